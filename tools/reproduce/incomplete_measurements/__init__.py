# SPDX-License-Identifier: MIT
"""Target tracking with incomplete measurements by Gaussian progressive filtering (in Chinese), Acta Automatica Sinica, 2018: IUKF, PUKF, MPUKF."""

from pathlib import Path

import tracking

from . import figures, results
from .batches import RECORDED, compute, load

__all__ = ["compute", "report"]


def report(out: Path, seeds: range) -> int:
    return tracking.report(out, seeds, "incomplete-measurements", load, results.write, figures.write, RECORDED)
