# SPDX-License-Identifier: MIT
"""Logs of the simulator itself, where it has been built: there is no array that readers and tables do not know, and none of its numbers is lost."""

import numpy as np
import pytest
from converted import read_parquet
from test_integrity_simulator import scenario
from test_tracking_simulator import SCENARIO, SIMULATOR, simulate

import meshkal_log

pytestmark = pytest.mark.skipif(not SIMULATOR.exists(), reason=f"{SIMULATOR} is not built")

FAULT = {"node": 2, "from_s": 2, "to_s": 6, "rate": 1.0}
CASES = {
    "frozen": ("projectile --nodes 8", {}, ("--frozen", "0.1", "--filter", "rkfdnu2", "--steps", "200")),
    "centre, float32": ("projectile --nodes 8", {}, ("--filter", "rkfc", "--real", "float32", "--loss", "0.2", "--steps", "30")),
    "monitor": ("projectile --nodes 8", {"faults": [FAULT], "monitor": {"false_alarm": 1e-6}},
                ("--filter", "rkfdu", "--monitor", "aime-improved", "--steps", "60")),
    "duif": (None, {}, ("--filter", "duif", "--loss", "0.1", "--steps", "20")),
    "ukf": (None, {}, ("--filter", "ukf", "--steps", "20")),
    "navigation": ("gnss-ins", {"faults": [FAULT | {"from_s": 10, "to_s": 20}], "monitor": {"false_alarm": 1e-6}},
                   ("--filter", "rekf-t", "--monitor", "exclude", "--steps", "30")),
}


@pytest.mark.parametrize("case", CASES)
def test_no_number_is_lost(tmp_path, case):
    name, changes, options = CASES[case]
    path = scenario(tmp_path / "net.json", name, **changes) if name else SCENARIO
    _, items = simulate(path, tmp_path / "run.cbor", *options)
    for form in ("parquet", "csv", "mcap"):
        assert meshkal_log.convert(tmp_path / "run.cbor", tmp_path / f"run.{form}") == []
    found = read_parquet(tmp_path / "run.parquet")
    numbers = sum(len(value) for item in items for key, value in item.items() if isinstance(value, np.ndarray) and key != "time_s")
    tell_apart = {"run", "step", "time_s", "node", "satellite", "sender", "row", "other", "other_satellite"}
    # Each number of the log is one value of a table; innovations may be fewer than readings only if some nodes have no estimator.
    assert sum(len(values) for columns in found.values() for column, values in columns.items() if column not in tell_apart) == numbers
    run = meshkal_log.read(tmp_path / "run.cbor")
    assert run.warnings == [] and set(run) == {key for key, value in items[0].items() if isinstance(value, np.ndarray)} - {"time_s"}
    for i, item in enumerate(items):
        np.testing.assert_array_equal(run.estimate[i].reshape(-1), item["estimate"])
        np.testing.assert_array_equal(run.measurements_arrived[i], item["measurements_arrived"])
        np.testing.assert_array_equal(run.readings(1)[i], item["measurements"][run.row_node == 1])
    if case == "frozen":
        assert run.frozen.any()
