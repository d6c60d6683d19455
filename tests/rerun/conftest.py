# SPDX-License-Identifier: MIT
import os
import signal
import sys
from pathlib import Path

# Without it, rerun only warns about what it could not record.
os.environ["RERUN_STRICT"] = "1"
os.environ.pop("RERUN", None)

PACKAGE = Path(__file__).resolve().parents[2] / "tools" / "rerun"
sys.path.insert(0, str(PACKAGE))

# A run in the background may ignore these, and so would the programs that tests start to stop them; they would wait for ever.
for _number in (signal.SIGINT, signal.SIGHUP):
    if signal.getsignal(_number) == signal.SIG_IGN:
        signal.signal(_number, signal.default_int_handler if _number == signal.SIGINT else signal.SIG_DFL)
