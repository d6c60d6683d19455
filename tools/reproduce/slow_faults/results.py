# SPDX-License-Identifier: MIT
"""The tables: alarm times and gains run by run, ends of faults, and what a clairvoyant test would reach."""

from pathlib import Path

import numpy as np
import tables
from scipy import stats
from statements import evaluate
from tables import Row

from . import published
from .batches import ETAS, EVIDENCE, FAULTS, NEAR, RATES, Batch, Fault, Shares, ours, plain, unending
from .properties import CONFIDENCE, LABEL, PROPERTIES, ROBUST, gain, innovation, wilson

MONITOR = {"ekf": "AIME", "rekf-n": "AIME", "rekf-t": "improved AIME"}
# Shares of early ends at which the bound is told.
EARLY = (0.001, 0.01)


def write(out: Path, batches: list[Batch], errors: dict[int, str]) -> int:
    batch = batches[0] if batches else None
    runs = f"{batch.runs} runs of the experiment on slow faults" if batch else "slow faults"
    report = tables.Report(
        title=runs,
        intro="GNSS/INS, 8 satellites; a ramp on satellite 1 from 150 s on, until 299 s unless said otherwise. All cases see the same runs.\n",
        independent="independent, mean",
        rows=times(batch) if batch else [],
        outcomes=evaluate(PROPERTIES, batches),
        seeds=[b.seed for b in batches],
        errors=errors,
        one="batch",
        extra=[alarms(batch), gains(batch), ends(batch), curve(batch), bounds(batch)] if batch else [],
        facts={"ends": {fault_name(f): _facts(batch, f) for f in FAULTS}} if batch else {},
    )
    return tables.write(out, report)


def fault_name(fault: Fault) -> str:
    return f"{fault[0]:.2f} m/s until {fault[1]} s"


def times(batch: Batch) -> list[Row]:
    """Values by run."""
    rows = []
    for scheme in published.SCHEMES:
        for rate in RATES:
            values = dict(enumerate(batch.of[plain(scheme, (rate, 299))].alarm.tolist()))
            paper, independent = published.ALARM_S[scheme].get(rate), (published.INDEPENDENT_ALARM_S[scheme][rate],)
            rows.append(Row(f"alarm, s: {LABEL[scheme]} + {MONITOR[scheme]}, {rate:.2f} m/s", values, 1, paper, independent))
    for scheme in ROBUST:
        for rate in RATES:
            of_ekf, own = (published.INDEPENDENT_ALARM_S[s][rate] for s in ("ekf", scheme))
            values = dict(enumerate(gain(batch, scheme, rate).tolist()))
            rows.append(Row(f"gain over EKF, s: {LABEL[scheme]}, {rate:.2f} m/s", values, 1, published.GAIN_S[scheme][rate], (of_ekf - own,)))
    return rows


def _mean(values: np.ndarray) -> str:
    """With the half width of its 95 % interval (Student)."""
    half = stats.t.ppf(0.5 + CONFIDENCE / 2, len(values) - 1) * values.std(ddof=1) / np.sqrt(len(values)) if len(values) > 1 else np.inf
    return f"{values.mean():.2f} \N{PLUS-MINUS SIGN} {half:.2f}"


def _quantiles(values: np.ndarray) -> list[str]:
    low, middle, high = np.quantile(values, (0.05, 0.5, 0.95))
    return [f"{middle:.0f}", f"{low:.0f} .. {high:.0f}"]


def alarms(batch: Batch) -> str:
    header = ["alarm, s", "rate, m/s", "mean", "median", "5 .. 95 %", "published", "independent, mean", "position, RMS while the fault is on, m"]
    body = []
    for scheme in (*published.SCHEMES, "ours"):
        for rate in RATES:
            name = "REKF-t, ours" if scheme == "ours" else f"{LABEL[scheme]} + {MONITOR[scheme]}"
            watched = batch.of[ours((rate, 299)) if scheme == "ours" else plain(scheme, (rate, 299))]
            paper, independent = (of.get(scheme, {}).get(rate) for of in (published.ALARM_S, published.INDEPENDENT_ALARM_S))
            beside = [f"{value:g}" if value else "-" for value in (paper, independent)]
            body.append([name, f"{rate:.2f}", _mean(watched.alarm), *_quantiles(watched.alarm), *beside, f"{watched.position_m:.2f}"])
    return tables.table(header, body)


def gains(batch: Batch) -> str:
    header = ["alarm before that of EKF + AIME by, s", "rate, m/s", "mean", "median", "5 .. 95 %", "published"]
    header += ["innovation of satellite 1 at 299 s, m"]
    body = []
    for scheme in ROBUST:
        for rate in RATES:
            values = gain(batch, scheme, rate)
            shown = f"{innovation(batch, scheme):.1f} (EKF {innovation(batch, 'ekf'):.1f}, true 22.35)" if rate == 0.15 else "-"
            body.append([LABEL[scheme], f"{rate:.2f}", _mean(values), *_quantiles(values), f"{published.GAIN_S[scheme][rate]:g}", shown])
    return tables.table(header, body)


def _share(hits: int, runs: int) -> str:
    low, high = wilson(hits, runs)
    return f"{100 * hits / runs:.1f} ({100 * low:.1f} .. {100 * high:.1f})"


def _cells(s: Shares) -> list[str]:
    return [_share(s.exact, s.runs), _share(s.near, s.runs), _share(s.early, s.runs), f"{100 * s.rest / s.runs:.1f}"]


def ends(batch: Batch) -> str:
    header = ["fault", "its end declared by", "exact, %", f"within {NEAR} epochs, %", "early, %", "later or not, %", "independent: exact, early, %"]
    body = []
    for fault in FAULTS:
        exact, early = published.INDEPENDENT_ENDS[fault]
        body.append([fault_name(fault), "published rule", *_cells(batch.declared(plain("rekf-t", fault))), f"{100 * exact:.0f}, {100 * early:.0f}"])
        body.append([fault_name(fault), "ours", *_cells(batch.declared(ours(fault))), "-"])
    return tables.table(header, body)


def curve(batch: Batch) -> str:
    """Shares over the threshold: the ROC curve in numbers."""
    header = ["rule", "threshold", *(f"{rate:.2f} m/s: within {NEAR}, early, %" for rate in RATES)]

    def cells(shares: list[Shares]) -> list[str]:
        return [f"{100 * s.near / s.runs:.1f}, {100 * s.early / s.runs:.1f}" for s in shares]

    body = [["published", f"eta {eta:g}", *cells([batch.declared(unending((rate, 299)), eta) for rate in RATES])] for eta in ETAS]
    for evidence in EVIDENCE:
        body.append(["ours", f"evidence {evidence:g}", *cells([batch.declared(ours((rate, 299), evidence)) for rate in RATES])])
    body.append(["ours", "as it is", *cells([batch.declared(ours((rate, 299))) for rate in RATES])])
    return tables.table(header, body)


def bounds(batch: Batch) -> str:
    header = ["clairvoyant test", "d after 1 epoch", f"d after {NEAR + 1}"]
    header += [f"bound, {what}, early {100 * e:g} %" for what in (f"within {NEAR}", "exact") for e in EARLY]
    header += [f"reached with early 1 %: within {NEAR}", "exact"]
    body = []
    for fault in FAULTS:
        limit = batch.limit[fault]
        distances = [f"{d:.1f}" for d in limit.distances]
        share = [f"{100 * v:.2f}" for exact in (False, True) for v in limit.bound(np.array(EARLY), exact=exact)]
        early, near, exact = limit.reached
        # The lowest threshold that keeps it.
        at = int(np.argmax(early <= 0.01))
        body.append([fault_name(fault), *distances, *share, f"{100 * near[at]:.2f}", f"{100 * exact[at]:.1f}"])
    return tables.table(header, body)


def _facts(batch: Batch, fault: Fault) -> dict:
    rules = {"published": batch.declared(plain("rekf-t", fault)), "ours": batch.declared(ours(fault))}
    return {name: vars(s) | {"wilson_near": wilson(s.near, s.runs), "wilson_early": wilson(s.early, s.runs)} for name, s in rules.items()}
