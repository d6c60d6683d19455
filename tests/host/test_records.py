# SPDX-License-Identifier: MIT
"""Records of simulated nodes and `meshkal replay`: the same bits, and what is said of records that are cut, damaged, changed or foreign. Items are read here
with struct and zlib."""
import json
import pathlib
import struct
import zlib

import numpy as np
import pytest
from logs import log as read_log

CONFIGURATION, STATE, MEASURE, FRAME, INCREMENTAL, DIFFUSE, ADVANCE, TOLERANCE, RESTART = range(1, 10)
MIXED = pathlib.Path(__file__).with_name("mixed.json")
SIZES = {"float32": 4, "float64": 8}


def items(data):
    """(kind, status, content, offset) of every item; CRCs by zlib."""
    found, at = [], 0
    while at < len(data):
        kind, status, length = struct.unpack_from("<BBI", data, at)
        end = at + 6 + length
        assert struct.unpack_from("<I", data, end)[0] == zlib.crc32(data[at:end])
        found.append((kind, status, data[at + 6:end], at))
        at = end + 4
    return found


def item(kind, status, content):
    head = struct.pack("<BBI", kind, status, len(content)) + content
    return head + struct.pack("<I", zlib.crc32(head))


def flipped(data, index, byte, bit=0):
    """The record with one bit of one item's content changed, CRC repaired."""
    kind, status, content, at = items(data)[index]
    other = bytearray(content)
    other[byte] ^= 1 << bit
    return data[:at] + item(kind, status, bytes(other)) + data[at + 10 + len(content):]


@pytest.fixture(scope="module")
def projectile(run, tmp_path_factory):
    path = tmp_path_factory.mktemp("records") / "projectile.json"
    path.write_bytes(run("scenario", "projectile", "--nodes", 8, "--seed", 2).stdout)
    return path


@pytest.fixture(scope="module")
def recorded(run, projectile, tmp_path_factory):
    """recorded(*options, path=...) -> directory of the records, log."""
    def call(*options, path=projectile):
        place = tmp_path_factory.mktemp("recorded")
        log = run("simulate", path, *options, "--record", place / "records", "--out", "-").stdout
        return place / "records", log
    return call


@pytest.fixture(scope="module")
def one(recorded):
    """The record of one node, 30 steps, float64, frames lost."""
    return recorded("--steps", 30, "--loss", 0.2)[0] / "node_02.record"


@pytest.fixture(scope="module")
def replay(run, tmp_path_factory):
    """replay(record or its bytes, *options, status=0) -> text, summary."""
    def call(record, *options, status=0):
        place = tmp_path_factory.mktemp("replay")
        if isinstance(record, bytes):
            (place / "changed.record").write_bytes(record)
            record = place / "changed.record"
        done = run("replay", record, *options, "--json", place / "summary.json", status=status)
        summary = place / "summary.json"
        return done.stdout.decode() + done.stderr.decode(), json.loads(summary.read_text()) if summary.exists() else None
    return call


# --- equal -----------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("real", ["float32", "float64"])
@pytest.mark.parametrize("network", ["projectile", "mixed"])
@pytest.mark.parametrize("options", [("--loss", 0.25), ("--filter", "rkfdnu", "--loss", 0.25), ("--filter", "kfd"), ("--filter", "rkfdu", "--loss", 0.9),
                                     ("--frozen", 0.5, "--loss", 0.01)])
def test_equal(recorded, replay, projectile, real, network, options):
    path = projectile if network == "projectile" else MIXED
    place, log = recorded("--steps", 60, "--real", real, *options, path=path)
    header, steps, _ = read_log(log)
    nodes, n = header["nodes"], header["states"]
    assert sorted(p.name for p in place.iterdir()) == [f"node_{k:02d}.record" for k in range(nodes)]
    base = 0
    for k in range(nodes):
        data = (place / f"node_{k:02d}.record").read_bytes()
        text, summary = replay(place / f"node_{k:02d}.record")
        slots = header["slots"][k]
        own = slice(base, base + len(slots))
        base += len(slots)
        assert "differences  none" in text and summary["differences"] == 0 and summary["first_difference"] is None
        assert summary["node"] == k and summary["states"] == n and summary["slots"] == len(slots) and summary["real"] == real
        assert summary["model"] == "0x" + header["scenario_sha256"][:8] and summary["end"] == {"kind": "whole", "item": len(items(data)), "byte": len(data)}
        assert summary["steps"] == summary["last_step"] == summary["readings"] == 60
        heard = sum(int(s[key][own][1:].sum()) for s in steps for key in ("measurements_arrived", "estimates_arrived"))
        assert summary["frames"] == ({"MK_OK": heard} if heard else {})
        # What the record says is what the log says: x of a step is the estimate of the next.
        found = items(data)
        x = [np.frombuffer(c[4:], "<f8" if real == "float64" else "<f4") for kind, _, c, _ in found if kind == DIFFUSE]
        for t in range(59):
            assert x[t].tobytes() == steps[t + 1]["estimate"].reshape(nodes, n)[k].tobytes()
        if "--frozen" in options and k == nodes - 1:
            assert sum(int(s["frozen"].sum()) for s in steps) > 20
        c = [np.frombuffer(c, x[0].dtype)[0] for kind, _, c, _ in found if kind == TOLERANCE]
        assert c == ([s["tolerance"][k] for s in steps] if "rkfdnu" in options else [])
        assert [kind for kind, *_ in found[:2]] == [CONFIGURATION, STATE]


def test_unaffected(run, projectile, tmp_path):
    """Recording changes no number, whatever the threads and runs; the records neither."""
    def call(*options):
        run("simulate", projectile, "--steps", 40, "--loss", 0.1, "--json", tmp_path / "summary.json", *options)
        return json.loads((tmp_path / "summary.json").read_text())["filters"]
    plain = call("--runs", 5)
    assert call("--runs", 5, "--record", tmp_path / "a", "--threads", 2)[0]["msd"] == plain[0]["msd"]
    run("simulate", projectile, "--steps", 40, "--loss", 0.1, "--record", tmp_path / "b", "--threads", 1)
    for path in (tmp_path / "a").iterdir():
        assert path.read_bytes() == (tmp_path / "b" / path.name).read_bytes()


def test_many_nodes(run, replay, tmp_path):
    """More nodes than a process may have files, records much larger than what waits in memory."""
    scenario = tmp_path / "many.json"
    scenario.write_bytes(run("scenario", "projectile", "--nodes", 300, "--seed", 5).stdout)
    import resource
    def few():
        resource.setrlimit(resource.RLIMIT_NOFILE, (64, 64))
    run("simulate", scenario, "--steps", 300, "--real", "float32", "--record", tmp_path / "records", preexec_fn=few)
    paths = sorted((tmp_path / "records").iterdir())
    assert len(paths) == 300 and paths[7].name == "node_007.record" and max(p.stat().st_size for p in paths) > 65536
    for k in (0, 150, 299):
        assert replay(paths[k])[1]["steps"] == 300


def test_missing_readings(run, replay, projectile, tmp_path):
    """Readings that are not in the recorded data: nothing measured, nothing sent."""
    rows = ["t,node,row,value"] + [f"{t},{k},{r},{0.1 * t}" for t in range(20) for k in range(8) for r in range(2) if (t + k) % 3]
    (tmp_path / "readings.csv").write_text("\n".join(rows) + "\n")
    run("simulate", projectile, "--measurements", tmp_path / "readings.csv", "--record", tmp_path / "records")
    summary = replay(tmp_path / "records" / "node_00.record")[1]
    assert summary["readings"] == sum(t % 3 > 0 for t in range(20)) and summary["differences"] == 0


def test_failing_filter(run, replay, tmp_path):
    """The simulation ends where a filter fails. The node object goes on: readings dropped, x kept; and so does the replay."""
    scenario = {"model": {"A": [[3.0, 0.0], [0.0, 0.5]], "Q": [[1, 0], [0, 1]]}, "nodes": [{"C": [[0.0, 1.0]], "R": [[0.5]]}] * 2,
                "edges": [[0, 1]], "tolerance": 0.0}
    (tmp_path / "s.json").write_text(json.dumps(scenario))
    done = run("simulate", tmp_path / "s.json", "--filter", "kfd", "--real", "float32", "--steps", 500, "--record", tmp_path / "records", status=1)
    assert b"node 0: MK_ERROR" in done.stderr
    record = tmp_path / "records" / "node_00.record"
    found = items(record.read_bytes())
    x = [np.frombuffer(content[4:], "<f4") for kind, _, content, _ in found if kind == DIFFUSE]
    psi = [np.frombuffer(content, "<f4") for kind, _, content, _ in found if kind == INCREMENTAL]
    assert found[-1][:2] == (INCREMENTAL, 0) and len(psi) == len(x) + 1
    assert (psi[-1] == [3 * x[-1][0], 0.5 * x[-1][1]]).all() and psi[-2][1] != 0.5 * x[-2][1]
    assert replay(record)[1]["differences"] == 0


# --- different -------------------------------------------------------------------------------------------------------------------


def find(data, kind, number):
    return [i for i, it in enumerate(items(data)) if it[0] == kind][number]


@pytest.mark.parametrize("kind,byte,what,step", [(INCREMENTAL, 8 * 3, "psi[3]", 11), (DIFFUSE, 4 + 8 * 5, "x[5]", 11), (DIFFUSE, 0, "step", 11)])
def test_changed_output(one, replay, kind, byte, what, step):
    data = one.read_bytes()
    index = find(data, kind, step)
    text, summary = replay(flipped(data, index, byte), status=1)
    first = summary["first_difference"]
    assert (first["item"], first["byte"], first["step"], first["what"]) == (index, items(data)[index][3], step, what)
    assert f"item {index} ({'incremental' if kind == INCREMENTAL else 'diffuse'}) at byte {items(data)[index][3]}, step {step}: {what}\n" in text
    if what == "step":
        assert (first["recorded"]["value"], first["replayed"]["value"]) == ((step + 1) ^ 1, step + 1)
        return
    content = items(data)[index][2]
    value = struct.unpack_from("<d", content, byte)[0]
    assert summary["differences"] == 1 and first["ulp"] == 1 and first["replayed"]["value"] == value and first["replayed"]["hexadecimal"] != first["recorded"]["hexadecimal"]
    assert float.fromhex(first["replayed"]["hexadecimal"]) == value and int(first["replayed"]["bits"], 16) == struct.unpack_from("<Q", content, byte)[0]
    assert "    distance  1 ulp\n" in text and repr(value)[:15] in text


def test_changed_input(one, replay):
    """A reading changed in its sign: psi of that step is the first that differs, then everything."""
    data = one.read_bytes()
    text, summary = replay(flipped(data, find(data, MEASURE, 7), 7, 7), "--all", status=1)
    first = summary["first_difference"]
    assert (first["item"], first["kind"], first["step"]) == (find(data, INCREMENTAL, 7), "incremental", 7) and first["what"].startswith("psi")
    assert summary["differences"] == len(summary["all_differences"]) == text.count("difference: item") == 2 * 23
    assert summary["all_differences"][0] == first


def test_changed_status(one, replay):
    data = one.read_bytes()
    kind, _, content, at = items(data)[find(data, FRAME, 5)]
    changed = data[:at] + item(kind, 15, content) + data[at + 10 + len(content):]
    text, summary = replay(changed, status=1)
    assert summary["first_difference"]["what"] == "status" and summary["frames"]["MK_ERROR_STRANGER" if "MK_ERROR_STRANGER" in summary["frames"] else "MK_ERROR_REPLAYED"] == 1
    assert "recorded  MK_ERROR_" in text and "replayed  MK_OK (0)" in text


# --- not whole, not readable -----------------------------------------------------------------------------------------------------


def test_cut(one, replay):
    data = one.read_bytes()
    at = items(data)[find(data, DIFFUSE, 9)][3]
    text, summary = replay(data[:at + 20])
    assert summary["end"] == {"kind": "cut", "item": find(data, DIFFUSE, 9), "byte": at} and summary["steps"] == 9
    assert "then one that is cut off" in text


def test_damaged(one, replay):
    data = bytearray(one.read_bytes())
    index = find(bytes(data), INCREMENTAL, 9)
    at = items(bytes(data))[index][3]
    data[at + 12] ^= 4
    text, summary = replay(bytes(data), status=2)
    assert summary["end"]["item"] == index and summary["end"]["byte"] == at and summary["steps"] == 9 and summary["differences"] == 0
    assert f"item {index} at byte {at}: its CRC is wrong" in text and "differences  none" in text


def test_foreign(run, refused, projectile, tmp_path, one):
    log = tmp_path / "run.cbor"
    log.write_bytes(run("simulate", projectile, "--steps", 3, "--out", "-").stdout)
    (tmp_path / "empty").write_bytes(b"")
    (tmp_path / "zeros").write_bytes(bytes(1000))
    (tmp_path / "ones").write_bytes(b"\1" * 1000)
    (tmp_path / "state").write_bytes(b"\2" * 1000)
    (tmp_path / "late").write_bytes(item(MEASURE, 0, bytes(16)) + one.read_bytes())
    (tmp_path / "scenario").write_bytes(projectile.read_bytes())
    for name, complaint in (("run.cbor", "no item of a record"), ("empty", "no whole state"), ("zeros", "no item of a record"), ("ones", ""), ("state", ""),
                            ("late", "before the first state"), ("scenario", "no item of a record")):
        line = refused(tmp_path, "replay", tmp_path / name)
        assert line.startswith(f"{tmp_path / name}: item 0 at byte 0: ") and complaint in line, line
        refused(tmp_path, "replay", tmp_path / name, "--json", "{}/summary.json")
        if name != "late":
            refused(tmp_path, "replay", one, "--configuration", tmp_path / name)
    assert "No such file" in refused(tmp_path, "replay", tmp_path / "none")
    assert "the record is missing" in refused(tmp_path, "replay")
    assert "No such file" in refused(tmp_path, "replay", one, "--json", "{}/none/summary.json")


# --- configurations and states -----------------------------------------------------------------------------------------------------


def test_configuration(one, replay, recorded, refused, tmp_path):
    data = one.read_bytes()
    found = items(data)
    bare = tmp_path / "bare.record"
    bare.write_bytes(data[found[1][3]:])
    assert "--configuration" in refused(tmp_path, "replay", bare)
    assert replay(bare, "--configuration", one)[1]["differences"] == 0
    assert "of another node" in refused(tmp_path, "replay", bare, "--configuration", one.with_name("node_05.record"))
    other, _ = recorded("--steps", 30, "--real", "float32")
    assert "precision" in refused(tmp_path, "replay", bare, "--configuration", other / one.name)
    assert "no configuration" in refused(tmp_path, "replay", one, "--configuration", bare)
    # In place of the record's own it counts too: with another A[0] the first psi differs.
    changed = tmp_path / "changed.record"
    slots = struct.unpack_from("<H", data, 6 + 4)[0]
    changed.write_bytes(flipped(data, 0, 18 + 4 * slots + 6, 3))
    first = replay(one, "--configuration", changed, status=1)[1]["first_difference"]
    assert (first["step"], first["what"]) == (0, "psi[0]")


def test_joined(one, replay):
    """Drains of a recorder that was started again: without a gap, with one, and another node's record behind."""
    data = one.read_bytes()
    found = items(data)
    start = found[2][3]
    again = data + data
    text, summary = replay(again)
    assert [b["kind"] for b in summary["states_restored"]] == ["first", "gap"] and summary["steps"] == 60
    assert "goes on at step 0, the replay was at step 30" in text and summary["states_restored"][1]["byte"] == len(data) + found[1][3]
    # The state at the start twice: the replay is in it.
    text, summary = replay(data[:start] + data)
    assert [b["kind"] for b in summary["states_restored"]] == ["first", "seamless"] and "seamless" in text
    text, summary = replay(data + one.with_name("node_05.record").read_bytes())
    assert [b["kind"] for b in summary["states_restored"]] == ["first", "other"] and "another configuration" in text and summary["node"] == 2


# --- what simulate refuses ---------------------------------------------------------------------------------------------------------


def test_refusals(refused, projectile, tmp_path):
    for options, complaint in ((("--filter", "kfc"), "records are of nodes"), (("--filter", "all"), "records are of nodes"), (("--resume", "{}/kept"), "not records")):
        assert complaint in refused(tmp_path, "simulate", projectile, "--record", "{}/records", *options)
    assert "No such file" in refused(tmp_path, "simulate", projectile, "--record", "{}/none/records")
    (tmp_path / "file").write_text("")
    assert "node_00.record: Not a directory" in refused(tmp_path, "simulate", projectile, "--record", "{}/file")
    (tmp_path / "records" / "node_04.record").mkdir(parents=True)
    assert "node_04.record: Is a directory" in refused(tmp_path, "simulate", projectile, "--record", "{}/records")


def test_full_disk(run, projectile, tmp_path):
    place = tmp_path / "records"
    place.mkdir()
    (place / "node_01.record").symlink_to("/dev/full")
    done = run("simulate", projectile, "--steps", 3, "--record", place, status=1)
    assert b"node_01.record: No space left" in done.stderr
