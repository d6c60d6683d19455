# SPDX-License-Identifier: MIT
"""Chi-square and Student tails and quantiles of the node library, as a shared library: against SciPy on random degrees and tails, and
against series and fractions in decimal arithmetic with 40 digits."""
import ctypes
import decimal
import fractions
import math

import numpy as np
import pytest
from scipy import special, stats

D = decimal.Decimal
PI = D("3.14159265358979323846264338327950288419716939937510582097494459230781640628620899862803482534211706798214808651328230664709384461")


@pytest.fixture(scope="module")
def lib(shared):
    library = shared("src/meshkal/meshkal.c")

    def call(name):
        function = getattr(library, f"mk_{name}")
        function.restype = ctypes.c_double
        return lambda *arguments: function(*map(ctypes.c_double, arguments))
    return call


# --- the reference: 40 digits ------------------------------------------------------------------------------------------------------

def bernoulli(n):
    """B_2 .. B_2n as fractions, by their recurrence."""
    b = [fractions.Fraction(1)]
    for m in range(1, 2 * n + 1):
        b.append(-sum((math.comb(m + 1, k) * b[k] for k in range(m)), fractions.Fraction(0)) / (m + 1))
    return b[2::2]


# Coefficients of Stirling's series.
STIRLING = [b / (2 * j * (2 * j - 1)) for j, b in enumerate(bernoulli(20), 1)]


def log_gamma(a):
    """To more than 40 digits."""
    shift = D(1)
    while a < 60:
        shift *= a
        a += 1
    series = sum(D(f.numerator) / D(f.denominator) / a ** (2 * j - 1) for j, f in enumerate(STIRLING, 1))
    return (a - D("0.5")) * a.ln() - a + (2 * PI).ln() / 2 + series - shift.ln()


def total(term, ratio):
    """The sum of positive terms, the next one being ratio(n) times the last."""
    sum_, n = term, 0
    while True:
        r = ratio(n)
        term *= r
        sum_ += term
        n += 1
        if r < D("0.999") and term < sum_ * D(10) ** -45:
            return sum_


def fraction(evaluate):
    """A continued fraction from a number of terms; from twice that many it is the same."""
    value, again = evaluate(1000), evaluate(2000)
    assert abs(value / again - 1) < D("1e-25")
    return again


def chi2_exact(x, k):
    """P(X > x), P(X < x), density of log X: the lower part by its series or, for a small upper one, that by DLMF 8.9.2."""
    a, y = D(k) / 2, D(x) / 2
    density = (a * y.ln() - y - log_gamma(a)).exp()
    lower = density * total(1 / a, lambda n: y / (a + n + 1)) if y < a + 5 * a.sqrt() + 5 else D(1)
    if lower < 1 - D("1e-5"):
        return 1 - lower, lower, density

    def evaluate(terms):
        v = y + 2 * terms + 1 - a
        for j in range(terms, 0, -1):
            v = y + 2 * j - 1 - a - j * (j - a) / v
        return density / v
    upper = fraction(evaluate)
    return upper, 1 - upper, density


def student_exact(t, k):
    """P(T > t), P(|T| < t), density of log T: P(|T| < t) by its series or, for a small tail, that by its own series or by DLMF 8.17.22."""
    k, t = D(k), D(t)
    a, half = k / 2, D("0.5")
    x, y = k / (k + t * t), t * t / (k + t * t)
    scale = (log_gamma(a + half) - log_gamma(a) - PI.ln() / 2 + a * x.ln() + y.ln() / 2).exp()
    if y < D("0.9") and t * t < 40:
        centre = 2 * scale * total(D(1), lambda n: y * (a + half + n) / (n + D("1.5")))
        return (1 - centre) / 2, centre, scale

    def evaluate(terms):
        v = D(1)
        for m in range(terms, 0, -1):
            even = m * (half - m) / ((a + 2 * m - 1) * (a + 2 * m))
            odd = (a + m - 1) * (a + half + m - 1) / ((a + 2 * m - 2) * (a + 2 * m - 1))
            v = 1 - odd * x / (1 + even * x / v)
        return scale / (2 * a * v)
    tail = scale / 2 * total(1 / a, lambda n: x * (a + half + n) / (a + n + 1)) if x < half else fraction(evaluate)
    return tail, 1 - 2 * tail, scale


def exactly(function, x, k):
    with decimal.localcontext() as context:
        context.prec = 60
        return function(x, k)


def test_reference():
    """The reference itself, where there are closed forms: an even number of degrees, and Student's law of two."""
    for k, x in ((2, 3.5), (10, 4.0), (10, 300.0), (400, 350.0), (400, 700.0)):
        with decimal.localcontext() as context:
            context.prec = 60
            y = D(x) / 2
            want = (-y).exp() * sum(y**j / math.factorial(j) for j in range(k // 2))
            assert abs(chi2_exact(x, k)[0] / want - 1) < D("1e-24")
    for t in (0.3, 3.5, 7.0, 1e9):
        with decimal.localcontext() as context:
            context.prec = 60
            want = (1 - D(t) / (2 + D(t) ** 2).sqrt()) / 2
            assert abs(student_exact(t, 2)[0] / want - 1) < D("1e-24")
    for k in (300, 1000, 1e6):
        # both sides of the change of method agree in the slope between
        above, _, density = exactly(student_exact, math.sqrt(40) * (1 + 1e-6), k)
        below, _, _ = exactly(student_exact, math.sqrt(40) * (1 - 1e-6), k)
        assert (below - above) / density == pytest.approx(D("2e-6"), rel=D("1e-4"))


# --- the library -----------------------------------------------------------------------------------------------------------------

def draw(seed, count, smallest):
    """Degrees and tails, small, middle and near 1; some degrees whole, some where the method changes."""
    r = np.random.default_rng(seed)
    degrees = np.exp(r.uniform(np.log(0.5), np.log(1e6), count))
    some = r.random(count) < 0.4
    degrees[some] = r.choice([0.5, 1, 2, 3, 4, 5, 6, 7, 10, 30, 119.999, 120, 120.001, 1000, 1e5, 1e6], some.sum())
    tails = np.exp(r.uniform(np.log(smallest), np.log(0.5), count))
    near_one = r.random(count) < 0.35
    tails[near_one] = 1 - np.exp(r.uniform(np.log(1e-10), np.log(0.5), near_one.sum()))
    middle = r.random(count) < 0.2
    tails[middle] = r.uniform(0.01, 0.99, middle.sum())
    return zip(degrees.tolist(), tails.tolist())


@pytest.mark.parametrize("law", ["chi2", "student"])
def test_scipy(lib, law):
    """4000 points; SciPy's own error, up to 3e-9 at many degrees, is the larger one. Near the middle of Student's law its quantile has no
    relative accuracy: there the probability alone is compared."""
    tail, quantile, theirs = lib(f"{law}_tail"), lib(f"{law}_quantile"), stats.chi2 if law == "chi2" else stats.t
    for k, p in draw(20251122, 4000, 1e-10):
        x = quantile(p, k)
        q = tail(x, k)
        assert q == pytest.approx(p, rel=1e-11, abs=0), (k, p)
        assert q == pytest.approx(theirs.sf(x, k), rel=1e-8, abs=0), (k, p)
        if p > 0.5:
            assert theirs.cdf(x, k) == pytest.approx(1 - p, rel=1e-8, abs=0), (k, p)
        if law == "chi2" or abs(p - 0.5) > 1e-3:
            assert x == pytest.approx(theirs.isf(p, k), rel=1e-9, abs=0), (k, p)


@pytest.mark.once
@pytest.mark.parametrize("smallest", [1e-10, 1e-300])
@pytest.mark.parametrize("law", ["chi2", "student"])
def test_exact(lib, law, smallest):
    """What the header promises, 250 points each."""
    tail, quantile, exact = lib(f"{law}_tail"), lib(f"{law}_quantile"), chi2_exact if law == "chi2" else student_exact
    for k, p in draw(7, 250, smallest):
        x = quantile(p, k)
        if math.isinf(x):
            assert k < 1.1 and p < 1e-150
            continue
        upper, lower, density = exactly(exact, abs(x), k)
        # by the part that has the digits
        wanted = D(p) if x >= 0 else 1 - D(p)
        error = (upper - wanted) / density
        assert abs(error) < (1e-13 if smallest > 1e-11 else 1e-12), (k, p, x, float(error))
        assert abs(D(tail(abs(x), k)) / upper - 1) < D("1e-12"), (k, p, x)


def test_symmetry_and_middle(lib):
    """Near 1/2 Student's quantile is (1/2 - tail) / density(0), with all digits."""
    for k in (0.5, 1, 3, 30, 1e6):
        assert lib("student_quantile")(0.5, k) == 0
        for d in (2.0**-50, 1e-12, 1e-9):
            d = (0.5 + d) - 0.5
            x = lib("student_quantile")(0.5 - d, k)
            assert x == pytest.approx(d / stats.t.pdf(0, k), rel=1e-12) and lib("student_quantile")(0.5 + d, k) == -x
    for k, t in ((0.5, 1e5), (7, 2), (1e5, 5)):
        assert lib("student_tail")(-t, k) == 1 - lib("student_tail")(t, k)


def test_beyond_the_promise(lib):
    """Degrees of any size: still right, to what SciPy says."""
    for k in (1e-3, 0.01, 0.1, 1e7, 1e9, 1e12):
        for p in (1e-10, 1e-3, 0.3, 0.7, 0.999):
            x = lib("chi2_quantile")(p, k)
            if x > 1e-300:
                assert lib("chi2_tail")(x, k) == pytest.approx(p, rel=1e-8)
                assert special.gammaincc(k / 2, x / 2) == pytest.approx(p, rel=1e-6)
            else:
                assert special.gammaincc(k / 2, 1e-300) <= p * (1 + 1e-9)
            t = lib("student_quantile")(p, k)
            # Beyond 1e100, where SciPy's function overflows, the tail falls as t^-k.
            far = stats.t.sf(min(abs(t), 1e100), k) * max(min(abs(t), 1.7e308) / 1e100, 1.0) ** -k
            assert far > min(p, 1 - p) if math.isinf(t) else far == pytest.approx(min(p, 1 - p), rel=1e-6)
            assert t > 0 if p < 0.5 else t < 0
