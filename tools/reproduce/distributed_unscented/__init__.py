# SPDX-License-Identifier: MIT
"""Wang et al., "Coordinated Target Tracking by Distributed Unscented Information Filter in Sensor Networks with Measurement Constraints",
Mathematical Problems in Engineering 2013, 402732."""

from pathlib import Path

import tracking

from . import figures, results
from .batches import RECORDED, compute, load

__all__ = ["compute", "report"]


def report(out: Path, seeds: range) -> int:
    return tracking.report(out, seeds, "distributed-unscented", load, results.write, figures.write, RECORDED)
