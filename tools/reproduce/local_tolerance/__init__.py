# SPDX-License-Identifier: MIT
"""Emanuele, Gasparotto, Guerra, Zorzi, "Robust Distributed Kalman Filtering: On the Choice of the Local Tolerance", Sensors 20(11):3244, 2020."""

from pathlib import Path

from . import figures, recording, results
from .draws import compute, load

__all__ = ["compute", "report"]


def report(out: Path, seeds: range) -> int:
    """Table, figures and recording from the files of the draws. 1 if a draw is missing or something that must hold does not; all
    there is to show is shown before."""
    draws, errors = load(out, seeds)
    status = results.write(out, draws, errors)
    if draws:
        figures.write(out, draws)
        recording.write(out / "local-tolerance.rrd", draws, (out / "table.md").read_text())
    return status
