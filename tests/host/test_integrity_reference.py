# SPDX-License-Identifier: MIT
"""The reference of the slow-fault monitor against definitions, laws and the published experiment (spec 3)."""
import functools

import integrity_end
import integrity_guard as guard
import integrity_model as model
import integrity_published as published
import integrity_reference as reference
import numpy as np
import pytest
from scipy import stats

RUNS = 100


@functools.lru_cache(None)
def scenario():
    Phis, Qs = model.transitions()
    H = model.geometry()
    return Phis, Qs, H, *model.draw(np.random.default_rng(1), RUNS, Phis, Qs, H)


def measured(rate, last=299, row=0):
    Phis, Qs, H, _, zs = scenario()
    z = zs.copy()
    z[:, :, row] += model.ramp(rate, last=last)[:, None]
    return z, Phis, Qs, H


@functools.lru_cache(None)
def scheme(name, rate):
    return published.run(*measured(rate), name, improved=name == 'rekf-t')


def alarm_times(out):
    alarm = (out['alarm'] + out['ended'])[150:] > 0
    assert alarm.any(0).all()
    return 151 + alarm.argmax(0)


def random_covariance(rng, n):
    A = rng.standard_normal((n, n + 3))
    return A @ A.T


def test_thresholds():
    assert stats.chi2.isf(8e-10, 8) == pytest.approx(58.80, abs=0.005)
    assert reference.t_thresholds(8) == pytest.approx((1.943, 3.707), abs=5e-4)


def test_t_statistics_leave_one_out():
    rng = np.random.default_rng(2)
    u, used = rng.standard_normal((5, 8)), rng.random((5, 8)) < 0.8
    t = reference.t_statistics(u, used)
    for run in range(5):
        for j in range(8):
            others = u[run, used[run] & (np.arange(8) != j)]
            expected = (u[run, j] - others.mean()) / (others.std(ddof=1) * np.sqrt(1 + 1 / len(others))) if used[run, j] else 0
            assert t[run, j] == pytest.approx(expected, rel=1e-10)


def test_t_statistics_law():
    t = reference.t_statistics(np.random.default_rng(3).standard_normal((20000, 8)))
    assert stats.kstest(t[:, 0], stats.t(6).cdf).pvalue > 1e-3


def test_isolation_is_what_a_free_bias_takes_from_the_statistic():
    rng = np.random.default_rng(4)
    S = np.array([random_covariance(rng, 5) for _ in range(10)])
    r = rng.standard_normal((10, 5))
    q, v, I = reference.aime(r, np.linalg.inv(S))
    T, j = reference.isolate(v, I)
    assert j == T.argmax()
    for row in range(5):  # the constant bias vector of the pooled estimate, that of this row free: what is left by generalised least squares
        pooled, Sb = np.linalg.solve(I, v), np.linalg.inv(I)
        a = np.eye(5)[row]
        b = a @ np.linalg.solve(Sb, pooled) / (a @ np.linalg.solve(Sb, a))
        left = (pooled - b * a) @ np.linalg.solve(Sb, pooled - b * a)
        assert q - T[row] == pytest.approx(left, rel=1e-9)


def test_excluded_row_is_as_if_it_were_not_there():
    rng = np.random.default_rng(5)
    P, H, R = random_covariance(rng, 6), rng.standard_normal((4, 6)), np.diag([1.0, 2, 3, 4])
    used = np.array([True, False, True, True])
    x, z = rng.standard_normal(6), rng.standard_normal(4)
    r, S, PHt = reference.innovate(x, P, z, H, R)
    one = reference.update(x, P, r, PHt, reference.information(S, used), np.ones(4), H, R)
    r, S, PHt = reference.innovate(x, P, z[used], H[used], R[np.ix_(used, used)])
    other = reference.update(x, P, r, PHt, np.linalg.inv(S), np.ones(3), H[used], R[np.ix_(used, used)])
    assert np.allclose(one[0], other[0], rtol=1e-10) and np.allclose(one[1], other[1], rtol=1e-10)


def test_statistics_follow_their_laws_without_fault():
    """One epoch of every window: windows that overlap would not be independent."""
    Phis, Qs, H, _, zs = scenario()
    out = published.run(zs, Phis, Qs, H, 'ekf')
    assert stats.kstest(out['q_r'].ravel(), stats.chi2(8).cdf).pvalue > 1e-3
    assert stats.kstest(out['q_a'][9::10].ravel(), stats.chi2(8).cdf).pvalue > 1e-3


def test_published_order_and_no_false_alarm():
    gains = []
    for rate in (0.10, 0.15, 0.25):
        times = {name: alarm_times(scheme(name, rate)).mean() for name in ('ekf', 'rekf-n', 'rekf-t')}
        assert times['rekf-t'] < times['rekf-n'] < times['ekf']
        gains.append(times['ekf'] - times['rekf-t'])
        for name in times:
            assert not scheme(name, rate)['alarm'][:150].any()
    # The gains of 0.10 and 0.15 m/s lie within each other's error; that of 0.25 m/s does not.
    assert gains[2] < min(gains[:2])


def test_published_innovation_at_the_end():
    ekf, t = (scheme(name, 0.15)['r'][298, :, 0].mean() for name in ('ekf', 'rekf-t'))
    assert ekf == pytest.approx(9, abs=1)
    assert 20 < t < 22.5


def test_published_alarm_after_the_end():
    assert scheme('ekf', 0.15)['alarm'][299:].sum(0).mean() > 30
    assert scheme('rekf-t', 0.15)['alarm'][299:].sum(0).mean() < 3


@pytest.mark.parametrize('rate, last', [(0.10, 299), (0.15, 299), (0.25, 299), (0.15, 250), (0.15, 280)])
def test_end_of_fault(rate, last):
    out = guard.run(*measured(rate, last))
    offset, right = guard.declared(out, 0, last)
    assert right.mean() > 0.95
    assert (np.abs(offset) <= 2).mean() >= 0.95
    assert (offset < -2).mean() <= 0.01
    assert not out['faulty'][-1].any()


def test_end_of_fault_early_probability():
    """Page's test with a tracker that matches the drift: `early` bounds the probability; a low level makes it measurable."""
    rng = np.random.default_rng(6)
    runs, epochs = 20000, 100
    test = integrity_end.EndOfFault((runs,), early=0.05, horizon=epochs, level=0, slope=0, jump=1e-12, back=1)
    b, s = 2 + rng.standard_normal(runs), rng.standard_normal(runs) / 10
    everyone, ended = np.ones(runs, bool), np.zeros(runs, bool)
    test.start(everyone, np.full(runs, 2.0))
    for _ in range(epochs):
        b = b + s
        over, _, _ = test.step(everyone & ~ended, b + rng.standard_normal(runs))
        ended |= over
    assert 0 < ended.mean() <= 0.05


def test_fault_with_another_value_is_not_over():
    runs = 500
    rng = np.random.default_rng(7)
    test = integrity_end.EndOfFault((runs,), jump=1e-3)
    everyone, ended = np.ones(runs, bool), np.zeros(runs, bool)
    test.start(everyone, np.full(runs, 8.0))
    for k in range(60):
        over, back, _ = test.step(everyone & ~ended, (8.0 if k < 30 else -6.0) + rng.standard_normal(runs))
        ended |= over | back
    assert ended.mean() < 0.02


def test_healthy_row_comes_back():
    runs = 1000
    rng = np.random.default_rng(8)
    test = integrity_end.EndOfFault((runs,))
    everyone, held = np.ones(runs, bool), np.ones(runs, bool)
    test.start(everyone, np.full(runs, 2.5))
    for _ in range(30):
        over, back, _ = test.step(held, rng.standard_normal(runs))
        held &= ~(over | back)
    assert held.mean() < 0.01
