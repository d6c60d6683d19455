# SPDX-License-Identifier: MIT
"""<meshkal/weights.h> and the robust gain of <meshkal/unscented.h> (spec 3.2) against the definitions: the gain from whole covariances in the longest
float type, P in Joseph form."""
import ctypes
from ctypes import c_double, c_int, c_void_p

import numpy as np
import pytest
from scipy import stats

from nonlinear import bearing_from, covariance, distance_to, linear, quadratic, waves
from textbook import LONG, Textbook, blocks, inverse, solve
from unscented import (EXTENDED, ITERATED, LITERAL, NORMAL, OK, PROGRESSIVE, STUDENT, TYPES, UNSCENTED, Filter, status)

ARGUMENT, NOT_FINITE, ORDER = status("ARGUMENT"), status("NOT_FINITE"), status("ORDER")


# --- the definitions -------------------------------------------------------------------------------------------------------

def igg3(u, k0, k1):
    u = abs(u)
    return 1 if u <= k0 else 0 if u > k1 else (k0 / u) * ((k1 - u) / (k1 - k0))**2


def statistics(kind, r, S):
    u = LONG(r) / np.sqrt(LONG(np.diag(S)))
    if kind == NORMAL:
        return u
    n = len(u)
    others = [np.delete(u, j) for j in range(n)]
    return np.array([(u[j] - o.mean()) / (o.std(ddof=1) * np.sqrt(LONG(1) + LONG(1) / (n - 1))) for j, o in enumerate(others)], LONG)


def joseph(x, P, e, H, R, w):
    """x, P after an update with the gain K diag(w)."""
    x, P, e, H, R = (LONG(a) for a in (x, P, e, H, R))
    Kw = solve(H @ P @ H.T + R, H @ P).T * w
    rest = np.eye(len(x), dtype=LONG) - Kw @ H
    return x + Kw @ e, rest @ P @ rest.T + Kw @ R @ Kw.T


def thresholds(code, kind, significance, count, bits=64):
    t = TYPES[bits]
    k = np.full(count + 1, 99, t.numpy)
    found = getattr(code, f"mk_weight_thresholds{t.suffix}")(c_int(kind), c_double(significance), c_int(count), c_void_p(k.ctypes.data))
    assert k[count] == 99
    return found, k[:count]


def weight(code, u, k0, k1, bits=64):
    t = TYPES[bits]
    function = getattr(code, f"mk_igg3_weight{t.suffix}")
    function.restype, function.argtypes = t.real, [t.real] * 3
    return function(u, k0, k1)


def measured(code, kind, r, variance, bits=64, onto=None):
    """onto: 0 or 1, the input that the output is."""
    t = TYPES[bits]
    arrays = [np.array(a, t.numpy) for a in (r, variance, np.full(len(r), np.nan))]
    if onto is not None:
        arrays[2] = arrays[onto]
    getattr(code, f"mk_weight_statistics{t.suffix}")(c_int(kind), c_int(len(r)), *(c_void_p(a.ctypes.data) for a in arrays))
    return arrays[2]


# --- the filter ------------------------------------------------------------------------------------------------------------

def draw(seed, n=None):
    """A linear system, and readings some of which stand out."""
    rng = np.random.default_rng(seed)
    n = n or int(rng.integers(1, 18))
    rows = [int(r) for r in rng.integers(1, 4, rng.integers(1, 7))]
    while sum(rows) > 16:
        rows.pop()
    P, H = covariance(rng, n, 0.05, 5), [rng.normal(size=(r, n)) for r in rows]
    R, x = [covariance(rng, r, 0.05, 3) for r in rows], rng.normal(size=n)
    S = np.concatenate(H) @ P @ np.concatenate(H).T + np.asarray(blocks(R), float)
    e = np.linalg.cholesky(S) @ rng.normal(size=len(S)) + (rng.random(len(S)) < 0.3) * rng.normal(size=len(S)) * 8 * np.sqrt(np.diag(S))
    return rng, n, P, H, R, x, np.split(np.concatenate(H) @ x + e, np.cumsum(rows)[:-1])


def filter_of(code, n, P, H, R, x, k, update=EXTENDED, kind=STUDENT, **options):
    f = Filter(code, n, np.eye(n), np.zeros((n, n)), list(zip(map(linear, H), R)), x, P, kind=update, weights=(kind, *k) if k else None, **options)
    assert f.start() == OK
    return f


def put_all(f, z, slots=None):
    for slot in range(len(z)) if slots is None else slots:
        assert f.put(slot, z[slot]) == OK


def limits(code, kind, count, bits=64):
    return [thresholds(code, kind, s, count, bits)[1] for s in (0.1, 0.01)]


def distance(f, x, P):
    d = np.sqrt(np.diag(P))
    return max(np.max(np.abs(f.x - x) / d), np.max(np.abs(f.P - P) / np.outer(d, d)))


@pytest.mark.parametrize("kind", (NORMAL, STUDENT), ids=("normal", "student"))
@pytest.mark.parametrize("update", (EXTENDED, UNSCENTED), ids=("ekf", "ukf"))
def test_joseph(code, update, kind):
    worst, partly, unused, short = 0, 0, 0, 0
    for seed in range(300):
        rng, n, P, H, R, x, z = draw(seed)
        k = limits(code, kind, 3 * len(z))
        f = filter_of(code, n, P, H, R, x, k, update, kind)
        slots = [s for s in range(len(z)) if rng.random() < 0.9]
        put_all(f, z, slots)
        found, r, S, rows = f.innovations()
        assert found == OK and [s for s in range(len(z)) if rows[s]] == slots
        assert f.update() == OK
        if not slots:
            assert f.core.weighted_rows == f.core.unused_rows == 0 and not f.weight.any() and not f.statistic.any()
            continue
        Hs, Rs = np.concatenate([H[s] for s in slots]), blocks([R[s] for s in slots])
        e = LONG(np.concatenate([z[s] for s in slots])) - Hs @ LONG(x)
        exact = Hs @ LONG(P) @ Hs.T + Rs
        count = len(e)
        assert np.max(np.abs(r - e)) < 1e-10 and np.max(np.abs(S - exact) / np.max(np.abs(exact))) < 1e-13
        few = kind == STUDENT and count < 4
        t = np.zeros(count) if few else statistics(kind, e, exact)
        w = np.array([1 if few else igg3(v, k[0][count - 1], k[1][count - 1]) for v in t], LONG)
        where = np.concatenate([f.m * s + np.arange(len(z[s])) for s in slots])
        assert np.max(np.abs(f.statistic[where] - t) / np.maximum(1, np.abs(t))) < 1e-10
        assert np.max(np.abs(f.weight[where] - w)) < 1e-10
        assert not np.delete(f.weight, where).any() and not np.delete(f.statistic, where).any()
        assert (f.core.weighted_rows, f.core.unused_rows) == ((w < 1).sum(), (w == 0).sum())
        assert abs(f.core.nis / float(e @ inverse(exact) @ e) - 1) < 1e-10 and f.core.nis_rows == count
        worst = max(worst, distance(f, *joseph(x, P, e, Hs, Rs, w)))
        partly += ((w > 0) & (w < 1)).any()
        unused += (w == 0).any()
        short += few
    assert worst < 1e-10
    assert min(partly, unused) > 30 and (short > 30 or kind == NORMAL)
    print(f"largest error {worst:.1e}")


@pytest.mark.parametrize("update", (EXTENDED, UNSCENTED), ids=("ekf", "ukf"))
def test_no_row_stands_out(code, update):
    """Thresholds of 0, or beyond every statistic: the bits of a filter without weights."""
    for bits in (32, 64):
        for seed in range(40):
            rng, n, P, H, R, x, z = draw(seed)
            count = 3 * len(z)
            plain = filter_of(code, n, P, H, R, x, None, update, bits=bits)
            same = [filter_of(code, n, P, H, R, x, k, update, kind, bits=bits) for kind in (NORMAL, STUDENT)
                    for k in ((np.zeros(count), np.zeros(count)), (np.full(count, 1e30), np.full(count, 2e30)))]
            for f in (plain, *same):
                put_all(f, z)
                assert f.update() == OK
            for f in same:
                assert all(np.array_equal(a, b) for a, b in ((f.x, plain.x), (f.L, plain.L)))
                assert f.core.nis == plain.core.nis and f.core.weighted_rows == f.core.unused_rows == 0
                assert f.weight.sum() == sum(map(len, z))


def test_all_rows_rejected(code):
    """Thresholds below every statistic: the prediction, bit for bit, flagged; the readings are used up."""
    for bits in (32, 64):
        for seed in range(20):
            rng, n, P, H, R, x, z = draw(seed)
            k = [np.full(3 * len(z), v) for v in (1e-30, 2e-30)]
            f = filter_of(code, n, P, H, R, x, k, kind=NORMAL, bits=bits)
            before = f.x.copy(), f.L.copy()
            put_all(f, z)
            assert f.update() == OK
            rows = sum(map(len, z))
            assert np.array_equal(f.x, before[0]) and np.array_equal(f.L, before[1])
            assert f.core.unused_rows == f.core.weighted_rows == f.core.nis_rows == rows and f.core.nis > 0
            assert not f.weight.any() and not f.have.any() and np.count_nonzero(f.statistic) == rows


@pytest.mark.parametrize("bits", (32, 64))
def test_one_reading_at_the_end_of_the_range(code, bits):
    """It weighs nothing: the update without it; the weights of the others are their own."""
    most = {32: 3e38, 64: 1.7e308}[bits]
    for kind in (NORMAL, STUDENT):
        for size in (most, -most, most**0.5, 1e4):
            rng = np.random.default_rng(3)
            H, R, z = [np.eye(2)[[s % 2]] for s in range(8)], [np.eye(1)] * 8, [np.array([0.1 * s]) for s in range(7)] + [np.array([size])]
            f = filter_of(code, 2, np.eye(2), H, R, np.zeros(2), limits(code, kind, 8, bits), kind=kind, bits=bits)
            put_all(f, z)
            assert f.update() == OK
            assert f.core.unused_rows == 1 and f.weight[7] == 0 and abs(f.statistic[7]) > 100 and (f.statistic[7] > 0) == (size > 0)
            e = np.concatenate(z)
            S = np.concatenate(H) @ np.concatenate(H).T + np.eye(8)
            t = statistics(kind, np.r_[e[:7], size], S)[:7]
            w = np.array([igg3(v, *(k[7] for k in limits(code, kind, 8))) for v in t] + [0], LONG)
            assert np.abs(f.weight[:7] - w[:7]).max() < {32: 1e-5, 64: 1e-13}[bits]
            e[7] = 0
            assert distance(f, *joseph(np.zeros(2), np.eye(2), e, np.concatenate(H), np.eye(8), w)) < {32: 1e-5, 64: 1e-13}[bits]
            assert np.isfinite(f.core.nis) and f.core.nis > 1e3


@pytest.mark.parametrize("update", (EXTENDED, UNSCENTED), ids=("ekf", "ukf"))
def test_prior_much_wider_than_the_noise(code, update):
    """Eight sensors of two states in float32: the innovations' covariance has no factor in this precision, the update is as good as ever."""
    rng = np.random.default_rng(8)
    H, R, x, P = [rng.normal(size=(1, 2)) for _ in range(8)], [np.array([[0.01]])] * 8, np.zeros(2), 1e6 * np.eye(2)
    stacked = np.concatenate(H)
    with np.errstate(all="ignore"), pytest.raises(np.linalg.LinAlgError):
        np.linalg.cholesky((stacked @ P @ stacked.T + 0.01 * np.eye(8)).astype(np.float32))
    z = stacked @ np.array([3.0, -2.0]) + 0.1 * rng.normal(size=8)
    z[5] += 3000
    k = limits(code, NORMAL, 8)
    f = filter_of(code, 2, P, H, R, x, k, update, NORMAL, bits=32)
    put_all(f, z[:, None].astype(np.float32))
    assert f.update() == OK
    t = statistics(NORMAL, z, stacked @ P @ stacked.T + 0.01 * np.eye(8))
    w = np.array([igg3(v, k[0][7], k[1][7]) for v in t], LONG)
    assert f.core.unused_rows == (w == 0).sum()
    assert distance(f, *joseph(x, P, z, stacked, 0.01 * np.eye(8), w)) < 0.02


def test_with_a_gate(code):
    """The gate leaves out or inflates sensors first; weights see what is left, with the thresholds of so many rows."""
    for policy in (0, 1):
        H, R, z = [np.array([[1.0]])] * 6, [np.eye(1)] * 6, [np.array([v]) for v in (0.1, -0.2, 100.0, 0.3, 0.2, 4.0)]
        k = limits(code, STUDENT, 6)
        gate = dict(sensor=[50.0], policy=policy)
        f = filter_of(code, 1, np.eye(1), H, R, np.zeros(1), k, gate=gate)
        put_all(f, z)
        assert f.update() == OK
        noise = np.ones(6)
        if policy:  # innovation variance times ratio
            noise[2] = 2 * (100.0**2 / 2 / 50) - 1
        use = np.arange(6) if policy else np.delete(np.arange(6), 2)
        e, Rs = np.concatenate(z)[use], np.diag(noise[use])
        t = statistics(STUDENT, e, np.ones((len(e), len(e))) + Rs)
        w = np.array([igg3(v, k[0][len(e) - 1], k[1][len(e) - 1]) for v in t], LONG)
        assert (w < 1).any()
        assert np.abs(f.weight[use] - w).max() < 1e-12 and (policy or f.weight[2] == f.statistic[2] == 0)
        assert distance(f, *joseph(np.zeros(1), np.eye(1), e, np.ones((len(e), 1)), Rs, w)) < 1e-12


# --- functions -------------------------------------------------------------------------------------------------------------

@pytest.mark.parametrize("bits", (32, 64))
def test_thresholds(code, bits):
    near = {32: 1e-6, 64: 1e-9}[bits]  # as good as SciPy's quantiles are; its tails are better
    for s in (0.5, 0.1, 0.01, 1e-6, 1e-10, 1 - 1e-6):
        found, k = thresholds(code, STUDENT, s, 17, bits)
        assert found == OK and not k[:3].any()
        assert np.allclose(k[3:], stats.t.isf(s / 2, np.arange(2, 16)), rtol=near, atol=0)
        assert bits == 32 or np.allclose(2 * stats.t.sf(k[3:], np.arange(2, 16)), s, rtol=1e-12, atol=0)
        found, k = thresholds(code, NORMAL, s, 17, bits)
        assert found == OK and np.allclose(k, stats.norm.isf(s / 2), rtol=near, atol=0)
        assert bits == 32 or np.allclose(2 * stats.norm.sf(k), s, rtol=1e-11, atol=0)
    assert np.allclose([thresholds(code, STUDENT, s, 8)[1][7] for s in (0.1, 0.01)], (1.943, 3.707), atol=5e-4)  # spec 3.2
    for s in (0.0, 1.0, -0.1, 1.1, np.nan, np.inf):
        found, k = thresholds(code, STUDENT, s, 5, bits)
        assert found == ARGUMENT and (k == 99).all()
    for kind, count in ((2, 5), (-1, 5), (NORMAL, 0)):
        assert thresholds(code, kind, 0.1, count, bits)[0] == ARGUMENT
    t = TYPES[bits]
    assert getattr(code, f"mk_weight_thresholds{t.suffix}")(c_int(0), c_double(0.1), c_int(4), None) == ARGUMENT
    assert np.isfinite(thresholds(code, STUDENT, 1e-300, 4, bits)[1]).all()


@pytest.mark.parametrize("bits", (32, 64))
def test_igg3(code, bits):
    t = TYPES[bits].numpy
    for k0, k1 in ((1.5, 4.0), (1e-20, 1e20), (2.0, 2.0 * (1 + 1e-6))):
        k0, k1 = float(t(k0)), float(t(k1))
        for u in np.r_[0, np.geomspace(k0 / 2, k1 * 2, 200), k0, k1, np.nextafter(t(k1), t(np.inf)), np.nextafter(t(k0), t(0))]:
            for sign in (1, -1):
                value = float(t(sign * u))
                assert abs(weight(code, value, k0, k1, bits) - igg3(value, k0, k1)) < {32: 2e-6, 64: 1e-14}[bits]
    assert weight(code, np.nan, 1, 2, bits) == weight(code, np.nan, 0, 0, bits) == weight(code, np.inf, 1, 2, bits) == 0
    assert weight(code, 1e30, 0, 0, bits) == weight(code, np.inf, 0, 0, bits) == 1


@pytest.mark.parametrize("bits", (32, 64))
def test_statistics(code, bits):
    near, seen = {32: 2e-5, 64: 1e-12}[bits], 0
    for seed in range(200):
        rng = np.random.default_rng(seed)
        rows = int(rng.integers(1, 33))
        r, v = rng.normal(size=rows) * np.where(rng.random(rows) < 0.2, 30, 1), np.exp(rng.normal(size=rows))
        r, v = (a.astype(TYPES[bits].numpy) for a in (r, v))
        for kind in (NORMAL, STUDENT):
            expected = np.zeros(rows) if kind == STUDENT and rows < 4 else statistics(kind, r, np.diag(v))
            for onto in (None, 0, 1):
                found = measured(code, kind, r, v, bits, onto)
                assert np.max(np.abs(found - expected) / np.maximum(1, np.abs(expected))) < near
            # Units of all kinds: of both together none is seen; that of r alone cancels in t.
            for scale in {32: (1e-15, 1e-3, 1e15), 64: (1e-150, 1e-3, 1e150)}[bits]:
                found = measured(code, kind, scale * r.astype(float), scale**2 * v.astype(float), bits)
                assert np.max(np.abs(found - expected) / np.maximum(1, np.abs(expected))) < 2 * near
            for scale in {32: (1e-25, 1e25), 64: (1e-200, 1e200)}[bits] if kind == STUDENT else ():
                found = measured(code, kind, scale * r.astype(float), v, bits)
                assert np.max(np.abs(found - expected) / np.maximum(1, np.abs(expected))) < 2 * near
            seen += kind == STUDENT and rows >= 4
    assert seen > 100


@pytest.mark.parametrize("bits", (32, 64))
def test_others_do_not_vary(code, bits):
    most = np.finfo(TYPES[bits].numpy).max
    for same in (0.0, 0.1, -7.3, 1e30):
        for place in range(5):
            for off, expected in ((0, 0), (1, most), (-1, -most)):
                r = np.full(5, same)
                r[place] += off * max(1, abs(same))
                found = measured(code, STUDENT, r, np.ones(5), bits)
                assert found[place] == expected
                assert np.isfinite(found).all() and (off or not found.any())


# --- what is refused -------------------------------------------------------------------------------------------------------

def test_refused_weights(code):
    rng, n, P, H, R, x, z = draw(5)
    count = len(z) * max(map(len, H))
    good = limits(code, STUDENT, count + 1)

    def started(k, update=EXTENDED, kind=STUDENT):
        f = Filter(code, n, np.eye(n), np.zeros((n, n)), list(zip(map(linear, H), R)), x, P, kind=update, increments=2, weights=(kind, *k))
        before = f.state()
        found = f.start()
        assert found == OK or f.state() == before
        return found
    assert started(good) == started(good, UNSCENTED) == OK
    for update in (PROGRESSIVE, ITERATED, LITERAL):
        assert started(good, update) == ARGUMENT
    assert started(good, kind=2) == ARGUMENT
    assert started((None, good[1])) == started((good[0], None)) == ARGUMENT

    def changed(which, value, place=-1):
        k = [a.copy() for a in good]
        k[which][count - 1 if place == -1 else place] = value
        return k
    for value in (np.nan, np.inf, -np.inf):
        assert started(changed(0, value)) == started(changed(1, value)) == NOT_FINITE
    assert started(changed(0, 100.0)) == started(changed(0, -1.0)) == started(changed(1, 0.0)) == started(changed(0, 0.0)) == ARGUMENT
    assert started((good[1], good[1])) == ARGUMENT
    assert started(changed(0, np.nan, count)) == OK  # beyond the rows there are: not read


def test_failure_leaves_the_weights(code):
    """A model that fails, and what fails in the update itself: nothing changes, the weights of the last update either."""
    rng, n, P, H, R, x, z = draw(5)
    answer = [None]
    f = filter_of(code, n, P, H, R, x, limits(code, STUDENT, 3 * len(z)), fail=lambda which: answer[0])
    put_all(f, z)
    assert f.update() == OK
    put_all(f, z)
    before = f.state(), f.weight.copy(), f.statistic.copy()
    for answer[0] in (status("DOMAIN"), "nan"):
        assert f.update() != OK
        assert f.state() == before[0] and np.array_equal(f.weight, before[1]) and np.array_equal(f.statistic, before[2])
        assert f.core.failed == 0
        assert f.innovations()[0] != OK and f.state() == before[0] and f.core.failed == 0
    answer[0] = None
    assert f.innovations()[0] == OK and f.state() == before[0] and f.core.failed == f.slots
    assert f.update() == OK


# --- innovations and move --------------------------------------------------------------------------------------------------

@pytest.mark.parametrize("update", (EXTENDED, UNSCENTED), ids=("ekf", "ukf"))
def test_innovations_of_curved_models(code, update):
    """Against the textbook's moments, before a gate that refuses all."""
    for seed in range(30):
        rng = np.random.default_rng(seed)
        sensors = [(distance_to((9.0, 4.0), (0, 1)), np.array([[0.04]])), (bearing_from((-7.0, 5.0), (0, 1)), np.array([[1e-3]])),
                   (quadratic(rng, 4, 3, 0.1), covariance(rng, 3, 0.1, 1))]
        x, P = rng.normal(size=4), covariance(rng, 4, 0.1, 1)
        f = Filter(code, 4, waves(rng, 4, 0.3), np.eye(4), sensors, x, P, kind=update, gate=dict(sensor=[1e-9] * 3))
        textbook = Textbook(4, np.eye(4), np.eye(4), sensors, x, P, extended=update == EXTENDED)
        assert f.start() == OK
        found, r, S, rows = f.innovations()
        assert found == OK and not rows.any() and not len(r)
        slots = [s for s in range(3) if rng.random() < 0.8]
        z = {s: sensors[s][0].function(x[None] + 0.2, 0)[0] for s in slots}
        for s in slots:
            assert f.put(s, z[s]) == OK
        before = f.state(failed=True)
        found, r, S, rows = f.innovations()
        assert found == OK and f.state(failed=True) == before
        assert list(rows) == [sensors[s][0].rows if s in slots else 0 for s in range(3)]
        if not slots:
            continue
        zh, spread, _ = textbook.moments(slots)
        exact = spread + textbook.noise(slots)
        assert np.max(np.abs(r - textbook.error(slots, z, zh))) < 1e-12 and np.max(np.abs(S - exact)) < 1e-12 * np.max(np.abs(exact))


def test_innovations_and_move_refused(code):
    rng, n, P, H, R, x, z = draw(5)
    f = Filter(code, n, np.eye(n), np.eye(n), list(zip(map(linear, H), R)), x, P)
    assert f.innovations()[0] == f.move(np.zeros(n)) == ORDER
    assert f.start() == OK
    before = f.state()
    dx = rng.normal(size=n)
    for bad in (np.nan, np.inf):
        assert f.move(np.r_[dx[:-1], bad]) == NOT_FINITE and f.state() == before
    assert f.move(None) == ARGUMENT
    assert f.move(np.full(n, 1.7e308)) == OK and f.move(np.full(n, 1.7e308)) == NOT_FINITE
    assert f.restart(x, P) == OK and f.move(dx) == OK
    assert np.array_equal(f.x, x + dx) and np.allclose(f.P, P)
    put_all(f, z)
    pointers = [c_void_p(np.zeros(600).ctypes.data) for _ in range(3)]
    for missing in range(3):
        arguments = [None if i == missing else p for i, p in enumerate(pointers)]
        assert f.call("innovations", f.n, f.m, f.slots, ctypes.byref(f.view), *arguments) == ARGUMENT
