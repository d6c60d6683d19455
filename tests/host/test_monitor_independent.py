# SPDX-License-Identifier: MIT
"""The integrity monitor of the node library beside the reference that was written without it (integrity_reference, _end, _published): on random
innovations to 1e-10, and at work in the navigation scenario of spec 3.4."""
import integrity_end
import integrity_model as model
import integrity_published as published
import integrity_reference as reference
import numpy as np
import pytest

from monitors import EXCLUDE, IMPROVED, Monitor, covariance

ROWS, IDS, ONE = 8, np.arange(8), np.ones(8, int)


def close(found, expected, scale=0.0):
    assert np.allclose(found, expected, rtol=1e-10, atol=1e-10 * (1 + scale)), (found, expected)


def epochs(seed, count, faults):
    """Innovations of eight rows and their covariance; faults: (row, from, to, offset by epoch)."""
    g = np.random.default_rng(seed)
    for t in range(count):
        S = covariance(g, ROWS)
        r = np.linalg.cholesky(S) @ g.standard_normal(ROWS)
        for row, begin, end, offset in faults:
            if begin <= t < end:
                r[row] += offset(t - begin)
        yield t, r, S


@pytest.mark.parametrize("seed", range(4))
def test_exclusion(code, seed):
    faults = [(seed, 40, 90, lambda t: 0.4 * t), (seed + 3, 130, 170, lambda t: 9.0), (seed, 210, 280, lambda t: 20.0 if t < 30 else 6.5),
              (seed + 1, 320, 325, lambda t: 12.0), (seed + 2, 360, 440, lambda t: -0.3 * t)]
    window, false_alarm = 10, 1e-7
    monitor = Monitor(code, 1, ROWS, window, EXCLUDE, false_alarm=false_alarm)
    test = integrity_end.EndOfFault(ROWS, window=window)
    faulty, past, starts, ends, changes = np.zeros(ROWS, bool), [], 0, 0, 0
    for t, r, S in epochs(seed, 460, faults):
        assert monitor.watch(IDS, ONE, r, S) == 0
        core, s = monitor.core, np.diag(S)
        over, back, changed = test.step(faulty, r / np.sqrt(s))
        past = past[-(window - 1):] + [(r, reference.information(S, ~faulty))]
        q, v, I = reference.aime(*(np.array(a) for a in zip(*past)))
        T, j = reference.isolate(v, I)
        close([core.rctm, core.aime], [reference.rctm(*past[-1]), q], q)
        close([monitor.of(row).w for row in np.nonzero(T >= 0)[0]], T[T >= 0], q)
        new = np.zeros(ROWS, bool)
        if q >= monitor.threshold[(np.diag(I) > 0).sum() - 1]:
            new[j] = True
            test.start(new, v / np.where(np.diag(I) > 0, np.diag(I), 1) / np.sqrt(s))
            past = []
        assert core.alarm == new.any() and core.ended == (over | back).any() and not core.unresolved, t
        faulty = faulty & ~(over | back) | new
        assert [bool(monitor.of(row) and monitor.of(row).faulty) for row in range(ROWS)] == list(faulty), t
        for row in np.nonzero(faulty)[0]:
            tracker, = monitor.faults(row)
            close([tracker.level, tracker.slope, *tracker.P, tracker.sum, tracker.all],
                  [getattr(test, name)[row] for name in ("b", "s", "p11", "p12", "p22", "t", "T")], abs(test.b[row]))
            watched = monitor.of(row)
            close([watched.evidence, watched.speaking, watched.counted], [test.C[row], test.k[row], test.n[row]], 100)
        starts, ends, changes = starts + new.sum(), ends + (over | back).sum(), changes + (changed & ~back).sum()
    assert starts >= 5 and ends == starts and changes >= 1


def test_published_end(code):
    window = 10
    faults = [(row % ROWS, t, t + 40, lambda k: 0.3 * k) for row, t in enumerate(range(30, 1000, 80))]
    monitor = Monitor(code, 1, ROWS, window, IMPROVED, false_alarm=1e-7, jump=8)
    past, since, quiet, ends, ratios = [], -1, 0, 0, [1.0, 1.0]
    for t, r, S in epochs(9, 1000, faults):
        assert monitor.watch(IDS, ONE, r, S) == 0
        inverse = reference.information(S, np.ones(ROWS, bool))
        single = reference.rctm(r, inverse)
        if quiet:
            assert monitor.core.alarm == (single >= monitor.threshold[ROWS - 1]) and not monitor.core.ended
            quiet, ratios = quiet - 1, [1.0, 1.0]
            continue
        past = past[-(window - 1):] + [(r, inverse)]
        q = reference.aime(*(np.array(a) for a in zip(*past)))[0]
        alarm = q >= monitor.threshold[ROWS - 1]
        since = since + 1 if alarm else -1
        ratio, _, over = published.published_rule(q, single, since, ratios, 8.0)
        over &= alarm
        close([monitor.core.rctm, monitor.core.aime, monitor.core.rho], [single, q, ratio if alarm else 1.0], q)
        assert monitor.core.ended == over and monitor.core.alarm == (alarm and not over), t
        ratios = ratios[-1:] + [ratio if alarm else 1.0]
        if over:
            past, since, quiet, ends = [], -1, window, ends + 1
    assert ends >= 6


def navigate(code, runs, rate, last, seed, bits=64, **config):
    """The scenario of spec 3.4, REKF-t, and a monitor that says which rows are used. Returns alarm time of the first isolation, the row, and the epoch
    in which the fault of satellite 1 was found to be over, minus the first epoch without fault; NaN: never."""
    Phis, Qs = model.transitions()
    H, R = model.geometry(), model.SIGMA**2 * np.eye(ROWS)
    _, zs = model.draw(np.random.default_rng(seed), runs, Phis, Qs, H)
    zs[:, :, 0] += model.ramp(rate, last=last)[:, None]
    x, P = np.zeros((runs, model.STATES)), np.tile(model.initial_covariance(), (runs, 1, 1))
    monitors = [Monitor(code, 1, ROWS, 10, EXCLUDE, bits, **config) for _ in range(runs)]
    first, row, end = np.full(runs, np.nan), np.full(runs, -1), np.full(runs, np.nan)
    for k, z in enumerate(zs):
        x, P = reference.predict(x, P, Phis[k], Qs[k])
        r, S, PHt = reference.innovate(x, P, z, H, R)
        used = np.ones((runs, ROWS), bool)
        for i, monitor in enumerate(monitors):
            assert monitor.watch(IDS, ONE, r[i], S[i]) == 0
            for s in monitor.sensor:
                used[i, s.id] = not s.faulty
                if s.faulty and np.isnan(first[i]):
                    first[i], row[i] = k + 1, s.id
                if s.id == 0 and s.until == k + 1 and s.since > 150 and np.isnan(end[i]):
                    end[i] = k + 1 - (last + 1)
        x, P = reference.update(x, P, r, PHt, reference.information(S, used), reference.weights(r, S, used, "rekf-t"), H, R)
    return first, row, end


@pytest.mark.once
def test_navigation(code):
    """Slow faults of one satellite of eight: found, the right one, and over when they are over (2000 runs of the reference: 99.8 %)."""
    first, row, end = navigate(code, 40, 0.15, 299, 5, separation=10, patience=5, most=3)
    print(f"isolated at {np.mean(first):.1f} s, end {np.nanmean(end):+.2f} epochs, within two {np.mean(np.abs(end) <= 2):.3f}")
    assert (first > 150).all() and (row == 0).all() and 190 < first.mean() < 215
    assert np.mean(np.abs(end) <= 2) >= 0.9 and np.mean(end < -2) <= 0.05
