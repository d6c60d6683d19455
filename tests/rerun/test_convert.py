# SPDX-License-Identifier: MIT
"""Every number of a log is in each form that it is converted to, read back by readers that know nothing of this program."""

import csv
import io
import json
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import cbor2
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from lz4 import frame as lz4
from logs_of_all_kinds import LOGS, expected
from mcap.data_stream import ReadDataStream
from mcap.reader import make_reader
from mcap.records import Chunk, Message, MessageIndex
from mcap.stream_reader import StreamReader
from readback import PACKAGE, command
from synthetic import Log, typed
from synthetic_tracking import TrackingLog
from test_some_nodes import one_by_one

import meshkal_log
from meshkal_log import LogError, reader


def converted(log: Log, output: Path, **options) -> list[str]:
    return meshkal_log.convert(io.BufferedReader(io.BytesIO(log.data())), output, **options)


def read_parquet(folder: Path) -> dict[str, dict[str, np.ndarray]]:
    """Values by table and column."""
    out = {}
    for path in folder.iterdir():
        table = pq.read_table(path)
        assert len(set(table.column_names)) == len(table.column_names)
        out[path.stem] = {name: np.array([None] * len(table)) if table[name].null_count else table[name].to_numpy() for name in table.column_names}
    return out


def read_csv(folder: Path) -> dict[str, dict[str, np.ndarray]]:
    out = {}
    for path in folder.glob("*.csv"):
        raw = path.read_bytes()
        assert b"\r" not in raw and b'"' not in raw and raw.endswith(b"\n")
        with open(path, newline="") as stream:
            first, *rows = csv.reader(stream)
        out[path.stem] = {name: np.array([row[i] or None for row in rows], dtype=object) for i, name in enumerate(first)}
    return out


def same(found: np.ndarray, wanted: np.ndarray, text: bool) -> None:
    """Bit for bit, but for the sort of NaN; also the sign of 0."""
    wanted = wanted.reshape(-1)
    assert len(found) == len(wanted)
    if wanted.dtype == object:
        wanted, found = [w for w in wanted], [None if f is None else int(f) for f in found]
        assert found == wanted
    elif wanted.dtype.kind == "f":
        # A reader that sees "0" first takes the column for one of integers.
        assert not text or not any(re.fullmatch("-?[0-9]+|nan", f) for f in found)
        back = np.array([float(f) for f in found]).astype(wanted.dtype) if text else found
        assert back.dtype == wanted.dtype
        np.testing.assert_array_equal(back, wanted)
        there = ~np.isnan(wanted)
        np.testing.assert_array_equal(np.signbit(back[there]), np.signbit(wanted[there]))
    else:
        np.testing.assert_array_equal([int(f) for f in found], wanted)


@pytest.mark.parametrize("name", LOGS)
@pytest.mark.parametrize("form", ("parquet", "csv"))
def test_every_number_is_in_the_tables(tmp_path, name, form):
    log = LOGS[name]()
    assert converted(log, tmp_path / f"run.{form}") == []
    found = (read_parquet if form == "parquet" else read_csv)(tmp_path / f"run.{form}")
    wanted = expected(log)
    assert found.keys() == wanted.keys()
    for table, columns in wanted.items():
        assert found[table].keys() == columns.keys(), table
        for column, values in columns.items():
            same(found[table][column], values, form == "csv")
    assert sorted(p.name for p in tmp_path.iterdir()) == [f"run.{form}"]


class McapRead:
    """Messages of all topics, decoded by the definition that is in the file."""

    def __init__(self, path: Path) -> None:
        with open(path, "rb") as stream:
            source = make_reader(stream, validate_crcs=True)
            self.summary = source.get_summary()
            self.metadata = {record.name: record.metadata for record in source.iter_metadata()}
            self.messages: dict[str, list] = {}
            pools = {}
            for schema, channel, message in source.iter_messages():
                assert schema.encoding == channel.message_encoding == "protobuf"
                if schema.id not in pools:
                    pools[schema.id] = descriptor_pool.DescriptorPool()
                    for file in descriptor_pb2.FileDescriptorSet.FromString(schema.data).file:
                        pools[schema.id].Add(file)
                kind = message_factory.GetMessageClass(pools[schema.id].FindMessageTypeByName(schema.name))
                decoded = kind()
                decoded.ParseFromString(message.data)
                self.messages.setdefault(channel.topic, []).append((message, decoded))
        self.channels = {channel.topic: channel for channel in self.summary.channels.values()}

    def tables(self) -> dict[str, dict[tuple, dict[str, np.ndarray]]]:
        """By table: by row, which is the topic and the numbers that tell repeated fields apart, the columns over time."""
        out: dict[str, dict[tuple, dict[str, list]]] = {}
        for topic, messages in self.messages.items():
            table = topic.split("/")[1]
            for _, message in messages:
                repeated = [f.name for f in message.DESCRIPTOR.fields if f.message_type]
                items = getattr(message, repeated[0]) if repeated else [message]
                for at, item in enumerate(items):
                    row = out.setdefault(table, {}).setdefault((topic, at), {})
                    for field in item.DESCRIPTOR.fields:
                        row.setdefault(field.name, []).append(getattr(item, field.name))
                    if item is not message:
                        row.setdefault("step", []).append(message.step)
        return out


@pytest.mark.parametrize("name", LOGS)
def test_every_number_is_in_the_messages(tmp_path, name):
    log = LOGS[name]()
    assert converted(log, tmp_path / "run.mcap") == []
    file = McapRead(tmp_path / "run.mcap")
    found, wanted = file.tables(), expected(log)
    assert found.keys() == wanted.keys()
    satellites = log.header.get("satellites")
    sensor = (lambda k: f"satellite_{satellites[k]}") if satellites else str
    for table, columns in wanted.items():
        counts: dict[str, int] = {}
        seen = set()
        for i in range(len(next(iter(columns.values()))[0])):
            of_row = {column: values[:, i] for column, values in columns.items()}
            node = "centre" if of_row.get("node", [0])[0] is None else of_row.get("node", [0])[0]
            topic = {"steps": "/steps", "nodes": f"/nodes/{node}", "sensors": f"/sensors/{sensor(node) if table == 'sensors' else ''}",
                     "readings": f"/readings/{sensor(node)}/{of_row['row'][0]}" if table == "readings" else "", "links": f"/links/{node}",
                     "innovation_covariance": "/innovation_covariance"}[table]
            at = counts[topic] = counts.get(topic, -1) + 1
            row = found[table][topic, at]
            seen.add((topic, at))
            # Who sends is the topic's name and in its metadata; the run is in the file's, the time in /steps.
            kept = {c for c in of_row if c not in ("run", "time_s", "node", "row", "satellite")} | {"step"} | ({"time_s"} if table == "steps" else set())
            if table in ("links", "innovation_covariance"):
                kept |= {"satellite"} & of_row.keys()
            if table == "innovation_covariance":
                kept |= {"node"}
            assert row.keys() == kept
            for column in kept:
                values = np.array(row[column])
                if of_row[column].dtype == np.float32:  # a float of protobuf, which Python shows as its only sort
                    np.testing.assert_array_equal(values, values.astype(np.float32))
                    values = values.astype(np.float32)
                same(values, of_row[column], False)
            np.testing.assert_array_equal([m.log_time for m, _ in file.messages[topic]], np.rint(of_row["time_s"] * 1e9))
        assert seen == found[table].keys()
    assert file.metadata["meshkal end"]["end"] == "complete"
    assert file.summary.statistics.message_count == sum(map(len, file.messages.values()))


def test_another_reader_finds_no_fault(tmp_path):
    """The one of rerun, which is not mcap's library: structure, times, and that every message is as its definition says."""
    for name in ("duif", "navigation"):
        converted(LOGS[name](), tmp_path / "run.mcap")
        check = subprocess.run([sys.executable, "-m", "rerun", "mcap", "check", "--full", tmp_path / "run.mcap"],
                               capture_output=True, text=True, timeout=120, check=False)
        verdicts = [line.split()[0] for line in check.stdout.splitlines() if "/" in line and "run.mcap" not in line]
        assert check.returncode == 0 and len(verdicts) == len(McapRead(tmp_path / "run.mcap").channels) and set(verdicts) == {"ok"}, check.stdout


@pytest.mark.parametrize("chunk", (1, 4000))
def test_index_of_messages_points_at_them(tmp_path, monkeypatch, chunk):
    monkeypatch.setattr("meshkal_log.mcap_file.CHUNK_BYTES", chunk)
    log = TrackingLog(steps=15)
    converted(log, tmp_path / "run.mcap")
    data, pointed, chunks = b"", set(), 0
    with open(tmp_path / "run.mcap", "rb") as stream:
        for record in StreamReader(stream, emit_chunks=True, validate_crcs=True).records:
            if isinstance(record, Chunk):
                data, chunks = lz4.decompress(record.data), chunks + 1
                assert len(data) == record.uncompressed_size
            if isinstance(record, MessageIndex):
                for when, offset in record.records:
                    assert data[offset] == 5
                    length = int.from_bytes(data[offset + 1 : offset + 9], "little")
                    message = Message.read(ReadDataStream(io.BytesIO(data[offset + 9 : offset + 9 + length])), length)
                    assert (message.channel_id, message.log_time, message.publish_time) == (record.channel_id, when, when)
                    pointed.add((record.channel_id, when))
    assert chunks > 1
    assert len(pointed) == 15 * len(McapRead(tmp_path / "run.mcap").summary.channels)


def test_small_batches_and_slices_give_the_same(tmp_path, monkeypatch):
    log = LOGS["duif"]()
    for form in ("parquet", "csv"):
        converted(log, tmp_path / f"one.{form}")
    monkeypatch.setattr(reader, "BATCH_STEPS", 5)
    monkeypatch.setattr("meshkal_log.columnar.SLICE_ROWS", 7)
    for form in ("parquet", "csv"):
        converted(log, tmp_path / f"many.{form}")
    assert pq.ParquetFile(tmp_path / "many.parquet/links.parquet").num_row_groups == 12
    for path in (tmp_path / "one.csv").iterdir():
        assert path.read_bytes() == (tmp_path / "many.csv" / path.name).read_bytes()
    one, many = read_parquet(tmp_path / "one.parquet"), read_parquet(tmp_path / "many.parquet")
    for table, columns in one.items():
        for column, values in columns.items():
            np.testing.assert_array_equal(values, many[table][column])


def test_the_header_is_in_each_form(tmp_path):
    log = Log(nodes=3, steps=4)
    log.header["truth"] = "nominal"  # what the reader itself has no use for
    for form in ("parquet", "csv", "mcap"):
        converted(log, tmp_path / f"run.{form}")
    header = dict(log.header, scenario=json.dumps(log.scenario))
    plain = json.loads((tmp_path / "run.csv/header.json").read_text())
    assert {key: plain[key] for key in header} == header and (plain["end"], plain["warnings"]) == ("complete", [])
    found = [
        {k.decode(): v.decode() for k, v in pq.read_schema(tmp_path / "run.parquet/nodes.parquet").metadata.items() if k != b"ARROW:schema"},
        McapRead(tmp_path / "run.mcap").metadata["meshkal"],
    ]
    for texts in found:
        for key, value in header.items():
            assert texts[key] == value if isinstance(value, str) else json.loads(texts[key]) == value, key
        assert len(texts["scenario_sha256"]) == 64
    footer = pq.read_metadata(tmp_path / "run.parquet/steps.parquet").metadata
    assert (footer[b"end"], footer[b"warnings"]) == (b"complete", b"[]")


def test_units_and_meanings(tmp_path):
    log = LOGS["duif"]()
    converted(log, tmp_path / "run.parquet")
    schema = pq.read_schema(tmp_path / "run.parquet/nodes.parquet")
    assert schema.field("time_s").metadata[b"unit"] == b"s"
    assert schema.field("estimate_vx").metadata[b"unit"] == b"m/s"
    assert schema.field("position_covariance_px_py").metadata[b"unit"] == b"m^2"
    assert schema.field("nis").metadata[b"description"].startswith(b"normalised innovation squared")
    assert schema.field("node").type == pa.int32()
    assert pq.read_schema(tmp_path / "run.parquet/links.parquet").field("measurements_arrived").type == pa.bool_()
    converted(log, tmp_path / "run.mcap")
    assert McapRead(tmp_path / "run.mcap").metadata["meshkal units"]["nodes.estimate_vx"] == "m/s"
    converted(log, tmp_path / "run.csv")
    assert json.loads((tmp_path / "run.csv/header.json").read_text())["columns"]["nodes"]["estimate_vx"]["unit"] == "m/s"


def test_one_run_or_all(tmp_path):
    log = Log(nodes=3, steps=4, runs=3)
    converted(log, tmp_path / "one.parquet", run=1)
    same(read_parquet(tmp_path / "one.parquet")["nodes"]["theta"], expected(log, 1)["nodes"]["theta"], False)
    converted(log, tmp_path / "all.csv", run=None)
    found, wanted = read_csv(tmp_path / "all.csv"), [expected(log, run) for run in range(3)]
    for column in wanted[0]["links"]:
        same(found["links"][column], np.concatenate([each["links"][column] for each in wanted]), True)
    with pytest.raises(LogError, match="run 3 is not in the log"):
        converted(log, tmp_path / "none.csv", run=3)
    with pytest.raises(LogError, match="MCAP file has one run"):
        converted(log, tmp_path / "none.mcap", run=None)
    converted(log, tmp_path / "two.mcap", run=2)
    file = McapRead(tmp_path / "two.mcap")
    assert file.metadata["meshkal end"]["run"] == "2"
    np.testing.assert_array_equal([m.theta for _, m in file.messages["/nodes/1"]], log.arrays["theta"][2, :, 1])
    assert not list(tmp_path.glob("*none*"))


@pytest.mark.parametrize("form", ("parquet", "csv", "mcap"))
def test_cut_log_up_to_the_cut(tmp_path, form):
    items = Log(nodes=3, steps=10).items()
    (tmp_path / "cut.cbor").write_bytes(b"".join(items[:6]) + items[6][:50])
    (warning,) = meshkal_log.convert(tmp_path / "cut.cbor", tmp_path / f"run.{form}")
    assert warning.startswith("the log was cut: it ends after 5 step items")
    if form == "mcap":
        file = McapRead(tmp_path / "run.mcap")
        assert len(file.messages["/nodes/2"]) == 5
        assert file.metadata["meshkal end"]["end"] == "cut" and warning in file.metadata["meshkal end"]["warnings"]
    else:
        found = (read_parquet if form == "parquet" else read_csv)(tmp_path / f"run.{form}")
        assert len(found["nodes"]["theta"]) == 15


@pytest.mark.parametrize("name", ("linear", "duif", "navigation"))
def test_no_step_gives_empty_tables(tmp_path, name):
    data = LOGS[name]().items()[0] + cbor2.dumps({"end": "complete", "items": 0})
    for form in ("parquet", "csv", "mcap"):
        assert meshkal_log.convert(io.BufferedReader(io.BytesIO(data)), tmp_path / f"run.{form}") == []
    for found in (read_parquet(tmp_path / "run.parquet"), read_csv(tmp_path / "run.csv")):
        assert {"steps", "nodes", "readings", "links"} <= found.keys()
        assert {"run", "step", "time_s", "node", "faults"} <= found["nodes"].keys()
        assert all(len(values) == 0 for columns in found.values() for values in columns.values())
    file = McapRead(tmp_path / "run.mcap")
    assert not file.messages and file.metadata["meshkal"]["format"] == "meshkal-log"


def test_what_is_unknown_is_said_to_be_left_out(tmp_path):
    log = Log(nodes=2, steps=3)
    log.arrays |= {"from_the_future": log.arrays["nis"], "another": log.arrays["nis"]}
    (warning,) = converted(log, tmp_path / "run.parquet")
    assert warning == "left out, because this program does not know what it is: another, from_the_future"


def test_times_before_zero(tmp_path):
    log = TrackingLog(steps=4)
    log.arrays["time_s"] = np.array([-2.5, -1.0, 0.25, 1.0]).reshape(1, 4, 1)
    converted(log, tmp_path / "run.mcap")
    file = McapRead(tmp_path / "run.mcap")
    assert [m.log_time for m, _ in file.messages["/steps"]] == [500_000_000, 2_000_000_000, 3_250_000_000, 4_000_000_000]
    assert [m.time_s for _, m in file.messages["/steps"]] == [-2.5, -1.0, 0.25, 1.0]
    assert file.metadata["meshkal end"]["log_time_is_later_by_s"] == "3.0"
    log.arrays["time_s"][0, 0] = -1e11
    with pytest.raises(LogError, match="beyond the clock"):
        converted(log, tmp_path / "far.mcap")


def test_more_topics_than_a_file_can_have(tmp_path):
    with pytest.raises(LogError, match="topics"):
        converted(Log(nodes=22000, steps=1), tmp_path / "run.mcap")
    assert not list(tmp_path.iterdir())


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
import resource, sys
from meshkal_log import convert, reader
reader.BATCH_BYTES = 1 << 20
convert(sys.argv[1], sys.argv[2])
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
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
    assert peaks[1] - peaks[0] < 0.5 * size, peaks
