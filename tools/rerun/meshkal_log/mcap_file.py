# SPDX-License-Identifier: MIT
"""Writes a log as an MCAP file (https://mcap.dev/spec): protobuf messages in compressed chunks, indexed. The records of mcap's library, but not its
writer: that takes messages one at a time, and there may be millions."""

import zlib
from collections import deque
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pyarrow as pa
from mcap import records
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.writer import MCAP0_MAGIC

from .fields import Batch, Header
from .layout import as_texts
from .messages import Messages
from .reader import LogError
from .run import times
from .tables import TIME_COLUMNS, tables_of

CHUNK_BYTES = 4 << 20
_COMPRESSION = "lz4"  # every reader knows it; in zstd the file is a tenth smaller
_CHANNELS = 65535
_CHUNKS_AHEAD = 3
_LARGEST_TIME_S = 9.2e9


class McapFile:
    """`batch` for each batch of a run, then `finish`; `stop` in any case."""

    def __init__(self, path: Path, header: Header, first: Batch, header_item: dict) -> None:
        self._header = header
        tables = tables_of(header, first)
        self._messages = Messages(header, tables)
        if len(self._messages.topics) > _CHANNELS:
            raise LogError(f"the log would have {len(self._messages.topics)} topics, an MCAP file has {_CHANNELS} at most; write tables")
        units = {f"{t.name}.{c.name}": c.unit for t in tables for c in (*TIME_COLUMNS, *t.columns) if c.unit}
        self._shift_s = None  # of a log with times before 0, which an MCAP file cannot have
        self._pool = ThreadPoolExecutor(2)
        self._pending: deque[tuple[Future, np.ndarray, int]] = deque()
        self._chunks: list[records.ChunkIndex] = []
        self._metadata: list[records.MetadataIndex] = []
        self._steps, self._run = 0, 0
        self._out = open(path, "wb")
        self._out.write(MCAP0_MAGIC)
        self._put(records.Header(profile="", library="meshkal-rerun"))
        self._describe("meshkal", header_item)
        self._describe("meshkal units", units)
        self._schemas, self._channels = self._declare()
        for record in (*self._schemas, *self._channels):
            self._put(record)

    def _declare(self) -> tuple[list[records.Schema], list[records.Channel]]:
        names = list(dict.fromkeys(topic.message for topic in self._messages.topics))
        schemas = [records.Schema(id=1 + i, name=name, encoding="protobuf", data=self._messages.schema) for i, name in enumerate(names)]
        channels = [
            records.Channel(id=1 + i, topic=t.name, message_encoding="protobuf", metadata=t.metadata, schema_id=1 + names.index(t.message))
            for i, t in enumerate(self._messages.topics)
        ]
        return schemas, channels

    def batch(self, run: int, batch: Batch) -> None:
        self._run = run
        log_time = self._log_time(batch)
        each = max(1, CHUNK_BYTES // self._messages.step_bytes)
        for first in range(0, len(log_time), each):
            steps = slice(first, first + each)
            data = self._messages.fill(batch, steps, log_time[steps])
            self._pending.append((self._pool.submit(_compressed, data), log_time[steps], data.size))
            while len(self._pending) > _CHUNKS_AHEAD:
                self._chunk(*self._pending.popleft())
        self._steps += len(log_time)

    def _log_time(self, batch: Batch) -> np.ndarray:
        seconds = times(batch, self._header)
        if self._shift_s is None:
            self._shift_s = float(-np.floor(min(0.0, seconds.min(initial=0.0))))
        seconds = seconds + self._shift_s
        if len(seconds) and not (0.0 <= seconds.min() and seconds.max() < _LARGEST_TIME_S):
            raise LogError(f"times from {seconds.min():g} s to {seconds.max():g} s do not fit the nanoseconds of an MCAP file; write tables")
        return np.rint(seconds * 1e9).astype(np.uint64)

    def _chunk(self, future: Future, log_time: np.ndarray, size: int) -> None:
        data, crc = future.result()
        start, end, at = int(log_time.min()), int(log_time.max()), self._out.tell()
        self._put(records.Chunk(
            compression=_COMPRESSION, data=data, message_start_time=start, message_end_time=end, uncompressed_crc=crc, uncompressed_size=size,
        ))
        indexed_from = self._out.tell()
        index = self._message_index(log_time)
        self._out.write(index.tobytes())
        offsets = indexed_from + index.itemsize * np.arange(len(index))
        self._chunks.append(records.ChunkIndex(
            message_start_time=start, message_end_time=end, chunk_start_offset=at, chunk_length=indexed_from - at,
            message_index_offsets=dict(zip(range(1, 1 + len(index)), offsets.tolist())), message_index_length=index.nbytes,
            compression=_COMPRESSION, compressed_size=len(data), uncompressed_size=size,
        ))

    def _message_index(self, log_time: np.ndarray) -> np.ndarray:
        """A record for each channel; each has one message a step."""
        entry = np.dtype([("time", "<u8"), ("offset", "<u8")])
        form = [("opcode", "u1"), ("length", "<u8"), ("channel", "<u2"), ("bytes", "<u4"), ("entries", entry, (len(log_time),))]
        index = np.zeros(len(self._channels), dtype=form)
        index["opcode"] = Opcode.MESSAGE_INDEX
        index["length"] = index.itemsize - 9
        index["channel"] = 1 + np.arange(len(index))
        index["bytes"] = entry.itemsize * len(log_time)
        index["entries"]["time"] = log_time
        steps = np.uint64(self._messages.step_bytes) * np.arange(len(log_time), dtype=np.uint64)
        index["entries"]["offset"] = self._messages.offsets[:, None] + steps
        return index

    def finish(self, last: dict) -> None:
        while self._pending:
            self._chunk(*self._pending.popleft())
        shift = {"log_time_is_later_by_s": self._shift_s} if self._shift_s else {}
        self._describe("meshkal end", {**last, "run": self._run, **shift})
        self._put(records.DataEnd(0))
        self._summary()
        self._out.close()

    def _summary(self) -> None:
        summary, start, groups = RecordBuilder(), self._out.tell(), []
        counts = dict.fromkeys(range(1, 1 + len(self._channels)), self._steps) if self._steps else {}
        statistics = records.Statistics(
            attachment_count=0, channel_count=len(self._channels), channel_message_counts=counts, chunk_count=len(self._chunks),
            message_count=sum(counts.values()), metadata_count=len(self._metadata), schema_count=len(self._schemas),
            message_start_time=min((c.message_start_time for c in self._chunks), default=0),
            message_end_time=max((c.message_end_time for c in self._chunks), default=0),
        )
        for opcode, group in (
            (Opcode.SCHEMA, self._schemas), (Opcode.CHANNEL, self._channels), (Opcode.STATISTICS, [statistics]),
            (Opcode.CHUNK_INDEX, self._chunks), (Opcode.METADATA_INDEX, self._metadata),
        ):
            first = summary.count
            for record in group:
                record.write(summary)
            if group:
                groups.append(records.SummaryOffset(group_opcode=opcode, group_start=start + first, group_length=summary.count - first))
        offsets_start = start + summary.count
        for record in groups:
            record.write(summary)
        data = summary.end()
        self._out.write(data)
        footer = RecordBuilder()
        records.Footer(summary_start=start, summary_offset_start=offsets_start, summary_crc=0).write(footer)
        # The checksum covers the footer up to itself.
        whole = footer.end()
        crc = zlib.crc32(whole[:-4], zlib.crc32(data))
        self._out.write(whole[:-4] + crc.to_bytes(4, "little") + MCAP0_MAGIC)

    def _describe(self, name: str, items: dict) -> None:
        offset = self._out.tell()
        self._put(records.Metadata(name=name, metadata=as_texts(items)))
        self._metadata.append(records.MetadataIndex(offset=offset, length=self._out.tell() - offset, name=name))

    def _put(self, record: records.McapRecord) -> None:
        builder = RecordBuilder()
        record.write(builder)
        self._out.write(builder.end())

    def stop(self) -> None:
        self._pool.shutdown(wait=True, cancel_futures=True)
        self._out.close()


def _compressed(data: np.ndarray) -> tuple[bytes, int]:
    return pa.compress(data, codec=_COMPRESSION, asbytes=True), zlib.crc32(data)
