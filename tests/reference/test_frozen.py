# SPDX-License-Identifier: MIT
"""The frozen gain of `--frozen`: the headers' numbers against the definitions, and what it costs in a simulation."""
import json
import re

import numpy as np
import pytest

import reference as ref
from reference import CENTRAL, Network
from scenarios import MAKERS, blind_node, scenario
from test_simulate import read_sequence


def arrays(header):
    """The static arrays and the steady part of a generated header, hexadecimal floats read by Python."""
    text = header.read_text()
    found = {name: np.array([float.fromhex(v.rstrip("f")) for v in body.replace(",", " ").split()])
             for name, body in re.findall(r"mk_f(?:32|64)_t node\d+_(\w+)\[\d+\] = \{([^}]*)\}", text)}
    steady = re.search(r"_steady = \{[^}]*_W, (\S+?) /\* theta \*/, (\S+?) /\* trace P \*/,\s*(\S+?) /\* close", text)
    if steady:
        found["theta"], found["trace_P"], found["close"] = (float.fromhex(v.rstrip("f")) for v in steady.groups())
    return found, text


@pytest.mark.parametrize("real, precision", [("float64", 1e-8), ("float32", 1e-6)])
@pytest.mark.parametrize("name", list(MAKERS))
def test_gain_by_its_definition(meshkal, scenario_file, tmp_path, name, real, precision):
    s = scenario(name)
    net, want = Network(s), ref.design(s)
    meshkal("design", scenario_file(s), "--c-header", tmp_path / "h", "--frozen", 0.5, "--real", real, "--c-max", "none")
    for k, node in enumerate(want["nodes"]):
        got, text = arrays(tmp_path / "h" / f"node_{k:02d}.h")
        assert f"&node{k:02d}_steady" in text
        slots, m, V = net.slots[k], max(len(net.C[l]) for l in net.slots[k]), np.array(node["V"])
        assert slots[0] == k
        M = np.linalg.inv(np.linalg.inv(V) + sum(net.F[l] @ net.C[l] for l in slots))
        G = [net.A @ M @ net.F[l] for l in slots]
        Phi = net.A - sum(g @ net.C[l] for g, l in zip(G, slots))
        deviation = np.sqrt(np.diag(V))
        def close(a, b):
            assert (np.abs(a - b) / np.abs(b).max()).max() < precision if np.abs(b).max() > 0 else not a.any()
        close(got["Phi"].reshape(net.n, net.n).T / np.outer(deviation, 1 / deviation), Phi / np.outer(deviation, 1 / deviation))
        for l, (columns, g) in enumerate(zip(got["G"].reshape(len(slots), m, net.n), G)):
            close(columns[:g.shape[1]].T / deviation[:, None], g / deviation[:, None])
            assert not columns[g.shape[1]:].any()
        W, rows = np.linalg.inv(V), np.tril_indices(net.n)
        close(got["W"] * deviation[rows[0]] * deviation[rows[1]], (W * np.outer(deviation, deviation))[rows])
        assert got["theta"] == pytest.approx(node["theta"], rel=precision, abs=0)
        assert got["trace_P"] == pytest.approx(np.trace(np.array(node["P"])), rel=precision, abs=0)
        assert got["close"] >= 0.4999


def test_without_the_option_nothing_is_frozen(meshkal, scenario_file, tmp_path):
    meshkal("design", scenario_file(scenario("n1-stable-ring")), "--c-header", tmp_path / "h")
    got, text = arrays(tmp_path / "h" / "node_00.h")
    assert "steady" not in text and "Phi" not in got


def test_node_without_a_limit_is_named(meshkal, scenario_file, tmp_path):
    done = meshkal("design", scenario_file(blind_node()), "--c-header", tmp_path / "h", "--frozen", 1e-3, "--allow-unobservable")
    assert "node 0: its header has no frozen gain: its recursion does not converge" in done.stderr
    assert done.stderr.count("frozen") == 1, done.stderr
    got, text = arrays(tmp_path / "h" / "node_00.h")
    assert "Phi" not in got and "No frozen gain" in text
    got, text = arrays(tmp_path / "h" / "node_01.h")
    assert "Phi" in got


@pytest.fixture(scope="module")
def simulated(meshkal, scenario_file, tmp_path_factory):
    folder = tmp_path_factory.mktemp("frozen")

    def run(name, *arguments):
        log, summary = folder / "run.cbor", folder / "run.json"
        meshkal("simulate", scenario_file(scenario(name)), "--out", log, "--json", summary, *arguments)
        return read_sequence(log.read_bytes()), json.loads(summary.read_text())["filters"][0]
    return run


def apart(a, b):
    """Largest difference of two logs' estimates, in standard deviations that the node holds."""
    return max((np.abs(p["estimate"].astype(float) - q["estimate"]).reshape(len(q["trace_covariance"]), -1).max(axis=1)
                / np.sqrt(q["trace_covariance"])).max() for p, q in zip(a, b))


@pytest.mark.parametrize("filter", ["kfc", "rkfc", "kfd", "rkfdu", "rkfdnu2"])
@pytest.mark.parametrize("name, close, real, loss", [("n4-stable-path", 1e-9, "float64", 0.02), ("projectile-8", 1e-4, "float32", 0.0),
                                                     ("n3-integrating-complete", 1e-3, "float64", 0.01)])
def test_estimates_are_those_of_the_full_filter(simulated, name, close, real, loss, filter):
    options = ("--filter", filter, "--real", real, "--loss", loss, "--steps", 600)
    full, sums = simulated(name, *options)
    part, frozen_sums = simulated(name, *options, "--frozen", close)
    full, part = full[1:-1], part[1:-1]
    assert not any("frozen" in item for item in full)
    flags = np.array([item["frozen"] for item in part])
    assert flags.mean() > 0.1, flags.mean()
    C = Network(scenario(name)).C
    for a, b in zip(full, part):
        own = [b["estimate"].astype(float).reshape(len(b["theta"]), -1)[0 if filter in CENTRAL else k] for k in range(len(C))]
        want = b["measurements"] - np.concatenate([Ck @ x for Ck, x in zip(C, own)])
        lost = np.repeat(b["measurements_arrived"] == 0, [len(Ck) for Ck in C]) if filter in CENTRAL else np.zeros(len(want), bool)
        assert (np.isnan(b["innovation"]) == lost).all()
        assert np.allclose(b["innovation"][~lost], want[~lost], rtol=0, atol=8 * np.finfo(b["theta"].dtype).eps * np.abs(b["measurements"]).max())
        assert (a["measurements"] == b["measurements"]).all()
        assert ((b["nis_rows"] == 0) & (b["nis"] == 0) & (b["faults"] & 9 == 0))[b["frozen"] == 1].all()
    # float32 has an error of its own, the larger the further the target flies.
    exact = simulated(name, *options[:3], "float64", *options[4:])[0][1:-1] if real == "float32" else full
    rounding = apart(full, exact)
    assert apart(part, full) < 30 * close + 3 * rounding
    assert frozen_sums["msd"] == pytest.approx(sums["msd"], rel=60 * close + 3 * rounding)
    assert frozen_sums["mean_theta"] == pytest.approx(sums["mean_theta"], rel=60 * close + 1e-6, abs=1e-12)


def test_frozen_steps_do_not_dilute_the_nis(simulated):
    """Two full steps in the second half, three hundred in the whole of the other."""
    _, full = simulated("projectile-8", "--steps", 4000)
    _, part = simulated("projectile-8", "--steps", 4000, "--frozen", 1e-3)
    assert part["nis_ratio"] == pytest.approx(full["nis_ratio"], rel=0.25)


@pytest.mark.parametrize("arguments, message", [
    (("simulate", "{}", "--filter", "rkfdnu", "--frozen", 0.01), "--frozen: rkfdnu has another tolerance at every step"),
    (("simulate", "{}", "--frozen", 0), "--frozen 0: must be a number from 1e-12 to 0.5"),
    (("design", "{}", "--frozen", 0.01), "--frozen goes with --c-header"),
    (("design", "{}", "--frozen", "nan", "--c-header", "h"), "--frozen nan: must be a number from 1e-12 to 0.5")])
def test_refusals(meshkal, scenario_file, arguments, message):
    path = scenario_file(scenario("n1-stable-ring"))
    done = meshkal(*(str(path) if a == "{}" else a for a in arguments), ok=False)
    assert done.returncode == 2 and message in done.stderr, done.stderr


def test_kept_runs_belong_to_their_gain(meshkal, scenario_file, tmp_path):
    options = ("simulate", scenario_file(scenario("n1-stable-ring")), "--runs", 2, "--resume", tmp_path / "kept")
    meshkal(*options, "--frozen", 0.01)
    meshkal(*options, "--frozen", 0.01)
    meshkal(*options, ok=False)
    meshkal(*options, "--frozen", 0.02, ok=False)
