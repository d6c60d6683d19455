# SPDX-License-Identifier: MIT
"""What is shown of one estimator: its states and their variances, the innovations of its own sensor, its test quantity against chi-square, and
what reached it. Numbers only, no rerun."""

from collections.abc import Sequence
from enum import IntEnum

import numpy as np

from meshkal_log.fields import Batch, Header
from meshkal_log.scenario import Scenario
from . import derive, quantiles
from .departures import Episode

SIGMAS = 3.0
TAIL = 1e-3  # of the test: exceeded once in so many steps by a filter whose model fits
INNER_TAIL = 0.05
_UNITS = {"p": "m", "v": "m/s"}
_AXES = "xyz"


def state_names(header: Header, scenario: Scenario) -> list[str]:
    """With units where the scenario gives them a meaning."""
    out = []
    for i in range(header.states):
        if scenario.states:
            name = scenario.states[i]
            unit = "rad/s" if name == "omega" else _UNITS.get(name[0]) if len(name) == 2 and name[1] in _AXES else None
            out.append(f"{name}, {unit}" if unit else name)
        elif scenario.position_states and i in scenario.position_states:
            out.append(f"state {i} (position {_AXES[scenario.position_states.index(i)]})")
        else:
            out.append(f"state {i}")
    return out


def variances(batch: Batch, header: Header, scenario: Scenario, e: int) -> np.ndarray:
    """(T, n): of the covariance that the estimator holds; NaN where the log has none."""
    if batch.variance is not None:
        out = derive.finite(batch.variance[:, e])
    else:
        out = np.full((len(batch.step), header.states), np.nan)
        if batch.position_covariance is not None:
            for row, state in enumerate(scenario.position_states or ()):
                out[:, state] = derive.finite(batch.position_covariance[:, e, row * (row + 1) // 2 + row])
    return np.where(out >= 0.0, out, np.nan)


def errors(batch: Batch, e: int) -> np.ndarray | None:
    """Estimate less truth (T, n)."""
    if batch.truth is None:
        return None
    with np.errstate(invalid="ignore", over="ignore"):
        return derive.finite(batch.estimate[:, e].astype(np.float64) - batch.truth)


def own_rows(header: Header, e: int) -> slice:
    """Where the estimator's numbers are in `innovation` of a linear log."""
    first = sum(header.own_rows[:e])
    return slice(first, first + header.own_rows[e])


def test_ratio(nis: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of the test quantity to what it exceeds with probability TAIL, and the same of what it exceeds with INNER_TAIL."""
    outer = quantiles.chi_square(TAIL, rows)
    return derive.finite(nis) / outer, quantiles.chi_square(INNER_TAIL, rows) / outer


class Arrival(IntEnum):
    """What came of a neighbour in a step."""

    ALL, NO_ESTIMATE, NO_READING, NOTHING, HELD, FAULTY = range(6)


def arrivals(batch: Batch, header: Header, e: int, l: int, fault: np.ndarray | None) -> np.ndarray:
    """(T,): of slot l, numbers of Arrival. What a neighbour does not send (a reading, where only estimates are exchanged) is not missing. fault:
    (T, N), of integrity.faulty_now."""
    at = int(header.slot_starts[e]) + l
    reading = np.ones(len(batch.step), dtype=bool)
    estimate = reading if batch.estimates_arrived is None or (l == 0 and not header.central) else batch.estimates_arrived[:, at] != 0
    if l < header.heard[e] and header.rows[header.slots[e][l]]:
        reading = batch.measurements_arrived[:, at] != 0
        if batch.measuring is not None:
            reading = reading | (batch.measuring[:, header.slots[e][l]] == 0)
    nothing = ~estimate & (~reading if l < header.heard[e] else True) if batch.estimates_arrived is not None else ~reading
    out = np.select([nothing, ~reading, ~estimate], [Arrival.NOTHING, Arrival.NO_READING, Arrival.NO_ESTIMATE], Arrival.ALL)
    if fault is not None and l < header.heard[e]:
        out = np.where((fault[:, header.slots[e][l]] != 0.0) & (batch.measurements_arrived[:, at] != 0), int(Arrival.FAULTY), out)
    if batch.excluded is not None:
        out = np.where(batch.excluded[:, at] != 0, int(Arrival.HELD), out)
    return out


def departed(batch: Batch, episodes: Sequence[Episode]) -> np.ndarray:
    """(T,): 0 as usual, 1 the test quantity departs, 2 the error does."""
    out = np.zeros(len(batch.step), dtype=np.int64)
    for episode in episodes:
        inside = (batch.step >= episode.begin_step) & (batch.step <= episode.end_step)
        out = np.where(inside, np.maximum(out, 2 if episode.of_error else 1), out)
    return out
