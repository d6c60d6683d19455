# SPDX-License-Identifier: MIT
"""What must hold of every batch, and what is said."""

import numpy as np
from statements import CLAIM, MUST, OPEN, Property

from .batches import Batch
from .graphs import GRAPHS, ITERATIONS, Graph, disagreement

# Relative; a linear solve with three sensors loses some digits.
EQUAL = 1e-9
# Disagreement counts as gone, or as kept, if this much is left at the end of what there was after EARLY iterations.
EARLY, GONE, KEPT = 5, 0.01, 0.5
FLOOR = 1e-12


def node_rmse(batch: Batch, variant: str) -> np.ndarray:
    item = batch.of[variant]
    return np.array(item.get("node_position_rmse", [item["position_rmse"]]))


def central_rmse(batch: Batch, where: str) -> float:
    return batch.of[f"{where}, centralised"]["position_rmse"]


def excess(batch: Batch, variant: str) -> float:
    """Largest relative distance of a node's RMSE from that of the centralised filter."""
    where = variant.split(",")[0]
    return float(np.abs(node_rmse(batch, variant) / central_rmse(batch, where) - 1.0).max())


def rate(curve: np.ndarray) -> float:
    """What disagreement is multiplied by in one iteration, at last: from where the other eigenvectors are gone to where rounding
    begins. NaN if it does not fall so far."""
    above = np.nonzero(curve < FLOOR * 1e3)[0]
    last = int(above[0]) - 1 if len(above) else len(curve) - 1
    first = last - 8
    if first < 5 or curve[first] <= 0.0:
        return float("nan")
    return float((curve[last] / curve[first]) ** (1.0 / (last - first)))


def rates(batch: Batch, protocol: str) -> np.ndarray:
    return np.array([rate(curve) for curve in batch.disagreement[protocol]])


def _rate_error(batch: Batch, protocol: str) -> float:
    return float(np.abs(rates(batch, protocol) / batch.eigenvalue(protocol) - 1.0).max())


def _apart(batch: Batch, one: str, other: str) -> float:
    a, b = batch.estimates[one], batch.estimates[other]
    return float(np.abs(a - b).max() / np.abs(b).max())


def _left(batch: Batch, graph: Graph) -> float:
    """Of the disagreement, over some iterations each: a swing may pass through zero."""
    curve = disagreement(batch.graphs[graph.title])
    early = curve[EARLY : EARLY + 4].max()
    return float(curve[-4:].max() / early) if early > 0.0 else 0.0


def _powers_error(batch: Batch) -> float:
    """Of the library's iterations from the powers of the weight matrix."""
    worst = 0.0
    for graph in GRAPHS:
        values, matrix = batch.graphs[graph.title], graph.weights()
        expected = values[0]
        for step in range(1, ITERATIONS + 1):
            expected = matrix @ expected
            worst = max(worst, float(np.abs(values[step] - expected).max() / np.abs(values[0]).max()))
    return worst


def _limit_error(batch: Batch) -> float:
    """Of the limit on connected undirected graphs from sum pi_j s_j, pi_j = (deg_j + g_j) / sum."""
    worst = 0.0
    for graph in GRAPHS:
        undirected = all(i in graph.hears[j] for i, near in enumerate(graph.hears) for j in near)
        if graph.converges and undirected:
            weight = np.array([len(near) + g for near, g in zip(graph.hears, graph.measures)], float)
            values = batch.graphs[graph.title]
            left = graph.second_eigenvalue() ** ITERATIONS
            worst = max(worst, float(np.abs(values[-1] - weight @ values[0] / weight.sum()).max() / np.ptp(values[0])) - 2.0 * left)
    return worst


def _within(kind: str, variant: str, text: str) -> Property:
    return Property(kind, f"RMSE of every node within 1 % of the centralised: {text}", "largest, relative", lambda b: excess(b, variant), "<", 0.01)


def _equal(one: str, other: str, text: str) -> Property:
    return Property(MUST, text, "largest difference of a state, relative", lambda b: _apart(b, one, other), "<", EQUAL)


def _slope(protocol: str) -> Property:
    text = f"disagreement falls as the second eigenvalue that design tells: {protocol}"
    return Property(MUST, text, "largest, relative", lambda b: _rate_error(b, protocol), "<", 1e-2)


def _theorem(graph: Graph) -> Property:
    if graph.converges:
        return Property(MUST, f"theorem met, agrees: {graph.title}", f"left from {EARLY} to {ITERATIONS}", lambda b: _left(b, graph), "<", GONE)
    return Property(MUST, f"theorem broken, never agrees: {graph.title}", f"left from {EARLY} to {ITERATIONS}", lambda b: _left(b, graph), ">", KEPT)


PROPERTIES = [
    _equal("metropolis", "centralised", "Metropolis, L = 100: the centralised filter"),
    _equal("perron", "centralised", "paper's protocol, scaled, L = 100: the centralised filter"),
    _equal("ratio", "centralised", "ratio consensus, L = 100: the centralised filter"),
    _equal("paper", "Perron mean", "paper's protocol, L = 100: its Perron mean"),
    Property(MUST, "paper's protocol, L = 100: not the centralised filter", "largest difference of a state, relative",
             lambda b: _apart(b, "paper", "centralised, information as published"), ">", 1e-6),
    _within(CLAIM, "all, paper, 10", "all visible, paper's protocol, L = 10"),
    _within(MUST, "all, metropolis, 10", "all visible, Metropolis, L = 10"),
    _within(CLAIM, "100 m, paper, 10", "range 100 m, paper's protocol, L = 10"),
    _within(OPEN, "100 m, metropolis, 10", "range 100 m, Metropolis, L = 10"),
    _within(OPEN, "85 m, paper, 10", "range 85 m, paper's protocol, L = 10"),
    _slope("paper"),
    _slope("perron"),
    _slope("metropolis"),
    _slope("ratio"),
    *(_theorem(graph) for graph in GRAPHS),
    Property(MUST, "iterations of the library: powers of the weight matrix", "largest, relative", _powers_error, "<", 1e-12),
    Property(MUST, "their limit, undirected: sum of pi_j s_j", "beyond 2 lambda^L", _limit_error, "<", 1e-12),
    Property(MUST, "more iterations, less disagreement: range 85 m, L = 1, 3, 10", "largest ratio of rms",
             lambda b: max(b.of["85 m, paper, 3"]["disagreement_rms"] / b.of["85 m, paper, 1"]["disagreement_rms"],
                           b.of["85 m, paper, 10"]["disagreement_rms"] / b.of["85 m, paper, 3"]["disagreement_rms"]), "<", 1.0),
    Property(MUST, "without consensus ten times the error", "smallest ratio",
             lambda b: float(node_rmse(b, "alone").min() / central_rmse(b, "all")), ">", 10.0),
]  # fmt: skip
