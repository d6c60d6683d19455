# SPDX-License-Identifier: MIT
"""States over time, sent where they change."""

from collections.abc import Sequence

import numpy as np
import rerun as rr

from meshkal_log.fields import Batch
from .series import Clock, Series


class Lanes:
    def __init__(self, series: Series, clock: Clock) -> None:
        self._series, self._clock = series, clock
        self._last: dict[str, int] = {}

    def send(self, path: str, batch: Batch, states: np.ndarray, names: Sequence[str], paint: Sequence[int]) -> None:
        """states: (T,), places in names and colours."""
        last = self._last.get(path)
        before = np.concatenate([[-1 if last is None else last], states[:-1]])
        self._last[path] = int(states[-1])
        at = np.flatnonzero(states != before)
        if not len(at):
            return
        if self._series.first(path):
            style = rr.StateConfiguration(values=list(names), labels=list(names), colors=np.array(paint, dtype=np.uint32))
            self._series.rec.log(path, style, static=True)
        self._series.rec.send_columns(path, self._clock.times(batch, at), rr.StateChange.columns(state=[names[state] for state in states[at]]))
