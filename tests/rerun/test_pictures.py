# SPDX-License-Identifier: MIT
"""Views rendered by the real viewer: painted, different where data are, the same where they are the same, and nothing left behind."""

import io
import os
import signal
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import psutil
import pytest
from PIL import Image
from readback import PACKAGE
from synthetic import Log, showcase
from synthetic_monitor import NavigationLog, add_monitor
from synthetic_tracking import TrackingLog

from meshkal_log.reader import LogError
from meshkal_rerun import conversion, pictures
from meshkal_rerun.pictures import viewer

SIZE = (1200, 800)


@pytest.fixture(scope="session")
def can_render() -> None:
    try:
        with viewer.viewer((200, 200)):
            pass
    except viewer.NoViewer as error:
        pytest.skip(f"views cannot be rendered here: {error}")


def network(seed: int = 7) -> Log:
    return add_monitor(Log(nodes=9, steps=60, seed=seed, name="nine nodes"), "exclude")


def write(log: Log, directory: Path, **options) -> list[str]:
    with ExitStack() as keep:
        logs = conversion.Logs({"log": io.BufferedReader(io.BytesIO(log.data()))}, keep)
        return pictures.write(logs, conversion.Wanted(view=options.pop("view", None)), directory, size=SIZE, **options)


def pixels(picture: Path | Image.Image) -> np.ndarray:
    return np.asarray((Image.open(picture) if isinstance(picture, Path) else picture).convert("RGB")).astype(int)


def packed(picture: np.ndarray) -> np.ndarray:
    return picture @ (65536, 256, 1)


def painted(picture: np.ndarray, columns: int = 3, rows: int = 2) -> np.ndarray:
    """Of each part of the picture below its tabs, the share that is not background."""
    body = picture[60:-40]
    colours, counts = np.unique(packed(body), return_counts=True)
    background = colours[counts.argmax()] >> np.array([16, 8, 0]) & 255
    there = np.abs(body - background).max(axis=2) > 24
    return np.array([[part.mean() for part in np.array_split(band, columns, axis=1)] for band in np.array_split(there, rows, axis=0)])


def different(first: np.ndarray, second: np.ndarray) -> float:
    """Share of pixels that differ plainly."""
    return float((np.abs(first - second).max(axis=2) > 24).mean())


def overview(shown: viewer.Viewer, log: Log, recording: Path | None, moment: dict | None = None) -> np.ndarray:
    """recording: made and opened, unless it is already."""
    if recording:
        conversion.convert({"log": io.BufferedReader(io.BytesIO(log.data()))}, recording, conversion.Wanted())
        shown.open(recording)
    shown.show("overview", moment)
    return pixels(shown.picture())


@pytest.fixture(scope="module")
def rendered(can_render, tmp_path_factory) -> Path:
    directory = tmp_path_factory.mktemp("pictures") / "of" / "a run"
    assert write(network(), directory) == []
    return directory


def test_each_view_is_painted(rendered):
    views = {path.stem for path in rendered.glob("*.png") if not path.stem.startswith("figure-")}
    assert views == {"overview", "node", "consensus", "integrity", "summary"}
    for view in views:
        picture = pixels(rendered / f"{view}.png")
        assert picture.shape == (SIZE[1], SIZE[0], 3)
        share = painted(picture)
        # Every column has something in it, and the picture as a whole is more than titles.
        assert (share.max(axis=0) > 0.01).all() and share.mean() > 0.01, (view, share)
        assert len(np.unique(packed(picture))) > 30, view
        assert (rendered / f"{view}.png").stat().st_size < 250_000
    assert {path.stem for path in rendered.glob("figure-*")} >= {f"figure-{name}" for name in ("error", "consistency", "network", "integrity", "position")}


def test_views_are_of_different_things(rendered):
    views = [pixels(path) for path in sorted(rendered.glob("*.png")) if not path.stem.startswith("figure-")]
    assert all(different(a, b) > 0.02 for i, a in enumerate(views) for b in views[:i])


def test_other_data_other_picture(rendered, tmp_path):
    """Of the same log the same picture, nearly: the eye of the scene may move by less than a pixel."""
    with viewer.viewer(SIZE) as shown:
        again = overview(shown, network(), tmp_path / "again.rrd")
        other = overview(shown, network(seed=8), tmp_path / "other.rrd")
    first = pixels(rendered / "overview.png")
    # The one on the disk has a palette.
    assert different(again, first) < 0.005
    assert different(other, again) > 0.01


def test_a_moment(can_render, tmp_path):
    """Of a tracking log, whose timeline is another one and begins late; the scene changes with time, and the plots do not."""
    log = TrackingLog(steps=40)
    with viewer.viewer(SIZE) as shown:
        end = overview(shown, log, tmp_path / "run.rrd")
        then = overview(shown, log, None, {"timeline": "time_s", "duration": float(log.arrays["time_s"][0, 20, 0])})
        assert shown.views() == ["overview", "node", "consensus", "summary"]
    # The viewer gives all recordings of one session the blueprint of the first.
    with viewer.viewer(SIZE) as shown:
        flight = overview(shown, add_monitor(NavigationLog(), "exclude"), tmp_path / "flight.rrd")
        assert shown.views() == ["overview", "node", "integrity", "summary"]
    assert 0.001 < different(end, then) < 0.2
    for picture in (end, flight):
        assert (painted(picture).max(axis=0) > 0.01).all()


def test_a_moment_outside_the_run(tmp_path):
    with pytest.raises(LogError, match="there is nothing at -5 s"):
        write(TrackingLog(steps=5), tmp_path / "before", time_s=-5.0)
    assert not (tmp_path / "before").exists()


def test_a_thousand_nodes_in_reasonable_time(can_render, tmp_path):
    log = showcase(1000, 100)
    begin = time.monotonic()
    assert write(log, tmp_path, view="overview") == []
    assert time.monotonic() - begin < 60.0
    assert (painted(pixels(tmp_path / "overview.png")).max(axis=0) > 0.01).all()
    assert all(path.stat().st_size < 250_000 for path in tmp_path.iterdir())


def command(log: Path, directory: Path, home: Path, **environment: str) -> subprocess.Popen:
    env = {**os.environ, "PYTHONPATH": str(PACKAGE), "HOME": str(home), "TMPDIR": str(home / "tmp"), **environment}
    for name in [name for name in env if name.startswith("XDG_")]:
        del env[name]
    (home / "tmp").mkdir(parents=True, exist_ok=True)
    return subprocess.Popen([sys.executable, "-m", "meshkal_rerun", str(log), "--png", str(directory)], env=env, stdout=subprocess.PIPE,
                            stderr=subprocess.PIPE, text=True)


def left_at(home: Path) -> list[str]:
    """Files but those of matplotlib, which keeps a list of fonts."""
    return [str(path) for path in home.rglob("*") if path.is_file() and "matplotlib" not in path.parts] + list(map(str, (home / "tmp").iterdir()))


@pytest.fixture(scope="module")
def small(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("log") / "run.cbor"
    path.write_bytes(Log(nodes=4, steps=10).data())
    return path


def headless(process: psutil.Process) -> bool:
    try:
        return "--headless" in process.cmdline()
    except psutil.Error:
        return False  # it has ended


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_a_signal_leaves_no_viewer(can_render, small, tmp_path, number):
    running = command(small, tmp_path / "out", tmp_path / "home")
    viewers: list[psutil.Process] = []
    deadline = time.monotonic() + 60.0
    while not viewers and time.monotonic() < deadline and running.poll() is None:
        viewers = [child for child in psutil.Process(running.pid).children() if headless(child)]
        time.sleep(0.02)
    assert viewers, running.communicate()
    # Somewhere in its work: it starts, loads, or paints.
    time.sleep({signal.SIGINT: 0.05, signal.SIGTERM: 1.5, signal.SIGKILL: 0.8}[number])
    running.send_signal(number)
    running.communicate(timeout=30.0)
    assert running.returncode == (-signal.SIGKILL if number == signal.SIGKILL else 130)
    _, alive = psutil.wait_procs(viewers, timeout=5.0)
    assert not alive
    if number != signal.SIGKILL:
        assert left_at(tmp_path / "home") == []
    assert not [path for path in (tmp_path / "out").glob("*") if path.name.startswith(".")]


def test_without_a_driver_there_are_figures(small, tmp_path):
    """On a machine that has no viewer it is the same."""
    nothing = {"VK_DRIVER_FILES": "/dev/null", "VK_ICD_FILENAMES": "/dev/null"}
    running = command(small, tmp_path / "out", tmp_path / "home", **nothing)
    _, said = running.communicate(timeout=60.0)
    assert running.returncode == 0
    assert len(said.splitlines()) == 1 and "figures only" in said and "mesa-vulkan-drivers" in said, said
    written = {path.name for path in (tmp_path / "out").iterdir()}
    assert "figure-error.png" in written and "overview.png" not in written
    assert left_at(tmp_path / "home") == []


def test_a_view_that_the_log_does_not_have(tmp_path):
    with pytest.raises(LogError, match="integrity"):
        write(Log(nodes=3, steps=5), tmp_path / "out", view="integrity")
    assert not (tmp_path / "out").exists()


def test_a_viewer_that_hangs_is_ended(can_render, monkeypatch):
    """As if the viewer never answered: the time-out ends it, and says so."""
    monkeypatch.setattr(viewer, "PAINT_S", 1.0)
    with pytest.raises(viewer.ViewerError, match="could not paint the view: it did not within 1 s"), viewer.viewer(SIZE) as shown:
        process = psutil.Process(shown._process.pid)
        process.suspend()
        shown.picture()
    assert not process.is_running()
