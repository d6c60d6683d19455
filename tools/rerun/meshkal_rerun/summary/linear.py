# SPDX-License-Identifier: MIT
"""The text panel: what ran, how it went, and how to read the pictures."""

import numpy as np

from meshkal_log.fields import Batch, Header
from meshkal_log.scenario import Scenario
from ..numbers import derive
from .ending import ENDINGS
from .head import Head
from .integrity import IntegritySummary

_FILTER_NAMES = {
    "kfc": "central Kalman filter",
    "rkfc": "central robust Kalman filter",
    "kfd": "distributed Kalman filter",
    "rkfdu": "distributed robust Kalman filter, one tolerance for all nodes",
    "rkfdnu": "distributed robust Kalman filter, local tolerances sent at every step",
    "rkfdnu2": "distributed robust Kalman filter, local steady-state tolerances stored in the nodes",
}


class Summary:
    def __init__(self, header: Header, scenario: Scenario, run: int, names: list[str], head: Head) -> None:
        self.head = head
        self._header, self._scenario, self._run, self._names = header, scenario, run, names
        self._steps = 0
        self._last_step = 0
        self._missing = {"measurements": 0.0, "estimates": 0.0}
        self._slots = sum(len(s) for s in header.slots)
        self._fault_entries = 0
        self._nis = np.zeros(2)
        self._squares = np.zeros(header.estimators)
        self._known = np.zeros(header.estimators)
        self._infinite = 0
        self._last_rms_db: float | None = None
        self._has_estimates_arrived = False
        self.integrity = IntegritySummary(header, names)
        self.more: list[tuple[str, str]] = []  # further rows of the result

    def batch(self, batch: Batch, quantities: dict, network: dict, fault_entries: int) -> None:
        self._steps += len(batch.step)
        self._last_step = int(batch.step[-1])
        self._fault_entries += fault_entries
        for what in self._missing:
            if f"missing_{what}" in quantities:
                self._missing[what] += float(quantities[f"missing_{what}"].sum())
        self._has_estimates_arrived = "missing_estimates" in quantities
        nis = derive.finite(batch.nis)
        self._nis += (np.nansum(nis), np.where(np.isnan(nis), 0, batch.nis_rows).sum())
        error = derive.known_error(batch)
        if error is not None:
            known = np.isfinite(error)
            # A diverged run may overflow; an infinite mean is then what happened.
            with np.errstate(over="ignore"):
                self._squares += np.square(np.where(known, error, 0.0)).sum(axis=0)
            self._known += known.sum(axis=0)
            self._infinite += int(np.isinf(error).sum())
            self._last_rms_db = float(network["error_db"]["rms"][-1])

    def text(self, end: str | None, colour_range: tuple[float, float] | None) -> str:
        result, facts = (table(heading, rows) for heading, rows in self.tables(end).items())
        return "\n\n".join([self._title(), self.head.text(self._good()), result, self._legend(colour_range), facts])

    def tables(self, end: str | None) -> dict[str, list[tuple[str, str]]]:
        """Rows of name and value, in Markdown, by the tables' headings."""
        return {"Result": self._result(end), "Scenario": self._facts()}

    def title(self) -> tuple[str, str]:
        """Of the scenario, and of the filter in Markdown."""
        name, what = self._title().split("\n\n", 1)
        return name.removeprefix("# "), what

    def headlines(self) -> list[str]:
        """How good, who is worst, when and why, in Markdown."""
        return self.head.text(self._good()).split("  \n")

    def _good(self) -> str:
        """In a line."""
        out = []
        if self._known.any():
            mean = self._squares.sum() / self._known.sum()
            out.append(f"RMS error {np.sqrt(mean):.3g} ({db(mean)})" + (" over all nodes" if self._header.estimators > 1 else ""))
        return ", ".join([*out, *self._fit()])

    def _fit(self) -> list[str]:
        return [f"test quantity {self._nis[0] / self._nis[1]:.2f} (expected 1)"] if self._nis[1] > 0 else []

    def _title(self) -> str:
        return f"# {self._scenario.name}\n\n{_FILTER_NAMES[self._header.filter]} (`{self._header.filter}`)"

    def _result(self, end: str | None) -> list[tuple[str, str]]:
        rows = []
        if self._known.any():
            with np.errstate(divide="ignore", invalid="ignore"):
                each = self._squares / self._known
            total = self._squares.sum() / self._known.sum()
            rows.append(("RMS error, all nodes and steps", db(total)))
            rows.append(("RMS error, last step", "unknown" if np.isnan(self._last_rms_db) else f"{self._last_rms_db:z.1f} dB"))
            if self._header.estimators > 1:
                best, worst = int(np.nanargmin(each)), int(np.nanargmax(each))
                rows.append(("best and worst node", f"{self._names[best]}: {db(each[best])}, {self._names[worst]}: {db(each[worst])}"))
        else:
            rows.append(("error", "no truth in the log"))
        if self._infinite:
            rows.append(("infinite errors, not in the RMS", str(self._infinite)))
        if self._nis[1] > 0:
            rows.append(("mean test quantity (expected 1)", f"{self._nis[0] / self._nis[1]:.2f}"))
        rows.append(("measurements missing", self._share("measurements")))
        if self._has_estimates_arrived:
            rows.append(("estimates missing", self._share("estimates")))
        rows.append(("fault entries", str(self._fault_entries)))
        rows += self.integrity.rows()
        rows += self.more
        state = ENDINGS[end]
        rows.append(("log", f"{state}, {self._steps} steps, to step {self._last_step}"))
        return rows

    def _share(self, what: str) -> str:
        return f"{100.0 * self._missing[what] / (self._slots * self._steps):.1f} %"

    def _facts(self) -> list[tuple[str, str]]:
        header, scenario = self._header, self._scenario
        live = header.source == "live"
        links = sum(len(s) for s in header.slots) - header.estimators
        rows = [
            ("nodes", str(header.nodes)),
            ("estimators", self._estimators()),
            ("states", str(header.states)),
            ("measured rows", str(sum(header.rows))),
            ("neighbours a node, mean", "" if header.central else f"{links / header.estimators:.1f}"),
            ("time step", f"{header.dt_s:g} s"),
            ("run", "" if live else f"{self._run} of {header.runs} (from 0), {header.steps} steps asked for"),
            ("seed, message loss", "" if live else f"{header.seed}, {header.loss:g}"),
            ("data", {"drawn": "drawn from the model", "recorded": "recorded", "live": "from a running node"}[header.source]),
            ("arithmetic", header.real),
            ("tolerance", scenario.tolerance),
            ("weights", scenario.weights),
            *self.integrity.facts(),
            ("program", header.program),
            ("scenario SHA-256", f"`{header.scenario_sha256[:16]}`"),
        ]
        return [row for row in rows if row[1]]

    def _estimators(self) -> str:
        header = self._header
        if header.central:
            return f"{header.estimators} (central)"
        if header.estimators == header.nodes:
            return f"{header.estimators} (one a node)"
        return ", ".join(self._names)

    def _monitor_legend(self) -> list[str]:
        if not self._header.monitor:
            return []
        lines = ["- Test ratio of a monitor: its statistic over the threshold; 1 or more is an alarm. w: what leaving a sensor out takes from AIME. Axes "
                 "are cut above twice the threshold: zoom out."]
        if self._header.monitor == "exclude" and not self._header.satellites:
            lines.append("- Network and scene: \u00d7, yellow or red: held faulty at so many of the nodes that hear the sensor.")
        return lines

    def _legend(self, colour_range: tuple[float, float] | None) -> str:
        what = "error" if self._known.any() else "10 log10 of the test quantity (there is no truth)"
        lines = ["**How to read it**", ""]
        if colour_range:
            low, high = colour_range
            lines.append(f"- Network: blue {low:.0f} dB or less, red {high:.0f} dB or more; {what}. Grey: unknown. Dashed: nothing arrived over this half of a link.")
        lines += [
            "- Error in dB: 20 log10 of the norm of (truth - estimate); -20 dB is a tenth. A gap: zero, unknown or infinite.",
            "- Test quantity: squared normalised innovation over its degrees of freedom. Around 1: the node's model fits.",
            "- theta is 0 where a filter is not robust. Tolerance: twice the Kullback-Leibler divergence, in nats.",
            "- Faults: an entry when a node's faults change, what is merely missing left out: it is counted in the next tab.",
        ]
        lines += self._monitor_legend()
        if self._scenario.position_states:
            lines.append(
                "- Ellipsoids: 3 sigma of the position, from the covariance V that the node holds. Diffusion changes the error "
                "and not V, so it is not the covariance of the error."
            )
        return "\n".join(lines)


def db(mean_square: float) -> str:
    with np.errstate(divide="ignore"):
        return f"{10.0 * np.log10(mean_square):z.1f} dB"


def table(heading: str, rows: list[tuple[str, str]]) -> str:
    lines = [f"| {heading} | |", "|---|---|"]
    lines += [f"| {name} | {value} |" for name, value in rows]
    return "\n".join(lines)
