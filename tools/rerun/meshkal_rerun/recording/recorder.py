# SPDX-License-Identifier: MIT
"""Writes the batches of one run to a rerun recording: times, series, faults. Scene, network and summary have their own files."""

import hashlib
from collections.abc import Sequence

import numpy as np
import rerun as rr

from meshkal_log.fields import LINEAR, NAVIGATION, TRACKING, Batch, Header
from meshkal_log.scenario import Scenario
from ..numbers import agreement, derive
from ..numbers.integrity import Story
from ..numbers.survey import Survey, quantities
from ..summary.linear import Summary
from ..summary.navigation import NavigationSummary
from ..summary.tracking import TrackingSummary
from . import colours
from .agreement import AgreementRecorder
from .integrity import IntegrityRecorder
from .integrity_marks import IntegrityMarks
from .navigation import NavigationRecorder, NavigationScene
from .network import NetworkGraph
from .scene import Scene
from .series import Clock, Series
from .tracking import TrackingRecorder
from .tracking_scene import TrackingScene

# The bits of meshkal/rkfd.h.
_FAULTS = {0: "measurement missing", 1: "estimate missing", 2: "input refused", 3: "no measurement at all"}
# With lossy links the first two come and go at every step; they are drawn as counts and would bury the others here.
_LOGGED = np.uint32(0xFFFFFFFF & ~0b11)

_SCENES = {LINEAR: Scene, TRACKING: TrackingScene, NAVIGATION: NavigationScene}
_SUMMARIES = {LINEAR: Summary, TRACKING: TrackingSummary, NAVIGATION: NavigationSummary}

_SUMMARY_STYLE = {
    "rms": (colours.SUMMARY, 3.0),
    "pooled": (colours.SUMMARY, 3.0),
    "mean": (colours.SUMMARY, 3.0),
    "total": (colours.SUMMARY, 3.0),
    "median": (colours.MEDIAN, 2.0),
    "worst": (colours.WORST, 1.5),
    "largest": (colours.WORST, 1.5),
}


def recording_id(header: Header, run: int, compared: Sequence[str] = ()) -> str:
    """The same run gives the same id. compared: ids of other logs beside it. The viewer merges recordings of equal id, so everything that makes a run differ is in it."""
    rest = (header.program, header.real, header.source, header.steps, header.loss, header.dt_s)
    if header.estimator_nodes != tuple(range(header.nodes)) and not header.central:
        rest += header.estimator_nodes
    if header.tracking:
        rest += (header.start_s, header.iterations, header.protocol, header.increments, header.gate)
    if header.navigation:
        rest += (header.start_s, header.satellites)
    if header.monitor:
        rest += (header.monitor, header.monitor_window, header.monitor_false_alarm)
    rest += tuple(compared)
    digest = hashlib.sha256(repr(rest).encode()).hexdigest()[:8]
    return f"{header.scenario_sha256[:16]}-{header.filter}-seed{header.seed}-run{run}-{digest}"


def estimator_path(header: Header, k: int) -> str:
    return "centre" if header.central else f"node/{header.estimator_nodes[k]}"


def estimator_names(header: Header) -> list[str]:
    return ["centre"] if header.central else [f"node {k}" for k in header.estimator_nodes]


class Recorder:
    """Takes batches in order, then `finish`. Every row is sent in columns: one row at a time is a hundred times slower."""

    def __init__(self, rec: rr.RecordingStream, header: Header, scenario: Scenario, run: int, found: Survey, named: Sequence[int]) -> None:
        self._rec = rec
        self._header, self._scenario = header, scenario
        self._names = estimator_names(header)
        self._palette = colours.Palette(header, named)
        self._colours = self._palette.estimators
        self._clock = Clock(header)
        self._shade_range = found.shade_range_db
        self._series = Series(rec, envelope=header.timed)
        self._gaps: dict[str, bool] = {}  # of series, whether their first values have some
        self._last_faults = np.zeros(header.estimators, dtype=np.uint32)
        paths = [estimator_path(header, k) for k in range(header.estimators)]
        scene = _SCENES[header.kind]
        self._scene = scene(rec, header, scenario, self._names, self._palette) if scenario.position_states else None
        self._tracking = TrackingRecorder(self._series, self._clock, header, self._palette, paths) if header.tracking else None
        self._navigation = NavigationRecorder(rec, self._series, self._clock, header, self._palette) if header.navigation else None
        # The links of satellites to one receiver say nothing; the sky does.
        self._graph = None if header.navigation else NetworkGraph(rec, header, scenario, found.shade_range_db)
        agrees = agreement.applies(header)
        agreement_of = (rec, self._series, self._clock, header, scenario, self._palette, named, found.steps)
        self._agreement = AgreementRecorder(*agreement_of) if agrees else None
        self._story = Story(header)
        self._integrity = IntegrityRecorder(self._series, self._clock, header, scenario, self._palette, self._names, paths)
        self._marks = IntegrityMarks(rec, self._clock, header, scenario) if header.monitor and self._graph else None
        self._summary = _SUMMARIES[header.kind](header, scenario, run, self._names)
        rec.send_recording_name(f"{scenario.name}: {header.filter}, run {run}")

    def batch(self, batch: Batch) -> None:
        times = self._clock.times(batch)
        each, network = quantities(batch, self._header, self._scenario)
        if self._navigation:
            self._navigation.batch(times, batch)
        if self._tracking:
            self._tracking.batch(times, batch)
        self._quantities(times, each, network)
        self._states(times, batch)
        self._measurements(times, batch)
        # What became of readings says more than these, and is drawn for every sensor.
        fault_changes = 0 if self._header.timed else self._faults(batch)
        events = self._story.batch(batch)
        self._integrity.batch(times, batch, events)
        if self._marks:
            self._marks.batch(batch)
        if self._agreement:
            self._agreement.batch(times, batch)
        if self._scene:
            self._scene.batch(times, batch)
        if self._graph:
            self._graph.batch(times, each)
        self._summary.batch(batch, each, network, fault_changes)
        self._summary.integrity.batch(batch, events)

    def finish(self, end: str | None, more: Sequence[tuple[str, str]] = ()) -> None:
        """more: further rows of the result in the summary."""
        if self._scene:
            self._scene.finish()
        if self._navigation:
            self._navigation.finish()
        if self._agreement:
            self._agreement.finish()
        self._summary.more += more
        self._rec.log("summary", rr.TextDocument(self._summary.text(end, self._shade_range if self._graph else None), media_type="text/markdown"), static=True)

    def _quantities(self, times: list, each: dict, network: dict) -> None:
        for quantity, values in each.items():
            draw = self._sparse if quantity == "nis_ratio" else self._drawn
            for k, name in enumerate(self._names):
                path = f"{quantity}/{estimator_path(self._header, k)}"
                draw(path, times, values[:, k], width=1.0, names=name, colors=self._colours[k])
            for summary, row in network[quantity].items():
                colour, width = _SUMMARY_STYLE[summary]
                draw(f"{quantity}/network/{summary}", times, row, names=summary, colors=colour, width=width)
        ones = np.ones(len(each["nis_ratio"]))
        self._series.lines("nis_ratio/expected", times, ones, names="expected: 1", colors=colours.REFERENCE, widths=1.0)

    def _states(self, times: list, batch: Batch) -> None:
        """One entity a state with all estimators in it: a node in each entity would make states x nodes entities."""
        for i in range(self._header.states):
            estimates = derive.finite(batch.estimate[:, :, i])
            self._series.lines(f"state/{i}/estimates", times, estimates, names=self._names, colors=self._colours, widths=1.0)
            for summary, function in (("median", np.nanmedian), ("smallest", np.nanmin), ("largest", np.nanmax)):
                row = derive.quietly(function, estimates)
                colour = colours.WORST if summary != "median" else colours.MEDIAN
                self._series.lines(f"state/{i}/network/{summary}", times, row, names=summary, colors=colour, widths=1.5)
            if batch.truth is not None:
                truth = derive.finite(batch.truth[:, i])
                self._series.lines(f"state/{i}/truth", times, truth, names="truth", colors=colours.TRUTH, widths=3.0)

    def _measurements(self, times: list, batch: Batch) -> None:
        first = 0
        for k, rows in enumerate(self._header.rows):
            values = derive.finite(batch.measurements[:, first : first + rows])
            first += rows
            if rows:
                name = self._header.sensor_name(k)
                names = [name if rows == 1 else f"{name}, row {r}" for r in range(rows)]
                self._sparse(f"measurement/{self._header.sensor_path(k)}", times, values, names=names, colors=np.full(rows, self._palette.nodes[k]))

    def _drawn(self, path: str, times: list, values: np.ndarray, *, width: float, **style: object) -> None:
        self._series.lines(path, times, values, widths=width, **style)

    def _sparse(self, path: str, times: list, values: np.ndarray, *, width: float = 1.0, **style: object) -> None:
        """What a tracking log does not have in every step is drawn as points: a line between gaps would not be seen. Lines are quicker."""
        if path not in self._gaps:
            self._gaps[path] = self._header.timed and not np.isfinite(values).all()
        if self._gaps[path]:
            self._series.points(path, times, values, marker_sizes=1.0 + width, **style)
        else:
            self._drawn(path, times, values, width=width, **style)

    def _faults(self, batch: Batch) -> int:
        """An entry when a node's faults change: a lasting fault would otherwise fill the log with the same line."""
        faults = batch.faults & _LOGGED
        before = np.vstack([self._last_faults, faults[:-1]])
        self._last_faults = faults[-1]
        at, who = np.nonzero(faults != before)
        masks = faults[at, who]
        if len(at):
            texts = [f"{self._names[k]}: {fault_text(int(mask))}" for k, mask in zip(who, masks)]
            levels = ["WARN" if mask else "INFO" for mask in masks]
            times = self._clock.times(batch, at)
            self._rec.send_columns("faults", times, rr.TextLog.columns(text=texts, level=levels))
        return int(np.count_nonzero(masks))


def fault_text(mask: int) -> str:
    return ", ".join(_FAULTS.get(bit, f"fault bit {bit}") for bit in range(32) if mask >> bit & 1) or "faults over"
