# SPDX-License-Identifier: MIT
"""Series of how far the nodes agree, of logs of distributed filters."""

from collections.abc import Sequence

import numpy as np
import rerun as rr

from meshkal_log.fields import Batch, Header
from meshkal_log.scenario import Scenario
from ..numbers import agreement as numbers
from ..summary.agreement import AgreementSummary
from . import colours
from .series import Clock, Series
from .smooth import Smoothed

# Lines that jump from step to step: more of them hide each other.
NAMED = 3
_COLOURS = {"readings": colours.MEDIAN, "estimates": colours.MESSAGE, "messages": colours.MESSAGE}


class AgreementRecorder:
    def __init__(
        self, rec: rr.RecordingStream, series: Series, clock: Clock, header: Header, scenario: Scenario, palette: colours.Palette, named: Sequence[int],
        steps: int,
    ) -> None:
        """steps: of the run, 0 if nobody knows."""
        self._rec, self._series, self._clock = rec, series, clock
        self._header, self._scenario, self._palette = header, scenario, palette
        self._named = [k for k in named if k in header.estimator_nodes][:NAMED]
        self._smooth = Smoothed(series, clock, steps)
        self._over_graph = numbers.OverGraph(header, scenario)
        self._summary = AgreementSummary(header, scenario)

    def batch(self, times: list, batch: Batch) -> None:
        found = numbers.agreement(batch, self._scenario)
        lines = self._series.lines
        for k in self._named:
            values = found.distance[:, self._header.estimator_nodes.index(k)]
            style = {"names": f"node {k}{self._smooth.said}", "colors": self._palette.nodes[k], "widths": 1.2}
            self._smooth.line(f"agreement/distance/node/{k}", batch, values, **style)
        for name, values, colour, width in (("largest", found.largest, colours.WORST, 1.5), ("median", found.median, colours.MEDIAN, 2.0),
                                            ("rms", found.rms, colours.SUMMARY, 2.5)):
            lines(f"agreement/distance/over_nodes/{name}", times, values, names=name.replace("rms", "RMS"), colors=colour, widths=width)
        if found.mean_error is not None:
            lines("agreement/error/nodes", times, found.node_error, names="error of the nodes, RMS", colors=colours.SUMMARY, widths=2.5)
            lines("agreement/error/mean", times, found.mean_error, names="error of their mean", colors=colours.COMPARED["orange"], widths=2.0)
            lines("agreement/error/spread", times, found.rms, names="distance from their mean, RMS", colors=colours.COMPARED["turquoise"], widths=2.0)
        shares = numbers.arrived(batch, self._header)
        for what, share in shares.items():
            lines(f"agreement/arrived/{what}", times, 100.0 * share, names=what, colors=_COLOURS[what], widths=1.5)
        self._over_graph.batch(batch)
        self._summary.batch(batch, found, shares)

    def refresh(self, times: list) -> None:
        """Of a run that goes on, at one time: what is known by now."""
        text = self._summary.text(self._over_graph.distances())
        self._rec.send_columns("agreement/summary", times, rr.TextDocument.columns(text=[text], media_type=["text/markdown"]))
        bars = self._bars()
        if bars:
            self._rec.send_columns("agreement/over_graph", times, rr.BarChart.columns(**bars))

    def finish(self) -> None:
        self._smooth.finish()
        bars = self._bars()
        if bars:
            self._rec.log("agreement/over_graph", rr.BarChart(**bars), static=True)
        text = self._summary.text(self._over_graph.distances())
        self._rec.log("agreement/summary", rr.TextDocument(text, media_type="text/markdown"), static=True)

    def _bars(self) -> dict[str, object]:
        distances = self._over_graph.distances()
        known = np.isfinite(distances)
        if not known.any():
            return {}
        # A bar begins at its place, and is 1 wide.
        return {"values": distances[known], "abscissa": 0.5 + np.flatnonzero(known), "color": colours.MEDIAN}
