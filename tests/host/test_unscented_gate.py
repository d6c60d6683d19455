# SPDX-License-Identifier: MIT
"""Gates of <meshkal/unscented.h> and <meshkal/gate.h>: decisions against squared distances and SciPy's quantiles, what is left of the readings,
the way back."""
import ctypes

import numpy as np
import pytest
from scipy import stats

from nonlinear import bearing_from, covariance, distance_to, linear, quadratic, waves
from textbook import LONG, Textbook, blocks, distance, solve
from unscented import EXTENDED, INFLATE, INNOVATION, ITERATED, MAHALANOBIS, NO_RULE, OK, PROGRESSIVE, SKIP, TYPES, UNSCENTED, Filter, status


def thresholds(tail, count):
    return stats.chi2.isf(tail, np.arange(1, count + 1))


@pytest.mark.parametrize("bits", (32, 64))
def test_thresholds(code, bits):
    t = TYPES[bits]
    call = getattr(code, f"mk_gate_thresholds_f{bits}")
    for tail in (1e-10, 1e-3, 0.05, 0.5, 1 - 1e-6):
        out = np.zeros(12, t.numpy)
        assert call(ctypes.c_double(tail), 12, ctypes.c_void_p(out.ctypes.data)) == OK
        assert np.allclose(out, thresholds(tail, 12), rtol=1e-6 if bits == 64 else 2e-6, atol=0)
    for tail in (0.0, 1.0, -0.1, 2.0, np.nan, np.inf):
        out = np.full(3, 7, t.numpy)
        assert call(ctypes.c_double(tail), 3, ctypes.c_void_p(out.ctypes.data)) == status("ARGUMENT") and (out == 7).all()
    assert call(ctypes.c_double(0.1), 3, None) == status("ARGUMENT")


@pytest.mark.parametrize("bits", (32, 64))
def test_judge(code, bits):
    """policy, threshold, d2 -> factor, ratio, and which counter moves."""
    t = TYPES[bits]
    judge = getattr(code, f"mk_gate_judge_f{bits}")
    judge.restype = t.real
    largest = float(np.finfo(t.numpy).max)
    nan, inf = float("nan"), float("inf")
    for policy, threshold, d2, factor, ratio, kept in (
            (SKIP, 4, 3, 1, 0.75, 3), (SKIP, 4, 4, 1, 1, 4), (SKIP, 4, 6, 0, 1.5, 6), (INFLATE, 4, 6, 1.5, 1.5, 6), (INFLATE, 4, 4, 1, 1, 4),
            (SKIP, 0, 6, 1, 0, 6), (INFLATE, 0, 6, 1, 0, 6), (SKIP, 0, nan, 1, 0, largest), (SKIP, 4, nan, 0, None, largest),
            (INFLATE, 4, nan, None, None, largest), (SKIP, 4, inf, 0, None, largest), (INFLATE, 0.25, largest, largest, largest, largest),
            (INFLATE, 0.25, nan, largest, largest, largest)):
        record = t.record(d2=9, ratio=9, accepted=10, rejected=20, inflated=30, since_accepted=40)
        found = judge(policy, t.real(threshold), t.real(d2), ctypes.byref(record))
        if factor is None:
            assert found > 1 and np.isfinite(found)
            factor = found
        else:
            assert found == factor, (policy, threshold, d2, found)
        assert np.isfinite(record.ratio) and record.d2 == kept
        assert record.ratio == ratio if ratio is not None else record.ratio > 1
        which = "accepted" if factor == 1 else "rejected" if factor == 0 else "inflated"
        moved = dict(accepted=10, rejected=20, inflated=30)
        moved[which] += 1
        assert {k: getattr(record, k) for k in moved} == moved
        assert record.since_accepted == (0 if which == "accepted" else 41)


# --- decisions -------------------------------------------------------------------------------------------------------------

METHODS = {"ukf": (UNSCENTED, 1, NO_RULE), "ekf": (EXTENDED, 1, NO_RULE), "pukf": (PROGRESSIVE, 4, NO_RULE), "mpukf": (PROGRESSIVE, 4, INNOVATION),
           "mpukf-mahalanobis": (PROGRESSIVE, 4, MAHALANOBIS), "iukf": (ITERATED, 3, NO_RULE)}


def bench(rng):
    n = int(rng.integers(2, 6))
    models = [(distance_to(rng.normal(size=2) * 20, (0, 1)), np.array([[0.04]])), (bearing_from(rng.normal(size=2) * 20, (0, 1)), np.array([[1e-3]])),
              (quadratic(rng, n, 2, 0.1), covariance(rng, 2, 0.1, 1)), (quadratic(rng, n, 3, 0.1), covariance(rng, 3, 0.1, 1))]
    return n, waves(rng, n, 0.3), covariance(rng, n, 0.01, 0.1), models, rng.normal(size=n), covariance(rng, n, 0.1, 1)


def judged(book, slots, z, R=None):
    zh, spread, _ = book.moments(slots)
    e = book.error(slots, z, zh)
    return float(e @ solve(spread + (book.noise(slots) if R is None else R), e))


def inflated(book, slots, R, f):
    """Chang 2014: R := (f - 1) (E - R) + f R."""
    return (f - 1) * book.moments(slots)[1] + f * R


@pytest.mark.once
@pytest.mark.parametrize("policy", (SKIP, INFLATE), ids=("skip", "inflate"))
@pytest.mark.parametrize("which", ("sensor", "stacked", "both"))
@pytest.mark.parametrize("method", METHODS)
def test_decisions(code, method, which, policy):
    """Each decision, counter and record, and the update that follows, which is that of an ungated filter with what is left (bit for bit where
    readings are skipped) and the textbook's with Chang's R."""
    update, N, rule = METHODS[method]
    beyond = together = 0
    for seed in range(3):
        rng = np.random.default_rng([seed, 11])
        n, motion, Q, models, x, P = bench(rng)
        gate = {"policy": policy}
        sensor, stacked = thresholds(0.05, 3), thresholds(0.02 if which == "stacked" else 0.3, 12)
        if which != "stacked":
            gate["sensor"] = sensor
        if which != "sensor":
            gate["stacked"] = stacked
        options = dict(kind=update, increments=N, rule=rule, m=3)
        f = Filter(code, n, motion, Q, models, x, P, gate=gate, **options)
        plain = Filter(code, n, motion, Q, models, x, P, **options)
        assert f.start() == plain.start() == OK
        book = Textbook(n, motion, Q, models, x, P, extended=update == EXTENDED)
        count = {s: dict(accepted=0, rejected=0, inflated=0, since_accepted=0) for s in (0, 1, 2, 3, "all")}

        def note(who, ratio):
            """What the counters say of this test ratio: of a sensor the product of its own and that of all together, where these are beyond 1."""
            c = count[who]
            c["accepted" if ratio <= 1 else "rejected" if policy == SKIP else "inflated"] += 1
            c["since_accepted"] = 0 if ratio <= 1 else c["since_accepted"] + 1

        truth = x + np.linalg.cholesky(P) @ rng.normal(size=n)
        for _ in range(40):
            assert f.predict(0.3) == OK
            truth = motion.function(truth[None], 0.3)[0]
            z = {}
            for s, (model, R) in enumerate(models):
                if rng.random() < 0.7:
                    scale = 8 if rng.random() < 0.25 else 1
                    z[s] = model.function(truth[None], 0)[0] + scale * np.linalg.cholesky(R) @ rng.normal(size=model.rows)
            for s in z:
                assert f.put(s, z[s]) == OK
            book.x, book.P = f.exact()
            before = (f.x.tobytes(), f.L.tobytes())
            plain.x[:], plain.L[:] = f.x, f.L
            noise, kept, ratios, beyond_now = {s: np.asarray(models[s][1], LONG) for s in z}, sorted(z), {}, dict.fromkeys(z, 1)
            if which != "stacked":
                for s in sorted(z):
                    rows = models[s][0].rows
                    d2 = judged(book, [s], z)
                    ratios[s] = d2, d2 / sensor[rows - 1]
                    beyond_now[s] = max(1, ratios[s][1])
                    factor = beyond_now[s] if beyond_now[s] > 1 else None
                    beyond += factor is not None
                    if factor and policy == SKIP:
                        kept.remove(s)
                    elif factor:
                        noise[s] = inflated(book, [s], noise[s], factor)
            R, rows = None, sum(models[s][0].rows for s in kept)
            if kept:
                R = blocks([noise[s] for s in kept])
            whole = None
            if which != "sensor" and kept:
                d2 = judged(book, kept, z, R)
                whole = d2, d2 / stacked[rows - 1]
                note("all", whole[1])
                factor = whole[1] if whole[1] > 1 else None
                together += factor is not None
                for s in kept:
                    beyond_now[s] *= max(1, whole[1])
                if factor and policy == SKIP:
                    kept = []
                elif factor:
                    R = inflated(book, kept, R, factor)
            assert f.update() == OK
            for s in z:
                note(s, beyond_now[s])
                record = f.record[s]
                if which != "stacked":
                    assert np.allclose((record.d2, record.ratio), ratios[s], rtol=1e-9, atol=1e-12)
                assert {k: getattr(record, k) for k in count[s]} == count[s]
            if whole:
                assert np.allclose((f.core.stacked.d2, f.core.stacked.ratio), whole, rtol=1e-9, atol=1e-12)
                assert {k: getattr(f.core.stacked, k) for k in count["all"]} == count["all"]
            assert f.core.measurements == len(kept) and f.core.nis_rows == sum(models[s][0].rows for s in kept)
            if not kept:
                assert (f.x.tobytes(), f.L.tobytes()) == before and f.core.increments == 0
                continue
            assert np.isclose(f.core.nis, judged(book, kept, {s: z[s] for s in kept}, R), rtol=1e-8)
            if policy == SKIP:
                for s in kept:
                    assert plain.put(s, z[s]) == OK
                assert plain.update() == OK
                assert (f.x.tobytes(), f.L.tobytes()) == (plain.x.tobytes(), plain.L.tobytes())
            if update != ITERATED:
                # The Mahalanobis rule looks at the noise in use.
                if rule == MAHALANOBIS and policy == INFLATE:
                    book.noise = lambda slots: R
                book.update({s: z[s] for s in kept}, N, rule={NO_RULE: None, INNOVATION: "innovation", MAHALANOBIS: "mahalanobis"}[rule], R=R)
                if rule == MAHALANOBIS and policy == INFLATE:
                    del book.noise
                assert max(distance(f.x, f.P, book)) < 1e-8
        assert not any(f.have)
    assert which == "stacked" or beyond > 10
    assert which == "sensor" or together > 5


def test_inflated_ratio_is_one(code):
    """What was inflated sits on the threshold: judged with its new noise, its ratio is 1."""
    rng = np.random.default_rng(3)
    n, motion, Q, models, x, P = bench(rng)
    bound = thresholds(0.01, 3)
    book = Textbook(n, motion, Q, models, x, P)
    for s in range(4):
        rows = models[s][0].rows
        f = Filter(code, n, motion, Q, models, x, P, gate=dict(sensor=bound, policy=INFLATE), m=3)
        assert f.start() == OK
        z = {s: models[s][0].function(x[None], 0)[0] + 9}
        if s == 1:
            z[s] = z[s] - 8
        assert f.put(s, z[s]) == OK and f.update() == OK
        d2, ratio = f.record[s].d2, f.record[s].ratio
        assert ratio > 1 and f.record[s].inflated == 1
        assert np.isclose(f.core.nis, bound[rows - 1], rtol=1e-9)
        assert np.isclose(judged(book, [s], z, inflated(book, [s], book.noise([s]), ratio)), bound[rows - 1], rtol=1e-9)
        assert np.isclose(d2, judged(book, [s], z), rtol=1e-9)


@pytest.mark.parametrize("bits", (32, 64))
def test_way_back(code, bits):
    """More than `patience` updates with most readings refused, less the others: P := P0, x stays, all readings are used."""
    H, P0 = np.eye(2), np.diag([4.0, 9.0])
    models, bound = [(linear(H[:1]), np.eye(1) * 0.01)] * 3, thresholds(0.01, 3)

    def make():
        f = Filter(code, 2, np.eye(2), np.eye(2) * 1e-6, models, np.zeros(2), P0, gate=dict(sensor=bound, patience=3), bits=bits)
        assert f.start() == OK
        for _ in range(5):
            assert [f.put(s, [0.0]) for s in range(3)] == [OK] * 3 and f.update() == OK
        return f

    def feed(f, *values):
        for s, value in enumerate(values):
            if value is not None:
                assert f.put(s, [value]) == OK
        assert f.update() == OK

    f = make()
    for k in range(3):
        feed(f, 50.0, 50.0, 0.0)
        assert f.core.gated_updates == k + 1 and f.core.measurements == 1
    feed(f)  # nothing arrives: neither good nor bad
    assert f.core.gated_updates == 3
    x = f.x.copy()
    feed(f, 50.0, 50.0, 50.5)
    assert f.core.reinitialised == 1 and f.core.gated_updates == 0 and f.core.measurements == 3
    book = Textbook(2, np.eye(2), np.eye(2), models, x, P0)
    R = f.types.numpy(0.01)
    book.sensors = [(m, np.eye(1) * R) for m, _ in models]
    book.update({0: [50.0], 1: [50.0], 2: [50.5]})
    assert max(distance(f.x, f.P, book)) < (1e-12 if bits == 64 else 1e-4)
    # Half is not most; a good update in between counts down: half of them bad never come back, two of three do; patience 0 never comes back.
    f = make()
    for _ in range(10):
        feed(f, 50.0, 0.0)
    assert f.core.gated_updates == 0 and f.core.reinitialised == 0
    for k in range(30):
        feed(f, *([0.0] * 3 if k % 2 else [50.0] * 3))
    assert f.core.reinitialised == 0 and f.core.gated_updates == 0
    for k, count in enumerate([1, 2, 1, 2, 3, 2, 3, 0]):
        assert f.core.reinitialised == 0
        feed(f, *([0.0] * 3 if k % 3 == 2 else [50.0] * 3))
        assert f.core.gated_updates == count
    assert f.core.reinitialised == 1
    f = make()
    f.gate.patience = 0
    for k in range(30):
        feed(f, 50.0)
    assert f.core.reinitialised == 0 and f.core.gated_updates == 30 and f.record[0].since_accepted == 30
    # A restart starts the count anew.
    f = make()
    feed(f, 50.0)
    assert f.core.gated_updates == 1
    assert f.restart(np.zeros(2), P0) == OK and f.core.gated_updates == 0


def test_contribution_is_gated(code):
    """What the gate refuses is not in the contribution; all refused: zero."""
    rng = np.random.default_rng(2)
    n, motion, Q, models, x, P = bench(rng)
    f = Filter(code, n, motion, Q, models, x, P, gate=dict(sensor=thresholds(0.01, 3)), m=3)
    plain = Filter(code, n, motion, Q, models, x, P, m=3)
    assert f.start() == plain.start() == OK
    h = [model.function(x[None], 0)[0] for model, _ in models]
    assert f.put(0, h[0] + 500) == f.put(2, h[2]) == plain.put(2, h[2]) == OK
    found, s, S = f.contribution()
    assert found == OK and f.record[0].rejected == 1 and f.record[2].accepted == 1 and f.core.measurements == 1
    assert all((a == b).all() for a, b in zip(plain.contribution()[1:], (s, S)))
    assert f.put(0, h[0] + 500) == OK
    found, s, S = f.contribution()
    assert found == OK and not s.any() and not S.any() and not any(f.have)
