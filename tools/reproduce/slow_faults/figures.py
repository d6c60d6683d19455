# SPDX-License-Identifier: MIT
"""The figures, PNG."""

from pathlib import Path

import numpy as np
import plots
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from . import published
from .batches import BEGIN_S, ETA, ETAS, EVIDENCE, FAULTS, NEAR, RATES, Batch, Shares, ours, plain, unending
from .properties import LABEL, ROBUST, SHOWN, gain, wilson
from .results import MONITOR, fault_name

# Of Okabe and Ito, told apart by the colour-blind.
COLOUR = {"ekf": "#999999", "rekf-n": "#e69f00", "rekf-t": "#0072b2", "ours": "#009e73"}
_ONE_RUN = "#d55e00"
_MEAN = {"marker": "x", "markersize": 8, "markeredgewidth": 2, "color": "black", "linestyle": "none"}


def write(out: Path, batches: list[Batch]) -> None:
    batch = batches[0]
    with plt.rc_context(plots.STYLE):
        plots.save(out / "alarms.png", alarms, batch)
        plots.save(out / "innovation.png", innovation, batch)
        plots.save(out / "statistic.png", statistic, batch)
        plots.save(out / "ratio.png", ratio, batch)
        plots.save(out / "ends.png", ends, batch)
    # Ten panels: smaller.
    with plt.rc_context(plots.STYLE | {"savefig.dpi": 120}):
        plots.save(out / "roc.png", roc, batch)


def _times(batch: Batch) -> np.ndarray:
    return np.arange(1, len(batch.fault[SHOWN]) + 1)


def _spread(axes: Axes, x: float, values: np.ndarray, colour: str, label: str) -> None:
    """Every run, 5 to 95 %, median."""
    offsets = (np.arange(len(values)) * 0.618034 % 1.0 - 0.5) * 0.2
    axes.scatter(x + offsets, values, s=7, color=colour, alpha=0.35, linewidths=0)
    low, middle, high = np.nanquantile(values, (0.05, 0.5, 0.95))
    axes.plot([x, x], [low, high], color="black", linewidth=1.4, label="5 to 95 %")
    axes.plot([x - 0.1, x + 0.1], [middle] * 2, color=colour, linewidth=4, solid_capstyle="butt", label=label)
    axes.plot([x - 0.1, x + 0.1], [middle] * 2, color="black", linewidth=1.4)


def alarms(batch: Batch) -> Figure:
    figure, (times, gained) = plt.subplots(1, 2, figsize=(9.6, 4.6), width_ratios=(3, 2))
    for i, rate in enumerate(RATES):
        for j, scheme in enumerate(published.SCHEMES):
            x = i + 0.28 * (j - 1)
            _spread(times, x, batch.of[plain(scheme, (rate, 299))].alarm, COLOUR[scheme], f"{LABEL[scheme]} + {MONITOR[scheme]}, median")
            if rate in published.ALARM_S[scheme]:
                times.plot(x, published.ALARM_S[scheme][rate], label="published", **plots.PUBLISHED | {"markersize": 7})
        for j, scheme in enumerate(ROBUST):
            x = i + 0.32 * (j - 0.5)
            values = gain(batch, scheme, rate)
            _spread(gained, x, values, COLOUR[scheme], "")
            gained.plot(x + 0.13, np.mean(values), **_MEAN, label="mean")
            gained.plot(x, published.GAIN_S[scheme][rate], **plots.PUBLISHED | {"markersize": 7})
    for axes in (times, gained):
        axes.set_xticks(range(len(RATES)), [f"{rate:.2f} m/s" for rate in RATES])
        axes.grid(visible=False, axis="x")
    times.set(ylabel="alarm, s", title=f"{batch.runs} runs; the fault begins at {BEGIN_S} s")
    gained.set(ylabel="alarm before that of EKF + AIME, s", title="the same run by both")
    shown = [axes.get_legend_handles_labels() for axes in (gained, times)]
    unique = {label: handle for handles, labels in shown for handle, label in zip(handles, labels) if label}
    figure.legend(unique.values(), unique.keys(), ncols=3, loc="outside lower center", fontsize=10)
    return figure


def innovation(batch: Batch) -> Figure:
    figure, axes = plt.subplots(figsize=(8.0, 4.6))
    t = _times(batch)
    axes.plot(t, batch.fault[SHOWN], color="black", linestyle=(0, (4, 2)), label="true fault", zorder=4)
    for scheme in published.SCHEMES:
        watched = batch.of[plain(scheme, SHOWN)]
        axes.plot(t, watched.mean_innovation, color=COLOUR[scheme], label=LABEL[scheme])
        axes.fill_between(t, watched.innovation[0], watched.innovation[2], color=COLOUR[scheme], alpha=0.16, linewidth=0)
    axes.plot(t, batch.of[ours(SHOWN)].mean_innovation, color=COLOUR["ours"], linewidth=1.2, label="REKF-t, left out from the alarm on (ours)")
    axes.set(xlabel="time, s", ylabel="innovation of satellite 1, m", xlim=(100, 380))
    axes.set_title(f"Mean and 5 to 95 % of {batch.runs} runs, ramp of {fault_name(SHOWN)}")
    axes.legend(loc="upper left")
    return figure


def statistic(batch: Batch) -> Figure:
    figure, panels = plt.subplots(1, 2, sharey=True, figsize=(9.6, 4.4))
    t = _times(batch)
    schemes = [(plain(s, SHOWN), COLOUR[s], f"{LABEL[s]} + {MONITOR[s]}") for s in published.SCHEMES]
    shown = (schemes, [(ours(SHOWN), COLOUR["ours"], "REKF-t, ours")])
    for axes, cases, title in zip(panels, shown, ("as published", "the satellite left out from the alarm on")):
        for case, colour, label in cases:
            low, middle, high = batch.of[case].statistic
            axes.semilogy(t, middle, color=colour, label=label)
            axes.fill_between(t, low, high, color=colour, alpha=0.18, linewidth=0)
        threshold = batch.of[plain("ekf", SHOWN)].threshold
        axes.axhline(threshold, color="black", linestyle=(0, (4, 2)), linewidth=1.2, label=f"threshold, {threshold:.2f}")
        axes.axvspan(BEGIN_S, SHOWN[1], color="#000000", alpha=0.05, linewidth=0)
        axes.set(xlabel="time, s", xlim=(100, 380), title=title)
        axes.legend(fontsize=9.5, loc="lower right")
    panels[0].set_ylabel("statistic of AIME")
    panels[0].set_ylim(bottom=1.0)
    figure.suptitle(f"Median and 5 to 95 % of {batch.runs} runs, {fault_name(SHOWN)} (grey)", fontsize=11)
    return figure


def ratio(batch: Batch) -> Figure:
    """Of the first run: what the two rules look at."""
    figure, panels = plt.subplots(1, 2, figsize=(9.6, 4.2))
    t = _times(batch)
    improved, own = batch.of[plain("rekf-t", SHOWN)], batch.of[ours(SHOWN)]
    left, right = panels
    left.plot(t, improved.one["monitor_rho"], color=COLOUR["rekf-t"], label="ratio", linewidth=1.4)
    left.plot(t, improved.one["monitor_median"], color=_ONE_RUN, label="median of the last three", linewidth=1.4)
    left.plot(t, improved.one["monitor_median"] + ETA, color="black", linestyle=(0, (4, 2)), linewidth=1.0, label=f"median + {ETA:g}")
    left.set(title="published: ratio above median + eta", ylabel="statistic of AIME / of RCTM", ylim=(0.0, None))
    # Up to the decision; then the satellite is in use again.
    evidence = np.where((own.one["excluded"] > 0) | (t == own.end[0]), own.one["end_ratio"], np.nan)
    right.plot(t, evidence, color=COLOUR["ours"], label="evidence / its limit", linewidth=1.4)
    right.axhline(1.0, color="black", linestyle=(0, (4, 2)), linewidth=1.0, label="limit")
    right.set(title="ours: evidence that the fault is over")
    for axes, watched in zip(panels, (improved, own)):
        axes.axvspan(BEGIN_S, SHOWN[1], color="#000000", alpha=0.05, linewidth=0)
        for time, colour, label in ((watched.alarm[0], "#999999", "alarm"), (watched.end[0], "#cc0000", "declared end")):
            if np.isfinite(time):
                axes.axvline(time, color=colour, linewidth=1.2, linestyle=(0, (1, 1)), label=f"{label}, {time:.0f} s")
        axes.set(xlabel="time, s", xlim=(140, 330))
        axes.legend(fontsize=9.5, loc="upper left")
    figure.suptitle(f"The first of {batch.runs} runs, {fault_name(SHOWN)} (grey)", fontsize=11)
    return figure


def ends(batch: Batch) -> Figure:
    figure, axes = plt.subplots(figsize=(9.0, 4.8))
    parts = (("exact", "#009e73", "first epoch without fault"), ("near", "#56b4e9", f"within {NEAR} epochs"),
             ("early", "#cc0000", "earlier"), ("rest", "#dddddd", "later or not"))  # fmt: skip
    y = 0.0
    ticks: list[tuple[float, str]] = []
    for fault in FAULTS:
        for name, case in (("published", plain("rekf-t", fault)), ("ours", ours(fault))):
            s = batch.declared(case)
            begin = 0.0
            for part, colour, label in parts:
                width = 100.0 * ((s.near - s.exact) if part == "near" else getattr(s, part)) / s.runs
                axes.barh(y, width, left=begin, height=0.72, color=colour, label=label if y == 0 else None)
                begin += width
            low, high = wilson(s.near, s.runs)
            middle = 100.0 * s.near / s.runs
            axes.errorbar(middle, y, xerr=[[middle - 100 * low], [100 * high - middle]], color="black", capsize=3, linewidth=1.3,
                          label=f"within {NEAR} epochs, 95 % interval" if y == 0 else None)  # fmt: skip
            axes.annotate(f"early {100.0 * s.early / s.runs:.1f} %", (101.0, y), va="center", fontsize=9.5, annotation_clip=False)
            ticks.append((y, f"{fault_name(fault)}: {name}"))
            y += 1.0
        y += 0.45
    axes.axvline(90.0, color="#555555", linewidth=1.0, linestyle=(0, (3, 2)))
    axes.set_yticks([at for at, _ in ticks], [text for _, text in ticks])
    axes.invert_yaxis()
    axes.grid(visible=False, axis="y")
    axes.set(xlabel="runs, %", xlim=(0, 100), title=f"When the end of the fault is declared, {batch.runs} runs (dashed: 90 %)")
    figure.legend(ncols=5, loc="outside lower center", fontsize=9.5)
    return figure


_FLOOR = 2e-4  # where none of the runs is shown on the logarithmic axis


def roc(batch: Batch) -> Figure:
    figure, panels = plt.subplots(2, len(FAULTS), sharex=True, sharey="row", figsize=(9.6, 4.6))
    early = np.geomspace(_FLOOR, 1.0, 200)
    for column, fault in zip(panels.T, FAULTS):
        limit = batch.limit[fault]
        by_eta = [batch.declared(unending(fault), eta) for eta in ETAS]
        by_evidence = [batch.declared(ours(fault, evidence)) for evidence in (*EVIDENCE, None)]
        rules = (
            (COLOUR["rekf-t"], "published rule, over eta", by_eta, ETAS.index(ETA)),
            (COLOUR["ours"], "ours, over evidence", by_evidence, len(EVIDENCE)),
        )
        for axes, part in zip(column, ("near", "exact")):
            bound = 100 * limit.bound(early, exact=part == "exact")
            axes.plot(early, bound, color="black", linestyle=(0, (4, 2)), linewidth=1.2, label="bound, rate known")
            reached = limit.reached[1 if part == "near" else 2]
            axes.plot(np.maximum(limit.reached[0], _FLOOR), 100 * reached, color="#777777", linewidth=1.2, label="Page's test, rate known")
            for colour, label, declared, default in rules:
                _points(axes, declared, part, colour, label, default)
            axes.set_xscale("log")
            axes.set_xlim(_FLOOR / 1.3, 1.0)
        column[0].set_title(fault_name(fault), fontsize=9)
        column[1].set_xticks([_FLOOR, 1e-3, 1e-2, 1e-1, 1], ["0", "0.1", "1", "10", "100"], fontsize=9)
        column[1].minorticks_off()
        column[1].set_xlabel("early ends, %")
    panels[0, 0].set_ylabel(f"within {NEAR} epochs, %", fontsize=10)
    panels[1, 0].set_ylabel("exact, %", fontsize=10)
    for row in panels:
        row[0].set_ylim(0, 104)
    figure.legend(*panels[0, 0].get_legend_handles_labels(), ncols=4, loc="outside lower center", fontsize=10)
    figure.suptitle(f"Ends of faults, {batch.runs} runs each; large: as set by default, with 95 % interval", fontsize=11)
    return figure


def _points(axes: Axes, declared: list[Shares], part: str, colour: str, label: str, default: int) -> None:
    x = np.array([max(s.early / s.runs, _FLOOR) for s in declared])
    y = np.array([100.0 * getattr(s, part) / s.runs for s in declared])
    order = np.lexsort((y, x))
    axes.plot(x[order], y[order], color=colour, marker="o", markersize=4, linewidth=1.2, label=label, clip_on=False)
    s = declared[default]
    low, high = wilson(getattr(s, part), s.runs)
    left, right = (max(v, _FLOOR) for v in wilson(s.early, s.runs))
    axes.plot([left, right], [y[default]] * 2, color=colour, linewidth=3, alpha=0.5)
    axes.plot([x[default]] * 2, [100 * low, 100 * high], color=colour, linewidth=3, alpha=0.5)
    axes.plot(x[default], y[default], color=colour, marker="o", markersize=9, clip_on=False)
