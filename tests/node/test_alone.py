# SPDX-License-Identifier: MIT
"""One node, or a few, on the loopback interface: frames byte by byte, hostile datagrams, readings, telemetry, state, clock, sleep, seals."""
import os
import pathlib
import signal
import socket
import struct
import subprocess
import sys
import time
import zlib

import cbor2
import numpy as np
import pytest
from nodes import Report, clock_step, port, read_log, wait_until

RERUN = pathlib.Path(__file__).resolve().parents[2] / "tools" / "rerun"
PERIOD = 20
KEY = "00112233445566778899aabbccddeeff" * 2


@pytest.fixture
def pair(bench, draw):
    """Two nodes that are neighbours, with their ports; start(k, **more) starts one."""
    class Pair:
        scenario = draw(2, density=2)
        ports = [port(), port()]

        def settings(self, k, **more):
            base = {"scenario": "net.json", "node": k, "real": "float32", "clock": {"period_ms": PERIOD}, "listen": f"127.0.0.1:{self.ports[k]}",
                    "peers": {str(1 - k): f"127.0.0.1:{self.ports[1 - k]}"}, "readings": "-", "telemetry": f"{k}.cbor"}
            return base | more

        def start(self, k, again="", env=None, **more):
            node = bench.start(k, self.settings(k, **more), again=again, env=env)
            time.sleep(0.05)
            return node

        def neighbour(self, k):
            """The socket of node k, held by the test."""
            s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            s.bind(("127.0.0.1", self.ports[k]))
            s.settimeout(2)
            return s

    made = Pair()
    bench.write("net.json", made.scenario)
    made.folder, made.bench = bench.folder, bench
    return made


def frame(stage, node, model, step, numbers, version=1):
    body = struct.pack("<BBHII", version, stage, node, model, step & 0xFFFFFFFF) + struct.pack(f"<{len(numbers)}f", *numbers)
    return body + struct.pack("<I", zlib.crc32(body))


def parse(data):
    version, kind, node, model, step = struct.unpack("<BBHII", data[:12])
    assert version == 1 and zlib.crc32(data[:-4]) == struct.unpack("<I", data[-4:])[0]
    return kind, node, model, step, np.frombuffer(data[12:-4], "<f4")


def report_now(node):
    """A report asked for by signal."""
    before = node.said().count("telemetry items")
    node.process.send_signal(signal.SIGUSR1)
    wait_until(lambda: node.said().count("telemetry items") > before and node.said().endswith("\n"), 3, "a report")
    return node.report()


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
        assert list(item["measurements_arrived"]) == [1, 0] and list(item["estimates_arrived"]) == [1, 0]
        np.testing.assert_array_equal(item["measurements"], [*y[t], np.nan, np.nan])
        K = P @ C.T @ np.linalg.inv(C @ P @ C.T + R)
        x, P = A @ (x + K @ (y[t] - C @ x)) + np.array(model.get("input", np.zeros(len(A)))), A @ (P - K @ C @ P) @ A.T + Q


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


def test_state_is_kept_and_taken_up(pair):
    state = {"file": "state", "every_s": 0.05}
    node = pair.start(0, state=state)
    node.feed("".join(f"{clock_step(PERIOD) + i},50,60\n" for i in range(10)))
    time.sleep(0.4)
    node.kill()
    last = max(read_log(pair.folder / "0.cbor")[1])
    node = pair.start(0, "b", state=state, telemetry="b.cbor")
    time.sleep(0.2)
    report = node.stop(signal.SIGINT)
    assert "state: state restored" in node.said() and "making up for them" in node.said()
    first = min(read_log(pair.folder / "b.cbor")[1])
    assert 0 < report["made up for"] <= first - last + 4 and report["started again after long silence"] == 0, report.text
    # What the first life knew was not forgotten: no reading came since.
    old, new = read_log(pair.folder / "0.cbor")[1][last], read_log(pair.folder / "b.cbor")[1][first]
    model = pair.scenario["model"]
    x = old["estimate"].astype(float)
    for _ in range(first - last):
        x = np.array(model["A"]) @ x + np.array(model.get("input", np.zeros(len(x))))
    assert np.abs(x).max() > 30
    np.testing.assert_allclose(new["estimate"], x, rtol=1e-3, atol=1e-3)

    good = (pair.folder / "state").read_bytes()
    for damaged, why in ((good[:-1], "MK_ERROR_CHECKSUM"), (b"", "MK_ERROR_LENGTH"), (good[:50] + bytes([good[50] ^ 1]) + good[51:], "MK_ERROR_CHECKSUM"), (b"hello world, this is not it", "MK_ERROR_VERSION")):
        (pair.folder / "state").write_bytes(damaged)
        node = pair.start(0, "c", state=state)
        node.stop()
        assert f"no state of this node ({why})" in node.said(), node.said()
        (pair.folder / "0.err").write_text("")
    # Too old a state: a fresh start, and said so.
    (pair.folder / "state").write_bytes(good)
    node = pair.start(0, "d", state=state, catch_up=1)
    report = node.stop()
    assert "starting again from x0 and P0" in node.said() and report["started again after long silence"] >= 1
    # Of the future, because the epoch was moved.
    (pair.folder / "state").write_bytes(good)
    node = pair.start(0, "e", state=state, clock={"period_ms": PERIOD, "epoch_s": 40.0})
    report = node.stop()
    assert report["started again after long silence"] == 1 and report["step"] == pytest.approx(clock_step(PERIOD) - 2000, abs=10), report.text
    # The other node's.
    (pair.folder / "state").write_bytes(good)
    node = pair.start(1, state=state)
    node.stop()
    assert "no state of this node (MK_ERROR_STRANGER)" in node.said()


def test_sleep(pair):
    node = pair.start(0, catch_up=20)
    for seconds in (0.2, 0.8):
        node.process.send_signal(signal.SIGSTOP)
        time.sleep(seconds)
        node.process.send_signal(signal.SIGCONT)
        time.sleep(0.15)
    report = node.stop()
    _, items, _ = read_log(pair.folder / "0.cbor")
    assert report["left out"] > 40 and report["made up for"] >= 5 and report["started again after long silence"] == 1, report.text
    assert len(items) == report["steps done"] == report["telemetry items"]
    assert max(items) >= clock_step(PERIOD) - 30


SHIM = """
#define _GNU_SOURCE
#include <dlfcn.h>
#include <fcntl.h>
#include <stdint.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <time.h>
int clock_gettime(clockid_t clock, struct timespec *now) {
    static int (*real)(clockid_t, struct timespec *);
    static volatile int64_t *ms;
    if (!real) {
        real = (int (*)(clockid_t, struct timespec *))dlsym(RTLD_NEXT, "clock_gettime");
        ms = mmap(0, 8, PROT_READ, MAP_SHARED, open(getenv("CLOCK_OFFSET"), O_RDONLY), 0);
    }
    const int status = real(clock, now);
    if (clock != CLOCK_REALTIME) return status;
    const int64_t ns = (int64_t)now->tv_sec * 1000000000 + now->tv_nsec + *ms * 1000000;
    now->tv_sec = ns / 1000000000;
    now->tv_nsec = ns % 1000000000;
    return status;
}
"""


def test_the_clock_is_set(pair):
    """Forward, back a little, back a lot: the time of day comes from a library that the test preloads."""
    source, library, offset = (pair.folder / name for name in ("shim.c", "shim.so", "offset"))
    source.write_text(SHIM)
    subprocess.run(["gcc", "-shared", "-fPIC", "-o", library, source, "-ldl"], check=True)
    offset.write_bytes(struct.pack("<q", 0))
    environment = {"LD_PRELOAD": str(library), "CLOCK_OFFSET": str(offset), "ASAN_OPTIONS": "verify_asan_link_order=0"}
    node = pair.start(0, env=os.environ | environment, catch_up=20)
    ahead = 0
    for jump, left_out, put_back in ((2000, 90, 0), (-200, 90, 0), (-60000, 90, 1)):
        time.sleep(0.2)
        before = report_now(node)
        ahead += jump
        with open(offset, "r+b") as file:
            file.write(struct.pack("<q", ahead))
        time.sleep(0.5)
        report = report_now(node)
        assert report["left out"] >= left_out and report["clock put back"] == put_back, report.text
        assert report["step"] == pytest.approx(clock_step(PERIOD) + ahead // PERIOD, abs=10)
        if jump == -200:  # ten steps were waited for
            assert report["steps done"] - before["steps done"] < 22
        assert report["steps done"] - before["steps done"] > 5
    node.stop()
    _, items, end = read_log(pair.folder / "0.cbor")
    runs = [item["run"] for item in items.values()]
    assert set(runs) == {0, 1} and end["end"] == "complete"


def test_a_slow_clock_follows_the_neighbours(pair):
    """Node 1 believes it is 10 steps earlier. It is taken along, and afterwards hears and is heard."""
    nodes = [pair.start(0), pair.start(1, clock={"period_ms": PERIOD, "epoch_s": 10 * PERIOD / 1000})]
    now = clock_step(PERIOD)
    for node in nodes:
        node.feed("".join(f"{now + i},1,2\n" for i in range(200)))
    time.sleep(0.8)
    first, second = (node.stop() for node in nodes)
    assert first["of the neighbours' clocks"] == 0 and second["of the neighbours' clocks"] == 10, second.text
    assert "steps ahead of this clock: following them" in nodes[1].said()
    logs = [read_log(pair.folder / f"{k}.cbor")[1] for k in (0, 1)]
    common = sorted(set(logs[0]) & set(logs[1]))
    assert len(common) > 20
    heard = np.array([logs[0][t]["estimates_arrived"][1] for t in common[5:]])
    assert heard.mean() > 0.8


def sealed(pair, k, key="key"):
    return {"security": {"key_file": key, "boot_file": f"boots{k}"}}


def test_sealed_frames(pair):
    pair.bench.write("key", KEY, 0o600)
    pair.bench.write("other", KEY[::-1], 0o600)
    now = clock_step(PERIOD)
    lines = "".join(f"{now + i},1,2\n" for i in range(300))
    # Recorded by the test, which holds the place of node 1.
    with pair.neighbour(1) as radio:
        node = pair.start(0, **sealed(pair, 0))
        node.feed(lines)
        recorded = [radio.recv(65536) for _ in range(20)]
        boot = int((pair.folder / "boots0").read_text())
        numbers = [int.from_bytes(d[12:20], "little") for d in recorded]
        assert numbers == sorted(set(numbers)) and all(0 <= x - (boot << 32) < 40 for x in numbers)
        assert all(d[1] & 0x20 for d in recorded)
        plain = frame(1, 1, int.from_bytes(recorded[0][4:8], "little"), clock_step(PERIOD), [1, 2])
        radio.sendto(plain, ("127.0.0.1", pair.ports[0]))
        radio.sendto(recorded[0][:2] + b"\1\0" + recorded[0][4:], ("127.0.0.1", pair.ports[0]))
        time.sleep(0.05)
        report = node.stop()
        assert report.frames == {"MK_ERROR_SECURITY": 1, "MK_ERROR_FORGED": 1}, report.text

    # Both with the key; a third, whose frames are the recorded ones, and node 1's played again.
    nodes = [pair.start(k, "b", **sealed(pair, k)) for k in (0, 1)]
    assert int((pair.folder / "boots0").read_text()) > boot
    for node in nodes:
        node.feed(lines)
    time.sleep(0.3)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as attacker:
        for datagram in recorded + recorded:
            attacker.sendto(datagram, ("127.0.0.1", pair.ports[1]))
        time.sleep(0.1)
    reports = [node.stop() for node in nodes]
    assert reports[0].frames.get("MK_OK", 0) > 10 and reports[1].frames.get("MK_OK", 0) > 10
    # Older than the window, because node 0 has started again since: every one of them.
    assert reports[1].frames["MK_ERROR_REPLAYED"] == 40, reports[1].text

    # The wrong key: nothing passes, in neither direction.
    nodes = [pair.start(0, "c", **sealed(pair, 0)), pair.start(1, "c", **sealed(pair, 1, "other"))]
    for node in nodes:
        node.feed(lines)
    time.sleep(0.4)
    reports = [node.stop() for node in nodes]
    for report in reports:
        assert set(report.frames) == {"MK_ERROR_FORGED"} and report.frames["MK_ERROR_FORGED"] > 5, report.text


def test_boot_file(pair):
    pair.bench.write("key", KEY, 0o600)
    # A clock that was set back: the file is ahead of it.
    future = int(time.time()) + 100000
    (pair.folder / "boots0").write_text(f"{future}\n")
    node = pair.start(0, **sealed(pair, 0))
    assert int((pair.folder / "boots0").read_text()) == future + 1
    path = pair.bench.write("second.json", pair.settings(0, listen=f"127.0.0.1:{port()}", **sealed(pair, 0)))
    done = subprocess.run([pair.bench.node_program, str(path)], capture_output=True, text=True, timeout=5, stdin=subprocess.DEVNULL)
    assert done.returncode == 2 and "security.boot_file" in done.stderr and "another node runs with it" in done.stderr
    node.kill()
    # A file that was lost: the clock stands in for it.
    (pair.folder / "boots0").unlink()
    pair.start(0, "b", **sealed(pair, 0)).stop()
    assert abs(int((pair.folder / "boots0").read_text()) - time.time()) < 60
