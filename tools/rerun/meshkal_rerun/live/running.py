# SPDX-License-Identifier: MIT
"""What a survey finds, of a run that goes on."""

import time
from dataclasses import replace

import numpy as np

from meshkal_log.fields import Batch, Header
from meshkal_log.scenario import Scenario
from ..numbers.departures import Departures, Watch
from ..numbers.survey import Survey, per_estimator, shade_db, unknown

_ROWS = 512
# Departures are looked for in the last steps, of all estimators together so many; looking takes a while, and is not done again for little.
_WATCHED = 1_000_000
_WATCHED_STEPS = 10_000
_LOOK_S = 5.0


class Running:
    """Memory is bounded: of long runs only every second, fourth, ... row is kept for the range of colours."""

    def __init__(self, header: Header, scenario: Scenario) -> None:
        self._header, self._scenario = header, scenario
        self._squares, self._known = np.zeros(header.estimators), np.zeros(header.estimators)
        self._steps = 0
        self._has_truth = False
        self._rows: list[np.ndarray] = []
        self._stride = 1
        self._watch = Watch(header, min(_WATCHED_STEPS, max(_WATCHED // header.estimators, 100)))
        self._departures, self._looked = Departures(), 0.0

    def batch(self, batch: Batch) -> None:
        each = per_estimator(batch, self._header, self._scenario)
        self._has_truth = "error_db" in each or "position_error" in each
        self._watch.batch(batch, each)
        shade = shade_db(each)
        first = -self._steps % self._stride
        self._steps += len(shade)
        self._rows += list(shade[first :: self._stride].astype(np.float32))
        while len(self._rows) > _ROWS:
            self._rows = self._rows[::2]
            self._stride *= 2
        self._known += np.isfinite(shade).sum(axis=0)
        with np.errstate(over="ignore"):
            self._squares += np.nansum(10.0 ** (shade / 10.0), axis=0)

    def survey(self) -> Survey:
        with np.errstate(divide="ignore", invalid="ignore"):
            mean = self._squares / self._known
        badness = np.sqrt(mean) if self._has_truth else mean
        values = np.concatenate(self._rows) if self._rows else np.zeros(0)
        values = values[np.isfinite(values)]
        span = tuple(float(q) for q in np.percentile(values, [10, 90])) if len(values) else None
        rank = tuple(int(e) for e in np.argsort(-badness, kind="stable"))
        now = time.monotonic()
        if now - self._looked > _LOOK_S:
            self._departures = self._watch.departures()
            self._looked = time.monotonic()
        known = {"rank": rank, "badness": badness, "shade_range_db": span, "has_truth": self._has_truth, "departures": self._departures}
        return replace(unknown(self._header), steps=self._steps, **known)
