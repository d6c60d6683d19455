# SPDX-License-Identifier: MIT
"""Fault bits of estimators where they change: a lasting fault would otherwise be said at every step. Numbers only, no rerun."""

import numpy as np

from meshkal_log.fields import Batch, Header

# The bits of meshkal/rkfd.h.
NAMES = {0: "measurement missing", 1: "estimate missing", 2: "input refused", 3: "no measurement at all"}
# With lossy links the first two come and go at every step; they are drawn as counts and would bury the others here.
_TOLD = np.uint32(0xFFFFFFFF & ~0b11)


class FaultChanges:
    """Takes batches in order."""

    def __init__(self, header: Header) -> None:
        self._last = np.zeros(header.estimators, dtype=np.uint32)

    def of(self, batch: Batch) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Places in the batch, estimators, and their faults from then on; 0: they are over."""
        faults = batch.faults & _TOLD
        before = np.vstack([self._last, faults[:-1]])
        self._last = faults[-1]
        at, who = np.nonzero(faults != before)
        return at, who, faults[at, who]


def text(mask: int) -> str:
    return ", ".join(NAMES.get(bit, f"fault bit {bit}") for bit in range(32) if mask >> bit & 1) or "faults over"
