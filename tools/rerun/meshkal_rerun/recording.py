# SPDX-License-Identifier: MIT
"""Writes the batches of one run to a rerun recording: times, series, faults. Scene, network and summary have their own files."""

import hashlib

import numpy as np
import rerun as rr

from . import colours, derive
from .network import NetworkGraph
from .reader import Batch, Header, LogError
from .scenario import Scenario
from .scene import Scene
from .summary import Summary

_LARGEST_NS = (1 << 63) - 1

# The bits of meshkal/rkfd.h.
_FAULTS = {0: "measurement missing", 1: "estimate missing", 2: "input refused", 3: "no measurement at all"}
# With lossy links the first two come and go at every step; they are drawn as counts and would bury the others here.
_LOGGED = np.uint32(0xFFFFFFFF & ~0b11)

_SUMMARY_STYLE = {
    "rms": (colours.SUMMARY, 3.0),
    "pooled": (colours.SUMMARY, 3.0),
    "total": (colours.SUMMARY, 3.0),
    "median": (colours.MEDIAN, 2.0),
    "worst": (colours.WORST, 1.5),
    "largest": (colours.WORST, 1.5),
}


def recording_id(header: Header, run: int) -> str:
    """The same run gives the same id. The viewer merges recordings of equal id, so everything that makes a run differ is in it."""
    rest = (header.program, header.real, header.source, header.steps, header.loss, header.dt_s)
    if header.estimator_nodes != tuple(range(header.nodes)) and not header.central:
        rest += header.estimator_nodes
    digest = hashlib.sha256(repr(rest).encode()).hexdigest()[:8]
    return f"{header.scenario_sha256[:16]}-{header.filter}-seed{header.seed}-run{run}-{digest}"


def estimator_path(header: Header, k: int) -> str:
    return "centre" if header.central else f"node/{header.estimator_nodes[k]}"


def estimator_names(header: Header) -> list[str]:
    return ["centre"] if header.central else [f"node {k}" for k in header.estimator_nodes]


class Recorder:
    """Takes batches in order, then `finish`. Every row is sent in columns: one row at a time is a hundred times slower."""

    def __init__(self, rec: rr.RecordingStream, header: Header, scenario: Scenario, run: int) -> None:
        self._rec = rec
        self._header = header
        self._names = estimator_names(header)
        each = colours.node_colours(header.nodes)
        self._colours = colours.node_colours(1) if header.central else each[list(header.estimator_nodes)]
        self._styled: set[str] = set()
        self._last_faults = np.zeros(header.estimators, dtype=np.uint32)
        self._scene = Scene(rec, header, scenario, self._names, self._colours) if scenario.position_states else None
        self._graph = NetworkGraph(rec, header, scenario)
        self._summary = Summary(header, scenario, run, self._names)
        rec.send_recording_name(f"{scenario.name}: {header.filter}, run {run}")

    def batch(self, batch: Batch) -> None:
        times = time_columns(batch.step, self._header.dt_s)
        quantities = derive.per_estimator(batch, self._header)
        network = derive.network(batch, quantities)
        self._quantities(times, quantities, network)
        self._states(times, batch)
        self._measurements(times, batch)
        fault_changes = self._faults(batch)
        if self._scene:
            self._scene.batch(times, batch)
        self._graph.batch(batch.step, quantities)
        self._summary.batch(batch, quantities, network, fault_changes)

    def finish(self, end: str | None) -> None:
        if self._scene:
            self._scene.finish()
        colour_range = self._graph.finish(lambda step: time_columns(step, self._header.dt_s))
        self._rec.log("summary", rr.TextDocument(self._summary.text(end, colour_range), media_type="text/markdown"), static=True)

    def _quantities(self, times: list, quantities: dict, network: dict) -> None:
        for quantity, values in quantities.items():
            for k, name in enumerate(self._names):
                path = f"{quantity}/{estimator_path(self._header, k)}"
                self._series(path, times, values[:, k], names=name, colors=self._colours[k], widths=1.0)
            for summary, row in network[quantity].items():
                colour, width = _SUMMARY_STYLE[summary]
                self._series(f"{quantity}/network/{summary}", times, row, names=summary, colors=colour, widths=width)
        ones = np.ones(len(quantities["nis_ratio"]))
        self._series("nis_ratio/expected", times, ones, names="expected: 1", colors=colours.REFERENCE, widths=1.0)

    def _states(self, times: list, batch: Batch) -> None:
        """One entity a state with all estimators in it: a node in each entity would make states x nodes entities."""
        for i in range(self._header.states):
            estimates = derive.finite(batch.estimate[:, :, i])
            self._series(f"state/{i}/estimates", times, estimates, names=self._names, colors=self._colours, widths=1.0)
            for summary, function in (("median", np.nanmedian), ("smallest", np.nanmin), ("largest", np.nanmax)):
                row = derive.quietly(function, estimates)
                colour = colours.WORST if summary != "median" else colours.MEDIAN
                self._series(f"state/{i}/network/{summary}", times, row, names=summary, colors=colour, widths=1.5)
            if batch.truth is not None:
                truth = derive.finite(batch.truth[:, i])
                self._series(f"state/{i}/truth", times, truth, names="truth", colors=colours.TRUTH, widths=3.0)

    def _measurements(self, times: list, batch: Batch) -> None:
        first = 0
        node_colours = colours.node_colours(self._header.nodes)
        for k, rows in enumerate(self._header.rows):
            values = derive.finite(batch.measurements[:, first : first + rows])
            first += rows
            if rows:
                names = [f"node {k}" if rows == 1 else f"node {k}, row {r}" for r in range(rows)]
                style = {"names": names, "colors": np.full(rows, node_colours[k]), "widths": 1.0}
                self._series(f"measurement/node/{k}", times, values, **style)

    def _series(self, path: str, times: list, values: np.ndarray, **style: object) -> None:
        if path not in self._styled:
            self._styled.add(path)
            self._rec.log(path, rr.SeriesLines(**style), static=True)
        columns = rr.Scalars.columns(scalars=np.ascontiguousarray(values, dtype=np.float64).reshape(-1))
        if values.ndim == 2:
            columns = columns.partition(np.full(len(values), values.shape[1]))
        self._rec.send_columns(path, times, columns)

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
            times = time_columns(batch.step[at], self._header.dt_s)
            self._rec.send_columns("faults", times, rr.TextLog.columns(text=texts, level=levels))
        return int(np.count_nonzero(masks))


def fault_text(mask: int) -> str:
    return ", ".join(_FAULTS.get(bit, f"fault bit {bit}") for bit in range(32) if mask >> bit & 1) or "faults over"


def time_columns(step: np.ndarray, dt_s: float) -> list:
    """The timelines `step` and `sim_time`. Nanoseconds as integers: rerun truncates a column of float seconds."""
    with np.errstate(invalid="ignore"):
        ns = np.rint(step * (dt_s * 1e9))
    if not ns.max() < _LARGEST_NS:  # also where 0 times infinity made NaN
        raise LogError(f"step {step.max()} with dt_s = {dt_s:g} is beyond the clock of rerun (292 years)")
    return [
        rr.TimeColumn("step", sequence=step),
        rr.TimeColumn("sim_time", duration=ns.astype("timedelta64[ns]")),
    ]
