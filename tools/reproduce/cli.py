# SPDX-License-Identifier: MIT
"""The command: published experiments, computed over random draws, each with its table, its figures and its recording."""

import argparse
import os
import sys
import time
from pathlib import Path

import distributed_unscented
import incomplete_measurements
import local_tolerance
import slow_faults
from program import Program, ReproduceError

ROOT = Path(__file__).resolve().parents[2]
# Each has compute(program, out, seeds, jobs), and report(out, seeds) -> exit status.
PAPERS = {
    "local-tolerance": local_tolerance,
    "incomplete-measurements": incomplete_measurements,
    "distributed-unscented": distributed_unscented,
    "slow-faults": slow_faults,
}
ALL = "all"
EXIT_BAD = 2


def main(arguments: list[str] | None = None) -> int:
    options = _options(arguments)
    chosen = {name: options.out / name for name in PAPERS} if options.paper == ALL else {options.paper: options.out}
    seeds = range(options.first_seed, options.first_seed + options.draws)
    started = time.monotonic()
    status = 0
    try:
        program = None if options.report_only else Program(options.meshkal)
        for name, out in chosen.items():
            if program:
                out.mkdir(parents=True, exist_ok=True)
                print(f"{name}: {len(seeds)} random draws, seeds {seeds[0]} to {seeds[-1]}, {options.jobs} at a time", flush=True)
                PAPERS[name].compute(program, out, seeds, options.jobs)
            status = max(status, PAPERS[name].report(out, seeds))
    except (ReproduceError, OSError) as error:
        print(f"reproduce: {error}", file=sys.stderr)
        return EXIT_BAD
    print(f"{time.monotonic() - started:.0f} s. Table, figures, recording and all numbers: {options.out}")
    return status


def _options(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="reproduce", description="Repeats published experiments over random draws.")
    parser.add_argument("paper", nargs="?", choices=[*PAPERS, ALL], default=ALL, help="which one (default: all, each in a folder of DIR)")
    parser.add_argument("--meshkal", type=Path, default=ROOT / "build" / "meshkal", metavar="PROGRAM", help="default: build/meshkal of this checkout")
    parser.add_argument("--out", type=Path, default=ROOT / "build" / "reproduce", metavar="DIR", help="default: build/reproduce of this checkout")
    parser.add_argument("--draws", type=_count, default=30, metavar="N", help="default: %(default)s")
    parser.add_argument("--first-seed", type=int, default=1, metavar="S", help="seeds are S, S + 1, ... (default: %(default)s)")
    parser.add_argument("--jobs", type=_count, default=os.cpu_count() or 1, metavar="N", help="draws at a time (default: one a core)")
    parser.add_argument("--report-only", action="store_true", help="from the numbers that DIR holds already, computing nothing")
    return parser.parse_args(arguments)


def _count(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number from 1")
    return int(text)
