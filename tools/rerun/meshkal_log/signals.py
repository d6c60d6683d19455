# SPDX-License-Identifier: MIT
"""What Ctrl-C and SIGTERM do to a program that writes a file."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def interruptible(reading_pipe: bool) -> Iterator[None]:
    """SIGTERM cleans up as Ctrl-C does. In a pipe, Ctrl-C reaches the simulator too, which then ends its log properly: the first
    one is left to it and what it wrote is kept, the second one stops this program."""

    def first_interrupt(_number: int, _frame: object) -> None:
        signal.signal(signal.SIGINT, signal.default_int_handler)

    before = signal.signal(signal.SIGTERM, signal.default_int_handler), signal.getsignal(signal.SIGINT)
    if reading_pipe:
        signal.signal(signal.SIGINT, first_interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before[0])
        signal.signal(signal.SIGINT, before[1])
