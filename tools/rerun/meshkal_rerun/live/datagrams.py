# SPDX-License-Identifier: MIT
"""Telemetry of nodes in datagrams: one item each, the header again and again, in any order and with losses; several nodes may send to one port."""

import select
import socket
import time
from collections.abc import Iterator

from meshkal_log import reader
from meshkal_log.fields import Header
from meshkal_log.reader import LogError

from .items import decode, is_end, is_header
from .sources import Arrived, Source

# A step waits so long for earlier ones that may be on their way.
HOLD_S = 0.1
# Steps that came before their sender's header, and senders: what comes from a network must not fill the memory.
_MOST_PENDING = 256
_MOST_SENDERS = 4096
_MOST_AT_ONCE = 2048
_BUFFER = 8 << 20
_END = (1 << 63, 0)


class Order:
    """Steps of one node, put in order."""

    def __init__(self) -> None:
        self._held: dict[tuple[int, int], tuple[float, object, bytes]] = {}
        self._last: tuple[int, int] | None = None
        self.late = self.missing = 0

    def put(self, at: tuple[int, int], now: float, item: object, raw: bytes) -> None:
        if at in self._held or (self._last is not None and at <= self._last):
            self.late += 1
        else:
            self._held[at] = (now, item, raw)

    def ready(self, now: float) -> Iterator[tuple[object, bytes]]:
        while self._held:
            at = min(self._held)
            since, item, raw = self._held[at]
            follows = self._last is not None and at == (self._last[0], self._last[1] + 1)
            if not follows and now - since < HOLD_S:
                return
            del self._held[at]
            if at == _END:
                yield item, raw
                continue
            if self._last is not None and at[0] == self._last[0]:
                self.missing += at[1] - self._last[1] - 1
            self._last = at
            yield item, raw

    def due(self) -> float:
        """When the first one has waited long enough."""
        return min((since for since, _, _ in self._held.values()), default=float("inf")) + HOLD_S


class Datagrams(Source):
    again = True
    joined = True

    def __init__(self, host: str, port: int) -> None:
        super().__init__()
        family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM, flags=socket.AI_PASSIVE)[0]
        self._socket = socket.socket(family, kind, protocol)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER)
        self._socket.bind(address)
        self._socket.setblocking(False)
        self.port = self._socket.getsockname()[1]
        self.waiting = f"datagrams on port {self.port} of {host}"
        self._scenario: str | None = None
        self._nodes: dict[tuple, int] = {}  # of senders that have said who they are
        self._pending: dict[tuple, list[tuple[object, bytes]]] = {}  # of those that have not
        self._headers: dict[int, tuple[object, bytes]] = {}
        self._orders: dict[int, Order] = {}

    def poll(self, timeout: float) -> Iterator[Arrived]:
        due = min((order.due() for order in self._orders.values()), default=float("inf"))
        wait = max(0.0, min(timeout, due - time.monotonic()))
        if select.select([self._socket], [], [], wait)[0]:
            for _ in range(_MOST_AT_ONCE):
                try:
                    data, sender = self._socket.recvfrom(65536)
                except BlockingIOError:
                    break
                yield from self._datagram(data, sender)
        yield from self._ready(time.monotonic())

    def finish(self) -> Iterator[Arrived]:
        yield from self._ready(float("inf"))

    def _ready(self, now: float) -> Iterator[Arrived]:
        for node, order in self._orders.items():
            for item, raw in order.ready(now):
                yield node, item, raw
        self.counts["steps lost, or left out by their nodes"] = sum(order.missing for order in self._orders.values())
        self.counts["steps that came twice or too late"] = sum(order.late for order in self._orders.values())

    def _datagram(self, data: bytes, sender: tuple) -> Iterator[Arrived]:
        try:
            item = decode(data)
            header = reader.parse_header(item) if is_header(item) else None
        except LogError:
            self.counts["damaged datagrams"] += 1
            return
        if header:
            yield from self._said(header, item, data, sender)
        elif sender in self._nodes:
            self._put(self._nodes[sender], item, data)
        elif sender in self._pending or len(self._pending) < _MOST_SENDERS:
            pending = self._pending.setdefault(sender, [])
            if len(pending) < _MOST_PENDING:
                pending.append((item, data))
            else:
                self.counts["steps of senders without a header"] += 1

    def _said(self, header: Header, item: object, data: bytes, sender: tuple) -> Iterator[Arrived]:
        """A sender has said who it is."""
        self._scenario = self._scenario or header.scenario_sha256
        if header.scenario_sha256 != self._scenario or header.timed or len(header.estimator_nodes) != 1:
            self.counts["headers of another scenario, or not of a node"] += 1
            self._nodes.pop(sender, None)
            return
        (node,) = header.estimator_nodes
        if sender not in self._nodes and len(self._nodes) >= _MOST_SENDERS:
            self._nodes.pop(next(iter(self._nodes)))  # a node that is started again comes from another port
        self._nodes[sender] = node
        self.waiting = ""
        if node not in self._orders:
            self._orders[node] = Order()
        yield node, item, data
        for item, data in self._pending.pop(sender, ()):
            self._put(node, item, data)

    def _put(self, node: int, item: object, data: bytes) -> None:
        if is_end(item):
            self._orders[node].put(_END, time.monotonic(), item, data)
            return
        if not isinstance(item, dict) or not all(reader.is_unsigned(item.get(key)) for key in ("run", "step")):
            self.counts["damaged datagrams"] += 1
            return
        self._orders[node].put((item["run"], item["step"]), time.monotonic(), item, data)

    def close(self) -> None:
        self._socket.close()
