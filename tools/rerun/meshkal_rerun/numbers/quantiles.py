# SPDX-License-Identifier: MIT
"""Upper quantiles: what is exceeded with a probability, however small."""

import numpy as np
from scipy.special import gammainccinv, stdtrit


def chi_square(tail: float, degrees: np.ndarray | int) -> np.ndarray:
    """Of the shape of `degrees`; NaN where there are none. A log has few different numbers of them, and a quantile takes time."""
    known, at = np.unique(degrees, return_inverse=True)
    values = np.where(known > 0, 2.0 * gammainccinv(np.maximum(known, 1) / 2.0, tail), np.nan)
    return values[at].reshape(np.shape(degrees))


def student(tail: float, degrees: int) -> float:
    return -float(stdtrit(degrees, tail))
