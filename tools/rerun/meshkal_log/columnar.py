# SPDX-License-Identifier: MIT
"""Writes tables as CSV or Parquet, a file each, in a folder."""

import json
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv
import pyarrow.parquet

from .fields import Batch, Header
from .layout import Axis, as_texts
from .run import times
from .tables import TIME_COLUMNS, Column, Table, tables_of

CSV, PARQUET = "csv", "parquet"
# Rows that are turned into columns at once: what a batch of a large network would take in one piece is some 100 MB.
SLICE_ROWS = 1 << 19
HEADER_FILE = "header.json"


def own_files(form: str) -> set[str]:
    """All that a folder of this form may have."""
    return {f"{axis.value}.{form}" for axis in Axis} | ({HEADER_FILE} if form == CSV else set())


class _TableWriter:
    """One file. `write` is called for batches in order, by one thread at a time."""

    def __init__(self, table: Table, header: Header) -> None:
        self.table, self._header = table, header
        self.schema = pa.schema([self._field(c) for c in (*TIME_COLUMNS, *table.columns)])
        self._tiled: dict[int, list[pa.Array]] = {}

    def _field(self, column: Column) -> pa.Field:
        return pa.field(column.name, pa.from_numpy_dtype(column.dtype), metadata={"unit": column.unit, "description": column.meaning})

    def write(self, run: int, batch: Batch) -> None:
        for columns in self._slices(run, batch):
            self.put(columns)

    def _slices(self, run: int, batch: Batch) -> Iterator[list[pa.Array]]:
        rows, seconds = self.table.rows, times(batch, self._header)
        steps_each = max(1, SLICE_ROWS // rows)
        for first in range(0, len(batch.step), steps_each):
            steps = slice(first, first + steps_each)
            count = len(batch.step[steps])
            fixed = iter(self._fixed(count))

            def column(c: Column) -> pa.Array:
                return next(fixed) if c.fixed is not None else self._array(np.ascontiguousarray(c.values(batch, steps)).reshape(-1))

            yield [
                pa.array(np.full(count * rows, run, dtype=np.int64)),
                self._of_steps(batch.step[steps], rows),
                self._of_steps(seconds[steps], rows),
                *map(column, self.table.columns),
            ]

    def _fixed(self, count: int) -> list[pa.Array]:
        if count not in self._tiled:
            # All slices of a batch but the last have one length.
            self._tiled = dict(list(self._tiled.items())[-1:])
            tiled = [np.tile(c.fixed, count) for c in self.table.fixed]
            self._tiled[count] = [pa.array(values, mask=values < 0 if c.name == "node" else None) for c, values in zip(self.table.fixed, tiled)]
        return self._tiled[count]

    def _array(self, values: np.ndarray) -> pa.Array:
        return pa.array(values)

    def _of_steps(self, values: np.ndarray, rows: int) -> pa.Array:
        return pa.array(np.repeat(values, rows))


class _ParquetTable(_TableWriter):
    def __init__(self, table: Table, header: Header, folder: Path, header_item: dict) -> None:
        super().__init__(table, header)
        self.schema = self.schema.with_metadata(as_texts(header_item))
        # Numbers that hardly repeat only lose time in a dictionary.
        repeated = [c.name for c in (*TIME_COLUMNS, *table.fixed)] + [c.name for c in table.changing if c.dtype.kind == "u"]
        self._writer = pa.parquet.ParquetWriter(
            folder / f"{table.name}.{PARQUET}", self.schema, compression="zstd", compression_level=1, use_dictionary=repeated
        )

    def put(self, rows: list[pa.Array]) -> None:
        self._writer.write_table(pa.Table.from_arrays(rows, schema=self.schema))

    def close(self, last: dict) -> None:
        self._writer.add_key_value_metadata(as_texts(last))
        self._writer.close()


class _CsvTable(_TableWriter):
    """Readers guess a column's type by its first rows: what is a real number is always written as one, with a point or an exponent."""

    def __init__(self, table: Table, header: Header, folder: Path, _header_item: dict) -> None:
        super().__init__(table, header)
        self._file = pa.OSFile(str(folder / f"{table.name}.{CSV}"), "wb")
        self._file.write((",".join(self.schema.names) + "\n").encode())

    def put(self, rows: list[pa.Array]) -> None:
        options = pa.csv.WriteOptions(include_header=False, quoting_style="none")
        pa.csv.write_csv(pa.Table.from_arrays(rows, names=self.schema.names), self._file, options)

    def _array(self, values: np.ndarray) -> pa.Array:
        if values.dtype.kind != "f":
            return pa.array(values.view(np.uint8) if values.dtype == bool else values)
        nan, whole = np.isnan(values), np.rint(values) == values
        if not nan.any() and not whole.any():
            return pa.array(values)
        text = pc.if_else(nan, "NaN", pc.cast(pa.array(values), pa.string()))
        if whole.any():
            bare = pc.match_substring_regex(text, "^-?[0-9]+$")
            text = pc.if_else(bare, pc.binary_join_element_wise(text, ".0", ""), text)
        return text

    def _of_steps(self, values: np.ndarray, rows: int) -> pa.Array:
        return self._array(values).take(pa.array(np.repeat(np.arange(len(values)), rows)))

    def close(self, _last: dict) -> None:
        self._file.close()


class FolderWriter:
    """All tables. Two are written at a time, while the next batch is read."""

    def __init__(self, form: str, folder: Path, header: Header, first: Batch, header_item: dict) -> None:
        self._folder, self._form, self._header_item = folder, form, header_item
        self._tables = tables_of(header, first)
        kind = _CsvTable if form == CSV else _ParquetTable
        writers = [kind(table, header, folder, header_item) for table in self._tables]
        # The longest first, so that both threads end at about the same time.
        self._writers = sorted(writers, key=lambda w: -w.table.rows * (len(w.table.columns) + len(TIME_COLUMNS)))
        self._pool = ThreadPoolExecutor(2)
        self._pending: list[Future] = []

    def batch(self, run: int, batch: Batch) -> None:
        self._wait()
        self._pending = [self._pool.submit(writer.write, run, batch) for writer in self._writers]

    def _wait(self) -> None:
        for future in self._pending:
            future.result()
        self._pending = []

    def finish(self, last: dict) -> None:
        self._wait()
        for writer in self._writers:
            writer.close(last)
        if self._form == CSV:
            columns = {t.name: {c.name: {"unit": c.unit, "meaning": c.meaning} for c in (*TIME_COLUMNS, *t.columns)} for t in self._tables}
            document = {**self._header_item, **last, "columns": columns}
            with open(self._folder / HEADER_FILE, "w", encoding="utf-8", newline="\n") as out:
                json.dump(document, out, ensure_ascii=False, default=str)
                out.write("\n")

    def stop(self) -> None:
        self._pool.shutdown(wait=True, cancel_futures=True)
