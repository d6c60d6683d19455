# SPDX-License-Identifier: MIT
"""Series, lanes and text of integrity monitors and of weights."""

import numpy as np
import rerun as rr

from meshkal_log.fields import Batch, Header
from meshkal_log.scenario import Scenario
from ..numbers import derive
from ..numbers import integrity
from ..numbers.integrity import STATISTICS, Event, Kind, Share
from ..numbers.tracking import Slots
from . import colours
from .series import Clock, Series

# Above this many slots that are heard, or estimators, only sums of them are drawn; the viewer draws a hundred lines at ease, and a thousand not.
DRAWN_SLOTS = DRAWN_ESTIMATORS = 100
# One lane each; more would be too thin to read. Of more estimators one lane says how many are in alarm.
LANES = 12
_STRIPE = 6.0
_BAND_STYLE = {
    "tenth percentile": (colours.REFERENCE, 1.0),
    "median": (colours.MEDIAN, 2.5),
    "ninetieth percentile": (colours.REFERENCE, 1.0),
    "largest": (colours.WORST, 1.0),
}
_STATISTIC_COLOURS = {"rctm": colours.BOUND, "aime": colours.MEDIAN}
_ALARM_LANE = {Share.NONE: "no alarm", Share.SOME: "some in alarm", Share.HALF: "half or more in alarm", Share.ALL: "alarm"}
_HELD_LANE = {Share.NONE: "in use", Share.SOME: "some hold it faulty", Share.HALF: "half or more hold it faulty", Share.ALL: "held faulty"}
_FAULT_LANE = {Share.NONE: "no fault", Share.ALL: "fault"}
_LEVELS = {Kind.FAULT: "INFO", Kind.FAULT_OVER: "INFO", Kind.ALARM: "WARN", Kind.ALARM_OVER: "INFO", Kind.HELD: "ERROR", Kind.RETURNED: "INFO",
           Kind.ENDED: "WARN"}


class IntegrityRecorder:
    def __init__(self, series: Series, clock: Clock, header: Header, scenario: Scenario, palette: colours.Palette, names: list[str], paths: list[str]) -> None:
        """names, paths: of the estimators."""
        self._series, self._clock, self._header = series, clock, header
        self._names, self._paths, self._jump = names, paths, scenario.jump
        self._slots, self._held = Slots(header), integrity.Held(header)
        self._node_colours, self._colours = palette.nodes, palette.estimators
        self._few = header.estimators <= DRAWN_ESTIMATORS
        self._lanes: dict[str, integrity.Changes] = {}
        self._start: list | None = None  # time of the first step: where lanes begin

    def batch(self, times: list, batch: Batch, events: list[Event]) -> None:
        if self._start is None:
            self._start = self._clock.times(batch, slice(0, 1))
        fault = integrity.faulty_now(batch, self._header)
        if fault is not None:
            self._faults(times, batch, fault)
        if batch.weight is not None:
            weight = integrity.read_only(batch.weight, batch)
            self._per_slot("weight", times, weight, np.nanmin)
            self._weight_map(times, weight)
        if batch.weight_statistic is not None:
            self._per_slot("weight_statistic", times, integrity.read_only(batch.weight_statistic, batch), np.nanmax)
        if self._header.monitor:
            self._statistics(times, batch)
            self._ends(times, batch)
            self._per_slot("isolation", times, derive.finite(batch.isolation), np.nanmax)
            if batch.end_ratio is not None:
                self._per_slot("end_ratio", times, derive.finite(batch.end_ratio), np.nanmax)
                ones = np.ones(len(batch.step))
                self._series.lines("end_ratio/decision", times, ones, names="decision: 1", colors=colours.REFERENCE, widths=1.0)
            self._monitor_lanes(batch)
        self._words(batch, events)

    def _statistics(self, times: list, batch: Batch) -> None:
        """The log's statistics and threshold, and ratios of the first to the second, which estimators of other sensors have in common."""
        ratio = integrity.ratios(batch, self._header)
        ones = np.ones(len(batch.step))
        self._series.lines("monitor_ratio/threshold", times, ones, names="threshold: 1", colors=colours.LIMIT_LINE, widths=2.0)
        for key, name in STATISTICS.items():
            self._each(f"monitor_ratio/{key}", times, ratio[key], name, _STATISTIC_COLOURS[key])
            self._each(f"monitor_statistic/{key}", times, derive.finite(getattr(batch, f"monitor_{key}")), name, _STATISTIC_COLOURS[key])
            self._band(f"monitor_ratio/{key}", times, ratio[key])
        threshold = derive.finite(batch.monitor_threshold)
        self._each("monitor_statistic/threshold", times, np.where(threshold > 0.0, threshold, np.nan), "threshold", colours.LIMIT_LINE)
        if self._few:
            marked = integrity.alarm_ratio(batch, self._header, ratio)
            for e, path in enumerate(self._paths):
                self._marks(f"monitor_ratio/alarm/{path}", batch, marked[:, e], f"{self._names[e]}: alarm", "cross", colours.WORST)
                # On the line of the threshold: the window may be empty then, and have no statistic.
                over = np.where(batch.monitor_ended[:, e] != 0, 1.0, np.nan)
                name = f"{self._names[e]}: fault declared over"
                self._marks(f"monitor_ratio/ended/{path}", batch, over, name, "diamond", colours.TRUTH, size=6.0)

    def _ends(self, times: list, batch: Batch) -> None:
        """Of `aime-improved`: a fault is over where rho is above its limit, the median and the jump."""
        if batch.monitor_rho is None:
            return
        rho, median = derive.finite(batch.monitor_rho), derive.finite(batch.monitor_median)
        self._each("monitor_rho/rho", times, rho, "rho", colours.MEDIAN)
        self._each("monitor_rho/median", times, median, "median of the last three", colours.BOUND)
        if self._header.estimators == 1:
            style = {"names": f"median + {self._jump:g}", "colors": colours.LIMIT_LINE, "widths": 1.0}
            self._series.lines("monitor_rho/limit", times, median[:, 0] + self._jump, **style)
        self._band("monitor_rho/rho", times, rho)

    def _each(self, path: str, times: list, values: np.ndarray, name: str, colour: int) -> None:
        for e, estimator in enumerate(self._paths):
            alone = self._header.estimators == 1
            style = {"names": name if alone else self._names[e], "colors": colour if alone else self._colours[e], "widths": 2.0 if alone else 1.0}
            self._series.lines(f"{path}/{estimator}", times, values[:, e], **style)

    def _band(self, path: str, times: list, values: np.ndarray) -> None:
        if self._header.estimators == 1:
            return
        for name, row in integrity.band(values).items():
            colour, width = _BAND_STYLE[name]
            self._series.lines(f"{path}/network/{name.replace(' ', '_')}", times, row, names=name, colors=colour, widths=width)

    def _marks(self, path: str, batch: Batch, values: np.ndarray, name: str, marker: str, colour: int, size: float = 4.0) -> None:
        at = np.flatnonzero(np.isfinite(values))
        if len(at):
            style = {"names": name, "colors": colour, "markers": marker, "marker_sizes": size}
            self._series.points(path, self._clock.times(batch, at), values[at], **style)

    def _per_slot(self, quantity: str, times: list, values: np.ndarray, worst: object) -> None:
        """A line for each sensor at each estimator; if these are too many, of each sensor the worst; if sensors are too many, of all."""
        values = values[:, self._slots.at]
        if len(self._slots.at) <= DRAWN_SLOTS:
            for i, (e, node) in enumerate(zip(self._slots.estimator, self._slots.node)):
                sensor = self._header.sensor_path(node)
                path = f"{quantity}/{sensor}" if self._header.central else f"{quantity}/{self._paths[e]}/sensor/{node}"
                name = self._header.sensor_name(node) + ("" if self._header.central else f" at {self._names[e]}")
                self._series.lines(path, times, values[:, i], names=name, colors=self._node_colours[node], widths=1.5)
        elif self._header.nodes <= DRAWN_SLOTS:
            for node in np.unique(self._slots.node):
                row = derive.quietly(worst, values[:, self._slots.node == node])
                style = {"names": self._header.sensor_name(node), "colors": self._node_colours[node], "widths": 1.5}
                self._series.lines(f"{quantity}/network/{self._header.sensor_path(node)}", times, row, **style)
        else:
            self._series.lines(f"{quantity}/network/all", times, derive.quietly(worst, values), names="all", colors=colours.WORST, widths=1.5)

    def _weight_map(self, times: list, weight: np.ndarray) -> None:
        """Of a centre a stripe for each sensor, as high as its number, in the colour of its weight: lines of many that jump hide each other."""
        if not self._header.central or self._header.nodes > DRAWN_SLOTS:
            return
        painted = colours.scale_colours(1.0 - weight[:, self._slots.at], 0.0, 1.0)
        for i, node in enumerate(self._slots.node):
            path, height = f"weight_map/{self._header.sensor_path(node)}", float(self._header.sensor_number(node))
            if self._series.first(path):
                self._series.rec.log(path, rr.SeriesLines(names=self._header.sensor_name(node), widths=_STRIPE), static=True)
            columns = rr.Scalars.columns(scalars=np.full(len(weight), height))
            self._series.rec.send_columns(path, times, [*columns, *rr.SeriesLines.columns(colors=painted[:, i])])

    def _faults(self, times: list, batch: Batch, fault: np.ndarray) -> None:
        for node in range(self._header.nodes):
            path, name = f"fault/{self._header.sensor_path(node)}", self._header.sensor_name(node)
            if (fault[:, node] != 0.0).any() or self._series.has(path):
                self._series.lines(path, times, fault[:, node], names=name, colors=self._node_colours[node], widths=2.0)
        states = np.where(fault != 0.0, Share.ALL.value, Share.NONE.value)
        for node in range(self._header.nodes):
            self._lane(f"integrity/injected/{self._header.sensor_path(node)}", batch, states[:, node], _FAULT_LANE, colours.BOUND)

    def _monitor_lanes(self, batch: Batch) -> None:
        alarm = batch.monitor_alarm != 0
        every = integrity.shares(alarm.sum(axis=1), self._header.estimators)
        if self._header.estimators <= LANES:
            for e, path in enumerate(self._paths):
                states = np.where(alarm[:, e], Share.ALL.value, Share.NONE.value)
                self._lane(f"integrity/alarm/{path}", batch, states, _ALARM_LANE, colours.WORST, always=self._header.estimators == 1)
        else:
            self._lane("integrity/alarm/network", batch, every, _ALARM_LANE, colours.WORST, always=True)
        counts = self._held.counts(batch)
        for node in np.flatnonzero(self._held.heard):
            states = integrity.shares(counts[:, node], self._held.heard[node])
            self._lane(f"integrity/held/{self._header.sensor_path(node)}", batch, states, _HELD_LANE, colours.WORST)

    def _lane(self, path: str, batch: Batch, states: np.ndarray, names: dict, colour: int, *, always: bool = False) -> None:
        """A lane appears when there is something to say, and then begins with the run. always: at once."""
        changes = self._lanes.setdefault(path, integrity.Changes(np.array([Share.NONE.value])))
        at, _ = changes.of(states[:, None])
        if not len(at) and not always:
            return
        if self._series.first(path):
            values = list(names.values())
            painted = [colours.QUIET, colours.SOME, colours.MANY, colour] if len(values) == len(Share) else [colours.QUIET, colour]
            self._series.rec.log(path, rr.StateConfiguration(values=values, labels=values, colors=np.array(painted, dtype=np.uint32)), static=True)
            self._series.rec.send_columns(path, self._start, rr.StateChange.columns(state=[names[Share.NONE]]))
        if len(at):
            words = [names[Share(state)] for state in states[at]]
            self._series.rec.send_columns(path, self._clock.times(batch, at), rr.StateChange.columns(state=words))

    def _words(self, batch: Batch, events: list[Event]) -> None:
        if events:
            at = np.array([event.at for event in events])
            texts, levels = [integrity.text(event, self._header, self._names) for event in events], [_LEVELS[event.kind] for event in events]
            self._series.rec.send_columns("integrity_events", self._clock.times(batch, at), rr.TextLog.columns(text=texts, level=levels))
