# SPDX-License-Identifier: MIT
"""What monitors found, as rows of the summary: alarms, who was held faulty, what was declared over, and the time to alert."""

import numpy as np

from meshkal_log.fields import Batch, Header
from ..numbers import integrity
from ..numbers.integrity import Event, Kind

_MOST = 4


class IntegritySummary:
    def __init__(self, header: Header, names: list[str]) -> None:
        self._header, self._names = header, names
        self._held = integrity.Held(header)
        self._alarms: list[list] = []  # begin, end (None: lasts), estimator
        self._excluded: list[list] = []  # begin, end, estimator, node
        self._faults: list[list] = []  # begin, end, node
        self._ends: list[tuple[float, int]] = []  # time, estimator
        self._most = np.zeros(header.nodes, dtype=np.int64)  # that held a sensor faulty at the same time
        self._before = 0.0
        self._alarm_epochs = self._epochs = 0

    def batch(self, batch: Batch, events: list[Event]) -> None:
        seconds = batch.step * self._header.dt_s if batch.time_s is None else batch.time_s
        previous = np.concatenate([[self._before], seconds[:-1]])
        self._before = float(seconds[-1])
        for event in events:
            last = float(previous[event.at])  # an end is the last instant that was inside
            if event.kind == Kind.FAULT:
                self._faults.append([event.time_s, None, event.node])
            elif event.kind == Kind.FAULT_OVER:
                _close(self._faults, last, event.node)
            elif event.kind == Kind.ALARM:
                self._alarms.append([event.time_s, None, event.estimator])
            elif event.kind == Kind.ALARM_OVER:
                _close(self._alarms, last, event.estimator)
            elif event.kind == Kind.HELD:
                self._excluded.append([event.time_s, None, event.estimator, event.node])
            elif event.kind == Kind.RETURNED:
                _close(self._excluded, last, event.estimator, event.node)
            elif event.kind == Kind.ENDED:
                self._ends.append((event.time_s, event.estimator))
        if self._header.monitor:
            self._most = np.maximum(self._most, self._held.counts(batch).max(axis=0))
            alarm = batch.monitor_alarm != 0
            self._alarm_epochs += int(alarm.sum())
            self._epochs += alarm.size

    def rows(self) -> list[tuple[str, str]]:
        header = self._header
        rows = [("injected fault", text) for text in self._of_sensors(self._faults)]
        if not header.monitor:
            return rows
        rows += self._when("alarms", "first alarm", self._alarms)
        rows.append(("estimator epochs in alarm" if header.estimators > 1 else "epochs in alarm", f"{self._alarm_epochs} of {self._epochs}"))
        alert = self._alert()
        if alert:
            rows.append(("time to alert", alert))
        if header.monitor == "exclude":
            held = self._of_sensors(self._excluded)
            rows += [("held faulty", text) for text in held] or [("held faulty", "nobody")]
        if header.monitor in ("aime-improved", "exclude"):
            rows += self._when("faults declared over", "first one declared over", [[time, time, e] for time, e in self._ends])
        return rows

    def facts(self) -> list[tuple[str, str]]:
        header = self._header
        what = f"{header.monitor}, window {header.monitor_window}, false alarm {header.monitor_false_alarm:g}"
        return [("monitor", what)] if header.monitor else []

    def _when(self, name: str, first_name: str, spans: list[list]) -> list[tuple[str, str]]:
        """Of one estimator all, of several how many and where the first was: the table is narrow."""
        if not spans:
            return [(name, "none")]
        if self._header.estimators == 1:
            return [(name, integrity.spans([(span[0], span[1]) for span in spans], _MOST))]
        who = len({span[2] for span in spans})
        first = min(spans, key=lambda span: span[0])
        return [(name, f"{len(spans)} at {who} of {self._header.estimators} nodes"), (first_name, f"{first[0]:g} s, {self._names[first[2]]}")]

    def _of_sensors(self, spans: list[list]) -> list[str]:
        """A text for each sensor: from when to when somebody held it faulty, or it had a fault."""
        out = []
        for node in sorted({span[-1] for span in spans}):
            mine = _union([span for span in spans if span[-1] == node])
            some = spans is self._excluded and not self._header.central
            by = f", by up to {self._most[node]} of {self._held.heard[node]}" if some else ""
            out.append(f"{self._header.sensor_name(node)}: {integrity.spans(mine, _MOST)}{by}")
        return out[:_MOST] + ([f"and {len(out) - _MOST} more sensors"] if len(out) > _MOST else [])

    def _alert(self) -> str | None:
        """From the first epoch with a fault to the first alarm that begins from then on."""
        if not self._faults:
            return None
        begin, over, _ = self._faults[0]
        after = [span[0] for span in self._alarms if span[0] >= begin and (over is None or span[0] <= over)]
        lasting = [span for span in self._alarms if span[0] < begin and (span[1] is None or span[1] >= begin)]
        if lasting and not after:
            return "in alarm already when the fault began"
        return f"{min(after) - begin:g} s after the first faulty epoch" if after else "no alarm while the fault was there"


def _close(spans: list[list], end: float, *key: int) -> None:
    for span in reversed(spans):
        if span[1] is None and tuple(span[2:]) == key:
            span[1] = end
            return


def _union(spans: list[list]) -> list[tuple[float, float | None]]:
    out: list[tuple[float, float | None]] = []
    for begin, end in sorted(((span[0], span[1]) for span in spans), key=lambda span: span[0]):
        if out and (out[-1][1] is None or begin <= out[-1][1]):
            last = out[-1][1]
            out[-1] = (out[-1][0], None if last is None or end is None else max(last, end))
        else:
            out.append((begin, end))
    return out
