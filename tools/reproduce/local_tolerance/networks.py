# SPDX-License-Identifier: MIT
"""More edges between the same nodes."""

import itertools
import math


def denser(scenario: dict, density: float) -> dict:
    """The shortest missing edges are added until a node has `density` neighbours on average, itself included. All old edges stay, so
    scenarios of rising density have nested edge sets."""
    place = [node["position_m"] for node in scenario["nodes"]]
    present = edges_of(scenario)
    pairs = itertools.combinations(range(len(place)), 2)
    missing = sorted((math.dist(place[i], place[j]), i, j) for i, j in pairs if (i, j) not in present)
    wanted = round((density - 1) * len(place) / 2) - len(present)
    return _with_edges(scenario, present | {(i, j) for _, i, j in missing[: max(0, wanted)]}, f"density-{density:g}")


def complete(scenario: dict) -> dict:
    return _with_edges(scenario, set(itertools.combinations(range(len(scenario["nodes"])), 2)), "complete")


def edges_of(scenario: dict) -> set[tuple[int, int]]:
    return {(min(edge), max(edge)) for edge in scenario["edges"]}


def neighbourhoods(scenario: dict) -> list[set[int]]:
    """A node belongs to its own."""
    near = [{k} for k in range(len(scenario["nodes"]))]
    for i, j in scenario["edges"]:
        near[i].add(j)
        near[j].add(i)
    return near


def mean_degree(scenario: dict) -> float:
    return 1.0 + 2.0 * len(scenario["edges"]) / len(scenario["nodes"])


def _with_edges(scenario: dict, edges: set[tuple[int, int]], suffix: str) -> dict:
    return {**scenario, "name": f"{scenario['name']}-{suffix}", "edges": [list(edge) for edge in sorted(edges)]}
