# SPDX-License-Identifier: MIT
"""The first lines of the text panel: how good, who is worst, when it went wrong and why, and where to look next."""

import math

import numpy as np

from meshkal_log.fields import Header
from ..numbers.causes import Causes, when
from ..numbers.departures import NETWORK, Episode
from ..numbers.survey import Survey

_MOST = 3


class Head:
    def __init__(self, header: Header, found: Survey, causes: Causes, names: list[str]) -> None:
        self._header, self._found, self._causes, self._names = header, found, causes, names

    def text(self, good: str) -> str:
        """good: how good the run was as a whole."""
        lines = [f"**How good:** {good}"] if good else []
        if self._found.steps:
            if self._header.estimators > 1:
                lines.append(f"**Worst:** {self._worst()}")
            episode = self._shown()
            lines.append(f"**When it went wrong:** {self._when(episode)}")
            if episode:
                lines.append(f"**Why:** {self._why(episode)}")
            lines.append(f"**Look next:** {self._next(episode)}")
        return "  \n".join(lines)

    def _shown(self) -> Episode | None:
        """Of the worst estimator; if it has none, the most serious of all."""
        return self._found.moment or max(self._found.departures.episodes, key=lambda e: (e.of_error, e.ratio), default=None)

    def _name(self, estimator: int) -> str:
        return "the network as a whole" if estimator == NETWORK else self._names[estimator]

    def _worst(self) -> str:
        found, e = self._found, self._found.rank[0]
        if not math.isfinite(found.badness[e]):
            return "unknown"
        middle = float(np.nanmedian(found.badness))
        what = "RMS error" if found.departures.levels is not None else "mean test quantity"
        times = f", {found.badness[e] / middle:.2g} times that of the median node" if middle > 0.0 else ""
        levels = found.departures.levels
        steady = f"; {levels[e]:.2g} times also when settled" if levels is not None and levels[e] >= 2.0 and math.isfinite(levels[e]) else ""
        unit = " m" if found.departures.of_position else ""
        return f"{self._names[e]}, {what} {found.badness[e]:.3g}{unit}{times}{steady}"

    def _when(self, episode: Episode | None) -> str:
        if episode is None:
            return "nobody departed from what is usual" if self._header.estimators > 1 else "it did not depart from what is usual"
        departures = self._found.departures
        unit = " m" if departures.of_position else ""
        what = (f"error up to {episode.ratio:.2g} times its usual ({episode.value:.3g}{unit})" if episode.of_error
                else f"test quantity up to {episode.ratio:.3g} times the expected")
        text = f"{self._name(episode.estimator)} {when(episode)}, {what} at {episode.peak_s:.6g} s"
        mine = [e for e in departures.of(episode.estimator) if e is not episode and e.of_error == episode.of_error]
        if mine:
            text += f"; {len(mine)} more times"
        others = {}
        for other in sorted(departures.episodes, key=lambda e: (not e.of_error, e.begin_s)):
            if other.estimator != episode.estimator:
                others.setdefault(other.estimator, other)
        some = [f"{self._name(e.estimator)} {e.begin_s:.6g} s" for e in list(others.values())[:_MOST]]
        if some:
            text += "; also " + ", ".join(some) + (f" and {len(others) - _MOST} more" if len(others) > _MOST else "")
        return text

    def _why(self, episode: Episode) -> str:
        """What the log knows of the begin, or, where the error is late, of the test quantity's that came before."""
        before = [e for e in self._found.departures.of(episode.estimator) if e.begin_step <= episode.begin_step and e.end_step >= episode.begin_step]
        texts = list(dict.fromkeys(text for e in [episode, *before] for text in self._causes.texts.get(e, [])))
        if texts:
            return "; ".join(texts)
        if not episode.of_error or any(not e.of_error for e in before):
            return "nothing was missing or marked faulty; the readings do not fit the model"
        return "nothing was missing or marked faulty, and the readings fit the model"

    def _next(self, episode: Episode | None) -> str:
        header = self._header
        tab = "Navigation" if header.navigation else "Node"
        e = self._found.rank[0] if episode is None or episode.estimator == NETWORK else episode.estimator
        page = "" if header.central else f", page {header.estimator_nodes[e]}"
        if episode is None:
            return f"tab {tab}{page}: errors against their bands"
        also = "" if header.navigation or header.central else f" (not there: --node {header.estimator_nodes[e]})" if e != self._found.rank[0] else ""
        return f"tab {tab}{page}{also}, at {episode.begin_s:.6g} s; a click on a line of its log goes there"
