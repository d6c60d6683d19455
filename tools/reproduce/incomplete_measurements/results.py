# SPDX-License-Identifier: MIT
"""The tables of the published comparison, of the fair one, of the gate's policies and of what the covariances are worth."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import tables
from statements import evaluate
from tables import Row
from tracking import nees_verdict, share, total

from . import published
from .batches import FILTERS, LOST_M, POLICIES, RUNS, TIGHT, Batch
from .properties import LABEL, PROPERTIES, fired, position, velocity

_INTRO = f"""A batch: {RUNS} runs of 60 steps. Errors: mean over time of ln of the mean over the runs of the squared error, position in m, velocity in m/s. As
published: a gate in MPUKF only, the literal IUKF. A run is lost if it ends with a position error above {LOST_M:g} m.
"""


def write(out: Path, batches: list[Batch], errors: dict[int, str]) -> int:
    report = tables.Report(
        title=f"{tables.count(batches, 'batch')} of tracking with incomplete measurements",
        intro=_INTRO,
        independent="independent",
        rows=comparison(batches) if batches else [],
        outcomes=evaluate(PROPERTIES, batches),
        seeds=[batch.seed for batch in batches],
        errors=errors,
        one="batch",
        extra=[_policies(batches, tight=False), _policies(batches, tight=True), _covariances(batches)] if batches else [],
    )
    return tables.write(out, report)


def comparison(batches: list[Batch]) -> list[Row]:
    def over(measure: Callable[[Batch], float]) -> dict[int, float]:
        return {batch.seed: float(measure(batch)) for batch in batches}

    rows = []
    kinds = (
        ("position", position, published.POSITION, published.INDEPENDENT_POSITION),
        ("velocity", velocity, published.VELOCITY, published.INDEPENDENT_VELOCITY),
    )
    for what, measure, paper, independent in kinds:
        for f in FILTERS:
            beside = (independent[f],) if f in independent else None
            rows.append(Row(f"{what}, ln: {LABEL[f]}", over(lambda b: measure(b, "published", f)), 3, paper.get(f), beside))
    for f in published.FILTERS:
        times = over(lambda b: b.ns[f] / b.ns["pukf"])
        rows.append(Row(f"time, ratio to PUKF: {LABEL[f]}", times, 3, round(published.TIME_S[f] / published.TIME_S["pukf"], 3)))
    for what, measure, *_ in kinds:
        for f in FILTERS:
            rows.append(Row(f"one gate for all, {what}, ln: {LABEL[f]}", over(lambda b: measure(b, "one gate", f)), 3))
    for f in ("pukf", "mpukf"):
        rows.append(Row(f"no gate, position, ln: {LABEL[f]}", over(lambda b: position(b, "no gate", f)), 3))
    for what, variant in (("literal", "published"), ("literal, no gate", "no gate"), ("Mahalanobis", "mahalanobis"), ("Mahalanobis, no gate", "mahalanobis, no gate")):
        rows.append(Row(f"updates ended by rule (20), %: {what}", over(lambda b: 100.0 * fired(b, variant)), 2))
    for what, variant in (("no rule", "no rule"), ("Mahalanobis", "mahalanobis")):
        rows.append(Row(f"position, ln: MPUKF, {what}", over(lambda b: position(b, variant, "mpukf")), 3))
    return rows


def lost(items: list[dict]) -> tuple[float, tuple[float, float]]:
    hits = sum(item["targets_lost"] for item in items)
    return hits, share(hits, sum(item["runs_done"] for item in items))


def _policies(batches: list[Batch], *, tight: bool) -> str:
    what = f"no faults, significance {TIGHT:g}" if tight else "as published, significance 0.001"
    header = [f"gate of MPUKF: {what}", "position, ln", "range", "lost", "95 % of its share, %", "rejected, %", "inflated, %", "re-initialised"]
    body = []
    for name in POLICIES:
        items = [batch.policy(name, tight=tight) for batch in batches]
        values = [item["mean_log_mse_position"] for item in items]
        hits, (low, high) = lost(items)
        readings = sum(total(items, key) for key in ("accepted", "rejected", "inflated"))
        parts = [f"{100.0 * total(items, key) / readings:.2f}" for key in ("rejected", "inflated")]
        cells = [name, f"{np.median(values):.3f}", f"{min(values):.3f} .. {max(values):.3f}", f"{hits:.0f} of {RUNS * len(batches)}"]
        body.append([*cells, f"{100.0 * low:.2f} .. {100.0 * high:.2f}", *parts, f"{total(items, 'reinitialised'):.0f}"])
    return tables.table(header, body)


def _covariances(batches: list[Batch]) -> str:
    """NEES a state: 1 where the covariance is that of the error."""
    header = ["NEES / 4, second half", "filter", "mean", "+- 95 %", "steps in their band", "verdict"]
    body = []
    for variant, text in (("own model", "own model: no faults, no gate"), ("own model, gate", "no faults, one gate"), ("published", "as published"), ("one gate", "faults, one gate")):
        for f in FILTERS:
            body.append([text, LABEL[f], *nees_verdict([batch.of[variant][f] for batch in batches])])
    return tables.table(header, body)
