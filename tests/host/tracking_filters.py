# SPDX-License-Identifier: MIT
"""The tracking filters in NumPy, from the formulas of the specification alone: covariances, sigma points, information matrices."""
import math

import numpy as np
import scipy.optimize
import scipy.stats


def wrap(angle):
    return math.remainder(angle, 2 * math.pi)


class Model:
    """Motion and sensors of a scenario, x -> x and x -> z, with the rows that are angles."""

    def __init__(self, scenario, linear=None):
        model = scenario["model"]
        self.names, self.kind = model["states"], model["motion"]
        self.n = len(self.names)
        self.psd, self.turn_psd = model.get("acceleration_psd"), model.get("turn_rate_psd", 0.0)
        self.x0, self.P0 = np.array(model["x0"], float), np.array(model["P0"], float)
        self.p = [self.names.index("p" + axis) for axis in "xy"]
        self.v = [self.names.index("v" + axis) for axis in "xy"]
        self.nodes, self.linear = scenario["nodes"], linear or {}
        self.R = [np.atleast_2d(np.array(node.get("R", [[1.0]]), float)) for node in self.nodes]
        self.angles = [{"bearing": [0], "range-bearing": [1]}.get(node["sensor"], []) for node in self.nodes]

    def move(self, x, dt):
        y = x.copy()
        if self.kind == "constant-velocity":
            y[self.p] += dt * x[self.v]
            return y
        w = x[self.names.index("omega")]
        s, c = math.sin(w * dt), math.cos(w * dt)
        vx, vy = x[self.v]
        y[self.v] = [c * vx - s * vy, s * vx + c * vy]
        y[self.p] += [s / w * vx - (1 - c) / w * vy, (1 - c) / w * vx + s / w * vy]
        return y

    def noise(self, dt):
        Q = np.zeros((self.n, self.n))
        for p, v in zip(self.p, self.v, strict=True):
            Q[np.ix_([p, v], [p, v])] = self.psd * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
        if self.kind == "constant-turn":
            Q[-1, -1] = self.turn_psd * dt
        return Q

    def jacobian(self, f, x, wrapped=()):
        """Central differences of high order: good to about 1e-11."""
        columns = []
        for i in range(self.n):
            h = 1e-3 * max(1.0, abs(x[i]))
            e = np.eye(self.n)[i] * h
            d = [self.minus(f(x + j * e), f(x - j * e), wrapped) / (2 * j * h) for j in (1, 2, 3)]
            columns.append(1.5 * d[0] - 0.6 * d[1] + 0.1 * d[2])
        return np.array(columns).T

    def see(self, k, x):
        node = self.nodes[k]
        if k in self.linear:
            return np.array([self.linear[k] @ x])
        d, v = x[self.p] - node["position_m"], x[self.v]
        r, b = math.hypot(*d), math.atan2(d[1], d[0])
        return np.array({"range": [r], "bearing": [b], "range-bearing": [r, b], "range-rate": [d @ v / r]}[node["sensor"]])

    @staticmethod
    def minus(a, b, wrapped):
        d = a - b
        for i in wrapped:
            d[i] = wrap(d[i])
        return d


class Transform:
    """Sigma points and weights of spec 2.2; `correction` on the weight of the central point for covariances (scaled form)."""

    def __init__(self, n, settings):
        kind = settings.get("kind", "julier")
        alpha, beta, kappa = 1.0, 0.0, settings.get("kappa", 3.0 - n)
        if kind == "cubature":
            kappa = 0.0
        if kind == "scaled":
            alpha, beta, kappa = settings.get("alpha", 1.0), settings.get("beta", 2.0), settings.get("kappa", 0.0)
        self.spread = alpha**2 * (n + kappa)
        self.mean = np.full(2 * n + 1, 0.5 / self.spread)
        self.mean[0] = 1 - n / self.spread
        self.covariance = self.mean.copy()
        if kind == "scaled":
            self.covariance[0] += 1 - alpha**2 + beta

    def points(self, x, P):
        L = np.linalg.cholesky(self.spread * P)
        return np.vstack([x, x + L.T, x - L.T])

    def moments(self, X, x, Y, wrapped=()):
        """Mean, covariance and cross covariance; angles as differences from the central point."""
        D = np.array([Model.minus(y.copy(), Y[0], wrapped) for y in Y])
        mean = Y[0] + self.mean @ D
        D = np.array([Model.minus(y.copy(), mean, wrapped) for y in Y])
        return mean, (self.covariance[:, None] * D).T @ D, (self.covariance[:, None] * (X - x)).T @ D


class Unscented:
    def __init__(self, model, transform):
        self.m, self.t = model, transform
        self.x, self.P = model.x0.copy(), model.P0.copy()

    def predict(self, dt):
        if dt > 0:
            X = self.t.points(self.x, self.P)
            x, P, _ = self.t.moments(X, self.x, np.array([self.m.move(p, dt) for p in X]))
            self.x, self.P = x, P + self.m.noise(dt)

    def stacked(self, x, P, slots, z):
        """Innovation, spread, cross covariance, R of these slots."""
        X = self.t.points(x, P)
        Y = np.array([np.concatenate([self.m.see(k, p) for k in slots]) for p in X])
        wrapped, first = [], 0
        R = np.zeros((Y.shape[1], Y.shape[1]))
        for k in slots:
            rows = len(self.m.R[k])
            R[first:first + rows, first:first + rows] = self.m.R[k]
            wrapped += [first + i for i in self.m.angles[k]]
            first += rows
        mean, S, C = self.t.moments(X, x, Y, wrapped)
        return Model.minus(np.concatenate([z[k] for k in slots]), mean, wrapped), S, C, R

    def update(self, z, significance=None, increments=1, rule=None):
        """z: {slot: reading}. The progressive filter of spec 2.3; increments = 1: UKF. Returns how many increments it took, -1: gated."""
        slots = sorted(z)
        if not slots:
            return 0
        e, S, C, R = self.stacked(self.x, self.P, slots, z)
        if significance and e @ np.linalg.solve(S + R, e) >= scipy.stats.chi2.isf(significance, len(e)):
            return -1
        before = math.inf
        for i in range(increments):
            e, S, C, R = self.stacked(self.x, self.P, slots, z)
            now = e @ e if rule == "innovation" else e @ np.linalg.solve(R + S, e) if rule == "mahalanobis" else 0.0
            if i > 0 and now > before:
                return i
            before = now
            Pzz = S + R * increments
            K = np.linalg.solve(Pzz, C.T).T
            self.x = self.x + K @ e
            self.P = self.P - K @ Pzz @ K.T
        return increments

    def information(self, k, z, residual=True):
        """Contribution of spec 4.1."""
        e, S, C, R = self.stacked(self.x, self.P, [k], {k: z})
        H = np.linalg.solve(self.P, C).T
        noise = R + S - H @ self.P @ H.T if residual else R
        F = np.linalg.solve(noise, H).T
        return F @ (e + H @ self.x), F @ H

    def inform(self, s, S):
        Y = np.linalg.inv(self.P)
        y = Y @ self.x
        self.P = np.linalg.inv(Y + S)
        self.x = self.P @ (y + s)


class Robust:
    """A node of rekfd: spec 1.4, the step cut in two, linearised at x."""

    def __init__(self, model):
        self.m, self.x, self.V = model, model.x0.copy(), model.P0.copy()

    def predict(self, dt, c):
        A = self.m.jacobian(lambda x: self.m.move(x, dt), self.x)
        self.x = self.m.move(self.x, dt)
        P = A @ self.V @ A.T + self.m.noise(dt)
        values = np.linalg.eigvalsh(P)
        theta = 0.0
        if c > 0:
            top = 1 / values[-1]
            theta = scipy.optimize.brentq(lambda t: np.sum(np.log1p(-t * values) + t * values / (1 - t * values)) - c, 0, top * (1 - 1e-9),
                                          xtol=1e-16 * top, rtol=1e-15)
        self.V = np.linalg.inv(np.linalg.inv(P) - theta * np.eye(self.m.n))
        return theta

    def correct(self, z):
        Y, b = np.linalg.inv(self.V), np.zeros(self.m.n)
        for k, reading in z.items():
            C = self.m.jacobian(lambda x, k=k: self.m.see(k, x), self.x, self.m.angles[k])
            F = np.linalg.solve(self.m.R[k], C).T
            Y += F @ C
            b += F @ Model.minus(reading.copy(), self.m.see(k, self.x), self.m.angles[k])
        self.V = np.linalg.inv(Y)
        self.x = self.x + self.V @ b
