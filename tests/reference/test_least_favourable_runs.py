# SPDX-License-Identifier: MIT
"""`meshkal simulate --truth least-favourable`: what is drawn, against the law it has to have. Fixed seeds; every test holds all
its comparisons together at LEVEL, and shows that data of the nominal model would not have passed."""
import copy
import json

import numpy as np
import pytest
from scipy import stats

import least_favourable as lf
from reference import CENTRAL, FILTERS, Network
from scenarios import scenario
from test_simulate import Log

LEVEL = 1e-4
IMPOSSIBLE = 1e-6


# --- statistics ----------------------------------------------------------------------------------------------------

def msd_p_values(msd, law, runs):
    """Two-sided p of each mean over `runs` draws of the mean square error. One draw is a weighted sum of chi-squares; the sum of
    thousands of them is a chi-square with the same two first moments."""
    p = []
    for t, value in enumerate(msd):
        lam = np.linalg.eigvalsh(law.X[t][:law.E * law.net.n, :law.E * law.net.n]) / law.E
        scale, freedom = (lam**2).sum() / lam.sum(), runs * lam.sum()**2 / (lam**2).sum()
        tails = stats.chi2.cdf(runs * value / scale, freedom), stats.chi2.sf(runs * value / scale, freedom)
        p.append(2 * min(tails))
    return np.array(p)


def covariance_p_value(chi, X):
    """p of draws (one a row) from N(0, X): mean and every entry of the covariance, and nothing where X has no room."""
    lam, U = np.linalg.eigh(X)
    kept = lam > 1e-9 * lam[-1]
    assert np.abs(chi @ U[:, ~kept]).max(initial=0) < 1e-3 * np.sqrt(lam[-1]), "an error outside the law's support"
    Z = chi @ U[:, kept] / np.sqrt(lam[kept])
    runs, d = Z.shape
    energy = (Z**2).sum(axis=0)
    # Given the other column, a column of unit normals times it, over its length, is a unit normal.
    products = (Z.T @ Z / np.sqrt(energy))[np.triu_indices(d, 1)]
    p = np.concatenate([2 * np.minimum(stats.chi2.cdf(energy, runs), stats.chi2.sf(energy, runs)),
                        2 * stats.norm.sf(np.abs(products)), 2 * stats.norm.sf(np.abs(Z.mean(axis=0)) * np.sqrt(runs))])
    return p.min() * len(p)


def regression_p_values(z, e, H, S):
    """(p of the slope being H, p of the residual having covariance S) for rows z = H e + noise."""
    G = e.T @ e
    slope = np.linalg.solve(G, e.T @ z).T
    off = np.linalg.solve(np.linalg.cholesky(S), (slope - H) @ np.linalg.cholesky(G))
    # The residual of least squares is what unit normals in runs - n dimensions leave.
    rest = z - e @ slope.T
    basis = np.linalg.svd(e, full_matrices=False)[0]
    refill = np.random.default_rng(0).standard_normal((e.shape[1], len(S))) @ np.linalg.cholesky(S).T
    return stats.chi2.sf((off**2).sum(), off.size), covariance_p_value(rest + basis @ refill, S)


def draw_errors(s, name, T, truth, runs, seed):
    """Stacked errors [t][run] as the reference draws them: to try the statistics without the program."""
    law, rng = lf.errors(s, name, T, truth), np.random.default_rng(seed)
    chi = [rng.multivariate_normal(np.zeros(law.net.n), law.net.P0, runs) @ np.tile(np.eye(law.net.n), law.E + 1)]
    for t in range(T + 1):
        Fx, Ex = lf.step_matrices(law.model, name, law.gains, t)
        noise = rng.multivariate_normal(np.zeros(Ex.shape[1]), law.model.K[t], runs)
        chi.append(chi[-1] @ Fx.T + noise @ Ex.T)
    return np.array(chi)


@pytest.mark.parametrize("which,name", [("n2-unstable-star", "rkfdnu2"), ("n4-stable-path", "kfd"), ("n3-integrating-complete", "rkfdu")])
def test_statistics_know_right_from_wrong(which, name):
    s, T, runs = scenario(which), 10, 2000
    law = lf.errors(s, name, T)
    for truth in lf.TRUTHS:
        chi = draw_errors(s, name, T, truth, runs, 1)
        msd = (chi[:, :, :law.E * law.net.n]**2).sum(axis=2).mean(axis=1) / law.E
        by_msd = msd_p_values(msd, law, runs)[:T + 1].min() * (T + 1)
        by_covariance = min(covariance_p_value(chi[t], law.X[t]) for t in (0, 1, 5, T)) * 4
        if truth == "nominal":
            assert by_msd < IMPOSSIBLE and by_covariance < IMPOSSIBLE
        else:
            assert by_msd > 1e-3 and by_covariance > 1e-3


# --- the program ---------------------------------------------------------------------------------------------------

CASES = {"projectile-8": (0.5, 8), "n1-stable-ring": (0.5, 8), "n2-unstable-star": (0.5, 7), "n3-integrating-complete": (0.2, 7),
         "n4-stable-path": (0.5, 7), "n4-singular": (0.2, 7)}
RUNS, LOGGED = 1200, 1600


def case(which):
    tolerance, T = CASES[which]
    base = "n4-integrating-ring" if which == "n4-singular" else which
    s = {**copy.deepcopy(scenario(base)), "name": f"{which}-runs", "tolerance": tolerance}
    if which == "n4-singular":
        s["model"]["Q"] = (0.05 * np.outer([0.5, 1.0, 0.2, 0.1], [0.5, 1.0, 0.2, 0.1])).tolist()
    return s, T


@pytest.fixture(scope="module")
def drawn(meshkal, scenario_file, tmp_path_factory):
    """(summary, log or None) of a simulation; each once."""
    if "least-favourable" not in meshkal("help").stdout.split("meshkal simulate", 1)[1].split("\nmeshkal ", 1)[0]:
        pytest.skip("`meshkal help` does not list least-favourable for simulate")
    folder, made = tmp_path_factory.mktemp("runs"), {}

    def run(s, name, T, truth, runs, seed, log=False):
        key = (s["name"], name, T, truth, runs, seed, log)
        if key not in made:
            summary, out = folder / f"{len(made)}.json", folder / f"{len(made)}.cbor"
            horizon = ["--horizon", T] if truth == "least-favourable" else []
            meshkal("simulate", scenario_file(s), "--truth", truth, *horizon, "--filter", name, "--steps", T + 1, "--runs", runs,
                    "--seed", seed, "--json", summary, *(["--out", out] if log else []))
            made[key] = json.loads(summary.read_text()), Log(out.read_bytes()) if log else None
        return made[key]
    return run


@pytest.mark.parametrize("which", CASES)
def test_msd_over_time(drawn, which):
    """All filters at all steps."""
    s, T = case(which)
    got, _ = drawn(s, "all", T, "least-favourable", RUNS, 5)
    other, _ = drawn(s, "all", T, "nominal", RUNS, 5)
    assert [f["filter"] for f in got["filters"]] == list(FILTERS)
    right, wrong = [], []
    for name, f, g in zip(FILTERS, got["filters"], other["filters"]):
        right.append(msd_p_values(f["msd_over_time"], lf.errors(s, name, T), RUNS))
        wrong.append(msd_p_values(g["msd_over_time"], lf.errors(s, name, T), RUNS))
        assert len(right[-1]) == T + 1
        assert msd_p_values(g["msd_over_time"], lf.errors(s, name, T, "nominal"), RUNS).min() * (T + 1) > LEVEL
        # Each node on its own: mean over the second half of the steps, whose laws the reference knows one by one.
        law = lf.errors(s, name, T)
        want = law.squares()[got["steady_from"]:, :law.E]
        assert np.abs(np.array(f["node_msd"]) / want.mean(axis=0) - 1).max() < 6 * np.sqrt(2 / RUNS), name
    assert np.min(right) * np.size(right) > LEVEL, (np.array(right).argmin() // (T + 1), np.min(right))
    assert np.min(wrong) < IMPOSSIBLE


@pytest.mark.parametrize("which,name", [("projectile-8", "rkfdnu2"), ("n4-stable-path", "rkfdnu"), ("n2-unstable-star", "kfd"),
                                        ("n4-singular", "kfc"), ("n3-integrating-complete", "rkfc")])
def test_errors_of_all_nodes_together(drawn, which, name):
    """Every block of X(t), from the states and estimates of a log; which do not have the law of the nominal model."""
    s, T = case(which)
    _, log = drawn(s, name, T, "least-favourable", LOGGED, 6, True)
    chi, times = (log.truth[:, None, :] - log.estimate).reshape(LOGGED, T + 1, -1), (0, 1, T // 2, T)
    def p_value(truth):
        X = [lf.errors(s, name, T, truth).X[t][:chi.shape[2], :chi.shape[2]] for t in times]
        return min(covariance_p_value(chi[:, t], Y) for t, Y in zip(times, X)) * len(times)
    assert p_value("least-favourable") > LEVEL
    assert p_value("nominal") < IMPOSSIBLE


@pytest.mark.parametrize("which", ["n4-stable-path", "n6-stable-star", "n2-unstable-star"])
def test_noise_is_what_the_adversary_makes_of_the_error(drawn, which):
    """z = [x(t+1) - A x - r; y - C x] = [B; D] (H e + L eps): the slope on e and the covariance of the rest, at every step."""
    s, T = {**scenario(which), "name": f"{which}-noise", "tolerance": 0.5}, 6
    _, log = drawn(s, "rkfc", T, "least-favourable", LOGGED, 7, True)
    net = Network(s)
    x, y = log.truth.reshape(LOGGED, T + 1, -1), log.flat.reshape(LOGGED, T + 1, -1)
    e = x - log.estimate.reshape(x.shape)
    z = np.concatenate([x[:, 1:] - x[:, :-1] @ net.A.T - net.r, (y - x @ np.vstack(net.C).T)[:, :-1]], axis=2)
    def p_values(truth):
        m = lf.model(s, T, truth)
        BD = np.vstack([m.B, m.D])
        return np.array([regression_p_values(z[:, t], e[:, t], BD @ m.H[t], BD @ m.K[t] @ BD.T) for t in range(T)]).min(axis=0)
    slope, rest = p_values("least-favourable") * T
    assert slope > LEVEL and rest > LEVEL, (slope, rest)
    slope, rest = p_values("nominal")
    assert slope < IMPOSSIBLE and rest < IMPOSSIBLE, (slope, rest)
