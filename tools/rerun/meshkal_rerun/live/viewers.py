# SPDX-License-Identifier: MIT
"""Serves viewers while a run goes on, in a thread of its own that nobody waits for.

rerun takes all that is sent and gives it to every viewer that is there; one that has stopped holds up the others, too. What cannot be sent then
fills several hundred MB inside rerun before it blocks for good, so each batch is followed by a flush: while one fails nothing more is sent, and the
queue in front drops its oldest steps.
"""

import threading
import time
from collections.abc import Sequence
from dataclasses import replace

import rerun as rr
import rerun.blueprint as rrb

from meshkal_log import reader
from meshkal_log.fields import Batch, Header
from meshkal_log.reader import LogError
from meshkal_log.scenario import parse_scenario
from ..numbers.survey import focus
from ..recording.output import APPLICATION_ID
from ..recording.recorder import Recorder
from ..views.blueprint import blueprint
from .queue import DropOldest
from .running import Running

# Every batch is a message for each of the things that are drawn: more often costs more time and memory, less often is seen later.
_INTERVAL_S = 0.1
_REFRESH_S = 1.0
_FLUSH_S = 0.25
_MOST_STEPS = 2048
# After these times the worst nodes are looked for again.
_FOCUS_S = (5.0, 30.0, 120.0, 600.0)
_FOCUS_EVERY_S = 3600.0


class Viewers(threading.Thread):
    def __init__(self, queue: DropOldest, sink: rr.GrpcServerSink, run: int, view: str | None, window_s: float) -> None:
        super().__init__(name="viewers", daemon=True)
        self._queue, self._sink = queue, sink
        self._run, self._view, self._window_s = run, view, window_s
        self._header: Header | None = None
        self._halt = threading.Event()
        self._recorder: Recorder | None = None
        self.delay_s = 0.0
        self.held_up = False  # a viewer does not take what is sent
        self.failure = ""
        self.end: str | None = None  # of the run, once it is known

    def begin(self, header: Header, nodes: Sequence[int]) -> None:
        """Before the first step is put into the queue. nodes: to be named."""
        self._header, self._nodes = header, nodes

    def run(self) -> None:
        try:
            self._serve()
        except Exception as error:  # whatever it is, the recording goes on
            self.failure = " ".join(str(error).split()) or type(error).__name__
            self._queue.close()
            self._queue.drop_all()

    def finish(self, end: str | None, patience_s: float) -> bool:
        """Shows what waits, if viewers take it in time. False: they do not, and this process cannot end in the usual way."""
        self.end = end
        self._queue.close()
        self.join(patience_s)
        if not self.is_alive():
            return not self.held_up
        self._halt.set()
        self.join(2 * _FLUSH_S + 1.0)
        self._queue.drop_all()
        return not self.held_up and not self.is_alive()

    # --- in the thread -----------------------------------------------------------------------------------------------------

    def _serve(self) -> None:
        # An id of its own: a viewer would merge it with the recording that is made afterwards.
        self._rec = rr.RecordingStream(APPLICATION_ID, recording_id=f"live-{time.time_ns():x}")
        self._rec.set_sinks(self._sink)
        last = cost = 0.0
        while not self._halt.is_set() and not self._queue.over:
            # Of a large network, four fifths of the time at most.
            self._halt.wait(max(0.0, last + max(_INTERVAL_S, 1.25 * cost) - time.monotonic()))
            last = time.monotonic()
            items, since = self._queue.take(_MOST_STEPS, _INTERVAL_S)
            if items:
                self._show(reader.batch_of(items, self._header))
                cost = time.monotonic() - last
            if self._flush() and items:
                self.delay_s = time.monotonic() - since
        if self._recorder and not self._halt.is_set():
            self._refresh()
            self._recorder.finish(self.end, self._rows())
            # Not active: who looks has perhaps arranged things in another way. It is what the viewer resets to.
            self._rec.send_blueprint(self._blueprint(), make_active=False)
            self._flush()

    def _flush(self) -> bool:
        while not self._halt.is_set():
            try:
                self._rec.flush(timeout_sec=_FLUSH_S)
            except RuntimeError:
                self.held_up = True
                continue
            self.held_up = False
            return True
        return False

    def _show(self, batch: Batch) -> None:
        now = time.monotonic()
        if self._recorder is None:
            self._begin(batch, now)
        self._running.batch(batch)
        self._recorder.batch(batch)
        self._last = batch
        if now >= self._refresh_at:
            self._refresh()
            self._refresh_at = time.monotonic() + _REFRESH_S
        if now >= self._focus_at[0]:
            # The first steps say little; later on, nobody wants his view to be reset.
            self._focus(active=len(self._focus_at) == len(_FOCUS_S))
            self._focus_at = self._focus_at[1:] or (now + _FOCUS_EVERY_S,)

    def _begin(self, batch: Batch, now: float) -> None:
        header = self._header
        self._scenario = parse_scenario(header)
        self._running = Running(header, self._scenario)
        self._running.batch(batch)
        found = self._running.survey()
        self._running = Running(header, self._scenario)
        self._first = batch
        self._named = focus(header, found, self._nodes)
        # Nobody knows how many steps there will be.
        self._recorder = Recorder(self._rec, header, self._scenario, self._run, replace(found, steps=0), self._named)
        self._rec.send_blueprint(self._blueprint(self._window_s))
        self._refresh_at = now + _REFRESH_S
        self._focus_at = tuple(now + s for s in _FOCUS_S)

    def _refresh(self) -> None:
        self._recorder.refresh(self._last, self._running.survey(), self._rows())

    def _focus(self, *, active: bool) -> None:
        """Other nodes are the worst by now."""
        found = self._running.survey()
        named = focus(self._header, found, self._nodes)
        if set(named) != set(self._named):
            self._named = named
            self._recorder.rename(found, named)
            self._rec.send_blueprint(self._blueprint(self._window_s), make_active=active)

    def _rows(self) -> list[tuple[str, str]]:
        dropped = self._queue.dropped
        return [("not shown live", f"{dropped} steps: a viewer was too slow")] if dropped else []

    def _blueprint(self, window_s: float | None = None) -> rrb.Blueprint:
        facts = (self._header, self._scenario, self._first, self._running.survey(), self._named, ())
        try:
            shown = blueprint(*facts, self._view)
        except LogError:  # there is nothing for that view
            shown = blueprint(*facts)
        if window_s:
            # Relative to the time that is followed; nanoseconds, which on the axis of steps is all of them.
            ends = (rrb.TimeRangeBoundary.cursor_relative(seconds=s) for s in (-window_s, 0.0))
            set_axes(shown.root_container, rrb.TimeAxis(view_range=rrb.TimeRange(*ends)))
        return shown


def set_axes(part: rrb.Container | rrb.View, axis: rrb.TimeAxis) -> int:
    """Of all plots in it; how many there are."""
    if isinstance(part, rrb.View):
        if "TimeAxis" not in part.properties:
            return 0
        part.properties["TimeAxis"] = axis
        return 1
    return sum(set_axes(inner, axis) for inner in part.contents)
