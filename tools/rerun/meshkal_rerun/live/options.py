# SPDX-License-Identifier: MIT
"""Arguments of live mode, without what takes long to import."""

import argparse

LOCAL = "127.0.0.1"
# Viewers take 9876 for themselves; one that is told to open that very address sends what it receives back to it.
PORT = 9877
_QUEUE_ITEMS = 20000


def add_arguments(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("while a run goes on")
    group.add_argument("--live", metavar="SOURCE", help="serve viewers and record: - (standard input), a file that grows, unix:PATH or "
                       "udp:[HOST:]PORT, the telemetry of meshkal-node (HOST: where to listen, default 127.0.0.1)")
    group.add_argument("--port", type=_port, default=PORT, help="for viewers (default: 9877; 0: a free one)")
    group.add_argument("--bind", metavar="ADDRESS", default=LOCAL, help="for viewers (default: 127.0.0.1; anyone who reaches another one sees all)")
    group.add_argument("--spawn", action="store_true", help="start a viewer")
    group.add_argument("--wait", type=_seconds, metavar="S", help="end when nothing has come for so long (default: at the end of the log or by Ctrl-C)")
    group.add_argument("--window", type=_seconds, default=60.0, metavar="S", help="time that plots show (default: 60)")
    group.add_argument("--memory", default="256MiB", help="kept for viewers that come later (default: 256MiB)")
    # Small queues show what is dropped when: for tests.
    group.add_argument("--queue", type=int, default=_QUEUE_ITEMS, help=argparse.SUPPRESS)


def _port(text: str) -> int:
    if not text.isdecimal() or int(text) > 65535:
        raise argparse.ArgumentTypeError(f"{text!r} is not a port")
    return int(text)


def _seconds(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0.0 < value < 1e9:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number of seconds")
    return value
