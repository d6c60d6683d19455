# SPDX-License-Identifier: MIT
"""Pictures of a run: its views as the rerun viewer shows them, and figures for paper."""

import os
import tempfile
from pathlib import Path

from meshkal_log.fields import Header

from .. import conversion
from ..conversion import Logs, Wanted
from ..recording.series import UNIX_TIMES_S, seconds_timeline
from . import figures, maps, paper, viewer
from .figures import Picture
from .run import Run, read

SIZE = viewer.SIZE


def write(logs: Logs, wanted: Wanted, directory: Path, *, size: tuple[int, int] = SIZE, time_s: float | None = None) -> list[str]:
    """Writes figure-NAME.png, then NAME.png of each view (of the wanted one only, if there is one); returns warnings for the user, among them why views
    could not be rendered on this machine. time_s: the moment that is shown, else the end. Raises LogError with nothing written, or OSError;
    viewer.ViewerError: figures are there, views are not, or not all."""
    planned = conversion.plan(logs, wanted)
    run = read(logs, planned, wanted, time_s)
    # Written first, for an unknown view is refused here.
    with tempfile.TemporaryDirectory(prefix="meshkal-") as temporary:
        recording = Path(temporary) / "run.rrd"
        remarks, views = conversion.record(logs, planned, recording, wanted)
        directory.mkdir(parents=True, exist_ok=True)
        with paper.style():
            for picture in pictures(run):
                save(picture, directory / f"figure-{picture.name}.png")
        shown = [wanted.view] if wanted.view else views
        try:
            for name, picture in rendered(recording, views, shown, run.header, size, time_s):
                viewer.save(picture, directory / f"{name}.png")
        except viewer.NoViewer as error:
            remarks = [*remarks, f"figures only, no pictures of the views: {error}"]
    return remarks


def pictures(run: Run) -> list[Picture]:
    """The caller has `paper.style()` in force."""
    return [*figures.over_time(run), *maps.of_moment(run)]


def save(picture: Picture, path: Path) -> None:
    """Whole or not at all."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    title = picture.figure.suptitle(picture.title, x=0.01, ha="left", fontsize=10)
    try:
        picture.figure.savefig(temporary, format="png", metadata={"Title": picture.title, "Description": picture.alt})
        os.replace(temporary, path)
    finally:
        title.remove()
        picture.figure._suptitle = None  # noqa: SLF001: matplotlib would go on reserving room for it
        temporary.unlink(missing_ok=True)


def rendered(recording: Path, views: list[str], shown: list[str], header: Header, size: tuple[int, int] = SIZE, time_s: float | None = None):
    """Names and pictures, one after another; views: all of the recording, in the order of their tabs. Raises viewer.NoViewer, viewer.ViewerError."""
    moment = None
    if time_s is not None:
        moment = {"timeline": seconds_timeline(header), "timestamp" if header.start_s >= UNIX_TIMES_S else "duration": time_s}
    with viewer.viewer(size) as opened:
        opened.open(recording)
        for name in shown:
            opened.show(views.index(name), moment)
            yield name, opened.picture()
