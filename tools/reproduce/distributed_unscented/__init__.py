# SPDX-License-Identifier: MIT
"""Wang et al., "Coordinated Target Tracking by Distributed Unscented Information Filter in Sensor Networks with Measurement Constraints",
Mathematical Problems in Engineering 2013, 402732."""

from pathlib import Path

from . import figures, results
from .batches import compute, load

__all__ = ["compute", "report"]


def report(out: Path, seeds: range) -> int:
    """Tables and figures from the files of the batches. 1 if a batch is missing or something that must hold does not; all there is to
    show is shown before."""
    batches, errors = load(out, seeds)
    status = results.write(out, batches, errors)
    if batches:
        figures.write(out, batches)
    return status
