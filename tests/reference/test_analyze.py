# SPDX-License-Identifier: MIT
"""`meshkal analyze` against the dense reference of the least favourable model: every number of its JSON."""
import copy
import hashlib
import json

import numpy as np
import pytest

import least_favourable as lf
from reference import CENTRAL, FILTERS, Network
from scenarios import blind_node, cycling_node, projectile, random_scenario, scenario

REL = 1e-9


def changed(name, base, tolerance=None, **model):
    """A scenario under another name, with other entries of its model; None takes one away."""
    s = copy.deepcopy(scenario(base))
    s["name"] = name
    s["tolerance"] = s["tolerance"] if tolerance is None else tolerance
    s["model"] = {key: value for key, value in {**s["model"], **model}.items() if value is not None}
    return s


def rank_one(*column):
    return (0.05 * np.outer(column, column)).tolist()


# Name: how it is made, horizon. Odd and even horizons: the steady step is rounded down.
CASES = {
    "projectile": (scenario, 6),
    "projectile-complete": (scenario, 16),
    "projectile-9": (lambda s: projectile(s, 5, N=9, mean_degree=4.0, weights="uniform"), 15),
    "n1-stable-ring": (scenario, 60),
    "n1-integrating-single": (scenario, 25),
    "n2-unstable-star": (scenario, 31),
    "n2-stable-path-zero": (scenario, 12),
    "n3-integrating-complete": (scenario, 17),
    "n3-unstable-geometric": (scenario, 33),
    "n4-stable-path": (scenario, 45),
    "n6-unstable-geometric": (scenario, 24),
    "n6-stable-star": (scenario, 21),
    "n9-stable-ring": (scenario, 18),
    "n9-integrating-single": (scenario, 13),
    "n9-unstable-complete": (scenario, 10),
    # Noise that drives one direction only; a tolerance far beyond every guarantee; no position.
    "n4-singular-noise": (lambda s: changed(s, "n4-integrating-ring", 0.02, Q=rank_one(0.5, 1.0, 0.2, 0.1)), 28),
    "n4-large-tolerance": (lambda s: changed(s, "n4-stable-path", 5.0), 19),
    "n5-no-positions": (lambda s: without_positions(random_scenario(s, 71, 5, "stable", "geometric", 6, "matrix", 0.1)), 15),
}
_made = {}


def without_positions(s):
    del s["model"]["position_states"]
    return s


def case(name):
    if name not in _made:
        _made[name] = CASES[name][0](name)
    return _made[name], CASES[name][1]


@pytest.fixture(scope="module")
def analyzed(meshkal, scenario_file, tmp_path_factory):
    """The JSON of a run, and what it printed; each run once."""
    folder, made = tmp_path_factory.mktemp("analyze"), {}

    def run(s, *arguments):
        key = (s["name"], *arguments)
        if key not in made:
            out = folder / f"{len(made)}.json"
            done = meshkal("analyze", scenario_file(s), *arguments, "--json", out)
            made[key] = json.loads(out.read_text()), done.stdout + done.stderr
        return made[key]
    return run


def close(got, want, what, scale=None):
    """To REL of `scale`, which by default is the number itself: a tolerance of 1e-7 counts like one of 1."""
    got, want = np.array(got, float), np.array(want, float)
    assert got.shape == want.shape, f"{what}: {got.shape} for {want.shape}"
    assert np.isfinite(got).all(), what
    gap, allowed = np.abs(got - want), REL * np.abs(want if scale is None else scale)
    worst = np.unravel_index((gap - allowed).argmax(), gap.shape)
    assert (gap <= allowed).all(), f"{what} at {tuple(map(int, worst))}: {got[worst]!r} for {want[worst]!r}"


def db(value):
    return 10 * np.log10(value)


# --- every number --------------------------------------------------------------------------------------------------

def compare(got, s, name, T, truth):
    want, steady = lf.errors(s, name, T, truth), T // 2
    E, central, gains, positions = want.E, want.model.central, want.gains, want.positions
    assert (got["filter"], got["truth"], got["tolerance"], got["horizon"]) == (name, truth, s["tolerance"], T)
    assert got["steady_step"] == steady and got["steady"] in (True, False)
    squares = want.squares()
    places = want.squares(positions) if positions else None
    for key, column in (("msd", squares), ("position_msd", places)):
        for part, values in ((got, column), (got["central"], column)):
            if column is None:
                assert part[key] is None and part[f"{key}_db"] is None
                continue
            values = values[:, :E].mean(axis=1) if part is got else values[:, E]
            close(part[key], values, f"{name} {key}")
            if got["steady"]:
                # A relative error of REL is one of 4.3 REL in dB.
                close(part[f"{key}_db"], db(values[steady]), f"{name} {key}_db", 4.4)
            else:
                assert part[f"{key}_db"] is None
    close(got["node_msd"], squares[steady, :E], f"{name} node_msd")
    if positions:
        close(got["node_position_msd"], places[steady, :E], f"{name} node_position_msd")
    else:
        assert got["node_position_msd"] is None
    for key in ("tolerance", "theta"):
        values = getattr(gains, key)
        close(got[f"node_{key}"], values[steady], f"{name} node_{key}")
        close(got[f"mean_{key}"], values[steady].mean(), f"{name} mean_{key}")
        if f"{key}_over_time" in got:
            close(got[f"{key}_over_time"], values, f"{name} {key}_over_time")
    close(got["central"]["theta"], central.theta[steady], "central theta")
    close(got["central"]["trace_V"], np.trace(central.V[steady]), "trace_V")


@pytest.mark.parametrize("truth", lf.TRUTHS)
@pytest.mark.parametrize("which", CASES)
def test_all_filters(analyzed, scenario_file, which, truth):
    s, T = case(which)
    got, _ = analyzed(s, "--filter", "all", "--truth", truth, "--horizon", T, "--per-step")
    assert (got["scenario"], got["truth"], got["tolerance"], got["horizon"]) == (s["name"], truth, s["tolerance"], T)
    digest = hashlib.sha256(scenario_file(s).read_bytes()).hexdigest()
    assert got["scenario_sha256"] == digest
    assert [f["filter"] for f in got["filters"]] == list(FILTERS)
    for name, part in zip(FILTERS, got["filters"]):
        assert part["scenario"] == s["name"] and part["scenario_sha256"] == digest
        assert "theta_over_time" in part and "tolerance_over_time" in part
        compare(part, s, name, T, truth)
        assert part["seconds"] >= 0 and part["peak_memory_bytes"] > 0
    assert got["seconds"] >= 0 and got["peak_memory_bytes"] > 0


@pytest.mark.parametrize("truth", lf.TRUTHS)
@pytest.mark.parametrize("which,name,node", [
    ("projectile", "rkfdnu", 3), ("projectile-9", "rkfdu", 8), ("n1-stable-ring", "rkfdnu2", 0),
    ("n1-integrating-single", "rkfdnu", 0), ("n2-unstable-star", "kfd", 2), ("n3-unstable-geometric", "rkfdnu2", 4),
    ("n6-stable-star", "rkfdu", 0), ("n9-stable-ring", "rkfdnu", 5), ("n4-singular-noise", "rkfdnu2", 1)])
def test_covariances_of_a_node(analyzed, which, name, node, truth):
    s, T = case(which)
    got, _ = analyzed(s, "--filter", name, "--truth", truth, "--horizon", T, "--node", node)
    compare(got, s, name, T, truth)
    assert "theta_over_time" not in got and "tolerance_over_time" not in got
    want, c, t = lf.errors(s, name, T, truth), got["covariance"], T // 2
    assert (c["node"], c["step"]) == (node, t)
    neighbours = [k for k in Network(s).near[node] if k != node]
    assert [v["node"] for v in c["neighbours"]] == neighbours
    blocks = [(c["own"], node), (c["central"], want.E), *((v["block"], v["node"]) for v in c["neighbours"])]
    for block, other in blocks:
        # Entry (i, j) counts beside the standard deviations i and j: two errors may be hardly correlated.
        scale = np.sqrt(np.outer(np.diag(want.block(t, node, node)), np.diag(want.block(t, other, other))))
        close(block, want.block(t, node, other), f"E x_{node} x_{other}'", scale)
    assert (np.array(c["own"]) == np.array(c["own"]).T).all()


# --- options -------------------------------------------------------------------------------------------------------

def numbers(result):
    """What does not depend on the machine."""
    if isinstance(result, dict):
        return {k: numbers(v) for k, v in result.items() if k not in ("seconds", "peak_memory_bytes")}
    return [numbers(v) for v in result] if isinstance(result, list) else result


def test_one_filter_is_its_part_of_all(analyzed):
    s, T = case("n4-stable-path")
    together, _ = analyzed(s, "--filter", "all", "--truth", "least-favourable", "--horizon", T, "--per-step")
    for part in together["filters"]:
        alone, _ = analyzed(s, "--filter", part["filter"], "--horizon", T, "--per-step")
        assert numbers(alone) == numbers(part)


def test_defaults(analyzed):
    s = case("n2-unstable-star")[0]
    got, _ = analyzed(s)
    assert (got["filter"], got["truth"], got["horizon"]) == ("rkfdnu2", "least-favourable", 200)
    assert len(got["msd"]) == 201 and got["steady"] is True


def test_other_tolerance(analyzed):
    s, T = case("n6-unstable-geometric")
    for c in (0.0, 1e-3):
        got, _ = analyzed(s, "--filter", "rkfdnu2", "--horizon", T, "--tolerance", c)
        compare(got, {**s, "tolerance": c}, "rkfdnu2", T, "least-favourable")


def test_threads_change_no_bit(analyzed):
    s, T = case("projectile-9")
    one, two = (analyzed(s, "--filter", "rkfdnu", "--horizon", T, "--per-step", "--threads", n)[0] for n in (1, 3))
    assert numbers(one) == numbers(two)


# --- steady or not -------------------------------------------------------------------------------------------------

def test_too_short_a_horizon_is_said(analyzed):
    got, printed = analyzed(case("projectile")[0], "--filter", "rkfdnu2", "--horizon", 10)
    assert got["steady"] is False and got["msd_db"] is None and got["steady_step"] == 5
    assert "too short" in printed and "--horizon" in printed, printed


@pytest.mark.parametrize("truth", lf.TRUTHS)
@pytest.mark.parametrize("which", ["n1-stable-ring", "n4-stable-path", "projectile-9"])
def test_what_is_called_steady_is(analyzed, which, truth):
    """Twice the horizon moves both ends away and leaves the value as it was; what it leaves is called steady at the latest when
    it has not moved by 0.001 dB."""
    s = case(which)[0]
    for name in ("kfd", "rkfdnu2"):
        for T in (50, 150, 400):
            got, far = (analyzed(s, "--filter", name, "--truth", truth, "--horizon", h)[0] for h in (T, 2 * T))
            moved = max(abs(db(x["msd"][T // 2]) - db(y["msd"][T])) for x, y in ((got, far), (got["central"], far["central"])))
            assert moved < 0.1 or not got["steady"], (name, T, moved)
        assert moved < 0.001 and got["steady"], (name, T, moved)


# --- the published experiment --------------------------------------------------------------------------------------

@pytest.mark.parametrize("seed", [1, 7])
def test_published_experiment(analyzed, seed):
    """RKFC -2.92, RKFDU -1.56, RKFDNU and RKFDNU2 -1.62 dB for a network that was not published."""
    T = 400                                               # some draws hold a node that settles slowly
    got, _ = analyzed(projectile(f"analyze-draw-{seed}", seed), "--filter", "all", "--horizon", T)
    e = {f["filter"]: f for f in got["filters"]}
    msd = {name: db(f["msd"][T // 2]) for name, f in e.items()}
    for f in e.values():
        assert np.ptp(db(np.array(f["msd"][T // 2 - 20:T // 2 + 21]))) < 0.003
    # Sixty draws, a little widened.
    for name, low, high in (("rkfc", -3.9, -1.2), ("kfd", -2.5, 1.4), ("rkfdu", -3.2, 0.6), ("rkfdnu", -3.2, 0.5)):
        assert low < msd[name] < high, msd
    assert msd["rkfc"] < msd["kfc"] and msd["rkfc"] < msd["rkfdnu"] < msd["rkfdu"] < msd["kfd"]
    assert 0.001 < msd["rkfdu"] - msd["rkfdnu"] < 0.25 and abs(msd["rkfdnu"] - msd["rkfdnu2"]) < 0.01
    assert 0.0140 < e["rkfdnu"]["mean_tolerance"] < 0.0163 and max(e["rkfdnu"]["node_tolerance"]) <= 0.02
    assert e["rkfdnu"]["mean_theta"] < e["rkfdu"]["mean_theta"] < 0.7 and 0.9 < e["rkfc"]["mean_theta"] < 1.7
    assert 1.2 < msd["rkfc"] - db(e["rkfc"]["central"]["trace_V"]) < 3.3


# --- refusals ------------------------------------------------------------------------------------------------------

@pytest.mark.parametrize("arguments,words", [
    (("--filter", "rkfc", "--node", 0), ["--node"]), (("--filter", "kfc", "--node", 0), ["--node"]),
    (("--node", 4), ["node", "4"]), (("--node", -1), ["--node"]), (("--filter", "median"), ["median"]),
    (("--truth", "worst"), ["worst"]), (("--horizon", -1), ["--horizon"]), (("--horizon", "long"), ["long"]),
    (("--tolerance", -0.1), ["--tolerance"]), (("--tolerance", "nan"), ["nan"])])
def test_wrong_arguments(meshkal, scenario_file, tmp_path, arguments, words):
    out = tmp_path / "out.json"
    done = meshkal("analyze", scenario_file(case("n2-stable-path-zero")[0]), *arguments, "--json", out, ok=False)
    assert done.returncode == 2 and not out.exists()
    assert all(word in done.stderr for word in words), done.stderr


@pytest.mark.parametrize("make,node", [(blind_node, "node 0"), (cycling_node, "node 6")])
def test_nodes_without_a_steady_state(meshkal, scenario_file, tmp_path, make, node):
    out = tmp_path / "out.json"
    done = meshkal("analyze", scenario_file(make()), "--horizon", 20, "--json", out, ok=False)
    assert done.returncode == 2 and not out.exists() and node in done.stderr, done.stderr
