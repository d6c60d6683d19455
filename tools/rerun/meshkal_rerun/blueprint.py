"""What the viewer shows when a recording is opened: everything of importance without a click."""

import rerun.blueprint as rrb

from .reader import Header
from .scenario import Scenario
from .scene import SPHERES

# The viewer draws a hundred lines in a plot at ease, and a thousand not.
DRAWN_NODES = 100
_LEGEND_NODES = 8
_STATE_PLOTS = 9


def blueprint(header: Header, scenario: Scenario, *, has_truth: bool) -> rrb.Blueprint:
    few = header.estimators <= DRAWN_NODES
    tabs = [
        _overview(header, scenario, has_truth=has_truth, few=few),
        _grid_tab(_consistency(header, few=few), "Consistency and losses"),
        _grid_tab(_states(header, has_truth=has_truth, few=few), "States"),
    ]
    if header.nodes <= DRAWN_NODES:
        tabs.append(_plot("measurement", "Measurements of each node, in the units of the model", few=True, legend=False))
    return rrb.Blueprint(
        rrb.Tabs(*tabs, active_tab=0),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        # Opened at the last step: trail, colours and values are then all there.
        rrb.TimePanel(state="collapsed", timeline="sim_time", play_state="following"),
        auto_layout=False,
        auto_views=False,
    )


def _overview(header: Header, scenario: Scenario, *, has_truth: bool, few: bool) -> rrb.Horizontal:
    legend = header.estimators <= _LEGEND_NODES
    every = "of each node" if few and not header.central else "over the network" if not few else "of the centre"
    plots = [
        _plot("theta", f"Risk sensitivity theta {every}", few=few, legend=legend),
        _plot("tolerance", f"Tolerance c {every}, nats", few=few, legend=legend),
    ]
    if has_truth:
        name = f"Error {every}, dB" + (" (white: RMS over the network)" if header.estimators > 1 else "")
        plots.insert(0, _plot("error_db", name, few=few, legend=True if not few else legend))
    else:
        plots.insert(0, _plot("nis_ratio", f"Test quantity {every}, 1 = as expected (no truth: no error)", few=few, legend=legend))
    colour = "error" if has_truth else "test quantity"
    graph = rrb.GraphView(origin="network", name=f"Network, colour: {colour} from blue (small) to red (large)")
    pictures = [graph]
    if scenario.position_states:
        pictures.insert(0, _scene(few=few, has_truth=has_truth))
    text = rrb.Vertical(
        rrb.TextDocumentView(origin="summary", name="Summary"),
        rrb.TextLogView(origin="faults", name="Faults"),
        row_shares=[4, 1],
    )
    return rrb.Horizontal(
        rrb.Vertical(*plots, row_shares=[4, 3, 3]),
        rrb.Vertical(*pictures),
        text,
        column_shares=[5, 5, 4],
        name="Overview",
    )


def _scene(*, few: bool, has_truth: bool) -> rrb.Spatial3DView:
    contents = ["$origin/**"] if few else ["$origin/**", f"- /{SPHERES}"]
    name = "Position, m: " + ("truth (white) and " if has_truth else "") + "estimates of the nodes (coloured)"
    return rrb.Spatial3DView(origin="scene", contents=contents, name=name)


def _consistency(header: Header, *, few: bool) -> list[rrb.View]:
    plots = [
        _plot("nis_ratio", "Test quantity: squared normalised innovation / degrees of freedom (1 = as expected)", few=few),
        _plot("trace_covariance", "Trace of the covariance V", few=few),
        _plot("missing_measurements", "Missing measurements (white: all nodes together)", few=few),
    ]
    if not header.central:
        plots.append(_plot("missing_estimates", "Missing estimates (white: all nodes together)", few=few))
    return plots


def _states(header: Header, *, has_truth: bool, few: bool) -> list[rrb.View]:
    plots = []
    for i in range(min(header.states, _STATE_PLOTS)):
        wanted = ["$origin/estimates"] if few else ["$origin/network/**"]
        if has_truth:
            wanted.append("$origin/truth")
        name = f"State {i}" + (" (white: truth)" if has_truth else "")
        plots.append(rrb.TimeSeriesView(origin=f"state/{i}", contents=wanted, name=name, plot_legend=_legend(not few)))
    return plots


def _grid_tab(views: list[rrb.View], name: str) -> rrb.Grid:
    return rrb.Grid(*views, name=name, grid_columns=1 if len(views) <= 2 else 2 if len(views) <= 6 else 3)


def _plot(quantity: str, name: str, *, few: bool, legend: bool | None = None) -> rrb.TimeSeriesView:
    contents = ["$origin/**"] if few else ["$origin/network/**", "$origin/expected"]
    return rrb.TimeSeriesView(origin=quantity, contents=contents, name=name, plot_legend=_legend(not few if legend is None else legend))


def _legend(visible: bool) -> rrb.PlotLegend:
    return rrb.PlotLegend(rrb.Corner2D.RightTop, visible=visible)
