# SPDX-License-Identifier: MIT
import os
import sys
from pathlib import Path

# Without it, rerun only warns about what it could not record.
os.environ["RERUN_STRICT"] = "1"
os.environ.pop("RERUN", None)

PACKAGE = Path(__file__).resolve().parents[2] / "tools" / "rerun"
sys.path.insert(0, str(PACKAGE))
