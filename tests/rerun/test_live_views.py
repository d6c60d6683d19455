# SPDX-License-Identifier: MIT
"""What is shown of a run that goes on: what was not known at its beginning comes later."""

import io

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from readback import Recording
from synthetic import Log

from meshkal_log import reader
from meshkal_log.fields import Batch
from meshkal_log.reader import LogReader
from meshkal_log.scenario import parse_scenario
from meshkal_rerun.live.running import Running
from meshkal_rerun.live.viewers import set_axes
from meshkal_rerun.numbers.survey import focus, survey, unknown
from meshkal_rerun.recording import colours
from meshkal_rerun.recording.recorder import Recorder
from meshkal_rerun.recording.series import Series
from meshkal_rerun.views.blueprint import blueprint


def opened(log: Log) -> tuple[LogReader, list[Batch]]:
    """In batches of ten steps."""
    log_reader = LogReader(io.BufferedReader(io.BytesIO(log.data())))
    items = list(log_reader.steps())
    return log_reader, [reader.batch_of(items[at : at + 10], log_reader.header) for at in range(0, len(items), 10)]


def test_a_running_survey_finds_what_a_survey_finds():
    log = Log(nodes=12, steps=600)
    log_reader, batches = opened(log)
    scenario = parse_scenario(log_reader.header)
    running = Running(log_reader.header, scenario)
    for batch in batches:
        running.batch(batch)
    found, expected = running.survey(), survey(batches, log_reader.header, scenario)
    assert (found.rank, found.steps, found.has_truth) == (expected.rank, expected.steps, True)
    np.testing.assert_allclose(found.badness, expected.badness, rtol=1e-12)
    # Of every second row; the draws of the log are independent.
    np.testing.assert_allclose(found.shade_range_db, expected.shade_range_db, atol=0.5)
    assert len(running._rows) <= 512


def test_colours_names_and_summary_come_later(tmp_path):
    """The worst nodes are others than at first, and so is the range of colours."""
    log = Log(nodes=12, steps=40)
    log_reader, batches = opened(log)
    header, scenario = log_reader.header, parse_scenario(log_reader.header)
    rec = rr.RecordingStream("meshkal", recording_id="test")
    rec.save(tmp_path / "run.rrd")
    recorder = Recorder(rec, header, scenario, 0, unknown(header), (0, 1))
    recorder.batch(batches[0])
    running = Running(header, scenario)
    for batch in batches[:2]:
        running.batch(batch)
    recorder.refresh(batches[1], running.survey(), [("not shown live", "7 steps")])
    named = focus(header, running.survey(), (9,))
    recorder.rename(running.survey(), named)
    recorder.batch(batches[2])
    rec.disconnect()
    recording = Recording(tmp_path / "run.rrd")
    painted = {k: recording.rows(f"error_db/node/{k}", "SeriesLines:colors", static=True)[2] for k in range(12)}
    assert painted[0][0] != [colours.OTHERS] and painted[9][0] == [colours.OTHERS]
    assert [painted[k][-1] for k in named] == [[colour] for colour in colours.cycled(len(named))]
    assert painted[0][-1] == ([colours.OTHERS] if 0 not in named else [colours.cycled(5)[named.index(0)]])
    # The text is where its steps are, so that it can be forgotten.
    steps, _, texts = recording.rows("summary", "TextDocument:text")
    assert steps.tolist() == [19]
    assert "| not shown live | 7 steps |" in texts[0][0] and "| log | goes on, 10 steps, to step 9 |" in texts[0][0]
    shades = recording.rows("network/nodes", "Points2D:colors")[2]
    assert len({tuple(row) for row in shades[:10]}) == 1, "without a range all nodes are grey"
    assert len(set(shades[10])) > 2


def test_a_long_path_is_thinned():
    log = Log(nodes=2, steps=10)
    log_reader, _ = opened(log)
    rec = rr.RecordingStream("meshkal", recording_id="test")
    recorder = Recorder(rec, log_reader.header, parse_scenario(log_reader.header), 0, unknown(log_reader.header), ())
    scene = recorder._scene
    for k in range(100):
        scene._path.append(np.full((1000, 3), k, dtype=np.float32))
        scene.thin()
    (path,) = scene._path
    assert len(path) <= 21000 and path[0, 0] == 0 and path[-1, 0] == 99 and (np.diff(path[:, 0]) >= 0).all()


def test_plots_show_the_last_while():
    log_reader, batches = opened(Log(nodes=3, steps=10))
    header, scenario = log_reader.header, parse_scenario(log_reader.header)
    shown = blueprint(header, scenario, batches[0], unknown(header), header.estimator_nodes)
    ends = rrb.TimeRangeBoundary.cursor_relative(seconds=-60.0), rrb.TimeRangeBoundary.cursor_relative()
    assert set_axes(shown.root_container, rrb.TimeAxis(view_range=rrb.TimeRange(*ends))) > 5


def test_only_styles_that_change_are_sent_again(tmp_path):
    rec = rr.RecordingStream("meshkal", recording_id="test")
    rec.save(tmp_path / "run.rrd")
    series = Series(rec)
    times = [rr.TimeColumn("step", sequence=[0])]
    for colours_now in ([1, 2], [1, 3]):
        for k, colour in enumerate(colours_now):
            series.lines(f"line/{k}", times, np.zeros(1), names=["one"], colors=np.array([colour], dtype=np.uint32))
        series.style_again()
    rec.disconnect()
    recording = Recording(tmp_path / "run.rrd")
    painted = [recording.rows(f"line/{k}", "SeriesLines:colors", static=True)[2] for k in range(2)]
    assert painted == [[[1]], [[2], [3]]]
