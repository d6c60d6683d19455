# SPDX-License-Identifier: MIT
"""Steps of several nodes put together while they come, as meshkal_log.joined does with files."""

import json
import time
from dataclasses import replace

from meshkal_log.fields import Header
from meshkal_log.joined import MAY_BE_ABSENT, JoinedReader

# A step waits so long for nodes that have lately said something.
_HOLD_S = 0.15
_SILENT_S = 2.0
_MOST_STEPS = 1000


class Joining(JoinedReader):
    """All nodes of the scenario have a place from the beginning: those that are silent are unknown, and may begin to speak at any time."""

    def __init__(self, first: Header) -> None:
        self.header = replace(first, estimators=first.nodes, estimator_nodes=tuple(range(first.nodes)), slots=_slots(first))
        self.late = 0  # came after the others were shown
        self._headers: dict[int, Header] = {}
        self._heard: dict[int, float] = {}
        self._last: dict[int, tuple[int, int]] = {}
        self._open: dict[tuple[int, int], tuple[float, dict[int, dict]]] = {}
        self._shown = (-1, -1)
        self._absent: set[str] | None = None  # arrays that no node had in the first step
        self._needed = ("estimates_arrived", *(("position_covariance",) if first.positions else ()))

    def node(self, node: int, header: Header) -> bool:
        """Tells of a node. False if its links are not those of the scenario: it cannot be shown with the others."""
        if header.slots != (self.header.slots[node],):
            return False
        self._headers[node] = header
        return True

    def put(self, node: int, item: dict, now: float) -> None:
        if node not in self._headers or any(key not in item for key in self._needed):
            return
        at = (item["run"], item["step"])
        self._heard[node], self._last[node] = now, at
        if at <= self._shown:
            self.late += 1
            return
        self._open.setdefault(at, (now, {}))[1][node] = item

    def silent(self, node: int) -> None:
        """The node has ended: nobody waits for it."""
        self._heard.pop(node, None)

    def ready(self, now: float) -> list[dict]:
        out = []
        speaking = [node for node, when in self._heard.items() if now - when < _SILENT_S]
        for at in sorted(self._open):
            since, parts = self._open[at]
            whole = all(self._last[node] >= at for node in speaking)
            if not whole and now - since < _HOLD_S and len(self._open) < _MOST_STEPS:
                break
            del self._open[at]
            self._shown = at
            if self._absent is None:
                self._absent = {key for key in MAY_BE_ABSENT if not any(key in item for item in parts.values())}
            out.append(self._together(*at, [(self._headers[node], item) for node, item in parts.items()], self._absent))
        return out

    def due(self) -> float:
        return min((since for since, _ in self._open.values()), default=float("inf")) + _HOLD_S - time.monotonic()


def _slots(header: Header) -> tuple[tuple[int, ...], ...]:
    """Of all nodes, from the links of the scenario: itself first, then its neighbours in ascending order."""
    near: list[set[int]] = [set() for _ in range(header.nodes)]
    for i, j in json.loads(header.scenario).get("edges", ()):
        near[i].add(j)
        near[j].add(i)
    return tuple((k, *sorted(near[k])) for k in range(header.nodes))
