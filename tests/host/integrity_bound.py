# SPDX-License-Identifier: MIT
"""What no decision on the end of a fault can beat by much: a test that knows the ramp, its start and all covariances (own, beside spec 3.3).

The ramp known, it is subtracted, and the Kalman filter with all rows is optimal: while the fault goes on its innovations are white, N(0, S).
When the fault ended at t0 the subtraction is wrong by -b(t) from t0 on, and the innovations have the mean d(t0, t) that the filter answers to
it. Page's test with these known means, maximised over t0, is the clairvoyant decision; d, S and the gains do not depend on the data."""
import numpy as np

import integrity_model as model


def gains(Phis, Qs, H):
    """Gains and inverse roots of S of the plain filter, epoch by epoch."""
    P, R = model.initial_covariance(), model.SIGMA**2 * np.eye(len(H))
    Ks, Ws = [], []
    for Phi, Q in zip(Phis, Qs):
        P = Phi @ P @ Phi.T + Q
        S = H @ P @ H.T + R
        K = P @ H.T @ np.linalg.inv(S)
        A = np.eye(len(P)) - K @ H
        P = A @ P @ A.T + K @ R @ K.T
        Ks.append(K)
        Ws.append(np.linalg.inv(np.linalg.cholesky(S)))
    return Ks, Ws


def answers(Phis, H, Ks, Ws, fault, row, onset, lags):
    """Whitened means of the innovations of indices onset .. onset + lags - 1 when `fault`, subtracted, is gone since onset: (lags, n)."""
    e, d = np.zeros(model.STATES), np.zeros((lags, len(H)))
    for lag in range(lags):
        k = onset + lag
        e = Phis[k] @ e
        r = -H @ e
        r[row] -= fault[k]
        e = e + Ks[k] @ r
        d[lag] = Ws[k] @ r
    return d


def page(whitened, ds, begin, lags):
    """Largest log-likelihood ratio over onsets begin .. t of every run and epoch t; whitened: (epochs, runs, n); ds: onset -> (lags, n)."""
    epochs, runs, _ = whitened.shape
    G = np.full((epochs, runs), -np.inf)
    for onset in range(begin, epochs):
        total = np.zeros(runs)
        for lag in range(min(lags, epochs - onset)):
            d = ds[onset][lag]
            total = total + whitened[onset + lag] @ d - d @ d / 2
            np.maximum(G[onset + lag], total, out=G[onset + lag])
    return G
