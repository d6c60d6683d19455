# SPDX-License-Identifier: MIT
"""The figures, PNG. One draw is shown where curves are, all draws where a spread is."""

from pathlib import Path

import matplotlib
import numpy as np
import plots
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.figure import Figure

from . import published
from .draws import FILTERS, HORIZON, Draw
from .networks import mean_degree, neighbourhoods
from .properties import decibels
from .styles import ON_WHITE

_LABEL = {name: name.upper() for name in FILTERS}
# Viridis without its palest end, which is hard to see on white.
_SCALE = ListedColormap(matplotlib.colormaps["viridis"](np.linspace(0.0, 0.9, 256)))
_STEP = "step t"
_MSD = "MSD of all states, dB"
_TRANSIENT_STEPS = 50
# The least favourable model of a longer horizon, so that its end is not seen.
_STEPS = np.arange(HORIZON + 1)


def write(out: Path, draws: list[Draw]) -> None:
    first = draws[0]
    with plt.rc_context(plots.STYLE):
        plots.save(out / "network.png", network, first)
        plots.save(out / "msd.png", msd, first)
        plots.save(out / "node-msd.png", node_msd, first)
        plots.save(out / "tolerance.png", tolerance, first)
        plots.save(out / "theta.png", theta, first)
        plots.save(out / "densities.png", densities, first)
        plots.save(out / "transient.png", transient, draws)
        plots.save(out / "draws.png", spread, draws)


def _line(axes: Axes, name: str, x: np.ndarray, y: np.ndarray, **style: object) -> None:
    # RKFDNU2 lies on RKFDNU: in dashes, and on top.
    dashes, order = ((0, (4, 3)), 3) if name == "rkfdnu2" else ("solid", 2)
    axes.plot(x, y, **{"color": ON_WHITE[name], "linestyle": dashes, "zorder": order, "label": _LABEL[name]} | style)


def network(draw: Draw) -> Figure:
    """Who hears whom, what a node measures, and how well it does."""
    place = np.array([node["position_m"] for node in draw.scenario["nodes"]])
    values = decibels(draw.least_favourable["rkfdnu"].node_msd)
    colours = Normalize(values.min(), values.max())
    figure, axes = plt.subplots(figsize=(7.4, 6.4))
    axes.add_collection(LineCollection([place[list(edge)] for edge in draw.scenario["edges"]], colors="#b8b8b8", linewidths=1.2, zorder=1))
    axes_of = [_measured_axes(draw.scenario, node) for node in draw.scenario["nodes"]]
    for pair, marker in (("x, y", "o"), ("x, z", "s"), ("y, z", "^")):
        chosen = [k for k, found in enumerate(axes_of) if found == pair]
        style = {"cmap": _SCALE, "norm": colours, "edgecolors": "black", "linewidths": 0.8, "zorder": 2}
        axes.scatter(place[chosen, 0], place[chosen, 1], c=values[chosen], s=170, marker=marker, label=pair, **style)
    for k, (x, y) in enumerate(place):
        axes.annotate(str(k), (x, y), (8, 8), textcoords="offset points", fontsize=10)
    title = f"Seed {draw.seed}: {mean_degree(draw.scenario):.1f} neighbours on average, itself included"
    axes.set(xlabel="x, m", ylabel="y, m", aspect="equal", title=title)
    legend = axes.legend(title="position components measured", ncols=3, loc="upper center", bbox_to_anchor=(0.5, -0.1))
    for handle in legend.legend_handles:
        handle.set_array(None)
        handle.set_facecolor("#d0d0d0")
    figure.colorbar(ScalarMappable(colours, _SCALE), ax=axes, label="steady MSD of RKFDNU at the node, dB", shrink=0.8)
    return figure


def _measured_axes(scenario: dict, node: dict) -> str:
    """What a node measures, by the name of the axis."""
    states = scenario["model"]["position_states"]
    return ", ".join(axis for axis, state in zip("xyz", states) if any(row[state] for row in node["C"]))


def _title(draw: Draw) -> str:
    return f"Under the least favourable model, c = {draw.tolerance:g} (seed {draw.seed})"


def msd(draw: Draw) -> Figure:
    figure, axes = plt.subplots()
    for name in sorted(FILTERS, key=lambda f: -round(draw.least_favourable[f].msd_db, 3)):
        analysis = draw.least_favourable[name]
        level = f"{analysis.msd_db:.2f}".replace("-", "\N{MINUS SIGN}")
        _line(axes, name, _STEPS, decibels(analysis.msd[_STEPS]), label=f"{_LABEL[name]}  {level} dB")
    axes.set(xlabel=_STEP, ylabel=_MSD, title=_title(draw), xlim=(0, HORIZON))
    axes.legend(title="steady value", alignment="left")
    return figure


def node_msd(draw: Draw) -> Figure:
    figure, axes = plt.subplots()
    shown = draw.least_favourable
    nodes = np.arange(len(shown["rkfdnu"].node_msd))
    for i, (name, marker) in enumerate((("kfd", "D"), ("rkfdu", "s"), ("rkfdnu", "o"), ("rkfdnu2", "x"))):
        beside = nodes + 0.2 * (i - 1.5)
        axes.scatter(beside, decibels(shown[name].node_msd), s=24, marker=marker, color=ON_WHITE[name], label=_LABEL[name], zorder=3)
    for name in ("kfc", "rkfc"):
        axes.axhline(shown[name].msd_db, color=ON_WHITE[name], label=f"{_LABEL[name]}, hears all")
    axes.set(xlabel="node", ylabel="steady " + _MSD, title=_title(draw), xticks=nodes)
    axes.grid(visible=False, axis="x")
    for node in nodes[:-1]:
        axes.axvline(node + 0.5, color="#e4e4e4", linewidth=0.7)
    axes.set_xlim(-0.6, len(nodes) - 0.4)
    axes.legend(ncols=3, loc="lower center", bbox_to_anchor=(0.5, 1.08))
    return figure


def tolerance(draw: Draw) -> Figure:
    figure, axes = plt.subplots()
    values = draw.over_time["rkfdnu"].tolerance
    degrees = [len(near) for near in neighbourhoods(draw.scenario)]
    colours = Normalize(min(degrees), max(degrees))
    for k, degree in enumerate(degrees):
        axes.plot(values[:, k], color=_SCALE(colours(degree)), linewidth=1.2)
    axes.axhline(draw.tolerance, color="black", linestyle=(0, (5, 3)))
    axes.annotate("c, tolerance of RKFC and RKFDU", (len(values) - 1, draw.tolerance), (0, -14), textcoords="offset points", ha="right")
    axes.set(xlabel=_STEP, ylabel="c$_k$(t), nats (twice the divergence)", title=f"Local tolerance of every node (seed {draw.seed})")
    axes.set_xlim(0, len(values) - 1)
    figure.colorbar(ScalarMappable(colours, _SCALE), ax=axes, label="neighbours, itself included")
    return figure


def theta(draw: Draw) -> Figure:
    figure, panels = plt.subplots(1, 3, sharey=True, figsize=(8.0, 4.0))
    degrees = [len(near) for near in neighbourhoods(draw.scenario)]
    colours = Normalize(min(degrees), max(degrees))
    for axes, name in zip(panels, ("rkfdu", "rkfdnu", "rkfdnu2")):
        values = draw.over_time[name].theta
        for k, degree in enumerate(degrees):
            axes.plot(values[:, k], color=_SCALE(colours(degree)), linewidth=1.0)
        axes.set(xlabel=_STEP, title=f"{_LABEL[name]}, mean {draw.least_favourable[name].mean_theta:.3f}", xlim=(0, len(values) - 1), ylim=(0.0, None))
        # The ends of neighbouring panels would overlap.
        axes.set_xticks(np.arange(50, len(values) - 1, 50))
    panels[0].set_ylabel("risk sensitivity \N{GREEK SMALL LETTER THETA}$_k$(t)")
    figure.colorbar(ScalarMappable(colours, _SCALE), ax=panels, label="neighbours, itself included")
    return figure


def densities(draw: Draw) -> Figure:
    figure, (over_time, by_node) = plt.subplots(1, 2, sharey=False, figsize=(8.0, 4.2))
    tones = _SCALE(np.linspace(0.9, 0.1, len(draw.densities)))
    for tone, marker, (scenario, analysis) in zip(tones, "os^", draw.densities.values()):
        label = f"{mean_degree(scenario):.1f}"
        over_time.plot(decibels(analysis.msd[_STEPS]), color=tone, label=label)
        by_node.scatter(np.arange(len(analysis.node_msd)), decibels(analysis.node_msd), color=tone, marker=marker, s=30, zorder=3)
    centre = draw.least_favourable["rkfc"]
    over_time.plot(decibels(centre.msd[_STEPS]), color=ON_WHITE["rkfc"], label="RKFC, hears all")
    by_node.axhline(centre.msd_db, color=ON_WHITE["rkfc"])
    over_time.set(xlabel=_STEP, ylabel=_MSD, title=f"RKFDNU, c = {draw.tolerance:g} (seed {draw.seed})", xlim=(0, HORIZON))
    over_time.legend(title="neighbours on average")
    by_node.set(xlabel="node", ylabel="steady " + _MSD, title="each node")
    by_node.set_xticks(np.arange(0, len(draw.scenario["nodes"]), 2))
    return figure


def transient(draws: list[Draw]) -> Figure:
    first, steps = draws[0], np.arange(_TRANSIENT_STEPS + 1)

    def curve(draw: Draw, name: str) -> np.ndarray:
        return decibels(draw.least_favourable[name].msd[: _TRANSIENT_STEPS + 1])

    figure, (level, difference) = plt.subplots(2, 1, sharex=True, figsize=(8.0, 5.4), height_ratios=(3, 2))
    for name in ("rkfdnu", "rkfdnu2"):
        _line(level, name, steps, curve(first, name))
    level.set(ylabel=_MSD, title=f"Tolerances sent at every step, or stored once (seed {first.seed})")
    level.legend()
    all_of_them = np.array([curve(draw, "rkfdnu2") - curve(draw, "rkfdnu") for draw in draws])
    label = f"{len(draws)} draws"
    band = all_of_them.min(axis=0), all_of_them.max(axis=0)
    difference.fill_between(steps, *band, color=ON_WHITE["rkfdnu2"], alpha=0.25, linewidth=0, label=label)
    difference.plot(steps, all_of_them[0], color=ON_WHITE["rkfdnu2"], label=f"seed {first.seed}")
    difference.axhline(0.0, color="black", linewidth=0.8)
    difference.set(xlabel=_STEP, ylabel="difference, dB", xlim=(0, _TRANSIENT_STEPS))
    difference.legend(title="RKFDNU2 \N{MINUS SIGN} RKFDNU", alignment="left")
    figure.align_ylabels()
    return figure


def spread(draws: list[Draw]) -> Figure:
    """Every draw beside what was published: what moves with the draw, and how far."""
    figure, (level, gain) = plt.subplots(1, 2, width_ratios=(5, 1.25), figsize=(8.0, 4.6))
    names = [name for name in FILTERS if name != "rkfdnu2"]
    for i, name in enumerate(names):
        values = [draw.least_favourable[name].msd_db for draw in draws]
        _strip(level, i, values, ON_WHITE[name], published.MSD_DB.get(name), published.INDEPENDENT_MSD_DB.get(name))
    level.set_xticks(range(len(names)), [f"{_LABEL[n]}\n= RKFDNU2" if n == "rkfdnu" else _LABEL[n] for n in names])
    level.set_ylabel("steady " + _MSD)
    level.set_title(f"Least favourable model, c = {draws[0].tolerance:g}")
    gains = [draw.least_favourable["rkfdu"].msd_db - draw.least_favourable["rkfdnu"].msd_db for draw in draws]
    _strip(gain, 0, gains, ON_WHITE["rkfdnu"], published.GAIN_DB, published.INDEPENDENT_GAIN_DB)
    gain.set_xticks([0], ["RKFDU \N{MINUS SIGN}\nRKFDNU"])
    gain.set(xlim=(-0.6, 0.6), ylim=(0.0, None), ylabel="gain, dB")
    for axes in (level, gain):
        axes.grid(visible=False, axis="x")
    handles, labels = level.get_legend_handles_labels()
    unique = dict(zip(labels, handles))
    order = [label for label in ("a random draw", "their median", "published", "another reproduction, 30 draws") if label in unique]
    figure.legend([unique[label] for label in order], order, ncols=4, loc="outside lower center", fontsize=10, columnspacing=1.2, handletextpad=0.5)
    return figure


def _strip(axes: Axes, x: float, values: list[float], colour: str, paper: float | None, independent: tuple | None) -> None:
    plots.scattered(axes, x, values, colour, "a random draw" if x == 1 else None)
    if independent:
        style = {"color": "#777777", "linewidth": 3, "solid_capstyle": "butt", "label": "another reproduction, 30 draws"}
        axes.plot([x + 0.33] * 2, [independent[0], independent[2]], **style)
        axes.plot([x + 0.29, x + 0.37], [independent[1]] * 2, color="#777777", linewidth=2)
    if paper is not None:
        axes.plot(x, paper, label="published", **plots.PUBLISHED)
