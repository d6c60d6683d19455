# SPDX-License-Identifier: MIT
"""The first reading of a log: who is worst, and how far values reach, so that what is shown can be chosen before it is written."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import zip_longest

import numpy as np

from meshkal_log.fields import Batch, Header
from meshkal_log.scenario import Scenario

from . import derive, navigation, tracking
from .departures import NETWORK, Departures, Episode, Watch, serious

# More would not be told apart, neither by colour nor in a legend.
ALL_NAMED = 8
NAMED = 5
# The viewer draws a hundred lines in a plot at ease, and a thousand not. Of more nodes only those that are named are drawn one by one.
DRAWN_NODES = 100


@dataclass(frozen=True)
class Survey:
    steps: int
    rank: tuple[int, ...]  # estimators, the worst first, those of which nothing is known last
    badness: np.ndarray  # (E,): RMS of the error; without truth the mean of the test quantity; NaN: unknown
    shade_range_db: tuple[float, float] | None  # of what nodes are coloured by
    has_truth: bool = False  # that is then the error
    departures: Departures = field(default_factory=Departures)  # when nodes went wrong

    @property
    def moment(self) -> Episode | None:
        """When the worst estimator's error departed; if it did not, the most serious departure of all. None if there was none."""
        worst = self.departures.worst(self.rank[0])
        return worst if worst and worst.of_error else max(self.departures.episodes, key=serious, default=None)


def quantities(batch: Batch, header: Header, scenario: Scenario) -> tuple[dict[str, np.ndarray], dict[str, dict[str, np.ndarray]]]:
    """All that is drawn of estimators, (T, E), and what sums up the network, (T,)."""
    each = per_estimator(batch, header, scenario)
    return each, derive.network(batch, each) | tracking.network(each)


def per_estimator(batch: Batch, header: Header, scenario: Scenario) -> dict[str, np.ndarray]:
    each = derive.per_estimator(batch, header)
    if header.navigation:
        each |= navigation.per_estimator(batch, scenario)
    if header.tracking:
        each |= tracking.per_estimator(batch, header, scenario)
    return each


def shade_db(each: dict[str, np.ndarray]) -> np.ndarray:
    """What nodes are coloured by: the error; without truth how far the innovations exceed what a node expects, in dB too."""
    if "position_error" in each:
        return derive.decibels(each["position_error"])
    if "error_db" in each:
        return each["error_db"]
    with np.errstate(divide="ignore", invalid="ignore"):
        return derive.finite(10.0 * np.log10(each["nis_ratio"]))


def survey(batches: Iterable[Batch], header: Header, scenario: Scenario) -> Survey:
    squares, known, steps = np.zeros(header.estimators), np.zeros(header.estimators), 0
    shades, watch = [], Watch(header)
    for batch in batches:
        steps += len(batch.step)
        each = per_estimator(batch, header, scenario)
        watch.batch(batch, each)
        shade = shade_db(each)
        shades.append(shade.astype(np.float32))
        known += np.isfinite(shade).sum(axis=0)
        with np.errstate(over="ignore"):
            squares += np.nansum(10.0 ** (shade / 10.0), axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        mean = squares / known
    has_truth = bool(shades) and ("error_db" in each or "position_error" in each)
    badness = np.sqrt(mean) if has_truth else mean
    values = np.concatenate(shades).ravel() if shades else np.zeros(0)
    values = values[np.isfinite(values)]
    # The extremes are left out: one start-up transient would otherwise paint the rest in one colour.
    span = tuple(float(q) for q in np.percentile(values, [10, 90])) if len(values) else None
    # NaN sorts last; equal ones stay in the order of their numbers.
    return Survey(steps, tuple(int(e) for e in np.argsort(-badness, kind="stable")), badness, span, has_truth, watch.departures())


def unknown(header: Header) -> Survey:
    """Of a run that has only begun."""
    return Survey(0, tuple(range(header.estimators)), np.full(header.estimators, np.nan), None)


def focus(header: Header, found: Survey, wanted: Sequence[int] = ()) -> tuple[int, ...]:
    """Nodes that are named and coloured: those that are wanted, then the worst throughout and those that departed most, the worst first; of few all;
    of a centre its sensors."""
    if header.central:
        return tuple(dict.fromkeys([*wanted, *range(header.nodes)]))
    if header.estimators <= ALL_NAMED:
        return header.estimator_nodes
    departed = [episode.estimator for episode in sorted(found.departures.episodes, key=serious, reverse=True) if episode.estimator != NETWORK]
    departed += [silence.estimator for silence, _ in found.departures.silences]
    departed = list(dict.fromkeys(departed))
    mixed = [e for pair in zip_longest(found.rank, departed) for e in pair if e is not None]
    room = max(NAMED - len(wanted), 0)
    chosen = set([e for e in dict.fromkeys(mixed) if header.estimator_nodes[e] not in wanted][:room])
    return tuple(dict.fromkeys([*wanted, *(header.estimator_nodes[e] for e in found.rank if e in chosen)]))
