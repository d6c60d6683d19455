# SPDX-License-Identifier: MIT
"""The integrity monitor of the node library on random innovations, beside the same rules written in NumPy with dense matrices and a list of the
epochs in the window: sensors that come and go, of one to three rows, with faults that begin, drift, jump and end."""
import numpy as np
import pytest
from scipy import linalg, stats

from monitors import AIME, EXCLUDE, IMPROVED, Monitor, covariance

CLOSE = {64: 1e-10, 32: 2e-3}


class Tracker:
    """The end of the fault of one sensor: level and slope of each row, Page's test, and the test of the window."""

    def __init__(self, rows, level, window):
        self.rows, self.window, self.n, self.T = rows, window, 0, np.zeros(rows)
        self.begin(level)

    def begin(self, level):
        rows = self.rows
        self.x = np.stack([level, np.zeros(rows)], 1)
        self.P = np.array([np.diag([1, self.window**-2.0])] * rows)
        self.C, self.k, self.t = 0.0, 0, np.zeros(rows)

    def predict(self):
        F = np.array([[1, 1], [0, 1]])
        self.x = self.x @ F.T
        self.P = F @ self.P @ F.T + np.diag([0.01, 1e-4])

    def step(self, u, h, zero, back):
        """True where the fault is over."""
        self.predict()
        V = 1 + self.P[:, 0, 0]
        ratio = stats.norm.logpdf(u) - stats.norm.logpdf(u, self.x[:, 0], np.sqrt(V))
        self.C = max(0.0, self.C + ratio.sum())
        self.k, self.t = (self.k + 1, self.t + u) if self.C > 0 else (0, np.zeros(self.rows))
        self.n, self.T = self.n + 1, self.T + u
        trust = min(max(1 - self.C / h, 0), 1)
        gain = trust * self.P[:, :, 0] / V[:, None]
        self.x = self.x + gain * (u - self.x[:, 0])[:, None]
        self.P = self.P - gain[:, :, None] * self.P[:, None, 0, :]
        over, self.shown = False, self.C / h
        if self.C > h:
            over = self.t @ self.t <= zero * self.k
            if not over:
                self.begin(self.t / self.k)
        if self.n >= self.window:
            over |= self.T @ self.T <= back * self.n
            self.n, self.T = 0, np.zeros(self.rows)
        return over


class Reference:
    def __init__(self, window, thresholds, h, zero, back, most=9, separation=0.0, patience=0):
        self.window, self.thresholds, self.h, self.zero, self.back = window, thresholds, h, zero, back
        self.most, self.separation, self.patience, self.waited = most, separation, patience, 0
        self.epochs, self.faulty, self.leaps = [], {}, 0

    def sums(self):
        keys = sorted({key for epoch in self.epochs for key in epoch[0]})
        I, v = np.zeros((len(keys),) * 2), np.zeros(len(keys))
        for own, Z, s in self.epochs:
            at = [keys.index(key) for key in own]
            I[np.ix_(at, at)] += Z
            v[at] += s
        return keys, I, v

    @staticmethod
    def pooled(I, v, at):
        """v' I^-1 v of some rows, the offsets of the others being free: the statistic of the average offsets of those rows."""
        b, covariance = np.linalg.solve(I, v), np.linalg.inv(I)
        return b[at] @ np.linalg.solve(covariance[np.ix_(at, at)], b[at]) if at else 0.0

    def isolate(self, keys, I, v, force):
        """Sensors that explain the alarm and the offsets of their rows, None where it stays unresolved."""
        left, out = sorted({key[0] for key in keys}), []

        def held(out):
            at = [i for i, key in enumerate(keys) if key[0] in out]
            return out, dict(zip([keys[i] for i in at], np.linalg.solve(I[np.ix_(at, at)], v[at])))

        def rest(without):
            at = [i for i, key in enumerate(keys) if key[0] not in without]
            return self.pooled(I, v, at), len(at)
        while left and len(out) < self.most - len(self.faulty):
            q = {j: rest(out + [j]) for j in left}
            now = rest(out)[0]
            j = min(left, key=lambda j: q[j][0] / self.thresholds[q[j][1] - 1] if q[j][1] else 0.0)
            w = {k: now - q[k][0] for k in left}
            out.append(j)
            left.remove(j)
            if not q[j][1] or q[j][0] < self.thresholds[q[j][1] - 1]:
                return held(out) if force or max([w[k] for k in left], default=-np.inf) <= w[j] - self.separation else None
        return held(out[:1]) if force and out else None

    def watch(self, ids, rows, r, S):
        start = np.concatenate([[0], np.cumsum(rows)]).astype(int)
        blocks = {id: slice(start[l], start[l + 1]) for l, id in enumerate(ids) if rows[l]}
        good = [(id, k) for id in blocks if id not in self.faulty for k in range(blocks[id].stop - blocks[id].start)]
        at = [blocks[id].start + k for id, k in good]
        Z = np.linalg.inv(S[np.ix_(at, at)])
        self.epochs = self.epochs[-(self.window - 1):] if self.window > 1 else []
        self.epochs.append((good, Z, Z @ r[at]))
        self.rctm, self.rows = r[at] @ Z @ r[at], len(at)
        keys, I, v = self.sums()
        self.aime, self.window_rows, self.keys, self.I, self.v = self.pooled(I, v, list(range(len(keys)))), len(keys), keys, I, v
        self.alarm = bool(keys) and self.aime >= self.thresholds[len(keys) - 1]
        self.over, self.unresolved = [], False

        def whiten(id, values):
            return linalg.solve_triangular(np.linalg.cholesky(S[blocks[id], blocks[id]]), values, lower=True)
        for id, tracker in list(self.faulty.items()):
            if id not in blocks:
                tracker and tracker.predict()
            elif tracker is None:
                u = whiten(id, r[blocks[id]])
                self.faulty[id] = Tracker(len(u), u, self.window)
            else:
                u = whiten(id, r[blocks[id]])
                if tracker.step(u, self.h, self.zero[len(u) - 1], self.back[len(u) - 1]):
                    self.over.append(id)
                    del self.faulty[id]
        if self.alarm:
            found = self.isolate(keys, I, v, False)
            if not found and self.rows and self.rctm >= self.thresholds[self.rows - 1]:
                found = self.isolate(good, Z, Z @ r[at], False)
                self.leaps += found is not None
            if not found and self.patience and self.waited >= self.patience:
                found = self.isolate(keys, I, v, True)
            self.unresolved = found is None
            if found:
                for id in found[0]:
                    if id not in blocks:
                        self.faulty[id] = None
                        continue
                    count = blocks[id].stop - blocks[id].start
                    level = whiten(id, np.array([found[1].get((id, k), 0.0) for k in range(count)]))
                    self.faulty[id] = Tracker(count, level, self.window)
                self.epochs = []
        self.waited = self.waited + 1 if self.unresolved else 0


def stream(g, sensors, epochs, presence, faults):
    """ids, rows, r, S of each epoch. faults: of (sensor, from, to): offset of its rows by epoch."""
    rows = np.asarray(sensors)
    for t in range(epochs):
        read = g.random(len(rows)) < presence(t)
        order = g.permutation(len(rows))
        count = np.where(read, rows, 0)[order]
        n = count.sum()
        S = covariance(g, n) if n else np.zeros((0, 0))
        r = np.linalg.cholesky(S) @ g.standard_normal(n) if n else np.zeros(0)
        at = 0
        for sensor, k in zip(order, count):
            for f, begin, end, offset in faults:
                if f == sensor and begin <= t < end:
                    r[at:at + k] += offset(t - begin)
            at += k
        yield order * 7 + 3, count, r, S


FAULTS = [(0, 60, 130, lambda t: 0.3 * t), (2, 90, 140, lambda t: 9.0 + 0 * t), (1, 200, 260, lambda t: -0.5 * t), (1, 300, 360, lambda t: 12.0 - 0.2 * t),
          (4, 320, 330, lambda t: 15.0), (0, 420, 421, lambda t: 30.0), (2, 450, 451, lambda t: 300.0), (3, 480, 560, lambda t: 10.0 if t < 40 else -12.0)]


@pytest.mark.parametrize("bits", [64, 32])
@pytest.mark.parametrize("window, seed, separation, patience, most", [(10, 1, 0, 0, 3), (10, 2, 40, 0, 3), (2, 3, 0, 0, 3), (1, 4, 0, 0, 3), (25, 5, 0, 0, 3),
                                                                      (10, 6, 40, 3, 3), (10, 7, 0, 2, 1)])
def test_exclusion(code, bits, window, seed, separation, patience, most):
    """float32: only as long as no decision is taken otherwise, which would be no error."""
    g = np.random.default_rng(seed)
    sensors = (1, 2, 1, 3, 2, 1)
    monitor = Monitor(code, 3, 6, window, EXCLUDE, bits, false_alarm=1e-6, separation=separation, patience=patience, most=most)
    reference = Reference(window, monitor.threshold.astype(float), monitor.config.evidence, monitor.zero.astype(float), monitor.back.astype(float),
                          most, separation, patience)
    ends = starts = unresolved = 0
    close = CLOSE[bits]
    for t, (ids, rows, r, S) in enumerate(stream(g, sensors, 600, lambda t: 1 if t < 150 else 0.75, FAULTS)):
        if bits == 32:
            r, S = r.astype(np.float32).astype(float), S.astype(np.float32).astype(float)
        before = set(reference.faulty)
        reference.watch(ids, rows, r, S)
        assert monitor.watch(ids, rows, r, S) == 0
        core = monitor.core
        scale = 1 + reference.aime
        assert core.epoch == t + 1 and core.rows == reference.rows and core.window_rows == reference.window_rows
        assert abs(core.rctm - reference.rctm) <= close * (1 + reference.rctm) and abs(core.aime - reference.aime) <= close * scale
        assert core.alarm == reference.alarm and core.unresolved == reference.unresolved and core.ended == bool(reference.over), t
        assert {s.id for s in monitor.sensor if s.used and s.faulty} == set(reference.faulty), t
        assert core.faulty == len(reference.faulty)
        for j in {key[0] for key in reference.keys}:
            at = [i for i, key in enumerate(reference.keys) if key[0] != j]
            w = reference.aime - reference.pooled(reference.I, reference.v, at)
            assert abs(monitor.of(j).w - w) <= close * scale
        for id, tracker in reference.faulty.items():
            if tracker is None:
                continue
            found = monitor.faults(id)[:tracker.rows]
            size = 1 + np.abs(tracker.x).max()
            assert np.allclose([f.level for f in found], tracker.x[:, 0], rtol=0, atol=close * size)
            assert np.allclose([f.slope for f in found], tracker.x[:, 1], rtol=0, atol=close * size)
            assert np.allclose([list(f.P) for f in found], tracker.P[:, [0, 0, 1], [0, 1, 1]], rtol=close, atol=close)
            assert abs(monitor.of(id).evidence - tracker.C) <= close * 100 * size and monitor.of(id).counted == tracker.n
        ends, starts, unresolved = ends + len(reference.over), starts + len(set(reference.faulty) - before), unresolved + reference.unresolved
    assert starts >= 5 and ends >= 4, (starts, ends)
    assert not (separation or patience) or unresolved > 0
    assert reference.leaps > 0 or window == 1


@pytest.mark.parametrize("bits", [64, 32])
def test_improved(code, bits):
    """The published decision by its words, on statistics from dense sums."""
    g = np.random.default_rng(11)
    window, sensors = 6, (1, 1, 2, 1)
    faults = [(0, t, t + 25, lambda k: 0.6 * k) for t in range(30, 900, 60)]
    monitor = Monitor(code, 2, 4, window, IMPROVED, bits, false_alarm=1e-6, jump=6)
    plain = Monitor(code, 2, 4, window, AIME, bits, false_alarm=1e-6)
    reference = Reference(window, monitor.threshold.astype(float), 1, [1, 1], [1, 1], 0)
    since, quiet, ends, rhos = 0, 0, 0, [1.0, 1.0, 1.0]
    for ids, rows, r, S in stream(g, sensors, 900, lambda t: 1, faults):
        if bits == 32:
            r, S = r.astype(np.float32).astype(float), S.astype(np.float32).astype(float)
        reference.watch(ids, rows, r, S)
        assert monitor.watch(ids, rows, r, S) == 0 and plain.watch(ids, rows, r, S) == 0
        if quiet:
            quiet -= 1
            reference.epochs = []
            rhos.append(1.0)
            assert monitor.core.alarm == (reference.rctm >= reference.thresholds[reference.rows - 1]) and monitor.core.aime == 0
            assert not monitor.core.ended and monitor.core.quiet == quiet
            since = 0
            continue
        since = since + 1 if reference.alarm else 0
        rhos.append(reference.aime / max(reference.rctm, 0.1) if reference.alarm else 1.0)
        over = since >= 3 and rhos[-1] - np.median(rhos[-3:]) > 6
        assert abs(monitor.core.rho - rhos[-1]) <= CLOSE[bits] * rhos[-1] and abs(monitor.core.median - np.median(rhos[-3:])) <= CLOSE[bits] * max(rhos[-3:])
        assert monitor.core.ended == over and monitor.core.alarm == (reference.alarm and not over)
        if over:
            ends, quiet, reference.epochs = ends + 1, window, []
    assert ends >= 5 and monitor.core.ends == ends
