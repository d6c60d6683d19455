# SPDX-License-Identifier: MIT
"""What figures and reports need of a run, collected in the second reading of its log: numbers of the recording, none of their own."""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from meshkal_log.fields import Batch, Header
from meshkal_log.reader import LogError
from meshkal_log.scenario import parse_scenario, positions_of

from ..conversion import Logs, Plan, Wanted
from ..numbers import derive, integrity, navigation, quantiles, tracking
from ..numbers.causes import Causes, fault_text
from ..numbers.faults import FaultChanges
from ..numbers.integrity import Story
from ..numbers.survey import quantities, shade_db
from ..recording import events as departure_events
from ..recording.comparison import Compared
from ..recording.recorder import estimator_names
from ..summary import SUMMARIES, compare
from ..summary.head import Head

# Events that are kept as texts.
_KEPT = 10_000


@dataclass
class Moment:
    """What maps show."""

    seconds: float
    step: int
    shade_db: np.ndarray  # (E,)
    estimate: np.ndarray | None  # (E, 3): positions
    covariance: np.ndarray | None  # (E, p (p + 1) / 2)
    truth: np.ndarray | None  # (3,)
    azimuth_deg: np.ndarray | None  # (N,), and these
    elevation_deg: np.ndarray | None
    weight: np.ndarray | None  # NaN: no reading


@dataclass
class Run:
    plan: Plan
    number: int
    drawn: tuple[int, ...]  # estimators that have lines of their own, the worst first
    names: list[str]  # of all estimators
    seconds: np.ndarray = field(default_factory=lambda: np.zeros(0))
    network: dict[str, dict[str, np.ndarray]] = field(default_factory=dict)  # (T,) by quantity and summary, as in the recording
    each: dict[str, np.ndarray] = field(default_factory=dict)  # (T, len(drawn)) by quantity
    nis_rows: np.ndarray | None = None  # (T,): degrees of freedom of a node's test quantity, the median of those that have some
    path: np.ndarray | None = None  # (T, 3): of the truth
    middle: np.ndarray | None = None  # (T, 3): of the estimates
    axis_error: np.ndarray | None = None  # (T, 3), metres, east, north, up, of a navigation log
    axis_sigma: np.ndarray | None = None
    disagreement: np.ndarray | None = None  # (T,), metres
    consensus: np.ndarray | None = None  # (T, L + 1)
    ratio: dict[str, dict[str, np.ndarray]] = field(default_factory=dict)  # of monitors: (T,) by statistic and place in its band
    alarm_ratio: np.ndarray | None = None  # (T,): the largest that gave an alarm, NaN: there was none
    alarm_count: np.ndarray | None = None  # (T,): estimators in alarm
    spans: dict[str, dict[int, list[list[float]]]] = field(default_factory=dict)  # begins and ends of what was "injected" in and "held" of a sensor
    events: list[tuple[float, str]] = field(default_factory=list)  # the first of them
    event_count: int = 0
    largest: np.ndarray | None = None  # (E,): largest of what nodes are coloured by, dB
    largest_s: np.ndarray | None = None  # and when it was
    moment: Moment | None = None
    tables: dict[str, list[tuple[str, str]]] = field(default_factory=dict)
    title: tuple[str, str] = ("", "")
    comparison: str = ""  # Markdown, of compared logs
    headlines: list[str] = field(default_factory=list)  # Markdown
    warnings: list[str] = field(default_factory=list)
    compared: dict[str, tuple[np.ndarray, dict[str, dict[str, np.ndarray]]]] = field(default_factory=dict)  # seconds and network, by label

    @property
    def header(self) -> Header:
        return self.plan.header


def read(logs: Logs, planned: Plan, wanted: Wanted, time_s: float | None = None) -> Run:
    """time_s: the moment that maps show, the last instant not after it; None: the end. Raises LogError."""
    shown, *others = logs.open()
    reading = _Reading(planned, wanted.run, time_s)
    for batch in shown.reader.batches(wanted.run):
        reading.batch(batch)
    run = reading.finish(shown, others)
    for other in others:
        try:
            run.compared[other.label.text] = _network(other.reader.batches(wanted.run), other.reader.header)
        except LogError as error:
            raise LogError(f"{other.name}: {error}") from None
        run.warnings += [f"{other.name}: {text}" for text in other.reader.warnings]
    return run


def seconds(batch: Batch, header: Header) -> np.ndarray:
    return batch.step * header.dt_s if batch.time_s is None else batch.time_s


def test_band(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where the test quantity of one node with so many degrees of freedom is with probability `tracking.BAND`, if its model is right."""
    tail = (1.0 - tracking.BAND) / 2.0
    degrees = np.maximum(rows, 1)
    return quantiles.chi_square(1.0 - tail, rows) / degrees, quantiles.chi_square(tail, rows) / degrees


class _Reading:
    def __init__(self, planned: Plan, number: int, time_s: float | None) -> None:
        header = planned.header
        self._header, self._scenario, self._time_s = header, planned.scenario, time_s
        named = [0] if header.central else [header.estimator_nodes.index(k) for k in planned.named if k in header.estimator_nodes]
        place = {e: i for i, e in enumerate(planned.found.rank)}
        self._run = Run(planned, number, tuple(sorted(named, key=place.__getitem__)), estimator_names(header))
        self._run.largest, self._run.largest_s = np.full(header.estimators, np.nan), np.full(header.estimators, np.nan)
        self._causes = Causes(header, planned.found.departures.episodes)
        head = Head(header, planned.found, self._causes, self._run.names)
        self._summary = SUMMARIES[header.kind](header, planned.scenario, number, self._run.names, head)
        self._faults, self._story = FaultChanges(header), Story(header)
        self._kept: dict[tuple, list[np.ndarray]] = {}
        self._held, self._changes = integrity.Held(header), {}
        self._begin = self._before = np.nan

    def batch(self, batch: Batch) -> None:
        header, run = self._header, self._run
        times = seconds(batch, header)
        self._begin = times[0] if np.isnan(self._begin) else self._begin
        each, network = quantities(batch, header, self._scenario)
        self._keep("seconds", times)
        for quantity, values in each.items():
            self._keep("each", quantity, values[:, list(run.drawn)])
        for quantity, summaries in network.items():
            for name, row in summaries.items():
                self._keep("network", quantity, name, row)
        rows = np.where(batch.nis_rows > 0, batch.nis_rows, np.nan)
        self._keep("nis_rows", np.floor(np.nan_to_num(derive.quietly(np.nanmedian, rows))))
        if self._scenario.position_states:
            if batch.truth is not None:
                self._keep("path", positions_of(batch.truth, self._scenario.position_states))
            self._keep("middle", tracking.middle(positions_of(batch.estimate, self._scenario.position_states)))
        if header.navigation and batch.truth is not None:
            self._keep("axis_error", navigation.errors(batch, navigation.POSITION))
            if batch.position_covariance is not None:
                self._keep("axis_sigma", navigation.position_sigma(batch))
        if batch.disagreement is not None:
            self._keep("disagreement", derive.finite(batch.disagreement))
        if batch.consensus_disagreement is not None:
            self._keep("consensus", derive.decibels(batch.consensus_disagreement))
        self._worst(times, shade_db(each))
        self._causes.batch(batch)
        events = self._story.batch(batch)
        self._tell([(event.time_s, integrity.text(event, header, run.names)) for event in events])
        self._integrity(times, batch)
        self._summary.batch(batch, each, network, self._fault_entries(times, batch))
        self._summary.integrity.batch(batch, events)
        self._moment(times, batch, each)
        self._before = float(times[-1])

    def finish(self, shown: Compared, others: list[Compared]) -> Run:
        run = self._run
        for path, parts in self._kept.items():
            values = np.concatenate(parts)
            if len(path) == 1:
                setattr(run, path[0], values)
            elif len(path) == 2:
                getattr(run, path[0])[path[1]] = values
            else:
                getattr(run, path[0]).setdefault(path[1], {})[path[2]] = values
        if run.moment is None:
            raise LogError(f"the run is from {self._begin:g} s to {run.seconds[-1]:g} s: there is nothing at {self._time_s:g} s")
        departed = departure_events.entries_of(self._header, run.names, run.plan.found.departures, self._causes)
        # All of them: they are few, and say most.
        run.events += [(second, text) for entries in departed.values() for _, second, text, _ in entries]
        run.event_count += sum(map(len, departed.values()))
        run.events.sort(key=lambda event: event[0])
        run.headlines = self._summary.headlines()
        found = [difference for _, difference in run.plan.compared[1:]]
        for other, difference in zip(others, found):
            self._summary.more += compare.rows(other.label.text, difference)
        if others:
            every = [(log.files, log.label, log.reader.header) for log in (shown, *others)]
            run.comparison = compare.text(every[0], every[1:], found)
        run.tables, run.title, run.warnings = self._summary.tables(shown.reader.end), self._summary.title(), list(shown.reader.warnings)
        return run

    def _keep(self, *path_and_values: object) -> None:
        *path, values = path_and_values
        self._kept.setdefault(tuple(path), []).append(values)

    def _worst(self, times: np.ndarray, shade: np.ndarray) -> None:
        run = self._run
        there = np.flatnonzero(np.isfinite(shade).any(axis=0))
        at = np.nanargmax(shade[:, there], axis=0)
        values = shade[at, there]
        more = ~(values <= run.largest[there])
        run.largest[there[more]], run.largest_s[there[more]] = values[more], times[at[more]]

    def _tell(self, entries: list[tuple[float, str]]) -> None:
        run = self._run
        run.event_count += len(entries)
        run.events += entries[: max(0, _KEPT - len(run.events))]

    def _fault_entries(self, times: np.ndarray, batch: Batch) -> int:
        """As the recording counts and tells them."""
        if self._header.timed:
            return 0
        at, who, masks = self._faults.of(batch)
        self._tell([(float(times[t]), f"{self._run.names[k]}: {fault_text(int(mask))}") for t, k, mask in zip(at, who, masks)])
        return int(np.count_nonzero(masks))

    def _integrity(self, times: np.ndarray, batch: Batch) -> None:
        fault = integrity.faulty_now(batch, self._header)
        if fault is not None:
            self._spans("injected", times, fault != 0.0)
        if not self._header.monitor:
            return
        ratio = integrity.ratios(batch, self._header)
        for key, values in ratio.items():
            for name, row in integrity.band(values).items():
                self._keep("ratio", key, name, row)
        self._keep("alarm_ratio", derive.quietly(np.nanmax, integrity.alarm_ratio(batch, self._header, ratio)))
        self._keep("alarm_count", (batch.monitor_alarm != 0).sum(axis=1))
        self._spans("held", times, self._held.counts(batch) > 0)

    def _spans(self, what: str, times: np.ndarray, there: np.ndarray) -> None:
        """The end is the last instant inside."""
        previous = np.concatenate([[self._before], times[:-1]])
        spans = self._run.spans.setdefault(what, {})
        for at, node in zip(*self._changes.setdefault(what, integrity.Changes(np.zeros(there.shape[1], dtype=bool))).of(there)):
            if there[at, node]:
                spans.setdefault(int(node), []).append([float(times[at]), np.inf])
            else:
                spans[int(node)][-1][1] = float(previous[at])

    def _moment(self, times: np.ndarray, batch: Batch, each: dict[str, np.ndarray]) -> None:
        at = len(times) - 1 if self._time_s is None else int(np.searchsorted(times, self._time_s, side="right")) - 1
        if at < 0:
            return
        states = self._scenario.position_states

        def of(values: np.ndarray | None) -> np.ndarray | None:
            return None if values is None else values[at]

        # A reading's weight where there are weights; else whether there was one.
        weight = None
        if batch.azimuth_deg is not None:
            weight = integrity.read_only(np.ones_like(batch.azimuth_deg) if batch.weight is None else batch.weight, batch)
        self._run.moment = Moment(
            float(times[at]), int(batch.step[at]), shade_db(each)[at],
            positions_of(batch.estimate[at], states) if states else None,
            of(batch.position_covariance),
            positions_of(batch.truth[at], states) if states and batch.truth is not None else None,
            of(batch.azimuth_deg), of(batch.elevation_deg), of(weight),
        )


def _network(batches: Iterator[Batch], header: Header) -> tuple[np.ndarray, dict[str, dict[str, np.ndarray]]]:
    times, kept, scenario = [], {}, parse_scenario(header)
    for batch in batches:
        times.append(seconds(batch, header))
        for quantity, summaries in quantities(batch, header, scenario)[1].items():
            for name, row in summaries.items():
                kept.setdefault(quantity, {}).setdefault(name, []).append(row)
    if not times:
        raise LogError("the log has no step of the run that is shown")
    return np.concatenate(times), {q: {name: np.concatenate(rows) for name, rows in of.items()} for q, of in kept.items()}
