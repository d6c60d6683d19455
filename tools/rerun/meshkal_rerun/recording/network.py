# SPDX-License-Identifier: MIT
"""The network as a graph: who listens to whom, each node coloured by its error over time."""

import numpy as np
import rerun as rr

from meshkal_log.fields import Header
from meshkal_log.scenario import Scenario
from ..numbers.survey import shade_db
from . import colours

NODES = "network/nodes"
LABELS = "network/labels"
# A graph view measures text and discs in the units of the positions, so positions are scaled until labels fit between nodes.
SPACING = 80.0
_RADIUS = 14.0
# Where a text is that says more of a node; its label is below.
ABOVE = (0.0, -2.1 * _RADIUS)
_LABELLED_NODES = 60


class NetworkGraph:
    def __init__(self, rec: rr.RecordingStream, header: Header, scenario: Scenario, shade_range_db: tuple[float, float] | None) -> None:
        """shade_range_db: blue and red."""
        self._rec = rec
        self.shade(shade_range_db)
        self._central = header.central
        self._nodes = header.nodes
        self._estimator_nodes = list(header.estimator_nodes)
        self._names = [str(k) for k in range(header.nodes)] + (["centre"] if header.central else [])
        edges, directed = graph_edges(header)
        positions = graph_positions(scenario.all_positions_m, header)
        rec.log(
            NODES,
            rr.GraphNodes.from_fields(
                node_ids=self._names, positions=positions, radii=np.full(len(positions), _RADIUS), labels=self._names, show_labels=False
            ),
            rr.GraphEdges([(self._names[i], self._names[j]) for i, j in edges], graph_type="directed" if directed else "undirected"),
            static=True,
        )
        if header.nodes <= _LABELLED_NODES:
            # The view draws a node as a disc or as a text. Nodes of their own for the texts give both.
            ids = [f"label {name}" for name in self._names]
            below = positions + (0.0, 2.1 * _RADIUS)
            rec.log(LABELS, rr.GraphNodes(ids, positions=below, labels=self._names, show_labels=True), static=True)

    def shade(self, shade_range_db: tuple[float, float] | None) -> None:
        """Blue and red from now on."""
        self._range = shade_range_db or (0.0, 0.0)

    def batch(self, times: list, quantities: dict[str, np.ndarray]) -> None:
        low, high = self._range
        self._send(times, shade_db(quantities), low, high)

    def _send(self, times: list, values: np.ndarray, low: float, high: float) -> None:
        each = np.full(len(values), len(self._names))
        painted = scale(values, low, high)
        if self._central:
            sensors = np.full((len(painted), self._nodes), colours.REFERENCE, dtype=np.uint32)
            painted = np.concatenate([sensors, painted], axis=1)
        elif len(self._estimator_nodes) < self._nodes:
            every = np.full((len(painted), self._nodes), colours.REFERENCE, dtype=np.uint32)
            every[:, self._estimator_nodes] = painted
            painted = every
        self._rec.send_columns(NODES, times, rr.GraphNodes.columns(colors=painted.reshape(-1)).partition(each))


def scale(values: np.ndarray, low: float, high: float) -> np.ndarray:
    return colours.scale_colours(np.where(np.isfinite(values), values, np.nan), low, high)


def graph_edges(header: Header) -> tuple[list[tuple[int, int]], bool]:
    """Pairs (from, to), and whether their direction matters. The slots say who listens; a central filter is a star."""
    if header.central:
        return [(k, header.nodes) for k in header.slots[0]], False
    heard = {(j, k) for k, slots in zip(header.estimator_nodes, header.slots) for j in slots if j != k}
    if len(header.estimator_nodes) < header.nodes:
        return sorted({(min(j, k), max(j, k)) for j, k in heard}), False
    if all((k, j) in heard for j, k in heard):
        return sorted((j, k) for j, k in heard if j < k), False
    return sorted(heard), True


def graph_positions(positions_m: np.ndarray | None, header: Header) -> np.ndarray:
    """The nodes' x and y, scaled for the view, whose y points down; a circle if they have none. The centre comes last."""
    if positions_m is None:
        angle = 2.0 * np.pi * np.arange(header.nodes) / header.nodes
        plane = np.stack([np.sin(angle), -np.cos(angle)], axis=1)
    else:
        plane = positions_m[:, :2] * (1.0, -1.0)
    low, high = plane.min(axis=0), plane.max(axis=0)
    extent = (high - low).max()
    plane = (plane - low) * (SPACING * max(2.0, np.sqrt(header.nodes)) / extent if extent > 0 else 1.0)
    if header.central:
        middle = plane.mean(axis=0)
        # Above a network of known positions, where no node is; a circle is empty in the middle.
        beside = [middle[0], -SPACING * max(1.0, np.sqrt(header.nodes) / 3.0)]
        plane = np.vstack([plane, middle if positions_m is None and header.nodes > 1 else beside])
    return plane
