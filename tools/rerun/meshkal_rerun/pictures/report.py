# SPDX-License-Identifier: MIT
"""A run as one web page: what ran, how it went, who was worst, plots, events, and how to do it again."""

import argparse
import io
import os
import shlex
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import numpy as np
from PIL import Image

from meshkal_log.interrupts import Interrupts

from .. import cli, conversion
from ..conversion import Logs, Wanted
from . import SIZE, figures, page, paper, pictures, png, rendered, viewer
from .figures import Picture
from .run import Run, read

WORST = 10
EVENTS = 200
# Above, a PNG is smaller than the same as SVG.
_SVG_POINTS = 9_000
_SCENARIO_BYTES = 60_000


def write(logs: Logs, wanted: Wanted, output: Path, *, time_s: float | None = None, views: bool = False, size: tuple[int, int] = SIZE) -> list[str]:
    """Writes one page, whole or not at all; returns warnings for the user. time_s: the moment that maps show, else the end. views: with the views as the
    rerun viewer shows them, where it can. Raises LogError, OSError (viewer.ViewerError is one)."""
    planned = conversion.plan(logs, wanted)
    run = read(logs, planned, wanted, time_s)
    remarks, shown = list(run.warnings), []
    if views:
        with tempfile.TemporaryDirectory(prefix="meshkal-") as temporary:
            recording = Path(temporary) / "run.rrd"
            conversion.record(logs, planned, recording, wanted)
            try:
                shown = [page.figure(png.encoded(picture), "png", f"View {name}", f"The view {name} of the recording, as the rerun viewer shows it.")
                         for name, picture in rendered(recording, run.header, wanted.view, size, time_s)]
            except viewer.NoViewer as error:
                remarks.append(f"no pictures of the views: {error}")
    with paper.style():
        text = page.page(f"{run.title[0]}: {run.header.filter}", _parts(run, shown))
    temporary = output.with_name(f".{output.name}.{os.getpid()}.tmp")
    try:
        temporary.write_text(text, encoding="utf-8")
        os.replace(temporary, output)
    finally:
        temporary.unlink(missing_ok=True)
    return remarks


def main(arguments: list[str] | None = None) -> int:
    """The command `meshkal-rerun report`. Exit status: as the whole command has it; 1 also: the viewer failed, and nothing is written."""
    parser = argparse.ArgumentParser(prog="meshkal-rerun report", description="Writes a run log as one web page: tables, plots, events.")
    parser.add_argument("log", nargs="+", help="the log; several as for meshkal-rerun itself")
    parser.add_argument("-o", "--output", metavar="REPORT.html", type=Path, help="the page to write (default: beside the log, .html instead of its suffix)")
    parser.add_argument("--run", type=cli.run_number, default=0, metavar="K", help="which Monte Carlo run (default: 0)")
    parser.add_argument("--node", type=cli.node_numbers, default=(), metavar="K[,K]", help="nodes to show by name, before the worst ones")
    parser.add_argument("--time", type=float, metavar="SECONDS", help="the moment that maps show (default: the end)")
    parser.add_argument("--views", action="store_true", help="with pictures of the views, where a Vulkan driver is installed")
    options = parser.parse_args(arguments)
    output = options.output or Path(options.log[0]).with_suffix(".html")
    if output.resolve() in [Path(name).resolve() for name in options.log]:
        parser.error(f"{output} is a log: give another name with -o")
    shown = options.log[0] if len(options.log) == 1 else "joined logs"
    with cli.guarded(options.log, shown) as work:
        work.status = _report(options, output, shown, work.interrupts)
    return work.status


def _report(options: argparse.Namespace, output: Path, shown: str, interrupts: Interrupts) -> int:
    with ExitStack() as keep:
        logs = Logs(keep.enter_context(cli.logs(options.log)), keep, interrupts, readings=3 if options.views else 2)
        try:
            remarks = write(logs, Wanted(options.run, None, options.node), output, time_s=options.time, views=options.views)
        except viewer.ViewerError as error:
            cli.say(str(error))
            return cli.EXIT_PART
    return cli.told(remarks, logs, shown, f"{output.name} shows what was read before", interrupts)


def _parts(run: Run, shown: list[str]) -> Iterator[str]:
    name, what = run.title
    yield f"<h1>{page.text(name)}</h1>"
    yield page.paragraph(what, "faint")
    for warning in run.warnings:
        yield page.paragraph(f"**Warning:** {warning}")
    yield page.heading("Result")
    yield page.facts(run.tables["Result"], f"Run {run.number}")
    if run.header.estimators > 1:
        yield page.heading("Worst nodes")
        yield _worst(run)
    yield page.heading("Plots")
    for picture in pictures(run):
        yield _figure(picture)
    if shown:
        yield page.heading("Views of the recording")
        yield from shown
    if run.event_count:
        yield page.heading("Events")
        yield from _events(run)
    yield page.heading("Scenario")
    yield page.facts(run.tables["Scenario"], "As the log's header has it")
    yield page.heading("How to do it again")
    yield from _again(run)


def worst_rows(run: Run) -> Iterator[tuple[str, str, str, str]]:
    """Of the worst nodes: name, RMS over the run, the largest value, and when that was."""
    found = run.plan.found
    quantity = figures.error_quantity(run)
    for e in found.rank[:WORST]:
        if not np.isfinite(found.badness[e]):
            return
        # Both as what nodes are coloured by: dB of an error, 10 log10 of a test quantity.
        bad, largest = float(found.badness[e]), float(run.largest[e])
        if quantity == "error_db":
            values = f"{20.0 * np.log10(bad):.2f}", f"{largest:.2f}"
        elif quantity == "position_error":
            values = f"{bad:.4g}", f"{10.0 ** (largest / 20.0):.4g}"
        else:
            values = f"{bad:.3f}", f"{10.0 ** (largest / 10.0):.3f}"
        yield run.names[e], *values, f"{run.largest_s[e]:.6g}"


def _worst(run: Run) -> str:
    what = {"error_db": "error, dB", "position_error": "position error, m", None: "test quantity"}[figures.error_quantity(run)]
    mean = "mean of the" if figures.error_quantity(run) is None else "RMS"
    caption = f"Of {run.header.estimators}; expected test quantity: 1" if figures.error_quantity(run) is None else f"Of {run.header.estimators}"
    return page.table(("node", f"{mean} {what}", f"largest {what}", "at, s"), worst_rows(run), caption)


def _figure(picture: Picture) -> str:
    if picture.points <= _SVG_POINTS:
        out = io.StringIO()
        # Without a date the same run gives the same page.
        picture.figure.savefig(out, format="svg", metadata={"Date": None, "Creator": None})
        return page.figure(out.getvalue().encode(), "svg+xml", picture.title, picture.alt)
    out = io.BytesIO()
    picture.figure.savefig(out, format="png")
    return page.figure(png.encoded(Image.open(out)), "png", picture.title, picture.alt)


def _events(run: Run) -> Iterator[str]:
    told = run.events[:EVENTS]
    more = run.event_count - len(told)
    caption = f"The first {len(told)}; {more} more are in the recording" if more else f"All {len(told)}"
    yield page.table(("at, s", "what"), ((f"{at:.6g}", text) for at, text in told), caption)


def _again(run: Run) -> Iterator[str]:
    header = run.header
    if header.source == "drawn":
        yield page.paragraph("With the scenario that the log carries, as `scenario.json`:")
        yield page.code(" ".join(map(shlex.quote, simulation(run))))
    else:
        yield page.paragraph("The data are recorded: the log has them, a simulation cannot draw them again.")
    yield page.code(f"meshkal-rerun report run.cbor -o report.html --run {run.number}")
    yield page.facts([("written by", header.program), ("scenario, SHA-256", f"`{header.scenario_sha256}`")], "Versions")
    if len(header.scenario.encode()) <= _SCENARIO_BYTES:
        yield page.folded("The scenario", page.code(header.scenario))


def simulation(run: Run) -> list[str]:
    """The command that writes the same log; `nominal` truth is its default."""
    header = run.header
    words = ["meshkal", "simulate", "scenario.json", "--filter", header.filter, "--seed", str(header.seed), "--steps", str(header.steps),
             "--runs", str(header.runs), "--real", header.real]
    if header.loss and not header.navigation:
        words += ["--loss", repr(header.loss)]
    if header.monitor:
        words += ["--monitor", header.monitor, "--window", str(header.monitor_window), "--false-alarm", repr(header.monitor_false_alarm)]
    return [*words, "--out", "run.cbor"]
