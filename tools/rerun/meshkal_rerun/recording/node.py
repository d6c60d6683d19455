# SPDX-License-Identifier: MIT
"""One node, closely: states and errors with the bands of its covariance, innovations, test quantity, and what reached it. Of named nodes only: all of a
large network would be a large recording."""

from collections.abc import Sequence

import numpy as np
import rerun as rr

from meshkal_log.fields import Batch, Header
from meshkal_log.scenario import Scenario
from ..numbers import derive, integrity, nodes
from ..numbers.causes import LOGGED, fault_text
from ..numbers.departures import Departures
from ..numbers.nodes import SIGMAS, Arrival
from ..numbers.tracking import Slots, decisions
from . import colours
from .lanes import Lanes
from .series import Clock, Series
from .tracking import STATES

# More would be too thin to read.
NEIGHBOURS = 12
ROWS = 12  # of innovations
_DEPARTURE = (("as usual", colours.QUIET), ("test quantity departs", colours.MANY), ("error departs", colours.WORST))
_ARRIVAL = {
    Arrival.ALL: ("all arrived", 0x3E6B4AFF),
    Arrival.NO_ESTIMATE: ("estimate missing", colours.BOUND),
    Arrival.NO_READING: ("reading missing", colours.SOME),
    Arrival.NOTHING: ("nothing", colours.WORST),
    Arrival.HELD: ("held faulty", 0xC77DFFFF),
    Arrival.FAULTY: ("reading with a fault", colours.MANY),
}
_BAND_COLOUR = 0x8FC7A8FF


def estimators(header: Header, named: Sequence[int]) -> list[int]:
    """Those that are shown closely, in the order of the names."""
    return [0] if header.central else [header.estimator_nodes.index(k) for k in named if k in header.estimator_nodes]


def origin(header: Header, e: int) -> str:
    return "node/centre" if header.central else f"node/{header.estimator_nodes[e]}"


class NodeRecorder:
    def __init__(self, series: Series, clock: Clock, header: Header, scenario: Scenario, departures: Departures, named: Sequence[int],
                 palette: colours.Palette) -> None:
        self._palette = palette
        self._series, self._clock, self._header, self._scenario, self._departures = series, clock, header, scenario, departures
        self._estimators = estimators(header, named)
        self._states = nodes.state_names(header, scenario)
        self._lanes = Lanes(series, clock)
        self._slots = Slots(header) if header.tracking else None

    def rename(self, departures: Departures, named: Sequence[int]) -> None:
        """Other nodes from now on: of a run that goes on."""
        self._departures, self._estimators = departures, estimators(self._header, named)

    def batch(self, times: list, batch: Batch) -> None:
        decided = decisions(batch, self._slots) if self._slots else None
        fault = integrity.faulty_now(batch, self._header)
        for e in self._estimators:
            at = origin(self._header, e)
            self._bands(at, times, batch, e)
            if batch.innovation is not None:
                self._innovations(at, times, batch, e)
            ratio, inner = nodes.test_ratio(batch.nis[:, e], batch.nis_rows[:, e])
            lines = self._series.lines
            lines(f"{at}/test/ratio", times, ratio, names="test quantity / 99.9 % limit", colors=self._colour(e), widths=1.5)
            lines(f"{at}/test/limit", times, np.ones(len(ratio)), names="limit: 99.9 %", colors=colours.LIMIT_LINE, widths=1.5)
            lines(f"{at}/test/inner_limit", times, inner, names="95 %", colors=colours.REFERENCE, widths=1.0)
            self._all_lanes(at, batch, e, decided, fault)

    def _colour(self, e: int) -> int:
        return int(self._palette.estimators[e])

    def _bands(self, at: str, times: list, batch: Batch, e: int) -> None:
        """The viewer draws a band of one standard deviation about a value: its variance is that of SIGMAS of them."""
        variance, error = SIGMAS**2 * nodes.variances(batch, self._header, self._scenario, e), nodes.errors(batch, e)
        estimate = derive.finite(batch.estimate[:, e])
        for i, name in enumerate(self._states):
            self._band(f"{at}/estimate/{i}", times, estimate[:, i], variance[:, i], f"estimate, {name}", self._colour(e))
            if error is not None:
                self._band(f"{at}/band/{i}", times, np.zeros(len(error)), variance[:, i], f"{SIGMAS:g} sigma", _BAND_COLOUR)
                self._series.lines(f"{at}/error/{i}", times, error[:, i], names=f"error, {name}", colors=self._colour(e), widths=1.5)

    def _band(self, path: str, times: list, value: np.ndarray, variance: np.ndarray, name: str, colour: int) -> None:
        """An unknown variance has no band: the value is drawn alone."""
        if self._series.first(path):
            self._series.rec.log(path, rr.Measurements.from_fields(names=name, colors=colour, widths=1.5), static=True)
        columns = rr.Measurements.columns(values=value, variances=np.where(np.isnan(variance), 0.0, variance))
        self._series.rec.send_columns(path, times, columns)

    def _innovations(self, at: str, times: list, batch: Batch, e: int) -> None:
        """Of a centre in units of their deviations, so that sensors of all kinds fit one picture."""
        rows = nodes.own_rows(self._header, e)
        innovation, variance = derive.finite(batch.innovation[:, rows]), derive.finite(batch.innovation_variance[:, rows])
        if self._header.central:
            return self._standardised(at, times, innovation, variance)
        for i in range(min(innovation.shape[1], ROWS)):
            known = np.isfinite(innovation[:, i])
            band = np.where(known, SIGMAS**2 * variance[:, i], np.nan)
            self._band(f"{at}/innovation_band/{i}", times, np.where(known, 0.0, np.nan), band, f"{SIGMAS:g} sigma", _BAND_COLOUR)
            style = {"names": f"innovation, row {i}", "colors": self._colour(e), "marker_sizes": 2.0}
            self._series.points(f"{at}/innovation/{i}", times, innovation[:, i], **style)
        return None

    def _standardised(self, at: str, times: list, innovation: np.ndarray, variance: np.ndarray) -> None:
        sensors = np.repeat(np.arange(self._header.nodes), self._header.rows)[:ROWS]
        with np.errstate(divide="ignore", invalid="ignore"):
            values = derive.finite(innovation / np.sqrt(variance))
        for i, node in enumerate(sensors):
            style = {"names": f"{self._header.sensor_name(node)}, row {i - int(np.searchsorted(sensors, node))}", "marker_sizes": 2.0}
            self._series.points(f"{at}/innovation/{i}", times, values[:, i], colors=int(colours.cycled(i + 1)[i]), **style)
        ones = np.ones(len(values))
        self._band(f"{at}/innovation_band/0", times, 0.0 * ones, SIGMAS**2 * ones, f"{SIGMAS:g} sigma", _BAND_COLOUR)

    def _all_lanes(self, at: str, batch: Batch, e: int, decided: np.ndarray | None, fault: np.ndarray | None) -> None:
        header, send = self._header, self._lanes.send
        states = nodes.departed(batch, self._departures.of(e))
        send(f"{at}/lanes/departure", batch, states, *zip(*_DEPARTURE))
        if header.monitor:
            alarm = (batch.monitor_alarm[:, e] != 0).astype(np.int64)
            send(f"{at}/lanes/monitor", batch, alarm, ("no alarm", "alarm"), (colours.QUIET, colours.WORST))
        slots = header.slots[e]
        if not header.central and header.rows[slots[0]]:
            self._own_sensor(f"{at}/lanes/own_sensor", batch, e, decided, fault)
        names, paint = zip(*_ARRIVAL.values())
        for l, node in list(enumerate(slots))[0 if header.central else 1 :][:NEIGHBOURS]:
            send(f"{at}/lanes/from_{header.sensor_path(node)}", batch, nodes.arrivals(batch, header, e, l, fault), names, paint)
        self._faults(f"{at}/lanes/node_faults", batch, e)

    def _own_sensor(self, path: str, batch: Batch, e: int, decided: np.ndarray | None, fault: np.ndarray | None) -> None:
        node = self._header.slots[e][0]
        if decided is not None:
            (column,) = np.flatnonzero((self._slots.estimator == e) & (self._slots.node == node))
            names = list(STATES.values())
            order = {int(kind): i for i, kind in enumerate(STATES)}
            states = np.array([order[d] for d in range(len(order))])[decided[:, column]]
            if fault is None and batch.faulty is not None:
                fault = batch.faulty
            paint = [colours.DECISIONS[name] for name in names]
        else:
            names, paint = ["no reading", "used"], [colours.WORST, 0x3E6B4AFF]
            states = (batch.measurements_arrived[:, int(self._header.slot_starts[e])] != 0).astype(np.int64)
        if fault is not None:
            states = np.where((fault[:, node] != 0) & (states != 0), len(names), states)
        if batch.excluded is not None:
            states = np.where(batch.excluded[:, int(self._header.slot_starts[e])] != 0, len(names) + 1, states)
        self._lanes.send(path, batch, states, [*names, "faulty, as injected", "held faulty"], [*paint, colours.MANY, 0xC77DFFFF])

    def _faults(self, path: str, batch: Batch, e: int) -> None:
        """A lane where there was a fault of the node itself."""
        masks = batch.faults[:, e] & LOGGED
        if masks.any() or self._series.has(path):
            kinds = [0, 4, 8, 12]
            states = np.select([masks == kind for kind in kinds], range(len(kinds)), len(kinds))
            names = ["none", *(fault_text(kind) for kind in kinds[1:]), "several"]
            self._lanes.send(path, batch, states, names, [colours.QUIET, colours.MANY, colours.WORST, colours.WORST, colours.WORST])
