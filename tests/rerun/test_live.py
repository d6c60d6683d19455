# SPDX-License-Identifier: MIT
"""Live mode from a pipe: what becomes the recording, how it ends, and viewers that are absent, late, frozen or killed."""

import os
import random
import signal
import socket
import subprocess
import sys
import time

import numpy as np
import pytest
from live_process import DEADLINE_S, RERUN, client, live, same, size, wait_for
from readback import PACKAGE, Recording, convert
from synthetic import Log
from synthetic_tracking import TrackingLog


def pieces(data: bytes, count: int = 40) -> list[bytes]:
    cuts = sorted(random.Random(5).sample(range(1, len(data)), count))
    return [data[i:j] for i, j in zip([0, *cuts], [*cuts, len(data)])]


@pytest.mark.parametrize("make", [lambda: Log(nodes=3, steps=30), lambda: TrackingLog(steps=20)], ids=["linear", "tracking"])
def test_the_recording_is_as_one_made_afterwards(tmp_path, make):
    """No viewer is there; the pieces end anywhere."""
    data = make().data()
    with live("-", tmp_path / "run.rrd") as process:
        for piece in pieces(data):
            process.write(piece)
            time.sleep(0.005)
        status, said = process.end()
    assert status == 0
    assert "to look at it" in said and "not shown" not in said and "warning" not in said
    assert [path.name for path in tmp_path.iterdir()] == ["run.rrd"]
    convert(data, tmp_path / "offline.rrd")
    same(tmp_path / "run.rrd", tmp_path / "offline.rrd")


def test_a_viewer_sees_steps_while_the_run_goes_on(tmp_path):
    """And a late one, too, those before it came, with their styles. What it sees are the numbers of the log."""
    log = Log(nodes=3, steps=40)
    items = log.items()
    with live("-", tmp_path / "run.rrd") as process:
        process.write(*items[:21])
        with client(process.url, tmp_path / "late.rrd") as late:
            wait_for(lambda: size(tmp_path / "late.rrd") > 10000, "the first steps at a late viewer")
            process.write(*items[21:])
            status, _ = process.end()
            late.wait(DEADLINE_S)  # it ends with its server
    assert status == 0
    seen = Recording(tmp_path / "late.rrd")
    np.testing.assert_array_equal(seen.series("theta/node/1"), log.arrays["theta"][0, :, 1])
    np.testing.assert_array_equal(seen.series("state/2/estimates"), log.arrays["estimate"][0].reshape(40, 3, 4)[:, :, 2])
    assert seen.rows("theta/node/1", "SeriesLines:names", static=True)[2] == [["node 1"]]
    assert "| log | complete, 40 steps, to step 39 |" in seen.summary()


def test_a_frozen_viewer_neither_stalls_nor_loses(tmp_path):
    """More is written than all buffers between take; the rest is dropped for viewers, counted, and in the recording."""
    log = Log(nodes=40, steps=1200)
    items = log.items()
    with live("-", tmp_path / "run.rrd", "--queue", 100) as process:
        with client(process.url, tmp_path / "client.rrd") as frozen:
            process.write(*items[:50])
            wait_for(lambda: size(tmp_path / "client.rrd") > 10000, "the first steps at the viewer")
            frozen.send_signal(signal.SIGSTOP)
            for item in items[50:]:
                process.write(item)
                time.sleep(0.002)
            process.process.stdin.close()
            # While it is frozen. rerun's own end would wait for it.
            wait_for(lambda: "run.rrd: 1200 steps" in process.said, "the recording")
            status = process.process.wait(12)
            assert frozen.poll() is None
        _, said = process.end()
    assert status == 0
    dropped = int(said.partition(" steps were not shown live")[0].rpartition(" ")[2])
    assert 100 < dropped < 1200
    series = Recording(tmp_path / "run.rrd").series("theta/node/39")
    np.testing.assert_array_equal(series, log.arrays["theta"][0, :, 39])


def test_what_is_dropped_is_told_in_the_viewer(tmp_path):
    log = Log(nodes=3, steps=600)
    items = log.items()
    with live("-", tmp_path / "run.rrd", "--queue", 3) as process:
        with client(process.url, tmp_path / "client.rrd") as viewer:
            process.write(items[0], *items[1:500])
            time.sleep(1.0)
            process.write(*items[500:])
            status, said = process.end()
            viewer.wait(DEADLINE_S)
    assert status == 0
    seen = Recording(tmp_path / "client.rrd")
    shown = len(seen.series("theta/node/0"))
    assert 0 < shown < 600
    assert f"{600 - shown} steps were not shown live" in said
    assert f"| not shown live | {600 - shown} steps: a viewer was too slow |" in seen.summary()
    recorded = Recording(tmp_path / "run.rrd")
    assert len(recorded.series("theta/node/0")) == 600 and "not shown live" not in recorded.summary()


def test_a_killed_viewer_is_nothing(tmp_path):
    log = Log(nodes=3, steps=60)
    items = log.items()
    with live("-", tmp_path / "run.rrd") as process:
        with client(process.url, tmp_path / "killed.rrd") as viewer:
            process.write(*items[:20])
            wait_for(lambda: size(tmp_path / "killed.rrd") > 10000, "the first steps at the viewer")
            viewer.kill()
            viewer.wait()
            process.write(*items[20:40])
        with client(process.url, tmp_path / "next.rrd") as viewer:
            wait_for(lambda: size(tmp_path / "next.rrd") > 10000, "the steps at the next viewer")
            process.write(*items[40:])
            status, said = process.end()
            viewer.wait(DEADLINE_S)
    assert status == 0 and "not shown" not in said
    for name in ("run", "next"):
        np.testing.assert_array_equal(Recording(tmp_path / f"{name}.rrd").series("theta/node/1"), log.arrays["theta"][0, :, 1])


def started(process, items: list[bytes]) -> None:
    """What was written is kept."""
    process.write(*items)
    wait_for(lambda: len(process.kept()) >= sum(map(len, items)), "the steps to be kept")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signals_end_it_with_what_has_come(tmp_path, number):
    items = Log(nodes=3, steps=50).items()
    with live("-", tmp_path / "run.rrd") as process:
        started(process, items[:31])
        process.write(items[31][:100])
        process.process.send_signal(number)
        status = process.process.wait(DEADLINE_S)
        _, said = process.end()
    assert status == 128 + number
    assert ("stopped by Ctrl-C" if number == signal.SIGINT else "stopped by SIGTERM") in said and "30 steps, to step 29" in said
    recording = Recording(tmp_path / "run.rrd")
    assert len(recording.series("theta/node/0")) == 30
    assert "run was interrupted, 30 steps" in recording.summary()
    assert [path.name for path in tmp_path.iterdir()] == ["run.rrd"]


def test_the_first_ctrl_c_is_left_to_the_simulator(tmp_path):
    log = Log(nodes=3, steps=20)
    log.end = "interrupted"
    items = log.items()
    with live("-", tmp_path / "run.rrd") as process:
        started(process, items[:11])
        process.process.send_signal(signal.SIGINT)
        process.write(*items[11:])
        status, said = process.end()
    assert status == 0
    assert len(Recording(tmp_path / "run.rrd").series("theta/node/0")) == 20


def test_a_second_signal_keeps_a_log_instead(tmp_path):
    log = Log(nodes=100, steps=400, states=6)
    items = log.items()
    with live("-", tmp_path / "run.rrd") as process:
        started(process, items[:-1])
        process.process.send_signal(signal.SIGTERM)
        wait_for(lambda: "stopped by SIGTERM" in process.said, "the end of reading")
        process.process.send_signal(signal.SIGTERM)
        status = process.process.wait(DEADLINE_S)
        _, said = process.end()
    (kept,) = tmp_path.iterdir()
    assert status == 143 and f"kept as a log: {kept}" in said
    assert kept.read_bytes().startswith(b"".join(items[:-1]))


def test_a_kill_leaves_a_log(tmp_path):
    log = Log(nodes=3, steps=50)
    items = log.items()
    with live("-", tmp_path / "run.rrd") as process:
        started(process, items[:31])
        process.process.kill()
        process.process.wait()
    (kept,) = tmp_path.iterdir()
    assert kept.suffix == ".cbor"
    recording, _ = convert(kept.read_bytes(), tmp_path / "again.rrd")
    np.testing.assert_array_equal(recording.series("theta/node/2"), log.arrays["theta"][0, :30, 2])


def wrong_length(item: bytes) -> bytes:
    """An array that would never end."""
    assert b"\x58\x18" in item
    return item.replace(b"\x58\x18", b"\x5b\x7f" + 7 * b"\xff", 1)


BROKEN = {
    "lost": (lambda items: items[:11], "its log has no end item"),
    "cut in an item": (lambda items: [*items[:11], items[11][:200]], "its log has no end item"),
    "damaged": (lambda items: [*items[:11], b"\xff" * 50, *items[11:]], "item 12"),
    "a wrong length": (lambda items: [*items[:11], wrong_length(items[11]), *items[12:] * 90], "item 12 is damaged"),
    "out of order": (lambda items: [*items[:11], items[5], *items[11:]], "comes after run 0, step 9"),
}


@pytest.mark.parametrize("case", BROKEN)
def test_what_is_readable_is_recorded(tmp_path, case):
    breaks, message = BROKEN[case]
    log = Log(nodes=3, steps=20)
    with live("-", tmp_path / "run.rrd") as process:
        try:
            process.write(*breaks(log.items()))
        except BrokenPipeError:
            pass  # it has seen enough
        status, said = process.end()
    assert status == 1
    assert message in said
    recording = Recording(tmp_path / "run.rrd")
    np.testing.assert_array_equal(recording.series("theta/node/2"), log.arrays["theta"][0, :10, 2])
    assert [path.name for path in tmp_path.iterdir()] == ["run.rrd"]


@pytest.mark.parametrize("data, message", [(b"", "no step has come"), (b"no log", "not a Meshkal log"), (Log(2, 2).items()[0], "no step has come")],
                         ids=["nothing", "text", "header"])
def test_without_a_step_nothing_is_written(tmp_path, data, message):
    with live("-", tmp_path / "run.rrd") as process:
        process.write(data)
        status, said = process.end()
    assert status == 2 and message in said and "nothing is written" in said
    assert list(tmp_path.iterdir()) == []


def test_a_view_that_the_log_has_nothing_for(tmp_path):
    with live("-", tmp_path / "run.rrd", "--view", "integrity") as process:
        process.write(Log(nodes=3, steps=10).data())
        status, said = process.end()
    assert status == 0 and "nothing for the view integrity" in said and "not shown" not in said
    assert len(Recording(tmp_path / "run.rrd").series("theta/node/0")) == 10


def test_a_node_that_is_none(tmp_path):
    with live("-", tmp_path / "run.rrd", "--node", "7") as process:
        process.write(Log(nodes=3, steps=10).data())
        status, said = process.end()
    assert status == 2 and "there is no node 7" in said
    assert list(tmp_path.iterdir()) == []


def test_a_port_that_is_taken(tmp_path):
    with live("-", tmp_path / "run.rrd") as process:
        port = process.url.removesuffix("/proxy").rpartition(":")[2]
        command = [sys.executable, "-m", "meshkal_rerun", "--live", "-", "-o", tmp_path / "other.rrd", "--port", port]
        done = subprocess.run(command, input=b"", capture_output=True, env={**os.environ, "PYTHONPATH": str(PACKAGE)}, timeout=DEADLINE_S, check=False)
    assert done.returncode == 2 and f"port {port}".encode() in done.stderr and done.stderr.count(b"\n") == 1


def test_a_real_viewer(tmp_path):
    """The viewer itself, without a window: it has the recording, and in it the timelines of the log."""
    from rerun.experimental import ViewerClient

    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    with live("-", tmp_path / "run.rrd") as process:
        viewer = subprocess.Popen([RERUN, process.url, "--headless", "--bind", "127.0.0.1", "--port", str(port), "--hide-welcome-screen"],
                                  stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            items = Log(nodes=3, steps=40).items()
            process.write(*items[:30])

            def connected():
                if viewer.poll() is not None:
                    pytest.skip("the viewer does not start here: no Vulkan driver")
                try:
                    return ViewerClient.connect(f"rerun+http://127.0.0.1:{port}/proxy")
                except Exception:
                    return None

            control = wait_for(connected, "the viewer")

            def shown():
                return [r for r in control.get_state().recordings if {"step", "sim_time"} <= {t.name for t in r.timelines}]

            assert len(wait_for(shown, "steps in the viewer")) == 1
            process.write(*items[30:])
            status, _ = process.end()
        finally:
            viewer.kill()
            viewer.wait()
    assert status == 0
    assert len(Recording(tmp_path / "run.rrd").series("theta/node/0")) == 40
