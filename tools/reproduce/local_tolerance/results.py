# SPDX-License-Identifier: MIT
"""Published values beside the draws, and every property."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import tables
from statements import evaluate
from tables import Row

from . import published
from .draws import FILTERS, HORIZON, LARGER_TOLERANCE, Draw
from .networks import mean_degree
from .properties import APART_DB, PROPERTIES, decibels, gap_db, transient_db


def write(out: Path, draws: list[Draw], errors: dict[int, str]) -> int:
    """1 if a draw could not be computed or a property that must hold does not."""
    intro = (
        f"Steady values under the least favourable model of RKFC with c = {draws[0].tolerance:g}, unless said otherwise. Tolerances: twice the\n"
        "Kullback-Leibler divergence, nats.\n"
        if draws
        else ""
    )
    report = tables.Report(
        title=f"{tables.count(draws, 'random draw')} of the published experiment",
        intro=intro,
        independent="independent: min / median / max",
        rows=comparison(draws) if draws else [],
        outcomes=evaluate(PROPERTIES, draws) if draws else [],
        seeds=[draw.seed for draw in draws],
        errors=errors,
    )
    return tables.write(out, report)


def comparison(draws: list[Draw]) -> list[Row]:
    def over(measure: Callable[[Draw], float]) -> dict[int, float]:
        return {draw.seed: float(measure(draw)) for draw in draws}

    rows = []
    for f in FILTERS:
        values = over(lambda d: d.least_favourable[f].msd_db)
        rows.append(Row(f"MSD, dB: {f.upper()}", values, 4, published.MSD_DB.get(f), published.INDEPENDENT_MSD_DB.get(f)))
    gain = over(lambda d: gap_db(d.least_favourable, "rkfdnu", "rkfdu"))
    rows.append(Row("gain of RKFDNU over RKFDU, dB", gain, 4, published.GAIN_DB, published.INDEPENDENT_GAIN_DB))
    for f in FILTERS:
        rows.append(Row(f"MSD of the position, dB: {f.upper()}", over(lambda d: d.least_favourable[f].position_msd_db), 4))
    for f in ("rkfc", "rkfdu", "rkfdnu", "rkfdnu2"):
        values = over(lambda d: d.least_favourable[f].mean_tolerance)
        rows.append(Row(f"mean tolerance: {f.upper()}", values, 4, published.TOLERANCE[f], published.INDEPENDENT_TOLERANCE.get(f)))
    for f in ("rkfc", "rkfdu", "rkfdnu", "rkfdnu2"):
        values = over(lambda d: d.least_favourable[f].mean_theta)
        rows.append(Row(f"mean theta: {f.upper()}", values, 4, published.THETA[f], published.INDEPENDENT_THETA.get(f)))
    for f in FILTERS:
        rows.append(Row(f"numbers sent a step by the nodes: {f.upper()}", over(lambda d: d.communication[f]["numbers_sent_per_step"]), 0))
    for f in ("rkfdnu", "rkfdnu2"):
        rows.append(Row(f"numbers sent a step by the centre: {f.upper()}", over(lambda d: d.communication[f]["numbers_from_centre_per_step"]), 0))
    for f in FILTERS:
        rows.append(Row(f"MSD under the nominal model, dB: {f.upper()}", over(lambda d: d.nominal[f].msd_db), 4))
    rows.append(Row("mean number of neighbours, itself included", over(lambda d: mean_degree(d.scenario)), 1))
    rows.append(Row("horizon in whose middle all filters are steady, steps", over(lambda d: d.least_favourable["rkfc"].horizon), 0))
    rows.append(Row(f"reading at t = {HORIZON // 2} of {HORIZON} instead: largest change of an MSD, dB", over(_published_reading_db), 4))
    rows.append(Row(f"last step where RKFDNU2 is {APART_DB:g} dB or more off RKFDNU", over(_last_apart), 0))
    rows.append(Row("largest distance of RKFDNU2 from RKFDNU at any step, dB", over(lambda d: transient_db(d).max()), 4))
    rows.append(Row(f"gap from RKFDNU to RKFDU at c = {LARGER_TOLERANCE:g}, dB", over(lambda d: gap_db(d.larger, "rkfdnu", "rkfdu")), 4))
    rows.append(Row("share of nodes better off with RKFDNU than with RKFDU", over(_better_off), 2))
    return rows


def _published_reading_db(draw: Draw) -> float:
    return max(abs(float(decibels(draw.over_time[f].msd[HORIZON // 2])) - draw.least_favourable[f].msd_db) for f in FILTERS)


def _last_apart(draw: Draw) -> int:
    apart = np.nonzero(transient_db(draw) >= APART_DB)[0]
    return int(apart.max(initial=-1))


def _better_off(draw: Draw) -> float:
    return float(np.mean(decibels(draw.least_favourable["rkfdnu"].node_msd) < decibels(draw.least_favourable["rkfdu"].node_msd)))
