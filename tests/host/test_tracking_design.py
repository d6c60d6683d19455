# SPDX-License-Identifier: MIT
"""`meshkal design` of tracking scenarios: consensus and observability, computed again in NumPy (numerical Jacobians, eigenvalues of the
nonsymmetric matrices), the published scene of spec 4.3, and networks that cannot work."""
import json
import math
import pathlib
import subprocess

import numpy as np
import pytest

from tracking_reference import adjacency, check_sight, mean_path, metropolis, paper, ratio, runs, second


def scene(limit=None, **changes):
    """Spec 4.3."""
    nodes = [{"sensor": "range", "position_m": p, "R": [[1.0]]} for p in ([0, 0], [100, 0], [50, 90])]
    for node in nodes:
        if limit:
            node["range_limit_m"] = limit
    return {"name": "three", "model": {"motion": "constant-velocity", "states": ["px", "py", "vx", "vy"], "dt_s": 1.0, "acceleration_psd": 0.01,
                                       "x0": [10, 20, 1, 0.6], "P0": np.diag([25.0, 25, 1, 1]).tolist()},
            "nodes": nodes, "edges": [[0, 1], [1, 2]], "steps": 80,
            "tracking": {"consensus": {"protocol": "paper", "iterations": 10}}} | changes


@pytest.fixture
def design(run, tmp_path):
    """design(scenario, options ..., status=0) -> the JSON result; the text is result["text"], the complaint result["complaint"]."""
    def call(scenario, *options, status=0):
        (tmp_path / "s.json").write_text(json.dumps(scenario))
        done = run("design", tmp_path / "s.json", "--json", tmp_path / "r.json", *options, status=status)
        result = json.loads((tmp_path / "r.json").read_text())
        return result | {"text": done.stdout.decode(), "complaint": done.stderr.decode()}
    return call


# --- the published scene ---------------------------------------------------------------------------------------------

@pytest.mark.parametrize("limit,gaps", [(None, False), (100, False), (85, False), (80, False), (79, True), (70, True)])
def test_published_scene(design, limit, gaps):
    """On the straight line from x0 the second nearest sensor is never farther than 79.6 m."""
    s = scene(limit)
    r = design(s)
    assert r["failure"] is None
    path = mean_path(s)
    check_sight(s, r["observability"], path, np.arange(1, 81), 10)
    assert bool(r["observability"]["fewer_than_two_measure"]) == gaps
    assert any(w.startswith("fewer than two nodes measure") for w in r["warnings"]) == gaps
    hears = adjacency(s)
    case = {(c["weights"], c.get("measuring")): c for c in r["consensus"]["cases"]}
    assert case["paper", "all"]["converges"] and case["paper", "one"]["converges"] and case["metropolis", None]["converges"]
    assert not case["paper", "none"]["converges"] and case["paper", "none"]["period"] == 2
    assert abs(case["paper", "all"]["second_eigenvalue"] - second(paper(hears, [1, 1, 1]))) < 1e-13
    worst = [second(paper(hears, e)) for e in np.eye(3)]
    assert abs(case["paper", "one"]["second_eigenvalue"] - max(worst)) < 1e-12 and abs(worst[case["paper", "one"]["node"]] - max(worst)) < 1e-12
    assert np.allclose(r["consensus"]["perron_weights"], np.array([2, 3, 2]) / 7, atol=1e-15)
    assert abs(case["paper", "all"]["left"] - second(paper(hears, [1, 1, 1])) ** 10) < 1e-13


def test_one_sensor_along_a_noisy_path_is_named(design, tmp_path):
    """Its linearised information has full rank there, by the noise of the path alone: the condition number tells in most windows, the
    count of measuring nodes always."""
    s, rng = scene(), np.random.default_rng(2)
    s["nodes"] = [s["nodes"][0], {"sensor": "none"}, {"sensor": "none"}]
    path = np.column_stack((10 + np.arange(40.0), 20 + 0.6 * np.arange(40), np.ones(40), np.full(40, 0.6))) + 0.05 * rng.standard_normal((40, 4))
    (tmp_path / "t.csv").write_text("\n".join(["t,state,value", *(f"{t},{i},{x}" for t, row in enumerate(path) for i, x in enumerate(row))]))
    r = design(s, "--truth", tmp_path / "t.csv")
    values = check_sight(s, r["observability"], path, np.arange(40.0), 10)
    condition = values[:, -1] / values[:, 0]
    net = r["observability"]["network"]
    assert net["windows_unseen"] == 0 and net["ill_conditioned"] == runs(condition > 1e6) and net["windows_ill_conditioned"] > 31 / 2
    assert any(w.startswith("condition number above 1e+06 in") for w in r["warnings"])
    assert r["observability"]["fewer_than_two_measure"] == [[1, 40]]
    assert design(s, "--truth", tmp_path / "t.csv", "--condition", 1e30)["observability"]["network"]["windows_ill_conditioned"] == 0


@pytest.mark.once
def test_drawn_trajectories_of_the_published_scene(design):
    """With process noise a target leaves the straight line: below about 90 m most runs have intervals with fewer than two measuring nodes.
    Shares of runs and steps against as many runs drawn in NumPy; 4.4 standard errors of the difference, 1e-5 two-sided."""
    rng, runs_made = np.random.default_rng(21), 1000
    L = np.linalg.cholesky(0.01 * np.array([[1 / 3, 1 / 2], [1 / 2, 1]]))
    places, shares = np.array([node["position_m"] for node in scene()["nodes"]]), []
    for limit in (100, 90, 85, 80):
        p, v, few = np.tile([10.0, 20.0], (runs_made, 1)), np.tile([1.0, 0.6], (runs_made, 1)), np.zeros((runs_made, 80), bool)
        for t in range(80):
            w = L @ rng.standard_normal((runs_made, 2, 2))
            p, v = p + v + w[:, 0], v + w[:, 1]
            few[:, t] = (np.linalg.norm(p[:, None] - places, axis=2) <= limit).sum(axis=1) < 2
        s = scene(limit)
        s["model"]["start"] = "estimate"
        drawn = design(s, "--runs", runs_made)["drawn"]
        share, expected = drawn["runs_with_fewer_than_two"] / runs_made, few.any(axis=1).mean()
        assert abs(share - expected) < 4.4 * math.sqrt(2 * expected * (1 - expected) / runs_made)
        assert abs(drawn["fewer_than_two_measure"] - few.mean()) < 4.4 * math.sqrt(2) * few.mean(axis=1).std() / math.sqrt(runs_made)
        shares.append(share)
    assert shares == sorted(shares) and shares[2] > 0.5 > shares[0]


def test_cases_on_a_random_network(design):
    rng = np.random.default_rng(12)
    for n in (4, 13):
        nodes = [{"sensor": "range", "position_m": rng.uniform(-50, 50, 2).tolist(), "R": [[2.0]]} if k % 4 != 3 else {"sensor": "none"}
                 for k in range(n)]
        edges = sorted({(int(rng.integers(k)), k) for k in range(1, n)} |
                       {tuple(sorted(map(int, rng.choice(n, 2, replace=False)))) for _ in range(n // 3)})
        s = scene(nodes=nodes, edges=edges, steps=12, tracking={"consensus": {"protocol": "ratio", "iterations": 7}})
        r, hears = design(s), adjacency(s)
        sensing = np.array([node["sensor"] != "none" for node in nodes], float)
        expected = {("paper", "all"): second(paper(hears, sensing)), ("metropolis", None): second(metropolis(hears)),
                    ("ratio", None): second(ratio(hears)),
                    ("paper", "one"): max(second(paper(hears, e)) for e, there in zip(np.eye(n), sensing) if there)}
        for case in r["consensus"]["cases"]:
            key = case["weights"], case.get("measuring")
            if key not in expected:
                continue
            assert abs(case["second_eigenvalue"] - expected[key]) < 1e-10, key
            assert case["iterations"] == [max(1, math.ceil(math.log(a) / math.log(expected[key]))) for a in (1e-1, 1e-2, 1e-3, 1e-6, 1e-9)]
        pi = np.array(r["consensus"]["perron_weights"])
        assert np.abs(pi @ paper(hears, sensing) - pi).max() < 1e-15
        assert np.allclose(r["consensus"]["perron_scales"], 1 / (n * pi), rtol=1e-14)
        assert r["graph"]["without_sensor"] == [k for k in range(n) if k % 4 == 3]


def test_observability_of_every_sensor(design):
    """In space and in the plane, turning and straight, P0 with correlations, R with several rows."""
    rng = np.random.default_rng(5)
    kinds = ["range", "bearing", "range-bearing", "range-rate", "tdoa"]
    for dimensions, motion in ((2, "constant-turn"), (3, "constant-velocity"), (3, "constant-turn")):
        axes = "xyz"[:dimensions]
        states = [k + a for a in axes for k in "pv"] + (["omega"] if motion == "constant-turn" else [])
        n = len(states)
        X = rng.standard_normal((n, n)) * 0.3 + np.eye(n)
        nodes = []
        for i in range(6):
            kind = kinds[i % 5]
            rows = {"range": 1, "bearing": dimensions - 1, "range-bearing": dimensions, "range-rate": 1, "tdoa": 1}[kind]
            Y = rng.standard_normal((rows, rows)) * 0.2 + np.eye(rows)
            node = {"sensor": kind, "position_m": rng.uniform(-60, 60, dimensions).tolist(), "R": (Y @ Y.T).tolist(), "range_limit_m": 90.0}
            if kind == "tdoa":
                node["reference_m"] = rng.uniform(-60, 60, dimensions).tolist()
            nodes.append(node)
        x0 = [{"p": 20.0, "v": 3.0}.get(k[0], 0.15) + i for i, k in enumerate(states)]
        x0[-1] = 0.15 if motion == "constant-turn" else x0[-1]
        s = scene(nodes=nodes, edges=[[0, 1], [1, 2], [2, 3], [3, 4], [4, 5], [5, 0]], steps=25)
        s["model"] = {"motion": motion, "states": states, "dt_s": 0.5, "acceleration_psd": 0.1, "x0": x0, "P0": (X @ X.T).tolist()}
        r = design(s, "--window", 8)
        check_sight(s, r["observability"], mean_path(s), 0.5 * np.arange(1, 26), 8)


def test_recorded_truth(design, tmp_path):
    """Irregular times; only positions: velocities are differences. All states, shuffled: the same as in NumPy."""
    s, rng = scene(95), np.random.default_rng(4)
    s["nodes"][2]["sensor"] = "range-rate"  # whose derivative has the velocity in it
    times = np.cumsum(rng.uniform(0.2, 1.4, 40))
    position = np.column_stack((20 + 1.5 * times, 30 + 5 * np.sin(times / 5)))
    velocity = np.empty_like(position)
    velocity[1:-1] = (position[2:] - position[:-2]) / (times[2:] - times[:-2])[:, None]
    velocity[0], velocity[-1] = (position[1] - position[0]) / (times[1] - times[0]), (position[-1] - position[-2]) / (times[-1] - times[-2])
    path = np.column_stack((position, velocity))
    lines = [f"{t:.17g},{i},{x[i]:.17g}" for t, x in zip(times, path) for i in range(4)]
    rng.shuffle(lines)
    full, part = tmp_path / "full.csv", tmp_path / "part.csv"
    full.write_text("\n".join(["t,state,value", *lines]))
    part.write_text("\n".join(["t,state,value", *(line for line in lines if line.split(",")[1] in "01")]))
    a, b = design(s, "--truth", full, "--window", 6), design(s, "--truth", part, "--window", 6)
    assert a["observability"]["trajectory"] == "recorded"
    check_sight(s, a["observability"], path, times, 6)
    assert np.allclose(a["observability"]["network"]["eigenvalue_by_window"], b["observability"]["network"]["eigenvalue_by_window"], rtol=1e-9)
    assert "no velocity" in b["text"] and "no velocity" not in a["text"]


def test_recorded_truth_without_its_turn_rate(design, tmp_path):
    """What the file has nowhere stays as in x0: the same as a column of that value."""
    s = scene()
    s["model"] |= {"motion": "constant-turn", "states": ["px", "py", "vx", "vy", "omega"], "x0": [10, 20, 1, 0.6, 0.3],
                   "P0": np.diag([25.0, 25, 1, 1, 0.1]).tolist()}
    rows = [f"{t},{i},{v}" for t in range(30) for i, v in enumerate((20 + t, 30 + 0.5 * t * t / 10, 1, t / 10))]
    part, full, other = (tmp_path / name for name in ("part.csv", "full.csv", "other.csv"))
    part.write_text("\n".join(["t,state,value", *rows]))
    full.write_text("\n".join(["t,state,value", *rows, *(f"{t},4,0.3" for t in range(30))]))
    other.write_text("\n".join(["t,state,value", *rows, *(f"{t},4,0.1" for t in range(30))]))
    a, b, c = (design(s, "--truth", path) for path in (part, full, other))
    assert a["observability"] == b["observability"] != c["observability"]
    assert "states that the file does not have stay as in x0: 1" in a["text"]


OWN = """
#include <math.h>
#include <meshkal/plugin.h>
static mk_status_t h(const void *context, double dt, int count, const double *x, double *z) {
    const mk_plugin_context_f64_t *c = context;
    for (int i = 0; i < count; i++) {
        const double dx = x[i * c->n] - c->site.position[0], dy = x[i * c->n + 1] - c->site.position[1];
        z[2 * i] = sqrt(dx * dx + dy * dy);
        z[2 * i + 1] = atan2(dy, dx);
    }
    return MK_OK;
}
static void minus(const void *context, const double *a, const double *b, double *d) {
    d[0] = a[0] - b[0];
    d[1] = remainder(a[1] - b[1], 6.283185307179586);
}
static const mk_plugin_model_t model[] = {{.name = "own", .kind = MK_PLUGIN_SENSOR, .size = 2, .f64 = {.function = h, .difference = minus}}};
static const mk_plugin_t table = {MK_PLUGIN_VERSION, 1, model};
const mk_plugin_t *meshkal_plugin(void) { return &table; }
"""


def test_own_sensor_without_jacobian(design, tmp_path):
    """Central differences of the function, across the half turn too: the target moves straight at the sensor, from where azimuth is pi."""
    (tmp_path / "own.c").write_text(OWN)
    root = pathlib.Path(__file__).resolve().parents[2]
    subprocess.run(["gcc", "-std=c99", "-O2", "-shared", "-fPIC", f"-I{root}/include", f"-I{root}/port/host", tmp_path / "own.c", "-o",
                    tmp_path / "own.so", "-lm"], check=True)
    s = scene(steps=30)
    s["model"]["x0"] = [0, 0, 1, 0]
    s["nodes"] = [{"sensor": "range-bearing", "position_m": p, "R": [[1, 0], [0, 1e-4]]} for p in ([100, 0], [0, 70], [30, -30])]
    built_in = design(s)
    for node in s["nodes"]:
        node |= {"sensor": "plugin", "name": "own"}
    own = design(s, "--models", tmp_path / "own.so")
    for key in ("eigenvalue_by_window", "condition_by_window"):
        assert np.allclose(own["observability"]["network"][key], built_in["observability"]["network"][key], rtol=1e-7)
    assert np.allclose([n["smallest_eigenvalue"] for n in own["observability"]["nodes"]],
                       [n["smallest_eigenvalue"] for n in built_in["observability"]["nodes"]], rtol=1e-7)


# --- networks that cannot work ---------------------------------------------------------------------------------------

def cases(r):
    return {(c["weights"], c.get("measuring")): c for c in r["consensus"]["cases"]}


def test_one_node(design):
    s = scene(edges=[])
    s["nodes"] = [{"sensor": "range-bearing", "position_m": [0, 0], "R": [[1, 0], [0, 1e-3]]}]
    r = design(s)
    assert all(c["converges"] and c["second_eigenvalue"] == 0 and c["iterations"] == [1] * 5 for c in r["consensus"]["cases"])
    assert r["graph"]["isolated"] == [0] and not any("no links" in w for w in r["warnings"])
    assert r["observability"]["network"]["windows_unseen"] == 0


def test_one_blind_node_and_one_step(design):
    s = scene(edges=[], steps=1)
    s["nodes"] = [{"sensor": "none"}]
    r = design(s, status=1)
    assert "no node has a sensor" in r["complaint"] and r["observability"]["window"] == r["observability"]["steps"] == 1
    assert r["observability"]["network"]["states_seen_by_window"] == [0]


def test_two_nodes(design):
    """The smallest bipartite graph: swings if nobody measures."""
    s = scene(edges=[[0, 1]])
    s["nodes"] = s["nodes"][:2]
    case = cases(design(s))
    assert not case["paper", "none"]["converges"] and case["paper", "none"]["iterations"] == [None] * 5
    assert case["paper", "all"]["second_eigenvalue"] < 1e-15 and abs(case["paper", "one"]["second_eigenvalue"] - 0.5) < 1e-14


def test_no_links(design):
    r = design(scene(edges=[]), status=1)
    assert "falls into 3 parts" in r["complaint"] and r["failure"] in r["complaint"]
    assert r["graph"]["isolated"] == [0, 1, 2] and r["consensus"]["perron_weights"] is None
    assert not any(c["converges"] for c in r["consensus"]["cases"]) and "nodes 0, 1, 2 have no links" in r["text"]
    assert design(scene(edges=[]), "--allow-unobservable")["failure"] == r["failure"]


def test_disconnected_and_bipartite_parts(design):
    s = scene(edges=[[0, 1], [1, 2], [3, 4], [4, 5], [5, 3]])
    s["nodes"] = s["nodes"] * 2
    r = design(s, status=1)
    assert r["graph"]["parts"] == [{"nodes": [0, 1, 2], "bipartite": True}, {"nodes": [3, 4, 5], "bipartite": False}]
    assert "falls into 2 parts (nodes 0, 1, 2 is one)" in r["complaint"]


def test_triangle_without_readings_converges(design):
    case = cases(design(scene(edges=[[0, 1], [1, 2], [2, 0]])))
    assert case["paper", "none"]["converges"] and abs(case["paper", "none"]["second_eigenvalue"] - 0.5) < 1e-14


def test_blind_networks(design):
    s = scene()
    s["nodes"] = [{"sensor": "none"}] * 3
    r = design(s, status=1)
    assert "no node has a sensor" in r["complaint"] and {c.get("measuring") for c in r["consensus"]["cases"]} == {None, "none"}
    # One range sensor: the target may turn about it.
    s["nodes"] = [{"sensor": "none"}, scene()["nodes"][0], {"sensor": "none"}]
    r = design(s, status=1)
    net = r["observability"]["network"]
    assert "in no window" in r["complaint"] and net["windows_unseen"] == 71 and set(net["states_seen_by_window"]) <= {2, 3}
    assert r["observability"]["fewer_than_two_measure"] == [[1, 80]]
    # Out of reach of all, all the time.
    r = design(scene(0.5), status=1)
    assert r["observability"]["nobody_measures"] == [[1, 80]] and r["observability"]["network"]["least_states_seen"] == 0


def test_a_target_on_its_sensor_is_named(design):
    s = scene()
    s["nodes"][1]["position_m"] = [12.0, 21.2]
    s["model"]["x0"] = [11.0, 20.2, 1, 1.0]  # there exactly after a step
    r = design(s)
    assert any("1 readings have no derivative" in w and "node 1 at step 1" in w for w in r["warnings"]), r["warnings"]


def test_a_window_longer_than_the_run_is_the_run(design):
    r = design(scene(), "--window", 500)
    assert r["observability"]["window"] == 80 and len(r["observability"]["network"]["eigenvalue_by_window"]) == 1


def test_threads_change_nothing(design):
    a, b = design(scene(85), "--threads", 1), design(scene(85), "--threads", 3)
    assert a["observability"] == b["observability"] and a["consensus"] == b["consensus"]


def test_many_nodes(design):
    """Above LAPACK's share: Lanczos, and the worst node of those tried."""
    side = 25
    nodes = [{"sensor": "range", "position_m": [10.0 * (k % side), 10.0 * (k // side)], "R": [[1.0]], "range_limit_m": 30.0}
             for k in range(side * side)]
    edges = [[k, k + 1] for k in range(side * side) if k % side < side - 1] + [[k, k + side] for k in range(side * (side - 1))]
    s = scene(nodes=nodes, edges=edges, steps=20)
    r, hears = design(s), adjacency(s)
    case = cases(r)
    for key, P in ((("paper", "all"), paper(hears, np.ones(len(hears)))), (("metropolis", None), metropolis(hears))):
        root = np.sqrt(np.ones(len(hears)) if key[0] == "metropolis" else hears.sum(axis=1) + 1)
        values = np.linalg.eigvalsh(root[:, None] * P / root)
        assert case[key]["method"] == "Lanczos" and abs(case[key]["second_eigenvalue"] - max(-values[0], values[-2])) < 1e-10
    assert case["paper", "one"]["tried"] == 8 and case["paper", "one"]["second_eigenvalue"] >= case["paper", "all"]["second_eigenvalue"]


# --- wrong input -----------------------------------------------------------------------------------------------------

BAD = [(("--runs", "3", "--truth", "{}/hole.csv"), "--runs draws trajectories"),
       (("--tolerance", "0.1"), "--tolerance is for linear scenarios"), (("--c-header", "{}/h"), "--c-header is for linear scenarios"),
       (("--covariances",), "--covariances is for linear scenarios"), (("--window", "0"), "--window 0: must be an integer from 1"),
       (("--condition", "x"), "--condition x: must be a number"), (("--truth", "{}/none.csv"), "none.csv"),
       (("--truth", "{}/hole.csv"), "state 1 (py) has a value at 1 of 2 times"),
       (("--truth", "{}/two.csv"), "two.csv:3: t = 1, state 0 has a value already"),
       (("--truth", "{}/blind.csv"), "no values of state 1 (py), which is a position"), (("--truth", "{}/empty.csv"), "no values"),
       (("--truth", "{}/state.csv"), "state is 4: must be an integer from 0 to 3")]


@pytest.mark.parametrize("options,message", BAD)
def test_wrong_input(refused, tmp_path, options, message):
    (tmp_path / "s.json").write_text(json.dumps(scene()))
    for name, rows in (("hole", "1,0,1\n1,1,1\n2,0,1"), ("two", "1,0,1\n1,0,2"), ("blind", "1,0,1"), ("empty", ""), ("state", "1,4,1")):
        (tmp_path / f"{name}.csv").write_text("t,state,value\n" + rows + "\n")
    assert message in refused(tmp_path, "design", "{}/s.json", "--json", "{}/j", *options)


def test_a_linear_scenario_refuses_the_options(refused, tmp_path):
    linear = {"model": {"A": [[0.5]], "Q": [[1.0]]}, "nodes": [{"C": [[1.0]], "R": [[1.0]]}], "edges": []}
    (tmp_path / "s.json").write_text(json.dumps(linear))
    assert "--window is for scenarios that track a target" in refused(tmp_path, "design", "{}/s.json", "--window", "3")
