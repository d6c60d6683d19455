# SPDX-License-Identifier: MIT
"""The table: published values beside the draws, and every property. Printed, as table.md, and as results.json."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from . import published
from .draws import FILTERS, HORIZON, LARGER_TOLERANCE, Draw
from .networks import mean_degree
from .properties import APART_DB, CLAIM, MUST, Outcome, decibels, evaluate, gap_db, transient_db

SHOWN_SEEDS = 12


@dataclass(frozen=True)
class Row:
    """One quantity over the draws."""

    text: str
    values: dict[int, float]  # by seed
    digits: int
    published: float | None = None
    independent: tuple[float, float, float] | None = None

    def cells(self) -> list[str]:
        values = list(self.values.values())
        low, high = np.min(values), np.max(values)

        def show(value: float) -> str:
            return f"{value:.{self.digits}f}"

        spread = show(low) if show(low) == show(high) else f"{show(low)} .. {show(high)}"
        independent = " / ".join(show(v) for v in self.independent) if self.independent else "-"
        # The paper's own digits.
        return [self.text, f"{self.published:g}" if self.published is not None else "-", show(float(np.median(values))), spread, independent]


def write(out: Path, draws: list[Draw], errors: dict[int, str]) -> int:
    """1 if a draw could not be computed or a property that must hold does not."""
    rows = comparison(draws) if draws else []
    outcomes = evaluate(draws) if draws else []
    text = markdown(rows, outcomes, draws, errors)
    (out / "table.md").write_text(text)
    (out / "results.json").write_text(json.dumps(_as_json(rows, outcomes, draws, errors), indent=1) + "\n")
    print(text)
    return 1 if errors or not draws or any(outcome.breaks for outcome in outcomes) else 0


def comparison(draws: list[Draw]) -> list[Row]:
    def over(measure: Callable[[Draw], float]) -> dict[int, float]:
        return {draw.seed: float(measure(draw)) for draw in draws}

    rows = []
    for f in FILTERS:
        values = over(lambda d: d.least_favourable[f].msd_db)
        rows.append(Row(f"MSD, dB: {f.upper()}", values, 4, published.MSD_DB.get(f), published.INDEPENDENT_MSD_DB.get(f)))
    gain = over(lambda d: gap_db(d.least_favourable, "rkfdnu", "rkfdu"))
    rows.append(Row("gain of RKFDNU over RKFDU, dB", gain, 4, published.GAIN_DB, published.INDEPENDENT_GAIN_DB))
    for f in FILTERS:
        rows.append(Row(f"MSD of the position, dB: {f.upper()}", over(lambda d: d.least_favourable[f].position_msd_db), 4))
    for f in ("rkfc", "rkfdu", "rkfdnu", "rkfdnu2"):
        values = over(lambda d: d.least_favourable[f].mean_tolerance)
        rows.append(Row(f"mean tolerance: {f.upper()}", values, 4, published.TOLERANCE[f], published.INDEPENDENT_TOLERANCE.get(f)))
    for f in ("rkfc", "rkfdu", "rkfdnu", "rkfdnu2"):
        values = over(lambda d: d.least_favourable[f].mean_theta)
        rows.append(Row(f"mean theta: {f.upper()}", values, 4, published.THETA[f], published.INDEPENDENT_THETA.get(f)))
    for f in FILTERS:
        rows.append(Row(f"numbers sent a step by the nodes: {f.upper()}", over(lambda d: d.communication[f]["numbers_sent_per_step"]), 0))
    for f in ("rkfdnu", "rkfdnu2"):
        rows.append(Row(f"numbers sent a step by the centre: {f.upper()}", over(lambda d: d.communication[f]["numbers_from_centre_per_step"]), 0))
    for f in FILTERS:
        rows.append(Row(f"MSD under the nominal model, dB: {f.upper()}", over(lambda d: d.nominal[f].msd_db), 4))
    rows.append(Row("mean number of neighbours, itself included", over(lambda d: mean_degree(d.scenario)), 1))
    rows.append(Row("horizon in whose middle all filters are steady, steps", over(lambda d: d.least_favourable["rkfc"].horizon), 0))
    rows.append(Row(f"reading at t = {HORIZON // 2} of {HORIZON} instead: largest change of an MSD, dB", over(_published_reading_db), 4))
    rows.append(Row(f"last step where RKFDNU2 is {APART_DB:g} dB or more off RKFDNU", over(_last_apart), 0))
    rows.append(Row("largest distance of RKFDNU2 from RKFDNU at any step, dB", over(lambda d: transient_db(d).max()), 4))
    rows.append(Row(f"gap from RKFDNU to RKFDU at c = {LARGER_TOLERANCE:g}, dB", over(lambda d: gap_db(d.larger, "rkfdnu", "rkfdu")), 4))
    rows.append(Row("share of nodes better off with RKFDNU than with RKFDU", over(_better_off), 2))
    return rows


def _published_reading_db(draw: Draw) -> float:
    return max(abs(float(decibels(draw.over_time[f].msd[HORIZON // 2])) - draw.least_favourable[f].msd_db) for f in FILTERS)


def _last_apart(draw: Draw) -> int:
    apart = np.nonzero(transient_db(draw) >= APART_DB)[0]
    return int(apart.max(initial=-1))


def _better_off(draw: Draw) -> float:
    return float(np.mean(decibels(draw.least_favourable["rkfdnu"].node_msd) < decibels(draw.least_favourable["rkfdu"].node_msd)))


def markdown(rows: list[Row], outcomes: list[Outcome], draws: list[Draw], errors: dict[int, str]) -> str:
    parts = [f"# {_count(draws, 'random draw')} of the published experiment\n"]
    if errors:
        parts.append(f"**{_count(errors, 'draw')} could not be computed, in none of the numbers below:**\n")
        parts.append("".join(f"- seed {seed}: {message}\n" for seed, message in errors.items()))
    if not draws:
        return "\n".join(parts)
    parts.append(
        f"Steady values under the least favourable model of RKFC with c = {draws[0].tolerance:g}, unless said otherwise. Tolerances: twice the\n"
        "Kullback-Leibler divergence, nats.\n"
    )
    parts.append(_table(["quantity", "published", "median", "range", "independent: min / median / max"], [row.cells() for row in rows]))
    header = ["property, on every draw", "kind", "holds", "number: median, worst", "fails for seeds"]
    parts.append(_table(header, [_outcome_cells(o) for o in outcomes]))
    broken = sum(outcome.breaks for outcome in outcomes)
    must = [o for o in outcomes if o.property.kind == MUST]
    claims = [o for o in outcomes if o.property.kind == CLAIM]
    false = [o.property.text for o in claims if o.failed]
    parts.append(f"{len(must) - broken} of {len(must)} properties that must hold do, on every draw.\n")
    if false:
        parts.append(f"{len(false)} of {len(claims)} claims of the paper fail on some draw: {'; '.join(false)}.\n")
    return "\n".join(parts)


def _count(things: list | dict, name: str) -> str:
    return f"{len(things)} {name}" + ("" if len(things) == 1 else "s")


def _outcome_cells(outcome: Outcome) -> list[str]:
    p, failed, count = outcome.property, outcome.failed, len(outcome.values)
    verdict = f"all {count}" if not failed else f"**{count - len(failed)} of {count}**"
    seeds = " ".join(map(str, failed[:SHOWN_SEEDS])) + (f" and {len(failed) - SHOWN_SEEDS} more" if len(failed) > SHOWN_SEEDS else "")
    number = f"{p.number}: {outcome.median:.3g}, {outcome.worst:.3g} ({p.sense} {p.limit:g})"
    return [p.text, p.kind, verdict, number, "all" if len(failed) == count else seeds or "-"]


def _table(header: list[str], body: list[list[str]]) -> str:
    """Padded, so that it reads as plain text too."""
    widths = [max(len(line[i]) for line in [header, *body]) for i in range(len(header))]

    def line(cells: list[str]) -> str:
        return "| " + " | ".join(cell.ljust(width) for cell, width in zip(cells, widths)) + " |\n"

    return line(header) + "|" + "|".join("-" * (width + 2) for width in widths) + "|\n" + "".join(map(line, body))


def _as_json(rows: list[Row], outcomes: list[Outcome], draws: list[Draw], errors: dict[int, str]) -> dict:
    return {
        "seeds": [draw.seed for draw in draws],
        "errors": errors,
        "rows": [{"quantity": r.text, "published": r.published, "independent": r.independent, "values": r.values} for r in rows],
        "properties": [
            {"property": o.property.text, "kind": o.property.kind, "number": o.property.number, "sense": o.property.sense}
            | {"limit": o.property.limit, "values": o.values, "failed": o.failed}
            for o in outcomes
        ],
    }
