# SPDX-License-Identifier: MIT
"""Items of a log out of bytes that come in pieces, and the log that is kept of them."""

import io
from collections.abc import Iterator
from pathlib import Path

import cbor2

from meshkal_log import reader
from meshkal_log.fields import Header, lengths, optional
from meshkal_log.reader import FORMAT, LogError, check_arrays

# What damage cannot exceed: a wrong length would otherwise wait for bytes that never come. A header carries the scenario, with its matrices.
_HEADER_LIMIT = 256 << 20
_KEYS_LIMIT = 1 << 16
_MAP = 5
# Damaged input reaches the decoder's constructors too, which raise whatever they like.
_DAMAGE = (cbor2.CBORDecodeError, ValueError, TypeError, OverflowError, RecursionError, MemoryError)


def decode(data: bytes) -> object:
    """One item, all of `data`. Raises LogError."""
    stream = io.BytesIO(data)
    try:
        item = cbor2.CBORDecoder(stream, tag_hook=reader.typed_array).decode()
    except (EOFError, *_DAMAGE) as error:
        raise LogError(" ".join(str(error).split())) from None
    if stream.tell() != len(data):
        raise LogError("there is more than one item")
    return item


def is_header(item: object) -> bool:
    return isinstance(item, dict) and item.get("format") == FORMAT


def is_end(item: object) -> bool:
    return isinstance(item, dict) and "end" in item


class Framer:
    """Cuts a stream into items. An item that has come in part waits for the rest."""

    def __init__(self) -> None:
        self._tail = b""
        self._items = 0
        self._limit = _HEADER_LIMIT

    def feed(self, piece: bytes) -> Iterator[tuple[object, bytes]]:
        """Items and their bytes. Raises LogError where the stream is damaged, after what is whole."""
        data = self._tail + piece
        self._tail = b""
        if self._items == 0 and data and data[0] >> 5 != _MAP:
            raise LogError("not a Meshkal log")
        stream = io.BytesIO(data)
        decoder = cbor2.CBORDecoder(stream, tag_hook=reader.typed_array)
        start = 0
        while start < len(data):
            try:
                item = decoder.decode()
            except (cbor2.CBORDecodeEOF, EOFError):
                if len(data) - start > self._limit:
                    raise LogError(f"item {self._items + 1} is damaged: it is longer than an item of this log can be") from None
                break
            except _DAMAGE as error:
                raise LogError(f"item {self._items + 1} is damaged: {' '.join(str(error).split())}") from None
            end = stream.tell()
            self._items += 1
            yield item, data[start:end]
            start = end
        self._tail = data[start:]

    def expect(self, header: Header) -> None:
        """From now on no item is longer than this log's can be; another header may come again."""
        arrays = sum(dtype.itemsize * length for dtype, length in lengths(header).values())
        self._limit = max(arrays, 2 * len(header.scenario)) + 64 * header.nodes + _KEYS_LIMIT

    def forget(self) -> int:
        """A new connection begins with an item: what is left of the last one is of no use. Returns how many bytes."""
        lost, self._tail = len(self._tail), b""
        return lost


class KeptLog:
    """What has come of one log, checked, in a file that is a log itself."""

    def __init__(self, item: object, raw: bytes, path: Path) -> None:
        """Of a header item. Raises LogError if it is none, OSError if the file cannot be made or is there."""
        self.header = reader.parse_header(item)
        self.path = path
        self.end: str | None = None  # of the last end item, None if steps came after it
        self.steps = 0
        self._last = (-1, -1)
        self._lengths, self._optional = lengths(self.header), optional(self.header)
        self._present: frozenset[str] | None = None
        self._file = open(path, "xb", buffering=1 << 20)
        self._file.write(raw)

    def same(self, item: object) -> bool:
        return reader.parse_header(item) == self.header

    def step(self, item: object, raw: bytes, *, again: bool) -> bool:
        """Keeps a step. again: steps may come twice or late, and are then left out: returns whether it was kept. Raises LogError."""
        where = f"item {self.steps + 2}"
        if not isinstance(item, dict):
            raise LogError(f"{where} is not a map")
        for key in ("run", "step"):
            if not reader.is_unsigned(item.get(key)):
                raise LogError(f"{where}: {key} is missing or not an unsigned number")
        where += f" (run {item['run']}, step {item['step']})"
        check_arrays(item, self._lengths, self._optional, where)
        reader.check_times(item, self.header, where)
        present = frozenset(key for key in self._optional if key in self._lengths and key in item)
        if self._present not in (None, present):
            raise LogError(f"{where}: {', '.join(sorted(present ^ self._present))} is in some steps and not in others")
        now = (item["run"], item["step"])
        if now <= self._last:
            if again:
                return False
            raise LogError(f"{where}: comes after run {self._last[0]}, step {self._last[1]}")
        self._present, self._last, self.end = present, now, None
        self._file.write(raw)
        self.steps += 1
        return True

    def ended(self, item: dict) -> None:
        if item["end"] not in ("complete", "interrupted", "failed"):
            raise LogError(f"item {self.steps + 2}: end is neither complete nor interrupted")
        self.end = item["end"]

    def flush(self) -> None:
        """What is kept survives the end of this process."""
        self._file.flush()

    def close(self, end: str | None) -> None:
        """end: of the end item; None leaves the log without one."""
        if end:
            self._file.write(cbor2.dumps({"end": end, "items": self.steps}))
        self._file.close()
