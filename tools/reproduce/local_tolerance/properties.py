# SPDX-License-Identifier: MIT
"""What the paper says of every draw."""

import numpy as np
from statements import CLAIM, MUST, OPEN, Property

from .draws import DENSITIES, LARGER_TOLERANCE, Analysis, Draw
from .networks import neighbourhoods

APART_DB = 0.01

Analyses = dict[str, Analysis]


def decibels(values: np.ndarray) -> np.ndarray:
    return 10.0 * np.log10(values)


def transient_db(draw: Draw) -> np.ndarray:
    """|MSD of RKFDNU - MSD of RKFDNU2| over time, dB."""
    return np.abs(decibels(draw.least_favourable["rkfdnu"].msd) - decibels(draw.least_favourable["rkfdnu2"].msd))


def gap_db(of: Analyses, better: str, worse: str) -> float:
    return of[worse].msd_db - of[better].msd_db


def _gap_growth_db(draw: Draw, better: str, worse: str) -> float:
    return gap_db(draw.larger, better, worse) - gap_db(draw.least_favourable, better, worse)


def _gap_growth(draw: Draw, better: str, worse: str) -> float:
    def gap(of: Analyses) -> float:
        return float(of[worse].node_msd.mean() - of[better].node_msd.mean())

    return gap(draw.larger) / gap(draw.least_favourable)


def _settled(kind: str, first_step: int, limit_db: float) -> Property:
    text = f"transient: RKFDNU2 within {limit_db:g} dB of RKFDNU " + (f"from t = {first_step} on" if first_step else "at every step")
    return Property(kind, text, "largest, dB", lambda draw: float(transient_db(draw)[first_step:].max()), "<", limit_db)


def _steady_distance_db(draw: Draw) -> float:
    return abs(gap_db(draw.least_favourable, "rkfdnu", "rkfdnu2"))


def _theta_ratio(draw: Draw) -> float:
    return float((draw.over_time["rkfdnu"].theta / draw.over_time["rkfdu"].theta).max())


def _tolerance_excess(draw: Draw) -> float:
    return float(draw.over_time["rkfdnu"].tolerance.max() / draw.tolerance - 1.0)


def _tolerance_distance(draw: Draw) -> float:
    return float(np.abs(draw.over_time["rkfdnu"].tolerance[-1] / draw.design_tolerances - 1.0).max())


def _tolerance_growth(draw: Draw) -> float:
    return float((draw.larger["rkfdnu"].node_tolerance / draw.least_favourable["rkfdnu"].node_tolerance).min())


def _changed_nodes_db(draw: Draw) -> float:
    """Largest change of a node's steady MSD from one density to the next, over the nodes that gained a neighbour."""
    changes = []
    for low, high in zip(DENSITIES, DENSITIES[1:]):
        (before, few), (after, many) = draw.densities[low], draw.densities[high]
        changed = [old != new for old, new in zip(neighbourhoods(before), neighbourhoods(after))]
        changes.append(decibels(many.node_msd[changed] / few.node_msd[changed]))
    return float(np.concatenate(changes).max(initial=-np.inf))


def _approach_db(draw: Draw) -> float:
    """Largest change of the distance to RKFC from one density to the next. RKFC hears all nodes whatever the edges."""
    gaps = [analysis.msd_db - draw.least_favourable["rkfc"].msd_db for _, analysis in draw.densities.values()]
    return float(np.diff(gaps).max())


def _complete_tolerance(draw: Draw) -> float:
    return float(np.abs(draw.complete.node_tolerance / draw.tolerance - 1.0).max())


def _complete_db(draw: Draw) -> float:
    return abs(draw.complete.msd_db - draw.least_favourable["rkfc"].msd_db)


def _nominal_price_db(draw: Draw) -> float:
    return min(gap_db(draw.nominal, "kfc", name) for name in draw.nominal if name != "kfc")


def _below(kind: str, better: str, worse: str, at: str = "") -> Property:
    def measure(draw: Draw) -> float:
        return gap_db(draw.larger if at else draw.least_favourable, better, worse)

    return Property(kind, f"MSD of {better.upper()} below {worse.upper()}{at}", "gap, dB", measure, ">", 0.0)


def _position_below(better: str, worse: str) -> Property:
    def measure(draw: Draw) -> float:
        return draw.least_favourable[worse].position_msd_db - draw.least_favourable[better].position_msd_db

    return Property(OPEN, f"position alone: {better.upper()} below {worse.upper()}", "gap, dB", measure, ">", 0.0)


def _wider(kind: str, better: str, worse: str) -> Property:
    text = f"gap from {better.upper()} to {worse.upper()} wider{_AT_LARGER}"
    return Property(kind, f"{text}, in dB", "growth, dB", lambda draw: _gap_growth_db(draw, better, worse), ">", 0.0)


_AT_LARGER = f" at c = {LARGER_TOLERANCE:g}"

PROPERTIES = [
    _below(MUST, "rkfc", "rkfdnu"),
    _below(MUST, "rkfdnu", "rkfdu"),
    _below(CLAIM, "rkfdu", "kfd"),
    Property(MUST, "steady MSD of RKFDNU2 that of RKFDNU", "distance, dB", _steady_distance_db, "<", APART_DB),
    _settled(MUST, 0, 0.1),
    _settled(CLAIM, 20, APART_DB),
    _settled(MUST, 50, APART_DB),
    Property(MUST, "theta of RKFDNU below RKFDU, every node and step", "largest ratio", _theta_ratio, "<", 1.0),
    Property(MUST, "c_k(t) at most c, every node and step", "largest c_k(t)/c - 1", _tolerance_excess, "<", 1e-12),
    Property(MUST, "c_k(t) converges to the designed c_k", "last step, relative", _tolerance_distance, "<", 1e-4),
    _below(MUST, "rkfc", "rkfdnu", _AT_LARGER),
    _below(MUST, "rkfdnu", "rkfdu", _AT_LARGER),
    _below(CLAIM, "rkfdu", "kfd", _AT_LARGER),
    Property(MUST, f"every c_k larger{_AT_LARGER}", "smallest factor", _tolerance_growth, ">", 1.0),
    _wider(MUST, "rkfdnu", "rkfdu"),
    _wider(MUST, "rkfdu", "kfd"),
    _wider(CLAIM, "rkfc", "rkfdnu"),
    Property(MUST, f"the same gap wider{_AT_LARGER}, in MSD itself", "factor", lambda d: _gap_growth(d, "rkfc", "rkfdnu"), ">", 1.0),
    Property(MUST, "more edges: MSD of each node with new neighbours falls", "largest change, dB", _changed_nodes_db, "<", 0.0),
    Property(MUST, "more edges: RKFDNU comes nearer to RKFC", "largest change, dB", _approach_db, "<", 0.0),
    Property(MUST, "complete graph: c_k = c", "largest, relative", _complete_tolerance, "<", 1e-9),
    Property(MUST, "complete graph: RKFDNU is RKFC", "distance, dB", _complete_db, "<", 1e-6),
    _below(MUST, "rkfc", "kfc"),
    Property(MUST, "nominal truth: KFC the best of the six", "gap to the next, dB", _nominal_price_db, ">", 0.0),
    _below(OPEN, "kfc", "rkfdnu"),
    _position_below("rkfc", "rkfdnu"),
    _position_below("rkfdnu", "rkfdu"),
    _position_below("rkfdu", "kfd"),
    _position_below("rkfdnu", "kfd"),
]
