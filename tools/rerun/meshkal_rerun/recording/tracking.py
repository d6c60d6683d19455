# SPDX-License-Identifier: MIT
"""Series of a tracking log: gates and what they decided, NEES with its band, disagreement and consensus."""

import numpy as np
import rerun as rr

from meshkal_log.fields import Batch, Decision, Header
from ..numbers import derive
from ..numbers import tracking as numbers
from . import colours
from .series import Clock, Series

# Above this many slots that are heard, only the largest test ratio of each step is drawn.
DRAWN_SLOTS = 100
_MARKERS = {Decision.REJECTED: "cross", Decision.INFLATED: "up"}
STATES = {
    Decision.NONE: "no reading",
    Decision.USED: "used",
    Decision.LOST: "lost",
    Decision.INFLATED: "inflated",
    Decision.REJECTED: "rejected",
    Decision.REFUSED: "refused by the model",
}
_LEVELS = {Decision.REJECTED: "WARN", Decision.INFLATED: "INFO", Decision.REFUSED: "ERROR"}


class TrackingRecorder:
    def __init__(self, series: Series, clock: Clock, header: Header, palette: colours.Palette, paths: list[str]) -> None:
        self._series, self._clock, self._header = series, clock, header
        self._paths = paths  # of the estimators
        self._slots = numbers.Slots(header)
        self._node_colours = palette.nodes
        self._held = numbers.Held(header.nodes)
        self._last_decisions = np.full(header.nodes, -1, dtype=np.int64)
        # Of one estimator in one step; of a mean over the network there is none, since its estimators share what they know.
        low, high = numbers.nees_band(header.states)
        self._band = {"lower": low, "expected": float(header.states), "upper": high}

    def batch(self, times: list, batch: Batch) -> None:
        decided = numbers.decisions(batch, self._slots)
        self._gates(times, batch, decided)
        self._decisions(batch, decided)
        self._entries(batch, decided)
        self._consensus(times, batch)
        if batch.nees is not None:
            for name, value in self._band.items():
                label = name if name == "expected" else f"{name} bound, {100 * numbers.BAND:.0f} % band"
                colour = colours.REFERENCE if name == "expected" else colours.BAND
                self._series.lines(f"nees/band/{name}", times, np.full(len(batch.step), value), names=label, colors=colour, widths=1.0)

    def _gates(self, times: list, batch: Batch, decided: np.ndarray) -> None:
        """A point where a gate has judged: its marker says what became of the reading."""
        ratio = derive.finite(batch.gate_ratio[:, self._slots.at])
        together = derive.finite(batch.gate_stacked_ratio)
        if not (ratio > 0.0).any() and not (together > 0.0).any() and not self._series.has("gate_ratio/threshold"):
            return
        self._series.lines("gate_ratio/threshold", times, np.ones(len(ratio)), names="threshold: 1", colors=colours.REFERENCE, widths=1.0)
        every = np.concatenate([ratio, together], axis=1)
        largest = derive.quietly(np.nanmax, np.where(every > 0.0, every, np.nan))
        self._series.points("gate_ratio/network/largest", times, largest, names="largest", colors=colours.WORST, marker_sizes=2.0)
        if len(self._slots.at) <= DRAWN_SLOTS:
            for i, (e, node) in enumerate(zip(self._slots.estimator, self._slots.node)):
                name = f"reading of node {node}" if self._header.central else f"reading of node {node} at {self._paths[e].replace('/', ' ')}"
                self._marked(f"gate_ratio/{self._paths[e]}/sensor/{node}", name, batch, ratio[:, i], decided[:, i], self._node_colours[node])
        if self._header.estimators <= DRAWN_SLOTS:
            for e, path in enumerate(self._paths):
                beyond = np.where(together[:, e] > 1.0, int(Decision.REJECTED), int(Decision.USED))
                inflates = (batch.decision[:, self._header.slot_starts[e] :][:, : len(self._header.slots[e])] == Decision.INFLATED).any(axis=1)
                beyond[(beyond == Decision.REJECTED) & inflates] = Decision.INFLATED
                name = f"all readings at {path.replace('/', ' ')}"
                self._marked(f"gate_ratio/{path}/together", name, batch, together[:, e], beyond, colours.TRUTH)

    def _marked(self, path: str, name: str, batch: Batch, ratio: np.ndarray, decided: np.ndarray, colour: int) -> None:
        """All that were judged, and again those that were not used as they were: the viewer does not change a series' markers over time."""
        at = np.flatnonzero(ratio > 0.0)
        if not len(at):
            return
        self._series.points(path, self._clock.times(batch, at), ratio[at], names=name, colors=colour, markers="circle", marker_sizes=2.0)
        for kind, marker in _MARKERS.items():
            some = at[decided[at] == kind]
            if len(some):
                style = {"names": f"{name}: {STATES[kind]}", "colors": colours.DECISIONS[STATES[kind]], "markers": marker, "marker_sizes": 5.0}
                self._series.points(f"{path}/{STATES[kind]}", self._clock.times(batch, some), ratio[some], **style)

    def _decisions(self, batch: Batch, decided: np.ndarray) -> None:
        """What became of each sensor's reading, where it changes. Recorded sensors seldom measure together: there it holds on."""
        worst = numbers.worst_decisions(decided, self._slots, self._header.nodes)
        if self._header.source != "drawn":
            worst = self._held.states(batch.time_s, worst)
        before = np.vstack([self._last_decisions, worst[:-1]])
        self._last_decisions = worst[-1]
        for node, rows in enumerate(self._header.rows):
            at = np.flatnonzero(worst[:, node] != before[:, node])
            if not rows or not len(at):
                continue
            path = f"decisions/node/{node}"
            if self._series.first(path):
                names = list(STATES.values())
                painted = [colours.DECISIONS[name] for name in names]
                shown = [name != STATES[Decision.NONE] for name in names]
                self._series.rec.log(path, rr.StateConfiguration(values=names, labels=names, colors=painted, visible=shown), static=True)
            states = [STATES[Decision(d)] for d in worst[at, node]]
            self._series.rec.send_columns(path, self._clock.times(batch, at), rr.StateChange.columns(state=states))

    def _entries(self, batch: Batch, decided: np.ndarray) -> None:
        """A line for every reading that was not used as it was."""
        at, slot = np.nonzero(np.isin(decided, [int(d) for d in _LEVELS]))
        if not len(at):
            return
        texts, levels = [], []
        for t, i in zip(at, slot):
            kind, e, node = Decision(decided[t, i]), self._slots.estimator[i], self._slots.node[i]
            alone, together = batch.gate_ratio[t, self._slots.at[i]], batch.gate_stacked_ratio[t, e]
            how = f", test ratio {alone:.3g}" if alone > 1.0 else f" with the others, test ratio {together:.3g}"
            how = "" if kind == Decision.REFUSED else how
            own = self._header.central or self._header.estimator_nodes[e] == node
            where = "" if own else f" at {self._paths[e].replace('/', ' ')}"
            fault = ", faulty" if batch.faulty[t, node] else ""
            texts.append(f"reading of node {node}{where}: {STATES[kind]}{how}{fault}")
            levels.append(_LEVELS[kind])
        self._series.rec.send_columns("rejections", self._clock.times(batch, at), rr.TextLog.columns(text=texts, level=levels))

    def _consensus(self, times: list, batch: Batch) -> None:
        if batch.disagreement is not None:
            apart = derive.finite(batch.disagreement)
            name = "largest distance of two estimates, m"
            self._series.lines("disagreement/positions", times, apart, names=name, colors=colours.TRUTH, widths=2.0)
        if batch.consensus_disagreement is not None:
            decibels = derive.decibels(batch.consensus_disagreement)
            last = self._header.iterations
            shown = shown_iterations(last)
            for l, colour in zip(shown, colours.ramp(len(shown))):
                name = f"after {l} iterations" if l else "before"
                self._series.lines(f"consensus/after/{l}", times, decibels[:, l], names=name, colors=colour, widths=2.0 if l == last else 1.0)


def shown_iterations(last: int) -> list[int]:
    """0, 1, 2, 5, 10, .. and the last."""
    steps = [first * 10**power for power in range(5) for first in (1, 2, 5)]
    return [0, *(l for l in steps if l < last), *([last] if last else [])]
