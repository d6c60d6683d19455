"""The network as a graph: who listens to whom, each node coloured by its error over time."""

from collections.abc import Callable

import numpy as np
import rerun as rr

from . import colours
from .reader import Header
from .scenario import Scenario

ENTITY = "network"
# Text in a graph view has a fixed size in the units of the positions, so positions are scaled until labels fit between nodes.
SPACING = 90.0
_LABELLED_NODES = 60
_LAID_OUT_NODES = 100
_ROWS_A_SEND = 4096


class NetworkGraph:
    """Keeps one number a node and step until the end, because the colour scale needs the range of the whole run."""

    def __init__(self, rec: rr.RecordingStream, header: Header, scenario: Scenario) -> None:
        self._rec = rec
        self._steps: list[np.ndarray] = []
        self._values: list[np.ndarray] = []
        self._central = header.central
        self._nodes = header.nodes
        self._labels = [str(k) for k in range(header.nodes)] + (["centre"] if header.central else [])
        edges, directed = graph_edges(header)
        positions = graph_positions(scenario.node_positions_m, header)
        radii = np.full(len(self._labels), 12.0 if header.nodes <= _LABELLED_NODES else 25.0)
        rec.log(
            ENTITY,
            rr.GraphNodes.from_fields(
                node_ids=self._labels, labels=self._labels, positions=positions, radii=radii, show_labels=header.nodes <= _LABELLED_NODES
            ),
            rr.GraphEdges([(self._labels[i], self._labels[j]) for i, j in edges], graph_type="directed" if directed else "undirected"),
            static=True,
        )

    def batch(self, step: np.ndarray, quantities: dict[str, np.ndarray]) -> None:
        """Without a truth there is no error; how far the innovations exceed what a node expects stands in for it, in dB too."""
        if "error_db" in quantities:
            values = quantities["error_db"]
        else:
            with np.errstate(divide="ignore", invalid="ignore"):
                values = 10.0 * np.log10(quantities["nis_ratio"])
        self._steps.append(step)
        self._values.append(values.astype(np.float32))

    def finish(self, times: Callable[[np.ndarray], list]) -> tuple[float, float] | None:
        """Sends the colours and returns the dB values of blue and red."""
        values = np.concatenate(self._values)
        known = values[np.isfinite(values)]
        if len(known) == 0:
            low = high = 0.0
        else:
            # The extremes are left out: one start-up transient would otherwise paint the rest in one colour.
            low, high = (float(q) for q in np.percentile(known, [2, 98]))
        step = np.concatenate(self._steps)
        for first in range(0, len(step), _ROWS_A_SEND):
            part = slice(first, first + _ROWS_A_SEND)
            self._send(times(step[part]), values[part], low, high)
        return (low, high) if len(known) else None

    def _send(self, times: list, values: np.ndarray, low: float, high: float) -> None:
        painted = scale(values, low, high)
        if self._central:
            sensors = np.full((len(painted), self._nodes), colours.REFERENCE, dtype=np.uint32)
            painted = np.concatenate([sensors, painted], axis=1)
        fields = {"colors": painted.reshape(-1)}
        if len(self._labels) <= _LABELLED_NODES:
            texts = np.char.mod("%.1f dB", values)
            texts[~np.isfinite(values)] = "?"
            if self._central:
                texts = np.concatenate([np.full((len(values), self._nodes), ""), texts], axis=1)
            fields["labels"] = [f"{name}: {text}" if text else name for row in texts for name, text in zip(self._labels, row)]
        columns = rr.GraphNodes.columns(**fields).partition(np.full(len(values), len(self._labels)))
        self._rec.send_columns(ENTITY, times, columns)


def scale(values: np.ndarray, low: float, high: float) -> np.ndarray:
    return colours.scale_colours(np.where(np.isfinite(values), values, np.nan), low, high)


def graph_edges(header: Header) -> tuple[list[tuple[int, int]], bool]:
    """Pairs (from, to), and whether their direction matters. The slots say who listens; a central filter is a star."""
    if header.central:
        return [(k, header.nodes) for k in header.slots[0]], False
    heard = {(j, k) for k, slots in enumerate(header.slots) for j in slots if j != k}
    if all((k, j) in heard for j, k in heard):
        return sorted((j, k) for j, k in heard if j < k), False
    return sorted(heard), True


def graph_positions(positions_m: np.ndarray | None, header: Header) -> np.ndarray | None:
    """The nodes' x and y, scaled for the view, whose y points down. None leaves the layout of a small network to the viewer."""
    if positions_m is None:
        if header.nodes <= _LAID_OUT_NODES:
            return None
        # The viewer's own layout takes too long for many nodes.
        angle = 2.0 * np.pi * np.arange(header.nodes) / header.nodes
        plane = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    else:
        plane = positions_m[:, :2] * (1.0, -1.0)
    low, high = plane.min(axis=0), plane.max(axis=0)
    extent = (high - low).max()
    plane = (plane - low) * (SPACING * np.sqrt(header.nodes) / extent if extent > 0 else 1.0)
    if header.central:
        # Beside the network, not within: the lines of the star then stay apart from the nodes.
        plane = np.vstack([plane, [[plane[:, 0].mean(), plane[:, 1].min() - SPACING * max(1.0, np.sqrt(header.nodes) / 3.0)]]])
    return plane
