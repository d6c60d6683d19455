# SPDX-License-Identifier: MIT
"""`meshkal-rerun --live` by itself:  python -m meshkal_rerun.live --live SOURCE -o RUN.rrd"""

import argparse
import sys

from . import command


def main() -> int:
    parser = argparse.ArgumentParser(prog=command.PROGRAM)
    parser.add_argument("-o", "--output")
    parser.add_argument("--run", type=int, default=0)
    parser.add_argument("--view")
    parser.add_argument("--node", type=lambda text: tuple(map(int, text.split(","))), default=())
    command.add_arguments(parser)
    return command.main(parser.parse_args())


sys.exit(main())
