# SPDX-License-Identifier: MIT
"""Runs tools/reproduce as a user does."""

import os
import subprocess
import sys
from pathlib import Path

import matplotlib.image
import numpy as np

ROOT = Path(__file__).resolve().parents[2]
TOOL = ROOT / "tools" / "reproduce"
MESHKAL = Path(os.environ.get("MESHKAL", ROOT / "build" / "meshkal")).resolve()
# Three, so that a median is no mean; the last is a draw on which a claim of the paper fails (tools/reproduce/README.md).
SEEDS = (15, 16, 17)
# Of the tracking experiments; MPUKF loses a target in the second.
BATCHES = (1, 2)

os.environ["RERUN_STRICT"] = "1"
os.environ.pop("RERUN", None)
# The package beside the tests, not an installed one.
for folder in (TOOL, ROOT / "tools" / "rerun"):
    sys.path.insert(0, str(folder))


def command(*arguments: object, cwd: Path) -> subprocess.CompletedProcess:
    return subprocess.run([sys.executable, str(TOOL), *map(str, arguments)], capture_output=True, text=True, cwd=cwd, timeout=300, check=False)


def tables(text: str) -> dict[str, list[str]]:
    """Every table row as {first cell: other cells}."""
    rows = [[cell.strip() for cell in line.strip("|\n").split("|")] for line in text.splitlines() if line.startswith("|") and "---" not in line]
    return {row[0]: row[1:] for row in rows}


def shows_something(path: Path) -> None:
    pixels = matplotlib.image.imread(path)[:, :, :3]
    assert pixels.shape[1] > 800
    drawn = (pixels < 0.97).any(axis=2)
    assert 0.01 < drawn.mean() < 0.6
    # Neither the upper nor the lower half, neither the left nor the right, is empty.
    half_y, half_x = (size // 2 for size in drawn.shape)
    assert min(part.mean() for part in (drawn[:half_y], drawn[half_y:], drawn[:, :half_x], drawn[:, half_x:])) > 0.002
    colourful = np.ptp(pixels, axis=2) > 0.2
    assert colourful.mean() > 0.0005
