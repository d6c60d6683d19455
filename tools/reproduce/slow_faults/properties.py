# SPDX-License-Identifier: MIT
"""What must hold (spec 3.4), what is claimed, and the goal of an end of a fault that is declared in time."""

import numpy as np
from scipy import stats
from statements import CLAIM, MUST, OPEN, Property

from .batches import BEGIN_S, ETA, FAULTS, NEAR, RATES, Batch, Fault, Shares, ours, plain

LABEL = {"ekf": "EKF", "rekf-n": "REKF-N", "rekf-t": "REKF-t"}
ROBUST = ("rekf-n", "rekf-t")
CONFIDENCE = 0.95
# Both published, and here of the middle rate: the fault that the innovation is told for.
SHOWN: Fault = (0.15, 299)
KEEPS_S = 30


def gain(batch: Batch, scheme: str, rate: float) -> np.ndarray:
    """Of each run, s by which the alarm is before that of the EKF."""
    return batch.of[plain("ekf", (rate, 299))].alarm - batch.of[plain(scheme, (rate, 299))].alarm


def wilson(hits: int, runs: int) -> tuple[float, float]:
    """95 % confidence interval of a probability."""
    interval = stats.binomtest(hits, runs).proportion_ci(CONFIDENCE, method="wilson")
    return float(interval.low), float(interval.high)


def innovation(batch: Batch, scheme: str) -> float:
    """Mean over the runs at the fault's last second."""
    return float(batch.of[plain(scheme, SHOWN)].mean_innovation[SHOWN[1] - 1])


def _mean_gain(batch: Batch, scheme: str, rate: float) -> float:
    return float(np.mean(gain(batch, scheme, rate)))  # NaN where a run has no alarm


def _least_gain(batch: Batch, scheme: str) -> float:
    return min(_mean_gain(batch, scheme, rate) for rate in RATES)


def _shrinks(batch: Batch, rates: tuple[float, ...]) -> float:
    gains = [[_mean_gain(batch, scheme, rate) for rate in rates] for scheme in ROBUST]
    return float(-np.diff(gains).max())


def _false_alarms(batch: Batch, schemes: tuple[str, ...]) -> float:
    """Runs with one in any case."""
    return float(np.sum(np.any([watched.false > 0 for case, watched in batch.of.items() if case.scheme in schemes], axis=0)))


def _after(batch: Batch, scheme: str) -> list[float]:
    """Alarms after the fault, median of the runs, by rate."""
    return [float(np.median(batch.of[plain(scheme, (rate, 299))].after)) for rate in RATES]


def _least(batch: Batch, part: str) -> float:
    declared = [batch.declared(ours((rate, 299))) for rate in RATES]
    return min(getattr(s, part) / s.runs for s in declared)


def _most_early(batch: Batch) -> float:
    declared = [batch.declared(ours((rate, 299))) for rate in RATES]
    return max(s.early / s.runs for s in declared)


def _beyond_bound(batch: Batch, *, exact: bool) -> float:
    """By how much the lower end of a share's interval is above the bound; early ends as many as the upper end of their interval says."""

    def beyond(fault: Fault, s: Shares) -> float:
        bound = batch.limit[fault].bound(np.array([wilson(s.early, s.runs)[1]]), exact=exact)[0]
        return wilson(s.exact if exact else s.near, s.runs)[0] - float(bound)

    return max(beyond(fault, batch.declared(ours(fault))) for fault in FAULTS)


def _wrong(batch: Batch) -> float:
    return max(float(np.mean(batch.of[ours(fault)].wrong)) for fault in FAULTS)


def _better(batch: Batch) -> float:
    """By how much the share of hits is above the published rule's, where least."""
    return min((batch.declared(ours(f)).near - batch.declared(plain("rekf-t", f)).near) / batch.runs for f in FAULTS)


def _before_ekf(scheme: str) -> Property:
    text = f"{LABEL[scheme]} alarms before EKF at every rate"
    return Property(MUST, text, "least mean gain, s", lambda b: _least_gain(b, scheme), ">", 0.0)


def _no_false_alarm(kind: str, *schemes: str) -> Property:
    text = f"{', '.join(LABEL[s] for s in schemes)}: no alarm in the {BEGIN_S} epochs before the fault"
    return Property(kind, text, "runs", lambda b: _false_alarms(b, schemes), "<", 1.0)


def _ours_ends(fault: Fault) -> Property:
    rate, last = fault
    text = f"ours, {rate:.2f} m/s until {last} s: end within {NEAR} epochs in 90 %"
    return Property(OPEN, text, "share", lambda b: b.declared(ours(fault)).near / b.runs, ">", 0.9)


PROPERTIES = [
    *(_before_ekf(scheme) for scheme in ROBUST),
    Property(MUST, "gains smaller at 0.25 than at 0.10 m/s", "least difference, s", lambda b: _shrinks(b, (0.10, 0.25)), ">", 0.0),
    Property(CLAIM, "gains shrink from rate to rate", "least difference, s", lambda b: _shrinks(b, RATES), ">", 0.0),
    _no_false_alarm(MUST, "ekf", "rekf-t"),
    _no_false_alarm(CLAIM, "rekf-n"),
    Property(MUST, "innovation of satellite 1 at 299 s, 0.15 m/s: EKF near 9 m", "off 9 m", lambda b: abs(innovation(b, "ekf") - 9.0), "<", 1.0),
    Property(MUST, "the same: REKF-t in 20 .. 22.5 m", "off the middle, m", lambda b: abs(innovation(b, "rekf-t") - 21.25), "<", 1.25),
    Property(MUST, f"after the end EKF + AIME alarms for {KEEPS_S} s and more", "least median, s",
             lambda b: min(_after(b, "ekf")), ">", KEEPS_S - 1),
    Property(MUST, "the improved scheme does not", "largest median, s", lambda b: max(_after(b, "rekf-t")), "<", KEEPS_S),
    Property(MUST, f"ours: end within {NEAR} epochs in 90 % at every rate", "least share", lambda b: _least(b, "near"), ">", 0.9),
    Property(MUST, "ours: early ends below 1 % at every rate", "largest share", _most_early, "<", 0.01),
    *(_ours_ends(fault) for fault in FAULTS if fault[1] != 299),
    Property(MUST, f"ours: no fewer ends within {NEAR} epochs than the published rule, every fault", "least difference",
             _better, ">", -1e-9),
    Property(MUST, "ours: ends not better than the bound", "lower limit beyond it", lambda b: _beyond_bound(b, exact=False), "<", 0.0),
    Property(MUST, "ours: exact ends not better than the bound", "lower limit beyond it", lambda b: _beyond_bound(b, exact=True), "<", 0.0),
    Property(MUST, "ours: another satellite held faulty in fewer than 1 %", "largest share", _wrong, "<", 0.01),
    Property(OPEN, f"published rule, eta {ETA:g}: 90 % within {NEAR} epochs at every rate", "least share",
             lambda b: min(b.declared(plain("rekf-t", (rate, 299))).near / b.runs for rate in RATES), ">", 0.9),
]  # fmt: skip
