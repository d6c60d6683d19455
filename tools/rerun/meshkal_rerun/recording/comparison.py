# SPDX-License-Identifier: MIT
"""Other filters' logs of the same run beside the one that is shown: their position error, and how far the estimates are from theirs."""

import numpy as np
import rerun as rr

from meshkal_log.fields import Batch
from meshkal_log.reader import LogError, LogReader
from meshkal_log.scenario import Scenario, positions_of
from ..numbers import derive
from ..numbers import tracking as numbers
from . import colours
from .scene import send_trail
from .series import Clock, Series

# So the target and the readings are the same. Which messages are lost may differ, and the precision, too.
_SAME = ("scenario_sha256", "source", "dt_s", "states", "positions", "nodes", "start_s")


def labels(readers: dict[str, LogReader]) -> dict[str, str]:
    """What the logs behind the first one are called, by file. Raises LogError if one of them cannot be of the same run."""
    first_name, first = next(iter(readers.items()))
    for name, reader in readers.items():
        if reader.header.kind != first.header.kind:
            raise LogError(f"{name} is not the log of a {first.header.kind} scenario, {first_name} is; they cannot be joined")
        for key in (*_SAME, "seed") if first.header.source == "drawn" else _SAME:
            if getattr(reader.header, key) != getattr(first.header, key):
                raise LogError(f"{name} cannot be compared with {first_name}: its {key} is another")
    filters = [reader.header.filter for reader in readers.values()]
    return {name: f if filters.count(f) == 1 else f"{f}-{i + 1}" for i, (name, f) in enumerate(zip(readers, filters)) if i > 0}


class Comparison:
    """Keeps of the shown log what it needs, then takes the others, one after another."""

    def __init__(self, rec: rr.RecordingStream, scenario: Scenario) -> None:
        self._rec, self._series, self._scenario = rec, Series(rec, envelope=True), scenario
        self._steps: list[np.ndarray] = []
        self._positions: list[np.ndarray] = []
        self._squares: list[np.ndarray] = []

    def shown(self, batch: Batch) -> None:
        if self._scenario.position_states:
            self._steps.append(batch.step)
            self._positions.append(positions_of(batch.estimate, self._scenario.position_states))
            self._squares.append(_squares(batch, self._scenario))

    def other(self, label: str, reader: LogReader, run: int, index: int) -> tuple[str, str] | None:
        """Returns a row for the summary: the position RMSE of the shown filter over the instants that both logs have, and of this one."""
        if not self._scenario.position_states:
            return None
        steps, positions, squares = map(np.concatenate, (self._steps, self._positions, self._squares))
        _, colour = colours.compared(index)
        clock, path = Clock(reader.header), f"compared/{label}"
        self._rec.log(f"scene/{path}/estimates", rr.Points3D.from_fields(colors=colour, radii=-4.0, labels=[label], show_labels=False), static=True)
        self._rec.log(f"scene/{path}/trail", rr.LineStrips3D.from_fields(colors=colour, radii=-1.0), static=True)
        trail = np.zeros((0, 3), dtype=np.float32)
        sums, known = np.zeros(2), 0
        for batch in reader.batches(run):
            times = clock.times(batch)
            estimates = positions_of(batch.estimate, self._scenario.position_states)
            middle = numbers.middle(estimates)
            trail = send_trail(self._rec, f"scene/{path}/trail", times, trail, middle)
            each = np.full(len(estimates), estimates.shape[1])
            self._rec.send_columns(f"scene/{path}/estimates", times, rr.Points3D.columns(positions=estimates.reshape(-1, 3)).partition(each))
            theirs = _squares(batch, self._scenario)
            if np.isfinite(theirs).any():
                self._series.lines(f"position_error/{path}", times, np.sqrt(theirs), names=label, colors=colour, widths=2.0)
            _, mine, at = np.intersect1d(steps, batch.step, return_indices=True)
            apart = np.linalg.norm(positions[mine].astype(np.float64) - middle[at][:, None], axis=2)
            if len(at):
                apart = derive.root_mean_square(derive.finite(apart))
                style = {"names": f"RMS distance to {label}", "colors": colour, "widths": 1.5}
                self._series.lines(f"disagreement/{path}", clock.times(batch, at), apart, **style)
            both = np.isfinite(squares[mine]) & np.isfinite(theirs[at])
            sums += (squares[mine][both].sum(), theirs[at][both].sum())
            known += int(both.sum())
        if not known:
            return None
        ours, others = np.sqrt(sums / known)
        ratio = f" = {ours / others:.3f}" if others > 0 else ""
        return f"position RMSE against {label}", f"{ours:.4g} m / {others:.4g} m{ratio}"


def _squares(batch: Batch, scenario: Scenario) -> np.ndarray:
    error = numbers.position_error(batch, scenario)
    with np.errstate(over="ignore"):
        return np.full(len(batch.step), np.nan) if error is None else np.square(derive.root_mean_square(error))
