# SPDX-License-Identifier: MIT
"""Colours as 0xRRGGBBAA, chosen for rerun's dark background."""

from collections.abc import Sequence

import numpy as np

from meshkal_log.fields import Header

TRUTH = 0xFFFFFFFF
SUMMARY = 0xFFFFFFFF
WORST = 0xFF6B5EFF
MEDIAN = 0x7FC8FFFF
# Of the network as a whole, without a hue: hues are of nodes.
MIDDLE = 0xA9B8CCFF
BAND = 0x7C93B5FF
REFERENCE = 0xB0B0B0FF
LINK = 0x50505AFF
FAINT_LINK = 0x50505A50
# Links over which nothing came: they are dashed, too.
MISSING = 0xFFFFFFE0
FAINT_MISSING = 0xFFFFFF70
BACKGROUND = 0x0D0D0DFF
UNKNOWN = 0x808080FF
BOUND = 0xE8C35AFF
LIMIT = 0x8FA3B866
MESSAGE = 0x9BE37AFF
# Of three components.
AXES = (0x7FC8FFFF, 0xF5B83DFF, 0xFF7EB6FF)
LIMIT_LINE = 0xFFFFFFB0
# States of lanes and marks of monitors, from nothing to all; the last one is WORST.
QUIET = 0x3A4048FF
SOME = 0x8A7A3AFF
MANY = 0xF5B83DFF
# What became of a reading, by its name in tracking_recording.py.
DECISIONS = {
    "no reading": 0x50505AFF,
    "used": 0x58B368FF,
    "lost": 0x7F8C9AFF,
    "inflated": 0xF5B83DFF,
    "rejected": 0xFF4D40FF,
    "refused by the model": 0xC77DFFFF,
}
# Of filters that are compared with the one that is shown.
COMPARED = {"orange": 0xFFB000FF, "turquoise": 0x00D1C1FF, "pink": 0xFF7EB6FF, "lime": 0xB9E769FF, "lilac": 0xC3A6FFFF}


def compared(index: int) -> tuple[str, int]:
    """Name and colour; they repeat."""
    return list(COMPARED.items())[index % len(COMPARED)]


# Blue, sand, red: ordered for the colour-blind too, and none of them vanishes on a dark background.
_SCALE = np.array([[66, 135, 245], [245, 222, 150], [255, 88, 56]], dtype=np.float64)

# Of nodes that are named, from those of Okabe and Ito. Their five ones of equal lightness are two to the colour-blind; these differ in it, too:
# the first five by 29 units of CIELAB at least in normal vision, deuteranopia and protanopia, all by 14. None is the truth's white.
_NAMED = (0xE8650AFF, 0x56A5F0FF, 0xF5EA4AFF, 0x5FA27AFF, 0xA040FFFF, 0xA8F7C8FF, 0xA06A28FF, 0x2F6AD0FF)
OTHERS = 0x66788CFF


def cycled(count: int) -> np.ndarray:
    return np.resize(np.array(_NAMED, dtype=np.uint32), count)


class Palette:
    """The colours of nodes, the same in all pictures of a recording: those that are named have one each, the others share one."""

    def __init__(self, header: Header, named: Sequence[int]) -> None:
        self._estimator_nodes = list(header.estimator_nodes)
        self.nodes = np.empty(header.nodes, dtype=np.uint32)
        self.estimators = np.full(header.estimators, MEDIAN, dtype=np.uint32)
        self.name(named)

    def name(self, named: Sequence[int]) -> None:
        """In place: who has the arrays sees it."""
        self.named = tuple(named)
        self.nodes[:] = OTHERS
        self.nodes[list(named)] = cycled(len(named))
        # Estimators, in the order of their names; a centre is the only one.
        self.named_estimators = np.zeros(1, dtype=np.intp)
        if self._estimator_nodes:
            self.estimators[:] = self.nodes[self._estimator_nodes]
            of = {node: e for e, node in enumerate(self._estimator_nodes)}
            self.named_estimators = np.array([of[k] for k in named if k in of], dtype=np.intp)


def with_alpha(colours: np.ndarray, alpha: int) -> np.ndarray:
    return (np.asarray(colours, dtype=np.uint32) & np.uint32(0xFFFFFF00)) | np.uint32(alpha)


def scale_colours(values: np.ndarray, low: float, high: float) -> np.ndarray:
    """Blue at `low`, red at `high`, grey where the value is NaN."""
    span = high - low
    position = np.clip((values - low) / span if span > 0 else np.zeros_like(values), 0.0, 1.0)
    stops = np.linspace(0.0, 1.0, len(_SCALE))
    known = ~np.isnan(position)
    channels = [np.interp(np.where(known, position, 0.0), stops, _SCALE[:, c]) for c in range(3)]
    return np.where(known, _pack(np.stack(channels)), np.uint32(UNKNOWN)).astype(np.uint32)


def ramp(count: int) -> np.ndarray:
    """From red, the first, to blue, the last."""
    return scale_colours(np.arange(count, dtype=np.float64)[::-1], 0.0, max(count - 1.0, 1.0))


def _pack(rgb: np.ndarray) -> np.ndarray:
    r, g, b = np.rint(rgb).astype(np.uint32)
    return (r << np.uint32(24)) | (g << np.uint32(16)) | (b << np.uint32(8)) | np.uint32(0xFF)

