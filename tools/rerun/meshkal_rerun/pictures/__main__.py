# SPDX-License-Identifier: MIT
"""python -m meshkal_rerun.pictures RUN.cbor [...] --png DIR [--time SECONDS] [--size WxH] [--view NAME] [--node K[,K...]] [--run K]
python -m meshkal_rerun.pictures RUN.cbor [...] --report REPORT.html [--views]"""

import argparse
import signal
import sys
from contextlib import ExitStack
from pathlib import Path

from meshkal_log.reader import LogError

from ..conversion import Logs, Wanted
from . import SIZE, write


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m meshkal_rerun.pictures", description=__doc__)
    parser.add_argument("log", nargs="+")
    parser.add_argument("--png", type=Path)
    parser.add_argument("--report", type=Path)
    parser.add_argument("--views", action="store_true")
    parser.add_argument("--time", type=float)
    parser.add_argument("--size", type=lambda text: tuple(map(int, text.split("x"))), default=SIZE)
    parser.add_argument("--view")
    parser.add_argument("--node", type=lambda text: tuple(map(int, text.split(","))), default=())
    parser.add_argument("--run", type=int, default=0)
    options = parser.parse_args()
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        with ExitStack() as keep:
            logs = Logs({name: keep.enter_context(open(name, "rb")) for name in options.log}, keep)
            wanted, remarks = Wanted(options.run, options.view, options.node), []
            if options.png:
                remarks += write(logs, wanted, options.png, size=options.size, time_s=options.time)
            if options.report:
                from . import report

                remarks += report.write(logs, wanted, options.report, time_s=options.time, views=options.views)
    except KeyboardInterrupt:
        return 130
    except (LogError, OSError) as error:
        print(error, file=sys.stderr)
        return 2 if isinstance(error, LogError) else 1
    for remark in remarks:
        print(remark, file=sys.stderr)
    return 0


sys.exit(main())
