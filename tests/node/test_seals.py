# SPDX-License-Identifier: MIT
"""Sealed frames on the loopback interface, and the file of boots that keeps their sequence numbers apart."""
import socket
import subprocess
import time

from nodes import KEY, PERIOD, clock_step, frame, port


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
