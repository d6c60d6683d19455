# SPDX-License-Identifier: MIT
"""Every number of a log is in each form that it is converted to, read back by readers that know nothing of this program."""

import io
import json
import subprocess
import sys

import cbor2
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from converted import McapRead, converted, read_csv, read_parquet, same
from logs_of_all_kinds import LOGS, expected
from lz4 import frame as lz4
from mcap.data_stream import ReadDataStream
from mcap.records import Chunk, Message, MessageIndex
from mcap.stream_reader import StreamReader
from synthetic import Log
from synthetic_tracking import TrackingLog

import meshkal_log
from meshkal_log import LogError, reader


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
            kept = {c for c in of_row if c not in ("run", "time_s", "node", "row", "satellite")} | {"step"}
            kept |= {"time_s"} if table == "steps" else set()
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
