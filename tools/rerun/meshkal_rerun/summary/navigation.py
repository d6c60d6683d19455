# SPDX-License-Identifier: MIT
"""The text panel of a navigation log."""

import numpy as np

from meshkal_log.fields import Batch, Decision, Header
from meshkal_log.scenario import Scenario
from ..numbers import navigation as numbers
from ..numbers.navigation import GROUPS
from ..numbers.tracking import nees_band
from .ending import ENDINGS
from .head import Head
from .linear import Summary

_FILTER_NAMES = {
    "ekf": "tightly coupled GNSS/INS, extended Kalman filter",
    "rekf-n": "tightly coupled GNSS/INS, robust extended Kalman filter with normal statistics",
    "rekf-t": "tightly coupled GNSS/INS, robust extended Kalman filter with Student statistics",
}


class NavigationSummary(Summary):
    def __init__(self, header: Header, scenario: Scenario, run: int, names: list[str], head: Head) -> None:
        super().__init__(header, scenario, run, names, head)
        self._error_squares = {group.key: np.zeros(2) for group in GROUPS}  # sum and count of instants
        self._decided = np.zeros(len(Decision), dtype=np.int64)
        self._nees = np.zeros(3)  # sum, inside the band, count
        self._band = nees_band(header.states)
        self._first_s: float | None = None
        self._last_s = 0.0

    def batch(self, batch: Batch, quantities: dict, network: dict, fault_entries: int) -> None:
        super().batch(batch, quantities, network, fault_entries)
        self._decided += np.bincount(batch.decision.reshape(-1), minlength=len(Decision))
        if batch.truth is not None:
            for group in GROUPS:
                squares = np.square(numbers.errors(batch, group)).sum(axis=1)
                known = np.isfinite(squares)
                self._error_squares[group.key] += (squares[known].sum(), known.sum())
        if "nees" in quantities:
            nees = quantities["nees"][np.isfinite(quantities["nees"])]
            self._nees += (nees.sum(), ((nees >= self._band[0]) & (nees <= self._band[1])).sum(), len(nees))
        self._first_s = float(batch.time_s[0]) if self._first_s is None else self._first_s
        self._last_s = float(batch.time_s[-1])

    def _good(self) -> str:
        squares, count = self._error_squares["position"]
        out = [f"position RMSE {np.sqrt(squares / count):.4g} m"] if count else []
        out += [f"NEES {self._nees[0] / self._nees[2]:.3g} (exact: {self._header.states})"] if self._nees[2] else []
        return ", ".join([*out, *self._fit()])

    def _title(self) -> str:
        return f"# {self._scenario.name}\n\n{_FILTER_NAMES[self._header.filter]} (`{self._header.filter}`)"

    def _result(self, end: str | None) -> list[tuple[str, str]]:
        rows = [(f"{group.name.lower()} RMSE", f"{np.sqrt(squares / count):.4g} {group.unit}")
                for group in GROUPS for squares, count in [self._error_squares[group.key]] if count]
        rows = rows or [("error", "no truth in the log")]
        rows += self.more
        if self._nees[2]:
            rows.append((f"mean NEES (an exact filter: {self._header.states})", f"{self._nees[0] / self._nees[2]:.3g}"))
            low, high = self._band
            rows.append((f"NEES within {low:.2f} to {high:.2f}", f"{100.0 * self._nees[1] / self._nees[2]:.1f} % (exact: 95 %)"))
        if self._nis[1] > 0:
            rows.append(("mean test quantity (expected 1)", f"{self._nis[0] / self._nis[1]:.2f}"))
        d = self._decided
        used, less, none = (int(d[k]) for k in (Decision.USED, Decision.INFLATED, Decision.REJECTED))
        rows.append(("readings used, with less weight, not", f"{used}, {less}, {none}"))
        rows += self.integrity.rows()
        state = ENDINGS[end]
        rows.append(("log", f"{state}, {self._steps} epochs, {self._first_s:g} s to {self._last_s:g} s"))
        return rows

    def _facts(self) -> list[tuple[str, str]]:
        facts = [(name, value) for name, value in super()._facts() if name not in ("nodes", "estimators", "measured rows")]
        return [("satellites", ", ".join(map(str, self._header.satellites))), *facts]

    def _legend(self, colour_range: tuple[float, float] | None) -> str:
        lines = [
            "**How to read it**", "",
            "- Sky: zenith in the middle, north up, circles at elevations of 0, 30 and 60 degrees. A satellite is blue at full weight, red at "
            "none, grey without a reading; one that is held faulty has a ring and a cross.",
            "- Errors: estimate less truth. Attitude: roll, pitch, heading; biases in the body's axes: right, forward, up.",
            "- NEES: squared error in units of the covariance. Above its band the filter is over-confident, below it too careful.",
            "- Test quantity: squared normalised innovation over its degrees of freedom. Around 1: the model fits.",
        ]
        return "\n".join(lines + self._monitor_legend())
