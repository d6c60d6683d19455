# SPDX-License-Identifier: MIT
"""Statistics of the integrity monitor follow their laws: Kolmogorov-Smirnov on 1e5 epochs without fault, tails by importance sampling."""
from ctypes import byref

import numpy as np
import pytest
from scipy import stats

from monitors import AIME, EXCLUDE, RCTM, Monitor, covariance, pack

pytestmark = pytest.mark.once
SENSORS = (1, 2, 1, 1, 3, 1)
WINDOW = 5


class Draws:
    """Epochs without fault: which sensors are read and S come from a stock, so that drawing is quick."""

    def __init__(self, seed, kinds=60, presence=0.7, dtype=np.float64):
        self.g, self.dtype = np.random.default_rng(seed), dtype
        self.kinds = []
        for _ in range(kinds):
            order = self.g.permutation(len(SENSORS))
            count = np.where(self.g.random(len(SENSORS)) < presence, SENSORS, 0)[order]
            S = covariance(self.g, count.sum()).astype(dtype).astype(float) * 10 ** self.g.uniform(-1, 1)
            S = S.astype(dtype).astype(float)
            keys = [3 * sensor + k for sensor, rows in zip(order, count) for k in range(rows)]
            self.kinds.append((order.astype(np.uint16), count.astype(np.uint8), S, np.linalg.cholesky(S), pack(S).astype(dtype), keys, np.linalg.inv(S)))

    def epoch(self):
        kind = self.kinds[self.g.integers(len(self.kinds))]
        return kind, kind[3] @ self.g.standard_normal(len(kind[3]))


def uniform(p, name):
    statistic, level = stats.kstest(p, "uniform")
    print(f"{name}: {len(p)} values, distance {statistic:.5f}, level {level:.3f}")
    return level > 1e-3


@pytest.mark.parametrize("bits", [64, 32])
def test_laws(code, bits):
    """q_R of every epoch, q_A and the w of one sensor of every window, with a set of rows that changes from epoch to epoch. Also the rate of alarms."""
    epochs, false_alarm = 100000, 0.02
    monitor = Monitor(code, 3, 6, WINDOW, AIME, bits, false_alarm)
    draws = Draws(bits, dtype=monitor.types.numpy)
    rctm, aime, single = [], [], []
    alarms = 0
    for t in range(epochs):
        kind, r = draws.epoch()
        assert monitor.watch_packed(kind[0], kind[1], r.astype(draws.dtype), kind[4]) == 0
        core = monitor.core
        if core.rows:
            rctm.append((core.rctm, core.rows))
        if t % WINDOW != WINDOW - 1:
            continue
        aime.append((core.aime, core.window_rows))
        alarms += core.alarm
        sensors = [(p, s) for p, s in enumerate(monitor.sensor) if s.used]
        p, sensor = sensors[draws.g.integers(len(sensors))]
        rows = bin(int(np.bitwise_or.reduce(monitor.seen)) >> 3 * p & 7).count("1")
        if rows:
            single.append((sensor.w, rows))
    assert core.crowded == 0 and len(set(np.array(rctm)[:, 1])) > 5
    for name, values in (("q_R", rctm), ("q_A", aime), ("w", single)):
        q, rows = np.array(values).T
        assert uniform(stats.chi2.sf(q, rows), f"float{bits} {name}")
    low, high = stats.binom.interval(1 - 1e-3, len(aime), false_alarm)
    print(f"alarms {alarms} of {len(aime)}, expected {low:.0f} .. {high:.0f}")
    assert low <= alarms <= high


@pytest.mark.parametrize("bits", [64, 32])
@pytest.mark.parametrize("scheme, window", [(RCTM, 1), (AIME, WINDOW)])
@pytest.mark.parametrize("false_alarm", [1e-6, 1e-9])
def test_tails(code, bits, scheme, window, false_alarm):
    """P(alarm) by importance sampling: the average offset b of a window is drawn with c^2 times its covariance I^-1, what is left of the innovations stays.
    Weight of a draw: c^rows exp(-(1 - 1 / c^2) b' I b / 2). Every alarm is the monitor's own."""
    trials = 8000
    monitor = Monitor(code, 3, 6, window, scheme, bits, false_alarm)
    draws = Draws(100 * bits + window, dtype=monitor.types.numpy)
    weights = np.zeros(trials)
    for trial in range(trials):
        epochs = [draws.epoch() for _ in range(window)]
        keys = sorted({key for kind, _ in epochs for key in kind[5]})
        at = [[keys.index(key) for key in kind[5]] for kind, _ in epochs]
        I, v = np.zeros((len(keys), len(keys))), np.zeros(len(keys))
        for (kind, r), place in zip(epochs, at):
            I[np.ix_(place, place)] += kind[6]
            v[place] += kind[6] @ r
        if not keys:
            continue
        b = np.linalg.solve(I, v)
        c = np.sqrt(monitor.threshold[len(keys) - 1] / len(keys))
        assert monitor.call("restart", byref(monitor.view)) == 0
        for (kind, r), place in zip(epochs, at):
            assert monitor.watch_packed(kind[0], kind[1], (r + (c - 1) * b[place]).astype(draws.dtype), kind[4]) == 0
        assert monitor.core.window_rows == len(keys)
        weights[trial] = monitor.core.alarm * c ** len(keys) * np.exp(-(1 - c**-2) * c * c * b @ I @ b / 2)
    empty = np.mean([len(kind[5]) == 0 for kind in draws.kinds]) ** window
    expected, error = false_alarm * (1 - empty), weights.std() / np.sqrt(trials)
    print(f"float{bits} window {window}: P(alarm) {weights.mean():.3e} +- {error:.1e}, expected {expected:.3e}")
    assert error < 0.05 * expected and abs(weights.mean() - expected) < 3.3 * error


def test_early_ends(code):
    """While a fault goes on as the tracker has it, Page's test calls it over with less than the probability asked for."""
    early, epochs, window = 0.1, 200, 10
    g, ids, rows, S = np.random.default_rng(3), np.arange(8, dtype=np.uint16), np.ones(8, np.uint8), pack(np.eye(8))
    ends = runs = 0
    for _ in range(60):
        monitor = Monitor(code, 1, 8, window, EXCLUDE, early=early, epochs=epochs, back=1 - 1e-12)
        level, slope = 12 + g.standard_normal(8), g.standard_normal(8) / window
        assert monitor.watch_packed(ids, rows, np.full(8, 12.0), S) == 0 and monitor.core.faulty == 8
        for _ in range(epochs):
            level = level + slope + 0.1 * g.standard_normal(8)
            slope = slope + 0.01 * g.standard_normal(8)
            monitor.watch_packed(ids, rows, level + g.standard_normal(8), S)
        runs += 8
        ends += sum(s.until > 0 for s in monitor.sensor)
    print(f"{ends} of {runs} ended early")
    assert ends <= stats.binom.ppf(0.999, runs, early)
