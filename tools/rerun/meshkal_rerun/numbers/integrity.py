# SPDX-License-Identifier: MIT
"""What integrity monitors say, over time and as a story: alarms, who is held faulty, what was declared over. Numbers only, no rerun."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np

from meshkal_log.fields import Batch, Header
from . import derive, quantiles
from .tracking import Slots

# Statistics with a name, as tests of them are called.
STATISTICS = {"rctm": "RCTM", "aime": "AIME"}
# Of a statistic over several estimators.
_BAND = {"tenth percentile": 10.0, "median": 50.0, "ninetieth percentile": 90.0, "largest": 100.0}


def tested(header: Header) -> str:
    """The statistic that the scheme tests; `aime-improved` tests the other one for a while after a fault."""
    return "rctm" if header.monitor == "rctm" else "aime"


def ratios(batch: Batch, header: Header) -> dict[str, np.ndarray]:
    """Of each statistic to its threshold, (T, E). The log has the threshold of the tested one only; that of the other follows in the same way."""
    out = {}
    for key in STATISTICS:
        value, rows = getattr(batch, f"monitor_{key}"), getattr(batch, f"monitor_{key}_rows")
        out[key] = derive.finite(value) / quantiles.chi_square(header.monitor_false_alarm, rows)
    return out


def alarm_ratio(batch: Batch, header: Header, ratio: dict[str, np.ndarray]) -> np.ndarray:
    """(T, E): of the statistic that gave the alarm, NaN where there is none."""
    value = ratio[tested(header)]
    if header.monitor == "aime-improved":
        value = np.where(value >= 1.0, value, ratio["rctm"])
    return np.where(batch.monitor_alarm != 0, value, np.nan)


def band(values: np.ndarray) -> dict[str, np.ndarray]:
    """Percentiles over the estimators, (T,) by name."""
    known = np.isfinite(values).any(axis=1)
    out = np.full((len(_BAND), len(values)), np.nan)
    out[:, known] = np.nanpercentile(values[known], list(_BAND.values()), axis=1)
    return dict(zip(_BAND, out))


def read_only(values: np.ndarray, batch: Batch) -> np.ndarray:
    """(T, slots): NaN where no reading arrived: the log has 0 there, as it has for a reading that counts for nothing."""
    return np.where(batch.measurements_arrived != 0, derive.finite(values), np.nan)


def faulty_now(batch: Batch, header: Header) -> np.ndarray | None:
    """(T, N): the fault that was added to a reading, of several rows the largest; None if the log does not know."""
    if batch.fault is None:
        return None
    out = np.zeros((len(batch.step), header.nodes))
    for node, (first, rows) in enumerate(zip(np.cumsum((0, *header.rows)), header.rows)):
        if rows:
            mine = batch.fault[:, first : first + rows]
            out[:, node] = np.take_along_axis(mine, np.abs(mine).argmax(axis=1)[:, None], axis=1)[:, 0]
    return out


class Held:
    """Who is held faulty by how many of those that hear him."""

    def __init__(self, header: Header) -> None:
        self._slots, self._nodes = Slots(header), header.nodes
        self.heard = np.bincount(self._slots.node, minlength=header.nodes)

    def counts(self, batch: Batch) -> np.ndarray:
        """(T, N)"""
        out = np.zeros((len(batch.step), self._nodes), dtype=np.int64)
        np.add.at(out, (slice(None), self._slots.node), batch.excluded[:, self._slots.at] != 0)
        return out


class Share(Enum):
    """Of those that could say it, so many do."""

    NONE, SOME, HALF, ALL = range(4)


def shares(counts: np.ndarray, of: np.ndarray | int) -> np.ndarray:
    """Numbers of `Share`."""
    half = np.where(2 * counts >= of, Share.HALF.value, Share.SOME.value)
    return np.where(counts == 0, Share.NONE.value, np.where(counts == of, Share.ALL.value, half))


class Changes:
    """Where columns change from one step to the next, also from one batch to the next."""

    def __init__(self, initial: np.ndarray) -> None:
        self._last = np.asarray(initial)

    def of(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Step and column of each change."""
        before = np.vstack([self._last[None], values[:-1]])
        self._last = values[-1].copy()
        return np.nonzero(values != before)


class Kind(Enum):
    FAULT, ALARM, HELD, ENDED, RETURNED, ALARM_OVER, FAULT_OVER = range(7)


@dataclass(frozen=True)
class Event:
    at: int  # step in the batch
    time_s: float
    kind: Kind
    estimator: int  # -1: nobody's
    node: int  # -1: of no sensor
    suspect: int = -1  # of an alarm, -1: of nobody
    ratio: float = np.nan  # of an alarm


class Story:
    """Events in the order of time."""

    def __init__(self, header: Header) -> None:
        self._header = header
        self._slots = Slots(header)
        slots = sum(len(s) for s in header.slots)
        self._alarm, self._excluded = Changes(np.zeros(header.estimators, dtype=bool)), Changes(np.zeros(slots, dtype=bool))
        self._fault = Changes(np.zeros(header.nodes, dtype=bool))
        self._place = {int(at): i for i, at in enumerate(self._slots.at)}

    def batch(self, batch: Batch) -> list[Event]:
        seconds = batch.step * self._header.dt_s if batch.time_s is None else batch.time_s
        events = []

        def add(at: int, kind: Kind, estimator: int, node: int, **more: object) -> None:
            events.append(Event(int(at), float(seconds[at]), kind, int(estimator), int(node), **more))

        fault = faulty_now(batch, self._header)
        if fault is not None:
            for at, node in zip(*self._fault.of(fault != 0)):
                add(at, Kind.FAULT if fault[at, node] else Kind.FAULT_OVER, -1, node)
        if self._header.monitor:
            ratio = alarm_ratio(batch, self._header, ratios(batch, self._header))
            for at, e in zip(*self._alarm.of(batch.monitor_alarm != 0)):
                if batch.monitor_alarm[at, e]:
                    add(at, Kind.ALARM, e, -1, suspect=self._suspect(batch, at, e), ratio=float(ratio[at, e]))
                else:
                    add(at, Kind.ALARM_OVER, e, -1)
            for at, slot in zip(*self._excluded.of(batch.excluded != 0)):
                i = self._place.get(int(slot))
                if i is not None:
                    add(at, Kind.HELD if batch.excluded[at, slot] else Kind.RETURNED, self._slots.estimator[i], self._slots.node[i])
            for at, e in zip(*np.nonzero(batch.monitor_ended)):
                add(at, Kind.ENDED, e, -1)
        return sorted(events, key=lambda event: (event.at, event.kind.value, event.estimator, event.node))

    def _suspect(self, batch: Batch, at: int, e: int) -> int:
        """Where the scheme isolates nobody: the sensor whose leaving takes most from the statistic."""
        mine = np.flatnonzero(self._slots.estimator == e)
        w = np.nan_to_num(derive.finite(batch.isolation[at, self._slots.at[mine]]))
        return int(self._slots.node[mine[w.argmax()]]) if self._header.monitor != "exclude" and (w > 0.0).any() else -1


def spans(times: Sequence[tuple[float, float | None]], most: int = 4) -> str:
    """"226 s to 301 s; 340 s on" of begins and ends (None: not yet), the last instants inside, and how many more there are."""
    texts = [f"{begin:g} s on" if end is None else f"{begin:g} s" if end == begin else f"{begin:g} s to {end:g} s" for begin, end in times[:most]]
    return "; ".join(texts) + (f"; and {len(times) - most} more" if len(times) > most else "")


def text(event: Event, header: Header, names: Sequence[str]) -> str:
    """names: of the estimators."""
    sensor = header.sensor_name(event.node) if event.node >= 0 else ""
    who = "" if header.central else f" at {names[event.estimator]}"
    if event.kind == Kind.ALARM:
        suspect = f", most from {header.sensor_name(event.suspect)}" if event.suspect >= 0 else ""
        return f"alarm{who}: test ratio {event.ratio:.3g}{suspect}"
    return {
        Kind.FAULT: f"injected fault of {sensor} begins",
        Kind.FAULT_OVER: f"injected fault of {sensor} is over",
        Kind.ALARM_OVER: f"no alarm any more{who}",
        Kind.HELD: f"{sensor} held faulty{who}",
        Kind.RETURNED: f"{sensor} is used again{who}",
        Kind.ENDED: f"a fault declared over{who}",
    }[event.kind]
