# SPDX-License-Identifier: MIT
"""What the tracking experiments share: their summaries, whether a covariance tells the truth, shares of counts."""

import math
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
from run_logs import record
from scipy import stats
from seeds import folder_of, read_json

STATES = 4
CONFIDENCE = 0.95


def summary(path: Path) -> dict[str, dict]:
    """Filters of a summary by name."""
    return {item["filter"]: item for item in read_json(path)["filters"]}


def interval(values: Iterable[float]) -> tuple[float, float]:
    """Mean of independent batches and the half width of its 95 % confidence interval (Student); one batch has none."""
    array = np.array(list(values))
    if len(array) < 2:
        return float(array.mean()), math.inf
    half = stats.t.ppf(0.5 + CONFIDENCE / 2, len(array) - 1) * array.std(ddof=1) / math.sqrt(len(array))
    return float(array.mean()), float(half)


def share(hits: float, total: float) -> tuple[float, float]:
    """95 % confidence interval of a probability (Clopper and Pearson) of which `hits` of `total` were seen."""
    tail = (1.0 - CONFIDENCE) / 2
    low = stats.beta.ppf(tail, hits, total - hits + 1) if hits > 0 else 0.0
    high = stats.beta.ppf(1.0 - tail, hits + 1, total - hits) if hits < total else 1.0
    return float(low), float(high)


# A filter whose covariance is true has 95 % of its steps in the band. Steps depend on each other: less than this is no chance.
LEAST_INSIDE = 0.9


def nees_verdict(items: list[dict]) -> list[str]:
    """Mean over the batches of the NEES a state, its interval, steps in which a batch's mean is in its band, and what this says. A few
    lost targets make a mean without meaning: then the steps decide."""
    mean, half = interval(item["nees"] / STATES for item in items)
    inside, inside_half = interval(item["nees_steps_inside"] for item in items)
    percent = 100.0 * abs(mean - 1.0)
    if not math.isfinite(half):
        return [f"{mean:.4g}", "-", f"{100.0 * inside:.0f} %", "unknown: one batch"]
    if abs(mean - 1.0) > half:
        verdict = f"{'over-confident' if mean > 1.0 else 'cautious'} by {percent:.2g} %" if percent < 100.0 else f"over-confident, {mean:.3g} times"
    elif inside + inside_half < LEAST_INSIDE:
        verdict = "not consistent: rarely in its band"
    else:
        verdict = "consistent"
    return [f"{mean:.4g}", f"{half:.2g}", f"{100.0 * inside:.0f} %", verdict]


def total(items: list[dict], name: str) -> float:
    return float(sum(item["counts"][name] for item in items))


Change = Callable[[dict], None]


def settings(**changes: object) -> Change:
    """Settings of the filters; of those that are objects themselves only what is named."""

    def apply(scenario: dict) -> None:
        tracking = scenario["tracking"]
        for key, value in changes.items():
            if isinstance(value, dict):
                tracking[key] = tracking.get(key, {}) | value
            elif value is None:
                tracking.pop(key, None)
            else:
                tracking[key] = value

    return apply


def report(out: Path, seeds: range, name: str, load: Callable, tables: Callable, figures: Callable, recorded: Iterable[str]) -> int:
    """Tables, figures and the recording of one run, NAME.rrd, from the files of the batches. 1 if a batch is missing or something that must
    hold does not; all there is to show is shown before."""
    batches, errors = load(out, seeds)
    status = tables(out, batches, errors)
    if batches:
        figures(out, batches)
        folder = folder_of(out, batches[0].seed)
        record([folder / f"{one}.cbor" for one in recorded], out / f"{name}.rrd")
    return status
