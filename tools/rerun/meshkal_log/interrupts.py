# SPDX-License-Identifier: MIT
"""Ctrl-C and its like: the first one ends the reading, and what was read is written; the next one ends the program and leaves nothing."""

import io
import os
import signal

_NAMES = {signal.SIGINT: "Ctrl-C", signal.SIGTERM: "SIGTERM", signal.SIGHUP: "SIGHUP"}


class _Woken(BaseException):
    """Leaves a read that blocks."""


class Interrupts:
    """A context that catches SIGINT, SIGTERM and SIGHUP, unless they are ignored. `spare`: the first Ctrl-C is left to others: in a pipe it reaches the
    simulator too, which then ends its log properly."""

    def __init__(self, *, stay: bool = False) -> None:
        """stay: also behind the block, where the program ends: Python's end takes its time, too."""
        self.spare = False
        self._stay = stay
        self._came: int | None = None
        self._waiting = False
        self._before: dict[int, object] = {}

    def __enter__(self) -> "Interrupts":
        for number in _NAMES:
            before = signal.getsignal(number)
            if before != signal.SIG_IGN:  # of nohup, of a job in the background
                self._before[number] = before
                signal.signal(number, self._caught)
        return self

    def __exit__(self, *_: object) -> None:
        if not self._stay:
            for number, before in self._before.items():
                signal.signal(number, before)

    @property
    def came(self) -> bool:
        return self._came is not None

    @property
    def name(self) -> str:
        return _NAMES[self._came]

    @property
    def exit_status(self) -> int:
        """What a shell gives a program that this signal ended."""
        return 128 + (self._came or signal.SIGINT)

    def read(self, descriptor: int, size: int) -> bytes:
        """A read that may take for ever. Nothing, as at the end of the input, when a signal comes, or has come."""
        try:
            self._waiting = True
            data = b"" if self.came else os.read(descriptor, size)
            self._waiting = False
            return data
        except _Woken:
            return b""
        finally:
            self._waiting = False

    def stream(self, descriptor: int) -> io.BufferedReader:
        """What reads of a descriptor by `read`."""
        return io.BufferedReader(_Source(descriptor, self), 1 << 16)

    def _caught(self, number: int, _frame: object) -> None:
        if number == signal.SIGINT and self.spare:
            self.spare = False
            return
        if self.came:
            raise KeyboardInterrupt
        self._came = number
        if self._waiting:
            raise _Woken


class _Source(io.RawIOBase):
    def __init__(self, descriptor: int, interrupts: Interrupts) -> None:
        self._descriptor, self._interrupts = descriptor, interrupts

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: memoryview) -> int:
        data = self._interrupts.read(self._descriptor, len(buffer))
        buffer[: len(data)] = data
        return len(data)
