# SPDX-License-Identifier: MIT
"""What each array of a log has one number of, its unit and its meaning: for `read`, for tables and for messages. Names are those of the log."""

import json
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from .fields import Batch, Header
from .reader import LogError


class Axis(Enum):
    """What a step has one row of; the value is the name of the table."""

    STEP = "steps"
    ESTIMATOR = "nodes"
    NODE = "sensors"
    ROW = "readings"
    SLOT = "links"
    PAIR = "innovation_covariance"


class Inner(Enum):
    """What a row has several numbers of."""

    NONE, STATES, POSITION, ITERATIONS = range(4)


@dataclass(frozen=True)
class Array:
    axis: Axis
    meaning: str
    unit: str = ""
    inner: Inner = Inner.NONE
    flag: bool = False  # 0 or 1 in the log


_STEP, _EACH, _NODE, _ROW, _SLOT, _PAIR = Axis

ARRAYS = {
    "truth": Array(_STEP, "true state", inner=Inner.STATES),
    "disagreement": Array(_STEP, "largest distance between the positions of two estimates", "m"),
    "consensus_disagreement": Array(
        _STEP, "largest relative distance of a node's information from the mean, after so many iterations", inner=Inner.ITERATIONS
    ),
    "correction": Array(_STEP, "what the update found, in the error's states", inner=Inner.STATES),
    "estimate": Array(_EACH, "estimated state", inner=Inner.STATES),
    "variance": Array(_EACH, "diagonal of the covariance that the node holds", inner=Inner.STATES),
    "error": Array(_EACH, "length of truth less estimate; navigation: of the position"),
    "nees": Array(_EACH, "normalised estimation error squared"),
    "trace_covariance": Array(_EACH, "trace of the covariance that the node holds"),
    "position_covariance": Array(_EACH, "covariance of the position that the node holds", inner=Inner.POSITION),
    "theta": Array(_EACH, "risk sensitivity"),
    "tolerance": Array(_EACH, "tolerance used, twice the Kullback-Leibler divergence", "nat"),
    "nis": Array(_EACH, "normalised innovation squared of all readings used"),
    "nis_rows": Array(_EACH, "its degrees of freedom"),
    "frozen": Array(_EACH, "the step took the frozen gain: there is no nis", flag=True),
    "faults": Array(_EACH, "bit mask of MK_FAULT_, 0 if none"),
    "gate_stacked_ratio": Array(_EACH, "test ratio of all readings together, 0 where not judged"),
    "monitor_rctm": Array(_EACH, "statistic of the epoch"),
    "monitor_rctm_rows": Array(_EACH, "its degrees of freedom"),
    "monitor_aime": Array(_EACH, "statistic of the window"),
    "monitor_aime_rows": Array(_EACH, "its degrees of freedom"),
    "monitor_threshold": Array(_EACH, "threshold of the statistic that is tested, 0 where it has no rows"),
    "monitor_alarm": Array(_EACH, "the test refuses the epoch", flag=True),
    "monitor_ended": Array(_EACH, "a fault was found to be over", flag=True),
    "monitor_rho": Array(_EACH, "ratio that the end of a fault is decided with"),
    "monitor_median": Array(_EACH, "its median"),
    "measuring": Array(_NODE, "the sensor gave a reading", flag=True),
    "faulty": Array(_NODE, "a fault was drawn for the reading", flag=True),
    "azimuth_deg": Array(_NODE, "of the satellite, clockwise from north", "deg"),
    "elevation_deg": Array(_NODE, "of the satellite", "deg"),
    "measurements": Array(_ROW, "reading, NaN where there is none"),
    "fault": Array(_ROW, "what faults added to the reading"),
    "innovation": Array(_ROW, "reading less its prediction by the node's estimator, NaN where there is none"),
    "innovation_variance": Array(_ROW, "variance of the innovation by the estimator"),
    "measurements_arrived": Array(_SLOT, "the reading was used, or left out as excluded", flag=True),
    "estimates_arrived": Array(_SLOT, "the estimate was used", flag=True),
    "messages_arrived": Array(_SLOT, "how many messages of the neighbour arrived"),
    "decision": Array(_SLOT, "0 no reading, 1 used, 2 refused by gate or weight, 3 used with less weight, 4 refused by the model"),
    "gate_ratio": Array(_SLOT, "test ratio of the reading, 0 where not judged"),
    "weight": Array(_SLOT, "weight of the reading, 0 where not used"),
    "weight_statistic": Array(_SLOT, "statistic that the weight comes from"),
    "excluded": Array(_SLOT, "the sensor is held faulty, its reading left out", flag=True),
    "isolation": Array(_SLOT, "what leaving the sensor out takes from monitor_aime"),
    "end_ratio": Array(_SLOT, "evidence that the fault is over, 1 at the decision"),
    "innovation_covariance": Array(_PAIR, "H P H' + R, NaN where there is no reading", "m^2"),
}

_MOST_STATES = 1 << 16  # a scenario has 64 at most

_NAVIGATION_STATES = {
    **dict.fromkeys(("roll", "pitch", "heading"), "rad"),
    **dict.fromkeys(("velocity_east", "velocity_north", "velocity_up"), "m/s"),
    **dict.fromkeys(("east", "north", "up"), "m"),
    **dict.fromkeys(("gyro_bias_right", "gyro_bias_forward", "gyro_bias_up"), "rad/s"),
    **dict.fromkeys(("accelerometer_bias_right", "accelerometer_bias_forward", "accelerometer_bias_up"), "m/s^2"),
    "clock_bias": "m",
    "clock_drift": "m/s",
}
_TRACKING_UNITS = {**dict.fromkeys(("px", "py", "pz"), "m"), **dict.fromkeys(("vx", "vy", "vz"), "m/s"), "omega": "rad/s"}


@dataclass(frozen=True)
class States:
    """Names of the states for columns, their units ("" unknown), and the names of those that are a position."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    position: tuple[str, ...]


def scenario_of(header: Header) -> dict:
    """The scenario as it was written; empty if it is not a JSON object, as a log of other tools may have it."""
    try:
        document = json.loads(header.scenario)
    except (ValueError, RecursionError):
        return {}
    return document if isinstance(document, dict) else {}


def as_texts(items: dict) -> dict[str, str]:
    """For metadata that can only be text: text as it is, everything else as JSON."""
    return {str(key): value if isinstance(value, str) else json.dumps(value, default=str) for key, value in items.items()}


def states_of(header: Header) -> States:
    """Of a linear scenario, whose states have no names, their numbers. Names that cannot be parts of a column's are numbers, too."""
    if header.states > _MOST_STATES:
        raise LogError(f"header: {header.states} states are more than there can be")
    model = scenario_of(header).get("model")
    model = model if isinstance(model, dict) else {}
    numbers = tuple(str(i) for i in range(header.states))
    if header.navigation:
        names, units = tuple(_NAVIGATION_STATES), tuple(_NAVIGATION_STATES.values())
        return States(names, units, names[6:9])
    if header.tracking:
        given = model.get("states")
        names = tuple(given) if _usable(given, header.states) else numbers
        position = tuple(name for name in ("px", "py", "pz") if name in names)
        return States(names, tuple(_TRACKING_UNITS.get(name, "") for name in names), _position(position, header))
    given = model.get("position_states")
    valid = isinstance(given, list) and all(type(i) is int and 0 <= i < header.states for i in given)
    return States(numbers, ("",) * header.states, _position(tuple(str(i) for i in given) if valid else (), header))


def _usable(names: object, count: int) -> bool:
    valid = isinstance(names, list) and all(isinstance(name, str) and name.isascii() and name.isidentifier() for name in names)
    return valid and len({name.lower() for name in names}) == len(names) == count


def _position(names: tuple[str, ...], header: Header) -> tuple[str, ...]:
    """A scenario that does not fit its header leaves coordinates without names."""
    return names if len(set(names)) == header.positions else tuple(f"p{i}" for i in range(header.positions))


def slot_estimator(header: Header) -> np.ndarray:
    """Which estimator, from 0, each slot belongs to."""
    return np.repeat(np.arange(header.estimators, dtype=np.int32), [len(s) for s in header.slots])


def slot_node(header: Header) -> np.ndarray:
    """Which node each slot listens to."""
    return np.array([node for slots in header.slots for node in slots], dtype=np.int32)


def whole_rows(batch: Batch, header: Header) -> Batch:
    """Innovations beside the measurements: a column for each of their rows, NaN for those of nodes that have no estimator in the log."""
    rows = sum(header.rows)
    if header.navigation and set(header.rows) != {1}:
        raise LogError("header: a satellite of a navigation log has one row")
    if header.central or sum(header.own_rows) == rows:
        return batch
    of_row = row_node(header)
    own = np.concatenate([np.flatnonzero(of_row == node) for node in header.estimator_nodes])

    def whole(values: np.ndarray | None) -> np.ndarray | None:
        if values is None:
            return None
        out = np.full((len(values), rows), np.nan, dtype=values.dtype)
        out[:, own] = values
        return out

    return replace(batch, innovation=whole(batch.innovation), innovation_variance=whole(batch.innovation_variance))


def row_node(header: Header) -> np.ndarray:
    """Which node each row of the measurements belongs to."""
    return np.repeat(np.arange(header.nodes, dtype=np.int32), header.rows)


def symmetric(lower: np.ndarray, size: int) -> np.ndarray:
    """Full matrices (.., size, size) of rows of lower triangles (.., size (size + 1) / 2)."""
    full = np.empty((*lower.shape[:-1], size, size), dtype=lower.dtype)
    rows, columns = np.tril_indices(size)
    full[..., rows, columns] = lower
    full[..., columns, rows] = lower
    return full
