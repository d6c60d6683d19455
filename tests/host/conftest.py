# SPDX-License-Identifier: MIT
"""Finds the program under test, as tests/reference does, and runs it with bytes in and out.

MESHKAL           path of the program, default build/meshkal of this checkout
MESHKAL_REQUIRED  1: a missing program is a failure. Otherwise the tests are skipped.
"""
import ctypes
import os
import pathlib
import subprocess

# One thread: the matrices are small, and thread pools of several workers only get in each other's way.
for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(variable, "1")

import pytest

ROOT = pathlib.Path(__file__).resolve().parents[2]


@pytest.fixture(scope="session")
def program():
    path = pathlib.Path(os.environ.get("MESHKAL", ROOT / "build" / "meshkal")).resolve()
    if not os.access(path, os.X_OK):
        message = f"no program at {path}: build it or set MESHKAL"
        (pytest.fail if os.environ.get("MESHKAL_REQUIRED") == "1" else pytest.skip)(message)
    return str(path)


@pytest.fixture(scope="session")
def run(program):
    """run(*arguments, status=0) -> CompletedProcess with bytes. Deaths by signal and sanitizer reports always fail."""
    def call(*arguments, status=0, **options):
        options = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "timeout": 60} | options
        done = subprocess.run([program, *map(str, arguments)], **options)
        text = (done.stderr or b"").decode(errors="replace")
        assert "Sanitizer" not in text and "runtime error" not in text, text
        assert done.returncode == status, f"exit {done.returncode}, not {status}: {done.args}\n{text}"
        return done
    return call


@pytest.fixture(scope="session")
def refused(run):
    """refused(folder, *arguments) -> the one line on standard error. Exit status 2, nothing on standard output and nothing new in the
    folder; `{}` in an argument stands for the folder."""
    def call(folder, *arguments):
        before = sorted(folder.rglob("*"))
        done = run(*(str(a).replace("{}", str(folder)) for a in arguments), status=2)
        text = done.stderr.decode()
        assert done.stdout == b"", done.stdout
        assert sorted(folder.rglob("*")) == before, "something was left behind"
        assert text.startswith("meshkal: ") and text.endswith("\n") and text.count("\n") == 1, text
        return text[len("meshkal: "):-1]
    return call


# The suite runs twice. What is random and long, and the same C code in both, runs in the plain one only.
SANITIZED = "sanitize" in os.environ.get("MESHKAL", "")


@pytest.fixture(scope="session")
def shared(tmp_path_factory):
    """shared(sources ...) -> those C files of the tree as a library for ctypes. In the sanitized run undefined behaviour ends the test; the
    address sanitizer would have to be loaded before Python."""
    def build(*sources):
        place = tmp_path_factory.mktemp("shared") / "tested.so"
        sanitize = ["-fsanitize=undefined", "-fno-sanitize-recover=all"] if SANITIZED else []
        include = [f"-I{ROOT}/{folder}" for folder in ("include", "src", "port/host", "tools/meshkal")]
        subprocess.run(["gcc", "-std=c99", "-O2", "-g", "-ffp-contract=off", "-D_POSIX_C_SOURCE=200809L", *sanitize, "-shared", "-fPIC", *include,
                        *(ROOT / s for s in sources), "-o", place, "-llapacke", "-lm"], check=True)
        return ctypes.CDLL(str(place))
    return build


@pytest.fixture(scope="session")
def code(shared):
    """The node library."""
    return shared("src/meshkal/meshkal.c")


def pytest_configure(config):
    config.addinivalue_line("markers", "once: statistics of C code that the plain run has already taken")


def pytest_collection_modifyitems(items):
    for item in items:
        if SANITIZED and item.get_closest_marker("once"):
            item.add_marker(pytest.mark.skip(reason="statistics: in the plain run"))
