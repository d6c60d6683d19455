# SPDX-License-Identifier: MIT
"""One node, closely: left its states, right its story, what reached it, and what it says of itself."""

from collections.abc import Sequence

import numpy as np
import rerun.blueprint as rrb

from meshkal_log.fields import Batch, Header
from meshkal_log.scenario import Scenario
from ..numbers import nodes
from ..numbers.nodes import SIGMAS
from ..numbers.survey import Survey
from ..recording import events
from ..recording.node import NEIGHBOURS, ROWS, estimators, origin
from .parts import TIME_AXIS, series, text_log

_PLOTS = 3  # in a column
_RATIO_AXIS = rrb.ScalarAxis(range=(0.0, 2.2))


def tab(header: Header, scenario: Scenario, first: Batch, found: Survey, named: Sequence[int]) -> rrb.Container:
    """In front the node that the summary tells of: the one that went wrong, or else the worst."""
    shown = estimators(header, named)
    pages = [_page(header, scenario, first, found, e, _label(header, found, e)) for e in shown]
    wrong = found.moment.estimator if found.moment else None
    silent = [silence.estimator for silence, _ in found.departures.silences]
    front = next((e for e in ([wrong] if found.moment else silent) + list(found.rank) if e in shown), None)
    return rrb.Tabs(*pages, active_tab=shown.index(front) if shown else 0, name="Node")


def _label(header: Header, found: Survey, e: int) -> str:
    if header.central:
        return "Centre"
    departure = found.departures.worst(e)
    said = (["worst"] if header.estimators > 1 and found.steps and e == found.rank[0] else []) + ([] if departure is None else ["departs" if departure.of_error else "test quantity"])
    said += ["silence"] if any(silence.estimator == e for silence, _ in found.departures.silences) else []
    return f"{header.estimator_nodes[e]}" + (f" ({', '.join(said)})" if said else "")


def _page(header: Header, scenario: Scenario, first: Batch, found: Survey, e: int, label: str) -> rrb.Horizontal:
    at, path = origin(header, e), "centre" if header.central else f"node/{header.estimator_nodes[e]}"
    who = "centre" if header.central else f"node {header.estimator_nodes[e]}"
    right = [_against_network(header, first, at, path, who)]
    shares = [3.0]
    if first.innovation is not None:
        right.append(_innovations(header, first, e, at))
        shares.append(3.0)
    name = f"Test quantity of {who} over its 99.9 % limit (grey: 95 %)"
    right.append(series(f"{at}/test", name, ["$origin/**"], axis=_RATIO_AXIS))
    shares.append(2.4)
    if first.theta is not None:
        right[-1] = rrb.Tabs(right[-1], *_robustness(header, at, path, who), active_tab=0)
    lanes, more = _lanes(header, e, at, who)
    right += [lanes, _story(header, found, e, who)]
    shares += [more, 3.2]
    return rrb.Horizontal(_states(header, scenario, first, at, e), rrb.Vertical(*right, row_shares=shares), column_shares=[1, 1], name=label)


def _states(header: Header, scenario: Scenario, first: Batch, at: str, e: int) -> rrb.Tabs:
    """Errors of the positions in front, then of the other states, then the states themselves."""
    names, position = nodes.state_names(header, scenario), list(scenario.position_states or ())
    rest = [i for i in range(header.states) if i not in position]
    pages = [position] if position else []
    pages += [rest[i : i + _PLOTS] for i in range(0, len(rest), _PLOTS)]
    error = nodes.errors(first, e)
    variance = nodes.variances(first, header, scenario, e)
    tabs = []
    for some in pages if error is not None else []:
        plots = [series(at, f"Error of {names[i]}; band: {SIGMAS:g} sigma", [f"$origin/band/{i}", f"$origin/error/{i}"], axis=_error_axis(error[:, i], variance[:, i]))
                 for i in some]
        tabs.append(rrb.Vertical(*plots, name=f"Errors of {_page_name(some, position, scenario)}"))
    for some in pages:
        truth = "; white: truth" if error is not None else ""
        plots = [series(at, f"Estimate of {names[i]}; band: {SIGMAS:g} sigma{truth}", [f"$origin/estimate/{i}", f"/state/{i}/truth"]) for i in some]
        tabs.append(rrb.Vertical(*plots, name=_page_name(some, position, scenario).capitalize() if error is not None else "Estimates of " + _page_name(some, position, scenario)))
    return rrb.Tabs(*tabs, active_tab=0)


def _page_name(some: list[int], position: list[int], scenario: Scenario) -> str:
    if some == position:
        return "position"
    return ", ".join(scenario.states[i] for i in some) if scenario.states else "states " + ", ".join(map(str, some))


def _error_axis(error: np.ndarray, variance: np.ndarray) -> rrb.ScalarAxis | None:
    """Errors and settled band: the viewer would fit the errors alone."""
    far, band = (float(np.percentile(v, q)) if len(v) else 0.0 for v, q in (
        (np.abs(error[np.isfinite(error)]), 99.5), (SIGMAS * np.sqrt(variance[np.isfinite(variance)]), 75.0)))
    high = 1.1 * max(far, min(band, 6.0 * far))  # a band may grow without bounds
    return rrb.ScalarAxis(range=(-high, high)) if 0.0 < high < np.inf else None


def _against_network(header: Header, first: Batch, at: str, path: str, who: str) -> rrb.TimeSeriesView:
    position = first.truth is not None and header.timed and header.positions
    quantity, what = ("position_error", "Position error, m") if position else ("error_db", "Error, dB") if first.error is not None else ("nis_ratio", "Test quantity")
    median = {"nis_ratio": "pooled"}.get(quantity, "median")
    contents = [f"/{quantity}/{path}"] + ([] if header.estimators == 1 else [f"/{quantity}/network/{median}"])
    name = f"{what}: {who}" + ("" if header.estimators == 1 else f" and the network ({'all together' if median == 'pooled' else 'median'})")
    return series(at, name, contents, legend=header.estimators > 1)


def _innovations(header: Header, first: Batch, e: int, at: str) -> rrb.Container | rrb.View:
    if header.central:
        name = f"Innovations of the sensors over their deviation; band: {SIGMAS:g} sigma"
        return series(at, name, ["$origin/innovation_band/0", "$origin/innovation/**"], legend=sum(header.rows) <= ROWS)
    rows = min(header.own_rows[e], ROWS)
    plots = []
    for i in range(rows):
        name = f"Own innovations, {SIGMAS:g} sigma" if rows == 1 else f"Own innovations, row {i}, {SIGMAS:g} sigma"
        row = nodes.own_rows(header, e).start + i
        axis = _error_axis(first.innovation[:, row], first.innovation_variance[:, row])
        plots.append(series(at, name, [f"$origin/innovation_band/{i}", f"$origin/innovation/{i}"], axis=axis))
    if len(plots) == 2:
        return rrb.Horizontal(*plots)
    return rrb.Tabs(*plots, active_tab=0) if plots else rrb.TextDocumentView(origin="summary", name="This node has no sensor")


def _robustness(header: Header, at: str, path: str, who: str) -> list[rrb.View]:
    names = {"theta": "Risk sensitivity theta", "tolerance": "Tolerance c, nats"}
    return [series(at, f"{name}: {who}", [f"/{key}/{path}"] + ([] if header.estimators == 1 else [f"/{key}/network/median"]), legend=True)
            for key, name in names.items()]


def _lanes(header: Header, e: int, at: str, who: str) -> tuple[rrb.View, float]:
    others = len(header.slots[e]) - (not header.central)
    some = f" ({NEIGHBOURS} of {others} drawn)" if others > NEIGHBOURS else ""
    view = rrb.StateTimelineView(origin=f"{at}/lanes", name=f"{who}: departures, own sensor, what arrived from others{some}", time_view=TIME_AXIS)
    return view, min(1.0 + 0.75 * (2 + bool(header.monitor) + min(others, NEIGHBOURS)), 6.0)


def _story(header: Header, found: Survey, e: int, who: str) -> rrb.TextLogView:
    view = text_log(events.ORIGIN, f"When {who} went wrong" + ("" if found.departures.of(e) or any(s.estimator == e for s, _ in found.departures.silences) else ": never"))
    view.contents = [f"/{events.path(header, e)}", f"/{events.ORIGIN}/network"]
    return view
