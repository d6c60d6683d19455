# SPDX-License-Identifier: MIT
"""Pictures of a run: its views as the rerun viewer shows them, and figures for paper."""

import io
import tempfile
from collections.abc import Iterator
from pathlib import Path

from PIL import Image

from meshkal_log.fields import Header

from .. import conversion
from ..conversion import Logs, Wanted
from ..recording.series import UNIX_TIMES_S, seconds_timeline
from . import figures, maps, paper, png, viewer
from .figures import Picture
from .run import Run, read

SIZE = viewer.SIZE


def write(logs: Logs, wanted: Wanted, directory: Path, *, size: tuple[int, int] = SIZE, time_s: float | None = None) -> list[str]:
    """Writes figure-NAME.png, then NAME.png of each view (of the wanted one only, if there is one); returns warnings for the user, among them why views
    could not be rendered on this machine. time_s: the moment that is shown, else the end. Raises LogError with nothing written, or OSError;
    viewer.ViewerError: figures are there, views are not, or not all."""
    planned = conversion.plan(logs, wanted)
    run = read(logs, planned, wanted, time_s)
    with tempfile.TemporaryDirectory(prefix="meshkal-") as temporary:
        recording = Path(temporary) / "run.rrd"
        # Before anything is written: a view that the log does not have is refused here.
        remarks = conversion.record(logs, planned, recording, wanted).remarks
        directory.mkdir(parents=True, exist_ok=True)
        with paper.style():
            for picture in pictures(run):
                png.save(image(picture), directory / f"figure-{picture.name}.png", picture.title, picture.alt)
        try:
            for name, view in rendered(recording, run.header, wanted.view, size, time_s):
                png.save(view, directory / f"{name}.png", f"{run.plan.scenario.name}: {name}")
        except viewer.NoViewer as error:
            remarks = [*remarks, f"figures only, no pictures of the views: {error}"]
    return remarks


def pictures(run: Run) -> list[Picture]:
    """The caller has `paper.style()` in force."""
    return [*figures.over_time(run), *maps.of_moment(run)]


def image(picture: Picture) -> Image.Image:
    """With its title in it."""
    out = io.BytesIO()
    picture.figure.suptitle(picture.title, x=0.01, ha="left", fontsize=10)
    picture.figure.savefig(out, format="png")
    return Image.open(out)


def rendered(recording: Path, header: Header, only: str | None = None, size: tuple[int, int] = SIZE,
             time_s: float | None = None) -> Iterator[tuple[str, Image.Image]]:
    """Names and pictures of views, one after another. Raises viewer.NoViewer, viewer.ViewerError."""
    moment = None
    if time_s is not None:
        moment = {"timeline": seconds_timeline(header), "timestamp" if header.start_s >= UNIX_TIMES_S else "duration": time_s}
    with viewer.viewer(size) as opened:
        opened.open(recording)
        for name in [only] if only else opened.views():
            opened.show(name, moment)
            yield name, opened.picture()
