# SPDX-License-Identifier: MIT
"""Tables as protobuf messages of MCAP records (tables.md). All numbers are of fixed length, so that the records of a step have the same places in
every step: a template is copied and its numbers are put in, all steps at once."""

from dataclasses import dataclass

import numpy as np
from google.protobuf import descriptor_pb2

from .fields import Batch, Header
from .layout import Axis
from .run import times
from .tables import Column, Table

PACKAGE = "meshkal"
_MESSAGE = {
    Axis.STEP: "Step", Axis.ESTIMATOR: "Node", Axis.NODE: "Sensor", Axis.ROW: "Reading", Axis.SLOT: "Links", Axis.PAIR: "InnovationCovariance"
}
# Tables with more rows than one would want topics: the rows of a topic are a repeated field of one message. Its name, and that of its type.
_REPEATED = {Axis.SLOT: ("links", "Link"), Axis.PAIR: ("pairs", "Pair")}

_ITEMS = 2  # number of the repeated field, after the step

_Field = descriptor_pb2.FieldDescriptorProto
_VARINT, _BITS64, _BYTES, _BITS32 = 0, 1, 2, 5
# Of a column: protobuf's type, wire type, and the bytes. One byte of a varint holds up to 127: a flag, or a decision.
_WIRE = {
    "b1": (_Field.TYPE_BOOL, _VARINT, "u1"),
    "u1": (_Field.TYPE_UINT32, _VARINT, "u1"),
    "u4": (_Field.TYPE_FIXED32, _BITS32, "<u4"),
    "i4": (_Field.TYPE_FIXED32, _BITS32, "<u4"),
    "i8": (_Field.TYPE_FIXED64, _BITS64, "<u8"),
    "f4": (_Field.TYPE_FLOAT, _BITS32, "<f4"),
    "f8": (_Field.TYPE_DOUBLE, _BITS64, "<f8"),
}
_RECORD = [(".opcode", "u1"), (".length", "<u8"), (".channel", "<u2"), (".sequence", "<u4"), (".log_time", "<u8"), (".publish_time", "<u8")]
_MESSAGE_OPCODE, _LENGTH_BEFORE = 5, 9
_STEP = Column("step", np.dtype("i8"), "", "step, as the log counts", fixed=np.zeros(1))
_TIME = Column("time_s", np.dtype("f8"), "s", "time of the step", fixed=np.zeros(1))


@dataclass(frozen=True)
class Topic:
    name: str
    message: str
    metadata: dict[str, str]


@dataclass(frozen=True)
class _Group:
    """Topics of one table whose messages have one length; `rows` (topics,) or (topics, repeated) says where in the table their numbers are."""

    table: Table
    axis: Axis
    rows: np.ndarray
    first_topic: int


class Messages:
    """`topics` in the order of their records in a step, `schema` a FileDescriptorSet, `fill` gives the records of some steps as bytes."""

    def __init__(self, header: Header, tables: list[Table]) -> None:
        self._header = header
        self.topics: list[Topic] = []
        self._groups: list[_Group] = []
        file = descriptor_pb2.FileDescriptorProto(name="meshkal.proto", package=PACKAGE, syntax="proto3")
        for table in tables:
            self._add(table, Axis(table.name), file)
        self.schema = descriptor_pb2.FileDescriptorSet(file=[file]).SerializeToString()
        self._dtype = np.dtype([(str(i), _record(g), (len(g.rows),)) for i, g in enumerate(self._groups)])
        self._template = self._make_template()
        self.step_bytes = self._dtype.itemsize
        # Where each topic's record begins.
        places = [self._dtype.fields[str(i)][1] + _record(g).itemsize * np.arange(len(g.rows)) for i, g in enumerate(self._groups)]
        self.offsets = np.concatenate(places).astype(np.uint64)

    def _add(self, table: Table, axis: Axis, file: descriptor_pb2.FileDescriptorProto) -> None:
        names, metadata, rows = _topics(table, axis, self._header)
        message = file.message_type.add(name=_MESSAGE[axis])
        for column, number in _outer(axis, table):
            _describe(message, column, number)
        if axis in _REPEATED:
            name, kind = _REPEATED[axis]
            message.field.add(
                name=name, json_name=name, number=_ITEMS, label=_Field.LABEL_REPEATED, type=_Field.TYPE_MESSAGE, type_name=f".{PACKAGE}.{kind}"
            )
            item = file.message_type.add(name=kind)
            for column, number in _items(axis, table):
                _describe(item, column, number)
        # Messages of one length are filled together.
        lengths = [len(r) for r in rows]
        for length in sorted(set(lengths)):
            chosen = [i for i, n in enumerate(lengths) if n == length]
            places = np.array([rows[i] for i in chosen])
            self._groups.append(_Group(table, axis, places if axis in _REPEATED else places[:, 0], len(self.topics)))
            self.topics += [Topic(names[i], f"{PACKAGE}.{_MESSAGE[axis]}", metadata[i]) for i in chosen]

    def _make_template(self) -> np.ndarray:
        template = np.zeros(1, dtype=self._dtype)
        for i, group in enumerate(self._groups):
            records = template[str(i)][0]
            records[".opcode"] = _MESSAGE_OPCODE
            records[".length"] = records.dtype.itemsize - _LENGTH_BEFORE
            records[".channel"] = 1 + group.first_topic + np.arange(len(group.rows))
            _put_tags(records, _outer(group.axis, group.table))
            if group.axis in _REPEATED:
                columns = _items(group.axis, group.table)
                items = records[".items"]
                items[".tag"] = np.frombuffer(_varint(_ITEMS << 3 | _BYTES), "u1")
                items[".size"] = np.frombuffer(_varint(_size(columns)), "u1")
                _put_tags(items, columns)
                for column, _ in columns:
                    if column.fixed is not None:
                        items[column.name] = column.fixed[group.rows]
        return np.frombuffer(template.tobytes(), "u1")

    def fill(self, batch: Batch, steps: slice, log_time: np.ndarray) -> np.ndarray:
        """(T, step_bytes) bytes; `log_time` of these steps in nanoseconds."""
        out = np.empty((len(log_time), self.step_bytes), dtype=np.uint8)
        out[:] = self._template
        records = out.view(self._dtype)[:, 0]
        step = batch.step[steps]
        for i, group in enumerate(self._groups):
            of_group = records[str(i)]
            of_group[".log_time"] = of_group[".publish_time"] = log_time[:, None]
            of_group[".sequence"] = (step & 0xFFFFFFFF)[:, None]
            of_group["step"] = step[:, None]
            if group.axis is Axis.STEP:
                of_group["time_s"] = times(batch, self._header)[steps, None]
        for table in {id(g.table): g.table for g in self._groups}.values():
            for column in table.changing:
                values = column.values(batch, steps)
                for i, group in enumerate(self._groups):
                    if group.table is table:
                        target = records[str(i)][".items"] if group.axis in _REPEATED else records[str(i)]
                        target[column.name] = values[:, group.rows]
        return out


def _topics(table: Table, axis: Axis, header: Header) -> tuple[list[str], list[dict[str, str]], list]:
    """Names, metadata, and of each topic its row in the table or its rows."""
    estimators = [str(k) for k in header.estimator_nodes] or ["centre"]
    sensors = [f"satellite_{k}" for k in header.satellites] or [str(k) for k in range(header.nodes)]
    fixed = {c.name: c.fixed for c in table.fixed}
    if axis is Axis.STEP:
        return ["/steps"], [{}], [[0]]
    if axis is Axis.PAIR:
        return [f"/{table.name}"], [{}], [list(range(table.rows))]
    if axis is Axis.SLOT:
        ends = np.cumsum([len(s) for s in header.slots])
        rows = [list(range(end - len(s), end)) for s, end in zip(header.slots, ends)]
        return [f"/{table.name}/{k}" for k in estimators], [{"node": k} for k in estimators], rows
    metadata = [{name: str(values[i]) for name, values in fixed.items() if values[i] >= 0} for i in range(table.rows)]
    if axis is Axis.ESTIMATOR:
        names = [f"/{table.name}/{k}" for k in estimators]
    elif axis is Axis.NODE:
        names = [f"/{table.name}/{k}" for k in sensors]
    else:
        names = [f"/{table.name}/{sensors[k]}/{row}" for k, row in zip(fixed["node"], fixed["row"])]
    return names, metadata, [[i] for i in range(table.rows)]


def _outer(axis: Axis, table: Table) -> list[tuple[Column, int]]:
    """Columns of a message, without those that are repeated, and their numbers."""
    columns = [_STEP, *([_TIME] if axis is Axis.STEP else []), *(table.changing if axis not in _REPEATED else [])]
    return [(column, 1 + i) for i, column in enumerate(columns)]


def _items(axis: Axis, table: Table) -> list[tuple[Column, int]]:
    # Who listens is the topic.
    columns = [c for c in table.columns if not (axis is Axis.SLOT and c.name == "node")]
    return [(column, 1 + i) for i, column in enumerate(columns)]


def _describe(message: descriptor_pb2.DescriptorProto, column: Column, number: int) -> None:
    # With a name in JSON of their own, a_b and aB are no conflict.
    message.field.add(name=column.name, json_name=column.name, number=number, label=_Field.LABEL_OPTIONAL, type=_WIRE[column.dtype.str[1:]][0])


def _fields(columns: list[tuple[Column, int]]) -> list[tuple]:
    out: list[tuple] = []
    for column, number in columns:
        _, wire, form = _WIRE[column.dtype.str[1:]]
        out += [(f".tag {column.name}", "u1", (len(_varint(number << 3 | wire)),)), (column.name, form)]
    return out


def _put_tags(records: np.ndarray, columns: list[tuple[Column, int]]) -> None:
    for column, number in columns:
        records[f".tag {column.name}"] = np.frombuffer(_varint(number << 3 | _WIRE[column.dtype.str[1:]][1]), "u1")


def _size(columns: list[tuple[Column, int]]) -> int:
    return np.dtype(_fields(columns)).itemsize


def _record(group: _Group) -> np.dtype:
    form = _RECORD + _fields(_outer(group.axis, group.table))
    if group.axis in _REPEATED:
        columns = _items(group.axis, group.table)
        item = [(".tag", "u1", (len(_varint(_ITEMS << 3 | _BYTES)),)), (".size", "u1", (len(_varint(_size(columns))),)), *_fields(columns)]
        form.append((".items", np.dtype(item), (group.rows.shape[1],)))
    return np.dtype(form)


def _varint(value: int) -> bytes:
    out = bytearray()
    while value > 127:
        out.append(value & 127 | 128)
        value >>= 7
    out.append(value)
    return bytes(out)
