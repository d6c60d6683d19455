# SPDX-License-Identifier: MIT
"""Latency and throughput of `meshkal-rerun --live -`: from writing a step into the pipe until a subscribed viewer has its numbers.

    .venv/bin/python tests/bench/live.py build/bench [--seconds 20]

The subscriber is rerun's own client without a window (`rerun URL --save`), which writes what it receives; its file is read as it grows. So what
is measured is pipe, decoding, batching, the server, the network and the client, and not the painting of a frame. Prints a table, writes live.json.
"""

import argparse
import json
import os
import pathlib
import subprocess
import sys
import tempfile
import threading
import time

import lz4.block
import numpy as np
import pyarrow
import rerun_cli

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests" / "rerun"))
from synthetic import Log  # noqa: E402

RERUN = pathlib.Path(rerun_cli.__file__).with_name("rerun")
NODES, RATE = 20, 100
# Of the last thing that is drawn of a step.
SEEN = "/network/nodes"
TARGET_S = 0.3


def varint(data: bytes, at: int) -> tuple[int, int]:
    value = shift = 0
    while True:
        byte = data[at]
        value |= (byte & 0x7F) << shift
        at, shift = at + 1, shift + 7
        if byte < 0x80:
            return value, at


def fields(data: bytes):
    """Numbers and values of the fields of a protobuf message."""
    at = 0
    while at < len(data):
        key, at = varint(data, at)
        if key & 7 == 0:
            value, at = varint(data, at)
        elif key & 7 == 1:
            value, at = data[at : at + 8], at + 8
        elif key & 7 == 2:
            length, at = varint(data, at)
            value, at = data[at : at + length], at + length
        else:
            raise ValueError("a recording of another version")
        yield key >> 3, value


class Client:
    """What rerun's client has received: the largest step of `SEEN`, and when it was there."""

    def __init__(self, url: str, path: pathlib.Path) -> None:
        self._path = path
        self.process = subprocess.Popen([RERUN, url, "--save", path, "--port", "auto", "--bind", "127.0.0.1"], stdin=subprocess.DEVNULL,
                                        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        self.seen: list[tuple[int, float]] = []
        self._halt = threading.Event()
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def _read(self) -> None:
        while not self._path.exists() and not self._halt.wait(0.01):
            pass
        with open(self._path, "rb", buffering=0) as file:
            data = b""
            begun = False
            while not self._halt.is_set():
                piece = file.read(1 << 20)
                now = time.monotonic()
                if not piece:
                    self._halt.wait(0.002)
                    continue
                data += piece
                at = 0 if begun else 12  # of the file's own header
                while at + 16 <= len(data):
                    kind, length = (int.from_bytes(data[at + i : at + i + 8], "little") for i in (0, 8))
                    if at + 16 + length > len(data):
                        break
                    if kind == 2:
                        self._message(data[at + 16 : at + 16 + length], now)
                    at += 16 + length
                    begun = True
                data = data[at:] if begun else data

    def _message(self, body: bytes, now: float) -> None:
        message = dict(fields(body))
        packed = message[5]
        if message.get(2) == 2:
            # Only the beginning tells whose it is, as text.
            packed = lz4.block.decompress(packed, uncompressed_size=message[3])
        if SEEN.encode() not in packed:
            return
        with pyarrow.ipc.open_stream(packed) as stream:
            batch = stream.read_next_batch()
        if "step" in batch.schema.names:
            self.seen.append((max(batch.column("step").to_pylist()), now))

    def close(self) -> None:
        self._halt.set()
        self._thread.join()
        self.process.kill()
        self.process.wait()


def live(folder: pathlib.Path) -> tuple[subprocess.Popen, str]:
    environment = os.environ | {"PYTHONPATH": str(ROOT / "tools" / "rerun")}
    command = [sys.executable, "-m", "meshkal_rerun", "--live", "-", "-o", folder / "run.rrd", "--port", "0"]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE, text=False, env=environment)
    for line in process.stderr:
        if b"rerun+http" in line:
            threading.Thread(target=process.stderr.read, daemon=True).start()
            return process, line.split()[-1].decode()
    raise SystemExit("meshkal-rerun did not start")


def wait_for(condition, seconds: float) -> None:
    until = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > until:
            raise SystemExit("the client has not received everything")
        time.sleep(0.01)


def processor_seconds(pid: int) -> float:
    user, system = pathlib.Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[11:13]
    return (int(user) + int(system)) / os.sysconf("SC_CLK_TCK")


def latency(folder: pathlib.Path, seconds: float) -> dict:
    items = Log(NODES, round(seconds * RATE), name="bench").items()
    process, url = live(folder)
    client = Client(url, folder / "client.rrd")
    try:
        wrote = {}
        process.stdin.write(items[0])
        process.stdin.flush()
        time.sleep(2.0)
        begin, used = time.monotonic(), processor_seconds(process.pid)
        for step, item in enumerate(items[1:-1]):
            time.sleep(max(0.0, begin + step / RATE - time.monotonic()))
            wrote[step] = time.monotonic()
            process.stdin.write(item)
            process.stdin.flush()
        last = len(items) - 3
        wait_for(lambda: client.seen and client.seen[-1][0] >= last, 60)
        share = (processor_seconds(process.pid) - used) / (time.monotonic() - begin)
        process.stdin.write(items[-1])
        process.stdin.close()
        process.wait()
    finally:
        process.kill()
        client.close()
    taken, delays, step = sorted(client.seen), [], 0
    for upto, when in taken:
        delays += [when - wrote[s] for s in range(step, upto + 1)]
        step = max(step, upto + 1)
    quantiles = np.percentile(delays, [50, 95, 100])
    return {"nodes": NODES, "rate_hz": RATE, "scalars_a_node": scalars(items), "steps": len(delays), "median_s": quantiles[0],
            "p95_s": quantiles[1], "max_s": quantiles[2], "max_after_the_first_second_s": max(delays[RATE:]), "cpu_share": share}


def scalars(items: list[bytes]) -> float:
    """Numbers a node and step in the log."""
    import cbor2

    step = cbor2.loads(items[1])
    size = {86: 8, 85: 4, 70: 4, 64: 1}
    return sum(len(v.value) // size[v.tag] for v in step.values() if isinstance(v, cbor2.CBORTag)) / NODES


def throughput(folder: pathlib.Path, nodes: int, steps: int) -> dict:
    """As fast as the pipe takes it: how long the writer is held up, and how long until all is recorded."""
    data = Log(nodes, steps, name="bench").data()
    process, _ = live(folder)
    try:
        begin = time.monotonic()
        process.stdin.write(data)
        process.stdin.close()
        written = time.monotonic() - begin
        process.wait()
        done = time.monotonic() - begin
    finally:
        process.kill()
    return {"nodes": nodes, "steps": steps, "written_steps_per_second": steps / written, "written_mb_per_second": len(data) / written / 1e6,
            "recorded_steps_per_second": steps / done}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--seconds", type=float, default=20.0)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        load = os.getloadavg()[0]
        found = latency(folder, arguments.seconds)
        print(f"\nmeshkal-rerun --live: {NODES} nodes, {RATE} steps/s, {found['scalars_a_node']:.1f} numbers a node in a step, {found['steps']} steps, "
              f"load before: {load:.1f}\n"
              f"from the pipe to a subscribed viewer: median {found['median_s']:.3f} s, 95 % {found['p95_s']:.3f} s, max {found['max_s']:.3f} s, "
              f"after the first second, in which all is set up, {found['max_after_the_first_second_s']:.3f} s (wanted: below {TARGET_S} s); {100 * found['cpu_share']:.0f} % of a core")
        rows = [throughput(folder, nodes, steps) for nodes, steps in ((NODES, 20000), (1000, 1000))]
    print(f"{'nodes':>6} {'steps':>6} {'taken from the pipe, steps/s':>29} {'MB/s':>6} {'recorded, steps/s':>18}")
    for row in rows:
        print(f"{row['nodes']:6d} {row['steps']:6d} {row['written_steps_per_second']:29.0f} {row['written_mb_per_second']:6.0f} "
              f"{row['recorded_steps_per_second']:18.0f}")
    arguments.folder.mkdir(parents=True, exist_ok=True)
    result = {"latency": found, "throughput": rows, "load_before": load}
    (arguments.folder / "live.json").write_text(json.dumps(result, indent=1) + "\n")


if __name__ == "__main__":
    main()
