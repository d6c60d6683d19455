# SPDX-License-Identifier: MIT
"""Logs of the simulator itself, where it has been built."""

import os
import subprocess
import sys
from pathlib import Path

import cbor2
import numpy as np
import pytest
from readback import PACKAGE, Recording

from meshkal_log.reader import LogReader

SIMULATOR = Path(os.environ.get("MESHKAL", Path(__file__).resolve().parents[2] / "build" / "meshkal"))

pytestmark = pytest.mark.skipif(not SIMULATOR.exists(), reason=f"{SIMULATOR} is not built")


@pytest.fixture(scope="module")
def scenario(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("scenario") / "projectile.json"
    path.write_bytes(subprocess.run([SIMULATOR, "scenario", "projectile", "--nodes", "6"], capture_output=True, check=True).stdout)
    return path


@pytest.mark.parametrize("filter_name", ["kfc", "rkfc", "kfd", "rkfdu", "rkfdnu", "rkfdnu2"])
@pytest.mark.parametrize("real", ["float64", "float32"])
def test_pipe_from_the_simulator(tmp_path, scenario, filter_name, real):
    log, output = tmp_path / "run.cbor", tmp_path / "run.rrd"
    simulate = f"{SIMULATOR} simulate {scenario} --filter {filter_name} --real {real} --steps 30 --runs 2 --loss 0.2 --out -"
    script = f"set -o pipefail; {simulate} | tee {log} | {sys.executable} -m meshkal_rerun - -o {output} --run 1"
    environment = {**os.environ, "PYTHONPATH": str(PACKAGE)}
    done = subprocess.run(["bash", "-c", script], capture_output=True, env=environment, timeout=120, check=False)
    assert done.returncode == 0 and b"meshkal-rerun" not in done.stderr, done.stderr.decode()

    with log.open("rb") as stream:
        decoder = cbor2.CBORDecoder(stream)
        header = decoder.decode()
        steps = [decoder.decode() for _ in range(60)]
    numbers = np.array([np.frombuffer(s["error"].value, "<f8") for s in steps if s["run"] == 1])
    thetas = np.array([np.frombuffer(s["theta"].value, "<f8" if real == "float64" else "<f4") for s in steps if s["run"] == 1])
    with log.open("rb") as stream:
        [batch] = LogReader(stream).batches(1)
    np.testing.assert_allclose(batch.variance.sum(axis=2), batch.trace_covariance, rtol=1e-5)
    assert (np.isfinite(batch.innovation).mean() < 1) == (filter_name in ("kfc", "rkfc"))
    assert (batch.innovation_variance[np.isfinite(batch.innovation)] > 0).all()
    recording = Recording(output)
    for k in range(header["estimators"]):
        name = "centre" if filter_name in ("kfc", "rkfc") else f"node/{k}"
        np.testing.assert_allclose(recording.series(f"error_db/{name}"), 20 * np.log10(numbers[:, k]), rtol=1e-9)
        np.testing.assert_array_equal(recording.series(f"theta/{name}"), thetas[:, k])
    assert {"scene/truth", "scene/sensors", "network/nodes", "summary"} <= recording.entities()
