# SPDX-License-Identifier: MIT
"""What the viewer shows of logs that are compared: errors and their differences left, which node is better when in the middle, the result right."""

from collections.abc import Sequence

import numpy as np
import rerun.blueprint as rrb

from meshkal_log.fields import Header
from meshkal_log.together import Label
from ..numbers.difference import Difference
from ..recording.agreement import NAMED
from ..recording.difference_map import picture
from .parts import series


def tab(header: Header, shown: Label, compared: Sequence[tuple[Label, Difference]]) -> rrb.Horizontal:
    metres = compared[0][1].metres
    has_error = any(found.judged for _, found in compared)
    unit = "dB of 1 m" if metres else "dB"
    over = ", RMS over the nodes" if any(len(found.pairing) > 1 for _, found in compared) else ""
    left: list = []
    if has_error:
        left.append(series("compare/rms", f"{'Position error' if metres else 'Error'}{over}, {unit}", ["$origin/**"], legend=True))
        left.append(_tabs([_difference(shown, *other) for other in compared if other[1].judged]))
    # Estimates of different truths have nothing to do with each other.
    if any(found.same_truth is not False for _, found in compared):
        left.append(series("compare/distance", f"RMS distance of the estimates, {unit}; a gap: 0", ["$origin/**"], legend=True))
    pictures = [_pictures(shown, *other) for other in compared if len(other[1].map_db) > 1]
    columns = [rrb.Vertical(*left, row_shares=[3, 4, 3][: len(left)])]
    columns += [_tabs(pictures)] if pictures else []
    columns.append(rrb.TextDocumentView(origin="compare/summary", name="Comparison"))
    return rrb.Horizontal(*columns, column_shares=[5, 5, 4] if len(columns) > 2 else [8, 5], name="Compare")


def _tabs(views: list):
    return views[0] if len(views) == 1 else rrb.Tabs(*views, active_tab=0)


def _difference(shown: Label, other: Label, found: Difference) -> rrb.View:
    several = len(found.pairing) > 1
    name = f"{shown.text} less {other.text}, dB" + (", each node" if several else "") + f"; below 0: {shown.text} better"
    return series(f"compare/{other.key}/difference", name, ["$origin/**"], legend=True, axis=_axis(found))


def _axis(found: Difference) -> rrb.ScalarAxis | None:
    """What the band and the nodes with the largest differences need in nearly all steps; the view zooms out to the rest."""
    if found.band_db is None:
        return None
    nodes = found.map_db[[found.pairing.nodes.index(k) for k in found.striking(NAMED)]]
    nodes = nodes[np.isfinite(nodes)]
    low, high = found.band_db
    if len(nodes):
        low, high = min(low, float(np.percentile(nodes, 5))), max(high, float(np.percentile(nodes, 95)))
    low, high = min(low, 0.0), max(high, 0.0)
    room = 0.2 * (high - low)
    return rrb.ScalarAxis(range=(low - room, high + room)) if room > 0.0 else None


def _pictures(shown: Label, other: Label, found: Difference) -> rrb.View | rrb.Vertical:
    made = picture(found.map_db, found.pairing.nodes, found.map_s)
    height, width = made.ids.shape
    differs = found.equal < found.judged
    bounds = rrb.VisualBounds2D(x_range=(-0.12 * width, 1.13 * width), y_range=(-0.05 * height, 1.12 * height))
    name = f"Nodes over time, blue: {shown.text} better, orange: {other.text}; " + (f"scale to {made.reach_db:.3g} dB" if differs else "no difference")
    image = rrb.Spatial2DView(origin=f"compare/{other.key}/map", name=name, visual_bounds=bounds, background=[13, 16, 17])
    if not differs:
        return image
    title = f"Mean difference by node number, dB; above 0: {other.text} better"
    bars = rrb.BarChartView(origin=f"compare/{other.key}/nodes", name=title, plot_legend=rrb.PlotLegend(visible=False))
    return rrb.Vertical(image, bars, row_shares=[3, 2], name=f"against {other.text}")
