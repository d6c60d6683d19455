# SPDX-License-Identifier: MIT
"""The report: one page that stands alone, whose numbers are the log's."""

import base64
import io
import json
import os
import re
import subprocess
from contextlib import ExitStack
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from readback import convert
from synthetic import Log, showcase
from synthetic_monitor import NavigationLog, add_monitor
from synthetic_tracking import TrackingLog

from meshkal_rerun import conversion
from meshkal_rerun.pictures import report

SIMULATOR = Path(os.environ.get("MESHKAL", Path(__file__).resolve().parents[2] / "build" / "meshkal"))
VOID = {"meta", "img", "br", "link", "hr", "input"}


class Page(HTMLParser):
    """Refuses what is not nested; keeps tables, pictures and texts."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[tuple[str, dict]] = []
        self.tables: dict[str, list[list[str]]] = {}
        self.headings: list[str] = []
        self._texts: list[str] = []
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attributes: list) -> None:
        self.tags.append((tag, dict(attributes)))
        if tag not in VOID:
            self.open.append(tag)
        if tag == "table":
            self._rows: list[list[str]] = []
        if tag == "tr":
            self._rows.append([])
        if tag in ("td", "th", "caption", "h2"):
            self._texts = []

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag
        text = "".join(self._texts)
        if tag in ("td", "th"):
            self._rows[-1].append(text)
        elif tag == "caption":
            self._caption = text
        elif tag == "h2":
            self.headings.append(text)
        elif tag == "table":
            self.tables[self.headings[-1]] = self._rows

    def handle_data(self, data: str) -> None:
        self._texts.append(data)


def written(directory: Path, *logs: Log, **options) -> tuple[Page, str, list[str]]:
    output = directory / "report.html"
    with ExitStack() as keep:
        opened = conversion.Logs({f"log {i}": io.BufferedReader(io.BytesIO(log.data())) for i, log in enumerate(logs)}, keep)
        remarks = report.write(opened, conversion.Wanted(options.pop("run", 0)), output, **options)
    text = output.read_text(encoding="utf-8")
    return Page(text), text, remarks


def markdown_rows(text: str, heading: str) -> list[list[str]]:
    """Of the summary in the recording."""
    lines = text[text.index(f"| {heading} |") :].split("\n\n")[0].splitlines()[2:]
    return [[part.strip().replace("`", "").replace("**", "") for part in line.strip("|").split("|", 1)] for line in lines]


KINDS = {
    "linear": lambda: add_monitor(Log(nodes=9, steps=40), "exclude"),
    "tracking": lambda: TrackingLog(steps=30),
    "navigation": lambda: add_monitor(NavigationLog(), "exclude"),
    "no truth": lambda: Log(nodes=12, steps=20, truth=False),
    "centre": lambda: Log(nodes=4, steps=20, filter="rkfc"),
}


@pytest.mark.parametrize("kind", KINDS)
def test_the_page_stands_alone_and_says_what_the_recording_says(kind, tmp_path):
    log = KINDS[kind]()
    page, text, remarks = written(tmp_path, log)
    assert remarks == []
    recording, _ = convert(log.data(), tmp_path / "run.rrd")
    for heading in ("Result", "Scenario"):
        assert page.tables[heading] == markdown_rows(recording.summary(), heading)
    assert text.startswith("<!DOCTYPE html>")
    tags = {tag for tag, _ in page.tags}
    assert not tags & {"script", "link", "iframe", "object", "embed", "base"}
    for tag, attributes in page.tags:
        assert not set(attributes) & {"href", "srcset", "data", "action"} and not [name for name in attributes if name.startswith("on")]
        if tag == "img":
            assert attributes["src"].startswith("data:image/") and len(attributes["alt"]) > 20
    # Nothing is fetched by the style or by the pictures either.
    assert not re.search(r"url\(|@import|https?:", text)
    drawings = [base64.b64decode(a["src"].split(",", 1)[1]) for tag, a in page.tags if tag == "img"]
    assert len(drawings) >= 3
    for drawing in drawings:
        if drawing.startswith(b"<?xml"):
            # Addresses are names of languages; what is drawn is in the file: parts of it, and colour bars.
            assert not re.search(rb"<script|<!DOCTYPE|@import|href=\"(?!#|data:image/png)", drawing)


def test_worst_nodes(tmp_path):
    log = Log(nodes=15, steps=25)
    page, _, _ = written(tmp_path, log)
    error = log.arrays["error"][0]
    rms = np.sqrt((error**2).mean(axis=0))
    order = np.argsort(-rms)[:10]
    rows = page.tables["Worst nodes"]
    assert rows[0] == ["node", "RMS error, dB", "largest error, dB", "at, s", "went wrong"]
    assert [row[0] for row in rows[1:]] == [f"node {k}" for k in order]
    for row, k in zip(rows[1:], order):
        assert float(row[1]) == pytest.approx(20 * np.log10(rms[k]), abs=0.006)
        assert float(row[2]) == pytest.approx(20 * np.log10(error[:, k].max()), abs=0.006)
        assert float(row[3]) == pytest.approx(0.1 * error[:, k].argmax())


def test_worst_nodes_of_tracking_are_in_metres(tmp_path):
    log = TrackingLog(steps=25)
    rows = written(tmp_path, log)[0].tables["Worst nodes"]
    error = np.linalg.norm((log.arrays["estimate"][0].reshape(25, 5, 4) - log.arrays["truth"][0][:, None])[..., :2], axis=2)
    worst = np.sqrt((error**2).mean(axis=0)).argmax()
    assert rows[1][0] == f"node {worst}"
    assert float(rows[1][1]) == pytest.approx(np.sqrt((error**2).mean(axis=0)).max(), rel=1e-3)
    assert float(rows[1][2]) == pytest.approx(error[:, worst].max(), rel=1e-3)
    assert float(rows[1][3]) == pytest.approx(log.arrays["time_s"][0, error[:, worst].argmax(), 0], rel=1e-5)


def test_events(tmp_path):
    log = add_monitor(Log(nodes=20, steps=90), "rctm")
    rng = np.random.default_rng(0)
    log.arrays["faults"] = 4.0 * (rng.random((1, 90, 20)) < 0.2)
    page, text, _ = written(tmp_path, log)
    rows = page.tables["Events"][1:]
    assert len(rows) == report.EVENTS
    times = [float(row[0]) for row in rows]
    assert times == sorted(times)
    entries = np.diff(np.concatenate([np.zeros((1, 20)), log.arrays["faults"][0]]), axis=0) != 0
    told = [row for row in rows if "input refused" in row[1] or "faults over" in row[1]]
    step, node = np.nonzero(entries)
    assert [told[0][1], told[1][1]] == [f"node {k}: input refused" for k in node[:2]] and float(told[0][0]) == pytest.approx(0.1 * step[0])
    more = int(re.search(r"(\d+) more are in the recording", text)[1])
    recording, _ = convert(log.data(), tmp_path / "run.rrd")
    departures = sum(len(recording.rows(entity, "TextLog:text")[2]) for entity in recording.entities() if entity.startswith("events/"))
    everything = departures + len(recording.rows("faults", "TextLog:text")[2]) + len(recording.rows("integrity_events", "TextLog:text")[2])
    assert len(rows) + more == everything


def test_names_are_escaped(tmp_path):
    name = "<script>alert('&\"\x07')</script>"
    page, text, _ = written(tmp_path, Log(nodes=3, steps=5, name=name))
    assert "<script" not in text and "&lt;script&gt;" in text and "\x07" not in text
    assert "script" not in {tag for tag, _ in page.tags}


def test_the_same_log_gives_the_same_page(tmp_path):
    (tmp_path / "again").mkdir()
    assert written(tmp_path, Log(nodes=4, steps=10))[1] == written(tmp_path / "again", Log(nodes=4, steps=10))[1]


def test_a_failure_leaves_the_old_page(tmp_path, monkeypatch):
    (tmp_path / "report.html").write_text("old")
    monkeypatch.setattr(report, "_again", lambda run: (_ for _ in ()).throw(OSError("no more room")))
    with pytest.raises(OSError, match="no more room"):
        written(tmp_path, Log(nodes=3, steps=5))
    assert (tmp_path / "report.html").read_text() == "old" and [path.name for path in tmp_path.iterdir()] == ["report.html"]


def test_a_large_network_is_a_small_page(tmp_path):
    _, text, _ = written(tmp_path, showcase(1000, 400))
    assert len(text.encode()) < 5_000_000
    assert "data:image/png" in text and "data:image/svg+xml" in text


def test_the_command(tmp_path, capsys):
    (tmp_path / "run.cbor").write_bytes(Log(nodes=3, steps=5).data())
    assert report.main([str(tmp_path / "run.cbor")]) == 0
    assert Page((tmp_path / "run.html").read_text()).tables["Result"]
    (tmp_path / "bad.cbor").write_bytes(b"no log")
    assert report.main([str(tmp_path / "bad.cbor")]) == 2 and "not a Meshkal log" in capsys.readouterr().err
    assert not (tmp_path / "bad.html").exists()
    with pytest.raises(SystemExit):
        report.main([str(tmp_path / "run.cbor"), "-o", str(tmp_path / "run.cbor")])


@pytest.mark.skipif(not SIMULATOR.exists(), reason=f"{SIMULATOR} is not built")
@pytest.mark.parametrize("options", [
    ("projectile", "--filter", "rkfdu", "--seed", "5", "--steps", "30", "--loss", "0.15", "--runs", "2"),
    ("projectile", "--filter", "kfd", "--real", "float32", "--steps", "40", "--monitor", "aime", "--window", "7", "--false-alarm", "0.001"),
    ("projectile", "--filter", "rkfdnu2", "--steps", "20", "--truth", "least-favourable"),
    ("distributed-unscented", "--filter", "duif", "--iterations", "6", "--protocol", "metropolis", "--loss", "0.1", "--seed", "9"),
    ("incomplete-measurements", "--filter", "mpukf", "--increments", "12", "--gate", "0.01", "--steps", "30"),
    ("incomplete-measurements", "--filter", "ukf", "--gate", "none", "--steps", "30"),
    ("gnss-ins", "--filter", "rekf-t", "--monitor", "exclude", "--steps", "40"),
], ids=lambda options: " ".join(options[:3]))
def test_the_command_that_it_gives_writes_the_same_log(options, tmp_path):
    kind, *options = options
    scenario = tmp_path / "net.json"
    scenario.write_bytes(subprocess.run([SIMULATOR, "scenario", kind], capture_output=True, check=True).stdout)
    subprocess.run([SIMULATOR, "simulate", scenario, *options, "--out", tmp_path / "first.cbor"], capture_output=True, check=True)
    with (tmp_path / "first.cbor").open("rb") as stream, ExitStack() as keep:
        report.write(conversion.Logs({"log": stream}, keep), conversion.Wanted(), tmp_path / "report.html")
    page = (tmp_path / "report.html").read_text()
    codes = [html_text(code) for code in re.findall(r"<pre><code>(.*?)</code></pre>", page, re.DOTALL)]
    (tmp_path / "scenario.json").write_text(codes[-1])
    assert json.loads(codes[-1])
    words = codes[0].replace("meshkal ", f"{SIMULATOR} ", 1)
    subprocess.run(words, shell=True, cwd=tmp_path, capture_output=True, check=True)
    assert (tmp_path / "run.cbor").read_bytes() == (tmp_path / "first.cbor").read_bytes()


def html_text(escaped: str) -> str:
    import html

    return html.unescape(escaped)
