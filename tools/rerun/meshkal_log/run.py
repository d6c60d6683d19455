# SPDX-License-Identifier: MIT
"""A run of a log as numpy arrays:

    import meshkal_log
    run = meshkal_log.read("run.cbor")
    plt.plot(run.time_s, run.error)
"""

import warnings as python_warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from .fields import Batch, Header, lengths, optional
from .layout import ARRAYS, Axis, Inner, row_node, scenario_of, slot_estimator, slot_node, states_of, symmetric
from .opening import Source, batches_of, opened


class LogWarning(UserWarning):
    """Something about a log that its reader should know: that it was cut, for instance."""


@dataclass(repr=False)
class Run:
    """One run. Arrays have the names of the log (port/host/log-format.md): `run["error"]` or `run.error`; `list(run)` names those that
    this log has. The first axis is time (T steps). Of E estimators, n states, p position states, N nodes:

    - (T, E): error, trace_covariance, theta, tolerance, nis, nis_rows, faults, nees, monitor_...
    - estimate, variance (T, E, n); position_covariance (T, E, p, p), symmetric
    - truth (T, n); disagreement (T,); consensus_disagreement (T, L + 1); correction (T, n)
    - measurements, fault, innovation, innovation_variance: (T, rows of all nodes); `row_node` says whose a row is. Innovations are those of the
      estimator of the row's node, NaN if it has none in this log
    - measurements_arrived, estimates_arrived, decision, weight and others of links: (T, slots); `slot_estimator` and
      `slot_node` say which estimator a slot belongs to and which node it listens to
    - measuring, faulty, azimuth_deg, elevation_deg: (T, N); innovation_covariance (T, N, N)

    What is 0 or 1 in the log is bool; real numbers have the log's precision."""

    header: Header
    header_item: dict  # the header as it was written
    run: int
    end: str | None  # "complete", "interrupted", or None if the log was cut
    warnings: list[str]
    step: np.ndarray  # (T,)
    time_s: np.ndarray  # (T,), by the length of a step where the log has no times
    scenario: dict  # the scenario file
    state_names: tuple[str, ...]  # of a linear scenario "0", "1", ..
    slot_estimator: np.ndarray  # (slots,), from 0 to E - 1
    slot_node: np.ndarray  # (slots,)
    row_node: np.ndarray  # (rows of all nodes,)
    arrays: dict[str, np.ndarray]

    @property
    def estimator_nodes(self) -> tuple[int, ...]:
        """The node of each estimator; empty for a centre."""
        return self.header.estimator_nodes

    def __getitem__(self, key: str) -> np.ndarray:
        try:
            return self.arrays[key]
        except KeyError:
            raise KeyError(f"the log has no {key}; it has {', '.join(self.arrays)}") from None

    def __getattr__(self, key: str) -> np.ndarray:
        arrays = self.__dict__.get("arrays", {})
        if key in arrays:
            return arrays[key]
        raise AttributeError(f"the log has no {key}; it has {', '.join(arrays)}")

    def __iter__(self) -> Iterator[str]:
        return iter(self.arrays)

    def __contains__(self, key: str) -> bool:
        return key in self.arrays

    def __len__(self) -> int:
        return len(self.arrays)

    def __repr__(self) -> str:
        header = self.header
        of = "a centre" if header.central else f"{header.estimators} nodes"
        return f"<run {self.run} of {header.filter}, {of}, {len(self.step)} steps, {self.end or 'cut'}: {', '.join(self.arrays)}>"

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self.arrays]

    def estimator(self, node: int) -> int:
        """Where node `node` is on the axis of estimators; 0 for a centre."""
        if self.header.central:
            return 0
        if node not in self.estimator_nodes:
            raise KeyError(f"node {node} has no estimator in this log")
        return self.estimator_nodes.index(node)

    def readings(self, node: int) -> np.ndarray:
        """(T, rows of the node): its measurements."""
        return self["measurements"][:, self.row_node == self._node(node)]

    def slots(self, node: int) -> np.ndarray:
        """Where the slots of the estimator of `node` are in arrays over slots."""
        return np.flatnonzero(self.slot_estimator == self.estimator(node))

    def _node(self, node: int) -> int:
        if not 0 <= node < self.header.nodes:
            raise KeyError(f"there is no node {node}: they are numbered from 0 to {self.header.nodes - 1}")
        return node


def read(source: Source | Sequence[Source], run: int = 0) -> Run:
    """The run `run` of a log: a path, or a binary stream. A list of paths of logs that nodes of one network have written is read as one log.
    A log that was cut is read up to the cut; that and the like is in `Run.warnings` and given as LogWarning. Raises LogError, OSError.
    Memory: the arrays once, and the largest of them twice while they are put together."""
    with opened(source) as reader:
        parts = _Parts(reader.header)
        for _, batch in batches_of(reader, run):
            parts.add(batch)
            del batch
        out = parts.run(run, reader)
    _tell(out.warnings, source)
    return out


def read_runs(source: Source) -> list[Run]:
    """All runs of a log that have a step, in one pass."""
    out: list[Run] = []
    with opened(source) as reader:
        parts, current = _Parts(reader.header), None
        for number, batch in batches_of(reader, None):
            if current not in (None, number):
                out.append(parts.run(current, reader))
                parts = _Parts(reader.header)
            current = number
            parts.add(batch)
        if current is not None:
            out.append(parts.run(current, reader))
    for each in out:  # they are only known now
        each.end, each.warnings = reader.end, list(reader.warnings)
    _tell(reader.warnings, source)
    return out


def _tell(texts: list[str], source: object) -> None:
    name = source if isinstance(source, (str, bytes)) or hasattr(source, "__fspath__") else "log"
    for text in texts:
        python_warnings.warn(f"{name}: {text}", LogWarning, stacklevel=3)


class _Parts:
    """Arrays of one run, batch by batch."""

    def __init__(self, header: Header) -> None:
        self._header = header
        self._parts: dict[str, list[np.ndarray]] = {"step": [], "time_s": []}

    def add(self, batch: Batch) -> None:
        self._parts["step"].append(batch.step)
        self._parts["time_s"].append(times(batch, self._header))
        for key, array in ARRAYS.items():
            value = getattr(batch, key)
            if value is None:
                continue
            if array.inner is Inner.POSITION:
                value = symmetric(value, self._header.positions)
            elif array.axis is Axis.PAIR:
                value = symmetric(value, self._header.nodes)
            self._parts.setdefault(key, []).append(value != 0 if array.flag else value)

    def run(self, number: int, reader: object) -> Run:
        header = self._header
        if not self._parts["step"]:
            self.add(nothing(header))
        whole = {}
        for key in list(self._parts):
            # Each list goes when its array is there, so that only one array is there twice.
            parts = self._parts.pop(key)
            whole[key] = parts[0] if len(parts) == 1 else np.concatenate(parts)
            del parts
        return Run(
            header=header,
            header_item=reader.header_item,
            run=number,
            end=reader.end,
            warnings=list(reader.warnings),
            step=whole.pop("step"),
            time_s=whole.pop("time_s"),
            scenario=scenario_of(header),
            state_names=states_of(header).names,
            slot_estimator=slot_estimator(header),
            slot_node=slot_node(header),
            row_node=row_node(header),
            arrays=whole,
        )


def times(batch: Batch, header: Header) -> np.ndarray:
    return batch.step * header.dt_s if batch.time_s is None else batch.time_s


def nothing(header: Header) -> Batch:
    """A batch of no step. What a log may leave out is left out."""
    arrays = {}
    for key, (dtype, length) in lengths(header).items():
        if key in optional(header):
            continue
        shape = (0,) if key == "time_s" else (0, header.estimators, header.states) if key == "estimate" else (0, length)
        arrays[key] = np.zeros(shape, dtype=dtype)
    return Batch(step=np.zeros(0, dtype=np.int64), **arrays)
