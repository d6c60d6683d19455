# SPDX-License-Identifier: MIT
"""What the recording needs from the scenario JSON that a log's header carries: a name, and what is where."""

import json
import math
from dataclasses import dataclass

import numpy as np

from .fields import Header
from .reader import LogError

# East, north, up of a navigation log.
NAVIGATION_POSITION = (6, 7, 8)


@dataclass(frozen=True)
class Scenario:
    name: str
    node_positions_m: np.ndarray | None  # (N, 3); None unless every node has one, or, for tracking, if no node has: NaN where one is missing
    position_states: tuple[int, ...] | None  # 1 to 3 indices into the state
    tolerance: str
    weights: str
    # For tracking.
    sensors: tuple[str, ...] = ()  # kind of each node's
    range_limits_m: np.ndarray | None = None  # (N,), infinite where there is none
    planar: bool = True  # positions have two coordinates
    gate_policy: str = ""
    states: tuple[str, ...] = ()  # names, empty if they have none
    # Of monitors: how much rho must exceed its median at the end of a fault.
    jump: float = 0.0

    @property
    def all_positions_m(self) -> np.ndarray | None:
        """None unless every node has one."""
        positions = self.node_positions_m
        return None if positions is None or np.isnan(positions).any() else positions


def parse_scenario(header: Header) -> Scenario:
    try:
        document = json.loads(header.scenario)
    except (ValueError, RecursionError) as error:
        raise LogError(f"header: the scenario is not JSON: {error}") from None
    if not isinstance(document, dict):
        raise LogError("header: the scenario is not a JSON object")
    model = document.get("model")
    if header.tracking:
        return _parse_tracking(header, document, model)
    if header.navigation:
        return Scenario(_name(document), None, NAVIGATION_POSITION, tolerance="", weights="", planar=False, jump=_jump(document, header))
    return Scenario(
        name=_name(document),
        node_positions_m=_node_positions(document.get("nodes"), header.nodes),
        position_states=_position_states(model.get("position_states") if isinstance(model, dict) else None, header.states),
        tolerance=_short(document.get("tolerance")),
        weights=_short(document.get("weights")),
        jump=_jump(document, header),
    )


def _parse_tracking(header: Header, document: dict, model: object) -> Scenario:
    names = model.get("states") if isinstance(model, dict) else None
    nodes = document.get("nodes")
    if not isinstance(names, list) or len(names) != header.states:
        raise LogError(f"scenario: model.states are not the names of {header.states} states")
    if not isinstance(nodes, list) or len(nodes) != header.nodes or not all(isinstance(node, dict) for node in nodes):
        raise LogError(f"scenario: nodes are not {header.nodes} objects")
    position_states = tuple(names.index(name) for name in ("px", "py", "pz") if name in names)
    if len(position_states) != header.positions:
        raise LogError(f"scenario: {len(position_states)} of model.states are positions, the header says {header.positions}")
    limits = [node.get("range_limit_m", math.inf) for node in nodes]
    if not all(limit == math.inf or _is_number(limit) for limit in limits):
        raise LogError("scenario: range_limit_m of a node is not a number")
    settings = document.get("tracking")
    gate = settings.get("gate") if isinstance(settings, dict) else None
    return Scenario(
        name=_name(document),
        node_positions_m=_node_positions(nodes, header.nodes, partial=True),
        position_states=position_states or None,
        tolerance=_short(document.get("tolerance")) if header.filter == "rekfd" else "",
        weights="",
        sensors=tuple(str(node.get("sensor")) for node in nodes),
        range_limits_m=np.array(limits, dtype=np.float64),
        planar=len(position_states) < 3,
        states=tuple(map(str, names)),
        gate_policy=str(gate.get("policy", "skip")) if isinstance(gate, dict) else "skip",
        jump=_jump(document, header),
    )


def _name(document: dict) -> str:
    return str(document.get("name") or "unnamed")


def _jump(document: dict, header: Header) -> float:
    """As the simulator takes it where the scenario does not say."""
    settings = document.get("monitor")
    jump = settings.get("jump") if isinstance(settings, dict) else None
    return float(jump) if _is_number(jump) else 2.0 * header.monitor_window


def positions_of(states: np.ndarray, position_states: tuple[int, ...]) -> np.ndarray:
    """The positions in `states` (..., n) as (..., 3) for the scene; coordinates that are missing are 0."""
    out = np.zeros((*states.shape[:-1], 3), dtype=np.float32)
    # A diverged estimate may exceed float32; infinity is then the honest value.
    with np.errstate(over="ignore"):
        out[..., : len(position_states)] = states[..., list(position_states)]
    return out


def _node_positions(nodes: object, count: int, *, partial: bool = False) -> np.ndarray | None:
    if not isinstance(nodes, list) or len(nodes) != count:
        return None
    positions = np.zeros((count, 3))
    for row, node in zip(positions, nodes):
        position = node.get("position_m") if isinstance(node, dict) else None
        if position is None and partial:
            row[:] = np.nan
            continue
        if position is None:
            return None
        if not isinstance(position, list) or len(position) not in (2, 3) or not all(map(_is_number, position)):
            raise LogError("scenario: position_m of a node is not a list of 2 or 3 numbers")
        row[: len(position)] = position
    return None if np.isnan(positions).all() else positions


def _position_states(indices: object, states: int) -> tuple[int, ...] | None:
    if indices is None:
        return None
    valid = isinstance(indices, list) and len(indices) in (1, 2, 3) and all(type(i) is int and 0 <= i < states for i in indices)
    if not valid:
        raise LogError(f"scenario: model.position_states is not a list of 1 to 3 states from 0 to {states - 1}")
    return tuple(indices)


def _is_number(value: object) -> bool:
    return type(value) in (int, float) and math.isfinite(value)


def _short(value: object) -> str:
    """A value for one line of a table: a full matrix or list would bury the rest."""
    if value is None:
        return ""
    if isinstance(value, list):
        return f"list of {len(value)}"
    if isinstance(value, dict):
        return ", ".join(f"{key} {_short(item)}" for key, item in value.items())
    return f"{value:g}" if isinstance(value, float) else str(value)
