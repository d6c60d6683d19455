# SPDX-License-Identifier: MIT
"""Other logs of the same network beside the one that is shown: errors of both, their difference node by node, and how far the estimates are apart."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr

from meshkal_log.fields import Batch
from meshkal_log.reader import LogReader
from meshkal_log.scenario import Scenario, positions_of
from meshkal_log.together import Label
from ..numbers import comparison as numbers
from ..numbers import derive
from ..numbers import tracking
from ..numbers.difference import Difference
from ..summary import compare
from . import colours
from .agreement import NAMED
from .difference_map import log_picture, picture
from .recorder import BAND_NAME
from .scene import send_trail
from .series import Clock, Series
from .smooth import Smoothed

# Bars of more nodes touch each other.
_GAPS = 100
SHOWN_BETTER, OTHER_BETTER = 0x4C9BE8FF, 0xE69F00FF


@dataclass(frozen=True)
class Compared:
    """A log that the shown one is compared with."""

    name: str  # of the file
    label: Label
    reader: LogReader
    files: str = ""  # as a text says which they are
    found: Difference | None = None  # after the first reading


class Comparison:
    """Takes the batches of the shown log in order, then `finish`. The others are read beside it."""

    def __init__(
        self, rec: rr.RecordingStream, shown: Compared, others: Sequence[Compared], scenario: Scenario, run: int, palette: colours.Palette,
        named: Sequence[int],
    ) -> None:
        self._rec, self._shown, self._header, self._label = rec, shown, shown.reader.header, shown.label
        self._scenario, self._clock = scenario, Clock(self._header)
        self._series = Series(rec, envelope=True)
        self._others = [_Other(self, other, run, index) for index, other in enumerate(others)]
        self._palette = palette
        self._named = tuple(named)

    def batch(self, batch: Batch) -> None:
        self._rms("shown", self._label.text, batch, self._header, self._clock, colours.SUMMARY)
        for other in self._others:
            other.beside_shown(batch)

    def finish(self) -> list[tuple[str, str]]:
        """Returns rows for the summary."""
        for other in self._others:
            other.finish()
        every = [(log.files, log.label, log.reader.header) for log in (self._shown, *(other.compared for other in self._others))]
        found = [other.compared.found for other in self._others]
        summary = compare.text(every[0], every[1:], found)
        self._rec.log("compare/summary", rr.TextDocument(summary, media_type="text/markdown"), static=True)
        return [row for other in self._others for row in compare.rows(other.compared.label.text, other.compared.found)]

    def _rms(self, key: str, name: str, batch: Batch, header, clock: Clock, colour: int) -> np.ndarray | None:
        error = numbers.errors(batch, header, self._scenario)
        if error is None:
            return None
        rms = derive.root_mean_square(error)
        self._series.lines(f"compare/rms/{key}", clock.times(batch), derive.decibels(rms), names=name, colors=colour, widths=2.5)
        return rms


class _Other:
    def __init__(self, parent: Comparison, compared: Compared, run: int, index: int) -> None:
        self._parent, self.compared = parent, compared
        self._rec, self._series = parent._rec, parent._series
        self._header = compared.reader.header
        self._clock = Clock(self._header)
        self._colour = colours.compared(index)[1]
        self._pairing = compared.found.pairing
        self._trail = np.zeros((0, 3), dtype=np.float32)
        self._positions = parent._scenario.position_states
        self._smooth = Smoothed(self._series, parent._clock, compared.found.steps)
        self._beside = numbers.Beside(parent._header, self._header, self._own(run))

    def _own(self, run: int) -> Iterator[Batch]:
        """Its batches, when what they say without the shown log has been sent."""
        key, label = self.compared.label.key, self.compared.label.text
        if self._positions:
            style = {"colors": self._colour}
            self._rec.log(f"scene/compared/{key}/estimates", rr.Points3D.from_fields(**style, radii=-4.0, labels=[label], show_labels=False), static=True)
            self._rec.log(f"scene/compared/{key}/trail", rr.LineStrips3D.from_fields(**style, radii=-1.0), static=True)
        for batch in self.compared.reader.batches(run):
            times = self._clock.times(batch)
            rms = self._parent._rms(key, label, batch, self._header, self._clock, self._colour)
            metres = numbers.in_metres(self._header, self._parent._scenario)
            if rms is not None and np.isfinite(rms).any():
                path, values = ("position_error", rms) if metres else ("error_db", derive.decibels(rms))
                self._series.lines(f"{path}/compared/{key}", times, values, names=label, colors=self._colour, widths=2.0)
            if self._positions:
                estimates = positions_of(batch.estimate, self._positions)
                self._trail = send_trail(self._rec, f"scene/compared/{key}/trail", times, self._trail, tracking.middle(estimates))
                each = np.full(len(estimates), estimates.shape[1])
                columns = rr.Points3D.columns(positions=estimates.reshape(-1, 3)).partition(each)
                self._rec.send_columns(f"scene/compared/{key}/estimates", times, columns)
            yield batch

    def beside_shown(self, batch: Batch) -> None:
        for both in self._beside.both(batch):
            times = self._parent._clock.times(both.mine)
            self._apart(times, both)
            self._difference(times, both)

    def finish(self) -> None:
        self._beside.finish()
        self._smooth.finish()
        found, key = self.compared.found, self.compared.label.key
        names = self._parent._label.text, self.compared.label.text
        if len(found.map_db) > 1:
            log_picture(self._rec, f"compare/{key}/map", picture(found.map_db, self._pairing.nodes, found.map_s), names)
        mean = found.mean_db
        if len(mean) > 1 and np.isfinite(mean).any():
            at = np.array(self._pairing.nodes, dtype=np.float64)
            for who, wanted, colour in (("better", mean < 0.0, SHOWN_BETTER), ("worse", mean > 0.0, OTHER_BETTER)):
                if wanted.any():
                    # A bar begins at its place.
                    width = 0.8 if len(mean) <= _GAPS else 1.0
                    bars = rr.BarChart(mean[wanted], abscissa=at[wanted] - width / 2, widths=np.full(int(wanted.sum()), width), color=colour)
                    self._rec.log(f"compare/{key}/nodes/{who}", bars, static=True)

    def _apart(self, times: list, both: numbers.Both) -> None:
        key, text, scenario = self.compared.label.key, self.compared.label.text, self._parent._scenario
        states = self._positions if numbers.in_metres(self._header, scenario) else None
        apart = derive.root_mean_square(numbers.distances(both.mine.estimate, both.theirs.estimate, self._pairing, states))
        if self.compared.found.same_truth is not False:
            self._series.lines(f"compare/distance/{key}", times, derive.decibels(apart), names=f"to {text}", colors=self._colour, widths=2.0)
        if numbers.in_metres(self._header, scenario):
            positions = positions_of(both.mine.estimate, self._positions).astype(np.float64)
            middle = tracking.middle(positions_of(both.theirs.estimate, self._positions))
            with np.errstate(invalid="ignore", over="ignore"):
                apart = derive.root_mean_square(derive.finite(np.linalg.norm(positions - middle[:, None], axis=2)))
            self._series.lines(f"disagreement/compared/{key}", times, apart, names=f"RMS distance to {text}", colors=self._colour, widths=1.5)

    def _difference(self, times: list, both: numbers.Both) -> None:
        every = [numbers.errors(batch, header, self._parent._scenario)
                 for batch, header in ((both.mine, self._parent._header), (both.theirs, self._header))]
        if any(error is None for error in every):
            return
        apart = numbers.difference_db(every[0][:, self._pairing.mine], every[1][:, self._pairing.theirs])
        path = f"compare/{self.compared.label.key}/difference"
        self._series.lines(f"{path}/zero", times, np.zeros(len(apart)), names="equal", colors=colours.REFERENCE, widths=1.0)
        nodes = self._pairing.nodes
        if len(self._pairing) == 1:
            self._series.lines(f"{path}/over_nodes/median", times, apart[:, 0], names=self._pairing.name(0), colors=colours.SUMMARY, widths=2.0)
            return
        for k in [k for k in self._parent._named if k in nodes][:NAMED]:
            style = {"names": f"node {k}{self._smooth.said}", "colors": self._parent._palette.nodes[k], "widths": 1.2}
            self._smooth.line(f"{path}/node/{k}", both.mine, apart[:, nodes.index(k)], **style)
        # The viewer draws in the order of names.
        spread = derive.spread(apart)
        self._series.band(f"{path}/over_nodes/band", times, spread["low"], spread["high"], name=BAND_NAME, color=colours.BAND)
        for edge in ("low", "high"):
            self._series.lines(f"{path}/over_nodes/{edge}", times, spread[edge], names=BAND_NAME, colors=colours.BAND, widths=0.7)
        self._series.lines(f"{path}/over_nodes/median", times, spread["median"], names="median", colors=colours.SUMMARY, widths=3.0)
