# SPDX-License-Identifier: MIT
"""Views that the screens of all kinds of logs have in common."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import rerun.blueprint as rrb
from rerun.blueprint.encodings import TextLogColumn

from meshkal_log.fields import Batch, Header
from meshkal_log.scenario import Scenario
from ..numbers.comparison import in_metres
from ..numbers.derive import QUANTILES
from ..numbers.survey import ALL_NAMED, Survey
from ..recording.network import bounds
from ..recording.scene import viewpoint

LEGEND_NODES = 8
BACKGROUND = [13, 13, 13]
_STATE_PLOTS = 9
_LOG_COLUMNS = [TextLogColumn("loglevel", visible=True), TextLogColumn("body", visible=True)]
# A viewer that follows the end would otherwise show the last part of a long run only. Numbers instead of infinity would be
# nanoseconds for one timeline and steps for the other.
TIME_AXIS = rrb.TimeAxis(view_range=rrb.TimeRange(start=rrb.TimeRangeBoundary.infinite(), end=rrb.TimeRangeBoundary.infinite()))


@dataclass(frozen=True)
class Shown:
    """What the tabs are made for."""

    header: Header
    scenario: Scenario
    first: Batch  # the first batch
    found: Survey
    named: tuple[int, ...]  # nodes, the worst first
    compared: tuple[str, ...] = ()  # names of other logs

    @property
    def few(self) -> bool:
        """Whether each node is drawn, not only the network and the nodes that are named."""
        return self.header.estimators <= ALL_NAMED

    def plot(self, quantity: str, name: str, **options: object) -> rrb.TimeSeriesView:
        """As the function of that name; {each} in the name is whose lines they are."""
        return plot(self.header, quantity, name.replace("{each}", self._each), **({"named": self.named} | options))

    def losses(self, quantity: str, name: str) -> rrb.TimeSeriesView:
        """Counts, of which only a total sums up the network."""
        if self.few:
            return self.plot(quantity, name, summary="total")
        nodes = [f"$origin/node/{k}" for k in self.named if k in self.header.estimator_nodes]
        return series(quantity, name.replace("{each}", ", all nodes together and the named ones"), ["$origin/network/total", *nodes], legend=True)

    @property
    def _each(self) -> str:
        if self.header.central:
            return " of the centre"
        if self.header.estimators == 1:
            return " of the node"
        return " of each node" if self.few else " over the network"


def words(name: str | None = None) -> rrb.Container:
    """The text of the summary, and below, as a tab with a name beside it, what happened."""
    events = text_log("/", "Events", ["/events/**", "/faults/**", "/rejections/**", "/integrity_events/**"])
    parts = [rrb.TextDocumentView(origin="summary", name="Summary"), events]
    return rrb.Horizontal(*parts, column_shares=[5, 4], name=name) if name else rrb.Vertical(*parts, row_shares=[4, 1])


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


def axis_of_most(values: np.ndarray, least: float = 0.0) -> rrb.ScalarAxis | None:
    """From 0 to what nearly all values reach: one outlier or the start would otherwise press the rest flat. The view zooms out to them."""
    known = values[np.isfinite(values) & (values > 0)]
    if not len(known):
        return None
    return rrb.ScalarAxis(range=(0.0, max(least, min(1.05 * float(known.max()), 1.5 * float(np.percentile(known, 97))))))


def plot(
    header: Header,
    quantity: str,
    name: str,
    *,
    named: Sequence[int] = (),
    summary: str | None = None,
    legend: bool | None = None,
    axis: rrb.ScalarAxis | None = None,
    extra: tuple[str, ...] = (),
) -> rrb.TimeSeriesView:
    """Of few nodes each with one summary of the network; of more the median, the band that holds most of them, the summary, and those that
    are named; and `extra`."""
    if header.estimators <= ALL_NAMED:
        contents = ["$origin/node/**", "$origin/centre"]
    else:
        contents = [f"$origin/network/{part}" for part in ("band", *QUANTILES)] + [f"$origin/node/{k}" for k in named if k in header.estimator_nodes]
    if summary and header.estimators > 1:
        contents.append(f"$origin/network/{summary}")
    if quantity == "nis_ratio":
        contents.append("$origin/expected")
    return series(quantity, name, [*contents, *extra], legend=header.estimators > 1 if legend is None else legend, axis=axis)


def network(header: Header, scenario: Scenario, *, has_truth: bool) -> rrb.Spatial2DView:
    what = "test quantity, dB" if not has_truth else "position error" if in_metres(header, scenario) else "error, dB"
    name = f"Network: {what}; dashed: {'no reading' if header.central else 'nothing'} arrived"
    x, y = bounds(header, scenario)
    return rrb.Spatial2DView(origin="network", name=name, visual_bounds=rrb.VisualBounds2D(x_range=x, y_range=y), background=BACKGROUND)


def states(header: Header, *, has_truth: bool, few: bool) -> list[rrb.View]:
    plots = []
    for i in range(min(header.states, _STATE_PLOTS)):
        wanted = ["$origin/estimates"] if few else ["$origin/network/**"]
        if has_truth:
            wanted.append("$origin/truth")
        plots.append(series(f"state/{i}", f"State {i}" + (" (white: truth)" if has_truth else ""), wanted, legend=not few))
    return plots


def scene(scenario: Scenario, first: Batch, name: str) -> rrb.Spatial3DView:
    eye, target = viewpoint(scenario, first)
    camera = rrb.EyeControls3D(position=eye, look_target=target, eye_up=(0.0, 0.0, 1.0))
    return rrb.Spatial3DView(origin="scene", name=name, eye_controls=camera)


def text_log(origin: str, name: str, contents: Sequence[str] = ("$origin/**",)) -> rrb.TextLogView:
    return rrb.TextLogView(origin=origin, contents=list(contents), name=name, columns=rrb.TextLogColumns(text_log_columns=_LOG_COLUMNS))
