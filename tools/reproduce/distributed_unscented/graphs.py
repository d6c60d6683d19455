# SPDX-License-Identifier: MIT
"""The paper's protocol on graphs that meet its convergence theorem and on graphs that do not: the library's iterations, beside powers of the
weight matrix."""

from dataclasses import dataclass

import numpy as np
from program import Program, ReproduceError

ITERATIONS = 60
PATH = ((0, 1), (1, 2))


@dataclass(frozen=True)
class Graph:
    """hears[i]: whom node i hears."""

    title: str
    hears: tuple[tuple[int, ...], ...]
    measures: tuple[int, ...]
    converges: bool

    def weights(self) -> np.ndarray:
        """Row i: what node i makes of the others' values in one iteration."""
        n = len(self.hears)
        matrix = np.zeros((n, n))
        for i, (near, g) in enumerate(zip(self.hears, self.measures)):
            matrix[i, list(near)] = 1.0
            matrix[i, i] = g
            if matrix[i].sum() == 0.0:
                matrix[i, i] = 1.0
        return matrix / matrix.sum(axis=1, keepdims=True)

    def second_eigenvalue(self) -> float:
        return float(np.sort(np.abs(np.linalg.eigvals(self.weights())))[-2])


def _undirected(n: int, edges: tuple) -> tuple[tuple[int, ...], ...]:
    return tuple(tuple(sorted({j for e in edges if i in e for j in e} - {i})) for i in range(n))


_RING = tuple(((i - 1) % 4,) for i in range(4))
GRAPHS = (
    Graph("path, all measure", _undirected(3, PATH), (1, 1, 1), converges=True),
    Graph("path, one end measures", _undirected(3, PATH), (1, 0, 0), converges=True),
    Graph("triangle, none measures", _undirected(3, (*PATH, (0, 2))), (0, 0, 0), converges=True),
    Graph("directed ring of 4, one measures", _RING, (1, 0, 0, 0), converges=True),
    Graph("directed tree, its root measures", ((), (0,), (0,), (1,)), (1, 0, 0, 0), converges=True),
    Graph("path, none measures", _undirected(3, PATH), (0, 0, 0), converges=False),
    Graph("directed ring of 4, none measures", _RING, (0, 0, 0, 0), converges=False),
    Graph("two parts, all measure", _undirected(4, ((0, 1), (2, 3))), (1, 1, 1, 1), converges=False),
    Graph("two roots measure, one node hears both", ((), (0, 2), ()), (1, 0, 1), converges=False),
)


def iterate(program: Program, graph: Graph, start: np.ndarray) -> np.ndarray:
    """Values at the nodes after 0 .. ITERATIONS iterations by the library."""
    lines = [f"paper {ITERATIONS} {len(start)}"]
    for value, near, g in zip(start, graph.hears, graph.measures):
        lines.append(" ".join(map(str, (g, repr(float(value)), len(near), *near))))
    values = np.array([line.split() for line in program.beside("consensus-run", "\n".join(lines)).splitlines()], float)
    if values.shape != (ITERATIONS + 1, len(start)):
        raise ReproduceError(f"consensus-run: {len(values)} lines on the graph '{graph.title}'")
    return values


def disagreement(values: np.ndarray) -> np.ndarray:
    """Largest distance between two nodes after each iteration, relative to that at the start."""
    spread = np.ptp(values, axis=1)
    return spread / spread[0]
