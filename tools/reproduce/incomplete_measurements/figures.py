# SPDX-License-Identifier: MIT
"""The figures, PNG. Curves are over all batches together, spreads show every batch."""

from pathlib import Path

import numpy as np
import plots
from matplotlib import pyplot as plt
from matplotlib.figure import Figure
from tracking import share

from . import published
from .batches import LOST_M, POLICIES, RUNS, TIGHT, Batch
from .properties import LABEL, position, velocity

# Of Okabe and Ito, told apart by the colour-blind.
COLOUR = {"ekf": "#cc79a7", "ukf": "#999999", "iukf": "#56b4e9", "iukf-literal": "#0072b2", "pukf": "#e69f00", "mpukf": "#009e73"}


def write(out: Path, batches: list[Batch]) -> None:
    with plt.rc_context(plots.STYLE):
        plots.save(out / "log-mse.png", log_mse, batches)
        plots.save(out / "comparison.png", comparison, batches)
        plots.save(out / "time.png", timing, batches)
        plots.save(out / "policies.png", policies, batches)


def _middle(batches: list[Batch], variant: str, name: str, key: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Lower quartile, median and upper quartile of the batches, over time: one lost target must not be the picture."""
    curves = np.array([batch.of[variant][name][key] for batch in batches], float)
    return tuple(np.quantile(curves, [0.25, 0.5, 0.75], axis=0))


def log_mse(batches: list[Batch]) -> Figure:
    figure, panels = plt.subplots(1, 2, figsize=(9.0, 4.4))
    shown = (("published", "iukf-literal", "solid", "IUKF as published"), ("published", "pukf", "solid", "PUKF"), ("published", "mpukf", "solid", "MPUKF, with its gate"),
             ("one gate", "pukf", (0, (3, 2)), "PUKF, with the same gate"), ("published", "iukf", (0, (1, 1.5)), "IUKF, Gauss-Newton"))  # fmt: skip
    for axes, what, paper in zip(panels, ("position", "velocity"), (published.POSITION, published.VELOCITY)):
        for variant, name, dashes, label in shown:
            low, middle, high = _middle(batches, variant, name, f"log_mse_{what}_over_time")
            steps = np.arange(1, len(middle) + 1)
            colour = "#000000" if variant == "one gate" else COLOUR[name]
            axes.plot(steps, middle, color=colour, linestyle=dashes, label=label, zorder=3)
            if dashes == "solid":
                axes.fill_between(steps, low, high, color=colour, alpha=0.18, linewidth=0)
        for name, value in paper.items():
            axes.plot(steps[-1] * 1.035, value, color=COLOUR[name], clip_on=False, zorder=4, **plots.PUBLISHED | {"markersize": 7, "markeredgecolor": COLOUR[name]})
        axes.set(xlabel="step", ylabel=f"ln of the mean squared {what} error", xlim=(1, len(steps)))
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, ncols=3, loc="outside lower center", fontsize=10)
    panels[0].set_title(f"Median and quartiles of {_batches(batches)} of {RUNS} runs")
    panels[1].set_title("diamonds: published means over time")
    return figure


def _batches(batches: list[Batch]) -> str:
    return f"{len(batches)} batch" + ("" if len(batches) == 1 else "es")


def comparison(batches: list[Batch]) -> Figure:
    """As published beside one gate for all."""
    figure, panels = plt.subplots(1, 2, figsize=(9.0, 4.6))
    columns = [("published", "iukf-literal", "IUKF\nliteral"), ("published", "pukf", "PUKF"), ("published", "mpukf", "MPUKF"),
               ("one gate", "ukf", "UKF\ngate"), ("one gate", "pukf", "PUKF\ngate"), ("one gate", "mpukf", "MPUKF\ngate")]  # fmt: skip
    kinds = ((position, "position", published.POSITION, published.INDEPENDENT_POSITION), (velocity, "velocity", published.VELOCITY, published.INDEPENDENT_VELOCITY))
    for axes, (measure, what, paper, independent) in zip(panels, kinds):
        for i, (variant, name, _) in enumerate(columns):
            values = [measure(batch, variant, name) for batch in batches]
            plots.scattered(axes, i, values, COLOUR[name], None)
            if variant == "published":
                axes.plot(i + 0.34, independent[name], marker="_", markersize=14, markeredgewidth=3, color="#777777", linestyle="none", label="independent")
                axes.plot(i, paper[name], label="published", **plots.PUBLISHED)
        axes.axvline(2.5, color="#aaaaaa", linewidth=1.0)
        axes.grid(visible=False, axis="x")
        axes.set_xticks(range(len(columns)), [label for *_, label in columns])
        axes.set(ylabel=f"ln of the mean squared {what} error", title="as published  |  one gate for all")
    figure.suptitle("One point a batch; the far ones lost a target", fontsize=11)
    handles, labels = panels[0].get_legend_handles_labels()
    unique = {f"median of {_batches(batches)}, {RUNS} runs each" if label == "their median" else label: h for label, h in zip(labels, handles)}
    figure.legend(unique.values(), unique.keys(), ncols=3, loc="outside lower center", fontsize=10)
    return figure


def timing(batches: list[Batch]) -> Figure:
    figure, axes = plt.subplots(figsize=(6.4, 4.0))
    for i, name in enumerate(published.FILTERS):
        plots.scattered(axes, i, [batch.ns[name] / batch.ns["pukf"] for batch in batches], COLOUR[name], None)
        axes.plot(i, published.TIME_S[name] / published.TIME_S["pukf"], label="published", **plots.PUBLISHED)
    axes.set_xticks(range(len(published.FILTERS)), [LABEL[name] for name in published.FILTERS])
    axes.grid(visible=False, axis="x")
    microseconds = np.median([batch.ns["pukf"] for batch in batches]) / 1000.0
    axes.set(ylabel="time of a step, PUKF = 1", ylim=(0.5, None), xlim=(-0.5, 2.5), title=f"30 increments each; PUKF {microseconds:.0f} \N{MICRO SIGN}s a step here")
    handles, labels = axes.get_legend_handles_labels()
    unique = {f"median of {_batches(batches)}" if label == "their median" else label: h for label, h in zip(labels, handles)}
    axes.legend(unique.values(), unique.keys(), loc="lower left")
    return figure


def policies(batches: list[Batch]) -> Figure:
    figure, panels = plt.subplots(1, 2, sharey=True, figsize=(9.0, 4.2))
    names = list(POLICIES)
    runs = RUNS * len(batches)
    for axes, tight, title in zip(panels, (False, True), ("as published: faults, significance 0.001", f"no faults at all, significance {TIGHT:g}")):
        for i, name in enumerate(names):
            lost = sum(batch.policy(name, tight=tight)["targets_lost"] for batch in batches)
            low, high = share(lost, runs)
            axes.plot([100.0 * low, 100.0 * high], [i, i], color="#0072b2", linewidth=5, alpha=0.4, solid_capstyle="butt", label="95 % interval")
            axes.plot(100.0 * lost / runs, i, marker="o", color="#0072b2", linestyle="none", clip_on=False, zorder=4, label=f"share of {runs} runs")
            axes.annotate(f"{lost:.0f}", (100.0 * high, i), (6, 0), textcoords="offset points", va="center", fontsize=10)
        axes.set(xlabel="targets lost, %", title=title)
        axes.set_xlim(left=0.0)
        axes.margins(x=0.12)
        axes.grid(visible=False, axis="y")
    panels[0].set_yticks(range(len(names)), names)
    panels[0].invert_yaxis()
    handles, labels = panels[0].get_legend_handles_labels()
    unique = dict(zip(labels, handles))
    figure.legend(unique.values(), unique.keys(), ncols=2, loc="outside lower center", fontsize=10)
    figure.suptitle(f"What MPUKF does beyond its gate: runs that end more than {LOST_M:g} m off", fontsize=12)
    return figure


