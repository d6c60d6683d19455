# SPDX-License-Identifier: MIT
"""What the viewer shows when a recording is opened: everything of importance without a click."""

import rerun.blueprint as rrb
from rerun.blueprint.encodings import TextLogColumn

from .reader import Batch, Header
from .scenario import Scenario
from .scene import ELLIPSOIDS, viewpoint

# The viewer draws a hundred lines in a plot at ease, and a thousand not.
DRAWN_NODES = 100
_LEGEND_NODES = 8
_STATE_PLOTS = 9
_FAULT_COLUMNS = [TextLogColumn("loglevel", visible=True), TextLogColumn("body", visible=True)]
# A viewer that follows the end would otherwise show the last part of a long run only. Numbers instead of infinity would be
# nanoseconds for one timeline and steps for the other.
_TIME_AXIS = rrb.TimeAxis(view_range=rrb.TimeRange(start=rrb.TimeRangeBoundary.infinite(), end=rrb.TimeRangeBoundary.infinite()))


def blueprint(header: Header, scenario: Scenario, first: Batch) -> rrb.Blueprint:
    """`first` is the first batch: it tells whether there is a truth, and where the scene is."""
    few = header.estimators <= DRAWN_NODES
    tabs = [
        _overview(header, scenario, first, few=few),
        _grid_tab(_consistency(header), "Consistency and losses"),
        _grid_tab(_states(header, has_truth=first.truth is not None, few=few), "States"),
    ]
    if header.nodes <= DRAWN_NODES:
        name = "Measurements of each node, in the units of the model"
        tabs.append(rrb.TimeSeriesView(origin="measurement", name=name, plot_legend=_legend(False), axis_x=_TIME_AXIS))
    return rrb.Blueprint(
        rrb.Tabs(*tabs, active_tab=0),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        # Opened at the last step: trail, colours and values are then all there.
        rrb.TimePanel(state="collapsed", timeline="sim_time", play_state="following"),
        auto_layout=False,
        auto_views=False,
    )


def _overview(header: Header, scenario: Scenario, first: Batch, *, few: bool) -> rrb.Horizontal:
    has_truth = first.error is not None
    legend = 1 < header.estimators <= _LEGEND_NODES
    every = "of the centre" if header.central else "of each node" if few else "over the network"
    if has_truth:
        name = f"Error {every}, dB" + (" (white: RMS over the network)" if header.estimators > 1 and few else "")
        plots = [_plot(header, "error_db", name, summary="rms", legend=legend or not few)]
    else:
        name = f"Test quantity {every}, 1 = as expected (no truth, so no error)"
        plots = [_plot(header, "nis_ratio", name, summary="pooled", legend=legend or not few)]
    plots += [
        _plot(header, "theta", f"Risk sensitivity theta {every}"),
        _plot(header, "tolerance", f"Tolerance c {every}, nats", axis=_tolerance_axis(first)),
    ]
    colour = "error" if has_truth else "test quantity"
    pictures = [rrb.GraphView(origin="network", name=f"Network, colour: {colour} from blue (small) to red (large), range in the summary")]
    if scenario.position_states:
        pictures.insert(0, _scene(scenario, first, few=few))
    else:
        pictures.insert(0, rrb.Tabs(*_states(header, has_truth=first.truth is not None, few=few), active_tab=0))
    text = rrb.Vertical(
        rrb.TextDocumentView(origin="summary", name="Summary"),
        rrb.TextLogView(origin="faults", name="Faults", columns=rrb.TextLogColumns(text_log_columns=_FAULT_COLUMNS)),
        row_shares=[4, 1],
    )
    return rrb.Horizontal(
        rrb.Vertical(*plots, row_shares=[4, 3, 3]),
        rrb.Vertical(*pictures),
        text,
        column_shares=[5, 5, 4],
        name="Overview",
    )


def _scene(scenario: Scenario, first: Batch, *, few: bool) -> rrb.Spatial3DView:
    contents = ["$origin/**"] if few else ["$origin/**", f"- /{ELLIPSOIDS}"]
    name = "Position, m: " + ("truth (white), " if first.truth is not None else "") + "estimates (coloured), sensors (grey)"
    eye, target = viewpoint(scenario, first)
    camera = rrb.EyeControls3D(position=eye, look_target=target, eye_up=(0.0, 0.0, 1.0))
    return rrb.Spatial3DView(origin="scene", contents=contents, name=name, eye_controls=camera)


def _tolerance_axis(first: Batch) -> rrb.ScalarAxis | None:
    """The viewer draws a lone constant on an axis from -1 to 1, where a tolerance looks like nothing."""
    low, high = float(first.tolerance.min()), float(first.tolerance.max())
    return rrb.ScalarAxis(range=(0.0, 1.5 * high)) if 0.0 < low == high < float("inf") else None


def _consistency(header: Header) -> list[rrb.View]:
    several = header.estimators > 1
    name = "Test quantity: squared normalised innovation / degrees of freedom, 1 = as expected"
    together = " (white: all nodes together)" if several else ""
    plots = [
        _plot(header, "nis_ratio", name, summary="pooled"),
        _plot(header, "trace_covariance", "Trace of the covariance V"),
        _plot(header, "missing_measurements", "Missing measurements" + together, summary="total"),
    ]
    if not header.central:
        plots.append(_plot(header, "missing_estimates", "Missing estimates" + together, summary="total"))
    return plots


def _states(header: Header, *, has_truth: bool, few: bool) -> list[rrb.View]:
    plots = []
    for i in range(min(header.states, _STATE_PLOTS)):
        wanted = ["$origin/estimates"] if few else ["$origin/network/**"]
        if has_truth:
            wanted.append("$origin/truth")
        name = f"State {i}" + (" (white: truth)" if has_truth else "")
        plots.append(rrb.TimeSeriesView(origin=f"state/{i}", contents=wanted, name=name, plot_legend=_legend(not few), axis_x=_TIME_AXIS))
    return plots


def _grid_tab(views: list[rrb.View], name: str) -> rrb.Grid:
    return rrb.Grid(*views, name=name, grid_columns=1 if len(views) <= 2 else 2 if len(views) <= 6 else 3)


def _plot(
    header: Header,
    quantity: str,
    name: str,
    *,
    summary: str | None = None,
    legend: bool | None = None,
    axis: rrb.ScalarAxis | None = None,
) -> rrb.TimeSeriesView:
    """All estimators with one summary of the network, or only summaries if they are too many."""
    few = header.estimators <= DRAWN_NODES
    contents = ["$origin/node/**", "$origin/centre"] if few else ["$origin/network/**"]
    if few and summary and header.estimators > 1:
        contents.append(f"$origin/network/{summary}")
    if quantity == "nis_ratio":
        contents.append("$origin/expected")
    shown = _legend(not few if legend is None else legend)
    return rrb.TimeSeriesView(origin=quantity, contents=contents, name=name, plot_legend=shown, axis_x=_TIME_AXIS, axis_y=axis)


def _legend(visible: bool) -> rrb.PlotLegend:
    return rrb.PlotLegend(rrb.Corner2D.RightTop, visible=visible)
