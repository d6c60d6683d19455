# SPDX-License-Identifier: MIT
"""Jiang et al., slowly growing faults of pseudoranges in tightly coupled GNSS/INS (in Chinese), Systems Engineering and Electronics 44(9), 2022."""

from pathlib import Path

from . import figures, results
from .batches import compute, load

__all__ = ["compute", "report"]


def report(out: Path, seeds: range) -> int:
    batches, errors = load(out, seeds)
    status = results.write(out, batches, errors)
    if batches:
        figures.write(out, batches[0])
    return status
