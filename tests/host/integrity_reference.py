# SPDX-License-Identifier: MIT
"""Reference of the slow-fault monitor, NumPy, written from the specification alone (3.1 to 3.3). Every function takes leading run axes.

Excluded rows: S keeps a row for an excluded measurement (its innovation is still wanted), but gain and monitors leave it out; `used` is a mask.
"""
import numpy as np
from scipy import stats


def igg3_weights(u, k0, k1):
    """IGG-III weight of a standardised statistic (spec 3.2). The clip keeps the unused middle branch finite."""
    a = np.abs(u)
    middle = k0 / np.maximum(a, k0) * (np.clip(k1 - a, 0, None) / (k1 - k0)) ** 2
    return np.where(a <= k0, 1.0, np.where(a > k1, 0.0, middle))


def t_statistics(u, used=None):
    """Each row against mean and deviation of the others (external studentisation); n of the used rows only, needs n >= 4."""
    used = np.ones(u.shape, bool) if used is None else used
    n = used.sum(-1, keepdims=True)
    v = np.where(used, u, 0.0)
    total, square = v.sum(-1, keepdims=True), (v**2).sum(-1, keepdims=True)
    mean = (total - v) / (n - 1)
    variance = (square - v**2 - (n - 1) * mean**2) / (n - 2)
    return np.where(used, (u - mean) / np.sqrt(variance * (1 + 1 / (n - 1))), 0.0)


def t_thresholds(n, significances=(0.1, 0.01)):
    """Two-sided quantiles of Student's law with n - 2 degrees of freedom: k0, k1 (n = 8: 1.943, 3.707)."""
    return tuple(stats.t.isf(a / 2, n - 2) for a in significances)


def weights(r, S, used, scheme, normal=(2.0, 5.0), significances=(0.1, 0.01)):
    """Row weights of a scheme: 'ekf' all 1; 'rekf-n' normal; 'rekf-t' Student, plain with fewer than four rows."""
    if scheme == 'ekf':
        return np.ones(r.shape)
    u = r / np.sqrt(np.einsum('...jj->...j', S))
    if scheme == 'rekf-n':
        return igg3_weights(u, *normal)
    n = used.sum(-1)
    safe = np.maximum(n, 4)
    k0, k1 = (stats.t.isf(a / 2, safe - 2)[..., None] for a in significances)
    with np.errstate(invalid='ignore', divide='ignore'):
        w = igg3_weights(t_statistics(u, used), k0, k1)
    return np.where(n[..., None] >= 4, w, 1.0)


def information(S, used):
    """S^-1 over the used rows, zero elsewhere."""
    both = used[..., :, None] & used[..., None, :]
    full = np.where(both, S, np.eye(S.shape[-1]))
    return np.where(both, np.linalg.inv(full), 0.0)


def predict(x, P, Phi, Q):
    """x = Phi x, P = Phi P Phi' + Q."""
    s = P.shape
    half = (P.reshape(-1, s[-1]) @ Phi.T).reshape(s).swapaxes(-1, -2)
    P = (half.reshape(-1, s[-1]) @ Phi.T).reshape(s).swapaxes(-1, -2) + Q
    return x @ Phi.T, (P + P.swapaxes(-1, -2)) / 2


def innovate(x, P, z, H, R):
    """Innovation, its covariance and P H'."""
    PHt = P @ H.T
    return z - x @ H.T, H @ PHt + R, PHt


def update(x, P, r, PHt, inverse, w, H, R):
    """Weighted gain and the Joseph form; `inverse` is zero in excluded rows, so they do not act."""
    K = (PHt @ inverse) * w[..., None, :]
    A = np.eye(P.shape[-1]) - K @ H
    P = A @ P @ A.swapaxes(-1, -2) + K @ R @ K.swapaxes(-1, -2)
    return x + np.einsum('...ij,...j->...i', K, r), (P + P.swapaxes(-1, -2)) / 2


def ekf_step(x, P, z, Phi, Q, H, R, scheme='ekf', used=None):
    """One epoch: prediction, weights, update. Returns x, P, r, S, weights."""
    x, P = predict(x, P, Phi, Q)
    r, S, PHt = innovate(x, P, z, H, R)
    used = np.ones(r.shape, bool) if used is None else used
    w = weights(r, S, used, scheme)
    x, P = update(x, P, r, PHt, information(S, used), w, H, R)
    return x, P, r, S, w


def rctm(r, inverse):
    return np.einsum('...i,...ij,...j->...', r, inverse, r)


def aime(r_window, inverse_window):
    """q_A, v = sum S_i^-1 r_i and I = sum S_i^-1 of a window, axis 0 is time. q_A = v' I^-1 v over the rows that are used."""
    v = np.einsum('k...ij,k...j->...i', inverse_window, r_window)
    I = inverse_window.sum(0)
    return statistic(v, I), v, I


def statistic(v, I):
    d = np.einsum('...jj->...j', I)
    safe = I + np.where(d == 0, 1.0, 0.0)[..., None] * np.eye(I.shape[-1])
    return np.einsum('...i,...i->...', v, np.linalg.solve(safe, v[..., None])[..., 0])


def isolate(v, I, used=None):
    """T_j = v_j^2 / I_jj: what an unknown constant bias of row j takes away from q_A, chi-square with one degree of freedom without a fault.
    Returns all T and the row with the largest."""
    d = np.einsum('...jj->...j', I)
    T = np.where(d > 0, v**2 / np.where(d > 0, d, 1), -1.0)
    return T, T.argmax(-1)
