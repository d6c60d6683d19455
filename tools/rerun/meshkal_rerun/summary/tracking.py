# SPDX-License-Identifier: MIT
"""The text panel of a tracking log."""

import numpy as np

from meshkal_log.fields import Batch, Decision, Header
from meshkal_log.scenario import Scenario
from ..numbers import tracking as numbers
from .ending import ENDINGS
from .head import Head
from .linear import Summary, db

_FILTER_NAMES = {
    "ekf": "central extended Kalman filter",
    "ukf": "central unscented Kalman filter",
    "iukf": "central iterated unscented Kalman filter",
    "iukf-literal": "central iterated unscented Kalman filter, as published",
    "pukf": "central progressive unscented Kalman filter",
    "mpukf": "central modified progressive unscented Kalman filter",
    "duif": "distributed unscented information filter",
    "kcf": "Kalman-consensus filter",
    "rekfd": "distributed robust extended Kalman filter",
}


class TrackingSummary(Summary):
    def __init__(self, header: Header, scenario: Scenario, run: int, names: list[str], head: Head) -> None:
        super().__init__(header, scenario, run, names, head)
        self._readings = numbers.Slots(header)
        self._decided = np.zeros(len(Decision), dtype=np.int64)
        self._faulty = np.zeros(len(Decision), dtype=np.int64)
        self._due = {"measurements": 0, "messages": 0}
        self._gone = {"measurements": 0.0, "messages": 0.0}
        self._position_squares, self._position_known = np.zeros(header.estimators), np.zeros(header.estimators)
        self._nees, self._inside, self._nees_known = 0.0, 0, 0
        self._band = numbers.nees_band(header.states)
        self._first_s: float | None = None
        self._last_s = 0.0
        self._apart: float | None = None

    def batch(self, batch: Batch, quantities: dict, network: dict, fault_entries: int) -> None:
        super().batch(batch, quantities, network, fault_entries)
        decided = numbers.decisions(batch, self._readings)
        faulty = batch.faulty[:, self._readings.node] != 0
        self._decided += np.bincount(decided.reshape(-1), minlength=len(Decision))
        self._faulty += np.bincount(decided[faulty], minlength=len(Decision))
        self._due["measurements"] += int((batch.measuring[:, self._readings.node] != 0).sum())
        self._due["messages"] += len(batch.step) * self._header.messages * (self._slots - self._header.estimators)
        for what in self._gone:
            self._gone[what] += float(quantities.get(f"missing_{what}", np.zeros(1)).sum())
        if "position_error" in quantities:
            error = quantities["position_error"]
            with np.errstate(over="ignore"):
                self._position_squares += np.nansum(np.square(error), axis=0)
            self._position_known += np.isfinite(error).sum(axis=0)
        if "nees" in quantities:
            nees = quantities["nees"]
            self._nees += np.nansum(nees)
            self._nees_known += int(np.isfinite(nees).sum())
            self._inside += int(((nees >= self._band[0]) & (nees <= self._band[1])).sum())
        self._first_s = float(batch.time_s[0]) if self._first_s is None else self._first_s
        self._last_s = float(batch.time_s[-1])
        if batch.disagreement is not None:
            self._apart = float(batch.disagreement[-1])

    def _good(self) -> str:
        if not self._position_known.any():
            return super()._good()
        rmse = f"position RMSE {np.sqrt(self._position_squares.sum() / self._position_known.sum()):.4g} m"
        nees = [f"NEES {self._nees / self._nees_known:.3g} (exact: {self._header.states})"] if self._nees_known else []
        return ", ".join([rmse, *nees, *self._fit()])

    def _title(self) -> str:
        return f"# {self._scenario.name}\n\n{_FILTER_NAMES[self._header.filter]} (`{self._header.filter}`)"

    def _result(self, end: str | None) -> list[tuple[str, str]]:
        rows = []
        if self._position_known.any():
            with np.errstate(divide="ignore", invalid="ignore"):
                each = np.sqrt(self._position_squares / self._position_known)
            total = np.sqrt(self._position_squares.sum() / self._position_known.sum())
            rows.append(("position RMSE, all instants", f"{total:.4g} m"))
            if self._header.estimators > 1:
                best, worst = int(np.nanargmin(each)), int(np.nanargmax(each))
                rows.append(("best and worst node", f"{self._names[best]}: {each[best]:.4g} m, {self._names[worst]}: {each[worst]:.4g} m"))
        elif self._known.any():
            rows.append(("RMS error, all states and instants", db(self._squares.sum() / self._known.sum())))
        else:
            rows.append(("error", "no truth in the log"))
        rows += self.more
        if self._nees_known:
            low, high = self._band
            rows.append((f"mean NEES (an exact filter: {self._header.states})", f"{self._nees / self._nees_known:.3g}"))
            inside = f"{100.0 * self._inside / self._nees_known:.1f} % (exact: {100 * numbers.BAND:.0f} %)"
            rows.append((f"NEES within {low:.2f} to {high:.2f}", inside))
        if self._nis[1] > 0:
            rows.append(("mean test quantity (expected 1)", f"{self._nis[0] / self._nis[1]:.2f}"))
        rows += self._fates() + self.integrity.rows()
        if not self._header.central:
            rows.append(("messages missing", _share(self._gone["messages"], self._due["messages"])))
        if self._apart is not None:
            rows.append(("disagreement at the end", f"{self._apart:.3g} m"))
        state = ENDINGS[end]
        rows.append(("log", f"{state}, {self._steps} instants, {self._first_s:g} s to {self._last_s:g} s"))
        return rows

    def _fates(self) -> list[tuple[str, str]]:
        d = self._decided
        judged = int(d[Decision.USED] + d[Decision.REJECTED] + d[Decision.INFLATED])
        rows = [("readings used as they were", f"{d[Decision.USED]} of {judged + d[Decision.REFUSED] + d[Decision.LOST]}")]
        names = {Decision.REJECTED: "rejected", Decision.INFLATED: "used with inflated noise", Decision.REFUSED: "refused by a model"}
        for decision, name in names.items():
            if d[decision]:
                faulty = f", {self._faulty[decision]} of them faulty" if self._faulty.any() else ""
                rows.append((f"readings {name}", f"{d[decision]}{faulty}"))
        if self._faulty[Decision.USED]:
            rows.append(("faulty readings used as they were", str(self._faulty[Decision.USED])))
        rows.append(("readings lost on their way", _share(self._gone["measurements"], self._due["measurements"])))
        return rows

    def _facts(self) -> list[tuple[str, str]]:
        header, scenario = self._header, self._scenario
        kinds = sorted(set(scenario.sensors) - {"none"})
        own = [
            ("sensors", ", ".join(f"{scenario.sensors.count(kind)} {kind}" for kind in kinds)),
            ("gate", f"significance {header.gate:g}, {scenario.gate_policy}" if header.gate else "none"),
            ("increments at most", str(header.increments) if header.filter in ("pukf", "mpukf") else ""),
            ("consensus", f"{header.protocol}, {header.iterations} iterations" if header.filter == "duif" else ""),
        ]
        return [row for row in own if row[1]] + super()._facts()

    def _legend(self, colour_range: tuple[float, float] | None) -> str:
        lines = ["**How to read it**", ""]
        if colour_range:
            what, low, high = "10 log10 of the test quantity (there is no truth)", *(f"{value:.0f} dB" for value in colour_range)
            if self._position_known.any():
                what, low, high = "position error", *(f"{10.0 ** (value / 20.0):.2g} m" for value in colour_range)
            lines.append(f"- Network: blue {low} or less, red {high} or more; {what}. Grey: unknown. Dashed: nothing arrived over this half of a link.")
        lines += [
            "- Estimates and covariances are those after the readings and the exchange of an instant.",
            "- Scene: a ring (a sphere in space) is a range limit; a bright point measures now. Its line is as long and points where the "
            "reading says; what the reading does not say is taken from the target. Green: used, red: rejected, yellow: used with inflated "
            "noise, violet: refused by the model, grey: lost; where several nodes hear it, the worst of these. A green link carried "
            "messages; the fainter, the fewer of them.",
            "- Ellipses: 3 sigma of the position.",
            "- NEES: squared error in units of the covariance. Above its band the filter is over-confident, below it too careful.",
            "- Test ratio: squared normalised innovation over the threshold of the gate; above 1 it is not used as it is.",
            "- Test quantity: squared normalised innovation over its degrees of freedom. Around 1: the model fits.",
        ]
        if self._header.iterations:
            lines.append("- Consensus: largest distance of a node's information matrix from the mean of all, in dB of it, after so many iterations.")
        lines += self._monitor_legend()
        lines.append("- Axes are cut above what nearly all values reach: zoom out to see outliers.")
        return "\n".join(lines)


def _share(gone: float, due: int) -> str:
    return f"{100.0 * gone / due:.1f} %" if due else "none expected"
