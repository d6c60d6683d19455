# SPDX-License-Identifier: MIT
"""Random models for the tests of the unscented family. Functions keep the float type of their points."""
import numpy as np

from unscented import Model


def wrap(angle):
    """Into [-pi, pi)."""
    pi = np.arctan2(np.zeros_like(angle), -np.ones_like(angle))
    return angle - 2 * pi * np.floor((angle + pi) / (2 * pi))


def covariance(rng, n, low=0.1, high=10.0, rank=None):
    """Random orthogonal vectors, log-uniform spectrum, zeros above `rank`."""
    vectors = np.linalg.qr(rng.normal(size=(n, n)))[0]
    spectrum = np.exp(rng.uniform(np.log(low), np.log(high), n))
    spectrum[n if rank is None else rank:] = 0
    return (vectors * spectrum) @ vectors.T


def linear(H):
    return Model(len(H), lambda x, dt: x @ H.T.astype(x.dtype), lambda x, dt: H.astype(x.dtype))


def quadratic(rng, n, rows, strength):
    """y_r = H_r x + strength / 2 x' B_r x"""
    H, B = rng.normal(size=(rows, n)), rng.normal(size=(rows, n, n))
    B = (B + B.transpose(0, 2, 1)) / 2
    return Model(rows, lambda x, dt: x @ H.T.astype(x.dtype) + np.einsum("pi,rij,pj->pr", x, B.astype(x.dtype), x) * x.dtype.type(strength) / 2,
                 lambda x, dt: H.astype(x.dtype) + np.einsum("rij,j->ri", B, x[0]) * x.dtype.type(strength))


def waves(rng, n, strength):
    """A motion that turns what is stable: g(x) = A x + strength sin(B x) dt"""
    A = np.linalg.qr(rng.normal(size=(n, n)))[0] * 0.95
    B = rng.normal(size=(n, n))
    return Model(n, lambda x, dt: x @ A.T.astype(x.dtype) + x.dtype.type(strength * dt) * np.sin(x @ B.T.astype(x.dtype)),
                 lambda x, dt: A.astype(x.dtype) + x.dtype.type(strength * dt) * np.cos(B.astype(x.dtype) @ x[0])[:, None] * B.astype(x.dtype))


def distance_to(place, states):
    """Range to a place; states: which of the state's numbers are the position."""
    place, states = np.asarray(place), list(states)

    def offset(x):
        return x[:, states] - place.astype(x.dtype)

    def jacobian(x, dt):
        J, d = np.zeros((1, x.shape[1]), x.dtype), offset(x)[0]
        J[0, states] = d / np.sqrt(d @ d)
        return J
    return Model(1, lambda x, dt: np.sqrt((offset(x)**2).sum(1))[:, None], jacobian)


def bearing_from(place, states, mean=False):
    """Direction from a place in the plane, in [-pi, pi)."""
    place, (i, j) = np.asarray(place), states

    def offset(x):
        return x[:, [i, j]] - place.astype(x.dtype)

    def jacobian(x, dt):
        J, (a, b) = np.zeros((1, x.shape[1]), x.dtype), offset(x)[0]
        J[0, [i, j]] = np.array([-b, a]) / (a * a + b * b)
        return J
    return Model(1, lambda x, dt: np.arctan2(offset(x)[:, 1:], offset(x)[:, :1]), jacobian, lambda a, b: wrap(a - b), circular if mean else None)


def circular(weights, angles):
    """Mean direction of each column."""
    weights = weights.astype(angles.dtype)
    return np.arctan2(weights @ np.sin(angles), weights @ np.cos(angles))


def walker(mean=False):
    """x = [px, py, heading, speed, turn rate]; the heading is an angle in [-pi, pi)."""
    def function(x, dt):
        dt = x.dtype.type(dt)
        px, py, heading, speed, rate = x.T
        return np.stack([px + dt * speed * np.cos(heading), py + dt * speed * np.sin(heading), wrap(heading + dt * rate), speed, rate], 1)

    def jacobian(x, dt):
        _, _, heading, speed, _ = x[0]
        J = np.eye(5, dtype=x.dtype)
        J[0, 2], J[0, 3] = -dt * speed * np.sin(heading), dt * np.cos(heading)
        J[1, 2], J[1, 3] = dt * speed * np.cos(heading), dt * np.sin(heading)
        J[2, 4] = dt
        return J

    def turned(a, b):
        d = a - b
        d[2] = wrap(d[2])
        return d

    def mean_of(weights, y):
        m = weights.astype(y.dtype) @ y
        m[2] = circular(weights, y[:, 2:3])[0]
        return m
    return Model(5, function, jacobian, turned, mean_of if mean else None)


def sensors(rng, n, count=None, strength=0.1):
    """Ranges, bearings and quadratic rows, some of them in one sensor of two rows."""
    made = []
    for _ in range(count or int(rng.integers(1, 5))):
        which = rng.integers(0, 3)
        if n >= 2 and which == 0:
            made.append((distance_to(rng.normal(size=2) * 20, rng.choice(n, 2, replace=False)), covariance(rng, 1, 1e-3, 1)))
        elif n >= 2 and which == 1:
            made.append((bearing_from(rng.normal(size=2) * 20, rng.choice(n, 2, replace=False)), covariance(rng, 1, 1e-5, 1e-2)))
        else:
            rows = int(rng.integers(1, 4))
            made.append((quadratic(rng, n, rows, strength), covariance(rng, rows, 0.1, 3)))
    return made


def reading(rng, model, R, truth, outliers=0.0):
    z = model.function(truth[None], 0.0)[0] + np.linalg.cholesky(R) @ rng.normal(size=model.rows) * (20 if rng.random() < outliers else 1)
    return wrap(z) if model.difference else z
