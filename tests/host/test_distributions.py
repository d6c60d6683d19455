# SPDX-License-Identifier: MIT
"""Distribution functions of the host programs against SciPy: port/host/distributions.c as a shared library."""
import ctypes

import numpy as np
import pytest
from scipy import special, stats

TAILS = [1e-300, 1e-100, 1e-30, 1e-12, 1e-9, 1e-6, 1e-4, 0.001, 0.01, 0.025, 0.05, 0.2, 0.24999, 0.25, 0.3, 0.4, 0.499, 0.5]


@pytest.fixture(scope="module")
def lib(shared):
    library = shared("port/host/distributions.c")

    def call(name):
        function = getattr(library, f"mk_{name}")
        function.restype = ctypes.c_double
        return lambda *arguments: function(*map(ctypes.c_double, arguments))
    return call


def close(got, want, rel=1e-10):
    assert got == pytest.approx(want, rel=rel, abs=0), (got, want)


def test_normal(lib):
    tail, quantile = lib("normal_tail"), lib("normal_quantile")
    for x in [-38, -10, -3, -1e-5, 0, 1e-9, 0.1, 1, 2, 5, 7, 20, 37]:
        close(tail(x), stats.norm.sf(x), 1e-12)
    for q in TAILS[:-1]:
        close(quantile(q), stats.norm.ppf(q), 1e-12)
        close(-quantile(q), stats.norm.isf(q), 1e-12)
        if q > 1e-12:
            close(quantile(1 - q), stats.norm.isf(1 - (1 - q)), 1e-12)
    for small in (1e-15, 1e-8, 1e-3):
        close(quantile(0.5 + small), special.erfinv(2 * ((0.5 + small) - 0.5)) * 2**0.5, 1e-12)
    assert quantile(0.5) == 0 and quantile(0) == -np.inf and quantile(1) == np.inf
    assert all(np.isnan(quantile(p)) for p in (-0.1, 1.1, np.nan)) and np.isnan(tail(np.nan))


def test_outside_the_domain(lib):
    assert all(np.isnan(lib(name)(x)) for name in ("digamma", "trigamma") for x in (0, -1.5, float("nan")))


def test_digamma(lib):
    for x in [1e-8, 0.01, 0.5, 1, 1.4616321449683623, 1.5, 2, 3, 7.5, 9.99, 10, 17.5, 100, 1e4, 1e9]:
        assert lib("digamma")(x) == pytest.approx(special.digamma(x), rel=1e-14, abs=1e-14)
        close(lib("trigamma")(x), special.polygamma(1, x), 1e-13)


@pytest.fixture(scope="module")
def shares(shared):
    function = shared("port/host/distributions.c").mk_share_interval
    function.restype = None

    def call(hits, trials, tail):
        low, high = ctypes.c_double(), ctypes.c_double()
        function(*map(ctypes.c_double, (hits, trials, tail)), ctypes.byref(low), ctypes.byref(high))
        return low.value, high.value
    return call


@pytest.mark.parametrize("hits,trials", [(0, 1), (1, 1), (0, 10), (1, 10), (5, 10), (10, 10), (3, 10 ** 6), (100, 10 ** 6), (999999, 10 ** 6), (12, 10 ** 9)])
@pytest.mark.parametrize("tail", [0.025, 0.005, 1e-6])
def test_share_interval(shares, hits, trials, tail):
    """Clopper and Pearson: quantiles of the beta distribution."""
    low, high = shares(hits, trials, tail)
    bound = 1e-8 if trials <= 10 ** 6 else 1e-6
    assert low == pytest.approx(stats.beta.ppf(tail, hits, trials - hits + 1) if hits else 0.0, rel=bound)
    assert high == pytest.approx(stats.beta.isf(tail, hits + 1, trials - hits) if hits < trials else 1.0, rel=bound)


@pytest.mark.parametrize("hits,trials,tail", [(-1, 10, 0.1), (11, 10, 0.1), (1, 0, 0.1), (1, 10, 0.0), (1, 10, 0.5), (np.nan, 10, 0.1)])
def test_share_interval_of_nothing(shares, hits, trials, tail):
    low, high = shares(hits, trials, tail)
    assert np.isnan(low) and np.isnan(high)
