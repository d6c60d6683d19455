# SPDX-License-Identifier: MIT
"""The first lines of the text panel: how good, who is worst, when it went wrong and why, and where to look next."""

import math

import numpy as np

from meshkal_log.fields import Header
from ..numbers.causes import Causes, when
from ..numbers.departures import NETWORK, Episode
from ..numbers.silence import silence_text
from ..numbers.survey import Survey

_MOST = 3
_LATE = 20  # steps, of the error after the test quantity


class Head:
    def __init__(self, header: Header, found: Survey, causes: Causes, names: list[str]) -> None:
        self._header, self.found, self._causes, self._names = header, found, causes, names

    def text(self, good: str) -> str:
        """good: how good the run was as a whole."""
        lines = [f"**How good:** {good}"] if good else []
        if self.found.steps:
            if self._header.estimators > 1:
                lines.append(f"**Worst:** {self._worst()}")
        if self.found.departures.watched:
            episode = self.found.moment
            lines.append(f"**When it went wrong:** {self._when(episode)}")
            if episode:
                lines.append(f"**Why:** {self._why(episode)}")
            silent = self._silent()
            if silent:
                lines.append(f"**Messages:** {silent}")
            lines.append(f"**Look next:** {self._next(episode)}")
        return "  \n".join(lines)

    def _name(self, estimator: int) -> str:
        return "the network as a whole" if estimator == NETWORK else "the filter" if self._header.central else self._names[estimator]

    def _worst(self) -> str:
        found, e = self.found, self.found.rank[0]
        if not math.isfinite(found.badness[e]):
            return "unknown"
        middle = float(np.nanmedian(found.badness))
        what = "RMS error" if found.has_truth else "mean test quantity"
        times = f", {found.badness[e] / middle:.2g} times that of the median node" if middle > 0.0 else ""
        if 0.0 < found.badness[e] < 1.1 * middle:
            times = ", hardly more than the others"
        levels = found.departures.levels
        steady = f"; {levels[e]:.2g} times also when settled" if levels is not None and levels[e] >= 2.0 and math.isfinite(levels[e]) else ""
        unit = " m" if found.departures.of_position else ""
        return f"{self._names[e]}, {what} {found.badness[e]:.3g}{unit}{times}{steady}"

    def _when(self, episode: Episode | None) -> str:
        if episode is None:
            return "nobody departed from what is usual" if self._header.estimators > 1 else "it did not depart from what is usual"
        departures = self.found.departures
        unit = " m" if departures.of_position else ""
        what = (f"error up to {episode.value:.3g}{unit}, {episode.ratio:.2g} times its usual," if episode.of_error
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
        mine = self.found.departures.of(episode.estimator)
        before = [e for e in mine if 0 <= episode.begin_step - e.begin_step <= _LATE and e.end_step >= episode.begin_step]
        texts = list(dict.fromkeys(text for e in [episode, *before] for text in self._causes.texts.get(e, [])))
        if texts:
            return "; ".join(texts)
        if not episode.of_error or any(not e.of_error for e in before):
            return "nothing was missing or marked faulty; the readings do not fit the model"
        return "nothing was missing or marked faulty, and the readings fit the model"

    def _silent(self) -> str:
        """Who heard nothing for a while, and who got clearly fewer messages than most."""
        departures = self.found.departures
        said = [f"{silence_text(silence, self._names[silence.estimator], self._header.central)} {when(span)}"
                for silence, span in departures.silences[:_MOST]]
        if len(departures.silences) > _MOST:
            said.append(f"{len(departures.silences) - _MOST} more")
        missing = departures.missing
        if missing is not None and np.isfinite(missing).sum() > 1:
            middle = float(np.nanmedian(missing))
            few = [e for e in np.argsort(-np.nan_to_num(missing), kind="stable")[:_MOST] if missing[e] > max(2.0 * middle, middle + 0.1)]
            said += [f"{self._names[e]} missed {100 * missing[e]:.0f} % of its messages (most nodes {100 * middle:.0f} %)" for e in few]
        return "; ".join(said)

    def _next(self, episode: Episode | None) -> str:
        header, silences = self._header, self.found.departures.silences
        tab = "Navigation" if header.navigation else "Node"
        e, moment = self.found.rank[0], episode
        if episode is None and silences:
            moment = silences[0][1]
        if moment and moment.estimator != NETWORK:
            e = moment.estimator
        page = "" if header.central else f", page {header.estimator_nodes[e]}"
        if moment is None:
            return f"tab {tab}{page}: errors against their bands"
        return f"tab {tab}{page}, at {moment.begin_s:.6g} s; a click on a line of the log of events goes there"
