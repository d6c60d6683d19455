# SPDX-License-Identifier: MIT
"""The network in a plane: who listens to whom, over which links nothing came, each node coloured by its error over time."""

import numpy as np
import pyarrow as pa
import rerun as rr

from meshkal_log.fields import Batch, Header
from meshkal_log.scenario import Scenario
from ..numbers.comparison import in_metres
from ..numbers.links import Heard
from ..numbers.survey import DRAWN_NODES, Survey, shade_db
from . import colours
from .series import Column

NODES = "network/nodes"
NAMED = "network/named"
LINKS = "network/links"
ONE_WAY = "network/links_one_way"
MISSING = "network/missing"
SCALE = "network/scale"
# More would hide each other; of more nodes those that are named have their labels.
_LABELLED_NODES = 60
# Parts of the receiver's half of a link that are drawn where nothing came, from the middle to the receiver. Of many links it is one piece.
_DASHES = ((0.04, 0.22), (0.38, 0.56), (0.72, 0.9))
_PIECE = ((0.0, 0.9),)
_SCALE_PARTS = 60
# Of the extent.
_MARGIN = 0.1
_SCALE_BELOW = 0.17
_ORDER = {LINKS: 10.0, ONE_WAY: 10.0, MISSING: 15.0, NAMED: 20.0, f"{NAMED}/gap": 21.0, NODES: 30.0}

(_STRIPS,) = [column for column in rr.LineStrips2D.columns(strips=[[[0.0, 0.0], [1.0, 1.0]]])]
_STRIPS_TYPE = _STRIPS.as_arrow_array().type.value_type


class NetworkPicture:
    """Positions in metres, y downwards as the viewer has it; of a network without positions a circle. A centre is beside its sensors."""

    def __init__(self, rec: rr.RecordingStream, header: Header, scenario: Scenario, found: Survey, palette: colours.Palette, labels: list[str]) -> None:
        """labels: of the estimators, for those that are named. Blue and red are found.shade_range_db."""
        self._rec, self._header, self._palette = rec, header, palette
        self._heard = Heard(header)
        self._positions = positions = plane_positions(scenario.all_positions_m, header)
        self._few = header.nodes <= DRAWN_NODES
        self._links(header, positions)
        self.style_again(labels)
        self.shade(found, scenario)
        middle, heard = (positions[self._heard.sender] + positions[self._heard.receiver]) / 2.0, positions[self._heard.receiver]
        parts = np.array(_DASHES if self._few else _PIECE)
        self._dashes = (middle[:, None, None] + parts[None, :, :, None] * (heard - middle)[:, None, None]).astype(np.float32)
        colour, radius = (colours.MISSING, -1.0) if self._few else (colours.FAINT_MISSING, -0.7)
        style = {"colors": colour, "radii": radius, "draw_order": _ORDER[MISSING]}
        self._static(MISSING, rr.LineStrips2D.from_fields(**style))

    def shade(self, found: Survey, scenario: Scenario) -> None:
        """Blue and red from now on."""
        self._range = found.shade_range_db
        self._metres = found.has_truth and in_metres(self._header, scenario)
        self._scale()

    def style_again(self, labels: list[str]) -> None:
        """The nodes, and those that are named."""
        header, palette, positions = self._header, self._palette, self._positions
        names = [str(k) for k in range(header.nodes)] + (["centre"] if header.central else [])
        labelled = header.nodes <= _LABELLED_NODES
        shown = [name if labelled and (header.central or k not in palette.named) else "" for k, name in enumerate(names)]
        radii = np.full(len(names), -6.0 if self._few else -2.5, dtype=np.float32)
        radii[[-1] if header.central else list(palette.named)] = -11.0 if header.central else -6.0
        self._static(NODES, rr.Points2D.from_fields(positions=positions, radii=radii, labels=shown, show_labels=labelled, draw_order=_ORDER[NODES]))
        self._rings(labels)

    def batch(self, times: list, batch: Batch, quantities: dict[str, np.ndarray]) -> None:
        values = shade_db(quantities)
        # Without a range nobody knows what much is.
        painted = colours.scale_colours(values, *self._range) if self._range else np.full(values.shape, colours.UNKNOWN, dtype=np.uint32)
        every = np.full((len(painted), len(self._positions)), colours.REFERENCE, dtype=np.uint32)
        every[:, [self._header.nodes] if self._header.central else list(self._header.estimator_nodes)] = painted
        each = np.full(len(every), every.shape[1])
        self._rec.send_columns(NODES, times, rr.Points2D.columns(colors=every.reshape(-1)).partition(each))
        self._missing(times, self._heard.missing(batch))

    def _missing(self, times: list, missing: np.ndarray) -> None:
        at, link = np.nonzero(missing)
        points = self._dashes[link].reshape(-1)
        pieces, parts = len(points) // 4, self._dashes.shape[1]
        strips = pa.ListArray.from_arrays(
            pa.array(np.arange(0, 2 * pieces + 1, 2, dtype=np.int32)), pa.FixedSizeListArray.from_arrays(pa.array(points, pa.float32()), 2)
        ).cast(_STRIPS_TYPE)
        offsets = np.concatenate([[0], parts * np.cumsum(np.bincount(at, minlength=len(missing)))])
        self._rec.send_columns(MISSING, times, [Column(_STRIPS.component_descriptor(), offsets, strips)])

    def _links(self, header: Header, positions: np.ndarray) -> None:
        both, one_way = links(header)
        colour = colours.LINK if self._few else colours.FAINT_LINK
        if len(both):
            self._static(LINKS, rr.LineStrips2D(positions[both], colors=colour, radii=-0.7, draw_order=_ORDER[LINKS]))
        if len(one_way):
            vectors = 0.94 * (positions[one_way[:, 1]] - positions[one_way[:, 0]])
            arrows = rr.Arrows2D(origins=positions[one_way[:, 0]], vectors=vectors, colors=colour, radii=-0.7, draw_order=_ORDER[ONE_WAY])
            self._static(ONE_WAY, arrows)

    def _rings(self, labels: list[str]) -> None:
        """Around the nodes that are named: a disc in the node's colour, and a smaller dark one on it."""
        header, palette = self._header, self._palette
        named = [] if header.central else [header.estimator_nodes[e] for e in palette.named_estimators]
        if not named:
            return
        labels = [labels[e] for e in palette.named_estimators]
        where, inner = self._positions[named], 8.0 if self._few else 5.0
        for path, radius, style in (
            (NAMED, inner + 3.0, {"colors": palette.nodes[named], "labels": labels, "show_labels": True}),
            (f"{NAMED}/gap", inner, {"colors": colours.BACKGROUND, "show_labels": False}),
        ):
            self._static(path, rr.Points2D(where, radii=-radius, draw_order=_ORDER[path], **style))

    def _scale(self) -> None:
        """The colours below the network, with what they mean."""
        if self._range is None:
            return
        low, high = self._range
        corner, end = _box(self._positions)
        y = end[1] + _SCALE_BELOW * (end - corner).max()
        line = np.stack([np.linspace(corner[0], end[0], _SCALE_PARTS + 1), np.full(_SCALE_PARTS + 1, y)], axis=1)
        painted = colours.scale_colours(np.linspace(low, high, _SCALE_PARTS), low, high)
        self._static(SCALE, rr.LineStrips2D(np.stack([line[:-1], line[1:]], axis=1), colors=painted, radii=-4.0))
        texts = [f"{self._value(low)} or less", self._value((low + high) / 2.0), f"{self._value(high)} or more"]
        at = [0, _SCALE_PARTS // 2, -1]
        self._static(f"{SCALE}/labels", rr.Points2D(line[at], colors=colours.REFERENCE, radii=-0.1, labels=texts, show_labels=True))

    def _value(self, decibels: float) -> str:
        return f"{10.0 ** (decibels / 20.0):.2g} m" if self._metres else f"{decibels:z.1f} dB"

    def _static(self, path: str, archetype: object) -> None:
        self._rec.log(path, archetype, static=True)


def links(header: Header) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of nodes (M, 2) that hear each other, smaller first, and (from, to) of those that only one of them hears. Where only some nodes have
    written a log nobody knows what the others hear: all are of the first kind, as those of a centre."""
    heard = Heard(header)
    pairs = set(zip(heard.sender.tolist(), heard.receiver.tolist()))
    if header.central or len(header.estimator_nodes) < header.nodes:
        both, one_way = {(min(link), max(link)) for link in pairs}, set()
    else:
        both = {(j, k) for j, k in pairs if j < k and (k, j) in pairs}
        one_way = {(j, k) for j, k in pairs if (k, j) not in pairs}
    return np.array(sorted(both), dtype=np.intp).reshape(-1, 2), np.array(sorted(one_way), dtype=np.intp).reshape(-1, 2)


def plane_positions(positions_m: np.ndarray | None, header: Header) -> np.ndarray:
    """(N, 2), and a centre's last."""
    if positions_m is None:
        angle = 2.0 * np.pi * np.arange(header.nodes) / header.nodes
        plane = np.stack([np.sin(angle), -np.cos(angle)], axis=1)
    else:
        plane = positions_m[:, :2] * (1.0, -1.0)
    if header.central:
        low, high = plane.min(axis=0), plane.max(axis=0)
        # Above a network of known positions, where no node is; a circle is empty in the middle.
        above = np.array([(low[0] + high[0]) / 2.0, low[1] - 0.25 * max(float((high - low).max()), 1e-3)])
        plane = np.vstack([plane, plane.mean(axis=0) if positions_m is None and header.nodes > 1 else above])
    return plane


def bounds(header: Header, scenario: Scenario) -> tuple[tuple[float, float], tuple[float, float]]:
    """What a view has to show, x and y: the network, room for its labels, and the scale of the colours."""
    low, high = _box(plane_positions(scenario.all_positions_m, header))
    margin = _MARGIN * (high - low).max()
    below = margin * (1.0 + _SCALE_BELOW / _MARGIN)
    return (float(low[0] - margin), float(high[0] + margin)), (float(low[1] - margin), float(high[1] + below))


def _box(plane: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Corners around the nodes; a row of them or a single one has some room, too."""
    low, high = plane.min(axis=0), plane.max(axis=0)
    extent = high - low
    least = max(0.3 * extent.max(), 1e-3) if extent.max() > 0.0 else 1.0
    wider = np.maximum(least - extent, 0.0) / 2.0
    return low - wider, high + wider
