# SPDX-License-Identifier: MIT
"""The viewer opens a log by itself: rerun run.cbor."""

import os
import subprocess
import sys
import time
from pathlib import Path

import cbor2
import numpy as np
import pytest
import rerun_cli
from readback import PACKAGE, Recording
from rerun.chunk import RrdReader
from synthetic import Log

# The program, and not its Python wrapper.
VIEWER = Path(rerun_cli.__file__).with_name("rerun")
NOT_OURS = 66
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(PACKAGE)}


def importer(*arguments, **options) -> subprocess.CompletedProcess:
    return subprocess.run([sys.executable, "-m", "meshkal_rerun.importer", *map(str, arguments)], capture_output=True, env=ENVIRONMENT, timeout=60, check=False, **options)


@pytest.fixture(scope="module")
def path(tmp_path_factory) -> str:
    """A PATH where the viewer finds the importer as pip would install it."""
    folder = tmp_path_factory.mktemp("bin")
    script = folder / "rerun-importer-meshkal"
    script.write_text(f'#!/bin/sh\nPYTHONPATH={PACKAGE} exec {sys.executable} -m meshkal_rerun.importer "$@"\n')
    script.chmod(0o755)
    return f"{folder}:{os.environ['PATH']}"


def opened(path: str, log: Path, output: Path) -> subprocess.CompletedProcess:
    """What the viewer has of a file after it has opened it."""
    command = [VIEWER, "--bind", "127.0.0.1", "--port", "0", "--save", output, log]
    return subprocess.run(command, capture_output=True, env={**os.environ, "PATH": path, "NO_COLOR": "1"}, timeout=90, check=False)


def test_the_viewer_opens_a_log(tmp_path, path):
    log = Log(nodes=3, steps=20)
    (tmp_path / "run.cbor").write_bytes(log.data())
    done = opened(path, tmp_path / "run.cbor", tmp_path / "run.rrd")
    assert done.returncode == 0, done.stderr
    np.testing.assert_array_equal(Recording(tmp_path / "run.rrd").series("theta/node/1"), log.arrays["theta"][0, :, 1])
    reader = RrdReader(tmp_path / "run.rrd")
    (recording,), (blueprint,) = reader.recordings(), reader.blueprints()
    assert recording.application_id == blueprint.application_id == "meshkal"


def test_the_viewer_shows_what_is_readable_of_a_damaged_log_and_says_so(tmp_path, path):
    log = Log(nodes=3, steps=20)
    items = log.items()
    (tmp_path / "run.cbor").write_bytes(b"".join([*items[:12], b"\xff", *items[12:]]))
    done = opened(path, tmp_path / "run.cbor", tmp_path / "run.rrd")
    assert b"run.cbor: damaged at item 13 " in done.stderr, done.stderr
    np.testing.assert_array_equal(Recording(tmp_path / "run.rrd").series("theta/node/1"), log.arrays["theta"][0, :11, 1])
    (tmp_path / "first.cbor").write_bytes(items[0] + b"\xff" + items[1])
    done = opened(path, tmp_path / "first.cbor", tmp_path / "first.rrd")
    assert b"first.cbor: item 2 (byte " in done.stderr and not (tmp_path / "first.rrd").exists()


def test_each_opening_is_a_recording_of_its_own(tmp_path):
    (tmp_path / "run.cbor").write_bytes(Log(nodes=2, steps=3).data())
    for name in ("rec_1", "rec_2"):
        done = importer(tmp_path / "run.cbor", "--application-id", "run", "--recording-id", name, "--opened-recording-id", "x", "--time_sequence", "a=1", "b=2",
                        "--static", "--an-option-of-later", "5")
        assert done.returncode == 0 and done.stderr == b""
        (tmp_path / "run.rrd").write_bytes(done.stdout)
        (recording,) = RrdReader(tmp_path / "run.rrd").recordings()
        assert recording.recording_id == name


def test_a_run_that_has_only_begun_and_one_that_was_cut(tmp_path):
    items = Log(nodes=2, steps=9).items()
    for count, message in ((1, b"the log has no step of run 0 yet"), (5, b"the log was cut: it ends after 4 step items")):
        (tmp_path / "run.cbor").write_bytes(b"".join(items[:count]))
        done = importer(tmp_path / "run.cbor")
        assert done.returncode == 0 and message in done.stderr
        (tmp_path / "run.rrd").write_bytes(done.stdout)
        assert Recording(tmp_path / "run.rrd").summary()


def foreign(folder: Path) -> list[Path]:
    header = cbor2.loads(Log(nodes=2, steps=2).items()[0])
    other = {**header, "format": "meshkal-runs"}
    files = {
        "empty": b"", "text": b"format meshkal-log", "json": b'{"format": "meshkal-log"}', "binary": bytes(range(256)), "map": cbor2.dumps({"a": 1}),
        "array": cbor2.dumps([1, 2]), "other-format": cbor2.dumps(other), "self-described": b"\xd9\xd9\xf7" + cbor2.dumps({"b": 2}), "byte": b"\xb3",
        "prefix": Log(nodes=2, steps=2).data()[:15], "rrd": b"RRF2" + bytes(99), "indefinite": b"\xbf\x61a\x01\xff", "wide": b"\xbb" + b"\xff" * 40,
        # The words somewhere in it make no log of it.
        "inside": cbor2.dumps({"text": b"\x66format\x6bmeshkal-log"}), "png": (PACKAGE / "recording.png").read_bytes() if (PACKAGE / "recording.png").exists() else b"\x89PNG",
    }
    for name, data in files.items():
        (folder / name).write_bytes(data)
    with (folder / "huge").open("wb") as huge:
        huge.write(cbor2.dumps({"b": 2}))
        huge.truncate(1 << 40)
    (folder / "directory.cbor").mkdir()
    os.mkfifo(folder / "fifo.cbor")
    (folder / "loop.cbor").symlink_to("loop.cbor")
    return [*folder.iterdir(), folder / "missing.cbor", Path("/dev/zero")]


def test_foreign_files_are_not_ours(tmp_path):
    for file in foreign(tmp_path):
        done = importer(file, "--recording-id", "x")
        assert (done.returncode, done.stdout, done.stderr) == (NOT_OURS, b"", b""), file


def test_every_first_bytes_of_a_log(tmp_path):
    """Whoever has the first key is a log; in an indefinite map, too."""
    from meshkal_rerun.importer import is_log

    for beginning in (b"\xb3", b"\xb8\x13", b"\xb9\0\x13", b"\xba\0\0\0\x13", b"\xbb" + bytes(7) + b"\x13", b"\xbf"):
        (tmp_path / "log").write_bytes(beginning + Log(nodes=2, steps=2).data()[1:])
        assert is_log(tmp_path / "log")


def test_the_answer_is_quick(tmp_path):
    (tmp_path / "text").write_text("hello")
    command = [sys.executable, "-X", "importtime", "-m", "meshkal_rerun.importer", str(tmp_path / "text")]
    done = subprocess.run(command, capture_output=True, env=ENVIRONMENT, check=False)
    imported = {line.rsplit(b"|", 1)[1].strip() for line in done.stderr.splitlines() if b"|" in line}
    assert done.returncode == NOT_OURS and b"argparse" in imported and not imported & {b"rerun", b"numpy", b"cbor2", b"pyarrow"}
    began = time.monotonic()
    importer(tmp_path / "text")
    assert time.monotonic() - began < 1.0  # usually 0.05 s


@pytest.mark.parametrize(("change", "message"), [
    ({"format_version": 2}, "log format version 2 is not supported, only version 1"),
    ({"filter": "chess"}, "header: filter is missing or wrong"),
    ({"scenario": "{"}, "the scenario is not JSON"),
])
def test_a_log_that_cannot_be_read_is_ours_and_says_why(tmp_path, change, message):
    header = {**cbor2.loads(Log(nodes=2, steps=2).items()[0]), **change}
    (tmp_path / "run.cbor").write_bytes(cbor2.dumps(header) + b"".join(Log(nodes=2, steps=2).items()[1:]))
    done = importer(tmp_path / "run.cbor")
    assert done.returncode == 1 and done.stdout == b"" and done.stderr.decode().count("\n") == 1 and message in done.stderr.decode()
    (tmp_path / "run.cbor").write_bytes(Log(nodes=2, steps=2).items()[0][:-5])
    done = importer(tmp_path / "run.cbor")
    assert done.returncode == 1 and b"ends inside the header" in done.stderr


def test_a_viewer_that_ends(tmp_path):
    """The importer does not stay behind."""
    (tmp_path / "run.cbor").write_bytes(Log(nodes=20, steps=2000).data())
    # rerun itself stays behind in about two cases of five.
    command = [sys.executable, "-m", "meshkal_rerun.importer", tmp_path / "run.cbor"]
    processes = [subprocess.Popen(command, env=ENVIRONMENT, stdout=subprocess.PIPE, stderr=subprocess.PIPE) for _ in range(5)]
    for process in processes:
        assert process.stdout.read(1000)
        process.stdout.close()
        process.stderr.close()
    try:
        for process in processes:
            process.wait(20)
    finally:
        for process in processes:
            process.kill()


def test_rerun_switched_off_is_said(tmp_path):
    (tmp_path / "run.cbor").write_bytes(Log(nodes=2, steps=2).data())
    done = subprocess.run([sys.executable, "-m", "meshkal_rerun.importer", tmp_path / "run.cbor"], capture_output=True, env={**ENVIRONMENT, "RERUN": "off"}, check=False)
    assert done.returncode == 1 and b"switched off" in done.stderr
