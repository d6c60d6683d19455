# SPDX-License-Identifier: MIT
"""What the viewer shows of a tracking log: the scene and the decisions of gates left, errors, consistency and agreement right."""

import numpy as np
import rerun.blueprint as rrb

from meshkal_log.fields import Batch, Header
from meshkal_log.scenario import Scenario
from ..numbers import tracking as numbers
from ..recording import colours
from ..recording.tracking import DRAWN_SLOTS
from .consensus import consensus
from .parts import TIME_AXIS, plot, scene, series, states, text_log

# One lane each; more would be too thin to read.
LANES = 40


def front(header: Header, scenario: Scenario, first: Batch, compared: tuple[str, ...], *, few: bool) -> dict:
    """The tabs that come first, by the name of the view."""
    network = rrb.GraphView(origin="network", name="Network, colours as the summary says")
    words = text_log("rejections", "Readings that were not used as they were")
    summary = rrb.TextDocumentView(origin="summary", name="Summary")
    return {
        "overview": _overview(header, scenario, first, compared, few=few),
        "summary": rrb.Horizontal(summary, rrb.Vertical(network, words), column_shares=[5, 6], name="Summary and network"),
    }


def _overview(header: Header, scenario: Scenario, first: Batch, compared: tuple[str, ...], *, few: bool) -> rrb.Horizontal:
    if scenario.position_states:
        left = [scene(scenario, first, _scene_name(first), few=few)]
    else:
        left = [rrb.Tabs(*states(header, has_truth=first.truth is not None, few=few), active_tab=0)]
    shares = [7.0]
    lanes = sum(map(bool, header.rows))
    if 0 < lanes <= LANES:
        left.append(rrb.StateTimelineView(origin="decisions", name="What became of each sensor's reading", time_view=TIME_AXIS))
        shares.append(min(max(0.7 * lanes - 0.4, 1.2), 6.0))  # a lane has the same height in all pictures
    return rrb.Horizontal(
        rrb.Vertical(*left, row_shares=shares),
        rrb.Vertical(*_plots(header, scenario, first, compared, few=few)),
        column_shares=[6, 5],
        name="Overview",
    )


def _plots(header: Header, scenario: Scenario, first: Batch, compared: tuple[str, ...], *, few: bool) -> list[rrb.View]:
    every = "of the centre" if header.central else "of each node" if few else "over the network"
    others = "".join(f", {colours.compared(i)[0]}: {label}" for i, label in enumerate(compared))
    distances = "".join(f"; {colours.compared(i)[0]}: RMS distance to {label}" for i, label in enumerate(compared))
    out = []
    error = numbers.position_error(first, scenario)
    if error is not None:
        name = f"Position error {every}, m" + (", white: RMS over the network" if header.estimators > 1 and few else "") + others
        extra = ("$origin/compared/**",) if compared else ()
        out.append(plot(header, "position_error", name, summary="rms", axis=_axis(error), extra=extra))
    elif first.error is not None:
        out.append(plot(header, "error_db", f"Error {every}, dB", summary="rms"))
    if first.nees is not None:
        low, high = numbers.nees_band(header.states)
        name = f"NEES {every}; an exact filter: {header.states}, in 95 of 100 steps from {low:.2f} to {high:.2f}"
        out.append(plot(header, "nees", name, summary="mean", axis=_axis(first.nees, 1.5 * high), extra=("$origin/band/**",)))
    else:
        name = f"Test quantity {every}, 1 = as expected (no truth, so no NEES)"
        out.append(plot(header, "nis_ratio", name, summary="pooled", axis=_axis(first.nis / np.maximum(first.nis_rows, 1), 2.0)))
    if _gated(first):
        sums = len(numbers.Slots(header).at) > DRAWN_SLOTS
        contents = ["$origin/threshold", "$origin/network/**" if sums else "$origin/**", *([] if sums else ["- $origin/network/**"])]
        what = "largest in each step" if sums else "of each reading; cross: rejected, triangle: inflated"
        axis = _axis(np.concatenate([first.gate_ratio, first.gate_stacked_ratio], axis=1), 2.0)
        out.append(series("gate_ratio", f"Test ratio of the gate, threshold 1; {what}", contents, axis=axis))
    elif first.nees is not None:
        name = f"Test quantity {every}, 1 = as expected (no gate in this log)"
        out.append(plot(header, "nis_ratio", name, summary="pooled", axis=_axis(first.nis / np.maximum(first.nis_rows, 1), 2.0)))
    if first.disagreement is not None:
        name = f"Disagreement: largest distance of two estimates, m{distances}"
        out.append(series("disagreement", name, ["$origin/**"], axis=_axis(first.disagreement)))
    elif compared:
        out.append(series("disagreement", f"Disagreement, m{distances}", ["$origin/**"]))
    if first.consensus_disagreement is not None and header.iterations:
        out.append(consensus(header))
    return out


def _scene_name(first: Batch) -> str:
    target = "target (white), " if first.truth is not None else ""
    return f"Position, m: {target}estimates with 3 sigma, sensors, readings of this instant"


def _gated(first: Batch) -> bool:
    return bool((first.gate_ratio > 0).any() or (first.gate_stacked_ratio > 0).any())


def _axis(values: np.ndarray, least: float = 0.0) -> rrb.ScalarAxis | None:
    """From 0 to what nearly all values reach: one outlier or the start would otherwise press the rest flat. The view zooms out to them."""
    known = values[np.isfinite(values) & (values > 0)]
    if not len(known):
        return None
    return rrb.ScalarAxis(range=(0.0, max(least, min(1.05 * float(known.max()), 1.5 * float(np.percentile(known, 97))))))
