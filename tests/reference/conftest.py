# SPDX-License-Identifier: MIT
"""Finds the program under test and runs it.

MESHKAL           path of the program, default build/meshkal of this checkout
MESHKAL_REQUIRED  1: a missing program is a failure. Otherwise the tests that need it are skipped, so that the reference
                  can check itself on a machine without a compiler.
"""
import json
import os
import pathlib
import subprocess

# One thread: the matrices are small, and thread pools of several workers only get in each other's way.
for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(variable, "1")

import pytest

ROOT = pathlib.Path(__file__).resolve().parents[2]


@pytest.fixture(scope="session")
def meshkal():
    """run(*arguments, ok=True) -> CompletedProcess. `ok` says whether the exit status has to be 0 or must not be."""
    path = pathlib.Path(os.environ.get("MESHKAL", ROOT / "build" / "meshkal"))
    if not os.access(path, os.X_OK):
        message = f"no program at {path}: build it or set MESHKAL"
        (pytest.fail if os.environ.get("MESHKAL_REQUIRED") == "1" else pytest.skip)(message)

    def run(*arguments, ok=True):
        done = subprocess.run([str(path), *map(str, arguments)], capture_output=True, text=True, timeout=100)
        assert done.returncode >= 0, f"died of signal {-done.returncode}: {done.args}\n{done.stderr}"
        assert (done.returncode == 0) == ok, f"exit {done.returncode}: {done.args}\n{done.stdout}\n{done.stderr}"
        return done
    return run


@pytest.fixture(scope="session")
def scenario_file(tmp_path_factory):
    """Writes a scenario once, returns its path."""
    folder = tmp_path_factory.mktemp("scenarios")

    def write(scenario):
        path = folder / f"{scenario['name']}.json"
        if not path.exists():
            path.write_text(json.dumps(scenario))
        return path
    return write
