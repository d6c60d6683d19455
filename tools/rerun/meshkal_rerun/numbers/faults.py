# SPDX-License-Identifier: MIT
"""Fault bits of estimators where they change: a lasting fault would otherwise be said at every step. Numbers only, no rerun."""

import numpy as np

from meshkal_log.fields import Batch, Header
from .causes import LOGGED


class FaultChanges:
    """Takes batches in order."""

    def __init__(self, header: Header) -> None:
        self._last = np.zeros(header.estimators, dtype=np.uint32)

    def of(self, batch: Batch) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Places in the batch, estimators, and their faults from then on; 0: they are over."""
        faults = batch.faults & LOGGED
        before = np.vstack([self._last, faults[:-1]])
        self._last = faults[-1]
        at, who = np.nonzero(faults != before)
        return at, who, faults[at, who]
