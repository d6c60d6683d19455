# SPDX-License-Identifier: MIT
"""The scene of a tracking log: besides the target and its estimates, how far sensors reach, who measures now and what became of it, and which
links carried a message."""

import numpy as np
import rerun as rr

from meshkal_log.fields import Batch, Decision, Header
from meshkal_log.scenario import Scenario, positions_of
from ..numbers import tracking as numbers
from . import colours
from .scene import ELLIPSOIDS, LABELLED_NODES, Scene, send_trail
from .tracking import STATES

LIMITS = "scene/range_limits"
_RING_POINTS = 73
_PAINT = np.array([colours.DECISIONS[STATES[decision]] for decision in Decision], dtype=np.uint32)
# Rows of a sensor's reading that hold its distance and its angles.
_DISTANCE_ROW = {"range": 0, "range-bearing": 0}
_FIRST_ANGLE_ROW = {"bearing": 0, "range-bearing": 1}


class TrackingScene(Scene):
    def __init__(self, rec: rr.RecordingStream, header: Header, scenario: Scenario, names: list[str], palette: colours.Palette) -> None:
        self._header, self._scenario = header, scenario
        self._slots, self._links = numbers.Slots(header), numbers.Links(header)
        self._first_row = np.concatenate([[0], np.cumsum(header.rows)])
        self._trail = np.zeros((0, 3), dtype=np.float32)
        super().__init__(rec, header, scenario, names, palette)
        # Lines only: the area of an estimate that knows little would cover the scene.
        self._style(ELLIPSOIDS, rr.Ellipsoids3D, fill_mode="majorwireframe")
        if scenario.node_positions_m is not None:
            self._style("scene/measuring", rr.Points3D, radii=-7.0)
            self._style("scene/readings", rr.LineStrips3D, radii=-1.2)
        self._style("scene/estimate_trail", rr.LineStrips3D, colors=colours.MEDIAN, radii=-1.0)

    def _sensors(self, header: Header, scenario: Scenario, palette: colours.Palette) -> None:
        positions = scenario.node_positions_m
        if positions is None:
            return
        known = np.flatnonzero(np.isfinite(positions).all(axis=1))
        few = header.nodes <= LABELLED_NODES
        # The colour of a reading tells what became of it; so that of a sensor is left to networks, where each has an estimate.
        painted = colours.REFERENCE if header.central else palette.nodes[known]
        style = {"labels": [str(k) for k in known], "show_labels": few, "radii": -4.0 if few else -2.0, "colors": painted}
        self._rec.log("scene/sensors", rr.Points3D(positions[known], **style), static=True)
        self._limits(positions, scenario)
        links = self._links.nodes
        links = links[np.isin(links, known).all(axis=1)]
        if len(links):
            self._rec.log("scene/links", rr.LineStrips3D(positions[links], colors=colours.LINK, radii=-0.5), static=True)

    def _limits(self, positions: np.ndarray, scenario: Scenario) -> None:
        """A ring in the plane, a sphere in space."""
        limited = np.flatnonzero(np.isfinite(scenario.range_limits_m) & np.isfinite(positions).all(axis=1))
        if not len(limited):
            return
        centers, limits = positions[limited], scenario.range_limits_m[limited]
        if scenario.planar:
            angle = np.linspace(0.0, 2.0 * np.pi, _RING_POINTS)
            ring = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)
            strips = centers[:, None] + limits[:, None, None] * ring
            self._rec.log(LIMITS, rr.LineStrips3D(strips, colors=colours.LIMIT, radii=-0.7), static=True)
        else:
            half = np.repeat(limits[:, None], 3, axis=1)
            spheres = rr.Ellipsoids3D(centers=centers, half_sizes=half, colors=colours.LIMIT, line_radii=-0.3, fill_mode="majorwireframe")
            self._rec.log(LIMITS, spheres, static=True)

    def batch(self, times: list, batch: Batch) -> None:
        super().batch(times, batch)
        estimates = positions_of(batch.estimate, self._scenario.position_states)
        middle = numbers.middle(estimates)
        self._estimate_trail(times, middle, without_truth=batch.truth is None)
        if self._scenario.node_positions_m is None:
            return
        target = middle if batch.truth is None else positions_of(batch.truth, self._scenario.position_states)
        self._readings(times, batch, np.where(np.isfinite(target).all(axis=1)[:, None], target, middle).astype(np.float64))
        if not self._header.central:
            self._messages(times, batch)

    def _estimate_trail(self, times: list, middle: np.ndarray, *, without_truth: bool) -> None:
        """Where the estimates, or their mean, have been; without a truth also the whole path."""
        self._trail = send_trail(self._rec, "scene/estimate_trail", times, self._trail, middle)
        if without_truth:
            self._path_of = "estimate"
            self._path.append(middle[np.isfinite(middle).all(axis=1)].astype(np.float32))

    def _readings(self, times: list, batch: Batch, target: np.ndarray) -> None:
        """A bright point at each sensor that gives a reading, and a line from it as far and where the reading says; the rest, and for other kinds
        of sensors all, is taken from the target. Its colour tells what became of the reading."""
        positions = self._scenario.node_positions_m
        worst = numbers.worst_decisions(numbers.decisions(batch, self._slots), self._slots, self._header.nodes)
        there = (batch.measuring != 0) & np.isfinite(positions).all(axis=1)
        at, node = np.nonzero(there)
        each = there.sum(axis=1)
        painted = _PAINT[worst[at, node]]
        sensors = positions[node].astype(np.float32)
        columns = rr.Points3D.columns(positions=sensors, colors=painted).partition(each)
        self._rec.send_columns("scene/measuring", times, columns)
        ends = self._ends(batch, at, node, target)
        known = np.isfinite(ends).all(axis=1)
        ends[~known] = sensors[~known]
        strips = np.stack([sensors, ends.astype(np.float32)], axis=1)
        columns = rr.LineStrips3D.columns(strips=strips, colors=painted).partition(each)
        self._rec.send_columns("scene/readings", times, columns)

    def _ends(self, batch: Batch, at: np.ndarray, node: np.ndarray, target: np.ndarray) -> np.ndarray:
        positions = self._scenario.node_positions_m
        towards = target[at] - positions[node]
        distance = np.linalg.norm(towards, axis=1)
        direction = towards / np.where(distance > 0.0, distance, 1.0)[:, None]
        sensors = np.array(self._scenario.sensors)
        for kind in np.unique(sensors[node]) if len(node) else ():
            mine = sensors[node] == kind
            row, step = self._first_row[node[mine]], at[mine]
            if kind in _DISTANCE_ROW:
                distance[mine] = batch.measurements[step, row + _DISTANCE_ROW[kind]]
            if kind in _FIRST_ANGLE_ROW:
                azimuth = batch.measurements[step, row + _FIRST_ANGLE_ROW[kind]]
                elevation = 0.0 if self._scenario.planar else batch.measurements[step, row + _FIRST_ANGLE_ROW[kind] + 1]
                level = np.cos(elevation)
                direction[mine] = np.stack(np.broadcast_arrays(level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)), axis=1)
        return positions[node] + distance[:, None] * direction

    def _messages(self, times: list, batch: Batch) -> None:
        """Links that carried a message in this step; the fewer of those that it should have carried, the fainter."""
        links, share = self._links.nodes, self._links.shares(batch.messages_arrived, len(batch.step))
        positions = self._scenario.node_positions_m
        lit = (share > 0.0) & np.isfinite(positions).all(axis=1)[links].all(axis=1)
        at, link = np.nonzero(lit)
        strips = positions[links[link]].astype(np.float32)
        alpha = np.rint(60.0 + 195.0 * share[at, link]).astype(np.uint32)
        painted = (np.uint32(colours.MESSAGE) & np.uint32(0xFFFFFF00)) | alpha
        radii = (-0.6 - 1.2 * share[at, link]).astype(np.float32)
        columns = rr.LineStrips3D.columns(strips=strips, colors=painted, radii=radii).partition(lit.sum(axis=1))
        self._rec.send_columns("scene/messages", times, columns)
