# SPDX-License-Identifier: MIT
"""The text beside the pictures of agreement."""

import numpy as np

from meshkal_log.fields import Batch, Header
from meshkal_log.scenario import Scenario
from ..numbers.agreement import Agreement
from .linear import table


class AgreementSummary:
    def __init__(self, header: Header, scenario: Scenario) -> None:
        self._header, self._scenario = header, scenario
        self._unit = " m" if scenario.position_states else ""
        # Sums of squares and how many are known: RMS distance, error of the mean, error of the nodes.
        self._squares, self._known = np.zeros(3), np.zeros(3)
        self._node_squares, self._node_known = np.zeros(header.estimators), np.zeros(header.estimators)
        self._last = float("nan")
        self._largest: tuple[float, int, int] | None = None
        self._shares: dict[str, list[float]] = {}

    def batch(self, batch: Batch, found: Agreement, shares: dict[str, np.ndarray]) -> None:
        for i, values in enumerate((found.rms, found.mean_error, found.node_error)):
            if values is not None:
                self._squares[i] += _squares(values)
                self._known[i] += np.isfinite(values).sum()
        known = np.isfinite(found.distance)
        with np.errstate(over="ignore"):
            self._node_squares += np.square(np.where(known, found.distance, 0.0)).sum(axis=0)
        self._node_known += known.sum(axis=0)
        if known.any():
            t, e = np.unravel_index(int(np.nanargmax(found.distance)), found.distance.shape)
            if self._largest is None or found.distance[t, e] > self._largest[0]:
                self._largest = float(found.distance[t, e]), int(e), int(batch.step[t])
        self._last = float(found.rms[-1])
        for what, share in shares.items():
            total = self._shares.setdefault(what, [0.0, 0])
            total[0] += float(share.sum())
            total[1] += len(share)

    def text(self, over_graph: np.ndarray) -> str:
        """over_graph: RMS distance of nodes that are so many links apart, from 1."""
        rms = np.sqrt(np.divide(self._squares, self._known, out=np.full(3, np.nan), where=self._known > 0))
        rows = [("RMS distance from the mean estimate", self._value(rms[0])), ("at the last step", self._value(self._last))]
        each = np.sqrt(np.divide(self._node_squares, self._node_known, out=np.full(len(self._node_known), np.nan), where=self._node_known > 0))
        if self._largest:
            farthest = int(np.nanargmax(each))
            rows.append(("farthest node, RMS", f"node {self._header.estimator_nodes[farthest]}, {self._value(each[farthest])}"))
            value, e, step = self._largest
            rows.append(("largest distance", f"{self._value(value)}, node {self._header.estimator_nodes[e]} at step {step}"))
        if self._known[1]:
            rows.append(("RMS error of the nodes", self._value(rms[2])))
            rows.append(("RMS error of their mean", self._value(rms[1])))
            if rms[2] > 0.0:
                rows.append(("disagreement's share of squared error", f"{100.0 * min((rms[0] / rms[2]) ** 2, 1.0):.0f} %"))
        for what, (total, count) in self._shares.items():
            rows.append((f"{what} of neighbours that arrived", f"{100.0 * total / count:.1f} %"))
        known = np.flatnonzero(np.isfinite(over_graph))
        if len(known) > 1:
            near, far = known[0], known[-1]
            rows.append((f"distance {near + 1} and {far + 1} links apart", f"{self._value(over_graph[near])}, {self._value(over_graph[far])}"))
        return table("Agreement", rows) + "\n\n" + self._legend()

    def _value(self, value: float) -> str:
        return f"{value:.3g}{self._unit}" if np.isfinite(value) else "unknown"

    def _legend(self) -> str:
        what = "positions, in metres" if self._scenario.position_states else "estimates: the norm over all states, in their units"
        lines = [
            "**How to read it**", "",
            f"- All distances are of {what}. The mean is that of all nodes whose estimate is finite.",
            "- Agreement is not correctness: squared error of the nodes = squared error of their mean + squared distance from it. Where the error of the "
            "mean is nearly all of it, the nodes agree on something wrong, and more exchange does not help.",
            "- Messages: of what neighbours sent in a step, the share that arrived. Readings of neighbours, too, are messages.",
        ]
        if self._header.tracking:
            lines.append("- Disagreement, as the log has it, is the largest distance of two estimates, and not from the mean.")
        if self._header.iterations:
            lines.append("- Consensus: largest distance of a node's information matrix from the mean of all, in dB of it, after so many iterations.")
        return "\n".join(lines)


def _squares(values: np.ndarray) -> float:
    with np.errstate(over="ignore"):
        return float(np.nansum(np.square(values)))
