# SPDX-License-Identifier: MIT
"""Finds meshkal and, beside it, meshkal-node.

MESHKAL           path of the program, default build/meshkal of this checkout
MESHKAL_REQUIRED  1: a missing program is a failure. Otherwise the tests are skipped.
"""
import json
import os
import pathlib
import subprocess

import pytest
from fabric import Fabric, Unavailable
from nodes import Bench, World

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
