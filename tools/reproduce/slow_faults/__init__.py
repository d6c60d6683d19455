# SPDX-License-Identifier: MIT
"""Jiang et al., slowly growing faults of pseudoranges in tightly coupled GNSS/INS (in Chinese), Systems Engineering and Electronics 44(9),
2022."""

from pathlib import Path

import tracking

from . import figures, results
from .batches import RECORDED, compute, load

__all__ = ["compute", "report"]


def report(out: Path, seeds: range) -> int:
    return tracking.report(out, seeds, "slow-faults", load, results.write, figures.write, RECORDED)
