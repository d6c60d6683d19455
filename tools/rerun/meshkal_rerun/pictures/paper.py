# SPDX-License-Identifier: MIT
"""The colours of recordings on white paper, and how figures look."""

import matplotlib
from cycler import cycler

from ..recording import colours

# As dark as letters of a large size must be on white (WCAG 2.1, 1.4.11).
_CONTRAST = 3.0
DASHES = ("-", (0, (6, 1.5)), (0, (1.5, 1)), (0, (5, 1, 1, 1)), (0, (8, 2)), (0, (3, 1)), (0, (5, 1, 1, 1, 1, 1)), (0, (1, 2)))
STYLE = {
    "figure.figsize": (8.0, 4.0), "figure.dpi": 120.0, "savefig.dpi": 120.0, "figure.constrained_layout.use": True,
    "font.size": 9.0, "axes.titlesize": 10.0, "axes.titlelocation": "left", "axes.spines.top": False, "axes.spines.right": False,
    "axes.grid": True, "axes.axisbelow": True, "grid.color": "#dddddd", "grid.linewidth": 0.6, "legend.fontsize": 8.0, "legend.framealpha": 0.85, "legend.edgecolor": "none",
    "lines.linewidth": 1.0, "axes.prop_cycle": cycler(color=["#000000"]), "figure.facecolor": "white", "axes.facecolor": "white",
    # Letters stay letters, so that a page can be searched and stays small; ids do not change from one call to the next.
    "svg.fonttype": "none", "svg.hashsalt": "meshkal", "font.family": "sans-serif", "path.simplify": True, "agg.path.chunksize": 20000,
}


def style() -> object:
    """For a `with` block."""
    return matplotlib.rc_context(STYLE)


def ink(colour: int) -> str:
    """#rrggbb of a colour that was chosen for the dark background: white is black, and what is too light is darkened."""
    colour = int(colour)
    rgb = [(colour >> shift & 0xFF) / 255.0 for shift in (24, 16, 8)]
    if min(rgb) > 0.97:
        return "#000000"
    while 1.05 / (_luminance(rgb) + 0.05) < _CONTRAST:
        rgb = [0.96 * c for c in rgb]
    return "#" + "".join(f"{round(255 * c):02x}" for c in rgb)


def _luminance(rgb: list[float]) -> float:
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in rgb]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


TRUTH, MEDIAN, WORST, REFERENCE, BOUND = (ink(c) for c in (colours.TRUTH, colours.MEDIAN, colours.WORST, colours.REFERENCE, colours.BOUND))
LINK = "#c8ccd2"
