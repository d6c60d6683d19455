# SPDX-License-Identifier: MIT
"""Numbers over time, in columns: one row at a time is a hundred times slower."""

from collections.abc import Sequence

import numpy as np
import pyarrow as pa
import rerun as rr

from meshkal_log.fields import Batch, Header
from meshkal_log.reader import LogError

_LARGEST_NS = (1 << 63) - 1
# A log that starts later, in 2001, is taken to count from 1970, and its times are shown as date and time of day, UTC.
UNIX_TIMES_S = 1e9


_SCALARS = next(iter(rr.Scalars.columns(scalars=[0.0]))).component_descriptor()


class Column:
    """A column for send_columns from an Arrow array as it is: the archetypes of rerun take five times as long over a thousand small ones."""

    def __init__(self, descriptor: rr.ComponentDescriptor, offsets: np.ndarray, values: pa.Array) -> None:
        """Row t has values[offsets[t] : offsets[t + 1]]."""
        self._descriptor, self._array = descriptor, pa.ListArray.from_arrays(pa.array(offsets, pa.int32()), values)

    def component_descriptor(self) -> rr.ComponentDescriptor:
        return self._descriptor

    def as_arrow_array(self) -> pa.Array:
        return self._array


class Series:
    """Sends numbers; the style of an entity is sent with its first ones."""

    def __init__(self, rec: rr.RecordingStream, *, envelope: bool = False) -> None:
        """envelope: where there are more numbers than pixels, lines show the smallest and the largest of them; else the viewer draws the
        middle of the two, which none of them needs to be."""
        self.rec = rec
        self._line_style = {"aggregation_policy": rr.components.AggregationPolicy.MinMax} if envelope else {}
        self._styled: set[str] = set()
        self._sent: dict[str, dict] = {}  # the styles

    def lines(self, path: str, times: list, values: np.ndarray, **style: object) -> None:
        self._send(path, times, values, rr.SeriesLines, style)

    def band(self, path: str, times: list, low: np.ndarray, high: np.ndarray, *, name: str, color: int) -> None:
        """An area between two lines. The viewer has none but that around a measurement, one sigma to either side."""
        if self.first(path):
            self.rec.log(path, rr.Measurements.from_fields(names=name, colors=color, widths=0.0), static=True)
        columns = rr.Measurements.columns(values=(low + high) / 2.0, variances=np.square((high - low) / 2.0))
        self.rec.send_columns(path, times, columns)

    def points(self, path: str, times: list, values: np.ndarray, **style: object) -> None:
        """For what is known at some instants only: a line between gaps would be nothing at all."""
        self._send(path, times, values, rr.SeriesPoints, style)

    def columns(self, paths: Sequence[str], times: list, values: np.ndarray) -> None:
        """Column k of `values` (T, K) to paths[k]: lines, unless `style` has said otherwise."""
        count = len(values)
        # One array in order of the columns, of which each entity gets a part that is not copied.
        flat = pa.array(np.asarray(values, dtype=np.float64).T.reshape(-1))
        offsets = np.arange(count + 1, dtype=np.int32)
        for k, path in enumerate(paths):
            self.rec.send_columns(path, times, [Column(_SCALARS, offsets, flat.slice(k * count, count))])

    def style(self, path: str, archetype: type, **style: object) -> None:
        """Sent once."""
        if not self.first(path):
            return
        plain = {key: value.tolist() if isinstance(value, np.ndarray) else value for key, value in style.items()}
        if self._sent.get(path) != plain:
            self._sent[path] = plain
            self.rec.log(path, archetype(**style, **(self._line_style if archetype is rr.SeriesLines else {})), static=True)

    def style_again(self) -> None:
        """Styles that have changed are sent anew with the next numbers."""
        self._styled.clear()

    def has(self, path: str) -> bool:
        return path in self._styled

    def first(self, path: str) -> bool:
        """Whether this is the first that is sent to this entity; from now on it is not."""
        known = path in self._styled
        self._styled.add(path)
        return not known

    def _send(self, path: str, times: list, values: np.ndarray, archetype: type, style: dict) -> None:
        self.style(path, archetype, **style)
        columns = rr.Scalars.columns(scalars=np.ascontiguousarray(values, dtype=np.float64).reshape(-1))
        if values.ndim == 2:
            columns = columns.partition(np.full(len(values), values.shape[1]))
        self.rec.send_columns(path, times, columns)


class Clock:
    """The timelines of a log: `step`, and `sim_time` from the length of a step or `time_s` from a log that has it."""

    def __init__(self, header: Header) -> None:
        self._header = header

    def times(self, batch: Batch, at: np.ndarray | slice = slice(None)) -> list:
        return self.columns(batch.step[at], None if batch.time_s is None else batch.time_s[at])

    def instants(self, at: list[tuple[int, float]]) -> list:
        """Of steps and seconds."""
        steps, time_s = (np.array(values) for values in zip(*at))
        return self.columns(steps, time_s if self._header.timed else None)

    def columns(self, step: np.ndarray, time_s: np.ndarray | None) -> list:
        """Nanoseconds as integers: rerun truncates a column of float seconds."""
        dt_s = self._header.dt_s
        with np.errstate(invalid="ignore", over="ignore"):
            ns = np.rint(step * (dt_s * 1e9) if time_s is None else time_s * 1e9)
        if len(ns) and not np.abs(ns).max() < _LARGEST_NS:  # also where 0 times infinity made NaN
            what = f"step {step.max()} with dt_s = {dt_s:g}" if time_s is None else f"time_s = {time_s[np.abs(time_s).argmax()]:g}"
            raise LogError(f"{what} is beyond the clock of rerun (292 years)")
        seconds = seconds_timeline(self._header)
        if self._header.start_s >= UNIX_TIMES_S:
            clock = rr.TimeColumn(seconds, timestamp=ns.astype("int64").astype("datetime64[ns]"))
        else:
            clock = rr.TimeColumn(seconds, duration=ns.astype("timedelta64[ns]"))
        return [rr.TimeColumn("step", sequence=step), clock]


def seconds_timeline(header: Header) -> str:
    return "time_s" if header.timed else "sim_time"
