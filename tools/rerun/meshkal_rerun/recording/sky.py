# SPDX-License-Identifier: MIT
"""The sky as the receiver sees it: zenith in the middle, north up; satellites coloured by their weight, those held faulty crossed out."""

import numpy as np
import rerun as rr

from meshkal_log.fields import Batch, Header
from ..numbers import integrity
from ..numbers.navigation import sky
from . import colours
from .series import Clock

RINGS_DEG = (0, 30, 60)
# Half the picture: the horizon and room for letters.
EXTENT = 104.0
_RING_POINTS = 145
_DISC = 4.2
_ARM = 5.2
# A satellite that has moved less is not drawn again in its trail.
_STEP_DEG = 0.2
_RING_RADIUS = 6.6
_BESIDE = (9.5, -4.0)


class Sky:
    def __init__(self, rec: rr.RecordingStream, clock: Clock, header: Header) -> None:
        self._rec, self._clock, self._header = rec, clock, header
        self._labels = [str(number) for number in header.satellites]
        self._trails: list[list[np.ndarray]] = [[] for _ in header.satellites]
        angle = np.linspace(0.0, 360.0, _RING_POINTS)
        rings = [sky(angle, np.full(_RING_POINTS, float(ring))) for ring in RINGS_DEG]
        cross = [sky(np.array([a, a + 180.0]), np.zeros(2)) for a in (0.0, 90.0)]
        rec.log("sky/rings", rr.LineStrips2D([*rings, *cross], colors=colours.LINK, radii=-0.7, draw_order=0.0), static=True)
        points = np.concatenate([sky(np.arange(4) * 90.0, np.full(4, -6.0)), sky(np.full(3, 45.0), np.array(RINGS_DEG, dtype=np.float64))])
        texts = ["N", "E", "S", "W", *(f"{ring}\u00b0" for ring in RINGS_DEG)]
        rec.log("sky/names", rr.Points2D(points, labels=texts, show_labels=True, colors=colours.LINK, radii=-0.1), static=True)
        rec.log("sky/satellites", rr.Points2D.from_fields(radii=_DISC, show_labels=False, draw_order=30.0), static=True)
        rec.log("sky/numbers", rr.Points2D.from_fields(radii=-0.1, colors=colours.TRUTH, show_labels=True, draw_order=31.0), static=True)
        if header.monitor:
            rec.log("sky/held_faulty", rr.LineStrips2D.from_fields(colors=colours.TRUTH, radii=0.8, draw_order=40.0), static=True)
            rec.log("sky/held_faulty/ring", rr.LineStrips2D.from_fields(colors=colours.WORST, radii=0.9, draw_order=35.0), static=True)
        self._ring = _RING_RADIUS * np.stack([np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle))], axis=1)

    def batch(self, times: list, batch: Batch) -> None:
        places = sky(batch.azimuth_deg, batch.elevation_deg)
        known = np.isfinite(places).all(axis=2)
        at, k = np.nonzero(known)
        each = known.sum(axis=1)
        painted = self._colours(batch)[at, k]
        texts = [self._labels[i] for i in k]
        columns = rr.Points2D.columns(positions=places[at, k], colors=painted, labels=texts)
        self._rec.send_columns("sky/satellites", times, columns.partition(each))
        # Beside the discs: a label in them would be hidden by a cross.
        columns = rr.Points2D.columns(positions=places[at, k] + _BESIDE, labels=texts)
        self._rec.send_columns("sky/numbers", times, columns.partition(each))
        if self._header.monitor:
            self._held(times, known & (batch.excluded != 0), places)
        self._trail(places, known)

    def _colours(self, batch: Batch) -> np.ndarray:
        """Grey where no reading came; of a filter without weights one colour, which is that of the full weight."""
        weight = np.ones_like(batch.azimuth_deg) if batch.weight is None else integrity.read_only(batch.weight, batch)
        return colours.scale_colours(np.where(batch.measurements_arrived != 0, 1.0 - weight, np.nan), 0.0, 1.0)

    def _held(self, times: list, held: np.ndarray, places: np.ndarray) -> None:
        at, k = np.nonzero(held)
        centre = places[at, k][:, None]
        arms = _ARM * np.array([[[-1.0, -1.0], [1.0, 1.0]], [[-1.0, 1.0], [1.0, -1.0]]])
        crosses = (centre[:, None] + arms).reshape(-1, 2, 2).astype(np.float32)
        rings = (centre + self._ring).astype(np.float32)
        self._rec.send_columns("sky/held_faulty", times, rr.LineStrips2D.columns(strips=crosses).partition(2 * held.sum(axis=1)))
        self._rec.send_columns("sky/held_faulty/ring", times, rr.LineStrips2D.columns(strips=rings).partition(held.sum(axis=1)))

    def _trail(self, places: np.ndarray, known: np.ndarray) -> None:
        for k, trail in enumerate(self._trails):
            for place in places[known[:, k], k]:
                if not trail or np.linalg.norm(place - trail[-1]) >= _STEP_DEG:
                    trail.append(place)

    def finish(self) -> None:
        strips = [np.array(trail, dtype=np.float32) for trail in self._trails if len(trail) > 1]
        if strips:
            self._rec.log("sky/trails", rr.LineStrips2D(strips, colors=colours.LIMIT, radii=-0.8, draw_order=10.0), static=True)
