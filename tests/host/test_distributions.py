# SPDX-License-Identifier: MIT
"""Distribution functions of the host programs against SciPy: port/host/distributions.c as a shared library."""
import ctypes

import numpy as np
import pytest
from scipy import special, stats

TAILS = [1e-300, 1e-100, 1e-30, 1e-12, 1e-9, 1e-6, 1e-4, 0.001, 0.01, 0.025, 0.05, 0.2, 0.24999, 0.25, 0.3, 0.4, 0.499, 0.5]
DEGREES = [0.1, 0.5, 1, 2, 2.5, 3, 5, 9, 10, 19, 19.99, 20, 21, 30, 100, 1127, 12345.5, 1e5]


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


@pytest.mark.parametrize("k", DEGREES)
def test_chi_square(lib, k):
    cdf, tail, quantile, tail_quantile = map(lib, ("chi_square_cdf", "chi_square_tail", "chi_square_quantile", "chi_square_tail_quantile"))
    for q in TAILS:
        low, high = stats.chi2.ppf(q, k), stats.chi2.isf(q, k)
        if low > 1e-290:
            close(cdf(low, k), special.gammainc(k / 2, low / 2))
            close(special.gammainc(k / 2, quantile(q, k) / 2), q, 1e-10 if q > 1e-20 else 1e-9)
            if q >= 1e-12:
                close(quantile(q, k), low)
        close(tail(high, k), special.gammaincc(k / 2, high / 2), 1e-10 if q > 1e-20 else 1e-9)
        close(special.gammaincc(k / 2, tail_quantile(q, k) / 2), q, 1e-10 if q > 1e-20 else 1e-9)
        if q >= 1e-12:
            close(tail_quantile(q, k), high)
            close(tail_quantile(1 - q, k), stats.chi2.isf(1 - q, k), 1e-9)
    for x in k * np.array([0.01, 0.5, 0.9, 0.99, 1, 1.01, 1.1, 1.5, 3]):
        for got, want in ((cdf(x, k), stats.chi2.cdf(x, k)), (tail(x, k), stats.chi2.sf(x, k))):
            if want > 1e-290:
                close(got, want, 1e-10 if want > 1e-20 else 1e-9)
        assert cdf(x, k) + tail(x, k) == pytest.approx(1, abs=1e-14)
    assert (cdf(0, k), tail(0, k), cdf(-1, k), tail(-1, k), cdf(np.inf, k), tail(np.inf, k)) == (0, 1, 0, 1, 1, 0)
    assert (quantile(0, k), quantile(1, k), tail_quantile(0, k), tail_quantile(1, k)) == (0, np.inf, np.inf, 0)


@pytest.mark.parametrize("k", [*DEGREES, 3e6, 1e8, 1e12])
def test_student(lib, k):
    tail, quantile = lib("student_tail"), lib("student_quantile")
    for q in TAILS[:-1]:
        if q >= 1e-12:
            # SciPy's inverse is worse than its forward function, which judges here.
            for p in (q, 1 - (1 - q)):
                close(stats.t.sf(-quantile(q, k) if p == q else quantile(1 - q, k), k), p, 2e-10)
    for t in (1e-6, 0.01, 0.5, 1, 1.7, 1.75, 2, 5, 7):
        close(tail(t, k), stats.t.sf(t, k), 1e-10)
        close(tail(-t, k), stats.t.sf(-t, k), 1e-10)
    assert tail(0, k) == 0.5 and quantile(0.5, k) == 0 and quantile(0, k) == -np.inf and quantile(1, k) == np.inf
    assert tail(np.inf, k) == 0 and tail(-np.inf, k) == 1


# Computed with 40 digits (series of the incomplete Gamma function, incomplete Beta function and quadrature): SciPy's own values are off by
# up to 5e-10 in the extreme ones. degrees, x, cdf, tail.
EXACT_CHI_SQUARE = [
    (1e6, 991541.1220939688, 1.00000000052450101e-9, None), (1e6, 1008543.0, None, 8.49912357308884191e-10),
    (1127, 960.0, 0.00011045212561160478, 0.999889547874388395), (1127, 1450.0, 0.999999999805054185, 1.94945814771532288e-10),
    (3, 50.0, 0.999999999920108208, 7.98917924495147114e-11), (21, 1.5, 2.07023805281466181e-9, 0.999999997929761947),
    (1e5, 98000.0, 3.38475422807949143e-6, None), (1e5, 102500.0, None, 1.46356259983671502e-8)]
# degrees, t, tail.
EXACT_STUDENT = [(9, 2.2621571628, 0.0249999999999266795), (30, 7.0, 4.43497933361032158e-8), (5, 40.0, 9.20598108588647718e-8),
                 (1e5, 5.0, 2.87135083932083643e-7), (2e6, 6.5, 4.01693877924115907e-11), (1e7, 3.25, 0.000577026948588158883)]


def test_exact(lib):
    for k, x, below, above in EXACT_CHI_SQUARE:
        for p, function, quantile in ((below, "cdf", "quantile"), (above, "tail", "tail_quantile")):
            if p is not None:
                close(lib(f"chi_square_{function}")(x, k), p, 1e-11)
                if p < 0.5:
                    close(lib(f"chi_square_{quantile}")(p, k), x, 1e-12)
    for k, t, p in EXACT_STUDENT:
        close(lib("student_tail")(t, k), p, 1e-11)
        close(-lib("student_quantile")(p, k), t, 1e-11)


def test_student_known(lib):
    """One degree of freedom is Cauchy's law, infinitely many the normal one."""
    for q in (1e-200, 1e-9, 0.01, 0.3):
        close(lib("student_quantile")(q, 1), -1 / np.tan(np.pi * q), 1e-12)
        close(lib("student_tail")(1 / np.tan(np.pi * q), 1), q, 1e-12)
        close(lib("student_quantile")(q, np.inf), stats.norm.ppf(q), 1e-12)


def test_outside_the_domain(lib):
    nan = float("nan")
    for name in ("chi_square_cdf", "chi_square_tail", "student_tail"):
        assert all(np.isnan(lib(name)(*a)) for a in ((1, 0), (1, -1), (nan, 1), (1, nan)))
    for name in ("chi_square_quantile", "chi_square_tail_quantile", "student_quantile"):
        assert all(np.isnan(lib(name)(*a)) for a in ((0.5, 0), (0.5, -1), (nan, 1), (0.5, nan), (-0.1, 3), (1.1, 3)))
    assert all(np.isnan(lib(name)(x)) for name in ("digamma", "trigamma") for x in (0, -1.5, nan))


def test_digamma(lib):
    for x in [1e-8, 0.01, 0.5, 1, 1.4616321449683623, 1.5, 2, 3, 7.5, 9.99, 10, 17.5, 100, 1e4, 1e9]:
        assert lib("digamma")(x) == pytest.approx(special.digamma(x), rel=1e-14, abs=1e-14)
        close(lib("trigamma")(x), special.polygamma(1, x), 1e-13)
