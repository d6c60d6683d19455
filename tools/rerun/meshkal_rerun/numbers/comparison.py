# SPDX-License-Identifier: MIT
"""Two logs of a network side by side: which of their steps and estimators belong together, and what a step of both is. Numbers only, no rerun."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, fields, replace

import numpy as np

from meshkal_log.fields import Batch, Header
from meshkal_log.reader import LogError
from meshkal_log.scenario import Scenario

from . import derive, tracking


class Pairing:
    """Which estimators stand side by side: those of the same nodes; a centre stands beside each node. `nodes` is empty for two centres."""

    def __init__(self, first: Header, other: Header) -> None:
        if first.central or other.central:
            self.nodes = other.estimator_nodes if first.central else first.estimator_nodes
            count = max(len(self.nodes), 1)
            self.mine = np.zeros(count, dtype=np.intp) if first.central else np.arange(count)
            self.theirs = np.zeros(count, dtype=np.intp) if other.central else np.arange(count)
        else:
            self.nodes = tuple(sorted(set(first.estimator_nodes) & set(other.estimator_nodes)))
            self.mine = np.array([first.estimator_nodes.index(k) for k in self.nodes], dtype=np.intp)
            self.theirs = np.array([other.estimator_nodes.index(k) for k in self.nodes], dtype=np.intp)
        self.same_kind = first.central == other.central

    def __len__(self) -> int:
        return len(self.mine)

    def name(self, pair: int) -> str:
        return f"node {self.nodes[pair]}" if self.nodes else "the centre"


@dataclass(frozen=True)
class Both:
    """The same steps of both logs; `rows` are their places in the batch that was asked for."""

    rows: np.ndarray
    mine: Batch
    theirs: Batch


class Beside:
    """The steps that another log has in common with a shown one, whose batches come in order. Of the other log, too, only one batch is held."""

    def __init__(self, first: Header, other: Header, batches: Iterable[Batch]) -> None:
        # The instants of one scenario have the same numbers; those of two are told by their times.
        self._by_step = not first.timed or first.scenario_sha256 == other.scenario_sha256
        self._batches = iter(batches)
        self._batch: Batch | None = None
        self._begun = False
        self._read = 0
        self._seen = 0
        self.common = 0

    def both(self, batch: Batch) -> Iterator[Both]:
        keys = self._keys(batch)
        self._seen += len(keys)
        if not self._begun:
            self._begun = True
            self._advance()
        while self._batch is not None:
            theirs = self._keys(self._batch)
            _, rows, at = np.intersect1d(keys, theirs, assume_unique=True, return_indices=True)
            if len(rows):
                self.common += len(rows)
                yield Both(rows, taken(batch, rows), taken(self._batch, at))
            if theirs[-1] > keys[-1]:
                break
            self._advance()

    def finish(self) -> tuple[int, int]:
        """Reads what is left of the other log; returns how many steps only the shown one has, and only the other one."""
        while not self._begun or self._batch is not None:
            self._begun = True
            self._advance()
        return self._seen - self.common, self._read - self.common

    def _advance(self) -> None:
        self._batch = next(self._batches, None)
        if self._batch is not None:
            self._read += len(self._batch.step)

    def _keys(self, batch: Batch) -> np.ndarray:
        if self._by_step:
            return batch.step
        keys = np.rint(batch.time_s * 1e9).astype(np.int64)
        if (np.diff(keys) <= 0).any():
            raise LogError(f"step {batch.step[1:][np.diff(keys) <= 0][0]}: its time is not after the time before it, so that two logs cannot be compared")
        return keys


def taken(batch: Batch, rows: np.ndarray) -> Batch:
    """Some steps of a batch; consecutive ones are not copied."""
    wanted: slice | np.ndarray = rows
    if len(rows) and rows[-1] - rows[0] + 1 == len(rows):
        if len(rows) == len(batch.step):
            return batch
        wanted = slice(int(rows[0]), int(rows[-1]) + 1)
    values = {field.name: getattr(batch, field.name) for field in fields(batch)}
    return replace(batch, **{name: value[wanted] for name, value in values.items() if isinstance(value, np.ndarray)})


def in_metres(header: Header, scenario: Scenario) -> bool:
    """Whether errors are those of positions; else they are the norm over all states."""
    return header.timed and bool(scenario.position_states)


def errors(batch: Batch, header: Header, scenario: Scenario) -> np.ndarray | None:
    """(T, E); NaN: unknown. None without a truth."""
    return tracking.position_error(batch, scenario) if in_metres(header, scenario) else derive.known_error(batch)


def difference_db(mine: np.ndarray, theirs: np.ndarray) -> np.ndarray:
    """Below 0 the first is better. 0 where both are the same number, be it 0; NaN where only one of them is 0, or one is unknown or infinite."""
    with np.errstate(divide="ignore", invalid="ignore"):
        apart = 20.0 * (np.log10(mine) - np.log10(theirs))
    return np.where((mine == theirs) & np.isfinite(mine), 0.0, derive.finite(apart))


def distances(mine: np.ndarray, theirs: np.ndarray, pairing: Pairing, states: tuple[int, ...] | None) -> np.ndarray:
    """(T, pairs) of estimates (T, E, n), over `states` or all."""
    wanted = slice(None) if states is None else list(states)
    with np.errstate(invalid="ignore", over="ignore"):
        apart = mine[:, pairing.mine][:, :, wanted].astype(np.float64) - theirs[:, pairing.theirs][:, :, wanted]
        return derive.finite(np.sqrt(np.einsum("tki,tki->tk", apart, apart)))
