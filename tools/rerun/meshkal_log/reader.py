# SPDX-License-Identifier: MIT
"""Reads a run log, item by item, into batches of arrays with time as first axis. The format is port/host/log-format.md."""

import hashlib
import io
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from operator import itemgetter

import cbor2
import numpy as np

from .fields import Batch, Decision, Header, lengths, optional
from .fields import CENTRAL, DISTRIBUTED, LINEAR, MONITORS, NAVIGATION, NAVIGATION_STATES, TRACKING

FORMAT = "meshkal-log"
FORMAT_VERSION = 1

# A batch is bounded by both, so that neither a large network nor a long run grows the memory in use.
BATCH_BYTES = 64 << 20
BATCH_STEPS = 4096

# RFC 8746 tags of the little-endian arrays that the format uses.
ARRAY_DTYPES = {64: np.dtype("u1"), 70: np.dtype("<u4"), 85: np.dtype("<f4"), 86: np.dtype("<f8")}
_MAP_MAJOR_TYPE = 5
# Steps of a run take nearly the same bytes each. An item that reaches the end of the input and is longer than so many of them was not cut:
# a length in it is damaged.
_LONGEST_CUT = 2
# Nanoseconds in 64 bits, which is what all formats of tables and recordings have.
_LARGEST_TIME_S = 9.2e9


class LogError(Exception):
    """The input is not a log that this program can read. The message is one line for the user."""


class _Cut(Exception):
    """The input ended inside or between items."""


@dataclass
class LogReader:
    """The header is read when the object is made. `batches` then reads the rest once, and leaves `end` and `warnings`. Damage ends the log where it is,
    with a warning that says where; damage before the first step that is wanted raises LogError."""

    stream: io.BufferedReader
    header: Header = field(init=False)
    header_item: dict = field(init=False, repr=False)  # as it was written, with what `header` leaves out
    # "complete", "interrupted", "failed", "damaged", "stopped" by `watch`, or None if the log was cut
    end: str | None = field(init=False, default=None)
    warnings: list[str] = field(init=False, default_factory=list)
    damage: list[str] = field(init=False, default_factory=list)  # those of the warnings that say where the log is damaged
    items: int = field(init=False, default=0)  # read until now, the header among them
    step: int | None = field(init=False, default=None)  # the last good one, of the runs that are read
    # Called after each step of any run; reading stops where it says True.
    watch: Callable[["LogReader"], bool] | None = field(init=False, default=None)

    def __post_init__(self) -> None:
        first = self.stream.peek(1)[:1]
        if not first:
            raise LogError("the input is empty")
        # A text or binary file of another kind would otherwise be decoded as some accidental CBOR item.
        if first[0] >> 5 != _MAP_MAJOR_TYPE:
            raise LogError("not a Meshkal log")
        self._decoder = cbor2.CBORDecoder(self.stream, tag_hook=typed_array)
        self._last: tuple[int, int] | None = None  # run and step of the item before
        self._tells = self.stream.seekable()
        self._start: int | None = None  # of the item that was read
        self._next_start = self.position
        self._largest = 0  # bytes of an item
        try:
            item = self._next()
        except _Cut:
            raise LogError("the input ends inside the header") from None
        except LogError:
            raise LogError("not a Meshkal log") from None
        self.header, self.header_item = parse_header(item), item
        if hashlib.sha256(self.header.scenario.encode(errors="surrogatepass")).hexdigest() != self.header.scenario_sha256:
            self.warnings.append("the scenario in the log does not match its SHA-256")

    @property
    def position(self) -> int | None:
        """In the input, in bytes; None where it does not tell."""
        return self.stream.tell() if self._tells else None

    def batches(self, run: int) -> Iterator[Batch]:
        # A running node does not know how often its clock will be put back.
        if run >= self.header.runs and self.header.source != "live":
            raise LogError(f"run {run} is not in the log, which has {self.header.runs} (numbered from 0)")
        yield from map(itemgetter(1), self.numbered_batches(run))

    def numbered_batches(self, run: int | None = None) -> Iterator[tuple[int, Batch]]:
        """Run and batch, of one run or of all, one after another."""
        pending: list[dict] = []
        pending_bytes = 0

        def taken() -> tuple[int, Batch]:
            # Nothing is kept here: a batch may have some 100 MB.
            out = pending[0]["run"], batch_of(pending, self.header)
            pending.clear()
            return out

        for item, size in self._until_damage(self._checked(run)):
            if pending and item["run"] != pending[0]["run"]:
                yield taken()
                pending_bytes = 0
            pending.append(item)
            pending_bytes += size
            if len(pending) >= BATCH_STEPS or pending_bytes >= BATCH_BYTES:
                yield taken()
                pending_bytes = 0
        if pending:
            yield taken()

    def _until_damage(self, items: Iterator) -> Iterator:
        """Ends at the first damage behind something good. LogError before it goes on to the caller."""
        good = False
        try:
            for item in items:
                good = True
                yield item
        except LogError as error:
            if not good:
                raise
            self.end = "damaged"
            self.damage.append(f"damaged at {error}")
            self.warnings += self.damage

    def _checked(self, run: int | None) -> Iterator[tuple[dict, int]]:
        """Steps that are as they should be, and how many bytes their arrays take."""
        header, wanted, may_lack = self.header, lengths(self.header), optional(self.header)
        present_first: frozenset[str] = frozenset()
        last: tuple[int, int] | None = None
        where = Where(self)
        for item in self.steps():
            if run is None or item["run"] == run:
                size = check_arrays(item, wanted, may_lack, where)
                present = frozenset(key for key in may_lack if key in wanted and key in item)
                if last is None or item["run"] != last[0]:
                    present_first = present
                if present != present_first:
                    raise LogError(f"{where}: {', '.join(sorted(present ^ present_first))} is in some steps and not in others")
                if last is not None and (item["run"], item["step"]) <= last:
                    raise LogError(f"{where}: run {item['run']}, step {item['step']} comes after run {last[0]}, step {last[1]}")
                check_times(item, header, where)
                last = item["run"], item["step"]
                self.step = item["step"]
                yield item, size
            if self.watch is not None and self.watch(self):
                self.end = "stopped"
                return

    def steps(self) -> Iterator[dict]:
        """Step items of all runs as they are, their arrays not checked."""
        count, known, where = 0, {*lengths(self.header), "run", "step"}, Where(self)
        while True:
            try:
                item = self._next()
            except _Cut:
                self._check_end()
                self.warnings.append(f"the log was cut: it ends after {count} step items, without its end item")
                return
            if not isinstance(item, dict):
                raise LogError(f"{where}: it is not a map")
            if "end" in item:
                self._finish(item, count, where)
                return
            if item.get("format") == FORMAT and item.get("scenario_sha256") == self.header.scenario_sha256:
                continue  # a live stream repeats its header for readers that come later
            for key in ("run", "step"):
                if not is_unsigned(item.get(key)):
                    raise LogError(f"{where}: {key} is missing or not an unsigned number")
            if item["run"] >= self.header.runs and self.header.source != "live":
                raise LogError(f"{where}: it is of run {item['run']}, and the header says {self.header.runs} runs")
            count += 1
            if not known.issuperset(item):
                self._left_out(item.keys() - known)
                known |= item.keys()
            yield item
            self._last = item["run"], item["step"]

    def _left_out(self, keys: set) -> None:
        self.warnings.append(f"left out, because this program does not know what it is: {', '.join(sorted(map(str, keys)))}")

    def _check_end(self) -> None:
        if self._tells and 0 < _LONGEST_CUT * self._largest < self.position - self._next_start:
            raise LogError(f"{Where(self, unread=True)}: it does not end, a length in it is wrong")

    def _finish(self, item: dict, count: int, where: object) -> None:
        if item["end"] not in ("complete", "interrupted", "failed"):
            raise LogError(f"{where}: end is neither complete nor interrupted nor failed")
        self.end = item["end"]
        if self.end == "interrupted":
            self.warnings.append(f"the run was interrupted after {count} step items")
        if self.end == "failed":
            self.warnings.append(f"the run failed after {count} step items: a node could not go on")
        if item.get("items") != count:
            self.warnings.append(f"the end item says {item.get('items')} step items, the log has {count}")

    def _next(self) -> object:
        try:
            item = self._decoder.decode()
        except (cbor2.CBORDecodeEOF, EOFError):
            raise _Cut from None
        except OSError:
            raise
        # Damaged input reaches the decoder's constructors too, which raise whatever they like.
        except Exception as error:
            reason = " ".join(str(error).split()) or type(error).__name__
            raise LogError(f"{Where(self, unread=True)}: {reason}") from None
        self.items += 1
        if self._tells:
            self._start, self._next_start = self._next_start, self.stream.tell()
            self._largest = max(self._largest, self._next_start - self._start)
        return item


class Where:
    """The place of the item that was read, or of the one behind it that could not be, in words when it comes to that."""

    def __init__(self, reader: LogReader, *, unread: bool = False) -> None:
        self._reader, self._unread = reader, unread

    def __str__(self) -> str:
        reader, last = self._reader, self._reader._last
        start = reader._next_start if self._unread else reader._start
        byte = "" if start is None else f"byte {start}"
        run = f"run {last[0]}, " if last and (reader.header.runs > 1 or last[0]) else ""
        after = f"after {run}step {last[1]}" if last else ""
        place = ", ".join(filter(None, (byte, after)))
        return f"item {reader.items + self._unread}" + (f" ({place})" if place else "")


def typed_array(*arguments: object) -> object:
    """The tag hook of a decoder: an RFC 8746 array of the format becomes an array, any other tag stays."""
    # cbor2 calls with (decoder, tag) up to version 5, and with (tag, immutable) from version 6.
    tag = next(argument for argument in arguments if isinstance(argument, cbor2.CBORTag))
    dtype = ARRAY_DTYPES.get(tag.tag)
    if dtype is None or not isinstance(tag.value, bytes):
        return tag
    return np.frombuffer(tag.value, dtype)


def is_unsigned(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value < 1 << 63


def _is_finite_number(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and bool(np.isfinite(value))


def parse_header(item: object) -> Header:
    """Raises LogError if the item is no header of this version, or something in it cannot be."""
    if not isinstance(item, dict) or item.get("format") != FORMAT:
        raise LogError("not a Meshkal log")
    version = item.get("format_version")
    if version != FORMAT_VERSION:
        raise LogError(f"log format version {version!r} is not supported, only version {FORMAT_VERSION}")

    def take(key: str, valid: object) -> object:
        if key not in item or not valid(item[key]):
            raise LogError(f"header: {key} is missing or wrong")
        return item[key]

    def text(value: object) -> bool:
        return isinstance(value, str)

    def one_of(*allowed: str) -> object:
        return lambda value: isinstance(value, str) and value in allowed

    def positive(value: object) -> bool:
        return is_unsigned(value) and value > 0

    nodes = take("nodes", positive)
    estimators = take("estimators", positive)
    kind = take("kind", one_of(TRACKING, NAVIGATION)) if "kind" in item else LINEAR
    filter_name = take("filter", one_of(*CENTRAL[kind], *DISTRIBUTED[kind]))
    central = filter_name in CENTRAL[kind]
    monitored = item.get("monitor", "none") != "none"
    some = "estimator_nodes" in item and not central
    if not some and estimators != (1 if central else nodes):
        raise LogError(f"header: {estimators} estimators do not fit filter {filter_name} with {nodes} nodes")

    def estimator_nodes_valid(value: object) -> bool:
        valid = isinstance(value, list) and len(value) == estimators and all(is_unsigned(k) and k < nodes for k in value)
        return valid and all(i < j for i, j in zip(value, value[1:]))

    def satellites_valid(value: object) -> bool:
        return isinstance(value, list) and len(value) == len(set(value)) == nodes and all(map(is_unsigned, value))

    def rows_valid(value: object) -> bool:
        return isinstance(value, list) and len(value) == nodes and all(map(is_unsigned, value))

    def slots_valid(value: object) -> bool:
        return (
            isinstance(value, list)
            and len(value) == estimators
            and all(isinstance(s, list) and s and all(is_unsigned(node) and node < nodes for node in s) for s in value)
        )

    return Header(
        program=take("program", text),
        scenario=take("scenario", text),
        scenario_sha256=take("scenario_sha256", text),
        filter=filter_name,
        real=take("real", one_of("float64", "float32")),
        source=take("source", one_of("drawn", "recorded", "live")),
        seed=take("seed", lambda value: isinstance(value, int)),
        runs=take("runs", positive),
        steps=take("steps", is_unsigned),
        loss=take("loss", _is_finite_number),
        dt_s=take("dt_s", lambda value: _is_finite_number(value) and value > 0),
        states=take("states", (lambda value: value == NAVIGATION_STATES) if kind == NAVIGATION else positive),
        positions=take("positions", lambda value: is_unsigned(value) and (value == 3 if kind == NAVIGATION else value <= 3)),
        nodes=nodes,
        estimators=estimators,
        rows=tuple(take("rows", rows_valid)),
        slots=tuple(tuple(s) for s in take("slots", slots_valid)),
        estimator_nodes=tuple(take("estimator_nodes", estimator_nodes_valid)) if some else () if central else tuple(range(nodes)),
        kind=kind,
        start_s=take("start_s", _is_finite_number) if kind != LINEAR else 0.0,
        iterations=take("iterations", is_unsigned) if kind == TRACKING else 0,
        protocol=take("protocol", text) if kind == TRACKING else "",
        increments=take("increments", is_unsigned) if kind == TRACKING else 0,
        gate=take("gate", lambda value: _is_finite_number(value) and 0 <= value < 1) if kind == TRACKING else 0.0,
        monitor=take("monitor", one_of(*MONITORS)) if monitored else "",
        monitor_window=take("monitor_window", positive) if monitored else 0,
        monitor_false_alarm=take("monitor_false_alarm", lambda value: _is_finite_number(value) and 0 < value < 1) if monitored else 0.0,
        satellites=tuple(take("satellites", satellites_valid)) if kind == NAVIGATION else (),
        truth=take("truth", text) if "truth" in item else "",
    )


def check_arrays(item: dict, lengths: dict[str, tuple[np.dtype, int]], optional: tuple[str, ...], where: object) -> int:
    """The bytes that they take. Raises LogError if one is not as it should be."""
    size = 0
    for key, (dtype, length) in lengths.items():
        value = item.get(key)
        if value is None and key in optional:
            continue
        if not isinstance(value, np.ndarray) or value.dtype != dtype:
            raise LogError(f"{where}: {key} is missing or not an array of {dtype.name}")
        if len(value) != length:
            raise LogError(f"{where}: {key} has {len(value)} numbers instead of {length}")
        size += value.nbytes
    return size


def check_times(item: dict, header: Header, where: object) -> None:
    """Raises LogError if the item's time is none, or a decision of a log that has times is unknown."""
    if header.timed:
        _check_timed(item, where)
    elif not item["step"] * header.dt_s < _LARGEST_TIME_S:
        raise LogError(f"{where}: step {item['step']} with dt_s = {header.dt_s:g} is beyond the clock (292 years)")


def _check_timed(item: dict, where: object) -> None:
    time_s = float(item["time_s"][0])
    if not np.isfinite(time_s):
        raise LogError(f"{where}: time_s is not finite")
    if not abs(time_s) < _LARGEST_TIME_S:
        raise LogError(f"{where}: time_s = {time_s:g} is beyond the clock (292 years)")
    largest = int(item["decision"].max(initial=0))
    if largest >= Decision.LOST:
        raise LogError(f"{where}: decision {largest} is unknown")


def batch_of(items: list[dict], header: Header) -> Batch:
    """Of step items of one run that are checked."""
    def stack(key: str) -> np.ndarray | None:
        return np.stack([item[key] for item in items]) if key in items[0] else None

    arrays = {key: stack(key) for key in lengths(header)}
    for key in ("estimate", "variance", "position_covariance"):
        if arrays[key] is not None:
            arrays[key] = arrays[key].reshape(len(items), header.estimators, -1)
    for key in ("time_s", "disagreement"):
        if arrays.get(key) is not None:
            arrays[key] = arrays[key][:, 0]
    return Batch(step=np.array([item["step"] for item in items], dtype=np.int64), **arrays)
