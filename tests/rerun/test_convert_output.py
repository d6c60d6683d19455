# SPDX-License-Identifier: MIT
"""Converting a log: what is written where, whole or not at all; the command around it, and its memory."""

import io
import signal
import subprocess
import sys
import time
from pathlib import Path

import cbor2
import pytest
from converted import McapRead, converted, read_csv, read_parquet, same
from readback import PACKAGE, command
from synthetic import Log, typed
from synthetic_tracking import TrackingLog
from test_some_nodes import one_by_one

import meshkal_log
from meshkal_log import LogError, reader


def test_form_by_name_or_option(tmp_path):
    log = Log(nodes=2, steps=2)
    converted(log, tmp_path / "folder")
    assert (tmp_path / "folder/nodes.parquet").is_file()
    converted(log, tmp_path / "other.txt", to="csv")
    assert (tmp_path / "other.txt/nodes.csv").is_file()
    converted(log, tmp_path / "RUN.MCAP")
    assert McapRead(tmp_path / "RUN.MCAP").messages
    with pytest.raises(LogError, match="say --to"):
        converted(log, tmp_path / "run.mcpa")


def test_runs_that_do_not_have_the_same(tmp_path):
    with_truth, without = (Log(nodes=2, steps=2, runs=2, truth=truth).items() for truth in (True, False))
    data = b"".join([*with_truth[:3], *without[3:]])
    with pytest.raises(LogError, match="run 1: error, truth is in some runs and not in others"):
        meshkal_log.convert(io.BufferedReader(io.BytesIO(data)), tmp_path / "out", run=None)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("form", ("parquet", "csv", "mcap"))
def test_failure_leaves_what_was_there(tmp_path, form, monkeypatch):
    monkeypatch.setattr(reader, "BATCH_STEPS", 2)
    output = tmp_path / f"run.{form}"
    converted(Log(nodes=2, steps=4), output)
    before = {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()}

    def interrupt(steps: int) -> None:
        assert steps == 2
        raise KeyboardInterrupt

    wrong = Log(nodes=2, steps=6)
    items = wrong.items()
    items[1] = cbor2.dumps({"run": 0, "step": 0, "measurements": typed([1.0], "<f8")})
    for data, exception, options in ((wrong.data(), KeyboardInterrupt, {"progress": interrupt}), (b"".join(items), LogError, {})):
        with pytest.raises(exception):
            meshkal_log.convert(io.BufferedReader(io.BytesIO(data)), output, **options)
        assert {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()} == before
    # And the whole is replaced by the whole.
    converted(TrackingLog(filter="kcf"), output)
    assert {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()} != before
    assert len(list(tmp_path.iterdir())) == 1


def test_folder_with_other_files_is_left_alone(tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out/thesis.tex").write_text("years")
    with pytest.raises(OSError, match=r"has other files \(thesis.tex\)"):
        converted(Log(nodes=2, steps=2), tmp_path / "out", to="csv")
    (tmp_path / "file.csv").write_text("1,2")
    with pytest.raises(OSError, match="is not a folder"):
        converted(Log(nodes=2, steps=2), tmp_path / "file.csv")
    with pytest.raises(IsADirectoryError):
        converted(Log(nodes=2, steps=2), tmp_path / "out", to="mcap")
    assert sorted(p.name for p in tmp_path.rglob("*")) == ["file.csv", "out", "thesis.tex"]
    (tmp_path / "empty").mkdir()
    converted(Log(nodes=2, steps=2), tmp_path / "empty", to="csv")
    assert (tmp_path / "empty/nodes.csv").is_file()


@pytest.mark.parametrize("form", ("parquet", "csv", "mcap"))
def test_not_a_log(tmp_path, form):
    (tmp_path / "text.cbor").write_text("hello")
    done = command("convert", tmp_path / "text.cbor", "-o", tmp_path / f"run.{form}")
    assert done.returncode == 2 and b"not a Meshkal log" in done.stderr and b"Traceback" not in done.stderr
    done = command("convert", tmp_path / "missing.cbor", "-o", tmp_path / f"run.{form}")
    assert done.returncode == 2 and b"missing.cbor" in done.stderr
    done = command("convert", tmp_path / "text.cbor", "-o", tmp_path / "run.mcpa")
    assert done.returncode == 2 and b"say --to" in done.stderr
    done = command("convert", tmp_path / "text.cbor", "-o", tmp_path / f"run.{form}", "--run", "x")
    assert done.returncode == 2 and b"not a run number" in done.stderr
    assert [p.name for p in tmp_path.iterdir()] == ["text.cbor"]


def test_standard_input_and_warnings_of_the_command(tmp_path):
    log = Log(nodes=2, steps=3)
    done = command("convert", "-", "-o", tmp_path / "run.mcap", stdin=b"".join(log.items()[:-1]))
    assert done.returncode == 0 and b"warning: the log was cut" in done.stderr
    assert len(McapRead(tmp_path / "run.mcap").messages["/steps"]) == 3


def test_all_runs_and_logs_of_nodes_on_the_command_line(tmp_path):
    (tmp_path / "run.cbor").write_bytes(Log(nodes=2, steps=3, runs=2).data())
    done = command("convert", tmp_path / "run.cbor", "-o", tmp_path / "all", "--to", "csv", "--run", "all")
    assert (done.returncode, done.stderr) == (0, b"")
    assert len(read_csv(tmp_path / "all")["nodes"]["step"]) == 12
    done = command("convert", *one_by_one(tmp_path), "-o", tmp_path / "joined")
    assert done.returncode == 0 and done.stderr.count(b"joined logs: warning: ") == 2
    assert command("convert", *one_by_one(tmp_path), "-o", tmp_path / "joined", "--run", "all").stderr == done.stderr
    found = read_parquet(tmp_path / "joined")
    same(found["nodes"]["theta"].reshape(-1, 5)[:, 3], Log(nodes=5, truth=False).arrays["theta"][0, :, 3], False)
    same(found["readings"]["innovation"].reshape(-1, 5)[:, 3], Log(nodes=5, truth=False).arrays["innovation"][0, :, 3], False)


def waiting(output: Path) -> subprocess.Popen:
    """The command, which has begun to write and waits for more of the log: 4500 steps of 5000 are there."""
    child = subprocess.Popen([sys.executable, "-m", "meshkal_log.converting", "-", "-o", str(output)],
                             stdin=subprocess.PIPE, stderr=subprocess.PIPE, env={"PYTHONPATH": str(PACKAGE)})
    child.stdin.write(b"".join(Log(nodes=1, steps=5000, position_states=None).items()[:4501]))
    child.stdin.flush()
    deadline = time.monotonic() + 60
    while not list(output.parent.glob(f".{output.name}.*.tmp")):
        assert time.monotonic() < deadline and child.poll() is None
        time.sleep(0.02)
    return child


@pytest.mark.parametrize("form", ("parquet", "csv", "mcap"))
@pytest.mark.parametrize("number", (signal.SIGTERM, signal.SIGHUP))
def test_what_was_read_before_a_signal_is_written(tmp_path, form, number):
    output = tmp_path / f"run.{form}"
    with waiting(output) as child:
        child.send_signal(number)
        said = child.stderr.read().decode()
        assert child.wait(60) == 128 + number
    assert f": stopped by {number.name}: run.{form} holds what was read before\n" in said and "Traceback" not in said
    assert [p.name for p in tmp_path.iterdir()] == [f"run.{form}"]
    steps = McapRead(output).messages["/steps"] if form == "mcap" else (read_csv if form == "csv" else read_parquet)(output)["steps"]["step"]
    assert 4096 <= len(steps) <= 4500


@pytest.mark.parametrize("form", ("parquet", "csv", "mcap"))
def test_damaged_log_up_to_the_damage(tmp_path, form):
    items = Log(nodes=2, steps=6, runs=2).items()
    items[4] = b"\xff" * 9
    (tmp_path / "run.cbor").write_bytes(b"".join(items))
    done = command("convert", tmp_path / "run.cbor", "-o", tmp_path / f"run.{form}", *([] if form == "mcap" else ["--run", "all"]))
    said = done.stderr.decode()
    assert done.returncode == 1 and "damaged at item 5 (byte " in said and f": run.{form} holds what was read before\n" in said
    output = tmp_path / f"run.{form}"
    steps = McapRead(output).messages["/steps"] if form == "mcap" else (read_csv if form == "csv" else read_parquet)(output)["steps"]["step"]
    assert len(steps) == 3


def test_first_ctrl_c_in_a_pipe_is_the_simulator_s(tmp_path):
    with waiting(tmp_path / "run.mcap") as child:
        child.send_signal(signal.SIGINT)
        time.sleep(0.2)
        _, said = child.communicate(cbor2.dumps({"end": "interrupted", "items": 4500}), timeout=60)
    assert child.returncode == 0 and b"interrupted after 4500 step items" in said
    assert len(McapRead(tmp_path / "run.mcap").messages["/steps"]) == 4500


@pytest.mark.parametrize("form", ("parquet", "csv", "mcap"))
def test_full_disk_leaves_nothing(tmp_path, form):
    (tmp_path / "run.cbor").write_bytes(Log(nodes=40, steps=400).data())
    (tmp_path / "out").mkdir()
    script = f"ulimit -f 200; exec {sys.executable} -m meshkal_log.converting {tmp_path}/run.cbor -o {tmp_path}/out/run.{form}"
    done = subprocess.run(["bash", "-c", script], capture_output=True, text=True, env={"PYTHONPATH": str(PACKAGE)}, timeout=60, check=False)
    assert done.returncode == 2 and done.stderr.count("\n") == 1 and "too large" in done.stderr, done.stderr
    assert list((tmp_path / "out").iterdir()) == []


MEASURE = """
import sys
from meshkal_log import convert, reader
reader.BATCH_BYTES = 1 << 20
convert(sys.argv[1], sys.argv[2])
# Not ru_maxrss, which a child has from the program that started it.
print(next(line.split()[1] for line in open("/proc/self/status") if line.startswith("VmHWM:")))
"""


@pytest.mark.parametrize("form", ("parquet", "csv", "mcap"))
def test_memory_does_not_grow_with_the_log(tmp_path, form):
    peaks = []
    for steps in (300, 1200):
        (tmp_path / "run.cbor").write_bytes(Log(nodes=200, steps=steps).data())
        done = subprocess.run([sys.executable, "-c", MEASURE, tmp_path / "run.cbor", tmp_path / f"run.{form}"],
                              capture_output=True, text=True, env={"PYTHONPATH": str(PACKAGE)}, timeout=120, check=True)
        peaks.append(int(done.stdout) / 1024)
    size = (tmp_path / "run.cbor").stat().st_size / 2**20
    assert size > 20
    assert peaks[1] - peaks[0] < 0.4 * size and peaks[1] < 200, peaks
