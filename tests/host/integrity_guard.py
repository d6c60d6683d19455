# SPDX-License-Identifier: MIT
"""Detection, isolation, exclusion and end of faults over many runs at once (own; spec 3.3, open problem): AIME, the row with the largest T_j,
its exclusion, and the sequential test of integrity_end. The window begins again, empty, where a row is excluded or comes back; AIME alarms with
any number of epochs in it, since its law needs no full window (with one epoch it is RCTM). A row is isolated where its T_j leads the next by
`separation`, or after `patience` epochs of alarm without that."""
import numpy as np
from scipy import stats

import integrity_end
import integrity_model as model
import integrity_reference as reference


def run(zs, Phis, Qs, H, scheme='rekf-t', exclude=True, false_alarm=8e-10, M=10, keep=(), most=3, separation=10.0, patience=5, **options):
    """zs: (epochs, runs, n). Returns arrays (epochs, runs): row (isolated in this epoch, -1: none); (epochs, runs, n): faulty (after this
    epoch), over, back, changed, r, s (= S_jj); of the names in `keep` also x, b, q_a, S. `most` rows are held faulty at a time, at most.
    exclude False: the weights of `scheme` alone protect the filter."""
    epochs, runs, n = zs.shape
    R = model.SIGMA**2 * np.eye(n)
    x, P = np.zeros((runs, model.STATES)), np.tile(model.initial_covariance(), (runs, 1, 1))
    faulty, everyone = np.zeros((runs, n), bool), np.ones((runs, n), bool)
    window_r, window_i = np.zeros((M, runs, n)), np.zeros((M, runs, n, n))
    test = integrity_end.EndOfFault((runs, n), window=M, **options)
    threshold = np.array([np.inf] + [stats.chi2.isf(false_alarm, i) for i in range(1, n + 1)])
    waited = np.zeros(runs, int)
    out = {'row': np.full((epochs, runs), -1)} | {name: np.zeros((epochs, runs, n), bool) for name in ('faulty', 'over', 'back', 'changed')}
    out |= {name: np.zeros((epochs, runs, n)) for name in ('r', 's')} | {name: [] for name in keep}
    for k in range(epochs):
        x, P = reference.predict(x, P, Phis[k], Qs[k])
        r, S, PHt = reference.innovate(x, P, zs[k], H, R)
        s = np.einsum('...jj->...j', S)
        over, back, changed = test.step(faulty, r / np.sqrt(s))
        ended = over | back
        faulty = faulty & ~ended
        again = ended.any(1)
        window_r[:, again], window_i[:, again] = 0, 0
        window_r[k % M], window_i[k % M] = r, reference.information(S, ~faulty)
        q_a, v, I = reference.aime(window_r, window_i)
        alarm = (q_a > threshold[(~faulty).sum(1)]) & (faulty.sum(1) < most)
        T, j = reference.isolate(v, I)
        ordered = np.sort(T, axis=1)
        waited = np.where(alarm, waited + 1, 0)
        alarm &= (ordered[:, -1] - ordered[:, -2] >= separation) | (waited > patience)
        if alarm.any():
            new = np.zeros_like(faulty)
            new[np.nonzero(alarm)[0], j[alarm]] = True
            information = np.einsum('...jj->...j', I)
            test.start(new, v / np.where(information > 0, information, 1) / np.sqrt(s))
            faulty = faulty | new
            window_r[:, alarm], window_i[:, alarm] = 0, 0
            out['row'][k] = np.where(alarm, j, -1)
        used = ~faulty if exclude else everyone
        inverse = reference.information(S, used)
        x, P = reference.update(x, P, r, PHt, inverse, reference.weights(r, S, used, scheme), H, R)
        for name, value in (('faulty', faulty), ('over', over), ('back', back), ('changed', changed), ('r', r), ('s', s)):
            out[name][k] = value
        for name, value in (('x', x), ('b', test.b), ('q_a', q_a), ('S', S)):
            if name in keep:
                out[name].append(value.copy())
    return out


def declared(out, row, last):
    """Of every run: offset of the first declared end of `row` from the first epoch without fault (last + 1), nan where none is;
    and whether the row isolated first was this one."""
    gone = (out['over'] | out['back'])[:, :, row]
    offset = np.where(gone.any(0), gone.argmax(0) + 1.0 - (last + 1), np.nan)
    alarm = out['row'] >= 0
    first = np.take_along_axis(out['row'], alarm.argmax(0)[None], 0)[0]
    return offset, first == row
