# SPDX-License-Identifier: MIT
"""Target tracking with incomplete measurements by Gaussian progressive filtering (in Chinese), Acta Automatica Sinica, 2018: IUKF, PUKF, MPUKF."""

from pathlib import Path

from run_logs import record
from seeds import folder_of

from . import figures, results
from .batches import RECORDED, compute, load

__all__ = ["compute", "report"]


def report(out: Path, seeds: range) -> int:
    """Tables, figures and the recording of one run from the files of the batches. 1 if a batch is missing or something that must hold
    does not; all there is to show is shown before."""
    batches, errors = load(out, seeds)
    status = results.write(out, batches, errors)
    if batches:
        figures.write(out, batches)
        folder = folder_of(out, batches[0].seed)
        record([folder / f"{name}.cbor" for name in RECORDED], out / "incomplete-measurements.rrd")
    return status
