# SPDX-License-Identifier: MIT
"""Finds meshkal and, beside it, meshkal-mpi, and runs the latter on several processes of this machine.

MESHKAL           path of the program of one process, default build/meshkal of this checkout
MESHKAL_REQUIRED  1: a missing program is a failure. Otherwise the tests are skipped.
"""
import json
import os
import pathlib
import shutil
import subprocess
import time

import pytest

ROOT = pathlib.Path(__file__).resolve().parents[2]
# More processes than cores: they must not spin while they wait. No network, no system calls that containers forbid; root is let in.
MPI = {"OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1", "OMPI_MCA_rmaps_base_oversubscribe": "1",
       "OMPI_MCA_mpi_yield_when_idle": "1", "OMPI_MCA_hwloc_base_binding_policy": "none", "OMPI_MCA_plm": "isolated", "OMPI_MCA_pml": "ob1",
       "OMPI_MCA_btl": "self,vader", "OMPI_MCA_btl_vader_single_copy_mechanism": "none",
       # Seconds from the signal that ends the others after one has failed to the one that kills them. Tests of signals take the default, 1.
       "OMPI_MCA_odls_base_sigkill_timeout": "0",
       # Of the sanitized program: Open MPI keeps some memory to the end.
       "ASAN_OPTIONS": os.environ.get("ASAN_OPTIONS", "") + ":detect_leaks=0"}
# What of a summary may differ when the same campaign is run in another way.
HOW = {"threads", "peak_memory_bytes", "seconds", "node_steps_per_second", "runs_kept", "processes", "split", "bytes_exchanged_per_step",
       "cut_links"}


def strip(value):
    if isinstance(value, dict):
        return {k: strip(v) for k, v in value.items() if k not in HOW}
    return [strip(v) for v in value] if isinstance(value, list) else value


@pytest.fixture(scope="session")
def program():
    path = pathlib.Path(os.environ.get("MESHKAL", ROOT / "build" / "meshkal")).resolve()
    parallel = path.with_name("meshkal-mpi")
    missing = [str(p) for p in (path, parallel) if not os.access(p, os.X_OK)] + ["mpirun"] * (shutil.which("mpirun") is None)
    if missing:
        message = "not there: " + ", ".join(missing)
        (pytest.fail if os.environ.get("MESHKAL_REQUIRED") == "1" else pytest.skip)(message)
    return str(path)


@pytest.fixture(scope="session")
def alone(program):
    """alone(*arguments, status=0): meshkal simulate in one process."""
    def call(*arguments, status=0):
        done = subprocess.run([program, "simulate", *map(str, arguments)], capture_output=True, timeout=60)
        assert done.returncode == status, done
        return done
    return call


@pytest.fixture(scope="session")
def environment():
    return os.environ | MPI


@pytest.fixture(scope="session")
def launch(program):
    """launch(ranks, *arguments) -> Popen of mpirun. A list of (ranks, argument, ...) instead: each group with its own arguments."""
    def call(ranks, *arguments, **environment):
        groups = ranks if isinstance(ranks, list) else [(ranks, *arguments)]
        words = ["mpirun"]
        for count, *rest in groups:
            words += [":"] * (len(words) > 1) + ["-n", str(count), program + "-mpi", *map(str, rest)]
        return subprocess.Popen(words, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                                env=os.environ | MPI | environment)
    return call


def finish(job, timeout=60):
    """Waits for mpirun. One that hangs is ended with all its processes, and the test fails."""
    try:
        job.out, job.err = job.communicate(timeout=timeout)
    except subprocess.TimeoutExpired:
        job.terminate()
        time.sleep(2)
        job.kill()
        pytest.fail(f"hangs: {' '.join(job.args)}\n{job.communicate()}")
    text = job.err.decode(errors="replace")
    assert "Sanitizer" not in text and "runtime error" not in text, text
    # What the program says; mpirun adds words of its own to a status other than 0.
    job.said = [line for line in text.splitlines() if line.startswith("meshkal: ")]
    return job


@pytest.fixture(scope="session")
def wait():
    return finish


@pytest.fixture(scope="session")
def mpi(launch):
    """mpi(ranks, *arguments, status=0) -> mpirun meshkal-mpi simulate, done."""
    def call(ranks, *arguments, status=0):
        groups = [(n, "simulate", *rest) for n, *rest in ranks] if isinstance(ranks, list) else [(ranks, "simulate", *arguments)]
        job = finish(launch(groups))
        if job.returncode == 1 and status == 0 and not job.said and b"exiting improperly" in job.err:
            # On a busy machine mpirun may take the end of a rank for its loss. A rank that fails says why; one that did not is asked again.
            job = finish(launch(groups))
        assert job.returncode == status, f"exit {job.returncode}, not {status}: {job.args}\n{job.err.decode()}"
        return job
    return call


@pytest.fixture
def figures(tmp_path):
    """The figures of a summary as text: equal means equal in every digit."""
    return lambda path: json.dumps(strip(json.loads(path.read_text())))
