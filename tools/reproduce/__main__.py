# SPDX-License-Identifier: MIT
import os
import sys
from pathlib import Path

# Neither an installed copy of the viewer's package nor a switched-off rerun may stand in for this checkout.
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "rerun"))
os.environ.pop("RERUN", None)

from cli import main  # noqa: E402

sys.exit(main())
