# SPDX-License-Identifier: MIT
"""Damaged logs: what comes before the damage is read and recorded, and the message says where it is."""

import io
import os

import cbor2
import numpy as np
import pytest
from readback import Recording, command
from synthetic import Log, typed
from synthetic_monitor import NavigationLog
from synthetic_tracking import TrackingLog
from test_some_nodes import some

from meshkal_log.reader import LogError, LogReader

KINDS = {
    "linear": lambda: Log(nodes=3, steps=4),
    "central": lambda: Log(nodes=2, steps=4, filter="rkfc", real="float32"),
    "tracking": lambda: TrackingLog(sensors=("range", "bearing", "none"), steps=4),
    "navigation": lambda: NavigationLog(steps=6),
}


def read(data: bytes) -> tuple[LogReader, list]:
    reader = LogReader(io.BufferedReader(io.BytesIO(data)))
    return reader, list(reader.batches(0))


def changed(items: list[bytes], where: int, **changes) -> bytes:
    item = {**cbor2.loads(items[where]), **changes}
    return cbor2.dumps({key: value for key, value in item.items() if value is not None})


def damaged(at: int, **changes) -> bytes:
    """A log of two nodes and six steps, step `at` of it changed."""
    items = Log(nodes=2, steps=6).items()
    return b"".join([*items[: at + 1], changed(items, at + 1, **changes), *items[at + 2 :]])


DAMAGE = {
    "length": ({"theta": typed([1.0], "<f8")}, "theta has 1 numbers instead of 2"),
    "type": ({"theta": typed([1.0, 1.0], "<f4")}, "theta is missing or not an array of float64"),
    "odd bytes": ({"theta": cbor2.CBORTag(86, b"123")}, "buffer size must be a multiple"),
    "lost array": ({"theta": None}, "theta is missing"),
    "lost truth": ({"truth": None}, "truth is in some steps and not in others"),
    "order": ({"step": 1}, "step 1 comes after run 0, step 1"),
    "far step": ({"step": 1 << 62}, "is beyond the clock"),
    "no step": ({"step": -3}, "step is missing or not an unsigned number"),
    "run": ({"run": 3}, "it is of run 3, and the header says 1 runs"),
    "end": ({"end": "perhaps"}, "end is neither complete nor interrupted nor failed"),
}


@pytest.mark.parametrize("case", DAMAGE)
def test_what_comes_before_the_damage_is_recorded(tmp_path, case):
    changes, message = DAMAGE[case]
    data, byte = damaged(2, **changes), sum(map(len, Log(nodes=2, steps=6).items()[:3]))
    (tmp_path / "run.cbor").write_bytes(data)
    done = command(tmp_path / "run.cbor")
    said = done.stderr.decode()
    assert done.returncode == 1 and said.count("\n") == 1 and message in said
    assert said.startswith(f"meshkal-rerun: {tmp_path}/run.cbor: damaged at item 4 (byte {byte}, after step 1): ")
    assert said.endswith("; run.rrd holds steps 0 to 1\n")
    recording = Recording(tmp_path / "run.rrd")
    np.testing.assert_array_equal(recording.series("theta/node/1"), Log(nodes=2, steps=6).arrays["theta"][0, :2, 1])
    assert "**damaged" in recording.summary()
    assert sorted(os.listdir(tmp_path)) == ["run.cbor", "run.rrd"]


def test_damage_in_another_run(tmp_path):
    items = Log(nodes=2, steps=3, runs=3).items()
    data = b"".join([*items[:6], b"\xff", *items[7:]])
    reader, batches = read(data)
    assert batches[0].step.tolist() == [0, 1, 2] and reader.end == "damaged"
    assert reader.damage[0].startswith(f"damaged at item 7 (byte {sum(map(len, items[:6]))}, after run 1, step 1): ")
    with pytest.raises(LogError, match=r"item 7 \(byte \d+, after run 1, step 1\)"):
        list(LogReader(io.BufferedReader(io.BytesIO(data))).batches(2))


def test_a_failed_run_is_read(tmp_path):
    log = Log(nodes=2, steps=3)
    log.end = "failed"
    (tmp_path / "run.cbor").write_bytes(log.data())
    done = command(tmp_path / "run.cbor")
    assert done.returncode == 0 and b"warning: the run failed after 3 step items" in done.stderr
    assert "**the run failed" in Recording(tmp_path / "run.rrd").summary()


def test_a_wrong_length_is_not_taken_for_a_cut():
    """A damaged length can swallow all that follows, which ends like a cut log."""
    items = Log(nodes=2, steps=12).items()
    whole = b"".join(items[:5])
    tagged = items[5].index(b"etheta") + len(b"etheta")
    assert items[5][tagged : tagged + 4] == b"\xd8\x56\x50" + items[5][tagged + 3 : tagged + 4]  # tag 86, 16 bytes
    data = whole + items[5][: tagged + 2] + b"\x5b" + (1 << 40).to_bytes(8, "big") + items[5][tagged + 3 :] + b"".join(items[6:])
    reader, batches = read(data)
    assert batches[0].step.tolist() == [0, 1, 2, 3]
    assert reader.warnings == [f"damaged at item 6 (byte {len(whole)}, after step 3): it does not end, a length in it is wrong"]


@pytest.mark.parametrize("kind", KINDS)
def test_a_flipped_bit_anywhere(kind):
    """Never anything but numbers or a LogError of one line; what comes before it is as it was."""
    data = KINDS[kind]().data()
    rng = np.random.default_rng(11)
    _, (whole,) = read(data)
    ends = np.cumsum([len(item) for item in KINDS[kind]().items()])
    refused = stopped = 0
    for at in range(0, len(data), 2):
        flipped = bytearray(data)
        flipped[at] ^= 1 << int(rng.integers(8))
        try:
            reader, batches = read(bytes(flipped))
        except LogError as error:
            assert at < ends[1] and "\n" not in str(error), f"byte {at}: {error}"
            refused += 1
            continue
        stopped += reader.end == "damaged"
        good = int(np.searchsorted(ends, at, side="right")) - 1  # steps before it
        steps = [t for batch in batches for t in batch.step.tolist()]
        assert len(steps) >= good
        if good > 0:
            np.testing.assert_array_equal(batches[0].estimate[:good], whole.estimate[:good])
            np.testing.assert_array_equal(batches[0].step[:good], whole.step[:good])
    assert refused > 50 and stopped > 50  # names of keys alone give as many


@pytest.mark.parametrize("kind", KINDS)
def test_bytes_that_are_lost_or_too_many(kind):
    data = KINDS[kind]().data()
    rng = np.random.default_rng(12)
    for _ in range(400):
        at, length = int(rng.integers(len(data))), int(rng.integers(1, 40))
        if rng.random() < 0.5:
            changed = data[:at] + data[at + length :]
        else:
            changed = data[:at] + rng.bytes(length) + data[at:]
        try:
            read(changed)
        except LogError as error:
            assert "\n" not in str(error)


@pytest.mark.parametrize("kind", KINDS)
def test_flipped_bits_on_the_command_line(kind, tmp_path, capsys):
    """The whole way: a recording that is whole, or none."""
    from meshkal_rerun import cli

    data, rng = KINDS[kind]().data(), np.random.default_rng(13)
    log, output = tmp_path / "run.cbor", tmp_path / "run.rrd"
    seen = set()
    for at in rng.integers(0, len(data), 15):
        flipped = bytearray(data)
        flipped[at] ^= 1 << int(rng.integers(8))
        log.write_bytes(flipped)
        output.unlink(missing_ok=True)
        status = cli.main([str(log)])
        said = capsys.readouterr().err
        seen.add(status)
        assert status in (0, 1, 2) and output.exists() == (status < 2), f"byte {at}: {said}"
        assert (status == 2) <= (said.count("\n") == 1)
        assert (status == 1) == ("; run.rrd holds step" in said)
        if status < 2:
            Recording(output).entities()
    assert {1, 2} & seen
    assert sorted(os.listdir(tmp_path)) in (["run.cbor"], ["run.cbor", "run.rrd"])


def test_damage_in_one_of_several_logs(tmp_path):
    """The others are read to their ends."""
    for name, node, at in (("a", 0, None), ("b", 1, 3)):
        items = some(Log(nodes=5, truth=False), [node]).items()
        if at is not None:
            items[at] = changed(items, at, theta=None)
        (tmp_path / f"{name}.cbor").write_bytes(b"".join(items))
    done = command(tmp_path / "a.cbor", tmp_path / "b.cbor", "-o", tmp_path / "run.rrd")
    assert done.returncode == 1 and f"{tmp_path}/b.cbor: damaged at item 4 ".encode() in done.stderr, done.stderr
    recording = Recording(tmp_path / "run.rrd")
    assert np.isfinite(recording.series("theta/node/0")).sum() == 12 and np.isfinite(recording.series("theta/node/1")).sum() == 2
