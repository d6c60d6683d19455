# SPDX-License-Identifier: MIT
"""What the viewer shows of a tracking log: the scene and the decisions of gates left, errors, consistency and agreement right."""

import numpy as np
import rerun.blueprint as rrb

from meshkal_log.fields import Batch
from ..numbers import tracking as numbers
from ..numbers.survey import DRAWN_NODES
from ..recording import colours
from ..recording.tracking import DRAWN_SLOTS
from .consensus import consensus
from .parts import TIME_AXIS, Shown, axis_of_most, network, scene, series, states, words

# One lane each; more would be too thin to read.
LANES = 40


def overview(shown: Shown) -> rrb.Horizontal:
    header, scenario, first = shown.header, shown.scenario, shown.first
    if scenario.position_states:
        left = [scene(scenario, first, _scene_name(first))]
    else:
        few = header.estimators <= DRAWN_NODES
        left = [rrb.Tabs(*states(header, has_truth=first.truth is not None, few=few), active_tab=0)]
    shares = [7.0]
    lanes = sum(map(bool, header.rows))
    if 0 < lanes <= LANES:
        left.append(rrb.StateTimelineView(origin="decisions", name="What became of each sensor's reading", time_view=TIME_AXIS))
        shares.append(min(max(0.7 * lanes - 0.4, 1.2), 6.0))  # a lane has the same height in all pictures
    return rrb.Horizontal(
        rrb.Vertical(*left, row_shares=shares),
        rrb.Vertical(*_plots(shown)),
        rrb.Vertical(network(header, scenario, has_truth=first.error is not None), words(), row_shares=[2, 3]),
        column_shares=[5, 5, 4],
        name="Overview",
    )


def _plots(shown: Shown) -> list[rrb.View]:
    header, scenario, first, compared = shown.header, shown.scenario, shown.first, shown.compared
    others = "".join(f", {colours.compared(i)[0]}: {label}" for i, label in enumerate(compared))
    distances = "".join(f"; {colours.compared(i)[0]}: RMS distance to {label}" for i, label in enumerate(compared))
    out = []
    error = numbers.position_error(first, scenario)
    if error is not None:
        extra = ("$origin/compared/**",) if compared else ()
        out.append(shown.plot("position_error", "Position error{each}, m" + others, summary="rms", axis=axis_of_most(error), extra=extra))
    elif first.error is not None:
        out.append(shown.plot("error_db", "Error{each}, dB", summary="rms"))
    if first.nees is not None:
        low, high = numbers.nees_band(header.states)
        name = "NEES{each}; exact: " + f"{header.states}, in 95 of 100 steps {low:.2f} to {high:.2f}"
        out.append(shown.plot("nees", name, summary="mean", axis=axis_of_most(first.nees, 1.5 * high), legend=False, extra=("$origin/band/**",)))
    else:
        out.append(_test_quantity(shown, "no truth, so no NEES"))
    if _gated(first):
        sums = len(numbers.Slots(header).at) > DRAWN_SLOTS
        contents = ["$origin/threshold", "$origin/network/**" if sums else "$origin/**", *([] if sums else ["- $origin/network/**"])]
        what = "largest in each step" if sums else "cross: rejected, triangle: inflated"
        axis = axis_of_most(np.concatenate([first.gate_ratio, first.gate_stacked_ratio], axis=1), 2.0)
        out.append(series("gate_ratio", f"Test ratio of the gate, threshold 1; {what}", contents, axis=axis))
    elif first.nees is not None:
        out.append(_test_quantity(shown, "no gate in this log"))
    if first.disagreement is not None:
        name = f"Disagreement: largest distance of two estimates, m{distances}"
        out.append(series("disagreement", name, ["$origin/**"], axis=axis_of_most(first.disagreement)))
    elif compared:
        out.append(series("disagreement", f"Disagreement, m{distances}", ["$origin/**"]))
    if first.consensus_disagreement is not None and header.iterations:
        out.append(consensus(header))
    return out


def _test_quantity(shown: Shown, why: str) -> rrb.View:
    axis = axis_of_most(shown.first.nis / np.maximum(shown.first.nis_rows, 1), 2.0)
    return shown.plot("nis_ratio", "Test quantity{each}, 1 = as expected " + f"({why})", summary="pooled", axis=axis, legend=False)


def _scene_name(first: Batch) -> str:
    target = "target (white), " if first.truth is not None else ""
    return f"Position, m: {target}estimates, readings"


def _gated(first: Batch) -> bool:
    return bool((first.gate_ratio > 0).any() or (first.gate_stacked_ratio > 0).any())
