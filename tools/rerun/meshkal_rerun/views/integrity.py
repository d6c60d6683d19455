# SPDX-License-Identifier: MIT
"""What the viewer shows of integrity monitors and weights."""

import rerun.blueprint as rrb

from meshkal_log.fields import Batch, Header
from ..numbers.integrity import STATISTICS, tested
from ..numbers.tracking import Slots
from ..recording.integrity import DRAWN_ESTIMATORS, DRAWN_SLOTS, LANES
from .parts import LEGEND_NODES, TIME_AXIS, series, text_log

# What is far above its threshold says no more than what is just above.
_RATIO_AXIS = rrb.ScalarAxis(range=(0.0, 2.2))


def tab(header: Header, first: Batch) -> rrb.Horizontal:
    """Of a log with a monitor."""
    words = text_log("integrity_events", "Alarms and faults")
    right = [ratio(header, "rctm" if tested(header) == "aime" else "aime")]
    if header.estimators <= DRAWN_ESTIMATORS:
        right.append(statistic(header))
    left = [ratio(header, tested(header)), *ends(header), isolation(header)]
    if first.weight is not None:
        right.append(weight_map(header) if header.central and header.nodes <= DRAWN_SLOTS else weights(header))
    if first.fault is not None:
        right.append(series("fault", "Injected fault of each sensor, unit of its reading", ["$origin/**"], legend=True))
    return rrb.Horizontal(
        rrb.Vertical(*left),
        rrb.Vertical(*right),
        rrb.Vertical(lanes(header), words, row_shares=[3, 2]),
        column_shares=[5, 5, 4],
        name="Integrity",
    )


def lanes(header: Header) -> rrb.StateTimelineView:
    parts = [("Alarms", header.monitor), ("sensors held faulty", header.monitor == "exclude"), ("injected faults", True)]
    return rrb.StateTimelineView(origin="integrity", name=", ".join(name for name, there in parts if there), time_view=TIME_AXIS)


def lane_count(header: Header) -> int:
    """As many as one usually sees: a fault, who is held for it, and the alarms."""
    return 3 if header.estimators > LANES else 2 + header.estimators


def ratio(header: Header, key: str) -> rrb.TimeSeriesView:
    of, drawn = "", [f"$origin/{key}/**"]
    if header.estimators > DRAWN_ESTIMATORS:
        of, drawn = ": median (blue), 10 to 90 % of nodes (grey), largest (red)", [f"$origin/{key}/network/**"]
    elif header.estimators > 1:
        of, drawn = " of each node (blue: median)", [*drawn, f"- $origin/{key}/network/**", f"$origin/{key}/network/median"]
    said = ""
    if key == tested(header) and header.estimators <= DRAWN_ESTIMATORS:
        drawn += ["$origin/alarm/**", "$origin/ended/**"]
        said = "; cross: alarm" + ("; diamond: fault declared over" if header.monitor in ("aime-improved", "exclude") else "")
    name = f"{STATISTICS[key]} / threshold{of}{said}"
    return series("monitor_ratio", name, [*drawn, "$origin/threshold"], axis=_RATIO_AXIS)


def both_ratios(header: Header) -> rrb.TimeSeriesView:
    """Of one estimator."""
    name = "Test statistic / threshold, alarm from 1 on: blue AIME, sand RCTM; cross: alarm; diamond: fault declared over"
    contents = ["$origin/aime/**", "$origin/rctm/**", "$origin/threshold", "$origin/alarm/**", "$origin/ended/**"]
    return series("monitor_ratio", name, contents, axis=_RATIO_AXIS)


def statistic(header: Header) -> rrb.TimeSeriesView:
    if header.estimators > 1:
        contents = [f"$origin/{tested(header)}/**"]
        return series("monitor_statistic", f"{STATISTICS[tested(header)]} of each node, as in the log", contents)
    return series("monitor_statistic", "Statistics and threshold of the tested one, as in the log", ["$origin/**"], legend=True)


def ends(header: Header) -> list[rrb.View]:
    if header.monitor == "exclude":
        name = f"Evidence that the fault is over{_each(header)}, decision at 1"
        return [series("end_ratio", name, ["$origin/**"], legend=header.nodes <= LEGEND_NODES, axis=rrb.ScalarAxis(range=(-0.05, 1.2)))]
    if header.monitor == "aime-improved":
        if header.estimators == 1:
            return [series("monitor_rho", "rho (blue), its median (sand), limit (white): above it the fault is over", ["$origin/**"])]
        contents = ["$origin/rho/**"] if header.estimators <= DRAWN_ESTIMATORS else ["$origin/rho/network/**"]
        return [series("monitor_rho", "rho of each node: the fault is over where it jumps above its median", contents)]
    return []


def isolation(header: Header) -> rrb.TimeSeriesView:
    name = f"w: what leaving a sensor out takes from AIME{_each(header)}"
    return series("isolation", name, ["$origin/**"], legend=header.nodes <= LEGEND_NODES)


def weights(header: Header) -> rrb.TimeSeriesView:
    name = f"Weight of each reading{_each(header)}: 1 used as it is, 0 not at all"
    return series("weight", name, ["$origin/**"], legend=header.nodes <= LEGEND_NODES, axis=rrb.ScalarAxis(range=(-0.05, 1.05)))


def weight_map(header: Header) -> rrb.TimeSeriesView:
    """Of a centre with not too many sensors."""
    numbers = [header.sensor_number(k) for k in range(header.nodes)]
    name = "Weight of each reading, by the number of its sensor; blue: full, red: none"
    return series("weight_map", name, ["$origin/**"], axis=rrb.ScalarAxis(range=(min(numbers) - 0.8, max(numbers) + 0.8)))


def _each(header: Header) -> str:
    slots = len(Slots(header).at)
    return "" if slots <= DRAWN_SLOTS else ", the worst of each sensor" if header.nodes <= DRAWN_SLOTS else ", the worst of all"
