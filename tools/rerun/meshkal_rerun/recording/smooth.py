# SPDX-License-Identifier: MIT
"""Lines of single nodes in long runs: means over so many steps that a line can be followed with the eye."""

import numpy as np

from meshkal_log.fields import Batch
from ..numbers import derive
from .series import Clock, Series

_POINTS = 120


class Smoothed:
    """Each point is the mean of `window` steps and stands at the last of them. Short runs are drawn as they are."""

    def __init__(self, series: Series, clock: Clock, steps: int) -> None:
        """steps: of the run, 0 if nobody knows."""
        self._series, self._clock = series, clock
        self.window = max(1, round(steps / _POINTS))
        self._rest: dict[str, tuple[np.ndarray, list]] = {}  # values of a block that is not full, and the time of the last one

    @property
    def said(self) -> str:
        """Behind the name of a line."""
        return f", mean of {self.window} steps" if self.window > 1 else ""

    def line(self, path: str, batch: Batch, values: np.ndarray, **style: object) -> None:
        if self.window == 1:
            self._series.lines(path, self._clock.times(batch), values, **style)
            return
        before = self._rest[path][0] if path in self._rest else np.zeros(0)
        every = np.concatenate([before, values])
        full = len(every) // self.window
        if full:
            ends = (np.arange(full) + 1) * self.window - len(before) - 1
            means = derive.quietly(np.nanmean, every[: full * self.window].reshape(full, -1))
            self._series.lines(path, self._clock.times(batch, ends), means, **style)
        self._rest[path] = every[full * self.window :], self._clock.times(batch, np.array([-1]))

    def finish(self) -> None:
        for path, (values, times) in self._rest.items():
            if len(values):
                self._series.lines(path, times, derive.quietly(np.nanmean, values[None]))
