# SPDX-License-Identifier: MIT
"""How two logs of a network differ, over the whole run. Numbers only, no rerun."""

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from meshkal_log.fields import Batch, Header, lengths
from meshkal_log.scenario import Scenario

from . import comparison, derive
from .batch_means import Mean, batch_means
from .comparison import Beside, Both, Pairing

MAP_BINS = 512
# What holds one number or more of each estimator, and of each slot; the rest is of the network.
_OF_ESTIMATORS = ("estimate", "error", "trace_covariance", "position_covariance", "theta", "tolerance", "nis", "nis_rows", "faults", "nees", "frozen",
                  "gate_stacked_ratio", "variance", "correction", *(f"monitor_{key}" for key in (
                      "rctm", "rctm_rows", "aime", "aime_rows", "threshold", "alarm", "ended", "rho", "median")))
_OF_SLOTS = ("measurements_arrived", "estimates_arrived", "messages_arrived", "decision", "gate_ratio", "weight", "weight_statistic", "excluded",
             "isolation", "end_ratio")
_OF_OWN_SENSORS = ("innovation", "innovation_variance")


@dataclass
class Divergence:
    """Where the two logs differ in one quantity. Equal is: bit for bit, or, of different types, the same number; NaN equals NaN."""

    steps: int = 0  # compared
    differing: int = 0  # of them
    first: int | None = None  # step
    where: str = ""  # of the first, who differs
    largest: float = 0.0  # difference of two finite numbers
    unknown: bool = False  # where they differ, one of them is not finite
    pairs: np.ndarray | None = None  # (pairs,): who differs in any step; None: not of estimators


@dataclass(frozen=True)
class Extreme:
    value: float
    pair: int
    step: int


@dataclass
class Difference:
    """Sums over the steps and pairs of estimators where both errors are finite; `steps` is how many steps both logs have."""

    pairing: Pairing
    metres: bool
    quantities: dict[str, Divergence] = field(default_factory=dict)
    alone: tuple[set[str], set[str]] = field(default_factory=lambda: (set(), set()))  # quantities that only the shown log has, and only the other
    steps: int = 0
    only_mine: int = 0
    only_theirs: int = 0
    squares: np.ndarray = field(default_factory=lambda: np.zeros((2, 0)))  # (2, pairs) of the errors
    known: np.ndarray = field(default_factory=lambda: np.zeros(0))
    sums_db: np.ndarray = field(default_factory=lambda: np.zeros(0))  # (pairs,)
    known_db: np.ndarray = field(default_factory=lambda: np.zeros(0))
    rms_squares: np.ndarray = field(default_factory=lambda: np.zeros(2))  # of the RMS over all estimators of each, of the steps where both have one
    rms_known: int = 0
    better: int = 0
    equal: int = 0
    judged: int = 0
    worst: Extreme | None = None  # largest and smallest difference in dB
    best: Extreme | None = None
    farthest: Extreme | None = None  # of the estimates
    apart_squares: float = 0.0
    apart_known: int = 0
    mean: Mean = Mean(float("nan"), float("nan"), float("nan"))  # of the difference in dB
    band_db: tuple[float, float] | None = None  # what nearly all of the quantiles that are drawn are within
    map_db: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))  # (pairs, bins): mean in dB
    map_s: np.ndarray = field(default_factory=lambda: np.zeros(0))  # time of the first step of each bin

    @property
    def mean_db(self) -> np.ndarray:
        """(pairs,)"""
        with np.errstate(invalid="ignore"):
            return np.divide(self.sums_db, self.known_db, out=np.full(len(self.known_db), np.nan), where=self.known_db > 0)

    def striking(self, count: int) -> list[int]:
        """Nodes with the largest mean differences, the largest first."""
        size = np.abs(self.mean_db)
        order = np.argsort(-size, kind="stable")[:count]
        return [self.pairing.nodes[pair] for pair in order if size[pair] > 0.0] if self.pairing.nodes else []

    @property
    def first_step(self) -> int | None:
        """Where anything differs."""
        return min((d.first for d in self.quantities.values() if d.first is not None), default=None)

    @property
    def same_truth(self) -> bool | None:
        """None: at least one has none."""
        truth = self.quantities.get("truth")
        return None if truth is None or not truth.steps else truth.first is None


class Differences:
    """Takes the batches of the shown log in order, then `result`."""

    def __init__(self, first: Header, other: Header, scenario: Scenario, batches: Iterable[Batch]) -> None:
        self._headers, self._scenario = (first, other), scenario
        self._beside = Beside(first, other, batches)
        self._pairing = pairing = Pairing(first, other)
        self._out = Difference(pairing, comparison.in_metres(first, scenario))
        self._out.squares = np.zeros((2, len(pairing)))
        self._out.known, self._out.sums_db, self._out.known_db = np.zeros(len(pairing)), np.zeros(len(pairing)), np.zeros(len(pairing))
        self._columns = {key: columns for key in lengths(first) if (columns := _columns(key, first, other, pairing))}
        self._each_step: list[np.ndarray] = []  # mean difference over the pairs
        self._quantiles: list[np.ndarray] = []
        self._bins = _Bins(len(pairing))

    def batch(self, batch: Batch) -> None:
        for both in self._beside.both(batch):
            self._equality(both)
            self._apart(both)
            self._errors(both)

    def result(self) -> Difference:
        out = self._out
        out.only_mine, out.only_theirs = self._beside.finish()
        out.steps = self._beside.common
        if self._each_step:
            out.mean = batch_means(np.concatenate(self._each_step))
            drawn = np.concatenate(self._quantiles, axis=1)
            drawn = drawn[np.isfinite(drawn)]
            out.band_db = (float(np.percentile(drawn, 1)), float(np.percentile(drawn, 99))) if len(drawn) else None
            out.map_db, out.map_s = self._bins.means(), self._bins.times()
        return out

    def _equality(self, both: Both) -> None:
        for key, (mine, theirs, width) in self._columns.items():
            a, b = getattr(both.mine, key), getattr(both.theirs, key)
            if a is None or b is None:
                for values, alone in zip((a, b), self._out.alone):
                    if values is not None:
                        alone.add(key)
                continue
            a, b = (_flat(values, of) for values, of in ((a, mine), (b, theirs)))
            record = self._out.quantities.setdefault(key, Divergence(pairs=np.zeros(len(self._pairing), dtype=bool) if width else None))
            record.steps += len(a)
            differs = _differs(a, b)
            rows = np.flatnonzero(differs.any(axis=1))
            record.differing += len(rows)
            if not len(rows):
                continue
            if width:
                record.pairs |= differs.any(axis=0).reshape(-1, width).any(axis=1)
            if record.first is None:
                record.first = int(both.mine.step[rows[0]])
                record.where = self._where(np.flatnonzero(differs[rows[0]]), width)
            with np.errstate(invalid="ignore", over="ignore"):
                sizes = np.abs(a[rows].astype(np.float64) - b[rows].astype(np.float64))
            finite = np.isfinite(sizes)
            record.unknown |= bool((~finite & differs[rows]).any())
            sizes = sizes[finite]
            record.largest = max(record.largest, float(sizes.max())) if len(sizes) else record.largest

    def _where(self, columns: np.ndarray, width: int) -> str:
        """width: of the columns of a pair, 0 where they are of the network."""
        if not width or len(self._pairing) == 1:
            return ""
        pairs = np.unique(columns // width)
        return self._pairing.name(int(pairs[0])) if len(pairs) == 1 else f"{len(pairs)} of {len(self._pairing)} nodes"

    def _apart(self, both: Both) -> None:
        states = self._scenario.position_states if self._out.metres else None
        apart = comparison.distances(both.mine.estimate, both.theirs.estimate, self._pairing, states)
        self._out.apart_known += int(np.isfinite(apart).sum())
        with np.errstate(over="ignore"):
            self._out.apart_squares += float(np.nansum(np.square(apart)))
        self._out.farthest = _extreme(self._out.farthest, apart, both.mine.step, 1.0)

    def _errors(self, both: Both) -> None:
        out = self._out
        every = [comparison.errors(batch, header, self._scenario) for batch, header in zip((both.mine, both.theirs), self._headers)]
        if any(error is None for error in every):
            return
        with np.errstate(over="ignore"):
            rms = np.square([derive.root_mean_square(derive.finite(error)) for error in every])
        known = np.isfinite(rms).all(axis=0)
        out.rms_squares += rms[:, known].sum(axis=1)
        out.rms_known += int(known.sum())
        mine, theirs = every[0][:, self._pairing.mine], every[1][:, self._pairing.theirs]
        finite = np.isfinite(mine) & np.isfinite(theirs)
        with np.errstate(over="ignore"):
            out.squares += [np.square(np.where(finite, error, 0.0)).sum(axis=0) for error in (mine, theirs)]
        out.known += finite.sum(axis=0)
        judged = ~(np.isnan(mine) | np.isnan(theirs))
        out.judged += int(judged.sum())
        out.better += int((mine < theirs)[judged].sum())
        out.equal += int((mine == theirs)[judged].sum())
        apart = comparison.difference_db(mine, theirs)
        there = np.isfinite(apart)
        out.known_db += there.sum(axis=0)
        out.sums_db += np.where(there, apart, 0.0).sum(axis=0)
        out.worst = _extreme(out.worst, apart, both.mine.step, 1.0)
        out.best = _extreme(out.best, apart, both.mine.step, -1.0)
        self._each_step.append(derive.quietly(np.nanmean, apart))
        self._quantiles.append(np.stack(derive.quantiles(apart, (0.05, 0.95))))
        self._bins.add(apart, both.mine.step * self._headers[0].dt_s if both.mine.time_s is None else both.mine.time_s)


def _columns(key: str, first: Header, other: Header, pairing: Pairing) -> tuple | None:
    """Which numbers of a quantity stand side by side in both logs (None: all), and how many belong to a pair (0: not told). None if the logs have not
    the same of it."""
    mine, theirs = lengths(first)[key][1], lengths(other).get(key, (None, -1))[1]
    if theirs < 0 or not mine or not theirs:
        return None
    whole = len(pairing) == first.estimators == other.estimators
    if key in _OF_ESTIMATORS:
        # Of a centre and of a node only their estimates are of the same thing.
        if not pairing.same_kind and key != "estimate" or mine // first.estimators != theirs // other.estimators:
            return None
        width = mine // first.estimators
        return (None, None, width) if whole else (_of(pairing.mine, width), _of(pairing.theirs, width), width)
    if key in _OF_SLOTS:
        if not pairing.same_kind:
            return None
        if first.slots == other.slots:
            return None, None, 0
        same = [i for i, (a, b) in enumerate(zip(pairing.mine, pairing.theirs)) if first.slots[a] == other.slots[b]]
        if not same:
            return None
        own = [np.concatenate([h.slot_starts[at[i]] + np.arange(len(h.slots[at[i]])) for i in same])
               for h, at in ((first, pairing.mine), (other, pairing.theirs))]
        return *own, 0
    if key in _OF_OWN_SENSORS and not (pairing.same_kind and whole):
        return None
    return (None, None, 0) if mine == theirs else None


def _of(estimators: np.ndarray, width: int) -> np.ndarray:
    return (estimators[:, None] * width + np.arange(width)).reshape(-1)


def _flat(values: np.ndarray, columns: np.ndarray | None) -> np.ndarray:
    values = values.reshape(len(values), -1)
    return values if columns is None else values[:, columns]


def _differs(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    if a.dtype == b.dtype:
        bits = f"u{a.dtype.itemsize}"
        return np.ascontiguousarray(a).view(bits) != np.ascontiguousarray(b).view(bits)
    return (a != b) & ~(np.isnan(a) & np.isnan(b))


def _extreme(before: Extreme | None, values: np.ndarray, step: np.ndarray, sign: float) -> Extreme | None:
    """The larger of both, of the smaller ones if sign is -1; the earlier of equal ones."""
    known = np.where(np.isfinite(values), sign * values, -np.inf)
    t, pair = np.unravel_index(int(np.argmax(known)), known.shape)
    if known[t, pair] == -np.inf or before is not None and known[t, pair] <= sign * before.value:
        return before
    return Extreme(float(values[t, pair]), int(pair), int(step[t]))


class _Bins:
    """Means over equal numbers of consecutive steps, whatever the number of steps: where there are too many bins, each two become one."""

    def __init__(self, rows: int, bins: int = MAP_BINS) -> None:
        self._sums, self._known = np.zeros((bins, rows)), np.zeros((bins, rows))
        self._firsts = np.zeros(bins)
        self._width, self._count = 1, 0

    def add(self, values: np.ndarray, time_s: np.ndarray) -> None:
        while self._count + len(values) > len(self._sums) * self._width:
            self._halve()
        at = (self._count + np.arange(len(values))) // self._width
        bins, starts = np.unique(at, return_index=True)
        known = np.isfinite(values)
        self._sums[bins] += np.add.reduceat(np.where(known, values, 0.0), starts, axis=0)
        self._known[bins] += np.add.reduceat(known.astype(np.float64), starts, axis=0)
        fresh = self._count % self._width != 0  # the first bin has begun before
        self._firsts[bins[fresh:]] = time_s[starts[fresh:]]
        self._count += len(values)

    def _halve(self) -> None:
        half = len(self._sums) // 2
        for values in (self._sums, self._known):
            values[:half] = values[0::2] + values[1::2]
            values[half:] = 0.0
        self._firsts[:half] = self._firsts[0::2]
        self._width *= 2

    def _used(self) -> int:
        return -(-self._count // self._width)

    def means(self) -> np.ndarray:
        used = slice(self._used())
        return np.divide(self._sums[used], self._known[used], out=np.full_like(self._sums[used], np.nan), where=self._known[used] > 0).T

    def times(self) -> np.ndarray:
        return self._firsts[: self._used()].copy()
