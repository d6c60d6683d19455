# SPDX-License-Identifier: MIT
"""Other filters' logs of the same run beside the one that is shown: their position error, and how far the estimates are from theirs."""

import numpy as np
import rerun as rr

from . import colours, derive
from . import tracking_numbers as numbers
from .reader import Header, LogError, LogReader
from .scenario import Scenario, positions_of
from .scene import send_trail
from .series import Clock, Series

# Filters with the same draws of targets and readings can be compared; which messages are lost may differ.
_SAME = ("scenario_sha256", "source", "steps", "dt_s", "states", "positions", "nodes", "start_s")


def labels(readers: dict[str, LogReader]) -> dict[str, str]:
    """What the logs behind the first one are called, by file. Raises LogError if one of them is not of the same run."""
    first_name, first = next(iter(readers.items()))
    others = list(readers)[1:]
    for name in others:
        header = readers[name].header
        same = (*_SAME, "seed") if first.header.source == "drawn" else _SAME
        for key in same:
            if getattr(header, key) != getattr(first.header, key):
                raise LogError(f"{name} cannot be compared with {first_name}: its {key} is another")
    filters = [reader.header.filter for reader in readers.values()]
    return {name: f if filters.count(f) == 1 else f"{f} {i}" for i, (name, f) in enumerate(zip(readers, filters)) if i > 0}


class Shown:
    """What comparisons need of the log that is shown, kept until they are made."""

    def __init__(self) -> None:
        self._steps: list[np.ndarray] = []
        self._positions: list[np.ndarray] = []
        self._squares: list[np.ndarray] = []

    def batch(self, batch, scenario: Scenario) -> None:
        if not scenario.position_states:
            return
        self._steps.append(batch.step)
        self._positions.append(positions_of(batch.estimate, scenario.position_states))
        error = numbers.position_error(batch, scenario)
        self._squares.append(np.full(len(batch.step), np.nan) if error is None else np.square(derive.root_mean_square(error)))

    def finish(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return np.concatenate(self._steps), np.concatenate(self._positions), np.concatenate(self._squares)


def compare(series: Series, shown: tuple[np.ndarray, np.ndarray, np.ndarray], label: str, reader: LogReader, run: int, colour: int) -> tuple[str, str]:
    """Records one other log. Returns a line of the summary: position RMSE of the shown filter and of this one over the instants they share."""
    raise NotImplementedError
