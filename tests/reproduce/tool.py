# SPDX-License-Identifier: MIT
"""Runs tools/reproduce as a user does."""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
TOOL = ROOT / "tools" / "reproduce"
MESHKAL = Path(os.environ.get("MESHKAL", ROOT / "build" / "meshkal")).resolve()
# Three, so that a median is no mean; the last is a draw on which a claim of the paper fails (tools/reproduce/README.md).
SEEDS = (15, 16, 17)

os.environ["RERUN_STRICT"] = "1"
os.environ.pop("RERUN", None)
# The package beside the tests, not an installed one.
for folder in (TOOL, ROOT / "tools" / "rerun"):
    sys.path.insert(0, str(folder))


def command(*arguments: object, cwd: Path) -> subprocess.CompletedProcess:
    return subprocess.run([sys.executable, str(TOOL), *map(str, arguments)], capture_output=True, text=True, cwd=cwd, timeout=300, check=False)
