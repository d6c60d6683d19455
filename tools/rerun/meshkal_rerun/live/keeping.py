# SPDX-License-Identifier: MIT
"""What comes from a source goes to two places: to the disk, all of it, and to viewers, what they can take."""

import argparse
import os
import time
from pathlib import Path

from meshkal_log import reader
from meshkal_log.reader import LogError
from .. import conversion
from .items import KeptLog, is_end, is_header
from .joining import Joining
from .queue import DropOldest
from .sources import Source
from .viewers import Viewers


class Keeping:
    def __init__(self, source: Source, output: Path, options: argparse.Namespace, queue: DropOldest, viewers: Viewers) -> None:
        self._source, self._output = source, output
        self._run, self._nodes = options.run, options.node
        self._queue, self._viewers = queue, viewers
        self._joining: Joining | None = None
        self._not_joined: set[int] = set()
        self.logs: dict[int, KeptLog] = {}
        self.steps = 0
        self.last_step = -1
        self.again = 0
        self.other_runs = 0
        self.heard = time.monotonic()

    def poll(self, timeout: float) -> None:
        """Raises LogError where the source is damaged, OSError if the disk is full."""
        if self._joining:
            timeout = max(0.0, min(timeout, self._joining.due()))
        try:
            for key, item, raw in self._source.poll(timeout):
                self._take(key, item, raw)
        finally:
            self._pass_on(time.monotonic())
            for log in self.logs.values():
                log.flush()

    def finish(self) -> None:
        for key, item, raw in self._source.finish():
            self._take(key, item, raw)
        self._pass_on(float("inf"))

    @property
    def from_nodes(self) -> bool:
        return any(log.header.source == "live" for log in self.logs.values())

    @property
    def ended(self) -> bool:
        """Whether all that was heard has said that it ends."""
        return bool(self.logs) and all(log.end for log in self.logs.values())

    @property
    def end(self) -> str | None:
        ends = {log.end for log in self.logs.values()}
        return None if not ends or None in ends else "complete" if ends == {"complete"} else max(ends)

    def _take(self, key: int, item: object, raw: bytes) -> None:
        self.heard = time.monotonic()
        if is_header(item):
            self._header(key, item, raw)
            return
        if key not in self.logs:
            if not self.logs:
                raise LogError("not a Meshkal log")
            return
        log = self.logs[key]
        if is_end(item):
            log.ended(item)
            if self._joining:
                self._joining.silent(key)
            return
        if not log.step(item, raw, again=self._source.again):
            self.again += 1
            return
        self.steps += 1
        if item["run"] != self._run:
            self.other_runs += 1
            return
        self.last_step = max(self.last_step, item["step"])
        if self._joining:
            self._joining.put(key, item, self.heard)
        else:
            self._queue.put(item, len(raw))

    def _header(self, key: int, item: object, raw: bytes) -> None:
        if key in self.logs:
            if not self.logs[key].same(item):
                raise LogError("the source came back with another scenario or other settings; convert it by itself")
            return
        header = reader.parse_header(item)
        if self._source.joined:
            self._joining = self._joining or Joining(header)
        shown = self._joining.header if self._joining else header
        named = conversion.node_numbers(shown, self._nodes)
        number = f".node{key}" if self._source.joined else ""
        path = self._output.with_name(f"{self._output.name}.{os.getpid()}{number}.part.cbor")
        try:
            self.logs[key] = KeptLog(item, raw, path)
        except OSError as error:
            raise OSError(f"{path} cannot be written: {error.strerror}") from None
        self._source.expect(header)
        if len(self.logs) == 1:
            self._viewers.begin(shown, named)
        if self._joining and not self._joining.node(key, header):
            self._not_joined.add(key)

    def nodes_of_recording(self) -> tuple[int, ...]:
        """Of the nodes that are to be named, those that it has."""
        return tuple(node for node in self._nodes if not self._joining or (node in self.logs and self.logs[node].steps))

    def _pass_on(self, now: float) -> None:
        if self._joining:
            size = 8 * self._joining.header.nodes * (self._joining.header.states + 16)
            for item in self._joining.ready(now):
                self._queue.put(item, size)

    def remarks(self) -> list[str]:
        out = [f"{count} {what}" for what, count in self._source.counts.items() if count]
        if self.again:
            out.append(f"{self.again} steps that came again after a new start were left out")
        if self._joining and self._joining.late:
            out.append(f"{self._joining.late} steps of nodes came too late to be shown live")
        if self._not_joined:
            out.append(f"not shown live, their links are not those of the scenario: nodes {', '.join(map(str, sorted(self._not_joined)))}")
        return out
