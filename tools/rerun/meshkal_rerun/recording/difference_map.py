# SPDX-License-Identifier: MIT
"""A picture of nodes and time, coloured by which of two logs is better: blue the shown one, orange the other one, dark: no difference."""

from dataclasses import dataclass

import numpy as np
import rerun as rr

_LEVELS = 16  # on each side of 0
_UNKNOWN = 0
# Dark in the middle, as the background is: what differs stands out. Blue and orange are told apart by the colour-blind, too.
_STOPS = np.array([[150, 205, 255], [45, 120, 225], [24, 28, 34], [225, 115, 20], [255, 205, 130]], dtype=np.float64)
_HEIGHT, _TALLEST_ROW, _SHAPE = 540, 90, 1.25
_TICKS = 8


@dataclass(frozen=True)
class Picture:
    ids: np.ndarray  # (H, W), classes: the map, a gap and the scale
    reach_db: float  # of the scale, to both sides
    width: int  # of the map alone
    ticks: list[tuple[float, float, str]]  # where, and its text


def picture(map_db: np.ndarray, nodes: tuple[int, ...], map_s: np.ndarray) -> Picture:
    """map_db: (pairs, bins). nodes: numbers of the pairs, empty for one without. Pixels are repeated until the picture is as wide as a screen."""
    rows, bins = map_db.shape
    tall = max(1, min(_TALLEST_ROW, _HEIGHT // rows))
    height = tall * rows
    wide = max(1, round(_SHAPE * max(height, 0.4 * _HEIGHT) / bins))
    reach = _reach(map_db)
    ids = np.repeat(np.repeat(_classes(map_db, reach), tall, axis=0), wide, axis=1)
    width = ids.shape[1]
    strip = max(width // 40, 1)
    scale = _classes(np.linspace(reach, -reach, height)[:, None], reach)
    ids = np.concatenate([ids, np.full((height, strip), _UNKNOWN, dtype=np.uint8), np.repeat(scale, strip, axis=1)], axis=1)
    ticks = [(-0.03 * width, (i + 0.5) * tall, f"node {nodes[i]}" if n == 0 else str(nodes[i])) for n, i in enumerate(_spread(rows))] if nodes else []
    below = height + 0.02 * max(height, width / _SHAPE)
    ticks += [((i + 0.5) * wide, below, text) for i, text in _times(map_s)]
    at = width + 3.4 * strip
    ticks += [(at, (0.5 - 0.5 * part) * height, f"{part * reach:+.3g} dB" if part else "0") for part in (1.0, 0.5, 0.0, -0.5, -1.0)]
    return Picture(ids, reach, width, ticks)


def log_picture(rec: rr.RecordingStream, path: str, made: Picture, names: tuple[str, str]) -> None:
    """names: of the shown log and of the other one."""
    classes = [rr.AnnotationInfo(_UNKNOWN, "unknown", (13, 16, 17, 255))]
    for level in range(-_LEVELS, _LEVELS + 1):
        text = f"{level / _LEVELS * made.reach_db:+.2g} dB" + (f", {names[0] if level < 0 else names[1]} better" if level else "")
        classes.append(rr.AnnotationInfo(level + _LEVELS + 1, text, (*map(int, _colour(level / _LEVELS)), 255)))
    rec.log(path, rr.AnnotationContext(classes), rr.SegmentationImage(made.ids, opacity=1.0), static=True)
    places = np.array([tick[:2] for tick in made.ticks])
    rec.log(f"{path}/ticks", rr.Points2D(places, radii=0.0, colors=0xB8C0CCFF, labels=[tick[2] for tick in made.ticks], show_labels=True), static=True)


def _reach(values: np.ndarray) -> float:
    """A round number of dB that nearly all values are within."""
    sizes = np.abs(values[np.isfinite(values)])
    largest = float(np.percentile(sizes, 97)) if len(sizes) else 0.0
    if not largest > 0.0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(largest))
    return next(float(first * power) for first in (1.0, 2.0, 3.0, 5.0, 10.0) if largest <= first * power * 1.001)


def _classes(values: np.ndarray, reach: float) -> np.ndarray:
    known = np.isfinite(values)
    level = np.rint(np.clip(np.where(known, values, 0.0) / reach, -1.0, 1.0) * _LEVELS)
    return np.where(known, level + _LEVELS + 1, _UNKNOWN).astype(np.uint8)


def _colour(part: float) -> np.ndarray:
    """part: -1 to 1."""
    return np.rint([np.interp(part, np.linspace(-1.0, 1.0, len(_STOPS)), _STOPS[:, c]) for c in range(3)])


def _times(map_s: np.ndarray, ticks: int = 6) -> list[tuple[int, str]]:
    """Bins at round times, and these. Times that count from long ago are those since the first one."""
    late = abs(map_s[0]) >= 1e6
    seconds = map_s - map_s[0] if late else map_s
    span = float(seconds[-1] - seconds[0])
    if not 0.0 < span < np.inf:
        return [(0, f"{seconds[0]:.4g} s")]
    power = 10.0 ** np.floor(np.log10(span / ticks))
    step = next(first * power for first in (1.0, 2.0, 5.0, 10.0, 20.0) if span <= ticks * first * power)
    wanted = step * np.arange(np.ceil(seconds[0] / step - 1e-9), np.floor(seconds[-1] / step + 1e-9) + 1)
    return [(int(np.abs(seconds - t).argmin()), f"{'+' if late else ''}{t:.4g} s") for t in wanted + 0.0]  # no -0


def _spread(count: int, ticks: int = _TICKS) -> list[int]:
    """At round distances, from 0."""
    step = next(first * 10**power for power in range(10) for first in (1, 2, 5) if count <= ticks * first * 10**power)
    return list(range(0, count, step))
