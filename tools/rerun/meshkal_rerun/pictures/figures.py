# SPDX-License-Identifier: MIT
"""Figures over time for paper: errors, consistency, theta and tolerance, monitors, agreement, messages. Maps are in maps.py."""

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC

import matplotlib.dates
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..numbers import integrity, tracking
from ..numbers.navigation import POSITION
from ..numbers.survey import NAMED
from ..recording import colours
from ..recording.series import UNIX_TIMES_S
from ..recording.tracking import shown_iterations
from . import paper
from .run import Run, test_band

_ROW_INCHES = 2.1
# More lines of named nodes would hide the band.
_MOST_LINES = NAMED
# Above it lines are thin: they would cover the band.
_MANY_STEPS = 500
# So many sensors have a lane.
_MOST_LANES = 20
_MISSING = {"missing_measurements": "measurements", "missing_estimates": "estimates", "missing_messages": "messages"}


@dataclass(frozen=True)
class Picture:
    name: str
    title: str
    alt: str  # what it shows, in words, for those who cannot see it
    figure: Figure

    @property
    def points(self) -> int:
        """Of all lines and marks: what its size as SVG depends on."""
        total = 0
        for axes in self.figure.axes:
            total += sum(len(line.get_xdata(orig=False)) for line in axes.lines)
            total += sum(max(sum(len(path.vertices) for path in c.get_paths()), len(c.get_offsets())) for c in axes.collections)
        return total


def over_time(run: Run) -> Iterator[Picture]:
    """Those that the log has something for. The caller has `paper.style()` in force."""
    for make in (_error, _axes, _consistency, _theta, _integrity, _agreement, _missing):
        picture = make(run)
        if picture:
            yield picture


def _error(run: Run) -> Picture | None:
    quantity = error_quantity(run)
    if quantity is None:
        return None
    unit = "dB" if quantity == "error_db" else "m"
    figure, (axes,) = _panels(1, 4.0)
    _spread(axes, run, quantity)
    for i, (label, (seconds, network)) in enumerate(run.compared.items()):
        if quantity in network:
            _, colour = colours.compared(i)
            axes.plot(_times(run, seconds), network[quantity]["rms"], color=paper.ink(colour), linewidth=1.6, label=f"{label}, RMS")
    what = "Norm of the error" if quantity == "error_db" else "Position error"
    if unit == "m":
        _positive(axes, run, quantity)
    _finish(axes, f"{what}, {unit}", run)
    rms = run.network[quantity]["rms"]
    alt = f"{what} over time. {_in_words('RMS over the nodes' if _several(run) else 'Error', rms, unit)}"
    if _several(run):
        alt += f" The worst node is {run.names[run.plan.found.rank[0]]}."
    return Picture("error", f"{what} {_whose(run)}", alt, figure)


def _axes(run: Run) -> Picture | None:
    """Of a navigation log."""
    if run.axis_error is None:
        return None
    figure, panels = _panels(3)
    for i, (axes, label) in enumerate(zip(panels, POSITION.labels)):
        axes.plot(_times(run), run.axis_error[:, i], color=paper.MEDIAN, label="estimate less truth")
        if run.axis_sigma is not None:
            for sign in (-3.0, 3.0):
                axes.plot(_times(run), sign * run.axis_sigma[:, i], color=paper.BOUND, linewidth=0.8, label="3 sigma of the filter" if sign > 0 else None)
        _finish(axes, f"{label.capitalize()}, m", run, last=i == 2, legend=i == 0)
    alt = "Errors of the position east, north and up over time, with three standard deviations of the filter."
    return Picture("axes", "Position error by axis", alt, figure)


def _consistency(run: Run) -> Picture | None:
    quantities = [q for q in ("nees", "nis_ratio") if q in run.network]
    figure, panels = _panels(len(quantities), None if len(quantities) > 1 else 3.4)
    words = []
    for axes, quantity in zip(panels, quantities):
        if quantity == "nees":
            low, high = tracking.nees_band(run.header.states)
            name, expected, said = "NEES", float(run.header.states), f"95 % band of chi-square, {run.header.states} degrees"
            band = np.full(len(run.seconds), low), np.full(len(run.seconds), high)
        else:
            band = test_band(run.nis_rows)
            rows = np.unique(run.nis_rows[run.nis_rows > 0]).astype(int)
            degrees = f"{rows[0]}" if len(rows) == 1 else f"{rows[0]} to {rows[-1]}" if len(rows) else "no"
            name, expected, said = "Test quantity", 1.0, f"95 % band of a node, {degrees} degrees"
        axes.fill_between(_times(run), *band, color=paper.BOUND, alpha=0.25, linewidth=0, label=said)
        axes.axhline(expected, color=paper.REFERENCE, linewidth=0.8, linestyle="--")
        _spread(axes, run, quantity)
        _positive(axes, run, quantity, float(np.nanmax(band[1], initial=expected)))
        _finish(axes, f"{name}, 1" if quantity == "nis_ratio" else f"{name}, 1 (expected {run.header.states})", run, last=axes is panels[-1])
        summary = next(iter(run.network[quantity].values()))
        words.append(f"{_in_words(name, summary, '')} Expected: {expected:g}.")
    return Picture("consistency", f"Consistency {_whose(run)}: " + " and ".join("NEES" if q == "nees" else "squared normalised innovation over its degrees"
                   for q in quantities), " ".join(words), figure)


def _theta(run: Run) -> Picture | None:
    quantities = [q for q in ("theta", "tolerance") if q in run.network and any(np.nanmax(np.abs(row), initial=0.0) > 0 for row in run.network[q].values())]
    if not quantities:
        return None
    figure, panels = _panels(len(quantities))
    names = {"theta": "Risk sensitivity theta, 1", "tolerance": "Tolerance c, nats"}
    for axes, quantity in zip(panels, quantities):
        _spread(axes, run, quantity)
        axes.set_ylim(bottom=0.0)
        _finish(axes, names[quantity], run, last=axes is panels[-1], legend=axes is panels[0])
    words = [_in_words(names[q].split(",")[0], run.network[q]["median"], "") for q in quantities]
    return Picture("theta", f"Risk sensitivity and tolerance {_whose(run)}", " ".join(words), figure)


def _integrity(run: Run) -> Picture | None:
    lanes = [(what, node) for what in ("injected", "held") for node in sorted(run.spans.get(what, {}))]
    if not run.ratio and not lanes:
        return None
    left_out, lanes = len(lanes[_MOST_LANES:]), lanes[:_MOST_LANES]
    several = run.header.estimators > 1
    rows = bool(run.ratio) + (bool(run.ratio) and several) + bool(lanes)
    figure, panels = _panels(rows, heights=[2.0] * (rows - bool(lanes)) + [max(0.6, 0.3 * len(lanes))] * bool(lanes))
    at = iter(panels)
    words = []
    if run.ratio:
        _ratios(next(at), run)
        words.append(f"{int(run.alarm_count.sum())} of {len(run.seconds) * run.header.estimators} estimator epochs are in alarm.")
        if several:
            axes = next(at)
            axes.plot(_times(run), run.alarm_count, color=paper.WORST, drawstyle="steps-post")
            axes.set_ylim(0, max(1.0, 1.05 * run.alarm_count.max()))
            _finish(axes, f"Nodes in alarm, of {run.header.estimators}", run, last=axes is panels[-1], legend=False)
    if lanes:
        _lanes(next(at), run, lanes)
        words += [f"{run.header.sensor_name(node).capitalize()} {'has a fault' if what == 'injected' else 'is held faulty'} "
                  f"{integrity.spans([(b, None if e == np.inf else e) for b, e in run.spans[what][node]])}." for what, node in lanes[:4]]
        if left_out:
            words.append(f"{left_out} more sensors are not drawn.")
    return Picture("integrity", "Integrity: monitors, and who is held faulty" if run.ratio else "Injected faults", " ".join(words), figure)


def _ratios(axes: Axes, run: Run) -> None:
    tested = integrity.tested(run.header)
    for key in sorted(run.ratio, key=lambda key: key == tested):
        band, colour = run.ratio[key], paper.MEDIAN if key == "aime" else paper.BOUND
        name = integrity.STATISTICS[key]
        axes.plot(_times(run), band["median"], color=colour, label=name + (", median" if _several(run) else ""))
        if _several(run) and key == tested:
            axes.fill_between(_times(run), band["tenth percentile"], band["ninetieth percentile"], color=colour, alpha=0.25, linewidth=0,
                              label="10 to 90 % of the nodes")
            axes.plot(_times(run), band["largest"], color=paper.WORST, linewidth=0.8, label="largest")
    axes.axhline(1.0, color="black", linewidth=0.8, linestyle="--", label="threshold")
    top = 2.2 if np.nanmax(run.ratio[tested]["largest"], initial=0.0) > 1.0 else 1.2
    there = np.isfinite(run.alarm_ratio)
    # What is above the panel says no more than what is just at its top.
    axes.plot(_times(run)[there], np.minimum(run.alarm_ratio[there], 0.97 * top), "x", color=paper.WORST, markersize=4, label="alarm")
    axes.set_ylim(0.0, top)
    _finish(axes, "Statistic / threshold, 1", run, last=False)


def _lanes(axes: Axes, run: Run, lanes: list[tuple[str, int]]) -> None:
    end = run.seconds[-1]
    for i, (what, node) in enumerate(lanes):
        for begin, over in run.spans[what][node]:
            where = _times(run, np.array([begin, min(over, end)]))
            axes.fill_between(where, i - 0.35, i + 0.35, color=paper.BOUND if what == "injected" else paper.WORST, linewidth=0.8)
    axes.set_yticks(range(len(lanes)), [f"{run.header.sensor_name(node)}: {'fault' if what == 'injected' else 'held faulty'}" for what, node in lanes])
    axes.set_ylim(len(lanes) - 0.5, -0.5)
    axes.set_xlim(*_times(run, run.seconds[[0, -1]]))
    axes.grid(axis="y", visible=False)
    _finish(axes, "", run, legend=False)


def _agreement(run: Run) -> Picture | None:
    """Of a distributed tracking filter."""
    rows = (run.disagreement is not None) + (run.consensus is not None and run.header.iterations > 0)
    if not rows:
        return None
    figure, panels = _panels(rows, None if rows > 1 else 3.0)
    words = []
    if run.disagreement is not None:
        panels[0].plot(_times(run), run.disagreement, color="black")
        panels[0].set_ylim(bottom=0.0)
        _finish(panels[0], "Largest distance\nof two estimates, m", run, last=rows == 1, legend=False)
        words.append(_in_words("Largest distance of two estimates", run.disagreement, "m"))
    if run.consensus is not None and run.header.iterations:
        shown = shown_iterations(run.header.iterations)
        for l, colour in zip(shown, colours.ramp(len(shown))):
            panels[-1].plot(_times(run), run.consensus[:, l], color=paper.ink(colour), label=f"after {l}" if l else "before")
        _finish(panels[-1], "Distance of information\nfrom the mean, dB", run)
        words.append(_in_words(f"Distance of the information matrices from their mean after {shown[-1]} iterations", run.consensus[:, shown[-1]], "dB"))
    return Picture("agreement", "Agreement of the nodes", " ".join(words), figure)


def _missing(run: Run) -> Picture | None:
    there = {q: name for q, name in _MISSING.items() if q in run.network}
    if not there:
        return None
    figure, (axes,) = _panels(1, 2.6)
    words = []
    for (quantity, name), colour in zip(there.items(), (paper.MEDIAN, paper.WORST, paper.BOUND)):
        total = run.network[quantity]["total"]
        axes.plot(_times(run), total, color=colour, label=name, linewidth=0.8)
        words.append(f"{int(total.sum())} {name} are missing, at most {int(total.max())} in a step.")
    axes.set_ylim(0.0, 1.05 * max(1.0, *(float(run.network[q]["total"].max()) for q in there)))
    _finish(axes, "Missing in a step, count", run)
    return Picture("missing", "What did not arrive, all nodes together", " ".join(words), figure)


def error_quantity(run: Run) -> str | None:
    return next((q for q in ("position_error", "error_db") if q in run.network), None)


def _spread(axes: Axes, run: Run, quantity: str) -> None:
    """The band of the nodes, what sums them up, and those that are named."""
    network, times = run.network[quantity], _times(run)
    if _several(run):
        if "low" in network:
            axes.fill_between(times, network["low"], network["high"], color=paper.MEDIAN, alpha=0.25, linewidth=0, label="5 to 95 % of the nodes")
        palette, many = colours.Palette(run.header, run.plan.named), len(times) > _MANY_STEPS
        for i, e in list(enumerate(run.drawn))[:_MOST_LINES][::-1]:
            axes.plot(times, run.each[quantity][:, i], color=paper.ink(palette.estimators[e]), label=run.names[e],
                      linestyle=paper.DASHES[i % len(paper.DASHES)], linewidth=0.5 if many else 0.8, alpha=0.6 if many else 1.0)
        for name, colour in (("median", paper.MEDIAN), ("pooled", "black"), ("mean", "black"), ("rms", "black")):
            if name in network:
                label = {"rms": "RMS", "pooled": "all nodes together"}.get(name, name)
                axes.plot(times, network[name], color=colour, linewidth=1.8, label=label)
    else:
        axes.plot(times, run.each[quantity][:, 0], color=paper.MEDIAN, label=run.header.filter if run.compared else run.names[0])


def _positive(axes: Axes, run: Run, quantity: str, least: float = 0.0) -> None:
    """From 0; with a logarithmic scale where the largest would press the rest flat."""
    drawn = [line.get_ydata() for line in axes.lines if len(line.get_ydata()) == len(run.seconds)]
    values = np.concatenate([np.asarray(row, dtype=float) for row in drawn]) if drawn else np.zeros(0)
    values = values[np.isfinite(values) & (values > 0)]
    if len(values) and values.max() > 5.0 * max(least, float(np.percentile(values, 90))):
        axes.set_yscale("log")
        axes.set_ylim(bottom=0.5 * float(np.percentile(values, 0.5)))
    else:
        axes.set_ylim(0.0, 1.1 * max(least, float(values.max()) if len(values) else 1.0))


def _panels(count: int, height: float | None = None, heights: list[float] | None = None) -> tuple[Figure, list[Axes]]:
    # Not pyplot: it keeps figures and wants a screen.
    figure = Figure(figsize=(8.0, height or (0.5 + sum(heights) if heights else 0.4 + _ROW_INCHES * count)))
    panels = figure.subplots(count, 1, sharex=True, squeeze=False, height_ratios=heights)[:, 0]
    return figure, list(panels)


def _finish(axes: Axes, label: str, run: Run, *, last: bool = True, legend: bool = True) -> None:
    axes.set_ylabel(label)
    if last:
        axes.set_xlabel("time, UTC" if _dated(run) else "time, s")
    if _dated(run):
        axes.xaxis.set_major_formatter(matplotlib.dates.ConciseDateFormatter(axes.xaxis.get_major_locator(), tz=UTC))
    handles, labels = axes.get_legend_handles_labels()
    if legend and len(labels) > 1:
        axes.legend(handles[::-1], labels[::-1], ncols=min(4, len(labels)), loc="best" if len(run.seconds) <= 2000 else "upper right")
    axes.margins(x=0.01)


def _times(run: Run, seconds: np.ndarray | None = None) -> np.ndarray:
    seconds = run.seconds if seconds is None else seconds
    return (seconds * 1e6).astype("datetime64[us]") if _dated(run) else seconds


def _dated(run: Run) -> bool:
    return run.header.start_s >= UNIX_TIMES_S


def _several(run: Run) -> bool:
    return run.header.estimators > 1


def _whose(run: Run) -> str:
    return "of the network's nodes" if _several(run) else "of the filter" if run.header.navigation else "of the centre" if run.header.central else "of the node"


def _in_words(name: str, values: np.ndarray, unit: str) -> str:
    known = values[np.isfinite(values)]
    if not len(known):
        return f"{name}: unknown."
    unit = f" {unit}" if unit else ""
    return f"{name}: from {known[0]:.3g}{unit} at the begin to {known[-1]:.3g}{unit} at the end, at least {known.min():.3g}, at most {known.max():.3g}{unit}."

