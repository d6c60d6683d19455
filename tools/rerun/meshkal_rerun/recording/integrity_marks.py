# SPDX-License-Identifier: MIT
"""Sensors that are held faulty, marked in the picture of the network and in the scene: in a colour and by a shape, with how many say so."""

import numpy as np
import rerun as rr

from meshkal_log.fields import Batch, Header
from meshkal_log.scenario import Scenario
from ..numbers import integrity
from ..numbers.integrity import Share
from . import colours
from .network import plane_positions
from .series import Clock

PICTURE = "network/held_faulty"
SCENE = "scene/held_faulty"
_PAINT = np.array([colours.QUIET, colours.BOUND, colours.MANY, colours.WORST], dtype=np.uint32)
_ARM = 0.02  # of the extent of the network: half the width of a cross
_TEXT = 5.0  # of that


class IntegrityMarks:
    """Sends them where they change."""

    def __init__(self, rec: rr.RecordingStream, clock: Clock, header: Header, scenario: Scenario) -> None:
        self._rec, self._clock, self._header = rec, clock, header
        self._held = integrity.Held(header)
        self._changes = integrity.Changes(np.zeros(header.nodes, dtype=np.int64))
        self._plane = plane_positions(scenario.all_positions_m, header)[: header.nodes]
        self._plane_arm = _ARM * max(float(np.ptp(self._plane, axis=0).max()), 1e-3)
        # Below the disc of the node, which keeps its colour, and wider.
        rec.log(PICTURE, rr.Points2D.from_fields(radii=-9.0, show_labels=False, draw_order=25.0), static=True)
        # Above the node: below it is its number.
        rec.log(f"{PICTURE}/text", rr.Points2D.from_fields(radii=-0.1, show_labels=True, draw_order=35.0), static=True)
        rec.log(f"{PICTURE}/cross", rr.LineStrips2D.from_fields(radii=-2.0, colors=colours.TRUTH, draw_order=34.0), static=True)
        self._positions = scenario.node_positions_m if scenario.position_states else None
        if self._positions is not None:
            known = self._positions[np.isfinite(self._positions).all(axis=1)]
            self._arm = _ARM * max(float((known.max(axis=0) - known.min(axis=0)).max()), 1e-3)
            rec.log(SCENE, rr.Points3D.from_fields(radii=-9.0, show_labels=True), static=True)
            rec.log(f"{SCENE}/cross", rr.LineStrips3D.from_fields(radii=-2.0, colors=colours.TRUTH), static=True)

    def batch(self, batch: Batch) -> None:
        counts = self._held.counts(batch)
        steps = np.unique(self._changes.of(counts)[0])
        if not len(steps):
            return
        times = self._clock.times(batch, steps)
        at, node = np.nonzero(counts[steps])
        of = self._held.heard[node]
        count = counts[steps][at, node]
        painted = _PAINT[np.array([Share.NONE.value, *integrity.shares(count, of)])[1:]]
        # The viewer ends itself over a character that its font does not have; it has this one.
        texts = ["\u00d7 faulty" if h == 1 else f"\u00d7 faulty at {c} of {h}" for c, h in zip(count, of)]
        each = np.bincount(at, minlength=len(steps))
        columns = rr.Points2D.columns(positions=self._plane[node], colors=painted, labels=texts)
        self._rec.send_columns(PICTURE, times, columns.partition(each))
        columns = rr.Points2D.columns(positions=self._plane[node] - (0.0, _TEXT * self._plane_arm), colors=painted, labels=texts)
        self._rec.send_columns(f"{PICTURE}/text", times, columns.partition(each))
        strips = _crosses(self._plane[node], self._plane_arm)
        self._rec.send_columns(f"{PICTURE}/cross", times, rr.LineStrips2D.columns(strips=strips).partition(2 * each))
        if self._positions is not None:
            known = np.isfinite(self._positions[node]).all(axis=1)
            each = np.bincount(at[known], minlength=len(steps))
            where = self._positions[node[known]]
            labels = [text for text, is_known in zip(texts, known) if is_known]
            columns = rr.Points3D.columns(positions=where, colors=painted[known], labels=labels)
            self._rec.send_columns(SCENE, times, columns.partition(each))
            self._rec.send_columns(f"{SCENE}/cross", times, rr.LineStrips3D.columns(strips=_crosses(where, self._arm)).partition(2 * each))


def _crosses(where: np.ndarray, arm: float) -> np.ndarray:
    """Two strips of two points for each point (M, 2 or 3), diagonals in x and y."""
    arms = np.zeros((2, 2, where.shape[1]))
    arms[:, :, :2] = arm * np.array([[[-1.0, -1.0], [1.0, 1.0]], [[-1.0, 1.0], [1.0, -1.0]]])
    return (where[:, None, None] + arms).reshape(-1, 2, where.shape[1]).astype(np.float32)
