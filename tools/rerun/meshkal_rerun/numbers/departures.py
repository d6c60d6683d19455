# SPDX-License-Identifier: MIT
"""When an estimator went wrong: episodes in which its error, or its test quantity, departs from what is usual. Numbers only, no rerun.

The error of several estimators: usual is the network's median in the same step, or its settled level if that is larger, times how much
worse this estimator is than most throughout. Few estimators, the network's median itself, and a centre have their own settled level. An
episode is where the error is twice the usual, and three times in three steps running. Before an error has come down to its settled level
for the first time it settles, and does not depart. Levels are lower quartiles over time, so that a fault may last for most of a run.

The test quantity, which needs no truth: a cumulative sum of the normalised innovations squared beyond half as many again as expected
(Page's test). It rises where innovations are too large, and the lowest and highest point of the rise are begin and end. The sum of an
estimator whose model fits exceeds h in a step with a probability of at most exp(-r h), where E exp(r (x - 1.5)) = 1 for x chi-square with
one degree of freedom (Lundberg's bound).
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from meshkal_log.fields import Batch, Header
from . import derive, quantiles
from .silence import Silence, Silences

NETWORK = -1  # in place of the number of an estimator
ON, OFF = 3.0, 2.0
SUSTAINED = 3  # steps running
_BRIDGED = 3  # steps below OFF that do not end an episode
_ALONE = 3  # so many estimators have no median to be compared with
_DRIFT = 1.5
_FALSE_STEP = 1e-6


@dataclass(frozen=True)
class Episode:
    of_error: bool  # or of the test quantity
    estimator: int  # or NETWORK
    begin_s: float
    end_s: float  # the last instant inside
    peak_s: float
    begin_step: int
    end_step: int
    lasts: bool  # to the end of the run
    ratio: float  # at the peak: the error over what is usual for it; or the test quantity, 1 is expected
    value: float  # the error at the peak; or as `ratio`
    against: float  # at the peak: the error over the network's median; NaN where there is none


def serious(episode: Episode) -> tuple[bool, float]:
    """By how serious they are: errors before test quantities."""
    return episode.of_error, episode.ratio


@dataclass(frozen=True)
class Departures:
    watched: bool = False  # else nothing is known
    episodes: tuple[Episode, ...] = ()  # in order of their begins
    of_position: bool = False  # the error is that of the position, in metres
    levels: np.ndarray | None = None  # (E,): settled level of the error over that of most estimators; None without truth
    silences: tuple[tuple[Silence, Episode], ...] = ()  # with their times, in an episode without numbers
    missing: np.ndarray | None = None  # (E,): share of others' messages that did not arrive

    def of(self, estimator: int) -> tuple[Episode, ...]:
        return tuple(episode for episode in self.episodes if episode.estimator == estimator)

    def worst(self, estimator: int) -> Episode | None:
        """The most serious episode."""
        return max(self.of(estimator), key=serious, default=None)


class Watch:
    """Takes all batches of a run; keeps ten bytes a step and estimator at most. most: of a run that goes on, batches beyond so many steps are
    forgotten, the oldest first."""

    def __init__(self, header: Header, most: int | None = None) -> None:
        self._header, self._most, self._forgotten = header, most, 0
        self._steps: list[np.ndarray] = []
        self._seconds: list[np.ndarray] = []
        self._error: list[np.ndarray] = []
        self._nis: list[np.ndarray] = []
        self._rows: list[np.ndarray] = []
        self._of_position = False
        self._silences = Silences(header)

    def batch(self, batch: Batch, each: dict[str, np.ndarray]) -> None:
        """each: of survey.quantities."""
        self._steps.append(batch.step)
        self._seconds.append(seconds(batch, self._header))
        self._of_position = self._header.timed and "position_error" in each
        error = each["position_error"] if self._of_position else derive.known_error(batch)
        with np.errstate(over="ignore"):
            self._nis.append(batch.nis.astype(np.float32))
            if error is not None:
                self._error.append(error.astype(np.float32))
        self._silences.batch(batch)
        self._rows.append(np.minimum(batch.nis_rows, np.iinfo(np.uint16).max).astype(np.uint16))
        while self._most and len(self._steps) > 1 and sum(map(len, self._steps)) > self._most:
            self._forgotten += len(self._steps[0])
            for kept in (self._steps, self._seconds, self._error, self._nis, self._rows):
                del kept[:1]

    def departures(self) -> Departures:
        if not self._steps:
            return Departures()
        step, time_s = np.concatenate(self._steps), np.concatenate(self._seconds)
        found = [(False, *row) for row in test_episodes(np.concatenate(self._nis).astype(np.float64), np.concatenate(self._rows))]
        levels = None
        if self._error:
            dimensions = self._header.positions if self._of_position else self._header.states
            rows, levels = error_episodes(np.concatenate(self._error).astype(np.float64), dimensions)
            found += [(True, *row) for row in rows]
        def episode(of_error: bool, who: int, begin: int, end: int, peak: int, ratio: float, value: float, against: float) -> Episode:
            return Episode(of_error, who, float(time_s[begin]), float(time_s[end]), float(time_s[peak]), int(step[begin]), int(step[end]),
                           end == len(step) - 1, ratio, value, against)

        episodes = sorted((episode(*row) for row in found), key=lambda e: (e.begin_s, e.estimator, e.of_error))
        silences, missing = self._silences.so_far()
        silences = [replace(s, begin=max(s.begin - self._forgotten, 0), end=s.end - self._forgotten) for s in silences if s.end >= self._forgotten]
        timed = tuple((s, episode(False, s.estimator, s.begin, s.end, s.begin, math.nan, math.nan, math.nan)) for s in silences)
        return Departures(True, tuple(episodes), self._of_position, levels, timed, missing)


def seconds(batch: Batch, header: Header) -> np.ndarray:
    return batch.step * header.dt_s if batch.time_s is None else batch.time_s


def error_episodes(error: np.ndarray, dimensions: int) -> tuple[list[tuple], np.ndarray]:
    """error: (T, E); dimensions: of the vectors that it is the norms of. Of each episode the estimator, the rows of begin, end and peak, and ratio, value
    and against as in `Episode`; and the levels."""
    median = quantile(error, 0.5, axis=1)
    # From the lower quartile to the median of a norm.
    up = math.sqrt(quantiles.chi_square(0.5, dimensions) / quantiles.chi_square(0.75, dimensions))
    level = quantile(error, 0.25, axis=0)
    typical = quantile(median, 0.25, axis=0) * up
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        levels = level / quantile(level, 0.5, axis=0)
        if error.shape[1] > _ALONE:
            worse = np.where(levels > 1.0, levels, 1.0)
            usual, settled = np.maximum(median, typical)[:, None] * worse, typical * worse
            # The last column is the network.
            usual = np.concatenate([usual, np.full((len(error), 1), typical)], axis=1)
            error, settled = np.concatenate([error, median[:, None]], axis=1), np.append(settled, typical)
        else:
            usual = settled = level * up
        ratio = np.where(np.logical_or.accumulate(error <= settled, axis=0), error / usual, 0.0)
        against = error / median[:, None]
    out = []
    for column in np.flatnonzero(_sustained(ratio >= ON).any(axis=0)):
        who = NETWORK if column == len(level) else int(column)
        for begin, end in _spells(ratio[:, column]):
            peak = begin + int(np.nanargmax(ratio[begin : end + 1, column]))
            other = math.nan if who == NETWORK or len(level) <= _ALONE else float(against[peak, column])
            out.append((who, begin, end, peak, float(ratio[peak, column]), float(error[peak, column]), other))
    return out, levels


def _sustained(above: np.ndarray) -> np.ndarray:
    if len(above) < SUSTAINED:
        return np.zeros((0, *above.shape[1:]), dtype=bool)
    return np.logical_and.reduce([above[i : len(above) - SUSTAINED + 1 + i] for i in range(SUSTAINED)])


def _spells(ratio: np.ndarray) -> list[tuple[int, int]]:
    """First and last row of each stretch above OFF that has SUSTAINED above ON. Unknown rows belong to what was before them."""
    known = np.maximum.accumulate(np.where(np.isnan(ratio), 0, np.arange(len(ratio))))
    held = np.nan_to_num(ratio[known], nan=0.0, posinf=math.inf)
    edges = np.diff(np.concatenate([[0], (held > OFF).astype(np.int8), [0]]))
    begins, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1
    apart = begins[1:] - ends[:-1] - 1 > _BRIDGED
    begins, ends = begins[np.append(True, apart)], ends[np.append(apart, True)]
    return [(int(begin), int(end)) for begin, end in zip(begins, ends) if _sustained(held[begin : end + 1] >= ON).any()]


def test_episodes(nis: np.ndarray, rows: np.ndarray) -> list[tuple]:
    """nis, rows: (T, E). As `error_episodes`, with the test quantity in place of ratio and value."""
    rows = rows.astype(np.float64)
    limit = threshold()
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        quantity = nis / rows
        # A model that is off throughout has its own level; one that is too careful has none.
        lower = quantiles.chi_square(0.75, rows) / rows
        level = quantile(quantity / lower, 0.25, axis=0)
        beyond = rows * (quantity / np.where(level > 1.0, level, 1.0) - _DRIFT)
    beyond = np.clip(np.nan_to_num(beyond, nan=0.0, posinf=math.inf), None, 10.0 * limit)
    total = np.concatenate([np.zeros((1, nis.shape[1])), np.cumsum(beyond, axis=0)])
    risen = (total - np.minimum.accumulate(total, axis=0)).max(axis=0) >= limit
    out = []
    for column in np.flatnonzero(risen):
        for begin, end in _rises(total[:, column], limit):
            some = np.nan_to_num(quantity[begin : end + 1, column], nan=0.0, posinf=math.inf)
            peak = begin + int(some.argmax())
            out.append((int(column), begin, end, peak, float(some.max()), float(some.max()), math.nan))
    return out


def threshold() -> float:
    """h, so that exp(-r h) is the probability of a false step."""
    low, high = 1e-3, 0.4999
    for _ in range(100):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if -0.5 * math.log1p(-2.0 * middle) < _DRIFT * middle else (low, middle)
    return -math.log(_FALSE_STEP) / low


def _rises(total: np.ndarray, limit: float) -> list[tuple[int, int]]:
    """First and last row of each rise by `limit` at least; it is over where the sum has fallen by as much. One from the first row on is settling,
    unless it lasts for half of the run."""
    out, start, last = [], 0, len(total) - 1
    while True:
        rest = total[start:]
        over = np.flatnonzero(rest - np.minimum.accumulate(rest) >= limit)
        if not len(over):
            return out
        at = start + int(over[0])
        low = start + int(total[start : at + 1].argmin())
        rest = total[at:]
        under = np.flatnonzero(np.maximum.accumulate(rest) - rest >= limit)
        stop = at + int(under[0]) if len(under) else last
        high = at + int(total[at : stop + 1].argmax())
        if low > 0 or high - low > last / 2:
            out.append((low, high - 1))  # total[i] is the sum of the rows before i
        if not len(under):
            return out
        start = stop


def quantile(values: np.ndarray, q: float, axis: int) -> np.ndarray:
    """Leaving NaN out and keeping infinity; NaN where nothing is known. Between two values their mean."""
    ordered = np.sort(values, axis=axis)  # NaN last
    count = np.count_nonzero(~np.isnan(values), axis=axis, keepdims=True)
    place = q * np.maximum(count - 1, 0)
    low, high = (np.take_along_axis(ordered, f(place).astype(np.intp), axis=axis) for f in (np.floor, np.ceil))
    return np.squeeze(np.where(low == high, low, 0.5 * (low + high)), axis=axis)
