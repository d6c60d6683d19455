# SPDX-License-Identifier: MIT
"""Logs that nodes of one network have written, each for itself, read as one log of the network."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from .fields import Batch, Header, lengths, monitor_lengths, optional
from .reader import LogError, LogReader, Where, check_arrays, check_times

SAME = ("scenario_sha256", "filter", "real", "dt_s", "source", "monitor", "monitor_window", "monitor_false_alarm")
# What holds one number or more of each slot, of each estimator, and of each row of its own sensor. The optional ones some of the logs may lack.
_SLOTS = ("measurements_arrived", "estimates_arrived")
_EACH = ("estimate", "variance", "trace_covariance", "position_covariance", "theta", "tolerance", "nis", "nis_rows", "faults")
_OWN = ("innovation", "innovation_variance")
MAY_BE_ABSENT = ("variance", *_OWN)


def _of_slots(header: Header) -> tuple[str, ...]:
    return (*_SLOTS, *(key for key in monitor_lengths(header) if not key.startswith("monitor_")))


def _of_estimators(header: Header) -> tuple[str, ...]:
    return (*_EACH, *(key for key in monitor_lengths(header) if key.startswith("monitor_")))


class JoinedReader(LogReader):
    """A step has what the nodes say of it; of a node that says nothing, nothing has arrived and all numbers are unknown. Several logs of the same
    node, one after another, are one. A truth is left out."""

    def __init__(self, readers: dict[str, LogReader]) -> None:
        self._readers = readers
        first = next(iter(readers.values())).header
        slots: dict[int, tuple[int, ...]] = {}
        for name, reader in readers.items():
            if reader.header.timed:
                raise LogError(f"{name} is the log of a {reader.header.kind} scenario, {next(iter(readers))} is not; they cannot be joined")
            for key in SAME:
                if getattr(reader.header, key) != getattr(first, key):
                    raise LogError(f"{name} does not belong to {next(iter(readers))}: its {key} is another")
            if reader.header.central:
                raise LogError(f"{name} is the log of a centre, which cannot be joined with others")
            slots |= zip(reader.header.estimator_nodes, reader.header.slots)
        nodes = tuple(sorted(slots))
        self.header = replace(first, estimators=len(nodes), estimator_nodes=nodes, slots=tuple(slots[k] for k in nodes))
        own = {"estimators": len(nodes), "estimator_nodes": list(nodes), "slots": [list(slots[k]) for k in nodes]}
        self.header_item = next(iter(readers.values())).header_item | own
        self.end, self.watch = None, None
        self.warnings, self.damage = [], []
        self.items, self.step, self._last, self._start = 0, None, None, None

    @property
    def position(self) -> int | None:
        positions = [reader.position for reader in self._readers.values()]
        return None if None in positions else sum(positions)

    def numbered_batches(self, run: int | None = None) -> Iterator[tuple[int, Batch]]:
        yield from super().numbered_batches(run)
        ends = [reader.end for reader in self._readers.values()]
        if self.end is None:
            self.end = "complete" if set(ends) == {"complete"} else "damaged" if "damaged" in ends else "interrupted" if all(ends) else None
        self.damage = [f"{name}: {text}" for name, reader in self._readers.items() for text in reader.damage]
        self.warnings = [f"{name}: {text}" for name, reader in self._readers.items() for text in reader.warnings] + self.warnings

    def steps(self) -> Iterator[dict]:
        sources = [(reader.header, _named(name, reader._until_damage(_checked(reader)))) for name, reader in self._readers.items()]
        heads = [next(items, None) for _, items in sources]
        absent = {key for key in MAY_BE_ABSENT if not any(head and key in head for head in heads)}
        while any(head is not None for head in heads):
            now = min((head["run"], head["step"]) for head in heads if head is not None)
            present = [i for i, head in enumerate(heads) if head is not None and (head["run"], head["step"]) == now]
            self.items += 1
            yield self._together(*now, [(sources[i][0], heads[i]) for i in present], absent)
            self._last = now
            for i in present:
                heads[i] = next(sources[i][1], None)

    def _together(self, run: int, step: int, parts: list, absent: set[str]) -> dict:
        item: dict = {"run": run, "step": step}
        sizes = lengths(self.header)
        groups = (_of_slots(self.header), _of_estimators(self.header), _OWN)
        of_slots, of_estimators, own = ([key for key in keys if key not in absent] for keys in groups)
        rows = np.concatenate(([0], np.cumsum(self.header.own_rows)))
        for key in ("measurements", *of_slots, *of_estimators, *own):
            dtype, length = sizes[key]
            item[key] = np.full(length, np.nan if dtype.kind == "f" else 0, dtype=dtype)
        for header, part in parts:
            item["measurements"] = np.where(np.isnan(item["measurements"]), part["measurements"], item["measurements"])
            at = row = 0
            for i, (node, slots) in enumerate(zip(header.estimator_nodes, header.slots)):
                k = self.header.estimator_nodes.index(node)
                start = int(self.header.slot_starts[k])
                for key in of_slots:
                    item[key][start : start + len(slots)] = part[key][at : at + len(slots)]
                at += len(slots)
                for key in of_estimators:
                    width = sizes[key][1] // self.header.estimators
                    if width and key in part:
                        item[key][k * width : (k + 1) * width] = part[key][i * width : (i + 1) * width]
                for key in own:
                    if key in part:
                        item[key][rows[k] : rows[k + 1]] = part[key][row : row + header.own_rows[i]]
                row += header.own_rows[i]
        if not self.header.positions:
            del item["position_covariance"]
        return item


def _named(name: str, items: Iterator[dict]) -> Iterator[dict]:
    try:
        yield from items
    except LogError as error:
        raise LogError(f"{name}: {error}") from None


def _checked(reader: LogReader) -> Iterator[dict]:
    """Items whose arrays are as the log's own header says, so that none of them can shift another's."""
    sizes, last, where = lengths(reader.header), None, Where(reader)
    needed = ("estimates_arrived", *(("position_covariance",) if reader.header.positions else ()))
    for item in reader.steps():
        check_arrays(item, sizes, optional(reader.header), where)
        for key in needed:
            if key not in item:
                raise LogError(f"{where}: {key} is missing")
        if last is not None and (item["run"], item["step"]) <= last:
            raise LogError(f"{where}: run {item['run']}, step {item['step']} comes after run {last[0]}, step {last[1]}")
        check_times(item, reader.header, where)
        last = (item["run"], item["step"])
        yield item
