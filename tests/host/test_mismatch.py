# SPDX-License-Identifier: MIT
"""c of a residual sample (tools/meshkal/fit/mismatch.c): formulas against SciPy, coverage of the interval, size and power of the test. The
samples are drawn here; 500 repetitions each, whose 99.9 % binomial limits about 95 % are 91.4 and 98."""
import ctypes

import numpy as np
import pytest
from scipy import optimize, signal, special, stats


class Mismatch(ctypes.Structure):
    _fields_ = [("steps", ctypes.c_int), ("rows", ctypes.c_int),
                *((n, ctypes.c_double) for n in ("raw", "bias", "variance", "signal", "spread", "degrees")), ("lags", ctypes.c_int),
                *((n, ctypes.c_double) for n in ("white_p", "kurtosis", "tails_p"))]


@pytest.fixture(scope="module")
def lib(shared):
    library = shared("tools/meshkal/fit/mismatch.c", "port/host/distributions.c", "port/host/error.c", "src/meshkal/meshkal.c")
    library.mk_mismatch_test.restype = library.mk_long_run.restype = ctypes.c_double
    return library


@pytest.fixture(scope="module")
def fit(lib):
    """fit(U, level) -> the sample's numbers, p of the test, interval. U: steps x rows, whitened."""
    def call(U, level=0.95):
        U, m, bad = np.ascontiguousarray(U), Mismatch(), ctypes.c_int(-1)
        S = np.empty(U.shape[1] * (U.shape[1] + 1) // 2)
        pointer = [a.ctypes.data_as(ctypes.c_void_p) for a in (U, S)]
        m.good = lib.mk_mismatch_make(ctypes.byref(m), *U.shape, *pointer, ctypes.byref(bad))
        m.bad, m.S = bad.value, S
        if m.good:
            out = [ctypes.c_double() for _ in range(4)]
            m.p = lib.mk_mismatch_test(ctypes.byref(m), *map(ctypes.byref, out[:2]))
            lib.mk_mismatch_interval(ctypes.byref(m), ctypes.c_double(level), *map(ctypes.byref, out[2:]))
            m.statistic, m.nu, m.low, m.high = (o.value for o in out)
            m.c = m.raw - m.bias
        return m
    return call


def divergence(S, mu):
    return np.trace(S) + mu @ mu - np.linalg.slogdet(S)[1] - len(S)


# --- the header's formulas, written again ----------------------------------------------------------------------------

def null_law(T, p):
    i = np.arange(1, p + 1)
    return -special.digamma((T - i) / 2).sum() - p * np.log(2 / T), special.polygamma(1, (T - i) / 2).sum() - 2 * p / T


def sample_c(U):
    """With its bias."""
    V = U - U.mean(axis=0)
    return divergence(V.T @ V / len(U), U.mean(axis=0))


def long_run(y, least):
    y = y - y.mean()
    total, k = 1.0, 1
    while k <= min(len(y) // 4, 1000):
        r = (y[:-k] @ y[k:]) / (y @ y)
        if k > least and r <= 3 / len(y)**0.5:
            break
        total, k = total + 2 * r, k + 1
    return max(total, 1.0)


def law(U):
    """c, variance, signal, r, lags, statistic, degrees, p."""
    T, p = U.shape
    d, m = p * (p + 3) / 2, U.mean(axis=0)
    V = U - m
    S = V.T @ V / T
    a = V / np.sqrt(np.diag(S))
    products, means, lags = np.zeros((p, p)), np.zeros(p), 0
    for k in range(1, min(T // 4, 1000) + 1):
        r = (a[:-k] * a[k:]).sum(axis=0) / T + 1 / T
        if T * (r @ r) < stats.chi2.isf(0.001, p):
            break
        means, products, lags = means + 2 * r, products + 2 * np.outer(r, r) - 2 / T * np.eye(p), k
    if lags:
        every = np.concatenate([np.maximum(1 + means, 0.1), 1 + products[np.tril_indices(p)]])
        time, unequal = max(every.mean(), 1), (every**2).mean() / every.mean()**2
    else:
        time, unequal = 1, 1
    fourth = (np.einsum("ti,ij,tj->t", V, np.linalg.inv(S), V)**2).mean()
    sd = np.sqrt(8 * p * (p + 2) * (T - 3) * (T - p - 1) * (T - p + 1) / ((T + 1)**2 * (T + 3) * (T + 5)))
    heavy = abs(fourth - p * (p + 2) * (T - 1) / (T + 1)) > 3 * sd
    tails = (p + ((T + 1) / (T - 1) * fourth - p) / 2) / d if heavy else 1
    ratio = time * tails
    bias, variance = null_law(max(T / ratio, p + 2), p)
    variance *= unequal
    y = np.einsum("ti,ij,tj->t", V, np.eye(p) - np.linalg.inv(S), V) + 2 * V @ m
    plain = 2 * ((S - np.eye(p))**2).sum() + 4 * m @ S @ m
    nu, W = T - 1, S * T / (T - 1)
    square = nu**2 / ((nu - 1) * (nu + 2)) * ((W**2).sum() - np.trace(W)**2 / nu)
    unbiased = 2 * (square - 2 * np.trace(W) + p) + 4 * (m @ W @ m - square / T)
    slope = (y.var() if heavy else plain) + y.var() * (long_run(y, lags) - 1) - ratio * (plain - unbiased)
    raw = sample_c(U)
    degrees = 2 * bias**2 / variance
    return raw - bias, variance, slope / T, ratio, lags, raw * degrees / bias, degrees, stats.chi2.sf(raw * degrees / bias, degrees)


def interval(c_hat, variance, slope, nu, level):
    """Feldman and Cousins with Pearson's approximation, as the header says: all c that are accepted, by a search for its ends."""
    error = 1 - level
    inside, outside = stats.norm.isf([error, error / 2])

    def acceptance(c):
        """(probability of an estimate as low) - (error on that side), and the same for high."""
        sd = np.sqrt(variance + slope * c)
        shift = nu / 2 * slope * c / variance
        k = (nu + 2 * shift)**3 / (nu + 3 * shift)**2
        at, s = k + (c_hat - c) / sd * np.sqrt(2 * k), c / sd
        if s >= outside:
            d = outside
        elif s < 1e-12:
            d = inside
        else:
            d = optimize.brentq(lambda d: stats.norm.cdf(d) - stats.norm.cdf(-(s**2 + d**2) / (2 * s)) - level, inside - 1e-9, outside + 1e-9, xtol=1e-13)
        high = min(stats.norm.sf(d), error)
        return stats.chi2.cdf(at, k) - (error - high), stats.chi2.sf(at, k) - high
    start = max(c_hat, 0)
    top = start + np.sqrt(variance)
    while acceptance(top)[0] > 0:
        top = 2 * top + 1e-6
    low = 0 if acceptance(0)[1] >= 0 else optimize.brentq(lambda c: acceptance(c)[1], 0, start, xtol=1e-13)
    return low, optimize.brentq(lambda c: acceptance(c)[0], start, top, xtol=1e-13)


def autoregressive(rng, T, p, phi):
    phi = np.broadcast_to(phi, p)
    e = rng.standard_normal((T, p)) * np.r_[[np.ones(p)], np.broadcast_to(np.sqrt(1 - phi**2), (T - 1, p))]
    return np.column_stack([signal.lfilter([1], [1, -f], e[:, i]) for i, f in enumerate(phi)])


@pytest.mark.parametrize("T,p", [(7, 2), (100, 1), (60, 5), (400, 12), (56, 46)])
def test_formulas(fit, T, p):
    rng = np.random.default_rng(T)
    G = np.eye(p) + 0.2 * rng.standard_normal((p, p))
    samples = [rng.standard_normal((T, p)), rng.standard_normal((T, p)) @ G + 0.3, autoregressive(rng, T, p, 0.8) @ G, rng.standard_t(4, (T, p))]
    kinds = set()
    for U in samples:
        m, (c, variance, slope, ratio, lags, statistic, degrees, probability) = fit(U), law(U)
        assert m.good and m.c == pytest.approx(c, rel=1e-9, abs=1e-11) and m.raw == pytest.approx(c + null_law(max(T / ratio, p + 2), p)[0], rel=1e-9)
        assert (m.variance, m.spread * T, m.lags) == pytest.approx((variance, ratio, lags), rel=1e-9)
        assert m.signal == pytest.approx(slope, rel=1e-8, abs=1e-10)
        assert (m.statistic, m.nu, m.degrees) == pytest.approx((statistic, degrees, p * (p + 3) / 2), rel=1e-9)
        assert m.p == pytest.approx(probability, rel=1e-9, abs=1e-250)
        noise = variance**0.5
        gain = (max(slope, 0) + noise * 4 * ratio / T) / (max(c, 0) + noise)
        for level in (0.95, 0.6):
            m = fit(U, level)
            assert (m.low, m.high) == pytest.approx(interval(c, variance, gain, degrees, level), rel=1e-7, abs=1e-10)
        kinds.add((lags > 0, ratio > 1))
    assert len(kinds) > 1 or T < 60, "the corrections have been seen at work"


def test_interval_of_a_known_law(fit):
    """p = 1: away from 0 the interval is where the noncentral chi-square has its tails, which Pearson's approximation follows closely."""
    rng = np.random.default_rng(1)
    U = rng.standard_normal((400, 1))
    U = (U - U.mean()) / U.std() + 0.5
    m = fit(U)
    # raw = mean^2 = 0.25: T raw is chi-square with d = 2 and shift T c.
    for end, tail in ((m.low, stats.ncx2.sf), (m.high, stats.ncx2.cdf)):
        assert tail(400 * 0.25, m.nu, 400 * end) == pytest.approx(0.025, abs=0.002)


# --- coverage --------------------------------------------------------------------------------------------------------

def mismatches(p, c):
    """(Sigma, mu) of divergence c, of several kinds."""
    one, none = np.eye(p), np.zeros(p)

    def solve(make):
        if divergence(*make(200.0)) < c:
            return None
        return make(optimize.brentq(lambda a: divergence(*make(a)) - c, 0, 200, xtol=1e-13))

    def single(a):
        S = one.copy()
        S[0, 0] += a
        return S, none

    def common(a):
        r = a / (1 + a)
        return (1 - r) * one + r * np.ones((p, p)), none
    kinds = {"all larger": lambda a: (one * (1 + a), none), "all smaller": lambda a: (one / (1 + a), none), "one larger": single,
             "bias": lambda a: (one, a * one[0])} | ({"correlated": common} if p > 1 else {})
    return {name: found for name, make in kinds.items() if (found := solve(make)) is not None}


# The largest: 46 rows are the published network of 20 nodes; 60 steps are hardly more than its rows.
@pytest.mark.once
@pytest.mark.parametrize("size,p,T", [*((s, p, T) for s in (0, 0.5, 3, 2.0) for p, T in ((3, 100), (3, 1000), (10, 100), (46, 60))),
                                      (0, 3, 2000), (0, 46, 300), (3, 46, 300)])
def test_coverage(fit, size, p, T):
    """c of 0, of half a standard deviation of its noise, of three, and of 2 nats."""
    rng = np.random.default_rng(round(1000 * p + T + 7 * size))
    c = size if size == 2.0 else size * np.sqrt(null_law(T, p)[1])
    cases = mismatches(p, c) if c else {"none": (np.eye(p), np.zeros(p))}
    repetitions = 500
    for name, (S, mu) in cases.items():
        L, hit, estimates, rejected = np.linalg.cholesky(S), 0, [], 0
        for _ in range(repetitions):
            m = fit(rng.standard_normal((T, p)) @ L.T + mu)
            hit += m.low <= c <= m.high
            rejected += m.p < 0.05
            estimates.append(m.c)
            assert m.low <= max(m.c, 0) <= m.high and (m.low == 0) == (m.p >= 0.05)
        assert 0.90 <= hit / repetitions <= 0.98, f"{name}: {hit / repetitions}"
        # Without bias: four standard errors.
        assert abs(np.mean(estimates) - c) < 4 * np.std(estimates) / repetitions**0.5, name
        if c == 0:
            low, high = stats.binom.ppf([0.0005, 0.9995], repetitions, 0.05)
            assert low <= rejected <= high, rejected
        elif size == 3:
            assert rejected > 0.6 * repetitions, "three standard deviations are seen more often than not"
        elif size == 2.0 and T > 60:
            assert rejected > 0.9 * repetitions, (name, rejected)


@pytest.mark.once
def test_size_of_the_test(fit):
    """Few rows and steps, where the chi-square law is least exact; levels 5 and 1 %."""
    rng = np.random.default_rng(3)
    for p, T in ((1, 4), (2, 6), (6, 12), (2, 100)):
        found = np.array([fit(rng.standard_normal((T, p))).p for _ in range(4000)])
        for level in (0.05, 0.01):
            low, high = stats.binom.ppf([0.0005, 0.9995], len(found), [0.95 * level, 1.1 * level])
            assert low <= (found < level).sum() <= high, (p, T, level, (found < level).mean())


@pytest.mark.once
@pytest.mark.parametrize("level", [0.68, 0.99])
def test_other_levels(fit, level):
    rng, p, T = np.random.default_rng(4), 4, 150
    for c in (0, 0.05, 1.0):
        S, mu = mismatches(p, c)["one larger"] if c else (np.eye(p), np.zeros(p))
        L = np.linalg.cholesky(S)
        found = [fit(rng.standard_normal((T, p)) @ L.T + mu, level) for _ in range(500)]
        hit = sum(m.low <= c <= m.high for m in found)
        low, high = stats.binom.ppf([0.0005, 0.9995], 500, level)
        assert low - 10 <= hit <= high + 5, (c, hit)


@pytest.mark.once
@pytest.mark.parametrize("p,T,phi", [(3, 300, 0.5), (3, 800, 0.8), (10, 300, 0.5), (3, 1000, [0.9, 0, 0])])
def test_coverage_of_correlated_residuals(fit, p, T, phi):
    """What the corrections are for: without them 0 to 60 %."""
    rng, repetitions = np.random.default_rng(p + T), 200
    a = np.broadcast_to(phi, p)
    squares = np.multiply.outer(a, a)[np.tril_indices(p)]
    ratio = np.concatenate([(1 + a) / (1 - a), (1 + squares) / (1 - squares)]).mean()
    for c in (0, 0.3):
        for name, (S, mu) in (mismatches(p, c) if c else {"none": (np.eye(p), np.zeros(p))}).items():
            L = np.linalg.cholesky(S)
            found = [fit(autoregressive(rng, T, p, phi) @ L.T + mu) for _ in range(repetitions)]
            hit = np.mean([m.low <= c <= m.high for m in found])
            assert hit >= 0.88, f"c = {c}, {name}: {hit}"
            if c == 0:
                plain = np.mean([stats.chi2.sf(m.raw * T, p * (p + 3) / 2) > 0.05 for m in found])
                assert plain < 0.65, "the correction is needed"
                assert np.mean([m.spread * T for m in found]) == pytest.approx(ratio, rel=0.12)
                assert np.mean([m.white_p < 0.01 for m in found]) > 0.95


@pytest.mark.once
def test_heavy_tails(fit):
    """Student's t with five degrees, scaled to the nominal variances: c is 0, and less than 95 % of the intervals know it. They are told."""
    rng, hit, plain = np.random.default_rng(6), {}, {}
    for p, T in ((3, 1000), (10, 300)):
        found = [fit(rng.standard_t(5, (T, p)) * 0.6**0.5) for _ in range(400)]
        hit[p] = np.mean([m.low == 0 for m in found])
        plain[p] = np.mean([stats.chi2.sf(m.raw * T, p * (p + 3) / 2) > 0.05 for m in found])
        assert np.mean([m.tails_p < 0.0027 and m.kurtosis > 1.05 for m in found]) > 0.95
    assert all(0.82 <= h <= 0.98 for h in hit.values()) and all(q < 0.72 for q in plain.values()), (hit, plain)
    light = fit(rng.uniform(-3**0.5, 3**0.5, (1000, 3)))
    assert light.kurtosis < 0.8 and light.tails_p < 1e-6


@pytest.mark.once
def test_white_residuals_are_left_alone(fit):
    rng = np.random.default_rng(7)
    found = [fit(rng.standard_normal((300, 4))) for _ in range(1000)]
    assert np.mean([m.spread * 300 == 1 for m in found]) > 0.98
    assert stats.kstest([m.white_p for m in found], "uniform").pvalue > 1e-3


# --- parts and sums --------------------------------------------------------------------------------------------------

def test_sum_and_across(lib, fit):
    rng = np.random.default_rng(8)
    L = np.linalg.cholesky(0.7 * np.eye(6) + 0.3)
    U = rng.standard_normal((500, 6)) @ L.T
    first, parts, total, across = [0, 1, 3, 6], [], Mismatch(), Mismatch()
    for b in range(3):
        parts.append(fit(U[:, first[b]:first[b + 1]]))
        lib.mk_mismatch_add(ctypes.byref(total), ctypes.byref(parts[-1]))
    whole = fit(U)
    for name in ("raw", "bias", "variance", "signal", "degrees", "rows"):
        assert getattr(total, name) == pytest.approx(sum(getattr(m, name) for m in parts), rel=1e-12)
    lib.mk_mismatch_across(ctypes.byref(across), ctypes.byref(whole), whole.S.ctypes.data_as(ctypes.c_void_p), 3, (ctypes.c_int * 4)(*first))
    for name in ("raw", "bias", "variance", "degrees"):
        assert getattr(across, name) == pytest.approx(getattr(whole, name) - getattr(total, name), rel=1e-9)
    assert across.degrees == 6 * 7 / 2 - (1 + 3 + 6), "covariances between blocks"
    assert lib.mk_mismatch_test(ctypes.byref(across), ctypes.byref(ctypes.c_double()), ctypes.byref(ctypes.c_double())) < 1e-12


@pytest.mark.once
def test_across_holds_its_size(lib, fit):
    rng, found = np.random.default_rng(9), []
    for _ in range(1000):
        whole, across = fit(rng.standard_normal((40, 6)) * [1, 2, 3, 1, 1, 0.5]), Mismatch()
        lib.mk_mismatch_across(ctypes.byref(across), ctypes.byref(whole), whole.S.ctypes.data_as(ctypes.c_void_p), 3, (ctypes.c_int * 4)(0, 2, 4, 6))
        found.append(lib.mk_mismatch_test(ctypes.byref(across), ctypes.byref(ctypes.c_double()), ctypes.byref(ctypes.c_double())))
    assert stats.kstest(found, "uniform").pvalue > 1e-3


def test_no_spread(fit):
    """A row that does not vary, or follows from others, is named."""
    U = np.random.default_rng(10).standard_normal((50, 4))
    for row, values in ((2, U[:, 0] - U[:, 1]), (1, np.full(50, 0.3)), (3, U[:, 2])):
        W = U.copy()
        W[:, row] = values
        m = fit(W)
        assert not m.good and m.bad == row


def test_far_away(fit):
    """Units that are wrong by a thousand do not break it."""
    rng = np.random.default_rng(11)
    for scale in (1e3, 1e6):
        U = rng.standard_normal((200, 3)) * scale
        m = fit(U)
        c = 3 * (scale**2 - 1 - np.log(scale**2))
        assert m.low < c < m.high and m.p == 0 and m.high < 1.5 * c
