# SPDX-License-Identifier: MIT
"""<meshkal/weights.h> and the robust gain of <meshkal/unscented.h> (spec 3.2) against the definitions: the gain from whole covariances in the longest
float type, P in Joseph form."""
import ctypes
from ctypes import c_double, c_int, c_void_p

import numpy as np
import pytest
from scipy import stats

from nonlinear import covariance, linear, waves
from textbook import LONG, blocks, inverse, solve
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
