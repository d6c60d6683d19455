# SPDX-License-Identifier: MIT
"""What a log says of the moment in which an estimator departs: faults, alarms, silence of neighbours, refused readings. Numbers only, no rerun."""

import math
from collections.abc import Sequence

import numpy as np

from meshkal_log.fields import Batch, Decision, Header
from . import integrity
from .departures import NETWORK, Episode, seconds
from .silence import nothing_arrived, silent_steps

# The bits of meshkal/rkfd.h.
FAULTS = {0: "measurement missing", 1: "estimate missing", 2: "input refused", 3: "no measurement at all"}
# With lossy links the first two come and go at every step; what is missing is counted, and would bury the others.
LOGGED = np.uint32(0xFFFFFFFF & ~0b11)
_AFTER = 3  # steps after the begin that still tell of its cause
_UNLIKELY = 1e-3  # of so long a silence by loss alone: at the moment of a departure less is enough
_NAMED = 3


def fault_text(mask: int) -> str:
    return ", ".join(FAULTS.get(bit, f"fault bit {bit}") for bit in range(32) if mask >> bit & 1) or "faults over"


class _Since:
    """Since when columns of truth values are true, over all batches."""

    def __init__(self, columns: int) -> None:
        self._step = np.full(columns, -1, dtype=np.int64)  # -1: not now
        self._second = np.full(columns, math.nan)

    def at(self, now: np.ndarray, batch: Batch, time_s: np.ndarray, row: int, column: int) -> tuple[int, float] | None:
        """now: (T, columns) of this batch. Step and second from which on it is true up to this row; None: it is not."""
        if not now[row, column]:
            return None
        before = np.flatnonzero(~now[:row, column])
        if len(before):
            return int(batch.step[before[-1] + 1]), float(time_s[before[-1] + 1])
        return (int(batch.step[0]), float(time_s[0])) if self._step[column] < 0 else (int(self._step[column]), float(self._second[column]))

    def advance(self, now: np.ndarray, batch: Batch, time_s: np.ndarray) -> None:
        steps = len(now)
        ago = np.argmax(~now[::-1], axis=0)  # rows that it has been true at the end; 0 also if always
        always = now.all(axis=0)
        first = np.minimum(steps - ago, steps - 1)
        fresh = ~always | (self._step < 0)
        first = np.where(always, 0, first)
        self._step = np.where(fresh, np.where(now[-1], batch.step[first], -1), self._step)
        self._second = np.where(fresh, time_s[first], self._second)


class Causes:
    """Takes all batches of a run; then `texts` says of each episode what the log knows."""

    def __init__(self, header: Header, episodes: Sequence[Episode]) -> None:
        self._header, self._episodes = header, episodes
        self.texts: dict[Episode, list[str]] = {}
        slots = sum(map(len, header.slots))
        self._quiet, self._faulty = _Since(slots), _Since(header.nodes)
        self._silent = silent_steps(header.loss, unlikely=_UNLIKELY)

    def batch(self, batch: Batch) -> None:
        if not self._episodes:
            return
        time_s = seconds(batch, self._header)
        quiet = nothing_arrived(batch, self._header)
        fault = integrity.faulty_now(batch, self._header)
        faulty = np.zeros((len(batch.step), self._header.nodes), dtype=bool) if fault is None else fault != 0.0
        if batch.faulty is not None:
            faulty |= batch.faulty != 0
        for episode in self._episodes:
            if batch.step[0] <= episode.begin_step <= batch.step[-1]:
                row = int(np.searchsorted(batch.step, episode.begin_step))
                rows = slice(row, row + _AFTER + 1)
                if episode.estimator == NETWORK:
                    self.texts[episode] = self._sensors(range(self._header.nodes), faulty, batch, time_s, rows)
                else:
                    self.texts[episode] = self._of(episode.estimator, faulty, quiet, batch, time_s, rows)
        self._quiet.advance(quiet, batch, time_s)
        self._faulty.advance(faulty, batch, time_s)

    def _of(self, e: int, faulty: np.ndarray, quiet: np.ndarray, batch: Batch, time_s: np.ndarray, rows: slice) -> list[str]:
        header, first = self._header, int(self._header.slot_starts[e])
        slots = header.slots[e]
        out = self._sensors(slots[: header.heard[e]], faulty, batch, time_s, rows)
        if header.monitor:
            held = (batch.excluded[rows, first : first + len(slots)] != 0).any(axis=0)
            out += [f"{header.sensor_name(slots[i])} held faulty" for i in np.flatnonzero(held)[:_NAMED]]
            if (batch.monitor_alarm[rows, e] != 0).any():
                out.append("alarm of its monitor")
        out += self._silence(e, quiet, batch, time_s, rows.start)
        if batch.decision is not None:
            some = batch.decision[rows, first : first + header.heard[e]]
            refused = int(np.isin(some, (Decision.REJECTED, Decision.REFUSED)).sum())
            if refused:
                out.append(f"{refused} of {int((some != Decision.NONE).sum())} readings refused")
        mask = int(np.bitwise_or.reduce(batch.faults[rows, e] & LOGGED))
        if mask:
            out.append(fault_text(mask))
        return out

    def _sensors(self, nodes: Sequence[int], faulty: np.ndarray, batch: Batch, time_s: np.ndarray, rows: slice) -> list[str]:
        """Faults that were put into readings."""
        some = [node for node in nodes if faulty[rows, node].any()]
        texts = []
        for node in some[:_NAMED]:
            last = rows.start + int(np.flatnonzero(faulty[rows, node])[0])
            _, since = self._faulty.at(faulty, batch, time_s, last, node)
            texts.append(f"sensor fault of {self._header.sensor_name(node)} since {since:.6g} s")
        return texts + ([f"faults of {len(some) - _NAMED} more sensors"] if len(some) > _NAMED else [])

    def _silence(self, e: int, quiet: np.ndarray, batch: Batch, time_s: np.ndarray, row: int) -> list[str]:
        header, first = self._header, int(self._header.slot_starts[e])
        since = {}
        for l, node in enumerate(header.slots[e]):
            last = min(row + self._silent, len(batch.step) - 1)
            found = self._quiet.at(quiet, batch, time_s, last, first + l)
            # What falls silent after the begin is no cause.
            if found and found[0] <= batch.step[row] + 1 and batch.step[last] - found[0] + 1 >= self._silent:
                since[node] = found[1]
        own = None if header.central else header.estimator_nodes[e]
        out = []
        if own in since:
            out.append(f"no reading of its own since {since.pop(own):.6g} s")
        if since:
            some = ", ".join(map(str, list(since)[:_NAMED])) + (", .." if len(since) > _NAMED else "")
            who = f"node{'s' * (len(since) > 1)} {some}"
            what = "sensors" if header.central else "neighbours"
            out.append(f"{len(since)} of {len(header.slots[e]) - (own is not None)} {what} silent since {min(since.values()):.6g} s ({who})")
        return out


def episode_text(episode: Episode, name: str, of_position: bool) -> str:
    """"node 7: error up to 6.3 m, 8.1 times its usual": short, for a log shows one line, and the time beside it."""
    if not episode.of_error:
        return f"{name}: test quantity up to {episode.ratio:.3g} times the expected"
    return f"{name}: error up to {episode.value:.3g}{' m' if of_position else ''}, {episode.ratio:.3g} times its usual"


def when(episode: Episode) -> str:
    return f"from {episode.begin_s:.6g} s " + ("to the end" if episode.lasts else f"to {episode.end_s:.6g} s")
