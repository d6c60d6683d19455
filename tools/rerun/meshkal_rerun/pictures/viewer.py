# SPDX-License-Identifier: MIT
"""The rerun viewer without a window: renders recordings to PNG. It needs a Vulkan driver; Debian's mesa-vulkan-drivers has one that runs on the
processor."""

import io
import json
import os
import shutil
import signal
import socket
import subprocess
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import rerun_cli
from PIL import Image
from rerun.experimental import ViewerClient

from ..views import VIEWS

SIZE = (1600, 1000)
STARTS = 3
START_S = 30.0
LOAD_S = 180.0
# A picture is painted when the viewer has given the same one for so long, and so often.
STILL_S, STILL_PICTURES = 0.8, 3
PAINT_S = 90.0
# For so long after a file was opened the viewer says so in a corner.
NOTICE_S = 3.5
_CONTROL_S = 10.0
# Titles of tabs that do not begin with the name of their view.
_OTHER_TITLES = {"navigation": "node"}


class NoViewer(Exception):
    """This machine cannot render; one line for the user."""


class ViewerError(OSError):
    """The viewer started and then failed; one line for the user."""


class Viewer:
    """A running viewer that shows one recording; made by `viewer`."""

    def __init__(self, process: subprocess.Popen, client: ViewerClient) -> None:
        self._process, self._client = process, client
        self._opened = 0.0
        self._store = ""
        self._blueprint: dict = {}
        self._tabs: dict = {}

    def open(self, recording: Path) -> None:
        with self._within(LOAD_S, "load the recording"):
            self._store = self._client.open([str(recording.resolve())]).store_ids[0]
            while self._client.get_state().loading:
                time.sleep(0.1)
        self._opened = time.monotonic()
        with self._within(_CONTROL_S, "say what it shows"):
            self._blueprint = self._client.get_blueprint(store_id=self._store).blueprint
        root = self._blueprint["/viewport"]["ViewportBlueprint"]["root_container"]
        self._tabs = self._blueprint[f"/container/{root}"]["ContainerBlueprint"]
        # The bar at the top warns of the machine, and says nothing of the recording.
        self._blueprint["/top_panel"] = {"PanelBlueprint": {"state": "Hidden"}}
        if self._tabs["container_kind"] != "Tabs":
            raise ViewerError("the recording's views are not in tabs")

    def views(self) -> list[str]:
        """Those of VIEWS that the recording has; a tab's title begins with its name."""
        return list(self._places())

    def show(self, view: str, moment: dict | None) -> None:
        """moment: timeline and time as `ViewerClient.set_time` takes them; None: the end."""
        self._tabs["active_tab"] = self._places()[view]
        with self._within(_CONTROL_S, "show the view"):
            self._client.set_blueprint(self._blueprint, store_id=self._store)
            if moment:
                self._client.set_time(**moment, play_state="paused", recording=self._store)

    def picture(self) -> Image.Image:
        """When nothing in it changes any more."""
        with self._within(PAINT_S, "paint the view"):
            last, since, same = self._client.take_screenshot(), time.monotonic(), 1
            while True:
                time.sleep(max(0.0, self._opened + NOTICE_S - time.monotonic()))
                png = self._client.take_screenshot()
                same += 1
                if png != last:
                    last, since, same = png, time.monotonic(), 1
                if same >= STILL_PICTURES and time.monotonic() - since >= STILL_S:
                    return Image.open(io.BytesIO(png)).convert("RGB")

    def _places(self) -> dict[str, str]:
        out = {}
        for tab in self._tabs["contents"]:
            said = self._blueprint[f"/{tab}"]
            title = (said.get("ContainerBlueprint") or said.get("ViewBlueprint")).get("display_name", "")
            name = title.split(" ")[0].lower()
            out.setdefault(_OTHER_TITLES.get(name, name), tab)
        return {name: out[name] for name in VIEWS if name in out}

    @contextmanager
    def _within(self, seconds: float, what: str) -> Iterator[None]:
        """Whatever hangs ends with the viewer."""
        late = threading.Timer(seconds, self._process.kill)
        late.start()
        try:
            yield
        except ViewerError:
            raise
        except Exception as error:
            try:
                ended = self._process.wait(0.5)
            except subprocess.TimeoutExpired:
                ended = None
            reason = f"it did not within {seconds:.0f} s" if ended == -9 else f"it ended with status {ended}" if ended is not None else _line(error)
            raise ViewerError(f"the viewer could not {what}: {reason}") from None
        finally:
            late.cancel()


@contextmanager
def viewer(size: tuple[int, int] = SIZE) -> Iterator[Viewer]:
    """It is gone when the block ends, however it ends. Raises NoViewer or ViewerError; in the block a signal raises KeyboardInterrupt at once."""
    with _interruptible(), tempfile.TemporaryDirectory(prefix="meshkal-viewer-", ignore_cleanup_errors=True) as home:
        process, client = _start(Path(home), size)
        try:
            yield Viewer(process, client)
        finally:
            _end(process)


@contextmanager
def _interruptible() -> Iterator[None]:
    """Who reads logs lets a first signal end the reading only; here nothing is read."""
    before = {}
    if threading.current_thread() is threading.main_thread():
        before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
    try:
        for number, handler in before.items():
            if handler != signal.SIG_IGN:
                signal.signal(number, signal.default_int_handler)
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _start(home: Path, size: tuple[int, int]) -> tuple[subprocess.Popen, ViewerClient]:
    """Another program may take the port between its choice and its use, so starting is tried again."""
    for attempt in range(STARTS):
        port, said = _free_port(), home / f"output-{attempt}"
        with said.open("wb") as output:
            process = subprocess.Popen(_command(port, size), env=_environment(home), stdin=subprocess.DEVNULL, stdout=output, stderr=output,
                                       # Ctrl-C in a terminal is for this program, which then ends the viewer.
                                       start_new_session=True)
        try:
            client = _connect(port, process)
            if client:
                return process, client
        except BaseException:
            _end(process)
            raise
        _end(process)
        text = said.read_text(errors="replace")
        if "render context" in text or "adapter" in text and "panicked" in text:
            raise NoViewer("the viewer found no Vulkan driver (Debian: mesa-vulkan-drivers)")
    last = next((line for line in reversed(text.splitlines()) if line.strip()), "it says nothing")
    raise NoViewer(f"the viewer did not start: {last.strip()}")


def _command(port: int, size: tuple[int, int]) -> list[str]:
    # The real program and not its Python wrapper, which would outlive a kill of its parent.
    program = Path(rerun_cli.__file__).with_name("rerun")
    if not program.is_file():
        raise NoViewer(f"rerun-sdk has no viewer for this machine: {program} is missing")
    # Should this program be killed outright, the kernel ends the viewer.
    setpriv = shutil.which("setpriv")
    return [*([setpriv, "--pdeathsig", "KILL"] if setpriv else []), str(program), "--headless", "--bind", "127.0.0.1", "--port", str(port),
            "--window-size", f"{size[0]}x{size[1]}", "--hide-welcome-screen"]


def _environment(home: Path) -> dict[str, str]:
    """A home of its own: it leaves no files, asks nothing about analytics and sends none, and no earlier setting changes the pictures."""
    folders = {name: home / name.lower() for name in ("XDG_CONFIG_HOME", "XDG_DATA_HOME", "XDG_CACHE_HOME", "XDG_STATE_HOME", "XDG_RUNTIME_DIR")}
    for folder in folders.values():
        folder.mkdir(mode=0o700, exist_ok=True)
    settings = folders["XDG_CONFIG_HOME"] / "rerun" / "analytics.json"
    settings.parent.mkdir(exist_ok=True)
    data = folders["XDG_DATA_HOME"] / "rerun" / "analytics"
    settings.write_text(json.dumps({"analytics_enabled": False, "analytics_id": "", "metadata": {}, "config_file_path": str(settings),
                                    "data_dir_path": str(data)}))
    return {**os.environ, "HOME": str(home), "TMPDIR": str(home), **{name: str(folder) for name, folder in folders.items()}, "MESA_SHADER_CACHE_DISABLE": "true"}


def _connect(port: int, process: subprocess.Popen) -> ViewerClient | None:
    """None if the viewer ended, or does not answer in time."""
    deadline = time.monotonic() + START_S
    late = threading.Timer(START_S, process.kill)
    late.start()
    try:
        while process.poll() is None and time.monotonic() < deadline:
            try:
                client = ViewerClient.connect(f"rerun+http://127.0.0.1:{port}/proxy")
                # Its port answers before it has found out whether it can render.
                client.take_screenshot(max_size=16)
                return client if process.poll() is None else None
            except Exception:
                time.sleep(0.1)
        return None
    finally:
        late.cancel()


def _end(process: subprocess.Popen) -> None:
    process.terminate()
    try:
        process.wait(5.0)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def _line(error: Exception) -> str:
    return " ".join(str(error).split())[:200] or type(error).__name__
