# SPDX-License-Identifier: MIT
"""What the viewer shows of how far the nodes of a distributed filter agree: distances left, error and exchange in the middle, the result right."""

import rerun.blueprint as rrb

from meshkal_log.fields import Batch, Header
from meshkal_log.scenario import Scenario
from ..numbers.agreement import agreement
from .parts import axis_of_most, series


def tab(header: Header, scenario: Scenario, first: Batch) -> rrb.Horizontal:
    unit = ", m" if scenario.position_states else ""
    what = "position" if scenario.position_states else "estimate"
    begun = agreement(first, scenario)
    name = f"Distance of a node's {what} from the mean of all{unit}"
    left = [series("agreement/distance", name, ["$origin/**"], legend=True, axis=axis_of_most(begun.largest))]
    if first.disagreement is not None:
        left.append(series("disagreement", "Disagreement: largest distance of two estimates, m", ["$origin/positions"]))
    if first.consensus_disagreement is not None and header.iterations:
        left.append(consensus(header))
    beside, middle = len(left) > 1, []
    if first.truth is not None:
        name = f"Agreement is not correctness: error of the nodes and of their mean{unit}"
        middle.append(series("agreement/error", name, ["$origin/**"], legend=True, axis=axis_of_most(begun.node_error)))
    if any(len(slots) > 1 for slots in header.slots):
        arrived = rrb.ScalarAxis(range=(-3.0, 103.0))
        messages = series("agreement/arrived", "Messages of neighbours that arrived, %", ["$origin/**"], legend=True, axis=arrived)
        (middle if beside else left).append(messages)
        name = f"RMS distance of two nodes{unit}, by the number of links between them"
        middle.append(rrb.BarChartView(origin="agreement/over_graph", name=name, plot_legend=rrb.PlotLegend(visible=False)))
    columns = [rrb.Vertical(*left, row_shares=[5, 3, 3][: len(left)])]
    columns += [rrb.Vertical(*middle)] if middle else []
    columns.append(rrb.TextDocumentView(origin="agreement/summary", name="Agreement"))
    return rrb.Horizontal(*columns, column_shares=[5] * (len(columns) - 1) + [4], name="Consensus")


def consensus(header: Header) -> rrb.View:
    """Of duif, over its iterations."""
    name = f"Consensus: distance from the mean, dB; red: before, blue: after {header.iterations} iterations"
    return series("consensus", name, ["$origin/**"])
