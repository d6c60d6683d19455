# SPDX-License-Identifier: MIT
"""Figures of one moment for paper: the network coloured by error, positions with their ellipses, the sky."""

from collections.abc import Iterator

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection, LineCollection
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.figure import Figure

from ..numbers.navigation import sky
from ..recording import colours
from ..recording.network import graph_edges, graph_positions
from ..recording.sky import RINGS_DEG
from . import paper
from .figures import Picture
from .run import Run

SIGMAS = 3.0
_LABELLED = 60
# More ellipses would hide each other.
_ELLIPSES = 30
_GREY = "#b0b0b0"


def of_moment(run: Run) -> Iterator[Picture]:
    """Those that the log has something for. The caller has `paper.style()` in force."""
    for make in (_network, _positions, _sky):
        picture = make(run)
        if picture:
            yield picture


def _network(run: Run) -> Picture | None:
    header = run.header
    if header.navigation or header.central or header.nodes < 2:
        return None
    figure = Figure(figsize=(7.0, 5.6))
    axes = figure.subplots()
    places = run.plan.scenario.all_positions_m
    placed = places is not None
    places = places[:, :2] if placed else graph_positions(None, header) * (1.0, -1.0)
    edges, _ = graph_edges(header)
    axes.add_collection(LineCollection(places[np.array(edges, dtype=np.intp).reshape(-1, 2)], colors=paper.LINK, linewidths=0.6, zorder=1))
    values = np.full(header.nodes, np.nan)
    values[list(header.estimator_nodes)] = run.moment.shade_db
    low, high = run.plan.found.shade_range_db or (0.0, 0.0)
    known, size = np.isfinite(values), float(np.clip(9000.0 / header.nodes, 8.0, 130.0))
    style = {"s": size, "edgecolors": "#555555", "linewidths": 0.4}
    axes.scatter(*places[~known].T, c=_GREY, zorder=2, **style)
    scale = {"cmap": _scale(), "norm": Normalize(low, high if high > low else low + 1.0)}
    worst_last = np.flatnonzero(known)[np.argsort(values[known])]
    marks = axes.scatter(*places[worst_last].T, c=values[worst_last], zorder=3, **style, **scale)
    truth = "error_db" in run.network or "position_error" in run.network
    what = ("Position error, dB of 1 m" if "position_error" in run.network else "Error, dB") if truth else "10 log10 of the test quantity, dB"
    figure.colorbar(marks, ax=axes, label=what, extend="both", shrink=0.8)
    named = range(header.nodes) if header.nodes <= _LABELLED else [header.estimator_nodes[e] for e in run.drawn]
    for k in named:
        axes.annotate(str(k), places[k], textcoords="offset points", xytext=(0, 4 + 0.5 * np.sqrt(size)), ha="center", fontsize=7, zorder=4)
    _square(axes, placed)
    there = values[known]
    alt = f"{header.nodes} nodes and {len(edges)} links at {run.moment.seconds:g} s, coloured by {what[0].lower()}{what[1:]}."
    if len(there):
        best, worst = np.flatnonzero(known)[[np.argmin(there), np.argmax(there)]]
        alt += f" Least: node {best} with {values[best]:.1f} dB; most: node {worst} with {values[worst]:.1f} dB."
    return Picture("network", f"Network at {run.moment.seconds:g} s, coloured by {what[0].lower()}{what[1:]}", alt, figure)


def _positions(run: Run) -> Picture | None:
    states, moment = run.plan.scenario.position_states, run.moment
    if not states:
        return None
    if len(states) == 1:
        return _coordinate(run)
    planes = [(0, 1)] if len(states) == 2 else [(0, 1), (0, 2)]
    figure = Figure(figsize=(9.0, 4.4) if len(planes) == 1 else (11.0, 4.0))
    *whole, near = figure.subplots(1, len(planes) + 1)
    for axes, plane in zip(whole, planes):
        _plane(axes, run, *plane)
    _plane(near, run, 0, 1, near=True)
    near.set_title("the estimates")
    figure.legend(*whole[0].get_legend_handles_labels(), loc="outside lower center", ncols=6)
    alt = f"Positions at {moment.seconds:g} s"
    if moment.truth is not None and np.isfinite(moment.truth).all():
        alt += f": the truth is at {_place(moment.truth[: len(states)])}"
    middle = run.middle[np.isfinite(run.middle).all(axis=1)]
    alt += f"; the estimates' mean was last at {_place(middle[-1][: len(states)])}." if len(middle) else "."
    return Picture("position", f"Position at {moment.seconds:g} s, with {SIGMAS:g} sigma of the estimates", alt, figure)


def _plane(axes: Axes, run: Run, i: int, j: int, *, near: bool = False) -> None:
    """near: only what is around most estimates."""
    scenario, moment, header = run.plan.scenario, run.moment, run.header
    sensors = scenario.node_positions_m
    if sensors is not None:
        if not header.central and not header.navigation:
            edges = np.array([edge for edge in graph_edges(header)[0]], dtype=np.intp).reshape(-1, 2)
            axes.add_collection(LineCollection(sensors[edges][:, :, [i, j]], colors=paper.LINK, linewidths=0.5, zorder=1))
        axes.plot(sensors[:, i], sensors[:, j], "^", color="#888888", markersize=4 if header.nodes <= 100 else 2, label="sensors", zorder=2)
    if run.path is not None:
        axes.plot(run.path[:, i], run.path[:, j], color=paper.TRUTH, linewidth=1.0, label="truth", zorder=3)
    if run.middle is not None and header.timed:
        name = "estimate" if header.estimators == 1 else "mean of the estimates"
        axes.plot(run.middle[:, i], run.middle[:, j], color=paper.MEDIAN, linewidth=0.9, linestyle="--", label=name, zorder=4)
    palette = colours.Palette(header, run.plan.named)
    inks = np.array([paper.ink(c) for c in palette.estimators])
    known = np.flatnonzero(np.isfinite(moment.estimate).all(axis=1))
    axes.scatter(moment.estimate[known, i], moment.estimate[known, j], s=9, c=inks[known], zorder=5, label="estimates now")
    drawn = known if len(known) <= _ELLIPSES else [e for e in run.drawn if e in known]
    if moment.covariance is not None and len(drawn):
        drawn = np.array(drawn)
        width, height, angle = ellipses(moment.covariance[drawn], i, j)
        axes.add_collection(EllipseCollection(width, height, angle, units="xy", offsets=moment.estimate[drawn][:, [i, j]], offset_transform=axes.transData,
                                              facecolors="none", edgecolors=inks[drawn], linewidths=0.7, zorder=4))
    if moment.truth is not None:
        axes.plot(*moment.truth[[i, j]], "*", color=paper.TRUTH, markersize=9, label="truth now", zorder=6)
    names = ("east", "north", "up") if header.navigation else ("x", "y", "z")
    axes.set_xlabel(f"{names[i]}, m")
    axes.set_ylabel(f"{names[j]}, m")
    axes.autoscale_view()
    if near and len(known):
        places = moment.estimate[known][:, [i, j]]
        middle = np.median(places, axis=0)
        reach = np.percentile(np.abs(places - middle).max(axis=1), 90)
        if moment.covariance is not None and len(drawn):
            reach = max(reach, 0.5 * float(np.median(width)))
        if reach > 0.0:
            axes.set_xlim(middle[0] - 1.4 * reach, middle[0] + 1.4 * reach)
            axes.set_ylim(middle[1] - 1.4 * reach, middle[1] + 1.4 * reach)
    span = [abs(np.subtract(*limits)) for limits in (axes.get_xlim(), axes.get_ylim())]
    # A flight is flat: in true proportions its height would be a line.
    if max(span) < 8.0 * min(span):
        axes.set_aspect("equal", adjustable="box" if near else "datalim")


def _coordinate(run: Run) -> Picture:
    figure = Figure(figsize=(8.0, 3.4))
    axes = figure.subplots()
    if run.path is not None:
        axes.plot(run.seconds, run.path[:, 0], color=paper.TRUTH, label="truth")
    axes.plot(run.seconds, run.middle[:, 0], color=paper.MEDIAN, linestyle="--", label="mean of the estimates")
    axes.set_xlabel("time, s")
    axes.set_ylabel("position, m")
    axes.legend()
    return Picture("position", "Position over time", "Position of the truth and of the mean of the estimates over time.", figure)


def _sky(run: Run) -> Picture | None:
    moment, header = run.moment, run.header
    if moment.azimuth_deg is None:
        return None
    figure = Figure(figsize=(5.4, 4.8))
    axes = figure.subplots()
    for ring in RINGS_DEG:
        circle = sky(np.linspace(0.0, 360.0, 145), np.full(145, float(ring))) * (1.0, -1.0)
        axes.plot(*circle.T, color=paper.LINK, linewidth=0.8)
        axes.annotate(f"{ring}°", sky(np.array(45.0), np.array(float(ring))) * (1.0, -1.0), fontsize=7, color="#777777")
    for letter, angle in zip("NESW", (0.0, 90.0, 180.0, 270.0)):
        axes.annotate(letter, sky(np.array(angle), np.array(-7.0)) * (1.0, -1.0), ha="center", va="center")
    places = sky(moment.azimuth_deg, moment.elevation_deg) * (1.0, -1.0)
    there, read = np.isfinite(places).all(axis=1), np.isfinite(moment.weight)
    axes.scatter(*places[there & ~read].T, s=160, c=_GREY, edgecolors="#555555", zorder=3)
    marks = axes.scatter(*places[there & read].T, s=160, c=moment.weight[there & read], cmap=_scale().reversed(), vmin=0.0, vmax=1.0, edgecolors="#555555", zorder=3)
    figure.colorbar(marks, ax=axes, label="Weight of the reading, 1", shrink=0.8)
    for k in np.flatnonzero(there):
        axes.annotate(str(header.sensor_number(k)), places[k], textcoords="offset points", xytext=(9, 6), fontsize=8, zorder=4)
    axes.set_axis_off()
    axes.set_aspect("equal")
    alt = "; ".join(f"satellite {header.sensor_number(k)} at elevation {moment.elevation_deg[k]:.0f}, azimuth {moment.azimuth_deg[k]:.0f} degrees, "
                    + (f"weight {moment.weight[k]:.2g}" if read[k] else "no reading") for k in np.flatnonzero(there))
    return Picture("sky", f"Sky at {moment.seconds:g} s; centre: zenith, circles: elevation", f"Sky: {alt}.", figure)


def ellipses(packed: np.ndarray, i: int, j: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of covariances (M, 3 or 6), lower triangles by rows: width, height and angle in degrees of the ellipse of `SIGMAS` in the plane of coordinates i < j."""
    a, b, c = packed[:, i * (i + 1) // 2 + i].astype(float), packed[:, j * (j + 1) // 2 + i].astype(float), packed[:, j * (j + 1) // 2 + j].astype(float)
    middle, apart = (a + c) / 2.0, np.hypot((a - c) / 2.0, b)
    width, height = (2.0 * SIGMAS * np.sqrt(np.maximum(value, 0.0)) for value in (middle + apart, middle - apart))
    return width, height, np.degrees(0.5 * np.arctan2(2.0 * b, a - c))


def _scale() -> ListedColormap:
    """That of recordings."""
    packed = colours.scale_colours(np.linspace(0.0, 1.0, 256), 0.0, 1.0)
    return ListedColormap(np.stack([packed >> shift & 0xFF for shift in (24, 16, 8)], axis=1) / 255.0)


def _square(axes: Axes, placed: bool) -> None:
    axes.set_aspect("equal", adjustable="datalim")
    axes.autoscale_view()
    if placed:
        axes.set_xlabel("x, m")
        axes.set_ylabel("y, m")
    else:
        axes.set_axis_off()


def _place(position: np.ndarray) -> str:
    return "(" + ", ".join(f"{x:.4g}" for x in position) + ") m"
