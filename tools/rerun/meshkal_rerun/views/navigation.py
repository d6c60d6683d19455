# SPDX-License-Identifier: MIT
"""What the viewer shows of a navigation log: the sky and what the monitor says left, statistics, weights and errors right."""

import rerun.blueprint as rrb

from meshkal_log.fields import Batch, Header
from meshkal_log.scenario import Scenario
from ..numbers import tracking as numbers
from ..numbers.navigation import GROUPS
from ..recording import colours
from ..recording.navigation import SIGMAS
from ..recording.sky import EXTENT
from . import integrity as integrity_blueprint
from . import parts as views
from .parts import LEGEND_NODES, plot, series, text_log


def front(header: Header, scenario: Scenario, first: Batch, compared: tuple[str, ...]) -> dict:
    """The tabs that come first, by the name of the view."""
    return {"overview": _overview(header, first, compared), "summary": _summary(header)}


def details(scenario: Scenario, first: Batch) -> list:
    name = "Position, m: " + ("truth (white), " if first.truth is not None else "") + "estimate (blue)"
    flight = rrb.Vertical(views.scene(scenario, first, name), name="Flight")
    return [flight]


def node(first: Batch) -> rrb.Grid:
    """The states of the one estimator, in the place of the view of single nodes."""
    return rrb.Grid(*_states(first), name="Navigation", grid_columns=3)


def consistency(header: Header, first: Batch) -> list[rrb.View]:
    plots = [plot(header, "nis_ratio", "Test quantity: squared normalised innovation / degrees of freedom, 1 = as expected", axis=_axis(3.0))]
    if first.nees is not None:
        plots.append(_nees(header))
    if first.weight_statistic is not None:
        name = "Standardised statistic of each reading, which its weight comes from"
        plots.append(series("weight_statistic", name, ["$origin/**"], legend=header.nodes <= LEGEND_NODES))
    return [*plots, plot(header, "missing_measurements", "Satellites without a reading")]


def _overview(header: Header, first: Batch, compared: tuple[str, ...]) -> rrb.Horizontal:
    held = ", ring and cross: held faulty" if header.monitor else ""
    weight = "blue: full weight, red: none" if first.weight is not None else "blue: used"
    bounds = rrb.VisualBounds2D(x_range=(-EXTENT, EXTENT), y_range=(-EXTENT, EXTENT))
    left = [rrb.Spatial2DView(origin="sky", name=f"Sky, elevation in degrees; {weight}{held}", visual_bounds=bounds, background=views.BACKGROUND)]
    shares = [7.0]
    if header.monitor:
        left.append(integrity_blueprint.lanes(header))
        shares.append(0.6 * integrity_blueprint.lane_count(header) + 0.3)
    elif first.fault is not None:
        left.append(integrity_blueprint.lanes(header))
        shares.append(1.6)
    plots = _plots(header, first, compared)
    # Stripes need more room than lines do.
    heights = [1.45 if view.origin == "weight_map" else 1.0 for view in plots]
    return rrb.Horizontal(
        rrb.Vertical(*left, row_shares=shares), rrb.Vertical(*plots, row_shares=heights), column_shares=[5, 6], name="Overview"
    )


def _plots(header: Header, first: Batch, compared: tuple[str, ...]) -> list[rrb.View]:
    out = []
    if header.monitor:
        out.append(integrity_blueprint.both_ratios(header))
    if first.weight is not None:
        out.append(integrity_blueprint.weight_map(header))
    if header.monitor:
        out += integrity_blueprint.ends(header)[:1] or [integrity_blueprint.isolation(header)]
    if first.innovation is not None:
        out.append(series("innovation", "Innovation of each satellite, m", ["$origin/**"], legend=header.nodes <= LEGEND_NODES, corner=rrb.Corner2D.LeftTop))
    if first.truth is not None:
        if compared:
            others = "".join(f", {colours.compared(i)[0]}: {label}" for i, label in enumerate(compared))
            out.append(plot(header, "position_error", f"Position error, m, blue: {header.filter}{others}", extra=("$origin/compared/**",)))
        else:
            out.append(series("navigation/error/position", "Position error, m", ["$origin/**"], legend=True))
    return out


def _summary(header: Header) -> rrb.Horizontal:
    return rrb.Horizontal(
        rrb.TextDocumentView(origin="summary", name="Summary"),
        text_log("/", "Events", ["/events/**", "/integrity_events/**"]),
        column_shares=[5, 4],
        name="Summary",
    )


def _states(first: Batch) -> list[rrb.View]:
    """Errors where there is a truth, else the estimates; of the position each component with what the filter holds of it."""
    what, said = ("error", " error") if first.truth is not None else ("estimate", "")
    out = []
    for axis in GROUPS[2].labels:
        contents = [f"/navigation/error/position/{axis}"] if first.truth is not None else []
        name = f"Position{said} {axis}, m" if contents else f"Uncertainty of the position {axis}, m"
        out.append(series("navigation", f"{name}, and {SIGMAS:g} sigma", [*contents, f"/navigation/sigma/{axis}/**"]))
    for group in GROUPS:
        if group.key != "position":
            name = f"{group.name}{said}, {group.unit}"
            out.append(series(f"navigation/{what}/{group.key}", name, ["$origin/**"], legend=len(group.labels) > 1))
    return out


def _nees(header: Header) -> rrb.View:
    low, high = numbers.nees_band(header.states)
    name = f"NEES; an exact filter: {header.states}, in 95 of 100 epochs from {low:.2f} to {high:.2f}"
    return plot(header, "nees", name, axis=_axis(3.0 * header.states), extra=("$origin/band/**",))


def _axis(high: float) -> rrb.ScalarAxis:
    return rrb.ScalarAxis(range=(0.0, high))
