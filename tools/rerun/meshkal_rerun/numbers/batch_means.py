# SPDX-License-Identifier: MIT
"""A mean of values that depend on those before them, with its confidence interval. Numbers only, no rerun."""

import math
from dataclasses import dataclass

import numpy as np

from . import quantiles

LEVEL = 0.95
# Longer batches depend less on each other; with fewer of them the interval is wide.
_MOST, _LEAST = 32, 8
_SHORTEST = 4


@dataclass(frozen=True)
class Mean:
    value: float
    low: float  # of the interval; NaN: too few values
    high: float


def batch_means(values: np.ndarray) -> Mean:
    """Of the values (T,) that are finite. They are cut into batches of equal length, whose means are nearly independent if a batch is long beside the
    correlation; there are 32 batches, fewer (down to 8) while neighbouring means still depend on each other."""
    values = values[np.isfinite(values)]
    if not len(values):
        return Mean(math.nan, math.nan, math.nan)
    mean = float(values.mean())
    count = min(_MOST, len(values) // _SHORTEST)
    if count < _LEAST:
        return Mean(mean, math.nan, math.nan)
    means = _means(values, count)
    # Of independent means the lag-1 correlation is below this in 3 of 4 cases.
    while count // 2 >= _LEAST and _correlation(means) > 0.67 / math.sqrt(count):
        count //= 2
        means = _means(values, count)
    # What is left of it; estimated from few means it is too small by about (1 + 4 r) / count.
    left = _correlation(means)
    left = min(max(left + (1.0 + 4.0 * left) / count, 0.0), 0.9) if left > 0.67 / math.sqrt(count) else 0.0
    half = quantiles.student(0.5 * (1.0 - LEVEL), count - 1) * float(means.std(ddof=1)) * math.sqrt((1.0 + left) / (1.0 - left) / count)
    return Mean(mean, mean - half, mean + half)


def _means(values: np.ndarray, count: int) -> np.ndarray:
    return np.array([part.mean() for part in np.array_split(values, count)])


def _correlation(means: np.ndarray) -> float:
    centred = means - means.mean()
    total = float(centred @ centred)
    return float(centred[1:] @ centred[:-1]) / total if total > 0.0 else 0.0
