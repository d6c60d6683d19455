# SPDX-License-Identifier: MIT
"""Writes the batches of one run to a rerun recording: times, series, faults. Scene, network and summary have their own files."""

import hashlib
from collections.abc import Sequence

import numpy as np
import rerun as rr

from meshkal_log.fields import LINEAR, NAVIGATION, TRACKING, Batch, Header
from meshkal_log.scenario import Scenario
from ..numbers import agreement, derive
from ..numbers.causes import Causes, fault_text
from ..numbers.faults import FaultChanges
from ..numbers.integrity import Story
from ..numbers.survey import ALL_NAMED, DRAWN_NODES, Survey, quantities
from ..summary import SUMMARIES
from ..summary.head import Head
from . import colours, events
from .agreement import AgreementRecorder
from .integrity import IntegrityRecorder
from .integrity_marks import IntegrityMarks
from .navigation import NavigationRecorder, NavigationScene
from .network import NetworkPicture
from .node import NodeRecorder
from .scene import Scene
from .series import Clock, Series
from .tracking import TrackingRecorder
from .tracking_scene import TrackingScene

BAND_NAME = "5 to 95 % of the nodes"

_SCENES = {LINEAR: Scene, TRACKING: TrackingScene, NAVIGATION: NavigationScene}

_SUMMARY_STYLE = {
    "rms": ("RMS", colours.SUMMARY, 3.0),
    "pooled": ("all nodes together", colours.SUMMARY, 2.5),
    "mean": ("mean", colours.SUMMARY, 2.5),
    "total": ("all nodes together", colours.SUMMARY, 1.5),
    "median": ("median", colours.MIDDLE, 2.0),
    # One name for all three parts of the band, so that they are one line of a legend.
    "low": (BAND_NAME, colours.BAND, 0.7),
    "high": (BAND_NAME, colours.BAND, 0.7),
    "worst": ("largest", colours.WORST, 1.0),
    "largest": ("largest", colours.WORST, 1.0),
}
# Of more than DRAWN_NODES nodes these have an entity of their own for each node, to be drawn on demand; without truth the test quantity stands
# for the error. Of the other quantities all nodes are in one entity, which takes a fifth of the space, besides those that are named.
_SINGLE = ("error_db", "position_error", "nees", "theta")


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


def labels(header: Header, found: Survey) -> list[str]:
    """Names of the estimators for legends, which say who is worst: of few the best, too, where they differ by a hundredth at least."""
    out = estimator_names(header)
    known = [e for e in found.rank if np.isfinite(found.badness[e])]
    if len(known) < 2 or not found.badness[known[0]] > 1.01 * found.badness[known[-1]]:
        return out
    if len(known) <= ALL_NAMED:
        out[known[-1]] += " (best)"
        known = known[:1]
    for e, what in zip(known, ("worst", "2nd worst", "3rd worst", "4th worst", "5th worst")):
        out[e] += f" ({what})"
    return out


def _moved(before: tuple[float, float] | None, now: tuple[float, float] | None) -> bool:
    """By a decibel."""
    return now is not None and (before is None or max(abs(a - b) for a, b in zip(before, now)) > 1.0)


class Recorder:
    """Takes batches in order, then `finish`. Every row is sent in columns: one row at a time is a hundred times slower."""

    def __init__(self, rec: rr.RecordingStream, header: Header, scenario: Scenario, run: int, found: Survey, named: Sequence[int]) -> None:
        self._rec = rec
        self._header, self._scenario = header, scenario
        self._names = estimator_names(header)
        self._palette = colours.Palette(header, named)
        self._colours = self._palette.estimators
        self._name(found, named)
        self._first_row = np.concatenate([[0], np.cumsum(header.rows)])
        self._clock = Clock(header)
        self._shade_range = found.shade_range_db
        self._series = Series(rec, envelope=header.timed)
        self._gaps: dict[str, bool] = {}  # of series, whether their first values have some
        self._fault_changes = FaultChanges(header)
        self._paths = paths = [estimator_path(header, k) for k in range(header.estimators)]
        scene = _SCENES[header.kind]
        self._scene = scene(rec, header, scenario, self._names, self._palette) if scenario.position_states else None
        self._tracking = TrackingRecorder(self._series, self._clock, header, self._palette, paths) if header.tracking else None
        self._navigation = NavigationRecorder(rec, self._series, self._clock, header, self._palette) if header.navigation else None
        # The links of satellites to one receiver say nothing; the sky does.
        self._picture = None if header.navigation else NetworkPicture(rec, header, scenario, found, self._palette, self._labels)
        self._departures = found.departures
        self._causes = Causes(header, found.departures.episodes)
        self._nodes = None if header.navigation else NodeRecorder(self._series, self._clock, header, scenario, found.departures, named, self._palette)
        agrees = agreement.applies(header)
        agreement_of = (rec, self._series, self._clock, header, scenario, self._palette, named, found.steps)
        self._agreement = AgreementRecorder(*agreement_of) if agrees else None
        self._story = Story(header)
        self._integrity = IntegrityRecorder(self._series, self._clock, header, scenario, self._palette, self._names, paths)
        self._marks = IntegrityMarks(rec, self._clock, header, scenario) if header.monitor and self._picture else None
        self._summary = SUMMARIES[header.kind](header, scenario, run, self._names, Head(header, found, self._causes, self._names))
        rec.send_recording_name(f"{scenario.name}: {header.filter}, run {run}")

    def _name(self, found: Survey, named: Sequence[int]) -> None:
        self._palette.name(named)
        self._labels = labels(self._header, found)
        self._is_named = np.isin(np.arange(self._header.estimators), self._palette.named_estimators)

    def rename(self, found: Survey, named: Sequence[int]) -> None:
        """Other nodes are named from now on: of a run that goes on."""
        self._name(found, named)
        self._series.style_again()
        if self._scene:
            self._scene.style_again()
        if self._picture:
            self._picture.style_again(self._labels)
        if self._nodes:
            self._nodes.rename(found.departures, named)
        self._departures, self._summary.head.found = found.departures, found

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
        self._causes.batch(batch)
        if self._nodes:
            self._nodes.batch(times, batch)
        story = self._story.batch(batch)
        self._integrity.batch(times, batch, story)
        if self._marks:
            self._marks.batch(batch)
        if self._agreement:
            self._agreement.batch(times, batch)
        if self._scene:
            self._scene.batch(times, batch)
        if self._picture:
            self._picture.batch(times, batch, each)
        self._summary.batch(batch, each, network, fault_changes)
        self._summary.integrity.batch(batch, story)

    def finish(self, end: str | None, more: Sequence[tuple[str, str]] = ()) -> None:
        """more: further rows of the result in the summary."""
        if self._scene:
            self._scene.finish()
        if self._navigation:
            self._navigation.finish()
        events.send(self._rec, self._clock, self._header, self._names, self._departures, self._causes)
        if self._agreement:
            self._agreement.finish()
        self._summary.more = list(more)
        self._rec.log("summary", rr.TextDocument(self._summary.text(end, self._shade_range if self._picture else None), media_type="text/markdown"), static=True)

    def refresh(self, last: Batch, found: Survey, more: Sequence[tuple[str, str]]) -> None:
        """Of a run that goes on, after its `last` batch: what is known by now. The text is not static: a viewer would keep it for ever."""
        if self._scene:
            self._scene.thin()
        # What the colours mean is static, which viewers and their server keep for ever: it is not sent again for little.
        if self._picture and _moved(self._shade_range, found.shade_range_db):
            self._shade_range = found.shade_range_db
            self._picture.shade(found, self._scenario)
        self._summary.more, self._summary.head.found = list(more), found
        text = self._summary.text("live", self._shade_range if self._picture else None)
        times = self._clock.times(last, slice(-1, None))
        if self._agreement:
            self._agreement.refresh(times)
        self._rec.send_columns("summary", times, rr.TextDocument.columns(text=[text], media_type=["text/markdown"]))

    def _quantities(self, times: list, each: dict, network: dict) -> None:
        for quantity, values in each.items():
            self._estimators(quantity, times, values, single=quantity in (*_SINGLE, *(() if "error_db" in each else ("nis_ratio",))))
            if self._header.estimators == 1:
                network[quantity] = {key: row for key, row in network[quantity].items() if key not in derive.QUANTILES}
            for summary, row in network[quantity].items():
                name, colour, width = _SUMMARY_STYLE[summary]
                draw = self._sparse if quantity == "nis_ratio" else self._drawn
                draw(f"{quantity}/network/{summary}", times, row, names=name, colors=colour, width=width)
            if "low" in network[quantity]:
                low, high = network[quantity]["low"], network[quantity]["high"]
                self._series.band(f"{quantity}/network/band", times, low, high, name=BAND_NAME, color=colours.BAND)
        ones = np.ones(len(each["nis_ratio"]))
        self._series.lines("nis_ratio/expected", times, ones, names="expected: 1", colors=colours.REFERENCE, widths=1.0)

    def _estimators(self, quantity: str, times: list, values: np.ndarray, *, single: bool) -> None:
        """Each in an entity of its own, as far as there are not too many. single: even then."""
        alone = np.arange(len(self._names))
        if len(alone) > DRAWN_NODES and not single:
            self._series.lines(f"{quantity}/nodes", times, values, widths=1.0)
            alone = alone[self._is_named]
        paths = [f"{quantity}/{self._paths[k]}" for k in alone]
        points = quantity == "nis_ratio" and self._header.timed
        for k, path in zip(alone, paths):
            if points and path not in self._gaps:
                self._gaps[path] = not np.isfinite(values[:, k]).all()
            # Those that nobody draws go without: a style takes as long as a line.
            if self._is_named[k] or len(self._names) <= DRAWN_NODES:
                width = 2.5 if self._labels[k].endswith("(worst)") else 1.5 if self._is_named[k] else 1.0
                as_points = points and self._gaps[path]
                style = {"marker_sizes": 1.0 + width} if as_points else {"widths": width}
                archetype = rr.SeriesPoints if as_points else rr.SeriesLines
                self._series.style(path, archetype, names=self._labels[k], colors=self._colours[k], **style)
        self._series.columns(paths, times, values[:, alone])

    def _states(self, times: list, batch: Batch) -> None:
        """One entity a state with all estimators in it: a node in each entity would make states x nodes entities."""
        for i in range(self._header.states):
            estimates = derive.finite(batch.estimate[:, :, i])
            self._series.lines(f"state/{i}/estimates", times, estimates, names=self._names, colors=self._colours, widths=1.0)
            for summary, row in zip(("median", "smallest", "largest"), derive.quantiles(estimates, (0.5, 0.0, 1.0))):
                colour = colours.WORST if summary != "median" else colours.MEDIAN
                self._series.lines(f"state/{i}/network/{summary}", times, row, names=summary, colors=colour, widths=1.5)
            if batch.truth is not None:
                truth = derive.finite(batch.truth[:, i])
                self._series.lines(f"state/{i}/truth", times, truth, names="truth", colors=colours.TRUTH, widths=3.0)

    def _measurements(self, times: list, batch: Batch) -> None:
        header, values = self._header, derive.finite(batch.measurements)
        alone = range(header.nodes)
        if header.nodes > DRAWN_NODES:
            self._series.lines("measurement/nodes", times, values, widths=1.0)
            alone = [k for k in alone if k in self._palette.named]
        for k in alone:
            rows, first = header.rows[k], self._first_row[k]
            if rows:
                name = header.sensor_name(k)
                names = [name if rows == 1 else f"{name}, row {r}" for r in range(rows)]
                style = {"names": names, "colors": np.full(rows, self._palette.nodes[k])}
                self._sparse(f"measurement/{header.sensor_path(k)}", times, values[:, first : first + rows], **style)

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
        """An entry when a node's faults change."""
        at, who, masks = self._fault_changes.of(batch)
        if len(at):
            texts = [f"{self._names[k]}: {fault_text(int(mask))}" for k, mask in zip(who, masks)]
            levels = ["WARN" if mask else "INFO" for mask in masks]
            times = self._clock.times(batch, at)
            self._rec.send_columns("faults", times, rr.TextLog.columns(text=texts, level=levels))
        return int(np.count_nonzero(masks))
