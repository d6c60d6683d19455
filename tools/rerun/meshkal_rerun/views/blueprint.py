# SPDX-License-Identifier: MIT
"""What the viewer shows when a recording is opened: everything of importance without a click."""

from collections.abc import Sequence

import rerun.blueprint as rrb

from meshkal_log.fields import Batch, Header
from meshkal_log.reader import LogError
from meshkal_log.scenario import Scenario
from meshkal_log.together import Label
from ..numbers import agreement
from ..numbers.difference import Difference
from ..numbers.survey import Survey
from ..recording.series import seconds_timeline
from . import compare as compare_blueprint
from . import consensus as consensus_blueprint
from . import integrity as integrity_blueprint
from . import navigation as navigation_blueprint
from . import parts as views
from . import tracking as tracking_blueprint
from .parts import DRAWN_NODES, plot


VIEWS = ("overview", "summary", "node", "compare", "integrity", "consensus")


def blueprint(
    header: Header,
    scenario: Scenario,
    first: Batch,
    found: Survey,
    named: Sequence[int],
    compared: Sequence[tuple[Label, Difference]] = (),
    view: str | None = None,
) -> rrb.Blueprint:
    """`first` is the first batch: it tells whether there is a truth, and where the scene is. named: nodes, the worst first. compared: the shown log's
    name with no difference, and those of others with theirs; or nothing. view: of VIEWS, what is in front."""
    beside = tuple(label.text for label, _ in compared[1:]) if scenario.position_states else ()
    few = header.estimators <= DRAWN_NODES
    if header.navigation:
        front = navigation_blueprint.front(header, scenario, first, beside)
    elif header.tracking:
        front = tracking_blueprint.front(header, scenario, first, beside, few=few)
    else:
        front = {"overview": _overview(header, scenario, first, few=few)}
    if header.monitor:
        front["integrity"] = integrity_blueprint.tab(header, first)
    if agreement.applies(header):
        front["consensus"] = consensus_blueprint.tab(header, scenario, first)
    if compared:
        front["compare"] = compare_blueprint.tab(header, compared[0][0], compared[1:])
        view = view or "compare"
    if view is not None and view not in front:
        raise LogError(f"the log has nothing for the view {view}; it has {', '.join(front)}")
    tabs = [*front.values(), *_details(header, scenario, first, few=few)]
    return rrb.Blueprint(
        rrb.Tabs(*tabs, active_tab=list(front).index(view) if view else 0),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        # Opened at the last step: trail, colours and values are then all there.
        rrb.TimePanel(state="collapsed", timeline=seconds_timeline(header), play_state="following"),
        auto_layout=False,
        auto_views=False,
    )


def _details(header: Header, scenario: Scenario, first: Batch, *, few: bool) -> list:
    """Tabs behind the views, for a closer look."""
    if header.navigation:
        grid = _grid_tab(navigation_blueprint.consistency(header, first), "Consistency and losses")
        return [*navigation_blueprint.details(scenario, first), grid]
    tabs = [
        _grid_tab(_consistency(header, first), "Consistency and losses"),
        _grid_tab(views.states(header, has_truth=first.truth is not None, few=few), "States"),
    ]
    if header.nodes <= DRAWN_NODES:
        name = "Measurements of each node, in the units of the model"
        tabs.append(views.series("measurement", name, ["$origin/**"]))
    return tabs


def _overview(header: Header, scenario: Scenario, first: Batch, *, few: bool) -> rrb.Horizontal:
    has_truth = first.error is not None
    legend = 1 < header.estimators <= views.LEGEND_NODES
    every = "of the centre" if header.central else "of each node" if few else "over the network"
    if has_truth:
        name = f"Error {every}, dB" + (" (white: RMS over the network)" if header.estimators > 1 and few else "")
        plots = [plot(header, "error_db", name, summary="rms", legend=legend or not few)]
    else:
        name = f"Test quantity {every}, 1 = as expected (no truth, so no error)"
        plots = [plot(header, "nis_ratio", name, summary="pooled", legend=legend or not few)]
    plots += [
        plot(header, "theta", f"Risk sensitivity theta {every}"),
        plot(header, "tolerance", f"Tolerance c {every}, nats", axis=_tolerance_axis(first)),
    ]
    colour = "error" if has_truth else "test quantity"
    pictures = [rrb.GraphView(origin="network", name=f"Network, colour: {colour} from blue (small) to red (large), range in the summary")]
    if scenario.position_states:
        name = "Position, m: " + ("truth (white), " if first.truth is not None else "") + "estimates (coloured), sensors (grey)"
        pictures.insert(0, views.scene(scenario, first, name, few=few))
    else:
        pictures.insert(0, rrb.Tabs(*views.states(header, has_truth=first.truth is not None, few=few), active_tab=0))
    text = rrb.Vertical(
        rrb.TextDocumentView(origin="summary", name="Summary"),
        views.text_log("faults", "Faults"),
        row_shares=[4, 1],
    )
    return rrb.Horizontal(
        rrb.Vertical(*plots, row_shares=[4, 3, 3]),
        rrb.Vertical(*pictures),
        text,
        column_shares=[5, 5, 4],
        name="Overview",
    )


def _tolerance_axis(first: Batch) -> rrb.ScalarAxis | None:
    """The viewer draws a lone constant on an axis from -1 to 1, where a tolerance looks like nothing."""
    low, high = float(first.tolerance.min()), float(first.tolerance.max())
    return rrb.ScalarAxis(range=(0.0, 1.5 * high)) if 0.0 < low == high < float("inf") else None


def _consistency(header: Header, first: Batch) -> list[rrb.View]:
    several = header.estimators > 1
    name = "Test quantity: squared normalised innovation / degrees of freedom, 1 = as expected"
    together = " (white: all nodes together)" if several else ""
    plots = [
        plot(header, "nis_ratio", name, summary="pooled"),
        plot(header, "trace_covariance", "Trace of the covariance " + ("P" if header.tracking else "V")),
        plot(header, "missing_measurements", "Missing measurements" + together, summary="total"),
    ]
    if header.filter == "rekfd":
        plots += [plot(header, "theta", "Risk sensitivity theta"), plot(header, "tolerance", "Tolerance c, nats", axis=_tolerance_axis(first))]
    if not header.central:
        what = "messages" if header.tracking else "estimates"
        plots.append(plot(header, f"missing_{what}", f"Missing {what}" + together, summary="total"))
    return plots


def _grid_tab(views: list[rrb.View], name: str) -> rrb.Grid:
    return rrb.Grid(*views, name=name, grid_columns=1 if len(views) <= 2 else 2 if len(views) <= 6 else 3)
