# SPDX-License-Identifier: MIT
"""<meshkal/unscented.h> on nonlinear models, against the forms of textbooks (textbook.py): filters, rules, angles, negative weights."""
import numpy as np
import pytest
from scipy import optimize

import nonlinear
import textbook
from nonlinear import bearing_from, covariance, distance_to, quadratic, reading, sensors, waves
from textbook import LONG, NotPositive, Textbook, Weights, distance
from unscented import (EXTENDED, INNOVATION, ITERATED, LITERAL, MAHALANOBIS, NO_RULE, OK, PROGRESSIVE, UNSCENTED, Filter, Model, status, transform)

pytestmark = pytest.mark.once
RULE = {NO_RULE: None, INNOVATION: "innovation", MAHALANOBIS: "mahalanobis"}


WEIGHTS = {"cubature": lambda n: {}, "two": lambda n: dict(kappa=2), "scaled": lambda n: dict(alpha=0.5, beta=2.0, kappa=0.0),
           "scaled-small": lambda n: dict(alpha=0.1, beta=2.0, kappa=1.0)}
KINDS = {**{f"ukf-{name}": (UNSCENTED, 1, NO_RULE, w) for name, w in WEIGHTS.items()}, "ekf": (EXTENDED, 1, NO_RULE, WEIGHTS["cubature"]),
         **{f"pukf-{N}": (PROGRESSIVE, N, NO_RULE, WEIGHTS["two"]) for N in (1, 5, 30)},
         **{f"mpukf-{RULE[rule]}-{N}": (PROGRESSIVE, N, rule, WEIGHTS["cubature"]) for rule in (INNOVATION, MAHALANOBIS) for N in (5, 30)},
         "iukf-literal": (LITERAL, 5, NO_RULE, WEIGHTS["cubature"])}


def pair(code, rng, n, kind, models=None, motion=None, P0=None, **options):
    """The library's filter and the textbook's, started, and a truth."""
    update, N, rule, weights = KINDS[kind]
    motion = motion or waves(rng, n, 0.3)
    models = models or sensors(rng, n)
    Q = covariance(rng, n, 1e-3, 0.1, rank=int(rng.integers(1, n + 1)))
    x, P = rng.normal(size=n) * 3, covariance(rng, n, 0.1, 2) if P0 is None else P0
    f = Filter(code, n, motion, Q, models, x, P, kind=update, increments=N, rule=rule, transform=transform(n, **weights(n)), **options)
    assert f.start() == OK
    real = f.types.numpy
    models = [(model, R.astype(real)) for model, R in models]
    book = Textbook(n, motion, Q.astype(real), models, x.astype(real), P.astype(real), Weights(n, **weights(n)), update == EXTENDED)
    truth = x + np.linalg.cholesky(P) @ rng.normal(size=n)
    return f, book, truth, motion, Q, models


@pytest.mark.parametrize("kind", KINDS)
def test_random_models(code, kind):
    """n = 1 .. 8, one to four sensors, arrivals by chance; each step from the library's own state, all decisions of the rules included."""
    update, N, rule, _ = KINDS[kind]
    stops, most = 0, 0.0
    for n in range(1, 9):
        rng = np.random.default_rng([n, 7])
        # The Mahalanobis form hardly ever stops where the models are nearly linear.
        models = sensors(rng, n, strength=2.0) if rule == MAHALANOBIS else None
        f, book, truth, motion, Q, models = pair(code, rng, n, kind, models)
        for _ in range(25 if N > 5 else 50):
            dt = float(rng.uniform(0.1, 1))
            book.x, book.P = f.exact()
            assert f.predict(dt) == OK
            book.predict(dt)
            most = max(most, *distance(f.x, f.P, book))
            assert most < 1e-9
            truth = motion.function(truth[None], dt)[0] + rng.multivariate_normal(np.zeros(n), Q, method="eigh")
            z = {s: reading(rng, *models[s], truth, 0.1) for s in range(len(models)) if rng.random() < 0.6}
            for s in rng.permutation(list(z)).tolist():
                assert f.put(s, z[s]) == OK
            fired, at = f.core.rule_fired, len(z)
            book.x, book.P = f.exact()
            assert f.update() == OK
            done = book.update(z, N, update == LITERAL, RULE[rule])
            if not at:
                continue
            assert (f.core.increments, f.core.stopped, f.core.rule_fired - fired) == (done, done < N, done < N), n
            stops += done < N
            most = max(most, *distance(f.x, f.P, book))
            assert most < 1e-9, n
            assert f.core.measurements == at and f.core.nis_rows == sum(models[s][0].rows for s in z)
    assert not rule or stops > 5, "this rule was not tried"


@pytest.mark.parametrize("kind", ("ukf-cubature", "ekf", "pukf-5", "mpukf-mahalanobis-5"))
def test_float32(code, kind):
    """The same in the other precision: rounding grows with the condition of P and of R."""
    update, N, rule, _ = KINDS[kind]
    for n in range(1, 7):
        rng = np.random.default_rng([n, 8])
        f, book, truth, motion, Q, models = pair(code, rng, n, kind, bits=32)
        for _ in range(30):
            book.x, book.P = f.exact()
            assert f.predict(0.5) == OK
            book.predict(0.5)
            assert max(distance(f.x, f.P, book)) < 1e-4
            truth = motion.function(truth[None], 0.5)[0] + rng.multivariate_normal(np.zeros(n), Q, method="eigh")
            z = {s: reading(rng, *models[s], truth).astype(np.float32) for s in range(len(models)) if rng.random() < 0.6}
            for s in z:
                assert f.put(s, z[s]) == OK
            book.x, book.P = f.exact()
            assert f.update() == OK
            done = book.update(z, N, False, RULE[rule])
            # A step whose statistics are nearly equal may be stopped by rounding.
            if not z or done != f.core.increments:
                continue
            assert max(distance(f.x, f.P, book)) < 3e-3


def test_in_one_go(code):
    """Without coming back to the library's state: the two run on for 60 steps."""
    for kind in KINDS:
        rng = np.random.default_rng(5)
        f, book, truth, motion, Q, models = pair(code, rng, 4, kind, sensors(rng, 4, 3))
        for _ in range(60):
            assert f.predict(0.3) == OK
            book.predict(0.3)
            truth = motion.function(truth[None], 0.3)[0] + rng.multivariate_normal(np.zeros(4), Q, method="eigh")
            z = {s: reading(rng, *models[s], truth) for s in range(3)}
            for s in z:
                assert f.put(s, z[s]) == OK
            assert f.update() == OK
            book.update(z, KINDS[kind][1], kind == "iukf-literal", RULE[KINDS[kind][2]])
            assert max(distance(f.x, f.P, book)) < 1e-7, kind


# --- iterated filter -------------------------------------------------------------------------------------------------------

def cost_of(book, z):
    slots = sorted(z)
    R, x0, P0 = book.noise(slots), book.x, book.P

    def cost(x):
        x = np.asarray(x, LONG)
        zh = np.concatenate([np.asarray(book.sensors[s][0].function(x[None], 0.0), LONG)[0] for s in slots])
        e = book.error(slots, z, zh)
        return float(e @ textbook.solve(R, e) + (x - x0) @ textbook.solve(P0, x - x0))
    return cost


def test_iterated_cost(code):
    """It never rises, and falls further with more steps."""
    falls = 0
    for seed in range(60):
        rng = np.random.default_rng([seed, 1])
        n = int(rng.integers(1, 7))
        models, x, P = sensors(rng, n), rng.normal(size=n) * 3, covariance(rng, n, 0.1, 5)
        truth = x + np.linalg.cholesky(P) @ rng.normal(size=n) * 2
        z = {s: reading(rng, *models[s], truth) for s in range(len(models))}
        costs = []
        for N in (1, 2, 4, 8):
            f = Filter(code, n, np.eye(n), np.eye(n), models, x, P, kind=ITERATED, increments=N)
            assert f.start() == OK
            book = Textbook(n, np.eye(n), np.eye(n), models, x, P)
            cost = cost_of(book, z)
            for s in z:
                assert f.put(s, z[s]) == OK
            assert f.update() == OK
            assert f.core.increments <= N
            costs.append(cost(f.x))
            assert costs[-1] <= cost(x) * (1 + 1e-12)
            assert np.linalg.eigvalsh(f.P)[0] > 0
        assert all(b <= a * (1 + 1e-12) for a, b in zip(costs, costs[1:])), costs
        falls += costs[-1] < costs[0] * 0.999
    assert falls > 10


def test_iterated_against_textbook(code):
    """As long as full steps let the cost fall, they are those of the iterated posterior linearisation."""
    compared = 0
    for seed in range(60):
        rng = np.random.default_rng([seed, 2])
        n = int(rng.integers(1, 7))
        models, x, P = sensors(rng, n), rng.normal(size=n) * 3, covariance(rng, n, 0.1, 2)
        truth = x + np.linalg.cholesky(P) @ rng.normal(size=n)
        z = {s: reading(rng, *models[s], truth) for s in range(len(models))}
        book = Textbook(n, np.eye(n), np.eye(n), models, x, P)
        steps = list(book.iterate(z, 4))
        for N in range(1, 5):
            if not steps[N][2] < steps[N - 1][2] * (1 - 1e-6):
                break
            f = Filter(code, n, np.eye(n), np.eye(n), models, x, P, kind=ITERATED, increments=N)
            assert f.start() == OK
            for s in z:
                assert f.put(s, z[s]) == OK
            assert f.update() == OK and f.core.increments == N
            book.x, book.P = steps[N][:2]
            assert max(distance(f.x, f.P, book)) < 1e-8
            compared += 1
    assert compared > 60


def test_iterated_is_map(code):
    """Sharp readings: the posterior's spread s goes to nothing, and with it what statistical linearisation adds, of order s^2 and of s in units
    of s. Against the minimum of the cost that SciPy finds from there."""
    apart = {}
    for size in (1e-2, 1e-3, 1e-4):
        apart[size] = []
        for seed in range(20):
            rng = np.random.default_rng([seed, 3])
            n = int(rng.integers(1, 6))
            models = [(quadratic(rng, n, rows, 0.3), covariance(rng, rows, 0.5, 2) * size**2) for rows in (n, 2)]
            x, P = rng.normal(size=n), covariance(rng, n, 0.05, 0.2)
            truth = x + np.linalg.cholesky(P) @ rng.normal(size=n)
            z = {s: reading(rng, *models[s], truth) for s in range(2)}
            f = Filter(code, n, np.eye(n), np.eye(n), models, x, P, kind=ITERATED, increments=50)
            assert f.start() == OK
            for s in z:
                assert f.put(s, z[s]) == OK
            assert f.update() == OK and f.core.increments < 50
            roots = [np.linalg.inv(np.linalg.cholesky(S)) for S in (*(R for _, R in models), P)]

            def whitened(trial):
                return np.concatenate([roots[s] @ (models[s][0].function(trial[None], 0)[0] - z[s]) for s in z] + [roots[2] @ (trial - x)])
            best = optimize.least_squares(whitened, f.x, xtol=1e-15, ftol=1e-15, gtol=1e-15)
            apart[size].append(float(np.max(np.abs(best.x - f.x) / np.sqrt(np.diag(f.P)))))
    middle = {size: np.median(values) for size, values in apart.items()}
    assert max(apart[1e-4]) < 1e-3
    assert middle[1e-3] < 0.3 * middle[1e-2] and middle[1e-4] < 0.3 * middle[1e-3]


# --- weights below zero ----------------------------------------------------------------------------------------------------

def extremes(S):
    """Smallest eigenvalue over the largest."""
    values = np.linalg.eigvalsh(np.asarray(S, float))
    return values[0] / abs(values[-1])


@pytest.mark.parametrize("n", range(4, 11))
def test_negative_centre_weight(code, n):
    """kappa = 3 - n: refused exactly where the textbook's covariance is not positive definite, equal elsewhere."""
    weights, seen = dict(kappa=3 - n), {"predict": [0, 0], "update": [0, 0]}
    for seed in range(60):
        rng = np.random.default_rng([seed, n])
        strength = float(np.exp(rng.uniform(np.log(0.02), np.log(10))))
        motion, models = quadratic(rng, n, n, strength), [(quadratic(rng, n, 2, strength), covariance(rng, 2, 0.1, 1)) for _ in range(2)]
        Q, x, P = covariance(rng, n, 0.01, 1) * (seed % 2), rng.normal(size=n) * (seed % 3 > 0), covariance(rng, n, 0.1, 2)
        f = Filter(code, n, motion, Q, models, x, P, transform=transform(n, **weights))
        assert f.start() == OK
        book = Textbook(n, motion, Q, models, x, P, Weights(n, **weights))
        z = {s: models[s][0].function(x[None], 0.0)[0] + rng.normal(size=2) for s in range(2)}
        _, spread, Pxz = book.moments([0, 1])
        S = spread + book.noise([0, 1])
        joint = np.block([[book.P, Pxz], [Pxz.T, S]])
        for s in z:
            assert f.put(s, z[s]) == OK
        before = f.state()
        found = f.update()
        if abs(extremes(joint)) > 1e-9:
            seen["update"][int(extremes(joint) > 0)] += 1
            if extremes(joint) > 0:
                assert found == OK
                book.update(z)
                assert max(distance(f.x, f.P, book)) < 1e-8
            else:
                # Whether P - K S K' or S itself: either way the joint covariance is not.
                assert found == status("NOT_POSITIVE_DEFINITE") and f.state() == before
                with pytest.raises(NotPositive):
                    book.update(z)
        f = Filter(code, n, motion, Q, models, x, P, transform=transform(n, **weights))
        assert f.start() == OK
        before, book = f.state(), Textbook(n, motion, Q, models, x, P, Weights(n, **weights))
        found, predicted = f.predict(), textbook.transformed(book.weights, book.x, book.P, [motion])[1] + book.Q
        if abs(extremes(predicted)) > 1e-9:
            seen["predict"][int(extremes(predicted) > 0)] += 1
            if extremes(predicted) > 0:
                assert found == OK, (seed, extremes(predicted))
                book.predict()
                assert max(distance(f.x, f.P, book)) < 1e-8
            else:
                assert found == status("NOT_POSITIVE_DEFINITE") and f.state() == before
    assert min(*seen["predict"], *seen["update"]) >= 3, seen


@pytest.mark.parametrize("bits", (32, 64))
def test_cubature_never_fails(code, bits):
    """kappa >= 0: the covariances are sums of squares, however strong the curvature."""
    for seed in range(40):
        rng = np.random.default_rng([seed, 4])
        n = int(rng.integers(1, 11))
        strength = float(np.exp(rng.uniform(np.log(0.1), np.log(300))))
        motion, models = quadratic(rng, n, n, strength), [(quadratic(rng, n, 2, strength), covariance(rng, 2, 0.1, 1))]
        f = Filter(code, n, motion, np.zeros((n, n)) if seed % 2 else covariance(rng, n, 0.1, 1), models, rng.normal(size=n), covariance(rng, n, 0.1, 2),
                   bits=bits, transform=transform(n, kappa=float(rng.choice([0, 0.5, 3]))))
        assert f.start() == OK
        assert f.put(0, models[0][0].function(rng.normal(size=(1, n)), 0)[0]) == OK
        assert f.update() == OK
        assert f.predict() == OK


# --- angles ----------------------------------------------------------------------------------------------------------------

@pytest.mark.parametrize("mean", (False, True), ids=("difference", "mean"))
@pytest.mark.parametrize("kind", ("ukf-two", "pukf-5", "mpukf-mahalanobis-5", "ekf"))
def test_angles(code, kind, mean):
    """A walker whose heading and whose bearings turn through +-pi many times, to within rounding of the textbook with circular residuals."""
    update, N, rule, weights = KINDS[kind]
    for seed in range(2):
        rng = np.random.default_rng([seed, 6])
        motion = nonlinear.walker(mean)
        models = [(bearing_from((9.0, 1.0), (0, 1), mean), np.array([[1e-3]])), (bearing_from((11.0, -2.0), (0, 1), mean), np.array([[4e-3]])),
                  (distance_to((0.0, 5.0), (0, 1)), np.array([[0.01]]))]
        Q, x = np.diag([1e-3, 1e-3, 1e-3, 1e-3, 1e-4]), np.array([1.0, 0.0, 3.1, 1.0, 0.5])
        P = np.diag([0.5, 0.5, 0.3, 0.1, 0.02])
        f = Filter(code, 5, motion, Q, models, x, P, kind=update, increments=N, rule=rule, transform=transform(5, **weights(5)))
        assert f.start() == OK
        book = Textbook(5, motion, Q, models, x, P, Weights(5, **weights(5)), update == EXTENDED)
        truth, crossings, worst = x.copy(), 0, 0.0
        for _ in range(120):
            book.x, book.P = f.exact()
            assert f.predict(0.2) == OK
            book.predict(0.2)

            def compare():
                sigma = np.sqrt(np.diag(book.P))
                d = f.x - book.x
                d[2] = nonlinear.wrap(d[2])
                found = max(np.max(np.abs(d) / sigma), distance(f.x, f.P, book)[1])
                return float(found)
            worst = max(worst, compare())
            crossings += abs(f.x[2]) > 2.6
            truth = motion.function(truth[None], 0.2)[0] + rng.multivariate_normal(np.zeros(5), Q)
            z = {s: reading(rng, *models[s], truth) for s in range(3) if rng.random() < 0.7}
            crossings += sum(abs(z[s][0]) > 3 for s in z if s < 2)
            for s in z:
                assert f.put(s, z[s]) == OK
            book.x, book.P = f.exact()
            assert f.update() == OK
            book.update(z, N, False, RULE[rule])
            worst = max(worst, compare())
        assert crossings > 20
        assert worst < 1e-9, worst
        assert np.hypot(*(f.x - truth)[:2]) < 3 and abs(nonlinear.wrap(f.x[2] - truth[2])) < 1
