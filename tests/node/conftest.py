# SPDX-License-Identifier: MIT
"""Finds meshkal and, beside it, meshkal-node.

MESHKAL           path of the program, default build/meshkal of this checkout
MESHKAL_REQUIRED  1: a missing program is a failure. Otherwise the tests are skipped.
"""
import json
import os
import pathlib
import socket
import subprocess

import pytest
from fabric import Fabric, Unavailable
from nodes import PERIOD, Bench, World, port

ROOT = pathlib.Path(__file__).resolve().parents[2]


@pytest.fixture(scope="session")
def program():
    path = pathlib.Path(os.environ.get("MESHKAL", ROOT / "build" / "meshkal")).resolve()
    missing = [str(p) for p in (path, path.with_name("meshkal-node")) if not os.access(p, os.X_OK)]
    if missing:
        message = "not there: " + ", ".join(missing)
        (pytest.fail if os.environ.get("MESHKAL_REQUIRED") == "1" else pytest.skip)(message)
    return str(path)


@pytest.fixture(scope="module")
def fabric():
    """Ten namespaces on one switch."""
    try:
        made = Fabric(10)
    except Unavailable as reason:
        pytest.skip(f"no network namespaces here: {reason}")
    yield made
    made.close()


@pytest.fixture
def bench(program, tmp_path):
    """Starts nodes, and ends them when the test ends, however it does."""
    bench = Bench(program, tmp_path)
    yield bench
    bench.close()


@pytest.fixture(scope="session")
def draw(program):
    """draw(nodes, seed): a network of the published example as a dictionary."""
    def call(nodes, seed=1, density=4):
        text = subprocess.run([program, "scenario", "projectile", "--nodes", str(nodes), "--seed", str(seed), "--density", str(density)],
                              check=True, capture_output=True).stdout
        return json.loads(text)
    return call


@pytest.fixture
def world(draw):
    return lambda nodes, steps, **options: World(draw(nodes, **options), steps)


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
            node.listens()
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
