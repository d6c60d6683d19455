# SPDX-License-Identifier: MIT
"""Every filter of <meshkal/unscented.h> on linear models, against the Kalman filter in the longest float type."""
import numpy as np
import pytest

from nonlinear import covariance, linear
from textbook import LONG, Textbook, Weights, blocks, distance, solve
from unscented import (EXTENDED, INNOVATION, ITERATED, LITERAL, MAHALANOBIS, NO_RULE, OK, PROGRESSIVE, UNSCENTED, Filter, transform)

STEPS = 200
pytestmark = pytest.mark.once


class Kalman:
    def __init__(self, A, Q, H, R, x, P):
        self.A, self.Q, self.H, self.R = (LONG(A), LONG(Q), [LONG(h) for h in H], [LONG(r) for r in R])
        self.x, self.P = LONG(x), LONG(P)

    def predict(self):
        self.x, self.P = self.A @ self.x, self.A @ self.P @ self.A.T + self.Q

    def update(self, z, divide=1):
        if not z:
            return
        slots = sorted(z)
        H, R = np.concatenate([self.H[s] for s in slots]), blocks([self.R[s] for s in slots]) / divide
        S = H @ self.P @ H.T + R
        K = solve(S, H @ self.P).T
        self.x, self.P = self.x + K @ (np.concatenate([LONG(z[s]) for s in slots]) - H @ self.x), self.P - K @ S @ K.T


def draw(seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 9))
    rows = [int(r) for r in rng.integers(1, 4, rng.integers(1, 4))]
    A = np.linalg.qr(rng.normal(size=(n, n)))[0] * np.exp(rng.uniform(-0.3, 0.02, n))
    Q = covariance(rng, n, 0.01, 1, rank=int(rng.integers(0, n + 1)))
    return (rng, n, A, Q, [rng.normal(size=(r, n)) for r in rows], [covariance(rng, r, 0.1, 3) for r in rows], rng.normal(size=n), covariance(rng, n))


KAPPA = {"gaussian": lambda n: 3 - n, "cubature": lambda n: 0, "two": lambda n: 2}
KINDS = {**{f"ukf-{name}": (UNSCENTED, 1, NO_RULE, lambda n, k=k: dict(kappa=k(n))) for name, k in KAPPA.items()},
         "ukf-scaled-1": (UNSCENTED, 1, NO_RULE, lambda n: dict(alpha=1.0, beta=2.0, kappa=0.0)),
         "ukf-scaled-1e-3": (UNSCENTED, 1, NO_RULE, lambda n: dict(alpha=1e-3, beta=2.0, kappa=0.0)),
         "ekf": (EXTENDED, 1, NO_RULE, lambda n: {}),
         **{f"pukf-{N}": (PROGRESSIVE, N, NO_RULE, lambda n: dict(kappa=3 - n)) for N in (1, 5, 30)},
         **{f"mpukf-{rule}-{N}": (PROGRESSIVE, N, rule, lambda n: {}) for rule in (INNOVATION, MAHALANOBIS) for N in (5, 30)},
         "iukf": (ITERATED, 4, NO_RULE, lambda n: {}), "iukf-gaussian": (ITERATED, 3, NO_RULE, lambda n: dict(kappa=3 - n)),
         "iukf-literal": (LITERAL, 5, NO_RULE, lambda n: {})}


@pytest.mark.parametrize("matrix", (False, True), ids=("function", "matrix"))
@pytest.mark.parametrize("kind", KINDS)
def test_kalman(code, kind, matrix):
    update, N, rule, weights = KINDS[kind]
    fired = 0
    for seed in range(5):
        rng, n, A, Q, H, R, x, P = draw(seed)
        kalman = Kalman(A, Q, H, R, x, P)
        f = Filter(code, n, A if matrix else linear(A), Q, list(zip(map(linear, H), R)), x, P, kind=update, increments=N, rule=rule,
                   transform=transform(n, **weights(n)))
        assert f.start() == OK
        # mu is w = 1 / 2 spread times the sum of n second differences, each with the rounding of results that are tens of standard deviations
        # large: no form of the transform can be nearer.
        limit = max(1e-12, 50 * n * 2.2e-16 / f.config.transform.spread)
        truth = x + np.linalg.cholesky(P) @ rng.normal(size=n)
        for _ in range(STEPS):
            assert f.predict() == OK
            kalman.predict()
            truth = A @ truth + rng.multivariate_normal(np.zeros(n), Q, method="eigh")
            z = {s: H[s] @ truth + np.linalg.cholesky(R[s]) @ rng.normal(size=len(H[s])) for s in range(len(H)) if rng.random() < 0.7}
            for s in z:
                assert f.put(s, z[s]) == OK
            assert f.update() == OK
            assert f.core.measurements == len(z)
            if rule and f.core.stopped and z:
                # What the rule leaves out inflates R by N / n.
                fired += 1
                kalman.update(z, f.core.increments / N)
            else:
                assert not z or update == ITERATED or f.core.increments == N
                kalman.update(z, N if update == LITERAL else 1)
            assert max(distance(f.x, f.P, kalman)) < limit
    assert fired == 0 or rule


def test_textbook_is_kalman():
    """The other references' own check."""
    for seed in range(10):
        rng, n, A, Q, H, R, x, P = draw(seed)
        kalman = Kalman(A, Q, H, R, x, P)
        models = list(zip(map(linear, H), R))
        books = [Textbook(n, linear(A), Q, models, x, P, Weights(n, **w)) for w in ({}, dict(kappa=3 - n), dict(alpha=0.1, beta=2.0, kappa=1.0))]
        books.append(Textbook(n, linear(A), Q, models, x, P, extended=True))
        informed = Textbook(n, A, Q, models, x, P)
        for _ in range(30):
            z = {s: rng.normal(size=len(H[s])) for s in range(len(H)) if rng.random() < 0.7}
            kalman.predict()
            kalman.update(z)
            for book in books:
                book.predict()
                steps = list(book.iterate(z, 3)) if z else [(book.x, book.P, 0)]
                book.update(z)
                assert max(distance(book.x, book.P, kalman)) < 1e-14
                assert max(distance(*steps[-1][:2], kalman)) < 1e-13
            informed.predict()
            if z:
                informed.inform(1, *informed.information(z))
            assert max(distance(informed.x, informed.P, kalman)) < 1e-14
