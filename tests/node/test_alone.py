# SPDX-License-Identifier: MIT
"""One node, or a few, on the loopback interface: frames byte by byte, hostile datagrams, estimates, readings, telemetry."""
import os
import pathlib
import socket
import struct
import subprocess
import sys
import time
import zlib

import cbor2
import numpy as np
import pytest
from nodes import PERIOD, Report, clock_step, frame, port, read_log, report_now, wait_until

RERUN = pathlib.Path(__file__).resolve().parents[2] / "tools" / "rerun"


def parse(data):
    version, kind, node, model, step = struct.unpack("<BBHII", data[:12])
    assert version == 1 and zlib.crc32(data[:-4]) == struct.unpack("<I", data[-4:])[0]
    return kind, node, model, step, np.frombuffer(data[12:-4], "<f4")


def test_frames_and_hostile_datagrams(pair):
    n = len(pair.scenario["model"]["A"])
    with pair.neighbour(1) as radio:
        node = pair.start(0)
        now = clock_step(PERIOD)
        node.feed("".join(f"{now + i},{i},{-i - 0.5}\n" for i in range(100)))
        kinds, model = {}, None
        for _ in range(12):
            kind, who, model, step, numbers = parse(radio.recv(65536))
            assert who == 0
            kinds.setdefault(kind, {})[step] = numbers
        for step, numbers in kinds[1].items():
            i = (step - now) & 0xFFFFFFFF
            assert list(numbers) == [i, -i - 0.5]
        assert all(len(numbers) == n and np.isfinite(numbers).all() for numbers in kinds[2].values())
        assert model == int(read_log(pair.folder / "0.cbor")[0]["scenario_sha256"][:8], 16)

        to = ("127.0.0.1", pair.ports[0])
        before = report_now(node)
        step = clock_step(PERIOD)
        good = frame(1, 1, model, step, [1, 2])
        bad = {"MK_ERROR_LENGTH": [b"", b"x", good[:9], frame(1, 1, model, step, [1, 2, 3]), bytes(60000)[:1] + b"\1"], "MK_ERROR_VERSION": [b"\2" + good[1:], os.urandom(1)[:0] + b"\0" * 60000],
               "MK_ERROR_CHECKSUM": [good[:-1] + bytes([good[-1] ^ 1])], "MK_ERROR_MODEL": [frame(1, 1, model ^ 1, step, [1, 2])],
               "MK_ERROR_STRANGER": [frame(1, 0, model, step, [1, 2]), frame(1, 7, model, step, [1, 2])], "MK_ERROR_TYPE": [frame(3, 1, model, step, [1, 2]), frame(0x51, 1, model, step, [1, 2])],
               "MK_ERROR_SECURITY": [bytes([1, 0x21]) + good[2:] + bytes(40)], "MK_ERROR_LATE": [frame(1, 1, model, step - 50, [1, 2])]}
        for datagrams in bad.values():
            for datagram in datagrams:
                radio.sendto(datagram, to)
        time.sleep(0.1)
        after = report_now(node)
        for name, datagrams in bad.items():
            assert after.frames.get(name, 0) - before.frames.get(name, 0) == len(datagrams), (name, after.text)
        assert after["datagrams received"] == sum(after.frames.values())
        for _ in range(50):  # one of them is in time
            radio.sendto(frame(1, 1, model, clock_step(PERIOD), [float("nan"), 1]), to)
            time.sleep(0.002)
        # A flood stops nothing.
        for _ in range(20000):
            radio.sendto(b"\1" * 40, to)
        flooded = node.stop()
        assert flooded["left out"] == 0 or flooded["steps done"] > 20, flooded.text
        assert flooded.frames["MK_ERROR_NOT_FINITE"] > 0
        header, items, end = read_log(pair.folder / "0.cbor")
        assert end == {"end": "complete", "items": len(items)} and all(np.isfinite(i["estimate"]).all() for i in items.values())
        assert header["estimator_nodes"] == [0] and header["slots"] == [[0, 1]] and header["source"] == "live" and header["dt_s"] == PERIOD / 1000


def test_estimates_are_those_of_an_independent_filter(pair):
    """Alone, with its own readings only: the plain Kalman filter in numpy (tolerance 0)."""
    pair.scenario["tolerance"] = 0.0
    pair.bench.write("net.json", pair.scenario)
    model, sensor = pair.scenario["model"], pair.scenario["nodes"][0]
    A, Q, C, R = (np.array(v) for v in (model["A"], model["Q"], sensor["C"], sensor["R"]))
    x, P = np.array(model.get("x0", np.zeros(len(A)))), np.array(model.get("P0", np.eye(len(A))))
    epoch = time.time() + 0.5
    node = pair.start(0, real="float64", clock={"period_ms": 40, "epoch_s": epoch})
    rng = np.random.default_rng(1)
    y = rng.normal(size=(30, 2)) * 10
    node.feed("".join(f"{t},{a!r},{b!r}\n" for t, (a, b) in enumerate(y.tolist())))
    time.sleep(epoch + 27 * 0.04 - time.time())
    node.stop()
    _, items, _ = read_log(pair.folder / "0.cbor")
    for t in range(25):
        item = items[t]
        np.testing.assert_allclose(item["estimate"], x, rtol=1e-8, atol=1e-8)
        np.testing.assert_allclose(item["trace_covariance"], np.trace(P), rtol=1e-8)
        np.testing.assert_allclose(item["variance"], np.diag(P), rtol=1e-8)
        np.testing.assert_allclose(item["innovation"], y[t] - C @ x, rtol=1e-8, atol=1e-8)
        np.testing.assert_allclose(item["innovation_variance"], np.diag(C @ P @ C.T + R), rtol=1e-8)
        assert list(item["measurements_arrived"]) == [1, 0] and list(item["estimates_arrived"]) == [1, 0]
        np.testing.assert_array_equal(item["measurements"], [*y[t], np.nan, np.nan])
        K = P @ C.T @ np.linalg.inv(C @ P @ C.T + R)
        x, P = A @ (x + K @ (y[t] - C @ x)) + np.array(model.get("input", np.zeros(len(A)))), A @ (P - K @ C @ P) @ A.T + Q


def test_a_refused_reading_has_its_innovation(pair):
    model, sensor = pair.scenario["model"], pair.scenario["nodes"][0]
    A, C, R = np.array(model["A"]), np.array(sensor["C"]), np.array(sensor["R"])
    x = [np.array(model["x0"])]
    while len(x) < 7:
        x.append(A @ x[-1] + np.array(model["input"]))
    # As predicted but for one.
    y = {t: (C @ x[t] + (1e6 if t == 3 else 0.0)).tolist() for t in (1, 3, 5)}
    epoch = time.time() + 0.5
    node = pair.start(0, real="float64", clock={"period_ms": 40, "epoch_s": epoch}, gate={"reading": 0.999})
    node.feed("".join(f"{t},{a!r},{b!r}\n" for t, (a, b) in y.items()))
    time.sleep(epoch + 8 * 0.04 - time.time())
    node.stop()
    _, items, _ = read_log(pair.folder / "0.cbor")
    for t in range(7):
        item = items[t]
        assert item["measurements_arrived"][0] == (t in (1, 5)), t
        assert np.isnan(item["measurements"][:2]).all() == (t not in (1, 5))
        if t in y:
            np.testing.assert_allclose(item["innovation"], y[t] - C @ item["estimate"], rtol=1e-12, atol=1e-9)
            assert (item["innovation_variance"] > np.diag(R)).all()
        else:
            assert np.isnan(item["innovation"]).all() and np.isnan(item["innovation_variance"]).all()


@pytest.mark.parametrize("kind", ["-", "udp", "unix"])
def test_readings(pair, kind):
    where = port()
    channel = {"-": "-", "udp": f"udp:127.0.0.1:{where}", "unix": "unix:in.sock"}[kind]
    node = pair.start(0, readings=channel)
    out = socket.socket(socket.AF_INET if kind == "udp" else socket.AF_UNIX, socket.SOCK_DGRAM)
    target = ("127.0.0.1", where) if kind == "udp" else str(pair.folder / "in.sock")
    send = node.feed if kind == "-" else lambda text: out.sendto(text.encode(), target)
    wait_until(lambda: kind != "unix" or (pair.folder / "in.sock").exists(), 2, "the socket")
    now = clock_step(PERIOD)
    send("# a comment\n\nnow,1,2\r\n")
    time.sleep(0.1)
    ahead = clock_step(PERIOD) + 10
    for line in (f"{ahead}, 3.5 ,-4e1", f"{ahead},5,6", f"{now - 5},1,2", f"{ahead + 5000},1,2", "now,1", "now,1,2,3", "now,1,x", "now,nan,2", "now,1e39,2", "soon,1,2",
                 "-1,1,2", "now", "9" * 40 + ",1,2", "now,1,2 3"):
        send(line + "\n")
    send(f"now,{'1' * 70000 if kind == '-' else '1' * 60000},2\n")
    send("now,7,8")
    if kind == "-":
        node.feed("\n")
    time.sleep(0.4)
    report = node.stop()
    # Two of the three that are "now", at least: the last may fall into a step that has one.
    assert report["own readings taken"] == 3 and report["repeated"] == 1 and report["late"] == 1 and report["too far ahead"] == 1, report.text
    assert report["refused"] == 11, report.text
    _, items, _ = read_log(pair.folder / "0.cbor")
    used = {t: list(i["measurements"][:2]) for t, i in items.items() if i["measurements_arrived"][0]}
    assert used[ahead] == [3.5, -40] and sorted(used.values()) == [[1, 2], [3.5, -40], [7, 8]], used
    assert not (pair.folder / "in.sock").exists()
    out.close()


def test_telemetry_readers_come_go_and_sleep(pair, tmp_path):
    node = pair.start(0, telemetry="unix:out.sock")
    wait_until(lambda: (pair.folder / "out.sock").exists(), 2, "the socket")

    def reader():
        s = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        s.connect(str(pair.folder / "out.sock"))
        return s

    asleep, gone, awake = reader(), reader(), reader()
    node.feed("".join(f"{clock_step(PERIOD) + i},1,2\n" for i in range(100)))
    time.sleep(0.2)
    gone.close()
    late = reader()
    many = [reader() for _ in range(12)]  # more than there are places
    time.sleep(0.3)
    data, data_late = b"", b""
    report = node.stop()
    while part := awake.recv(1 << 20):
        data += part
    while part := late.recv(1 << 20):
        data_late += part
    for s in (asleep, awake, late, *many):
        s.close()
    assert report["steps done"] + report["left out"] >= 20 and report["left out"] < 10
    for content in (data, data_late):
        (tmp_path / "log.cbor").write_bytes(content)
        _, items, end = read_log(tmp_path / "log.cbor")
        assert end == {"end": "complete", "items": len(items)} and len(items) > 10 and list(items) == sorted(items)
    assert not (pair.folder / "out.sock").exists()


def test_telemetry_reader_that_hardly_reads(pair):
    """A pipe of which little is read: items are dropped, the node goes on and ends when told to. Steps of 1 ms fill what there is of room."""
    path = pair.bench.write("0.json", pair.settings(0, telemetry="-", clock={"period_ms": 1}, readings="none"))
    process = subprocess.Popen([pair.bench.node_program, str(path)], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    try:
        time.sleep(0.8)
        os.read(process.stdout.fileno(), 8192)
        time.sleep(1.0)
        process.terminate()
        process.wait(5)
        _, text = process.communicate()
    finally:
        process.kill()
    report = Report(text.decode())
    assert process.returncode == 0 and report["dropped"] > 50, report.text
    assert report["telemetry items"] == report["steps done"] > 1000


def test_telemetry_by_datagrams(pair, tmp_path):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:
        s.bind(("127.0.0.1", 0))
        s.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
        s.settimeout(0.3)
        node = pair.start(0, telemetry=f"udp:127.0.0.1:{s.getsockname()[1]}", clock={"period_ms": 5})
        time.sleep(0.8)
        node.stop()
        data = []
        try:
            while True:
                data.append(s.recv(65536))
        except TimeoutError:
            pass
    items = [cbor2.loads(d) for d in data]
    assert sum("format" in i for i in items) >= 2 and "format" in items[0] and "end" in items[-1]
    (tmp_path / "log.cbor").write_bytes(b"".join(data))
    done = subprocess.run([sys.executable, "-m", "meshkal_rerun", tmp_path / "log.cbor", "-o", tmp_path / "log.rrd"], capture_output=True, text=True,
                          env=os.environ | {"PYTHONPATH": str(RERUN)}, timeout=60)
    assert done.returncode == 0 and done.stderr == "", done.stderr
