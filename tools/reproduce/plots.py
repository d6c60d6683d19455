# SPDX-License-Identifier: MIT
"""What all figures share."""

from collections.abc import Callable, Sequence
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt  # noqa: E402
import numpy as np  # noqa: E402
from matplotlib.axes import Axes  # noqa: E402

STYLE = {
    "figure.figsize": (8.0, 4.4),
    "figure.constrained_layout.use": True,
    "savefig.dpi": 150,
    "font.size": 11,
    "axes.titlesize": 11,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e4e4e4",
    "grid.linewidth": 0.7,
    "axes.axisbelow": True,
    "lines.linewidth": 1.8,
    "legend.frameon": False,
}
PUBLISHED = {"marker": "D", "markersize": 9, "markerfacecolor": "white", "markeredgecolor": "#cc0000", "markeredgewidth": 2, "linestyle": "none"}


def save(path: Path, make: Callable, *arguments: object) -> None:
    figure = make(*arguments)
    figure.savefig(path)
    plt.close(figure)


def scattered(axes: Axes, x: float, values: Sequence[float], colour: str, label: str | None) -> None:
    """A column of points, and their median."""
    # Spread by rank of a fixed sequence, not at random: the same numbers give the same picture.
    offsets = (np.arange(len(values)) * 0.618034 % 1.0 - 0.5) * 0.3
    axes.scatter(x + offsets, values, s=22, color=colour, alpha=0.55, linewidths=0, label=label)
    axes.plot([x - 0.24, x + 0.24], [np.median(values)] * 2, color="black", linewidth=2.2, label="their median")
