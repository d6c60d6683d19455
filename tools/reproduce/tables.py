# SPDX-License-Identifier: MIT
"""The table: values beside the draws, and every property. Printed, as table.md, and as results.json."""

import json
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from statements import CLAIM, MUST, Outcome

SHOWN_SEEDS = 12


@dataclass(frozen=True)
class Row:
    """One quantity over the draws. Beside it what was published, and what an independent reproduction says: a number or more."""

    text: str
    values: dict[int, float]  # by seed
    digits: int
    published: float | None = None
    independent: tuple[float, ...] | None = None

    def cells(self) -> list[str]:
        values = list(self.values.values())
        low, high = np.min(values), np.max(values)

        def show(value: float) -> str:
            return f"{value:.{self.digits}f}" if self.digits >= 0 else f"{value:.3g}"

        spread = show(low) if show(low) == show(high) else f"{show(low)} .. {show(high)}"
        independent = " / ".join(show(v) for v in self.independent) if self.independent else "-"
        # The paper's own digits.
        return [self.text, f"{self.published:g}" if self.published is not None else "-", show(float(np.median(values))), spread, independent]


@dataclass(frozen=True)
class Report:
    title: str
    intro: str
    independent: str  # heading of what the independent reproduction says
    rows: list[Row]
    outcomes: list[Outcome]
    seeds: list[int]
    errors: dict[int, str]
    one: str = "draw"  # name of what a seed gives
    extra: list[str] = field(default_factory=list)  # more tables or text, after the rows
    facts: dict = field(default_factory=dict)  # more for results.json


def write(out: Path, report: Report) -> int:
    """1 if a draw could not be computed or a property that must hold does not."""
    text = markdown(report)
    (out / "table.md").write_text(text)
    (out / "results.json").write_text(json.dumps(_as_json(report), indent=1) + "\n")
    print(text)
    return 1 if report.errors or not report.seeds or any(outcome.breaks for outcome in report.outcomes) else 0


def markdown(report: Report) -> str:
    outcomes, errors, one = report.outcomes, report.errors, report.one
    parts = [f"# {report.title}\n"]
    if errors:
        parts.append(f"**{count(errors, one)} could not be computed, in none of the numbers below:**\n")
        parts.append("".join(f"- seed {seed}: {message}\n" for seed, message in errors.items()))
    if not report.seeds:
        return "\n".join(parts)
    parts.append(report.intro)
    parts.append(table(["quantity", "published", "median", "range", report.independent], [row.cells() for row in report.rows]))
    parts += report.extra
    header = [f"property, on every {one}", "kind", "holds", "number: median, worst", "fails for seeds"]
    parts.append(table(header, [_outcome_cells(o) for o in outcomes]))
    broken = sum(outcome.breaks for outcome in outcomes)
    must = [o for o in outcomes if o.property.kind == MUST]
    claims = [o for o in outcomes if o.property.kind == CLAIM]
    false = [o.property.text for o in claims if o.failed]
    parts.append(f"{len(must) - broken} of {len(must)} properties that must hold do, on every {one}.\n")
    if false:
        parts.append(f"{len(false)} of {len(claims)} claims of the paper fail on some {one}: {'; '.join(false)}.\n")
    return "\n".join(parts)


def count(things: list | dict, name: str) -> str:
    return f"{len(things)} {name}" + ("" if len(things) == 1 else "es" if name.endswith("ch") else "s")


def _outcome_cells(outcome: Outcome) -> list[str]:
    p, failed, number_of = outcome.property, outcome.failed, len(outcome.values)
    verdict = f"all {number_of}" if not failed else f"**{number_of - len(failed)} of {number_of}**"
    seeds = " ".join(map(str, failed[:SHOWN_SEEDS])) + (f" and {len(failed) - SHOWN_SEEDS} more" if len(failed) > SHOWN_SEEDS else "")
    number = f"{p.number}: {outcome.median:.3g}, {outcome.worst:.3g} ({p.sense} {p.limit:g})"
    return [p.text, p.kind, verdict, number, "all" if len(failed) == number_of else seeds or "-"]


def table(header: list[str], body: list[list[str]]) -> str:
    """Padded, so that it reads as plain text too."""
    widths = [max(len(line[i]) for line in [header, *body]) for i in range(len(header))]

    def line(cells: list[str]) -> str:
        return "| " + " | ".join(cell.ljust(width) for cell, width in zip(cells, widths)) + " |\n"

    return line(header) + "|" + "|".join("-" * (width + 2) for width in widths) + "|\n" + "".join(map(line, body))


def _as_json(report: Report) -> dict:
    return {
        "seeds": report.seeds,
        "errors": report.errors,
        "rows": [{"quantity": r.text, "published": r.published, "independent": r.independent, "values": r.values} for r in report.rows],
        "properties": [
            {"property": o.property.text, "kind": o.property.kind, "number": o.property.number, "sense": o.property.sense}
            | {"limit": o.property.limit, "values": o.values, "failed": o.failed}
            for o in report.outcomes
        ],
    } | report.facts
