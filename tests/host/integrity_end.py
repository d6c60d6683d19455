# SPDX-License-Identifier: MIT
"""When a fault is over: a sequential test on the innovation of a row that is held faulty (own; beside the published rule of spec 3.3).

Each row on its own; u = r_j / sqrt(S_jj) (a sensor of several rows: u = L^-1 r_j with S_jj = L L', a tracker for each, l summed over them).
While the fault goes on, u has a mean that drifts; a Kalman filter of two states, level b and slope s, follows it and predicts the next u:
N(b, V). When it is over, u is N(0, 1). The likelihood ratio of the two laws, summed as in Page's test, decides.

State of a row: b, s, p11, p12, p22; of a sensor: C, k, t (of each row), n, T (of each row).

start, in the epoch of the alarm, from v = sum S_i^-1 r_i and I = sum S_i^-1 over the window of M epochs:
    b = v_j / I_jj / sqrt(S_jj),  s = 0,  p11 = 1,  p12 = 0,  p22 = 1 / M^2,  C = k = t = n = T = 0
each later epoch, before the filter's update, as long as the row is held faulty and was read:
    b <- b + s,  p11 <- p11 + 2 p12 + p22 + q_level,  p12 <- p12 + p22,  p22 <- p22 + q_slope,  V = 1 + p11
    l = ((u - b)^2 / V - u^2 + log V) / 2
    C <- max(0, C + l);  where C > 0: k <- k + 1, t <- t + u, else k <- 0, t <- 0
    trust = 1 - C / h, at least 0;  g1 = trust p11 / V, g2 = trust p12 / V, e = u - b
    b <- b + g1 e, s <- s + g2 e, p22 <- p22 - g2 p12, p12 <- p12 (1 - g1), p11 <- p11 (1 - g1)
    n <- n + 1, T <- T + u
    where C > h:  t^2 <= z_accept k:  over.  t^2 > z_jump k:  the fault has another value: b = t / k, s = 0, p11 = 1, p12 = 0, p22 = 1 / M^2,
                  C = k = t = 0.  Between the two, if they differ: wait for the next u
    where n = M:  T^2 <= z_back M:  over.  Else n = T = 0
A row that was not read: its prediction alone (first line).

h = log(horizon / early): Page's test ends early with a probability of about `early` at most in `horizon` epochs, since the likelihood ratio has
mean 1 while the fault goes on as the tracker models it. `trust` keeps what speaks for the end from dragging the tracker along.
z_jump, z_accept, z_back: upper chi-square quantiles with one degree of freedom (several rows: t' t against as many degrees). The last line takes
back a sensor whose fault is too small to be told from none: a wrong isolation, or a fault that shrank away.
"""
import numpy as np
from scipy import stats


class EndOfFault:
    """The trackers of an array of rows; every argument of `step` has the shape given. Sensors of one row each. accept None: as jump."""

    def __init__(self, shape, window=10, early=0.01, horizon=1000, level=0.01, slope=1e-4, jump=0.001, accept=None, back=0.1):
        self.window, self.h, self.level, self.slope = window, np.log(horizon / early), level, slope
        self.z_jump, self.z_accept = stats.chi2.isf(jump, 1), stats.chi2.isf(jump if accept is None else accept, 1)
        self.z_back = stats.chi2.isf(back, 1) if back < 1 else -1.0
        self.b, self.s, self.p11, self.p12, self.p22, self.C, self.k, self.t, self.n, self.T = (np.zeros(shape) for _ in range(10))

    def _begin(self, mask, b):
        for name, value in (('b', b), ('s', 0), ('p11', 1), ('p12', 0), ('p22', 1 / self.window**2), ('C', 0), ('k', 0), ('t', 0)):
            setattr(self, name, np.where(mask, value, getattr(self, name)))

    def start(self, mask, b):
        self._begin(mask, b)
        self.n, self.T = np.where(mask, 0, self.n), np.where(mask, 0, self.T)

    def step(self, mask, u):
        """One epoch of the rows in `mask`. Returns where the fault is over by Page's test, where by the window, where it has another value."""
        b, p11, p12, p22 = self.b + self.s, self.p11 + 2 * self.p12 + self.p22 + self.level, self.p12 + self.p22, self.p22 + self.slope
        V, e = 1 + p11, u - b
        C = np.maximum(0, self.C + 0.5 * (e**2 / V - u**2 + np.log(V)))
        k, t = np.where(C > 0, self.k + 1, 0), np.where(C > 0, self.t + u, 0)
        trust = np.clip(1 - C / self.h, 0, 1)
        g1, g2 = trust * p11 / V, trust * p12 / V
        self.b, self.s, self.p11, self.p12, self.p22 = b + g1 * e, self.s + g2 * e, p11 * (1 - g1), p12 * (1 - g1), p22 - g2 * p12
        self.C, self.k, self.t = C, k, t
        self.n, self.T = self.n + 1, self.T + u
        decide = mask & (C > self.h)
        over, changed = decide & (t**2 <= self.z_accept * k), decide & (t**2 > self.z_jump * k)
        whole = mask & (self.n >= self.window)
        back = whole & (self.T**2 <= self.z_back * self.n) & ~over
        self._begin(changed, t / np.maximum(k, 1))
        self.n, self.T = np.where(whole, 0, self.n), np.where(whole, 0, self.T)
        return over, back, changed
