# SPDX-License-Identifier: MIT
"""`meshkal design` against the reference: steady state of the central filter and of every node, local tolerances, the
guaranteed tolerance."""
import json

import numpy as np
import pytest

import reference as ref
from reference import Network
from scenarios import MAKERS, blind_node, cycling_node, projectile, scenario

TOLERANCE = 1e-8


def close(got, want, rel=TOLERANCE):
    """Covariances: entry (i, j) to `rel` of the standard deviations i and j. A small state next to a large one counts."""
    got, want = np.array(got, float), np.array(want, float)
    assert got.shape == want.shape
    deviation = np.sqrt(np.diag(want))
    worst = (np.abs(got - want) / np.outer(deviation, deviation)).max()
    assert worst < rel, f"off by {worst:.2e}\n{got}\n{want}"


@pytest.fixture(scope="module")
def designed(meshkal, scenario_file, tmp_path_factory):
    """Runs the program once a scenario."""
    folder, made = tmp_path_factory.mktemp("design"), {}

    def run(s, *extra):
        key = (s["name"], *extra)
        if key not in made:
            out = folder / f"{len(made)}.json"
            meshkal("design", scenario_file(s), "--json", out, *extra)
            made[key] = json.loads(out.read_text())
        return made[key]
    return run


@pytest.mark.parametrize("name", list(MAKERS))
def test_central_steady_state(designed, name):
    s = scenario(name)
    got, want = designed(s), ref.design(s)
    assert got["tolerance"] == s["tolerance"]
    assert got["central"]["theta"] == pytest.approx(want["central"]["theta"], rel=TOLERANCE, abs=0)
    close(got["central"]["P"], want["central"]["P"])
    close(got["central"]["V"], want["central"]["V"])


@pytest.mark.parametrize("name", list(MAKERS))
def test_node_steady_states(designed, name):
    s = scenario(name)
    net, got, want = Network(s), designed(s), ref.design(s)
    assert [v["node"] for v in got["nodes"]] == list(range(net.N))
    for g, w in zip(got["nodes"], want["nodes"]):
        assert g["degree"] == w["degree"]
        assert g["tolerance"] == pytest.approx(w["tolerance"], rel=TOLERANCE, abs=0), f"node {w['node']}"
        assert g["theta"] == pytest.approx(w["theta"], rel=TOLERANCE, abs=0), f"node {w['node']}"
        close(g["P"], w["P"])
        close(g["V"], w["V"])


@pytest.mark.parametrize("name", ["projectile", "n4-stable-path", "n6-stable-star", "n9-stable-ring", "n1-stable-ring"])
def test_local_tolerance_by_its_definition(designed, name):
    """Against the large stacked covariances, which share nothing with the n x n form. Only where rounding leaves digits."""
    s = scenario(name)
    net = Network(s)
    want = ref.steady_tolerances(net, ref.local_tolerance)
    got = [v["tolerance"] for v in designed(s)["nodes"]]
    assert got == pytest.approx(want, rel=TOLERANCE, abs=1e-12)


@pytest.mark.parametrize("name", list(MAKERS))
def test_local_tolerance_below_the_global_one(designed, name):
    s = scenario(name)
    net = Network(s)
    for v in designed(s)["nodes"]:
        assert v["tolerance"] <= net.c * (1 + 1e-9)
        if v["degree"] == net.N:
            assert v["tolerance"] == pytest.approx(net.c, rel=TOLERANCE)


def number(value):
    return np.inf if value is None else value


@pytest.mark.parametrize("name", list(MAKERS))
def test_guaranteed_tolerance(designed, name):
    s = scenario(name)
    net, got = Network(s), designed(s)
    table = {v["horizon"]: number(v["c_max"]) for v in got["c_max_by_horizon"]}
    assert table[got["c_max_horizon"]] == number(got["c_max"])
    short = [L for L in table if L <= 24]
    assert short, "no horizon small enough to check"
    for L in short:
        assert L >= net.n
        want = ref.c_max(net, L)
        assert table[L] == (pytest.approx(want, rel=1e-6) if np.isfinite(want) else np.inf), f"horizon {L}"
    values = [table[L] for L in sorted(table)]
    assert all(b >= a * (1 - 1e-6) for a, b in zip(values, values[1:])), "the bound grows with the horizon"


@pytest.mark.parametrize("name", ["projectile-8", "n1-stable-ring", "n3-integrating-complete", "n4-stable-path",
                                  "n2-stable-path-zero", "n6-unstable-geometric", "n9-integrating-single"])
def test_tolerances_per_step(designed, name):
    s, steps = scenario(name), 30
    net = Network(s)
    got = np.array(designed(s, "--per-step", steps)["per_step"])
    assert got.shape == (steps, net.N)
    want = ref.tolerances_per_step(net, steps)
    assert np.allclose(got, want, rtol=TOLERANCE, atol=0), np.abs(got / np.where(want == 0, 1, want) - 1).max()
    assert (got <= net.c * (1 + 1e-9)).all()


def test_tolerances_converge(designed):
    s = scenario("projectile")
    per_step = np.array(designed(s, "--per-step", 200)["per_step"])
    steady = [v["tolerance"] for v in designed(s)["nodes"]]
    gap = np.abs(per_step / steady - 1).max(axis=1)
    # The slowest mode of a poorly connected node fades by a few per cent a step.
    assert gap[199] < 1e-6 and gap[100] < 0.01


@pytest.mark.parametrize("seed", [41, 42])
def test_projectile_draws(designed, seed):
    """Other draws of the published experiment: the published sizes."""
    got = designed(projectile(f"design-draw-{seed}", seed))
    c = np.array([v["tolerance"] for v in got["nodes"]])
    assert 0.0140 < c.mean() < 0.0162
    assert 0.9 < got["central"]["theta"] < 1.7
    assert 0.2 < np.mean([v["theta"] for v in got["nodes"]]) < 0.7


def test_refuses_a_node_that_grows(meshkal, scenario_file, tmp_path):
    done = meshkal("design", scenario_file(blind_node()), "--json", tmp_path / "out.json", ok=False)
    assert "node 0" in done.stderr, done.stderr


def test_refuses_a_node_that_cycles(meshkal, scenario_file, tmp_path):
    """Bounded is not converged: the central filter and six nodes come to rest here, node 6 does not."""
    done = meshkal("design", scenario_file(cycling_node()), "--json", tmp_path / "out.json", ok=False)
    assert "node 6" in done.stderr, done.stderr
