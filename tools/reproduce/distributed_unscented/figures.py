# SPDX-License-Identifier: MIT
"""The figures, PNG."""

from pathlib import Path

import numpy as np
import plots
from matplotlib import pyplot as plt
from matplotlib.figure import Figure
from tracking import STATES, interval

from .batches import NODES, PROTOCOLS, RUNS, SWEEP, WATCHED, Batch
from .graphs import GRAPHS, ITERATIONS, disagreement
from .properties import central_rmse, node_rmse

# Of Okabe and Ito, told apart by the colour-blind.
COLOUR = {"paper": "#d55e00", "perron": "#e69f00", "metropolis": "#0072b2", "ratio": "#009e73"}
LABEL = {"paper": "paper's protocol", "perron": "paper's, scaled", "metropolis": "Metropolis", "ratio": "ratio"}
_NODES = ("#0072b2", "#d55e00", "#009e73", "#cc79a7")


def write(out: Path, batches: list[Batch]) -> None:
    with plt.rc_context(plots.STYLE):
        plots.save(out / "nodes.png", nodes, batches)
        plots.save(out / "rmse.png", rmse, batches)
        plots.save(out / "iterations.png", iterations, batches)
        plots.save(out / "disagreement.png", consensus, batches[0])
        plots.save(out / "theorem.png", theorem, batches[0])


def nodes(batches: list[Batch]) -> Figure:
    """RMSE of each node over that of the centralised filter."""
    shown = {"all, paper, 10": "all visible\npaper's\nL = 10", "all, metropolis, 10": "all visible\nMetropolis\nL = 10", "100 m, paper, 10": "100 m\npaper's\nL = 10",
             "100 m, metropolis, 10": "100 m\nMetropolis\nL = 10", "85 m, paper, 3": "85 m\npaper's\nL = 3", "85 m, paper, 10": "85 m\npaper's\nL = 10"}  # fmt: skip
    figure, axes = plt.subplots(figsize=(9.0, 4.6))
    for i, variant in enumerate(shown):
        ratios = np.array([node_rmse(b, variant) / central_rmse(b, variant.split(",")[0]) for b in batches])
        for k in range(NODES):
            offset = i + 0.25 * (k - 1)
            spread = (np.arange(len(batches)) * 0.618034 % 1.0 - 0.5) * 0.14
            axes.scatter(offset + spread, 100.0 * (ratios[:, k] - 1.0), s=16, color=_NODES[k], alpha=0.6, linewidths=0, label=f"node {k + 1}" if i == 0 else None)
    axes.axhspan(-1.0, 1.0, color="#bbbbbb", alpha=0.35, linewidth=0, label="within 1 %")
    axes.set_yscale("symlog", linthresh=1.0)
    axes.set_yticks([-100, -10, -1, 0, 1, 10, 100], ["\N{MINUS SIGN}100", "\N{MINUS SIGN}10", "\N{MINUS SIGN}1", "0", "1", "10", "100"])
    axes.set_xticks(range(len(shown)), shown.values())
    axes.grid(visible=False, axis="x")
    axes.set(ylabel="RMSE beyond the centralised filter's, %", title=f"Every node of {len(batches)} batches of {RUNS} runs, steps 21 to 80")
    axes.legend(ncols=4, loc="lower center", bbox_to_anchor=(0.5, 1.06))
    return figure


def rmse(batches: list[Batch]) -> Figure:
    """Over time: median of the batches."""
    figure, panels = plt.subplots(1, 2, figsize=(9.0, 4.2))

    def median(variant: str) -> np.ndarray:
        return np.median([b.of[variant]["position_rmse_over_time"] for b in batches], axis=0)

    left = (("alone", "one range sensor alone", "#999999", "solid"), ("all, paper, 1", "paper's, L = 1", "#e69f00", "solid"), ("all, paper, 10", "paper's, L = 10", COLOUR["paper"], "solid"),
            ("all, centralised", "centralised", "#000000", (0, (3, 2))))  # fmt: skip
    right = (("85 m, paper, 1", "paper's, L = 1", "#e69f00", "solid"), ("85 m, paper, 3", "paper's, L = 3", "#56b4e9", "solid"), ("85 m, paper, 10", "paper's, L = 10", COLOUR["paper"], "solid"),
             ("85 m, centralised", "centralised", "#000000", (0, (3, 2))))  # fmt: skip
    for axes, curves, title in zip(panels, (left, right), ("all sensors see the target", "sensing range 85 m")):
        for variant, label, colour, dashes in curves:
            values = median(variant)
            axes.semilogy(np.arange(1, len(values) + 1), values, color=colour, linestyle=dashes, label=label)
        axes.set(xlabel="step", ylabel="RMSE of the position, all nodes, m", title=f"{title}, median of the batches", xlim=(1, len(values)))
        axes.legend(fontsize=10)
    return figure


def iterations(batches: list[Batch]) -> Figure:
    """What iterations buy: accuracy, and a covariance that is true."""
    figure, (error, covariance) = plt.subplots(1, 2, figsize=(9.0, 4.4))
    for p in PROTOCOLS:
        sweep = SWEEP[p]
        beyond = [np.median([abs(node_rmse(b, f"all, {p}, {s}").max() / central_rmse(b, "all") - 1.0) for b in batches]) for s in sweep]
        error.loglog(sweep, 100.0 * np.maximum(beyond, 1e-12), marker="o", color=COLOUR[p], label=LABEL[p], linestyle=(0, (4, 2)) if p == "ratio" else "solid")
        found = [interval(b.of[f"all, {p}, {s}"]["nees"] / STATES for b in batches) for s in sweep]
        means, halves = np.array(found).T
        # Beside each other, not on each other.
        shift = 1.0 + 0.04 * (PROTOCOLS.index(p) - 1.5)
        covariance.errorbar(np.array(sweep) * shift, means, yerr=np.where(np.isfinite(halves), halves, 0.0), marker="o", markersize=5, color=COLOUR[p], capsize=3, linewidth=1.2)
    error.axhline(1.0, color="#888888", linewidth=1.0, linestyle=(0, (2, 2)))
    error.annotate("1 %", (50, 1.0), (0, 3), textcoords="offset points", ha="right", color="#555555")
    covariance.axhline(1.0, color="#888888", linewidth=1.0, linestyle=(0, (2, 2)))
    covariance.set_xscale("log")
    for axes in (error, covariance):
        ticks = [1, 2, 3, 5, 10, 20, 50]
        axes.set_xticks(ticks, map(str, ticks))
        axes.minorticks_off()
        axes.set_xlabel("iterations of consensus L")
    error.set(ylabel="RMSE of the worst node off the centralised, %", title="median of the batches")
    covariance.set(ylabel="NEES / 4: 1 if the covariance is true", title=f"mean of {len(batches)} batches, 95 % intervals", ylim=(0.9, None))
    figure.legend(*error.get_legend_handles_labels(), ncols=4, loc="outside lower center")
    return figure


def consensus(batch: Batch) -> Figure:
    figure, axes = plt.subplots()
    steps = np.arange(WATCHED + 1)
    for p in PROTOCOLS:
        if p == "ratio":
            continue
        curves = batch.disagreement[p]
        axes.fill_between(steps, curves.min(axis=0), curves.max(axis=0), color=COLOUR[p], alpha=0.2, linewidth=0)
        axes.semilogy(steps, np.median(curves, axis=0), color=COLOUR[p], label=LABEL[p])
        slope, anchor = batch.eigenvalue(p), 4
        line = 3.0 * np.median(curves[:, anchor]) * slope ** (steps - anchor)
        if p != "perron":
            axes.semilogy(steps, line, color="black", linestyle=(0, (4, 2)), linewidth=1.2, label=f"slope {slope:.3f}, from design")
    axes.set(xlabel="iteration l", ylabel="largest distance of a node's information\nfrom the mean, relative", xlim=(0, WATCHED), ylim=(1e-13, None))
    axes.set_title(f"Disagreement of consensus, path of three nodes: median and range of 80 steps (seed {batch.seed})")
    axes.legend()
    return figure


def theorem(batch: Batch) -> Figure:
    """Disagreement where the theorem is met; where it is not, what the nodes hold."""
    meet = [graph for graph in GRAPHS if graph.converges]
    broken = [graph for graph in GRAPHS if not graph.converges]
    figure = plt.figure(figsize=(10.0, 5.2))
    grid = figure.add_gridspec(2, 4)
    axes = figure.add_subplot(grid[:, :2])
    steps = np.arange(ITERATIONS + 1)
    for graph, tone in zip(meet, ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00")):
        curve = disagreement(batch.graphs[graph.title])
        eigenvalue = graph.second_eigenvalue()
        axes.semilogy(steps, np.maximum(curve, 1e-16), color=tone, label=f"{graph.title}: {eigenvalue:.3f}")
        if eigenvalue > 0.1:
            # From an iteration in which the second eigenvector is what is left.
            first = 10
            axes.semilogy(steps[first:], 2.5 * curve[first] * eigenvalue ** (steps[first:] - first), color="black", linestyle=(0, (4, 2)), linewidth=1.0)
    axes.set(xlabel="iteration l", ylabel="largest distance between nodes, relative", title="Graphs that meet the theorem", xlim=(0, ITERATIONS), ylim=(1e-13, 3.0))
    axes.legend(title="second eigenvalue, its slope dashed", fontsize=9, title_fontsize=9, ncols=2, loc="upper center", bbox_to_anchor=(0.5, -0.14))
    shown = 12
    for i, graph in enumerate(broken):
        panel = figure.add_subplot(grid[i // 2, 2 + i % 2])
        values = batch.graphs[graph.title][: shown + 1]
        for k in range(values.shape[1]):
            panel.plot(values[:, k], color=_NODES[k], linewidth=1.3, marker=".", markersize=5)
        panel.set_title(graph.title.replace(", ", ",\n", 1), fontsize=9.5)
        panel.set_xticks([0, 4, 8, shown])
        panel.tick_params(labelsize=9)
        if i >= len(broken) - 2:
            panel.set_xlabel("iteration l")
    figure.suptitle(f"The paper's protocol on random values (seed {batch.seed}). Right: values at the nodes of graphs that break the theorem", fontsize=11)
    return figure
