# SPDX-License-Identifier: MIT
"""The text beside the pictures of two logs: what differs between them, which one is better, and since when they are not equal."""

import math
from collections.abc import Sequence

import numpy as np

from meshkal_log.fields import Header
from meshkal_log.together import Label, differing
from ..numbers.difference import Difference, Divergence, Extreme
from .linear import db, table

_LARGEST_TABLE = 40
_LISTED = 5
# First what a node computes from nothing but itself and its input.
_NAMES = {
    "truth": "truth", "measurements": "readings", "measurements_arrived": "readings that arrived", "estimates_arrived": "estimates that arrived",
    "messages_arrived": "messages that arrived", "estimate": "estimates", "error": "errors", "variance": "variances",
    "trace_covariance": "trace of the covariance", "position_covariance": "covariance of the position", "theta": "theta", "tolerance": "tolerance",
    "nis": "NIS", "nis_rows": "rows of NIS", "nees": "NEES", "faults": "faults of nodes", "fault": "faults of sensors",
    "innovation": "innovations", "innovation_variance": "variances of innovations", "time_s": "times", "azimuth_deg": "azimuths", "elevation_deg": "elevations",
}


def text(shown: tuple[str, Label, Header], others: Sequence[tuple[str, Label, Header]], found: Sequence[Difference]) -> str:
    """Files, labels and headers, and how each of the others differs from the shown log."""
    parts = [f"# {shown[1].text} beside {', '.join(label.text for _, label, _ in others)}"]
    for other, difference in zip(others, found):
        parts += _one(shown[1].text, other[1].text, difference, several=len(others) > 1)
    every = [shown, *others]
    parts.append(_differing(every))
    for other, difference in zip(others, found):
        parts.append(_divergences(difference, shown[1].text, other[1].text, several=len(others) > 1))
    return "\n\n".join([*parts, _legend(shown[1].text, found)])


def rows(theirs: str, d: Difference) -> list[tuple[str, str]]:
    """For the summary of the shown log: the RMS over all its estimators, of the steps that both logs know it of."""
    if not d.rms_known:
        return []
    squares = d.rms_squares / d.rms_known
    if not d.metres:
        apart = f" = {db(squares[0] / squares[1])}" if squares[1] > 0.0 else ""
        return [(f"RMS error against {theirs}", f"{db(squares[0])} / {db(squares[1])}{apart}")]
    ours, others = np.sqrt(squares)
    ratio = f" = {ours / others:.3f}" if others > 0 else ""
    return [(f"position RMSE against {theirs}", f"{ours:.4g} m / {others:.4g} m{ratio}")]


def _one(mine: str, theirs: str, d: Difference, *, several: bool) -> list[str]:
    parts = [f"## against {theirs}"] if several else []
    parts.append(_verdict(mine, theirs, d))
    rows = []
    known = d.known.sum()
    unit = "position error" if d.metres else "error"
    if known:
        squares = d.squares.sum(axis=1) / known
        for name, square in zip((mine, theirs), squares):
            value = f"{math.sqrt(square):.4g} m ({db(square)})" if d.metres else db(square)
            rows.append((f"RMS {unit}, {name}", value))
    if known and d.equal < d.judged:
        rows.append(("mean difference", _db(d.mean.value)))
        if not math.isnan(d.mean.low):
            rows.append(("its 95 % interval", f"{d.mean.low:+.2g} to {_db(d.mean.high)}"))
        where = "nodes and steps" if len(d.pairing) > 1 else "steps"
        rows.append((f"{where}, {mine} better", _percent(d.better, d.judged) + (f" (equal: {_percent(d.equal, d.judged)})" if d.equal else "")))
        mean = d.mean_db
        if len(mean) > 1 and np.isfinite(mean).any():
            low, high = int(np.nanargmin(mean)), int(np.nanargmax(mean))
            for name, pair in (("lowest", low), ("highest", high)):
                rows.append((f"{name} mean of a node", f"{_db(mean[pair])}, {d.pairing.name(pair)}"))
        if d.worst is not None:
            rows.append(("largest difference", _extreme(d, d.worst)))
            rows.append(("smallest difference", _extreme(d, d.best)))
    if not known:
        rows.append((unit, "not known in both logs"))
    if d.apart_known and d.same_truth is not False:
        unit = " m" if d.metres else ""
        rows.append(("RMS distance of the estimates", f"{math.sqrt(d.apart_squares / d.apart_known):.3g}{unit}"))
        rows.append(("largest distance", f"{d.farthest.value:.3g}{unit}{_where(d, d.farthest)}"))
    estimates = d.quantities.get("estimate")
    if len(d.pairing) > 1 and estimates is not None and 0 < estimates.pairs.sum() < len(d.pairing):
        who = [d.pairing.name(int(pair)) for pair in np.flatnonzero(estimates.pairs)]
        listed = ", ".join(who[:_LISTED]) + (", .." if len(who) > _LISTED else "")
        rows.append(("estimates ever differ of", f"{len(who)} of {len(d.pairing)} nodes: {listed}"))
    alone = "".join(f", {count} only in {name}" for count, name in ((d.only_mine, mine), (d.only_theirs, theirs)) if count)
    rows.append(("steps compared", f"{d.steps}{alone}"))
    return [*parts, table(f"{mine} less {theirs}", rows)]


def _verdict(mine: str, theirs: str, d: Difference) -> str:
    first = d.first_step
    if first is None:
        return f"**Equal bit for bit in all {d.steps} steps**, in everything that both logs have."
    lines = []
    if d.same_truth is False:
        lines.append(f"**The truths differ** (from step {d.quantities['truth'].first}): these are different runs. Their mean errors can be compared, "
                     "single nodes and steps can not, and distances of estimates say nothing.")
    if not math.isnan(d.mean.value):
        size = f"{abs(d.mean.value):.2g} dB"
        if math.isnan(d.mean.low):
            lines.append(f"{mine if d.mean.value < 0 else theirs} has the smaller error, by {size} on average; too few steps for an interval.")
        elif d.mean.low <= 0.0 <= d.mean.high:
            lines.append(f"**No clear difference** of the errors: {_db(d.mean.value)}, 95 % interval {d.mean.low:+.2g} to {_db(d.mean.high)}.")
        else:
            lines.append(f"**{mine if d.mean.value < 0 else theirs} is better**, by {size} on average.")
    what = [_name(key) + (f" ({q.where})" if q.where else "") for key, q in _ordered(d) if q.first == first]
    lines.append(f"The first difference is in step {first}: {', '.join(what[:3])}{', ..' if len(what) > 3 else ''}.")
    return " ".join(lines)


def _db(value: float) -> str:
    return f"{value:+.2g} dB" if abs(value) < 9.95 else f"{value:+.1f} dB"


def _extreme(d: Difference, extreme: Extreme) -> str:
    return f"{_db(extreme.value)}{_where(d, extreme)}"


def _where(d: Difference, extreme: Extreme) -> str:
    return f"{f', {d.pairing.name(extreme.pair)}' if len(d.pairing) > 1 else ''} at step {extreme.step}"


def _percent(part: int, whole: int) -> str:
    return f"{100.0 * part / whole:.1f} %" if whole else "unknown"


def _differing(every: Sequence[tuple[str, Label, Header]]) -> str:
    names = [label.text for _, label, _ in every]
    rows = [("file", [name for name, _, _ in every]), *differing([header for _, _, header in every])]
    lines = [f"| What differs | {' | '.join(names)} |", "|---" * (len(names) + 1) + "|"]
    return "\n".join(lines + [f"| {name} | {' | '.join(values)} |" for name, values in rows])


def _divergences(d: Difference, mine: str, theirs: str, *, several: bool) -> str:
    """All quantities that both logs have, equal ones in one line, and those that only one has."""
    other = theirs if several else ""
    every = _ordered(d)
    equal = [_name(key) for key, q in every if q.first is None]
    lines = [f"| Differs{f' from {other}' if other else ''} | first at step | of steps | largest |", "|---|---|---|---|"]
    for key, q in [(key, q) for key, q in every if q.first is not None][:_LARGEST_TABLE]:
        where = f", {q.where}" if q.where else ""
        largest = "unknown in one" if q.unknown and not q.largest else f"{q.largest:.3g}"
        lines.append(f"| {_name(key)} | {q.first}{where} | {_percent(q.differing, q.steps)} | {largest} |")
    table = "\n".join(lines) if len(lines) > 2 else ""
    alone = [f"Only in {name}: {', '.join(sorted(map(_name, keys)))}." for name, keys in zip((mine, theirs), d.alone) if keys]
    return "\n\n".join([table, *([f"Equal{f' to those of {other}' if other else ''}: {', '.join(equal)}."] if equal else []), *alone])


def _ordered(d: Difference) -> list[tuple[str, Divergence]]:
    order = {key: place for place, key in enumerate(_NAMES)}
    return sorted(d.quantities.items(), key=lambda item: order.get(item[0], len(order)))


def _name(key: str) -> str:
    return _NAMES.get(key, key.replace("_", " "))


def _legend(mine: str, found: Sequence[Difference]) -> str:
    of = "position error" if found[0].metres else "norm of (truth - estimate)"
    of_errors = [
        f"- Difference: error of {mine} less that of the other log, in dB (20 log10 of the {of}), of the same node in the same step. Below 0 (blue) "
        f"{mine} is better, above 0 (orange) the other one. -6 dB is half of the error.",
        "- The mean of the differences in dB weighs all steps alike; the RMS is mostly that of the largest errors. They need not have the same sign.",
        "- The interval takes into account that neighbouring steps depend on each other (batch means).",
        "- A gap: the error of one of them is 0 or unknown.",
    ]
    return "\n".join([
        "**How to read it**", "",
        *(of_errors if any(d.judged for d in found) else []),
        *(["- A centre stands beside each node."] if not all(d.pairing.same_kind for d in found) else []),
        "- Equal is bit for bit; of different precisions: the same number. What only one log has is not compared.",
    ])
