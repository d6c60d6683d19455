# SPDX-License-Identifier: MIT
"""`meshkal simulate` against the reference: the log's own measurements and arrival masks are fed to the dense filters
and every logged number is compared. The drawn data are tested against the model they claim to come from."""
import hashlib
import io
import json

import cbor2
import numpy as np
import pytest
from scipy import stats

import reference as ref
from reference import CENTRAL, FILTERS, Network
from scenarios import scenario

TYPES = {86: "<f8", 85: "<f4", 70: "<u4", 64: "u1"}       # RFC 8746, little-endian
COMPARED = ["projectile", "projectile-complete", "n1-integrating-single", "n2-unstable-star", "n4-stable-path",
            "n6-unstable-geometric", "n9-stable-ring"]


def typed(decoder, tag):
    return np.frombuffer(tag.value, TYPES[tag.tag]) if tag.tag in TYPES else tag


def read_sequence(data):
    """Items of a CBOR sequence."""
    stream, items = io.BytesIO(data), []
    while stream.tell() < len(data):
        items.append(cbor2.load(stream, tag_hook=typed))
    return items


class Log:
    """A log with its arrays stacked over the steps and cut into nodes and slots."""

    def __init__(self, data):
        items = read_sequence(data)
        self.header, self.items, self.end = items[0], items[1:-1], items[-1]
        self.slots, self.rows = self.header["slots"], self.header["rows"]
        lengths = [len(s) for s in self.slots]
        def stacked(key):
            return np.array([i[key] for i in self.items])
        def by_slot(key):
            return [np.split(i[key], np.cumsum(lengths)[:-1]) for i in self.items]
        self.truth, self.flat = stacked("truth"), stacked("measurements")
        self.y = [np.split(i["measurements"], np.cumsum(self.rows)[:-1]) for i in self.items]
        self.measured = by_slot("measurements_arrived")
        self.heard = None if self.header["filter"] in CENTRAL else by_slot("estimates_arrived")
        self.estimate = stacked("estimate").reshape(len(self.items), len(self.slots), -1)
        self.variance = stacked("variance").reshape(self.estimate.shape)
        for key in ("innovation", "innovation_variance", "error", "trace_covariance", "theta", "tolerance", "nis", "nis_rows", "faults"):
            setattr(self, key, stacked(key))


def test_reader_reads_a_sequence():
    number = cbor2.CBORTag(86, np.array([1.5, np.nan], "<f8").tobytes())
    items = read_sequence(cbor2.dumps({"a": 1}) + cbor2.dumps({"x": number}) + cbor2.dumps({"end": "complete"}))
    assert items[0] == {"a": 1} and items[2] == {"end": "complete"}
    assert items[1]["x"][0] == 1.5 and np.isnan(items[1]["x"][1])


@pytest.fixture(scope="module")
def simulated(meshkal, scenario_file, tmp_path_factory):
    """log(scenario, filter, steps, seed, options) of a run; each run once."""
    folder, made = tmp_path_factory.mktemp("simulate"), {}

    def run(s, name, steps, seed, *extra):
        key = (s["name"], name, steps, seed, *extra)
        if key not in made:
            out, summary = folder / f"{len(made)}.cbor", folder / f"{len(made)}.json"
            meshkal("simulate", scenario_file(s), "--filter", name, "--steps", steps, "--seed", seed, *extra,
                    "--out", out, "--json", summary)
            assert isinstance(json.loads(summary.read_text()), dict)
            made[key] = Log(out.read_bytes())
            made[key].bytes = out.read_bytes()
        return made[key]
    return run


# --- every number of the log ---------------------------------------------------------------------------------------

def compare(s, log, name, rel):
    net = Network(s)
    want = ref.run(s, name, log.y, log.measured, log.heard)
    # Rounding errors of an estimate are relative to the largest state, and no smaller than to the prior's uncertainty.
    scale = np.maximum(np.abs(log.truth).max(axis=1), np.sqrt(np.diag(net.P0).max()))
    gap = np.abs(log.estimate - want["estimate"]).max(axis=2) / scale[:, None]
    assert gap.max() < rel, f"estimate off by {gap.max():.2e} at step, estimator {np.unravel_index(gap.argmax(), gap.shape)}"
    for key in ("theta", "tolerance", "trace_covariance", "variance", "innovation_variance"):
        a, b = getattr(log, key), want[key]
        assert a.dtype == log.estimate.dtype and (np.isnan(a) == np.isnan(b)).all(), key
        a, b = a[~np.isnan(b)], b[~np.isnan(b)]
        off = np.abs(a - b) / np.where(b == 0, 1, np.abs(b))
        assert off.max() < rel, f"{key} off by {off.max():.2e} at {np.unravel_index(off.argmax(), off.shape)}"
    # nis = e'S^-1 e with e = y - C xh: a rounding `unit` x scale of y moves it by at most 2 sqrt(nis) |S^-1/2 de|, S >= R.
    unit = np.finfo(log.estimate.dtype).eps
    smallest = np.sqrt(min(np.linalg.eigvalsh(R)[0] for R in net.R))
    size = max(np.linalg.norm(C, 2) for C in net.C)
    off = np.abs(log.innovation - want["innovation"]) / (size * scale[:, None])
    assert (np.isnan(off) == np.isnan(want["innovation"])).all() and np.nanmax(off) < rel, f"innovation off by {np.nanmax(off):.2e}"
    de = 8 * unit * size * scale[:, None] * np.sqrt(np.maximum(want["nis_rows"], 1)) / smallest
    allowed = rel * (1 + want["nis"]) + 2 * np.sqrt(want["nis"]) * de + de**2
    off = np.abs(log.nis - want["nis"]) / allowed
    assert off.max() < 1, f"nis {log.nis.flat[off.argmax()]} for {want['nis'].flat[off.argmax()]}"
    assert (log.nis_rows == want["nis_rows"]).all()
    error = np.linalg.norm(log.truth[:, None, :] - log.estimate.astype(float), axis=2)
    assert np.allclose(log.error, error, rtol=max(1e-12, unit), atol=4 * unit * scale.max())
    return want


@pytest.mark.parametrize("loss", [None, 0.3])
@pytest.mark.parametrize("name", FILTERS)
@pytest.mark.parametrize("which", COMPARED)
def test_filters_in_float64(simulated, which, name, loss):
    s = scenario(which)
    log = simulated(s, name, 40, 7, *(["--loss", loss] if loss else []))
    compare(s, log, name, 1e-9)
    if not loss:
        assert all(np.concatenate(m).all() for m in log.measured)
        assert log.heard is None or all(np.concatenate(m).all() for m in log.heard)
        assert not log.faults.any()


@pytest.mark.parametrize("name,loss", [(f, None) for f in FILTERS] + [("rkfdnu2", 0.3), ("rkfc", 0.3)])
@pytest.mark.parametrize("which", COMPARED)
def test_filters_in_float32(simulated, which, name, loss):
    s = scenario(which)
    log = simulated(s, name, 40, 8, "--real", "float32", *(["--loss", loss] if loss else []))
    assert log.estimate.dtype == np.float32 and log.theta.dtype == np.float32 and log.nis.dtype == np.float32
    compare(s, log, name, 1e-3)


def test_header_and_end(simulated, scenario_file):
    s = scenario("n2-unstable-star")
    net, text = Network(s), scenario_file(s).read_bytes()
    for name in ("rkfdnu", "rkfc"):
        log = simulated(s, name, 40, 7)
        h = log.header
        assert h["format"] == "meshkal-log" and h["format_version"] == 1 and h["program"].startswith("meshkal ")
        assert h["scenario"].encode() == text and h["scenario_sha256"] == hashlib.sha256(text).hexdigest()
        assert (h["filter"], h["real"], h["source"], h["seed"], h["steps"]) == (name, "float64", "drawn", 7, 40)
        assert (h["states"], h["nodes"], h["rows"], h["dt_s"]) == (net.n, net.N, net.rows, 0.2)
        assert h["slots"] == ([list(range(net.N))] if name == "rkfc" else net.slots)
        assert h["estimators"] == len(h["slots"])
        assert [(i["run"], i["step"]) for i in log.items] == [(0, t) for t in range(40)]
        assert log.end == {"end": "complete", "items": 40}
        assert ("estimates_arrived" in log.items[0]) == (name == "rkfdnu")


def test_first_estimate_is_the_prior(simulated):
    s = scenario("n4-stable-path")
    net, log = Network(s), simulated(s, "rkfdnu", 40, 7)
    assert (log.estimate[0] == net.x0).all()
    assert log.trace_covariance[0] == pytest.approx(np.trace(net.P0), rel=1e-14)


# --- relations between the filters ---------------------------------------------------------------------------------

def test_same_draw_for_every_filter(simulated):
    """A comparison of filters is one of the same data."""
    s = scenario("n4-stable-path")
    logs = [simulated(s, name, 40, 7) for name in FILTERS]
    for log in logs[1:]:
        assert (log.truth == logs[0].truth).all() and (log.flat == logs[0].flat).all()
    logs = [simulated(s, name, 40, 7, "--loss", 0.3) for name in FILTERS if name not in CENTRAL]
    for log in logs[1:]:
        assert all((np.concatenate(a) == np.concatenate(b)).all() for a, b in zip(log.measured, logs[0].measured))
        assert all((np.concatenate(a) == np.concatenate(b)).all() for a, b in zip(log.heard, logs[0].heard))


def test_complete_graph_is_central(simulated):
    s = scenario("projectile-complete")
    log = simulated(s, "kfd", 40, 7)
    want = ref.run(s, "kfc", log.y)["estimate"]
    assert np.abs(log.estimate - want).max() < 1e-9 * np.abs(log.truth).max()
    robust = simulated(s, "rkfdnu", 40, 7)
    assert robust.tolerance == pytest.approx(np.full_like(robust.tolerance, s["tolerance"]), rel=1e-9)


@pytest.mark.parametrize("which", ["n2-stable-path-zero", "n6-integrating-path"])
def test_no_tolerance_is_the_plain_filter(simulated, which):
    s = scenario(which)
    plain = simulated(s, "kfd", 40, 9)
    for name in ("rkfdu", "rkfdnu", "rkfdnu2"):
        log = simulated(s, name, 40, 9)
        assert (log.theta == 0).all() and (log.tolerance == 0).all()
        assert (log.estimate == plain.estimate).all() and (log.trace_covariance == plain.trace_covariance).all()


def test_published_relations(simulated):
    """What every draw of the published experiment shows without a least favourable model."""
    s = scenario("projectile")
    uniform, local, stored = (simulated(s, name, 160, 3) for name in ("rkfdu", "rkfdnu", "rkfdnu2"))
    c = s["tolerance"]
    assert (local.tolerance <= c * (1 + 1e-9)).all()
    assert (local.theta[-1] < uniform.theta[-1]).all()
    assert np.abs(local.tolerance[-1] / stored.tolerance[-1] - 1).max() < 1e-4
    gap = np.abs(local.estimate - stored.estimate).max(axis=(1, 2))
    assert gap[120:].max() < 1e-2 and gap[120:].max() < 0.02 * np.median(local.error[120:])
    assert (np.ptp(stored.tolerance, axis=0) == 0).all()


# --- random numbers ------------------------------------------------------------------------------------------------

def test_seed_decides_every_byte(simulated, scenario_file, meshkal, tmp_path):
    s = scenario("n6-unstable-geometric")
    first = simulated(s, "rkfdnu", 40, 7, "--loss", 0.3)
    meshkal("simulate", scenario_file(s), "--filter", "rkfdnu", "--steps", 40, "--seed", 7, "--loss", 0.3,
            "--out", tmp_path / "again.cbor", "--json", tmp_path / "again.json")
    assert (tmp_path / "again.cbor").read_bytes() == first.bytes
    other = simulated(s, "rkfdnu", 40, 8, "--loss", 0.3)
    assert (other.truth != first.truth).all() and (other.flat != first.flat).all()


def whitened_noise(s, log):
    """Unit noise that the log claims to hold: process noise and every node's measurement noise, one column a component."""
    net = Network(s)
    def white(X, cov):
        return np.linalg.solve(np.linalg.cholesky(cov), X.T).T
    columns = [white(log.truth[1:] - log.truth[:-1] @ net.A.T - net.r, net.Q)]
    for k in range(net.N):
        v = np.array([y[k] for y in log.y]) - log.truth @ net.C[k].T
        columns.append(white(v[:-1], net.R[k]))
    return np.hstack(columns)


def check_white(U, level=1e-3):
    """Unit variance, zero mean, nothing correlated. The 99.9 % belongs to all entries of a matrix together."""
    T, d = U.shape
    low, high = stats.chi2.ppf([level / d / 2, 1 - level / d / 2], T)
    energy = (U**2).sum(axis=0)
    assert (low < energy).all() and (energy < high).all(), energy / T
    assert np.abs(U.mean(axis=0)).max() * np.sqrt(T) < stats.norm.isf(level / d / 2)
    for lag in (0, 1, 2):
        X = U[lag:].T @ U[:T - lag] / np.sqrt(T - lag)
        if lag == 0:
            np.fill_diagonal(X, 0)
        # Products of unit normals have unit variance and tails that the central limit has smoothed at this length.
        assert np.abs(X).max() < 1.05 * stats.norm.isf(level / d**2 / 2), f"lag {lag}"
    assert stats.kstest(U.ravel(), "norm").pvalue > level


@pytest.mark.parametrize("which", ["n4-stable-path", "n9-stable-ring", "n3-integrating-complete"])
def test_draws_obey_the_model(simulated, which):
    s = scenario(which)
    check_white(whitened_noise(s, simulated(s, "kfc", 4000, 5)))


def test_first_state_obeys_the_prior_and_seeds_are_unrelated(simulated):
    s = scenario("n4-stable-path")
    net = Network(s)
    x = np.array([simulated(s, "kfc", 1, seed).truth[0] for seed in range(1, 301)])
    check_white(np.linalg.solve(np.linalg.cholesky(net.P0), (x - net.x0).T).T)


@pytest.mark.parametrize("loss", [0.05, 0.3])
def test_losses(simulated, loss):
    """Every message is lost on its own with the given probability; what a node makes itself is always there."""
    s = scenario("n6-unstable-geometric")
    log = simulated(s, "kfd", 500, 5, "--loss", loss)
    masks = []
    for by_slot in (log.measured, log.heard):
        assert all(m[0] == 1 for step in by_slot for m in step), "a node always has its own"
        masks.append(np.array([np.concatenate([m[1:] for m in step]) for step in by_slot]))
    U = 1.0 - np.hstack(masks)
    low, high = stats.binom.ppf([0.0005, 0.9995], U.size, loss)
    assert low <= U.sum() <= high, U.mean()
    low, high = stats.binom.ppf([0.0005 / U.shape[1], 1 - 0.0005 / U.shape[1]], len(U), loss)
    assert (low <= U.sum(axis=0)).all() and (U.sum(axis=0) <= high).all(), U.mean(axis=0)
    # Two messages go missing together as often as chance has it. Counts, for rare losses are far from normal.
    d = U.shape[1]
    for lag in (0, 1):
        T = len(U) - lag
        together = U[lag:].T @ U[:T]
        if lag == 0:
            together = together[np.triu_indices(d, 1)]
        low, high = stats.binom.ppf([0.0005 / together.size, 1 - 0.0005 / together.size], T, loss**2)
        assert low <= together.min() and together.max() <= high, f"lag {lag}"
