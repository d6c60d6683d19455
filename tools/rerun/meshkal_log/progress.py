# SPDX-License-Identifier: MIT
"""A bar on a terminal, nothing elsewhere."""

import sys
import time
from collections.abc import Callable

_PERIOD_S = 0.1


class Progress:
    """`total`: bytes, None where it is not known. Raises nothing."""

    def __init__(self, what: str, total: int | None) -> None:
        self._bar, self._next = None, 0.0
        if sys.stderr is None or not sys.stderr.isatty():
            return
        # Not where there is nothing to show: its import takes as long as a small log.
        from tqdm import tqdm

        self._bar = tqdm(desc=what, total=total, unit="B", unit_scale=True, unit_divisor=1024, leave=False, dynamic_ncols=True)

    def at(self, done: Callable[[], int], steps: int | None = None) -> None:
        """done: how much of `total`, asked for when it is shown. Cheap enough to be called for every item."""
        if self._bar is None or time.monotonic() < self._next:
            return
        self._next = time.monotonic() + _PERIOD_S
        if steps is not None:
            self._bar.set_postfix_str(f"{steps} steps", refresh=False)
        self._bar.update(done() - self._bar.n)

    def close(self) -> None:
        if self._bar is not None:
            self._bar.close()
