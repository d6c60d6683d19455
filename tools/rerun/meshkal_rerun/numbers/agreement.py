# SPDX-License-Identifier: MIT
"""How far the nodes of a distributed filter agree, beside how far they are from the truth. Numbers only, no rerun."""

from dataclasses import dataclass

import numpy as np

from meshkal_log.fields import Batch, Header
from meshkal_log.scenario import Scenario

from . import derive

# What the spread over the graph is measured from, and in how many steps of a batch.
_SOURCES = 24
_STEPS = 64


def applies(header: Header) -> bool:
    return not header.central and header.estimators > 1


@dataclass(frozen=True)
class Agreement:
    """Of a batch. Distances are those of positions where the scenario names position states, else norms over all states; NaN: unknown."""

    distance: np.ndarray  # (T, E): of a node's estimate from the mean of those that are finite
    rms: np.ndarray  # (T,) of the distances, and these
    median: np.ndarray
    largest: np.ndarray
    mean_error: np.ndarray | None  # (T,): of the mean estimate; None without a truth
    node_error: np.ndarray | None  # (T,): RMS over the nodes


def agreement(batch: Batch, scenario: Scenario) -> Agreement:
    """With mean error b, node error e and RMS distance d of the same nodes: e^2 = b^2 + d^2."""
    estimates = _shown(batch.estimate, scenario)
    known = np.isfinite(estimates).all(axis=2)
    count = known.sum(axis=1)
    there = count > 0
    total = np.where(known[:, :, None], estimates, 0.0)
    with np.errstate(over="ignore", invalid="ignore"):
        total = total.sum(axis=1)
        mean = np.divide(total, count[:, None], out=np.full(total.shape, np.nan), where=there[:, None])
        distance = _norms(estimates - mean[:, None])
        if batch.truth is None:
            errors = None, None
        else:
            truth = _shown(batch.truth, scenario)
            errors = derive.finite(_norms(truth - mean)), derive.finite(derive.root_mean_square(_norms(truth[:, None] - estimates)))
    return Agreement(distance, derive.root_mean_square(distance), derive.quietly(np.nanmedian, distance), derive.quietly(np.nanmax, distance), *errors)


def _shown(values: np.ndarray, scenario: Scenario) -> np.ndarray:
    return (values if scenario.position_states is None else values[..., list(scenario.position_states)]).astype(np.float64)


def _norms(values: np.ndarray) -> np.ndarray:
    return derive.finite(np.sqrt(np.einsum("...i,...i->...", values, values)))


def arrived(batch: Batch, header: Header) -> dict[str, np.ndarray]:
    """(T,): of what neighbours sent in a step, the share that arrived."""
    others = np.ones(sum(map(len, header.slots)), dtype=bool)
    others[header.slot_starts] = False
    if not others.any():
        return {}
    if header.tracking:
        if batch.messages_arrived is None or not header.messages:
            return {}
        return {"messages": np.minimum(batch.messages_arrived[:, others] / header.messages, 1.0).mean(axis=1)}
    out = {"readings": (batch.measurements_arrived[:, others] != 0).mean(axis=1)}
    if batch.estimates_arrived is not None:
        out["estimates"] = (batch.estimates_arrived[:, others] != 0).mean(axis=1)
    return out


class OverGraph:
    """RMS distance of the estimates of two nodes by the number of links between them: from some nodes to all, in some steps of each batch."""

    def __init__(self, header: Header, scenario: Scenario) -> None:
        self._scenario = scenario
        self._sources = np.unique(np.linspace(0, header.estimators - 1, min(_SOURCES, header.estimators)).round().astype(np.intp))
        self._links = links(header, self._sources)
        size = int(self._links.max(initial=0)) + 1
        self._squares, self._known = np.zeros(size), np.zeros(size)

    def batch(self, batch: Batch) -> None:
        at = np.unique(np.linspace(0, len(batch.step) - 1, min(_STEPS, len(batch.step))).round().astype(np.intp))
        estimates = _shown(batch.estimate[at], self._scenario)
        for source, away in zip(self._sources, self._links):
            with np.errstate(over="ignore", invalid="ignore"):
                squares = np.square(_norms(estimates - estimates[:, source, None]))
            use = np.isfinite(squares) & (away > 0)
            steps, nodes = np.nonzero(use)
            self._squares += np.bincount(away[nodes], weights=squares[steps, nodes], minlength=len(self._squares))
            self._known += np.bincount(away[nodes], minlength=len(self._known))

    def distances(self) -> np.ndarray:
        """[l]: of nodes that are l + 1 links apart."""
        return np.sqrt(np.divide(self._squares, self._known, out=np.full(len(self._known), np.nan), where=self._known > 0))[1:]


def links(header: Header, sources: np.ndarray) -> np.ndarray:
    """(sources, E): how many links each estimator is from each source, whoever listens to whom; -1: there is no way."""
    place = {node: e for e, node in enumerate(header.estimator_nodes)}
    near: list[set[int]] = [set() for _ in place]
    for e, slots in enumerate(header.slots):
        for node in slots:
            if node in place and place[node] != e:
                near[e].add(place[node])
                near[place[node]].add(e)
    out = np.full((len(sources), len(place)), -1, dtype=np.intp)
    for row, source in zip(out, sources):
        row[source], front, away = 0, [int(source)], 0
        while front:
            away += 1
            front = [e for e in {e for k in front for e in near[k]} if row[e] < 0]
            row[front] = away
    return out
