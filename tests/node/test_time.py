# SPDX-License-Identifier: MIT
"""What a node does about lost time: a saved state taken up, sleep, a clock that is set, a clock that is slow."""
import os
import signal
import struct
import subprocess
import time

import numpy as np
import pytest
from nodes import PERIOD, clock_step, read_log, report_now


def test_state_is_kept_and_taken_up(pair):
    state = {"file": "state", "every_s": 0.05}
    node = pair.start(0, state=state)
    node.feed("".join(f"{clock_step(PERIOD) + i},50,60\n" for i in range(10)))
    time.sleep(0.4)
    node.kill()
    time.sleep(3 * PERIOD / 1000)  # steps to make up for
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
    node.listens()
    for seconds in (0.2, 0.8):
        node.process.send_signal(signal.SIGSTOP)
        time.sleep(seconds)
        node.process.send_signal(signal.SIGCONT)
        time.sleep(0.15)
    report = node.stop()
    _, items, _ = read_log(pair.folder / "0.cbor")
    assert report["left out"] > 30 and report["made up for"] >= 5 and report["started again after long silence"] == 1, report.text
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
