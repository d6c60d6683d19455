# SPDX-License-Identifier: MIT
"""The published schemes over many runs at once: a filter, AIME over M epochs, and the published end-of-fault rule (spec 3.3)."""
import numpy as np
from scipy import stats

import integrity_model as model
import integrity_reference as reference

FALSE_ALARM = 8e-10
WINDOW = 10


def published_rule(q_a, q_r, alarmed_since, ratios, eta, floor=0.1, length=3):
    """One epoch of the published rule. `ratios` are the ratios since the alarm, oldest first, this epoch's not yet among them.
    Returns the ratio, its excess over the median of the last three (this one among them), and whether that ends the fault: from two epochs
    after the alarm."""
    ratio = q_a / np.maximum(q_r, floor)
    last = np.stack(ratios[-(length - 1):] + [ratio])
    excess = np.where(alarmed_since >= 2, ratio - np.median(last, axis=0), -np.inf)
    return ratio, excess, excess > eta


def run(zs, Phis, Qs, H, scheme, improved=False, eta=2.0 * WINDOW, false_alarm=FALSE_ALARM, M=WINDOW):
    """zs: (epochs, runs, n). Returns arrays (epochs, runs): q_A, q_R, alarm, ended, ratio, excess (ratio - median, -inf where the rule is not
    armed); and innovation, weights (epochs, runs, n)."""
    epochs, runs, n = zs.shape
    R = model.SIGMA**2 * np.eye(n)
    x, P = np.zeros((runs, model.STATES)), np.tile(model.initial_covariance(), (runs, 1, 1))
    used = np.ones((runs, n), bool)
    threshold = stats.chi2.isf(false_alarm, n)
    window_r, window_i = np.zeros((M, runs, n)), np.zeros((M, runs, n, n))
    count, since, rctm_left = np.zeros(runs, int), np.full(runs, -1), np.zeros(runs, int)
    ratios = [np.ones(runs), np.ones(runs)]
    out = {name: np.zeros((epochs, runs)) for name in ('q_a', 'q_r', 'alarm', 'ended', 'ratio', 'excess')}
    out |= {name: np.zeros((epochs, runs, n)) for name in ('r', 'w')}
    for k in range(epochs):
        x, P = reference.predict(x, P, Phis[k], Qs[k])
        r, S, PHt = reference.innovate(x, P, zs[k], H, R)
        w = reference.weights(r, S, used, scheme)
        inverse = reference.information(S, used)
        window_r[k % M], window_i[k % M] = r, inverse
        q_r = reference.rctm(r, inverse)
        q_a, _, _ = reference.aime(window_r, window_i)
        count += 1
        full = count >= M
        alarm = np.where(rctm_left > 0, q_r > threshold, full & (q_a > threshold))
        ended = np.zeros(runs, bool)
        if improved:
            since = np.where(alarm & (rctm_left == 0), np.where(since >= 0, since + 1, 0), -1)
            ratio, excess, ended = published_rule(q_a, q_r, since, ratios, eta)
            ratio = np.where(alarm, ratio, 1.0)
            ended &= alarm
            alarm &= ~ended
            rctm_left = np.where(ended, M, np.maximum(rctm_left - 1, 0))
            window_r[:, ended], window_i[:, ended], count[ended], since[ended] = 0, 0, 0, -1
            ratios = ratios[-1:] + [ratio]
            out['ratio'][k], out['excess'][k] = ratio, np.where(alarm | ended, excess, -np.inf)
        x, P = reference.update(x, P, r, PHt, inverse, w, H, R)
        for name, value in (('q_a', q_a), ('q_r', q_r), ('alarm', alarm), ('ended', ended), ('r', r), ('w', w)):
            out[name][k] = value
    return out
