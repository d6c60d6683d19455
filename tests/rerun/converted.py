# SPDX-License-Identifier: MIT
"""Converts synthetic logs and reads what was written, by readers that know nothing of this program."""

import csv
import io
import re
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from mcap.reader import make_reader
from synthetic import Log

import meshkal_log


def converted(log: Log, output: Path, **options) -> list[str]:
    return meshkal_log.convert(io.BufferedReader(io.BytesIO(log.data())), output, **options)


def read_parquet(folder: Path) -> dict[str, dict[str, np.ndarray]]:
    """Values by table and column."""
    out = {}
    for path in folder.iterdir():
        table = pq.read_table(path)
        assert len(set(table.column_names)) == len(table.column_names)
        out[path.stem] = {name: np.array([None] * len(table)) if table[name].null_count else table[name].to_numpy() for name in table.column_names}
    return out


def read_csv(folder: Path) -> dict[str, dict[str, np.ndarray]]:
    out = {}
    for path in folder.glob("*.csv"):
        raw = path.read_bytes()
        assert b"\r" not in raw and b'"' not in raw and raw.endswith(b"\n")
        with open(path, newline="") as stream:
            first, *rows = csv.reader(stream)
        out[path.stem] = {name: np.array([row[i] or None for row in rows], dtype=object) for i, name in enumerate(first)}
    return out


def same(found: np.ndarray, wanted: np.ndarray, text: bool) -> None:
    """Bit for bit, but for the sort of NaN; also the sign of 0."""
    wanted = wanted.reshape(-1)
    assert len(found) == len(wanted)
    if wanted.dtype == object:
        wanted, found = [w for w in wanted], [None if f is None else int(f) for f in found]
        assert found == wanted
    elif wanted.dtype.kind == "f":
        # A reader that sees "0" first takes the column for one of integers.
        assert not text or not any(re.fullmatch("-?[0-9]+|nan", f) for f in found)
        back = np.array([float(f) for f in found]).astype(wanted.dtype) if text else found
        assert back.dtype == wanted.dtype
        np.testing.assert_array_equal(back, wanted)
        there = ~np.isnan(wanted)
        np.testing.assert_array_equal(np.signbit(back[there]), np.signbit(wanted[there]))
    else:
        np.testing.assert_array_equal([int(f) for f in found], wanted)


class McapRead:
    """Messages of all topics, decoded by the definition that is in the file."""

    def __init__(self, path: Path) -> None:
        with open(path, "rb") as stream:
            source = make_reader(stream, validate_crcs=True)
            self.summary = source.get_summary()
            self.metadata = {record.name: record.metadata for record in source.iter_metadata()}
            self.messages: dict[str, list] = {}
            pools = {}
            for schema, channel, message in source.iter_messages():
                assert schema.encoding == channel.message_encoding == "protobuf"
                if schema.id not in pools:
                    pools[schema.id] = descriptor_pool.DescriptorPool()
                    for file in descriptor_pb2.FileDescriptorSet.FromString(schema.data).file:
                        pools[schema.id].Add(file)
                kind = message_factory.GetMessageClass(pools[schema.id].FindMessageTypeByName(schema.name))
                decoded = kind()
                decoded.ParseFromString(message.data)
                self.messages.setdefault(channel.topic, []).append((message, decoded))
        self.channels = {channel.topic: channel for channel in self.summary.channels.values()}

    def tables(self) -> dict[str, dict[tuple, dict[str, np.ndarray]]]:
        """By table: by row, which is the topic and the numbers that tell repeated fields apart, the columns over time."""
        out: dict[str, dict[tuple, dict[str, list]]] = {}
        for topic, messages in self.messages.items():
            table = topic.split("/")[1]
            for _, message in messages:
                repeated = [f.name for f in message.DESCRIPTOR.fields if f.message_type]
                items = getattr(message, repeated[0]) if repeated else [message]
                for at, item in enumerate(items):
                    row = out.setdefault(table, {}).setdefault((topic, at), {})
                    for field in item.DESCRIPTOR.fields:
                        row.setdefault(field.name, []).append(getattr(item, field.name))
                    if item is not message:
                        row.setdefault("step", []).append(message.step)
        return out
