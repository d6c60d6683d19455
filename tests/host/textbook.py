# SPDX-License-Identifier: MIT
"""The unscented family as textbooks write it (spec 2.2, 2.3, 4.1): explicit sigma points and weights, whole covariances, P - K S K'. In the
longest float type, so that the weights of the scaled transform, which cancel, cost no digits that count. Nothing of it is taken from the library."""
import numpy as np

LONG = np.longdouble


class NotPositive(Exception):
    pass


def root(S):
    """Lower triangular Cholesky factor."""
    S = np.asarray(S, LONG)
    L = np.zeros_like(S)
    for j in range(len(S)):
        pivot = S[j, j] - L[j, :j] @ L[j, :j]
        if not pivot > 0:
            raise NotPositive
        L[j, j] = np.sqrt(pivot)
        L[j + 1:, j] = (S[j + 1:, j] - L[j + 1:, :j] @ L[j, :j]) / L[j, j]
    return L


def solve(S, B):
    """S^-1 B for a positive definite S."""
    L, X = root(S), np.array(B, LONG)
    for i in range(len(L)):
        X[i] = (X[i] - L[i, :i] @ X[:i]) / L[i, i]
    for i in reversed(range(len(L))):
        X[i] = (X[i] - L[i + 1:, i] @ X[i + 1:]) / L[i, i]
    return X


def inverse(S):
    return solve(S, np.eye(len(S), dtype=LONG))


def blocks(matrices):
    size = sum(len(m) for m in matrices)
    whole, at = np.zeros((size, size), LONG), 0
    for m in matrices:
        whole[at:at + len(m), at:at + len(m)] = m
        at += len(m)
    return whole


def difference(model, a, b):
    return model.difference(a, b) if model.difference else a - b


class Weights:
    def __init__(self, n, alpha=1.0, beta=0.0, kappa=0.0):
        alpha, beta, kappa = LONG(alpha), LONG(beta), LONG(kappa)
        extra = alpha**2 * (n + kappa) - n  # "lambda"
        self.scale = np.sqrt(n + extra)
        self.mean = np.full(2 * n + 1, 1 / (2 * (n + extra)), LONG)
        self.covariance = self.mean.copy()
        self.mean[0] = extra / (n + extra)
        self.covariance[0] = self.mean[0] + 1 - alpha**2 + beta


def transformed(weights, x, P, models, dt=0.0):
    """Mean, covariance and cross covariance of all models' results, one below the other."""
    L = root(P) * weights.scale
    points = np.concatenate([[x], x + L.T, x - L.T])
    means, residuals = [], []
    for model in models:
        y = np.asarray(model.function(points, dt), LONG)
        if model.mean:
            mean = model.mean(weights.mean, y)
        elif model.difference:
            mean = y[0] + weights.mean @ np.array([difference(model, row, y[0]) for row in y])
        else:
            mean = weights.mean @ y
        means.append(mean)
        residuals.append(np.array([difference(model, row, mean) for row in y]))
    residuals = np.concatenate(residuals, 1)
    return (np.concatenate(means), (weights.covariance[:, None] * residuals).T @ residuals,
            (weights.covariance[:, None] * (points - x)).T @ residuals)


class Textbook:
    """motion: Model or matrix; sensors: pairs (Model, R). extended: first-order forms with Jacobians."""

    def __init__(self, n, motion, Q, sensors, x0, P0, weights=None, extended=False):
        self.n, self.motion, self.Q, self.sensors, self.extended = n, motion, np.asarray(Q, LONG), sensors, extended
        self.x, self.P, self.weights = np.asarray(x0, LONG), np.asarray(P0, LONG), weights or Weights(n)

    def predict(self, dt=1.0, Q=None):
        Q = self.Q if Q is None else np.asarray(Q, LONG)
        if not hasattr(self.motion, "function"):
            A = np.asarray(self.motion, LONG)
            x, P = A @ self.x, A @ self.P @ A.T + Q
        elif self.extended:
            J = np.asarray(self.motion.jacobian(self.x[None], dt), LONG)
            x, P = np.asarray(self.motion.function(self.x[None], dt), LONG)[0], J @ self.P @ J.T + Q
        else:
            x, P, _ = transformed(self.weights, self.x, self.P, [self.motion], dt)
            P = P + Q
        root(P)
        self.x, self.P = x, P

    def moments(self, slots, x=None, P=None):
        """zh, spread (Pzz without R), Pxz of these sensors."""
        x, P = (self.x if x is None else x), (self.P if P is None else P)
        models = [self.sensors[s][0] for s in slots]
        if self.extended:
            H = np.concatenate([np.asarray(model.jacobian(x[None], 0.0), LONG) for model in models])
            zh = np.concatenate([np.asarray(model.function(x[None], 0.0), LONG)[0] for model in models])
            return zh, H @ P @ H.T, P @ H.T
        return transformed(self.weights, x, P, models)

    def noise(self, slots):
        return blocks([np.asarray(self.sensors[s][1], LONG) for s in slots])

    def error(self, slots, z, zh):
        at, parts = 0, []
        for s in slots:
            model = self.sensors[s][0]
            parts.append(difference(model, np.asarray(z[s], LONG), zh[at:at + model.rows]))
            at += model.rows
        return np.concatenate(parts)

    def step(self, slots, z, R, previous=None, rule=None):
        """One update with noise R. Returns the rule's statistic, or None where it stops; then nothing has changed."""
        zh, spread, Pxz = self.moments(slots)
        e = self.error(slots, z, zh)
        statistic = e @ e if rule != "mahalanobis" else e @ solve(self.noise(slots) + spread, e)
        if rule and previous is not None and statistic > previous:
            return None
        S = spread + R
        K = solve(S, Pxz.T).T
        P = self.P - K @ S @ K.T
        root(P)
        self.x, self.P = self.x + K @ e, P
        return statistic

    def update(self, z, increments=1, literal=False, rule=None, R=None):
        """z: {slot: reading}. Returns the number of increments done."""
        slots = sorted(z)
        if not slots:
            return 0
        R = self.noise(slots) if R is None else R
        before, previous = (self.x, self.P), None
        try:
            for i in range(increments):
                previous = self.step(slots, z, R * (1 if literal else increments), previous, rule)
                if previous is None:
                    return i
        except NotPositive:
            self.x, self.P = before
            raise
        return increments

    def iterate(self, z, steps):
        """Gauss-Newton on the posterior, linearised statistically over the present one; no damping. Yields x, P and cost after each step."""
        slots = sorted(z)
        R, x0, P0, x, P = self.noise(slots), self.x, self.P, self.x, self.P

        def cost(x):
            zh = np.concatenate([np.asarray(self.sensors[s][0].function(x[None], 0.0), LONG)[0] for s in slots])
            e = self.error(slots, z, zh)
            return e @ solve(R, e) + (x - x0) @ solve(P0, x - x0)
        yield x, P, cost(x)
        for _ in range(steps):
            zh, spread, Pxz = self.moments(slots, x, P)
            H = solve(P, Pxz).T
            S = H @ P0 @ H.T + spread - H @ P @ H.T + R
            K = solve(S, H @ P0).T
            x, P = x0 + K @ (self.error(slots, z, zh) - H @ (x0 - x)), P0 - K @ S @ K.T
            yield x, P, cost(x)

    def information(self, z, without_residual=False):
        """s and S of spec 4.1."""
        slots = sorted(z)
        zh, spread, Pxz = self.moments(slots)
        H = solve(self.P, Pxz).T
        R = self.noise(slots)
        if not without_residual:
            R = R + spread - H @ self.P @ H.T
        return H.T @ solve(R, self.error(slots, z, zh) + H @ self.x), H.T @ solve(R, H)

    def inform(self, scale, s, S):
        Y = inverse(self.P)
        P = inverse(Y + scale * np.asarray(S, LONG))
        self.x, self.P = P @ (Y @ self.x + scale * np.asarray(s, LONG)), P


def distance(x, P, reference):
    """Largest difference from a Textbook in units of its standard deviations, and of its covariance likewise."""
    sigma = np.sqrt(np.diag(reference.P))
    return float(np.max(np.abs(x - reference.x) / sigma)), float(np.max(np.abs(P - reference.P) / np.outer(sigma, sigma)))
