# SPDX-License-Identifier: MIT
"""What is drawn of a tracking log besides the quantities of derive.py. Numbers only, no rerun."""

import numpy as np

from meshkal_log.fields import Batch, Decision, Header
from meshkal_log.scenario import Scenario
from . import derive, quantiles

BAND = 0.95
# What a picture shows of a reading that several estimators heard: the worst that became of it. It is lost if nobody got it.
_WORST_LAST = (Decision.NONE, Decision.LOST, Decision.USED, Decision.INFLATED, Decision.REJECTED, Decision.REFUSED)
_RANK = np.array([_WORST_LAST.index(decision) for decision in Decision], dtype=np.int64)


class Slots:
    """Whose slots readings come to, and from which node: arrays over those slots of all estimators that are heard, `at` in those of the log."""

    def __init__(self, header: Header) -> None:
        heard = [(first + l, e, node) for e, (first, slots, count) in enumerate(zip(header.slot_starts, header.slots, header.heard))
                 for l, node in enumerate(slots[:count]) if header.rows[node]]
        self.at, self.estimator, self.node = np.array(heard, dtype=np.intp).reshape(-1, 3).T


def per_estimator(batch: Batch, header: Header, scenario: Scenario) -> dict[str, np.ndarray]:
    """Arrays (T, E) by the name of the quantity."""
    slots = Slots(header)
    lost = (batch.measuring[:, slots.node] != 0) & (batch.measurements_arrived[:, slots.at] == 0)
    missing = np.zeros((len(batch.step), header.estimators), dtype=np.int64)
    np.add.at(missing, (slice(None), slots.estimator), lost)
    quantities = {"missing_measurements": missing}
    if batch.messages_arrived is not None:
        short = np.maximum(header.messages - batch.messages_arrived.astype(np.int64), 0)
        short[:, header.slot_starts] = 0  # nobody sends to himself
        quantities["missing_messages"] = np.add.reduceat(short, header.slot_starts, axis=1)
    if batch.nees is not None:
        quantities["nees"] = derive.finite(batch.nees)
    error = position_error(batch, scenario)
    if error is not None:
        quantities["position_error"] = error
    return quantities


def network(quantities: dict[str, np.ndarray]) -> dict[str, dict[str, np.ndarray]]:
    summaries = {key: {"total": quantities[key].sum(axis=1)} for key in ("missing_measurements", "missing_messages") if key in quantities}
    if "nees" in quantities:
        nees = quantities["nees"]
        summaries["nees"] = {"mean": derive.quietly(np.nanmean, nees)} | derive.spread(nees, most="largest")
    if "position_error" in quantities:
        error = quantities["position_error"]
        summaries["position_error"] = {"rms": derive.root_mean_square(error)} | derive.spread(error, most="worst")
    return summaries


def position_error(batch: Batch, scenario: Scenario) -> np.ndarray | None:
    """Metres (T, E); NaN where a coordinate is unknown or infinite."""
    if batch.truth is None or not scenario.position_states:
        return None
    states = list(scenario.position_states)
    with np.errstate(invalid="ignore", over="ignore"):
        return derive.finite(np.linalg.norm(batch.truth[:, None, states] - batch.estimate[:, :, states].astype(np.float64), axis=2))


def decisions(batch: Batch, slots: Slots) -> np.ndarray:
    """(T, heard slots): as in the log, and LOST where the sensor gave a reading that did not arrive."""
    decided = batch.decision[:, slots.at].astype(np.int64)
    lost = (batch.measuring[:, slots.node] != 0) & (batch.measurements_arrived[:, slots.at] == 0)
    return np.where((decided == Decision.NONE) & lost, int(Decision.LOST), decided)


def worst_decisions(decided: np.ndarray, slots: Slots, nodes: int) -> np.ndarray:
    """(T, N): the worst that became of each node's reading at the estimators that hear it."""
    rank = np.zeros((len(decided), nodes), dtype=np.int64)
    np.maximum.at(rank, (slice(None), slots.node), _RANK[decided])
    return np.array(_WORST_LAST, dtype=np.int64)[rank]


class Held:
    """Decisions of sensors that give readings at times of their own: each holds until the next one, but not for longer than five of the sensor's
    usual intervals, the median of those in the first batch."""

    def __init__(self, nodes: int) -> None:
        self._limit = np.full(nodes, np.nan)
        self._state = np.full(nodes, int(Decision.NONE), dtype=np.int64)
        self._since = np.full(nodes, -np.inf)

    def states(self, time_s: np.ndarray, decided: np.ndarray) -> np.ndarray:
        """(T, N) like `decided`."""
        out = np.empty_like(decided)
        for node in range(decided.shape[1]):
            there = decided[:, node] != Decision.NONE
            if np.isnan(self._limit[node]) and there.sum() > 1:
                self._limit[node] = 5.0 * np.median(np.diff(time_s[there]))
            last = np.maximum.accumulate(np.where(there, np.arange(len(there)), -1))
            state = np.where(last >= 0, decided[last, node], self._state[node])
            since = np.where(last >= 0, time_s[last], self._since[node])
            out[:, node] = np.where(there | (time_s - since <= np.nan_to_num(self._limit[node])), state, int(Decision.NONE))
            self._state[node], self._since[node] = state[-1], since[-1]
        return out


class Links:
    """Links (M, 2) of two nodes, smaller first."""

    def __init__(self, header: Header) -> None:
        pairs: dict[tuple[int, int], list[int]] = {}
        for first, node, slots in zip(header.slot_starts, header.estimator_nodes, header.slots):
            for l, other in enumerate(slots):
                if other != node:
                    pairs.setdefault((min(node, other), max(node, other)), []).append(int(first) + l)
        self._slots = [pairs[link] for link in sorted(pairs)]
        self._messages = header.messages
        self.nodes = np.array(sorted(pairs), dtype=np.intp).reshape(-1, 2)

    def shares(self, messages_arrived: np.ndarray | None, steps: int) -> np.ndarray:
        """(T, M): of the messages that a link carries in a step, both directions, the share that arrived."""
        share = np.zeros((steps, len(self._slots)))
        if messages_arrived is not None and self._messages:
            for i, slots in enumerate(self._slots):
                share[:, i] = np.minimum(messages_arrived[:, slots] / self._messages, 1.0).mean(axis=1)
        return share


def middle(estimates: np.ndarray) -> np.ndarray:
    """Of the finite positions (T, E, 3) in each step; NaN where there is none."""
    known = np.isfinite(estimates).all(axis=2)
    total = np.where(known[:, :, None], estimates, 0.0).sum(axis=1, dtype=np.float64)
    count = known.sum(axis=1)[:, None]
    return np.divide(total, count, out=np.full(total.shape, np.nan), where=count > 0)


def nees_band(states: int, level: float = BAND) -> tuple[float, float]:
    """Where the NEES of one estimator in one step is with this probability, if its filter is exact."""
    tail = (1.0 - level) / 2.0
    return float(quantiles.chi_square(1.0 - tail, states)), float(quantiles.chi_square(tail, states))
