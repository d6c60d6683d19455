# SPDX-License-Identifier: MIT
"""What the viewer shows of logs that are compared: errors and their differences left, which node is better when in the middle, the result right."""

from collections.abc import Sequence

import rerun.blueprint as rrb

from meshkal_log.fields import Header
from meshkal_log.together import Label
from ..numbers.difference import Difference
from ..recording.difference_map import picture
from .parts import series


def tab(header: Header, shown: Label, compared: Sequence[tuple[Label, Difference]]) -> rrb.Horizontal:
    metres = compared[0][1].metres
    has_error = any(found.judged for _, found in compared)
    unit = "dB of 1 m" if metres else "dB"
    left: list = []
    if has_error:
        left.append(series("compare/rms", f"{'Position error' if metres else 'Error'}, RMS over the nodes, {unit}", ["$origin/**"], legend=True))
        left.append(_tabs([_difference(shown, *other) for other in compared if other[1].judged]))
    runs = "; the truths differ, so this says nothing" if any(found.same_truth is False for _, found in compared) else ""
    left.append(series("compare/distance", f"RMS distance of the estimates, {unit}; a gap: 0{runs}", ["$origin/**"], legend=True))
    pictures = [_pictures(shown, *other) for other in compared if other[1].map_db.size]
    columns = [rrb.Vertical(*left, row_shares=[3, 4, 3][: len(left)])]
    columns += [_tabs(pictures)] if pictures else []
    columns.append(rrb.TextDocumentView(origin="compare/summary", name="Comparison"))
    return rrb.Horizontal(*columns, column_shares=[5, 5, 4][-len(columns) :] if len(columns) < 3 else [5, 5, 4], name="Compare")


def _tabs(views: list):
    return views[0] if len(views) == 1 else rrb.Tabs(*views, active_tab=0)


def _difference(shown: Label, other: Label, found: Difference) -> rrb.View:
    several = len(found.pairing) > 1
    lines = ", white: median of the nodes, grey: 5 and 95 % of them" if several else ""
    name = f"{shown.text} less {other.text}, dB: below 0 {shown.text} is better{lines}"
    return series(f"compare/{other.key}/difference", name, ["$origin/**"], legend=True, axis=_axis(found))


def _axis(found: Difference) -> rrb.ScalarAxis | None:
    """What nearly all steps need; the view zooms out to the rest."""
    if found.band_db is None:
        return None
    low, high = min(found.band_db[0], 0.0), max(found.band_db[1], 0.0)
    room = 0.2 * (high - low)
    return rrb.ScalarAxis(range=(low - room, high + room)) if room > 0.0 else None


def _pictures(shown: Label, other: Label, found: Difference) -> rrb.View | rrb.Vertical:
    made = picture(found.map_db, found.pairing.nodes, found.map_s)
    height, width = made.ids.shape
    bounds = rrb.VisualBounds2D(x_range=(-0.1 * width, 1.12 * width), y_range=(-0.06 * height, 1.14 * height))
    name = f"Difference by node (down) and time (right): blue {shown.text} better, orange {other.text} better, hover for dB"
    image = rrb.Spatial2DView(origin=f"compare/{other.key}/map", name=name, visual_bounds=bounds, background=[13, 16, 17])
    if len(found.pairing) < 2:
        return image
    title = f"Mean difference by node number, dB: below 0 {shown.text} better, above 0 {other.text} better"
    bars = rrb.BarChartView(origin=f"compare/{other.key}/nodes", name=title, plot_legend=rrb.PlotLegend(visible=False))
    return rrb.Vertical(image, bars, row_shares=[3, 2], name=f"against {other.text}")
