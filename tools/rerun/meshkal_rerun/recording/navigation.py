# SPDX-License-Identifier: MIT
"""Series of a navigation log: errors of the states in units of their own, innovations, NEES with its band; the flight in the scene."""

import numpy as np
import rerun as rr

from meshkal_log.fields import Batch, Header
from meshkal_log.scenario import NAVIGATION_POSITION, Scenario, positions_of
from ..numbers import derive
from ..numbers import navigation as numbers
from ..numbers.navigation import GROUPS
from ..numbers.tracking import BAND, nees_band
from . import colours
from .scene import Scene, send_trail, thinned
from .series import Clock, Series
from .sky import Sky

SIGMAS = 3.0


class NavigationRecorder:
    def __init__(self, rec: rr.RecordingStream, series: Series, clock: Clock, header: Header, palette: colours.Palette) -> None:
        self._series, self._header = series, header
        self._sky = Sky(rec, clock, header)
        self._colours = palette.nodes
        low, high = nees_band(header.states)
        self._band = {"lower": low, "expected": float(header.states), "upper": high}

    def batch(self, times: list, batch: Batch) -> None:
        for group in GROUPS:
            self._group(times, f"navigation/estimate/{group.key}", numbers.estimates(batch, group), group, "")
            if batch.truth is not None:
                self._group(times, f"navigation/error/{group.key}", numbers.errors(batch, group), group, " error")
        sigma = SIGMAS * numbers.position_sigma(batch)
        for i, axis in enumerate(GROUPS[2].labels):
            for name, values in (("upper", sigma[:, i]), ("lower", -sigma[:, i])):
                style = {"names": f"{SIGMAS:g} sigma", "colors": colours.BOUND, "widths": 1.0}
                self._series.lines(f"navigation/sigma/{axis}/{name}", times, values, **style)
        if batch.innovation is not None:
            for k in range(self._header.nodes):
                style = {"names": self._header.sensor_name(k), "colors": self._colours[k], "widths": 1.5}
                self._series.lines(f"innovation/{self._header.sensor_path(k)}", times, derive.finite(batch.innovation[:, k]), **style)
        if batch.nees is not None:
            for name, value in self._band.items():
                label = name if name == "expected" else f"{name} bound, {100 * BAND:.0f} % band"
                colour = colours.REFERENCE if name == "expected" else colours.BOUND
                self._series.lines(f"nees/band/{name}", times, np.full(len(batch.step), value), names=label, colors=colour, widths=1.0)
        self._sky.batch(times, batch)

    def _group(self, times: list, path: str, values: np.ndarray, group: numbers.Group, what: str) -> None:
        """One entity a component: each can then be shown alone."""
        for i, label in enumerate(group.labels):
            style = {"names": f"{label}{what}, {group.unit}", "colors": colours.AXES[i], "widths": 1.5}
            self._series.lines(f"{path}/{label.replace(' ', '_')}", times, values[:, i], **style)

    def finish(self) -> None:
        self._sky.finish()


class NavigationScene(Scene):
    """The flight: truth, and the trail of the estimate."""

    def __init__(self, rec: rr.RecordingStream, header: Header, scenario: Scenario, names: list[str], palette: colours.Palette) -> None:
        super().__init__(rec, header, scenario, names, palette)
        self._trail = np.zeros((0, 3), dtype=np.float32)
        self._estimates: list[np.ndarray] = []
        self._style("scene/estimate_trail", rr.LineStrips3D, colors=colours.MEDIAN, radii=-1.5)

    def batch(self, times: list, batch: Batch) -> None:
        super().batch(times, batch)
        estimate = positions_of(batch.estimate[:, 0], NAVIGATION_POSITION)
        self._trail = send_trail(self._rec, "scene/estimate_trail", times, self._trail, estimate)
        self._estimates.append(estimate[np.isfinite(estimate).all(axis=1)])

    def thin(self) -> None:
        super().thin()
        self._estimates = thinned(self._estimates)

    def finish(self) -> None:
        super().finish()
        path = np.concatenate(self._estimates)
        self._rec.log("scene/estimate_path", rr.LineStrips3D([path], colors=colours.LIMIT, radii=-0.7), static=True)
