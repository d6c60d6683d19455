# SPDX-License-Identifier: MIT
"""One line on a terminal that says how it goes; nothing in a pipe, except what is waited for."""

import sys
import time

from .queue import DropOldest

_EVERY_S = 0.5
_SILENT_S = 2.0


class Status:
    def __init__(self, keeping, queue: DropOldest, viewers, source) -> None:
        self._keeping, self._queue, self._viewers, self._source = keeping, queue, viewers, source
        self._terminal = sys.stderr.isatty()
        self._at = time.monotonic()
        self._steps = 0
        self._said = ""

    def show(self) -> None:
        now = time.monotonic()
        if now < self._at + _EVERY_S:
            return
        silent = now - self._keeping.heard > _SILENT_S and bool(self._source.waiting)
        if not self._terminal:
            if silent and self._said != self._source.waiting:
                self._said = self._source.waiting
                print(f"meshkal-rerun: waiting for {self._said}", file=sys.stderr, flush=True)
            elif not silent:
                self._said = ""
        else:
            rate = (self._keeping.steps - self._steps) / (now - self._at)
            print(f"\r{self._line(rate, silent)}\x1b[K", end="", file=sys.stderr, flush=True)
        self._steps, self._at = self._keeping.steps, now

    def _line(self, rate: float, silent: bool) -> str:
        if silent:
            return f"waiting for {self._source.waiting}; Ctrl-C ends"
        held = ", held up by a viewer" if self._viewers.held_up else f", shown {self._viewers.delay_s:.2f} s later"
        dropped = f", {self._queue.dropped} not shown" if self._queue.dropped else ""
        problems = ", ".join(f"{count} {what}" for what, count in self._source.counts.items() if count)
        line = f"step {self._keeping.last_step}, {rate:.0f} steps/s{held}{dropped}"
        return f"{line}; {problems}" if problems else line

    def close(self) -> None:
        if self._terminal:
            print("\r\x1b[K", end="", file=sys.stderr, flush=True)
