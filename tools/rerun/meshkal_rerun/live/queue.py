# SPDX-License-Identifier: MIT
"""What waits to be shown: bounded, the oldest steps are dropped."""

import threading
import time
from collections import deque


class DropOldest:
    """`put` never waits."""

    def __init__(self, items: int, size: int) -> None:
        self._most_items, self._most_bytes = items, size
        self._queue: deque[tuple[dict, int, float]] = deque()
        self._bytes = 0
        self._news = threading.Condition()
        self._closed = False
        self.dropped = 0

    def put(self, item: dict, size: int) -> None:
        with self._news:
            self._queue.append((item, size, time.monotonic()))
            self._bytes += size
            while len(self._queue) > self._most_items or (self._bytes > self._most_bytes and len(self._queue) > 1):
                self._bytes -= self._queue.popleft()[1]
                self.dropped += 1
            self._news.notify()

    def close(self) -> None:
        """Nothing comes any more; what is there can still be taken."""
        with self._news:
            self._closed = True
            self._news.notify()

    def take(self, most: int, timeout: float) -> tuple[list[dict], float]:
        """Up to `most` items, the oldest first, as soon as there is one, and when the oldest was put."""
        with self._news:
            self._news.wait_for(lambda: self._queue or self._closed, timeout)
            taken = [self._queue.popleft() for _ in range(min(most, len(self._queue)))]
            self._bytes -= sum(size for _, size, _ in taken)
        return [item for item, _, _ in taken], taken[0][2] if taken else 0.0

    def drop_all(self) -> None:
        with self._news:
            self.dropped += len(self._queue)
            self._queue.clear()
            self._bytes = 0

    @property
    def over(self) -> bool:
        with self._news:
            return self._closed and not self._queue

    def __len__(self) -> int:
        return len(self._queue)
