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
from ..numbers.survey import DRAWN_NODES, Survey
from ..recording import colours
from ..recording.series import seconds_timeline
from . import VIEWS
from . import compare as compare_blueprint
from . import consensus as consensus_blueprint
from . import integrity as integrity_blueprint
from . import navigation as navigation_blueprint
from . import node as node_blueprint
from . import parts as views
from . import tracking as tracking_blueprint
from .parts import Shown

PLAIN = ("kfc", "kfd")  # without theta and tolerance


def blueprint(
    header: Header,
    scenario: Scenario,
    first: Batch,
    found: Survey,
    named: Sequence[int],
    compared: Sequence[tuple[Label, Difference | None]] = (),
    view: str | None = None,
) -> rrb.Blueprint:
    """`first` is the first batch: it tells whether there is a truth, and where the scene is. named: nodes, the worst first. compared: the shown log's
    name with no difference, and those of others with theirs; or nothing. view: of VIEWS, what is in front; None: the comparison if there is one, else
    the overview."""
    shown = Shown(header, scenario, first, found, tuple(named), tuple(label.text for label, _ in compared[1:]))
    tabs = views_of(shown, compared)
    if view is not None and view not in tabs:
        raise LogError(f"the log has nothing for the view {view}; it has {', '.join(tabs)}")
    active = view or ("compare" if compared and "compare" in tabs else "overview")
    return rrb.Blueprint(
        rrb.Tabs(*tabs.values(), *_details(shown), active_tab=list(tabs).index(active)),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        # Opened at the last step: trail, colours and values are then all there.
        rrb.TimePanel(state="collapsed", timeline=seconds_timeline(header), play_state="following"),
        auto_layout=False,
        auto_views=False,
    )


def views_of(shown: Shown, compared: Sequence[tuple[Label, Difference | None]] = ()) -> dict[str, rrb.Container]:
    """Tabs by names of VIEWS, in their order, those that this log has something for. compared: as for `blueprint`."""
    header, scenario, first = shown.header, shown.scenario, shown.first
    if header.navigation:
        tabs = navigation_blueprint.front(header, scenario, first, shown.compared)
    elif header.tracking:
        tabs = {"overview": tracking_blueprint.overview(shown)}
    else:
        tabs = {"overview": _overview(shown)}
    tabs["node"] = navigation_blueprint.node(first) if header.navigation else node_blueprint.tab(header, scenario, first, shown.found, shown.named)
    if compared:
        tabs["compare"] = compare_blueprint.tab(header, compared[0][0], compared[1:])
    if agreement.applies(header):
        tabs["consensus"] = consensus_blueprint.tab(header, scenario, first)
    tabs.setdefault("summary", views.words("Summary"))
    if header.monitor:
        tabs["integrity"] = integrity_blueprint.tab(header, first)
    return {name: tabs[name] for name in VIEWS if name in tabs}


def _details(shown: Shown) -> list:
    """Tabs behind the views, for a closer look."""
    header, scenario, first = shown.header, shown.scenario, shown.first
    if header.navigation:
        grid = _grid_tab(navigation_blueprint.consistency(header, first), "Consistency and losses")
        return [*navigation_blueprint.details(scenario, first), grid]
    few = header.estimators <= DRAWN_NODES
    tabs = [
        _grid_tab(_consistency(shown), "Consistency and losses"),
        _grid_tab(views.states(header, has_truth=first.truth is not None, few=few), "States"),
    ]
    if header.nodes <= DRAWN_NODES:
        name = "Measurements of each node, in the units of the model"
        tabs.append(views.series("measurement", name, ["$origin/**"]))
    return tabs


def _overview(shown: Shown) -> rrb.Horizontal:
    header, scenario, first = shown.header, shown.scenario, shown.first
    has_truth = first.error is not None
    if has_truth:
        others = "".join(f", {colours.compared(i)[0]}: {label}" for i, label in enumerate(shown.compared))
        extra = ("$origin/compared/**",) if shown.compared else ()
        plots = [shown.plot("error_db", "Error{each}, dB" + others, summary="rms", extra=extra)]
    else:
        plots = [shown.plot("nis_ratio", "Test quantity{each}, 1 = as expected (no truth, so no error)", summary="pooled")]
    if header.filter in PLAIN:
        if has_truth:
            plots.append(shown.plot("nis_ratio", "Test quantity{each}, 1 = as expected", summary="pooled", legend=False, named=()))
        what = "measurements" if header.central else "estimates"
        plots.append(views.series(f"missing_{what}", f"Missing {what} in a step, whole network", ["$origin/network/total"]))
    else:
        plots.append(shown.plot("theta", "Risk sensitivity theta{each}", legend=False))
        plots.append(shown.plot("tolerance", "Tolerance c{each}, nats", axis=_tolerance_axis(first), legend=False))
    pictures = [views.network(header, scenario, has_truth=has_truth)] if header.nodes > 1 else []
    if scenario.position_states:
        name = "Position, m: " + ("truth (white), " if first.truth is not None else "") + "estimates, sensors"
        pictures.append(views.scene(scenario, first, name))
    if not scenario.position_states or header.nodes == 1:
        few = header.estimators <= DRAWN_NODES
        pictures.append(rrb.Tabs(*views.states(header, has_truth=first.truth is not None, few=few), active_tab=0, name="States"))
    return rrb.Horizontal(
        rrb.Vertical(*plots, row_shares=[5, 3, 3][: len(plots)]), rrb.Vertical(*pictures), views.words(), column_shares=[5, 5, 4], name="Overview"
    )


def _tolerance_axis(first: Batch) -> rrb.ScalarAxis | None:
    """The viewer draws a lone constant on an axis from -1 to 1, where a tolerance looks like nothing."""
    low, high = float(first.tolerance.min()), float(first.tolerance.max())
    return rrb.ScalarAxis(range=(0.0, 1.5 * high)) if 0.0 < low == high < float("inf") else None


def _consistency(shown: Shown) -> list[rrb.View]:
    header = shown.header
    plots = [
        shown.plot("nis_ratio", "Test quantity{each}: squared normalised innovation / degrees of freedom, 1 = as expected", summary="pooled"),
        shown.plot("trace_covariance", "Trace of the covariance " + ("P" if header.tracking else "V") + "{each}"),
        shown.losses("missing_measurements", "Missing measurements{each}"),
    ]
    if header.filter == "rekfd":
        plots.append(shown.plot("theta", "Risk sensitivity theta{each}"))
        plots.append(shown.plot("tolerance", "Tolerance c{each}, nats", axis=_tolerance_axis(shown.first)))
    if not header.central:
        what = "messages" if header.tracking else "estimates"
        plots.append(shown.losses(f"missing_{what}", f"Missing {what}" + "{each}"))
    return plots


def _grid_tab(views: list[rrb.View], name: str) -> rrb.Grid:
    return rrb.Grid(*views, name=name, grid_columns=1 if len(views) <= 2 else 2 if len(views) <= 6 else 3)
