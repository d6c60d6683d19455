# SPDX-License-Identifier: MIT
"""Networks of meshkal-node processes: settings, readings drawn from the model, telemetry read back, counters of the reports."""
import json
import pathlib
import re
import signal
import socket
import struct
import subprocess
import time
import zlib

import cbor2
import numpy as np
from fabric import die_with_parent

PERIOD = 20  # ms, of the tests of one node or two
KEY = "00112233445566778899aabbccddeeff" * 2
DTYPES = {64: "u1", 70: "<u4", 85: "<f4", 86: "<f8"}


class World:
    """A scenario with a truth and readings for some steps."""

    def __init__(self, scenario, steps, seed=5):
        self.scenario = scenario
        self.nodes = len(scenario["nodes"])
        self.neighbours = [sorted({j for e in scenario["edges"] if k in e for j in e} - {k}) for k in range(self.nodes)]
        rng = np.random.default_rng(seed)
        model = scenario["model"]
        A, Q = np.array(model["A"]), np.array(model["Q"])
        n = len(A)
        x = np.array(model.get("x0", np.zeros(n))) + np.linalg.cholesky(np.array(model.get("P0", np.eye(n)))) @ rng.normal(size=n)
        self.truth, self.readings = np.zeros((steps, n)), []
        for t in range(steps):
            self.truth[t] = x
            self.readings.append([np.array(s["C"]) @ x + np.linalg.cholesky(np.array(s["R"])) @ rng.normal(size=len(s["C"])) for s in scenario["nodes"]])
            x = A @ x + np.array(model.get("input", np.zeros(n))) + np.linalg.cholesky(Q + 1e-15 * np.eye(n)) @ rng.normal(size=n)

    def lines(self, k, first, begin=0):
        """All readings of node k as input, step t of the world being step first + t of the clock."""
        return "".join(f"{first + t},{','.join(repr(float(v)) for v in y[k])}\n" for t, y in enumerate(self.readings) if t >= begin)

    def write_csv(self, folder, used):
        """As meshkal simulate --measurements and --truth want them: the readings of these (step, node)."""
        rows = ["t,node,row,value"] + [f"{t},{k},{r},{float(v)!r}" for t, k in sorted(used) for r, v in enumerate(self.readings[t][k])]
        states = ["t,state,value"] + [f"{t},{i},{v!r}" for t, x in enumerate(self.truth) for i, v in enumerate(map(float, x))]
        (folder / "y.csv").write_text("\n".join(rows) + "\n")
        (folder / "x.csv").write_text("\n".join(states) + "\n")


def read_log(path):
    """(header, {step: item}, end item or None) of a log, which may have been cut."""
    header, items, end = None, {}, None
    with open(path, "rb") as stream:
        decoder = cbor2.CBORDecoder(stream, tag_hook=lambda _, tag: np.frombuffer(tag.value, DTYPES[tag.tag]))
        try:
            header = decoder.decode()
            while end is None:
                item = decoder.decode()
                if "end" in item:
                    end = item
                else:
                    items[item["step"]] = item
        except (EOFError, cbor2.CBORDecodeEOF):
            pass
    return header, items, end


class Report:
    """The counters of one report on standard error, by their names: report["frames sent"]."""

    def __init__(self, text):
        self.text = text
        self.frames = {name: int(count) for name, count in re.findall(r"(MK_[A-Z_]+) (\d+)", text)}

    def __getitem__(self, name):
        found = re.findall(rf"(?:^|[ ,;]){name} (\d+)", self.text, re.M)
        assert found, f"{name} is not in:\n{self.text}"
        return int(found[-1])


class Node:
    def __init__(self, process, folder, k):
        self.process, self.folder, self.k = process, folder, k
        self.errors = folder / f"{k}.err"

    def feed(self, text):
        self.process.stdin.write(text.encode())
        self.process.stdin.flush()

    def said(self):
        return self.errors.read_text()

    def report(self):
        """The last report that is complete."""
        found = re.findall(r"^meshkal-node \d+: step .*?^  telemetry .*?\n", self.said(), re.M | re.S)
        return Report(found[-1]) if found else None

    def stop(self, number=15, timeout=5):
        """SIGTERM, and an orderly end within the time. The last report."""
        self.listens()
        self.process.send_signal(number)
        status = self.process.wait(timeout)
        text = self.said()
        assert "Sanitizer" not in text and "runtime error" not in text, text
        assert status == 0, f"exit {status}:\n{text}"
        return self.report()

    def listens(self):
        """Waits until the node takes signals from its descriptor, for which it blocks them: before that SIGTERM just ends it."""
        for _ in range(1000):
            try:
                blocked = re.search(r"^SigBlk:\s*([0-9a-f]+)", pathlib.Path(f"/proc/{self.process.pid}/status").read_text(), re.M)
            except OSError:
                return
            if not blocked or int(blocked[1], 16) >> 14 & 1 or self.process.poll() is not None:
                return
            time.sleep(0.01)

    def kill(self):
        self.process.kill()
        self.process.wait(5)


class Bench:
    """Settings, processes and files of one test."""

    def __init__(self, program, folder):
        self.program, self.folder, self.running = program, folder, []
        self.node_program = str(pathlib.Path(program).with_name("meshkal-node"))

    def write(self, name, value, mode=0o644):
        path = self.folder / name
        path.write_text(value if isinstance(value, str) else json.dumps(value, indent=1))
        path.chmod(mode)
        return path

    def start(self, k, settings, prefix=(), again="", env=None):
        """Node k with these settings. again: so that the files of an earlier life stay."""
        path = self.write(f"{k}{again}.json", settings)
        with open(self.folder / f"{k}.err", "ab") as errors:
            process = subprocess.Popen([*prefix, self.node_program, str(path)], stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=errors, env=env,
                                       preexec_fn=die_with_parent)
        node = Node(process, self.folder, k)
        self.running.append(node)
        return node

    def close(self):
        for node in self.running:
            if node.process.poll() is None:
                node.process.kill()
        for node in self.running:
            node.process.wait(5)
            node.process.stdin.close()


def port():
    """A UDP port that was free a moment ago."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def clock_step(period_ms):
    return int(time.time() * 1000 // period_ms)


def wait_until(true, timeout, what):
    end = time.monotonic() + timeout
    while not true():
        assert time.monotonic() < end, f"after {timeout} s not yet: {what}"
        time.sleep(0.01)


def frame(stage, node, model, step, numbers, version=1):
    """A plain frame of float32 numbers, made here."""
    body = struct.pack("<BBHII", version, stage, node, model, step & 0xFFFFFFFF) + struct.pack(f"<{len(numbers)}f", *numbers)
    return body + struct.pack("<I", zlib.crc32(body))


def report_now(node):
    """A report asked for by signal."""
    before = node.said().count("telemetry items")
    node.process.send_signal(signal.SIGUSR1)
    wait_until(lambda: node.said().count("telemetry items") > before and node.said().endswith("\n"), 3, "a report")
    return node.report()
