# SPDX-License-Identifier: MIT
"""Views that the screens of all kinds of logs have in common."""

import rerun.blueprint as rrb
from rerun.blueprint.encodings import TextLogColumn

from meshkal_log.fields import Batch, Header
from meshkal_log.scenario import Scenario
from ..recording.scene import ELLIPSOIDS, viewpoint

# The viewer draws a hundred lines in a plot at ease, and a thousand not.
DRAWN_NODES = 100
LEGEND_NODES = 8
_STATE_PLOTS = 9
_LOG_COLUMNS = [TextLogColumn("loglevel", visible=True), TextLogColumn("body", visible=True)]
# A viewer that follows the end would otherwise show the last part of a long run only. Numbers instead of infinity would be
# nanoseconds for one timeline and steps for the other.
TIME_AXIS = rrb.TimeAxis(view_range=rrb.TimeRange(start=rrb.TimeRangeBoundary.infinite(), end=rrb.TimeRangeBoundary.infinite()))


def series(
    origin: str,
    name: str,
    contents: list[str],
    *,
    legend: bool = False,
    axis: rrb.ScalarAxis | None = None,
    corner: rrb.Corner2D = rrb.Corner2D.RightTop,
) -> rrb.TimeSeriesView:
    labels = rrb.PlotLegend(corner, visible=legend)
    return rrb.TimeSeriesView(origin=origin, contents=contents, name=name, plot_legend=labels, axis_x=TIME_AXIS, axis_y=axis)


def plot(
    header: Header,
    quantity: str,
    name: str,
    *,
    summary: str | None = None,
    legend: bool | None = None,
    axis: rrb.ScalarAxis | None = None,
    extra: tuple[str, ...] = (),
) -> rrb.TimeSeriesView:
    """All estimators with one summary of the network, or only summaries if they are too many; and `extra`."""
    few = header.estimators <= DRAWN_NODES
    contents = ["$origin/node/**", "$origin/centre"] if few else ["$origin/network/**"]
    if few and summary and header.estimators > 1:
        contents.append(f"$origin/network/{summary}")
    if quantity == "nis_ratio":
        contents.append("$origin/expected")
    return series(quantity, name, [*contents, *extra], legend=not few if legend is None else legend, axis=axis)


def states(header: Header, *, has_truth: bool, few: bool) -> list[rrb.View]:
    plots = []
    for i in range(min(header.states, _STATE_PLOTS)):
        wanted = ["$origin/estimates"] if few else ["$origin/network/**"]
        if has_truth:
            wanted.append("$origin/truth")
        plots.append(series(f"state/{i}", f"State {i}" + (" (white: truth)" if has_truth else ""), wanted, legend=not few))
    return plots


def scene(scenario: Scenario, first: Batch, name: str, *, few: bool) -> rrb.Spatial3DView:
    contents = ["$origin/**"] if few else ["$origin/**", f"- /{ELLIPSOIDS}"]
    eye, target = viewpoint(scenario, first)
    camera = rrb.EyeControls3D(position=eye, look_target=target, eye_up=(0.0, 0.0, 1.0))
    return rrb.Spatial3DView(origin="scene", contents=contents, name=name, eye_controls=camera)


def text_log(origin: str, name: str) -> rrb.TextLogView:
    return rrb.TextLogView(origin=origin, name=name, columns=rrb.TextLogColumns(text_log_columns=_LOG_COLUMNS))
