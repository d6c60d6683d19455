# SPDX-License-Identifier: MIT
"""Renders a recording to PNG without a display or a graphics card:  python screenshot.py run.rrd run.png [--time SECONDS] [--timeline time_s]

Needs a Vulkan driver; Debian's mesa-vulkan-drivers has one that runs on the processor.
"""

import argparse
import socket
import subprocess
import sys
import time
from pathlib import Path

import rerun_cli
from rerun.experimental import ViewerClient

START_S = 30.0
LOAD_S = 120.0
# `loading` turns false before the views have been painted with the new data.
PAINT_S = 2.0


def main() -> int:
    parser = argparse.ArgumentParser(description="Renders a rerun recording to a PNG file.")
    parser.add_argument("recording", type=Path)
    parser.add_argument("png", type=Path)
    parser.add_argument("--time", type=float, metavar="SECONDS", help="where on the timeline (default: the end)")
    parser.add_argument("--timeline", default="sim_time", help="sim_time, or time_s of a tracking log")
    parser.add_argument("--size", default="1600x1000", metavar="WxH")
    options = parser.parse_args()
    port = _free_port()
    viewer = subprocess.Popen(
        # The real program and not its Python wrapper, which would outlive a kill of its parent.
        [Path(rerun_cli.__file__).with_name("rerun"), "--headless", "--bind", "127.0.0.1", "--port", str(port)]
        + ["--window-size", options.size, "--hide-welcome-screen"],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        _render(_connect(port, viewer), options)
    finally:
        viewer.terminate()
        viewer.wait()
    return 0


def _render(client: ViewerClient, options: argparse.Namespace) -> None:
    client.open([str(options.recording.resolve())])
    _wait_loaded(client)
    if options.time is not None:
        client.set_time(options.timeline, duration=options.time, play_state="paused")
        _wait_loaded(client)
    time.sleep(PAINT_S)
    client.save_screenshot(str(options.png.resolve()))


def _connect(port: int, viewer: subprocess.Popen) -> ViewerClient:
    deadline = time.monotonic() + START_S
    while True:
        try:
            return ViewerClient.connect(f"rerun+http://127.0.0.1:{port}/proxy")
        except Exception:
            if viewer.poll() is not None:
                sys.exit("the viewer did not start: is a Vulkan driver installed?")
            if time.monotonic() > deadline:
                raise
            time.sleep(0.3)


def _wait_loaded(client: ViewerClient) -> None:
    deadline = time.monotonic() + LOAD_S
    while time.monotonic() < deadline:
        time.sleep(0.3)
        if not client.get_state().loading:
            return
    sys.exit("the viewer did not finish loading")


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


if __name__ == "__main__":
    sys.exit(main())
