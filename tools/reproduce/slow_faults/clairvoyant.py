# SPDX-License-Identifier: MIT
"""What a test of the end of a fault could reach that knows all but this end: satellite, beginning and rate.

Such a test takes the fault f(t) = rate (t - begin), if it still goes on, off the satellite's pseudorange. The innovations of the filter are then
white, N(0, S). If the fault ended before epoch s, they have a mean as well: that of -f(t) on this row from s on, and of what it does to the
filter. g(s, t) = L^-1 of this mean, S = L L', is the signature. All that can be known of the end is in the log likelihood ratios

    l(s, t) = sum over i = s .. t of  g(s, i)' e(i) - |g(s, i)|^2 / 2,    e white, N(0, I), or N(g(s, i), I) where the fault ended before s

Bound. Let T be the declared end, s the first epoch without fault, and p the probability of T in s - 2 .. s + 2 while the fault goes on. By
Neyman and Pearson no rule has T there with a probability above Phi(d - z_p) if the fault ends there; d^2 = sum over s .. s + 2 of |g(s, i)|^2,
z_p the upper quantile. A rule ends faults early, before s - 2, with a probability `early` in the epochs from the alarm on; the bound is for
rules that do this as often at any time: p = 5 early / epochs. For an exact hit: the epoch s alone, and p of one epoch.

Reached. Page's test, generalised: the end is declared at the first t where the largest l(s, t) exceeds a threshold. Its numbers are by
simulation of e.
"""

from dataclasses import dataclass

import numpy as np
from scipy import stats

from . import model

NEAR = 2  # an end within so many epochs is a hit
# Ends further back than this are not tried: they have been declared.
_BACK = 12
_RUNS = 10_000


@dataclass(frozen=True)
class Known:
    """What the test is told: of epochs first, first + 1, .. the fault f, filter and geometry of the scenario."""

    signature: np.ndarray  # (candidates s, epochs after s, satellites)
    first: int  # epoch of the first candidate


def known(scenario: dict, satellite: int, begin_s: float, rate: float, first: int, last: int) -> Known:
    """Candidate ends s = first .. last."""
    H, R = model.sight(scenario)
    steps = last + _BACK
    Phi, Q = model.transitions(scenario, steps)
    P, gains, roots = model.initial(scenario), [], []
    for t in range(1, steps + 1):
        P = Phi[t - 1] @ P @ Phi[t - 1].T + Q[t - 1]
        S = H @ P @ H.T + R
        K = np.linalg.solve(S, H @ P).T
        A = np.eye(model.STATES) - K @ H
        P = A @ P @ A.T + K @ R @ K.T
        gains.append(K)
        roots.append(np.linalg.cholesky(S))
    signature = np.zeros((last - first + 1, _BACK, len(H)))
    for i, s in enumerate(range(first, last + 1)):
        x = np.zeros(model.STATES)
        for j, t in enumerate(range(s, s + _BACK)):
            x = Phi[t - 1] @ x
            mean = -H @ x
            mean[satellite] -= rate * (t - begin_s)
            signature[i, j] = np.linalg.solve(roots[t - 1], mean)
            x += gains[t - 1] @ mean
    return Known(signature, first)


def distance(k: Known, s: int, epochs: int) -> float:
    """d of an end before epoch s, once so many epochs were seen."""
    return float(np.sqrt(np.sum(k.signature[s - k.first, :epochs] ** 2)))


def bound(k: Known, s: int, early: np.ndarray, *, exact: bool) -> np.ndarray:
    """Largest probability of a hit, for a probability of an early end."""
    window = 1 if exact else 2 * NEAR + 1
    share = np.minimum(early * window / (s - NEAR - k.first), 1.0)
    return stats.norm.cdf(distance(k, s, 1 if exact else 1 + NEAR) - stats.norm.isf(share))


def reached(k: Known, s: int, thresholds: np.ndarray, seed: int = 1, runs: int = _RUNS) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of Page's test with each threshold: shares of early ends, of ends within two epochs, of exact ones."""
    random = np.random.default_rng(seed)
    epochs = s - k.first + NEAR + 1
    g = k.signature
    ratio = np.zeros((_BACK, runs))  # of candidates t - 11 .. t, the youngest last
    largest = np.empty((epochs, runs))
    for n in range(epochs):
        t = k.first + n
        e = random.standard_normal((runs, g.shape[2]))
        if t >= s:
            e += g[s - k.first, t - s]
        ratio = np.roll(ratio, -1, axis=0)
        ratio[-1] = 0.0
        for j in range(min(_BACK, n + 1)):
            mean = g[n - j, j]
            ratio[-1 - j] += e @ mean - mean @ mean / 2.0
        if n < _BACK - 1:
            ratio[: _BACK - 1 - n] = -np.inf
        largest[n] = ratio.max(axis=0)
    beyond = largest[:, :, None] > np.asarray(thresholds)
    declared = np.where(beyond.any(axis=0), beyond.argmax(axis=0) + k.first - s, epochs)
    return tuple(np.mean(part, axis=0) for part in (declared < -NEAR, np.abs(declared) <= NEAR, declared == 0))
