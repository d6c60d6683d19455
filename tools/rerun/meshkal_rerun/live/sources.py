# SPDX-License-Identifier: MIT
"""Where a run comes from while it goes on: standard input, a file that grows, a Unix socket. Datagrams are in datagrams.py.

No source waits busily: `poll` sleeps until something comes, for `timeout` seconds at most.
"""

import fcntl
import os
import select
import socket
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from meshkal_log.reader import LogError

from .items import Framer, is_end

_PIECE = 1 << 20
_LOOK_S = 0.02  # how often a file is looked at that has not grown
_RETRY_S = 0.2

# Key of a log (one for each sender of datagrams, else 0), an item, its bytes.
Arrived = tuple[int, object, bytes]


class Source:
    """`poll` gives what has come. Raises LogError where the source is damaged; what came before has then been given."""

    again = False  # steps may come twice or late
    joined = False  # there are logs of several nodes

    def __init__(self) -> None:
        self.over = False  # nothing will come any more
        self.waiting = ""  # for what, if nothing comes
        self.counts: Counter[str] = Counter()  # of what went wrong, by how it is said
        self._framer = Framer()

    def poll(self, timeout: float) -> Iterator[Arrived]:
        raise NotImplementedError

    def expect(self, header) -> None:
        """Tells the header that was read."""
        self._framer.expect(header)

    def finish(self) -> Iterator[Arrived]:
        """What is still held back when nothing more is wanted."""
        return iter(())

    def close(self) -> None:
        pass

    def _items(self, piece: bytes) -> Iterator[Arrived]:
        for item, raw in self._framer.feed(piece):
            yield 0, item, raw


class Spool:
    """Takes a pipe's bytes as fast as they come, so that who writes them never waits, and has them on the disk until they are read."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        try:  # fewer switches between the writer and this thread
            fcntl.fcntl(descriptor, fcntl.F_SETPIPE_SZ, _PIECE)
        except OSError:
            pass  # not a pipe, or no larger one is allowed
        self._file = tempfile.TemporaryFile(buffering=0)
        self._news = threading.Condition()
        self._written = self._read = 0
        self._over: OSError | bool = False
        threading.Thread(target=self._copy, name="spool", daemon=True).start()

    def _copy(self) -> None:
        over: OSError | bool = True
        try:
            while piece := os.read(self._descriptor, _PIECE):
                with self._news:
                    os.pwrite(self._file.fileno(), piece, self._written)
                    self._written += len(piece)
                    self._news.notify()
        except OSError as error:
            over = error
        with self._news:
            self._over = over
            self._news.notify()

    def take(self, timeout: float) -> bytes | None:
        """What has come, b"" if nothing has, None at the end. Raises OSError if the disk is full."""
        with self._news:
            self._news.wait_for(lambda: self._written > self._read or self._over, timeout)
            if self._written == self._read:
                if isinstance(self._over, OSError):
                    raise self._over
                return None if self._over else b""
            piece = os.pread(self._file.fileno(), min(_PIECE, self._written - self._read), self._read)
            self._read += len(piece)
            if self._read == self._written:
                self._written = self._read = 0
                os.ftruncate(self._file.fileno(), 0)
            return piece


class Pipe(Source):
    def __init__(self, descriptor: int = 0) -> None:
        super().__init__()
        self._spool = Spool(descriptor)
        self.waiting = "standard input"

    def poll(self, timeout: float) -> Iterator[Arrived]:
        piece = self._spool.take(timeout)
        if piece is None:
            self.over = True
        for _, item, raw in self._items(piece or b""):
            self.waiting = ""
            yield 0, item, raw
            self.over = self.over or is_end(item)


class File(Source):
    """Followed until its end item. A file that is begun anew is read from its new beginning."""

    again = True

    def __init__(self, path: Path) -> None:
        super().__init__()
        self._path, self._file = path, None
        self.waiting = f"{path} to appear"

    def poll(self, timeout: float) -> Iterator[Arrived]:
        until = time.monotonic() + timeout
        while not (piece := self._piece()) and time.monotonic() < until:
            time.sleep(_LOOK_S)
        for _, item, raw in self._items(piece):
            yield 0, item, raw
            self.over = self.over or is_end(item)

    def _piece(self) -> bytes:
        if self._file is None:
            try:
                self._file = open(self._path, "rb", buffering=0)
            except FileNotFoundError:
                return b""
            self.waiting = f"{self._path} to grow"
        piece = self._file.read(_PIECE)
        if piece or not self._anew():
            return piece
        self._file.close()
        self._file = None
        self._framer.forget()
        self.counts["times the file was begun anew"] += 1
        return b""

    def _anew(self) -> bool:
        mine = os.fstat(self._file.fileno())
        if mine.st_size < self._file.tell():
            return True
        try:
            there = os.stat(self._path)
        except FileNotFoundError:
            return False  # whoever writes it may go on
        return (there.st_dev, there.st_ino) != (mine.st_dev, mine.st_ino)

    def close(self) -> None:
        if self._file:
            self._file.close()


class UnixSocket(Source):
    """The telemetry of a node. A node that ends or is started again is waited for."""

    again = True

    def __init__(self, path: str) -> None:
        super().__init__()
        self._path, self._socket = path, None
        self.waiting = f"{path} to accept a connection"

    def poll(self, timeout: float) -> Iterator[Arrived]:
        if self._socket is None and not self._connect():
            time.sleep(min(timeout, _RETRY_S))
            return
        if not select.select([self._socket], [], [], timeout)[0]:
            return
        try:
            piece = self._socket.recv(_PIECE)
        except OSError:
            piece = b""
        if not piece:
            self.close()
            self._socket = None
            self.waiting = f"{self._path} to come back"
            self.counts["connections that ended"] += 1
            self._framer.forget()
            return
        try:
            yield from self._items(piece)
        except LogError as error:
            if "not a Meshkal log" in str(error):
                raise
            # The next connection begins with a header again.
            self.counts["damaged streams"] += 1
            self.close()
            self._socket = None
            self._framer.forget()

    def _connect(self) -> bool:
        stream = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            stream.connect(self._path)
        except OSError:
            stream.close()
            return False
        self._socket, self.waiting = stream, f"{self._path} to send"
        return True

    def close(self) -> None:
        if self._socket:
            self._socket.close()
