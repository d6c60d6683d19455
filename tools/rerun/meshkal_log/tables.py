# SPDX-License-Identifier: MIT
"""The tables that a log becomes (tables.md): which there are, their rows and columns, and the values of a column in a batch. A table has the same
rows in every step."""

from dataclasses import dataclass

import numpy as np

from .fields import Batch, Header, lengths
from .layout import ARRAYS, Axis, Inner, States, row_node, slot_estimator, slot_node, states_of

TIMES = ("run", "step", "time_s")


@dataclass(frozen=True)
class Column:
    name: str
    dtype: np.dtype
    unit: str
    meaning: str
    key: str = ""  # of the log's array
    at: int | None = None  # which of the several numbers that a row has in it
    fixed: np.ndarray | None = None  # (rows,): the same in every step

    def values(self, batch: Batch, steps: slice) -> np.ndarray:
        """(steps, rows) of a column that is not fixed."""
        value = getattr(batch, self.key)[steps]
        if value.ndim == 1:
            value = value[:, None]
        if self.at is not None:
            value = value[..., self.at]
            value = value[:, None] if value.ndim == 1 else value
        return value != 0 if self.dtype == bool else value


@dataclass(frozen=True)
class Table:
    name: str
    rows: int  # a step
    columns: tuple[Column, ...]  # without those of TIMES

    @property
    def fixed(self) -> tuple[Column, ...]:
        return tuple(c for c in self.columns if c.fixed is not None)

    @property
    def changing(self) -> tuple[Column, ...]:
        return tuple(c for c in self.columns if c.fixed is None)


TIME_COLUMNS = (
    Column("run", np.dtype("i8"), "", "Monte Carlo run"),
    Column("step", np.dtype("i8"), "", "step, as the log counts"),
    Column("time_s", np.dtype("f8"), "s", "time of the step; step times dt_s where the log has no times"),
)


def tables_of(header: Header, batch: Batch) -> list[Table]:
    """Those that this log has a value for. `batch` says which arrays there are; steps come first even without an array."""
    states, sizes = states_of(header), lengths(header)
    out = []
    for axis in Axis:
        changing = []
        for key, array in ARRAYS.items():
            if array.axis is axis and getattr(batch, key) is not None:
                dtype = np.dtype(bool) if array.flag else sizes[key][0].newbyteorder("=")
                changing += _columns(key, dtype, states, header)
        if changing or axis is Axis.STEP:
            fixed = _fixed(axis, header)
            rows = len(fixed[0].fixed) if fixed else 1
            if rows:
                out.append(Table(axis.value, rows, (*fixed, *changing)))
    return out


def _columns(key: str, dtype: np.dtype, states: States, header: Header) -> list[Column]:
    array = ARRAYS[key]
    if array.inner is Inner.STATES:
        squared = {"": "", **{unit: f"({unit})^2" if "/" in unit else f"{unit}^2" for unit in states.units if unit}}
        units = [squared[unit] for unit in states.units] if key == "variance" else states.units
        return [Column(f"{key}_{name}", dtype, unit, array.meaning, key, i) for i, (name, unit) in enumerate(zip(states.names, units))]
    if array.inner is Inner.POSITION:
        unit = "m^2" if header.timed else ""
        places = zip(*np.tril_indices(header.positions))
        return [Column(f"{key}_{states.position[j]}_{states.position[i]}", dtype, unit, array.meaning, key, at) for at, (i, j) in enumerate(places)]
    if array.inner is Inner.ITERATIONS:
        return [Column(f"{key}_{i}", dtype, array.unit, array.meaning, key, i) for i in range(header.iterations + 1)]
    unit = "m" if header.navigation and key in ("error", "measurements", "fault", "innovation") else array.unit
    return [Column(key, dtype, unit, array.meaning, key)]


def _fixed(axis: Axis, header: Header) -> list[Column]:
    """What tells the rows of a step apart. The node of a centre is -1."""
    of_estimator = np.array(header.estimator_nodes or (-1,), dtype=np.int32)

    def nodes(name: str, meaning: str, values: np.ndarray) -> list[Column]:
        column = Column(name, np.dtype("i4"), "", meaning, fixed=values)
        if not header.satellites or name == "node" and axis in (Axis.ESTIMATOR, Axis.SLOT):
            return [column]
        satellite = "satellite" if name in ("node", "sender") else "other_satellite"
        return [column, Column(satellite, np.dtype("i8"), "", "its number", fixed=np.array(header.satellites, dtype=np.int64)[values])]

    estimator = "node of the estimator, none for a centre"
    if axis is Axis.ESTIMATOR:
        return nodes("node", estimator, of_estimator)
    if axis is Axis.NODE:
        return nodes("node", "node of the sensor", np.arange(header.nodes, dtype=np.int32))
    if axis is Axis.ROW:
        of_row = row_node(header)
        first = np.concatenate(([0], np.cumsum(header.rows)[:-1])).astype(np.int32)
        row = Column("row", np.dtype("i4"), "", "row of the node's measurement, from 0", fixed=np.arange(len(of_row), dtype=np.int32) - first[of_row])
        return [*nodes("node", "node of the sensor", of_row), row]
    if axis is Axis.SLOT:
        return [*nodes("node", estimator, of_estimator[slot_estimator(header)]), *nodes("sender", "node that it listens to", slot_node(header))]
    if axis is Axis.PAIR:
        rows, columns = (i.astype(np.int32) for i in np.tril_indices(header.nodes))
        return [*nodes("node", "first", rows), *nodes("other", "second", columns)]
    return []
