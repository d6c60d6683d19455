# SPDX-License-Identifier: MIT
"""Which estimators heard nothing for a while, and who got fewer messages than others. Numbers only, no rerun."""

import math
from dataclasses import dataclass

import numpy as np

from meshkal_log.fields import Batch, Header

_LEAST = 5  # steps
_UNLIKELY = 1e-7  # of so long a silence by loss alone


@dataclass(frozen=True)
class Silence:
    """From half of the neighbours on, or of the own sensor; at a centre, of any sensor."""

    estimator: int
    begin: int  # rows of the run
    end: int
    nodes: tuple[int, ...]  # that were silent when it began
    of: int  # so many neighbours, or sensors of a centre
    own: bool


def nothing_arrived(batch: Batch, header: Header) -> np.ndarray:
    """(T, slots): neither reading nor estimate; of the own slot, and at a centre, no reading. A sensor that does not see a target is not silent."""
    quiet = batch.measurements_arrived == 0
    if header.tracking:
        quiet = quiet if batch.estimates_arrived is None else batch.estimates_arrived == 0
        quiet[:, header.slot_starts if not header.central else slice(None)] = False
    elif batch.estimates_arrived is not None:
        heard = batch.estimates_arrived != 0
        heard[:, header.slot_starts] = False  # the own estimate is always there
        quiet = quiet & ~heard
        for first, slots in zip(header.slot_starts, header.slots):
            if not header.rows[slots[0]]:
                quiet[:, first] = False  # no sensor
    return quiet


def silent_steps(share: float, least: int = _LEAST, unlikely: float = _UNLIKELY) -> int:
    """So many steps without a message are no loss, where `share` of them are lost."""
    share = min(max(share, 0.0), 0.99)
    return max(least, math.ceil(math.log(unlikely) / math.log(share))) if share > 0.0 else least


class Silences:
    """Takes all batches of a run."""

    def __init__(self, header: Header) -> None:
        self._header = header
        slots = sum(map(len, header.slots))
        self._run = np.zeros(slots, dtype=np.int32)  # steps that each slot has been silent
        self._own = np.zeros(slots, dtype=bool)
        if not header.central:
            self._own[header.slot_starts] = True
        self._cut = np.zeros(header.estimators, dtype=bool)
        self._open: dict[int, tuple] = {}
        self._missing = np.zeros(slots)
        self._row = 0
        self._limit: int | None = None
        self.found: list[Silence] = []

    def batch(self, batch: Batch) -> None:
        header = self._header
        if header.navigation:
            return
        quiet, rows = nothing_arrived(batch, header), len(batch.step)
        arrived = [] if header.tracking and not header.central else [batch.measurements_arrived]
        arrived += [batch.estimates_arrived] if batch.estimates_arrived is not None else []
        self._missing += sum((messages == 0).mean(axis=0) for messages in arrived) / len(arrived) * rows
        if self._limit is None:
            self._limit = silent_steps(max(header.loss, float(np.median(quiet[:, ~self._own].mean(axis=0))) if (~self._own).any() else 0.0))
        row = np.arange(rows, dtype=np.int32)[:, None]
        run = row - np.maximum.accumulate(np.where(quiet, -1 - self._run, row), axis=0)
        self._run = run[-1]
        silent = run >= self._limit
        if silent.any() or self._cut.any():
            self._edges(silent)
        self._row += rows

    def _edges(self, silent: np.ndarray) -> None:
        starts = self._header.slot_starts
        others = np.add.reduceat((silent & ~self._own).astype(np.int32), starts, axis=1)
        of = np.add.reduceat((~self._own).astype(np.int32), starts)
        enough = 1 if self._header.central else np.maximum((of + 1) // 2, 1)
        own = np.zeros_like(others, dtype=bool) if self._header.central else silent[:, starts]
        cut = (others >= enough) | own
        before = np.vstack([self._cut, cut[:-1]])
        self._cut = cut[-1]
        for at, e in zip(*np.nonzero(cut != before)):
            if cut[at, e]:
                first, slots = int(starts[e]), self._header.slots[e]
                mine = silent[at, first : first + len(slots)] & ~self._own[first : first + len(slots)]
                nodes = tuple(slots[l] for l in np.flatnonzero(mine))
                self._open[int(e)] = (self._row + int(at) - self._limit + 1, nodes, int(of[e]), bool(own[at, e]))
            else:
                self._close(int(e), self._row + int(at) - 1)

    def _close(self, e: int, last: int) -> None:
        self.found.append(self._silence(e, last))
        del self._open[e]

    def _silence(self, e: int, last: int) -> Silence:
        begin, nodes, of, own = self._open[e]
        return Silence(e, begin, last, nodes, of, own)

    def so_far(self) -> tuple[list[Silence], np.ndarray]:
        """And the share of messages of others, (E,), that did not arrive; NaN where nobody sends."""
        found = self.found + [self._silence(e, self._row - 1) for e in self._open]
        starts = self._header.slot_starts
        gone = np.add.reduceat(np.where(self._own, 0.0, self._missing), starts)
        due = self._row * np.add.reduceat((~self._own).astype(np.float64), starts)
        return sorted(found, key=lambda s: (s.begin, s.estimator)), np.divide(gone, due, out=np.full(len(due), np.nan), where=due > 0)


def silence_text(silence: Silence, name: str, central: bool) -> str:
    who = f" (node {silence.nodes[0]})" if len(silence.nodes) == 1 else ""
    what = [f"{len(silence.nodes)} of {silence.of} {'sensors' if central else 'neighbours'} silent{who}"] if silence.nodes else []
    return f"{name}: " + " and ".join(what + (["no reading of its own"] if silence.own else []))
