# SPDX-License-Identifier: MIT
"""`meshkal fit`: c, tests and blocks against an evaluation with SciPy, coverage through the program, the filters' tables against a log, and
what it says of data that do not fit. The statistics of the numbers themselves are in test_mismatch."""
import json

import numpy as np
import pytest
from logs import log as read_log
from scipy import special, stats

from test_mismatch import law, null_law, sample_c

# Nothing diagonal, nodes of one, two and three rows.
MIXED = {"name": "mixed",
         "model": {"A": [[0.9, 0.2], [-0.1, 0.8]], "Q": [[0.5, 0.2], [0.2, 0.4]], "input": [0.3, -0.1], "x0": [1, 2], "position_states": [0, 1]},
         "nodes": [{"C": [[1, 0.5]], "R": [[0.3]]}, {"C": [[0, 1], [1, 0]], "R": [[0.4, -0.1], [-0.1, 0.2]]},
                   {"C": [[1, 1], [1, -1], [0.5, 0]], "R": [[1, 0.3, 0.1], [0.3, 0.8, 0], [0.1, 0, 0.6]]}],
         "edges": [[0, 1], [1, 2]], "tolerance": 0.05}
SMALL = {"model": {"A": [[0.9]], "Q": [[0.2]]}, "nodes": [{"C": [[1]], "R": [[0.5]]}, {"C": [[2]], "R": [[1]]}], "edges": [[0, 1]]}


def draw(s, T, rng, Q=None, R={}, bias={}, common=0.0):
    """States (T x n) and readings, a T x m_k array a node; Q, R[k], bias[k] of the truth where they are not the model's."""
    model = s["model"]
    A, n = np.array(model["A"], float), len(model["A"])
    w = rng.multivariate_normal(np.zeros(n), model["Q"] if Q is None else Q, T, method="eigh")
    x = np.zeros((T, n))
    for t in range(1, T):
        x[t] = A @ x[t - 1] + model.get("input", np.zeros(n)) + w[t - 1]
    shared = common * rng.standard_normal((T, 1))
    y = [x @ np.array(d["C"], float).T + rng.multivariate_normal(np.zeros(len(d["R"])), R.get(k, d["R"]), T) + bias.get(k, 0) + shared
         for k, d in enumerate(s["nodes"])]
    return x, y


def write(folder, s, x, y, missing=()):
    """Scenario and CSV files; missing: (t, node) without reading. repr: all digits."""
    (folder / "s.json").write_text(json.dumps(s))
    (folder / "x.csv").write_text("t,state,value\n" + "".join(f"{t},{i},{float(v)!r}\n" for t, row in enumerate(x) for i, v in enumerate(row)))
    missing = set(missing)
    (folder / "y.csv").write_text("t,node,row,value\n" + "".join(
        f"{t},{k},{r},{float(v)!r}\n" for t in range(len(x)) for k in range(len(y)) if (t, k) not in missing for r, v in enumerate(y[k][t])))


@pytest.fixture
def fit(run, tmp_path):
    """fit(scenario, x, y, options) -> the JSON object, with the text in "text"."""
    def call(s, x, y, *options, missing=()):
        write(tmp_path, s, x, y, missing)
        done = run("fit", tmp_path / "s.json", "--states", tmp_path / "x.csv", "--measurements", tmp_path / "y.csv", "--json", tmp_path / "f.json",
                   *options)
        assert done.stderr == b""
        return json.loads((tmp_path / "f.json").read_text()) | {"text": done.stdout.decode()}
    return call


def residuals(s, x, y):
    """Of process and nodes, whitened by Cholesky factors: c does not care which root."""
    model = s["model"]
    parts = [(x[1:] - x[:-1] @ np.array(model["A"], float).T - model.get("input", np.zeros(len(x[0]))), model["Q"])]
    parts += [(y[k] - x @ np.array(d["C"], float).T, d["R"]) for k, d in enumerate(s["nodes"])]
    return [np.linalg.solve(np.linalg.cholesky(np.array(K, float)), z.T).T for z, K in parts]


def check_law(block, raw, bias, variance, rel=1e-9):
    nu = 2 * bias**2 / variance
    got = [block[k] for k in ("c_with_bias", "c", "statistic", "degrees", "p")]
    assert got == pytest.approx([raw, raw - bias, raw * nu / bias, nu, stats.chi2.sf(raw * nu / bias, nu)], rel=rel, abs=1e-12)


@pytest.mark.parametrize("seed,missing,wrong", [(1, False, False), (6, False, False), (2, True, False), (3, False, True), (4, True, True)])
def test_numbers(fit, seed, missing, wrong):
    rng = np.random.default_rng(seed)
    x, y = draw(MIXED, 150, rng, **({"Q": [[0.9, 0.1], [0.1, 0.3]], "bias": {1: 0.3}, "common": 0.3} if wrong else {}))
    gone = {(t, k) for t in range(150) for k in range(3) if missing and rng.uniform() < 0.1 * (k + 1)}
    f = fit(MIXED, x, y, missing=gone)
    U = residuals(MIXED, x, y)
    there = [np.ones(149, bool)] + [np.array([(t, k) not in gone for t in range(150)]) for k in range(3)]
    used = np.all([h[:149] for h in there], axis=0)
    assert (f["steps"], f["complete_steps"], f["joint"], f["nodes_left_out"]) == (149, used.sum(), True, 0)
    assert f["all"]["lags"] == 0 and f["all"]["kurtosis_p"] > 0.003, "white and normal with these seeds: the exact law holds"
    assert f["all"]["effective_steps"] == pytest.approx(used.sum(), rel=1e-12)
    joint = np.hstack([u[:149][used] for u in U])
    check_law(f["all"], sample_c(joint), *null_law(used.sum(), 8))
    names = ["process noise", "node 0", "node 1", "node 2", "between blocks"]
    assert [b["block"] for b in f["blocks"]] == names and [b["rows"] for b in f["blocks"]] == [2, 1, 2, 3, 8]
    for b, u, h in zip(f["blocks"], U, there):
        # One block in three hundred has significant tails by chance: that law holds the correction.
        c, variance, _, ratio, lags, statistic, degrees, probability = law(u[h])
        assert (b["steps"], b["lags"]) == (h.sum(), lags) and b["effective_steps"] == pytest.approx(h.sum() / ratio, rel=1e-9)
        assert [b[k] for k in ("c", "statistic", "degrees", "p")] == pytest.approx([c, statistic, degrees, probability], rel=1e-9, abs=1e-12)
    own = [np.array(null_law(used.sum(), u.shape[1])) for u in U]
    across = sample_c(joint) - sum(sample_c(u[:149][used]) for u in U)
    check_law(f["blocks"][4], across, *(np.array(null_law(used.sum(), 8)) - sum(own)), rel=1e-8)
    p = np.array([b["p"] for b in f["blocks"]])
    order = np.argsort(p)
    holm = np.minimum(np.maximum.accumulate(p[order] * (5 - np.arange(5))), 1)
    assert np.array([b["p_holm"] for b in f["blocks"]])[order] == pytest.approx(holm, rel=1e-12)
    assert f["blocks_rejected"] == (holm < 0.05).sum() and f["consistent"] == (f["all"]["p"] >= 0.05)
    assert f["consistent"] != wrong and f["tolerance"] == (max(f["all"]["c"], 0) if wrong else 0)
    assert ("verdict           consistent: c = 0" in f["text"]) == f["consistent"]
    shown = "  c                 0\n    without bias    -" if f["all"]["c"] < 0 else f"  c                 {f['all']['c']:.6g}\n  95 %"
    assert shown in f["text"]


def test_level_and_steps(fit):
    x, y = draw(MIXED, 200, np.random.default_rng(5), Q=[[0.8, 0.2], [0.2, 0.6]])
    found = [fit(MIXED, x, y, "--level", level) for level in (0.5, 0.9, 0.999)]
    low, high = [f["all"]["low"] for f in found], [f["all"]["high"] for f in found]
    assert low[0] > low[1] > low[2] and high[0] < high[1] < high[2] and "99.9 % interval" in found[2]["text"]
    assert len({f["all"]["c"] for f in found}) == 1
    short = fit(MIXED, x, y, "--steps", 100)
    assert short["all"] == fit(MIXED, x[:100], [v[:100] for v in y])["all"]


@pytest.mark.once
@pytest.mark.parametrize("truth,c", [({}, 0), ({"Q": [[0.4]]}, 1 - np.log(2)), ({"R": {1: [[3.0]]}, "bias": {0: 0.2}}, 2 - np.log(3) + 0.08)])
def test_coverage(run, tmp_path, truth, c):
    """Files, residuals and laws together: 200 repetitions through the program."""
    hit, rejected, rng = 0, 0, np.random.default_rng(6)
    for _ in range(200):
        write(tmp_path, SMALL, *draw(SMALL, 100, rng, **truth))
        run("fit", tmp_path / "s.json", "--states", tmp_path / "x.csv", "--measurements", tmp_path / "y.csv", "--json", tmp_path / "f.json")
        f = json.loads((tmp_path / "f.json").read_text())
        hit += f["all"]["low"] <= c <= f["all"]["high"]
        rejected += not f["consistent"]
    low, high = stats.binom.ppf([0.0005, 0.9995], 200, 0.95)
    assert low <= hit <= high, hit
    if c:
        assert rejected > 190
    else:
        assert 200 - rejected == hit, "0 is in the interval exactly when the test accepts"


def test_who_is_inconsistent(fit):
    """Nodes with another noise, a bias and noise in common are named, the rest is not; of many nodes the worst are shown."""
    rng = np.random.default_rng(7)
    many = SMALL | {"nodes": [{"C": [[1.0]], "R": [[0.5]]} for _ in range(30)], "edges": []}
    x, y = draw(many, 400, rng, R={4: [[1.5]]}, bias={9: 0.5})
    e = rng.standard_normal(400)
    for k in (20, 21):
        y[k] = x + 0.5**0.5 * (0.8 * e[:, None] + 0.6 * rng.standard_normal((400, 1)))
    f = fit(many, x, y, "--level", 0.999)
    assert {b["block"] for b in f["blocks"] if b["p_holm"] < 0.001} == {"node 4", "node 9", "between blocks"} and f["blocks_rejected"] == 3
    lines = f["text"].splitlines()
    shown = [line for line in lines if line.startswith(("node ", "process", "between"))]
    assert len(shown) == 12 and sorted(line[:14].strip() for line in shown[:3]) == ["between blocks", "node 4", "node 9"]
    assert "20 more with larger p" in lines and any(line.startswith("3 of 32 blocks") for line in lines)
    assert not any(" -0 " in line for line in lines)


def test_correlated_in_time(fit):
    """A slowly wandering sensor: fewer steps count, and the user is told."""
    rng = np.random.default_rng(8)
    x, y = draw(SMALL, 600, rng)
    v = rng.standard_normal(600) * 0.5**0.5 * 0.19**0.5
    for t in range(1, 600):
        v[t] += 0.9 * v[t - 1]
    y[0] = x + v[:, None]
    f = fit(SMALL, x, y)
    node = f["blocks"][1]
    # Mean 19 times the variance of independent residuals, square (1 + 0.81) / (1 - 0.81) times.
    assert node["effective_steps"] == pytest.approx(600 / ((19 + 9.5) / 2), rel=0.5) and node["white_p"] < 1e-50 and node["lags"] > 5
    assert f["blocks"][2]["effective_steps"] == pytest.approx(600) and "correlated in time: 599 steps count as " in f["text"]


def test_heavy_tails_are_told(fit):
    rng = np.random.default_rng(9)
    x, y = draw(SMALL, 500, rng)
    y[1] = 2 * x + rng.standard_t(3, (500, 1)) / 3**0.5
    f = fit(SMALL, x, y)
    assert "tails are not normal: kurtosis" in f["text"] and f["blocks"][2]["kurtosis_p"] < 1e-6 and f["blocks"][1]["kurtosis_p"] > 1e-3


# --- the simulator's own data, and its filters -----------------------------------------------------------------------

def simulated(run, path, *options):
    """States and readings of a log, node by node; the log's items."""
    header, items, _ = read_log(run("simulate", path, "--out", "-", *options).stdout)
    flat = np.array([i["measurements"] for i in items])
    return np.array([i["truth"] for i in items]), np.split(flat, np.cumsum(header["rows"])[:-1], axis=1), items


def test_simulated_data_are_consistent(run, fit, tmp_path):
    """20 nodes of the published example: 46 residuals a step."""
    path = tmp_path / "net.json"
    path.write_bytes(run("scenario", "projectile", "--nodes", 20, "--seed", 3).stdout)
    s, accepted, nees, estimates = json.loads(path.read_text()), 0, 0, []
    for seed in range(1, 7):
        x, y, _ = simulated(run, path, "--steps", 200, "--seed", seed)
        f = fit(s, x, y)
        accepted += f["consistent"]
        nees += f["filters"][0]["nees"][0]["verdict"] == f["filters"][0]["nis"][0]["verdict"] == "consistent"
        estimates.append(f["all"]["c"])
        assert f["consistent"] == (f["all"]["low"] == 0) and f["all"]["rows"] == 46 and f["joint"]
    # 0.1 % of: 3 or more of 6 rejected at 5 %; two tests a run of the centralised filter.
    assert accepted >= 4 and nees >= 3
    assert abs(np.mean(estimates)) < 4 * np.sqrt(null_law(199, 46)[1] / 6)


@pytest.mark.parametrize("lost", [False, True])
def test_filter_tables(run, fit, tmp_path, lost):
    """NIS and NEES of the second half, from the same node code's log; all states are positions, so the log has the whole V."""
    rng = np.random.default_rng(10)
    x, y = draw(MIXED, 120, rng, Q=[[2.0, 0.5], [0.5, 1.0]])
    f = fit(MIXED, x, y, missing={(t, k) for t in range(120) for k in range(3) if lost and (rng.uniform() < 0.3 or k == 2)})
    assert [g["filter"] for g in f["filters"]] == ["kfc", "kfd", "rkfdnu2"] and f["tolerance"] > 0.1
    if lost:
        assert f["nodes_left_out"] == 1 and f["blocks"][3]["left_out"] and "c" not in f["blocks"][3] and "1 node with too few readings left out" in f["text"]
    for g in f["filters"]:
        assert g["tolerance"] == (f["tolerance"] if g["filter"] == "rkfdnu2" else 0)
        log = run("simulate", tmp_path / "s.json", "--filter", g["filter"], "--measurements", tmp_path / "y.csv", "--truth", tmp_path / "x.csv",
                  "--tolerance", repr(f["tolerance"]), "--out", "-").stdout
        _, items, _ = read_log(log)
        items = items[60:]
        E = len(g["nis"])
        assert E == (1 if g["filter"] == "kfc" else 3)
        for e in range(E):
            rows = sum(int(i["nis_rows"][e]) for i in items)
            assert g["nis"][e]["mean"] == pytest.approx(sum(i["nis"][e] for i in items) / rows, rel=1e-10)
            V = np.array([i["position_covariance"].reshape(E, 3)[e] for i in items])[:, [[0, 1], [1, 2]]]
            d = np.array([i["truth"] - i["estimate"].reshape(E, 2)[e] for i in items])
            nees = np.einsum("ti,tij,tj->t", d, np.linalg.inv(V), d)
            assert g["nees"][e]["mean"] == pytest.approx(nees.mean() / 2, rel=1e-8)
            limits = stats.chi2.ppf([0.025 / E, 1 - 0.025 / E], rows) / rows
            assert [g["nis"][e]["low"], g["nis"][e]["high"]] == pytest.approx(limits, rel=1e-9)
            for m in (g["nis"][e], g["nees"][e]):
                assert m["low"] < 1 < m["high"]
                assert m["verdict"] == ("optimistic" if m["mean"] > m["high"] else "cautious" if m["mean"] < m["low"] else "consistent")
            # Steps of NEES count less than all and more than a few.
            spread = np.diff(stats.chi2.ppf([0.025 / E, 1 - 0.025 / E], 120) / 120)[0]
            assert spread * 0.999 < g["nees"][e]["high"] - g["nees"][e]["low"] < 5 * spread
    assert f["filters"][0]["nees"][0]["verdict"] == "optimistic", "three times the process noise"


def test_interval_of_central_nees(fit):
    """One state, one sensor: the autocorrelation of the error is (A M / V)^k, that of its square the square of it."""
    s = SMALL | {"nodes": SMALL["nodes"][:1], "edges": []}
    x, y = draw(s, 200, np.random.default_rng(11))
    f = fit(s, x, y)["filters"][0]["nees"][0]
    V = 1.0
    for _ in range(200):
        V = 0.81 / (1 / V + 2) + 0.2
    phi = 0.9 / (1 / V + 2) / V
    k = np.arange(1, 100)
    effective = 100 / (1 + 2 * ((1 - k / 100) * phi**(2 * k)).sum())
    assert [f["low"], f["high"]] == pytest.approx(stats.chi2.ppf([0.025, 0.975], effective) / effective, rel=1e-5)


def test_a_filter_that_cannot_run_says_so(fit):
    """Noise ten thousand times too small in the model: no robust filter with that c converges. The fit stands."""
    s = {"model": {"A": [[0.4, 0.2], [-0.7, 0.5]], "Q": [[1, 0], [0, 0]]}, "nodes": [{"C": [[1, 0]], "R": [[10]]}], "edges": []}
    x, y = draw(s, 100, np.random.default_rng(12), Q=[[40, 0], [0, 0]])
    f = fit(s, x, y)
    assert f["all"]["c"] > 10 and "does not converge" in f["filters"][2]["not_run"] and "rkfdnu2  not run: tolerance" in f["text"]
    assert "not_run" not in f["filters"][0]


# --- models and data at the edge -------------------------------------------------------------------------------------

def test_singular_process_noise(fit):
    """Noise enters one of two states: the same law as with that state's residual alone."""
    s = {"model": {"A": [[0.9, 0.1], [0.2, 0.7]], "Q": [[0.4, 0.2], [0.2, 0.1]]}, "nodes": [{"C": [[1, 0]], "R": [[0.5]]}], "edges": []}
    x, y = draw(s, 100, np.random.default_rng(13))
    f = fit(s, x, y)
    w = ((x[1:] - x[:-1] @ np.array(s["model"]["A"]).T) @ [2, 1])[:, None] / 5 / 0.1**0.5
    assert f["blocks"][0]["rows"] == 1 and f["all"]["rows"] == 2
    check_law(f["blocks"][0], sample_c(w), *null_law(99, 1), rel=1e-8)
    # Six digits are enough.
    assert fit(s, np.array([[float(f"{v:.7g}") for v in row] for row in x]), y)["all"]["c"] == pytest.approx(f["all"]["c"], rel=1e-3)


def test_no_process_noise(fit):
    s = SMALL | {"model": {"A": [[0.9]], "Q": [[0.0]], "input": [0.2]}}
    x, y = draw(s, 60, np.random.default_rng(14))
    f = fit(s, x, y)
    assert [b["block"] for b in f["blocks"]] == ["node 0", "node 1", "between blocks"] and f["all"]["rows"] == 2
    check_law(f["all"], sample_c(np.hstack(residuals(SMALL | {"model": s["model"] | {"Q": [[1.0]]}}, x, y)[1:])[:59]), *null_law(59, 2))


def test_more_rows_than_steps(fit):
    """The sum over blocks stands in, says so, and is the sum."""
    many = SMALL | {"nodes": [{"C": [[1.0]], "R": [[0.5]]} for _ in range(40)], "edges": []}
    x, y = draw(many, 50, np.random.default_rng(15))
    f = fit(many, x, y)
    assert not f["joint"] and f["all"]["rows"] == 41 and len(f["blocks"]) == 41
    assert "sum over blocks, taken as independent: a joint fit of 41 rows needs 51 steps with all readings" in f["text"]
    U = residuals(many, x, y)
    bias, variance = sum(np.array(null_law(len(u), 1)) for u in U)
    check_law(f["all"], sum(sample_c(u) for u in U), bias, variance)
    x, y = draw(many, 52, np.random.default_rng(15))
    assert fit(many, x, y)["joint"]


def test_correlated_residuals_need_more_steps(fit):
    rng = np.random.default_rng(16)
    many = SMALL | {"nodes": [{"C": [[1.0]], "R": [[0.5]]} for _ in range(10)], "edges": []}
    x, y = draw(many, 150, rng)
    for k in range(10):
        v = rng.standard_normal(150) * 0.36**0.5 * 0.5**0.5
        for t in range(1, 150):
            v[t] += 0.8 * v[t - 1]
        y[k] = x + v[:, None]
    f = fit(many, x, y)
    assert not f["joint"] and "and more of these, correlated in time as they are" in f["text"]


def test_partial_readings_are_counted(run, tmp_path):
    x, y = draw(MIXED, 80, np.random.default_rng(17))
    write(tmp_path, MIXED, x, y)
    lines = [line for line in (tmp_path / "y.csv").read_text().splitlines() if not line.startswith(("7,2,1,", "9,1,0,"))]
    (tmp_path / "y.csv").write_text("\n".join(lines))
    done = run("fit", tmp_path / "s.json", "--states", tmp_path / "x.csv", "--measurements", tmp_path / "y.csv", "--json", tmp_path / "f.json")
    assert json.loads((tmp_path / "f.json").read_text())["complete_steps"] == 77
    assert b"2 readings with some of their rows missing were left out whole" in done.stdout


# --- errors ----------------------------------------------------------------------------------------------------------

def broken(x, y):
    """name -> (scenario, states, readings, rest of the arguments, message)."""
    hole, end = x.copy().tolist(), x[:20].tolist()
    hole[5] = hole[5][:1]
    rank_one = MIXED | {"model": MIXED["model"] | {"Q": [[1, 0], [0, 0]]}}
    twin = MIXED | {"nodes": [MIXED["nodes"][0], MIXED["nodes"][0]], "edges": []}
    stuck = [y[0], x @ np.array(MIXED["nodes"][1]["C"]).T + 0.5, y[2]]
    return {"hole": (MIXED, hole, y, (), "x.csv: state 1 at t = 5 is missing: every state of every step is needed up to the last measurement, t = 29"),
            "end": (MIXED, end, y, (), "x.csv: no state 0 at t = 20: the states end there, the measurements go on to t = 29 (--steps 20 uses what"),
            "none": (MIXED, [], y, (), "x.csv: no state 0 at t = 0: the states end there"),
            "short": (MIXED, x, y, ("--steps", 5), "x.csv: 4 steps are too few: the 2 dimensions of the process noise need at least 6 states in a row"),
            "rank": (rank_one, x, y, (), "from t = 0 to 1 the state moves where the process noise Q has rank 1 of 2 and allows nothing"),
            "twin": (twin, x, [y[0], y[0]], (), "y.csv: the residuals of node 1 follow from those of the blocks before it: c is infinite (are the"),
            "stuck": (MIXED, x, stuck, (), "y.csv: the residuals of node 1 do not vary in all of their 2 dimensions: c is infinite"),
            "steps": (MIXED, x, y, ("--steps", 1), "--steps 1: must be an integer from 2 to"),
            "level": (MIXED, x, y, ("--level", 1), "--level 1: must be a number from 0.5 to 0.9999"),
            "place": (MIXED, x, y, ("--json", "{}/none/f"), "none/f: No such file or directory")}


@pytest.mark.parametrize("name", broken(np.zeros((30, 2)), [np.zeros((30, 1)), np.zeros((30, 2)), np.zeros((30, 3))]))
def test_errors(refused, tmp_path, name):
    s, x, y, rest, message = broken(*draw(MIXED, 30, np.random.default_rng(18)))[name]
    write(tmp_path, s, x, y)
    if len(x) != 30:
        (tmp_path / "y.csv").write_text("t,node,row,value\n" + "".join(f"{t},{k},{r},{v}\n" for k in range(3) for t, row in enumerate(y[k])
                                                                      for r, v in enumerate(row)))
    said = refused(tmp_path, "fit", "{}/s.json", "--states", "{}/x.csv", "--measurements", "{}/y.csv", *(() if "--json" in rest else ("--json", "{}/f")),
                   *rest)
    assert message in said, said


def test_wrong_arguments(refused, tmp_path):
    write(tmp_path, MIXED, *draw(MIXED, 30, np.random.default_rng(19)))
    assert refused(tmp_path, "fit", "{}/s.json", "--states", "{}/x.csv") == "fit: --states FILE.csv and --measurements FILE.csv are both needed"
    assert refused(tmp_path, "fit") == "fit: the scenario file is missing"
    assert "unknown option --truth" in refused(tmp_path, "fit", "{}/s.json", "--truth", "{}/x.csv")
    (tmp_path / "y.csv").write_text("t,node,row,value\n0,0,0,nan\n")
    assert "y.csv:2: column value is not finite" in refused(tmp_path, "fit", "{}/s.json", "--states", "{}/x.csv", "--measurements", "{}/y.csv")
    (tmp_path / "y.csv").write_text("t,node,row,value\n" + "".join(f"{t},0,0,1\n" for t in (0, 29)))
    assert "y.csv: no node has enough readings: one of 1 rows needs at least 4" in refused(
        tmp_path, "fit", "{}/s.json", "--states", "{}/x.csv", "--measurements", "{}/y.csv")


def test_help(run):
    assert b"meshkal fit SCENARIO.json" in run("help").stdout
