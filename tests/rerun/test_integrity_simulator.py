# SPDX-License-Identifier: MIT
"""Logs with monitors of the simulator itself, where it has been built."""

import json
import subprocess
from pathlib import Path

import numpy as np
import pytest
from test_tracking_simulator import SIMULATOR, show, simulate

pytestmark = pytest.mark.skipif(not SIMULATOR.exists(), reason=f"{SIMULATOR} is not built")


def scenario(path: Path, name: str, **changes: object) -> Path:
    text = subprocess.run([SIMULATOR, "scenario", *name.split()], capture_output=True, check=True).stdout
    path.write_text(json.dumps(json.loads(text) | changes))
    return path


def check(header: dict, steps: list[dict], recording) -> int:
    """Monitors' numbers and marks against the log; how many epochs were in alarm."""
    paths = ["centre"] if header["estimators"] == 1 else [f"node/{k}" for k in range(header["estimators"])]
    alarms = 0
    for e, path in enumerate(paths):
        for key in ("rctm", "aime"):
            np.testing.assert_array_equal(recording.series(f"monitor_statistic/{key}/{path}"), [step[f"monitor_{key}"][e] for step in steps])
        at = [step["step"] for step in steps if step["monitor_alarm"][e]]
        assert recording.rows(f"monitor_ratio/alarm/{path}", "Scalars:scalars")[0].tolist() == at
        # The ratio and the alarm are two ways to one answer.
        if at:
            assert (recording.series(f"monitor_ratio/alarm/{path}") >= 1.0 - 1e-6).all()
        alarms += len(at)
    return alarms


@pytest.mark.parametrize(("filter_name", "scheme", "real"), [
    ("ekf", "aime", "float64"), ("rekf-n", "rctm", "float32"), ("rekf-t", "aime-improved", "float64"), ("rekf-t", "exclude", "float32"),
])
def test_navigation(tmp_path, filter_name, scheme, real, capsys):
    path = scenario(tmp_path / "flight.json", "gnss-ins", faults=[{"node": 0, "from_s": 20, "to_s": 60, "rate": 1.0}])
    options = ("--filter", filter_name, "--monitor", scheme, "--real", real, "--steps", "90")
    header, steps = simulate(path, tmp_path / "run.cbor", *options)
    recording = show(tmp_path / "run.cbor")
    assert capsys.readouterr().err == ""
    assert check(header, steps, recording) > 0
    number = header["satellites"][0]
    np.testing.assert_array_equal(recording.series(f"fault/satellite/{number}"), [step["fault"][0] for step in steps])
    np.testing.assert_array_equal(recording.series(f"innovation/satellite/{number}"), [step["innovation"][0] for step in steps])
    if filter_name != "ekf":
        np.testing.assert_array_equal(recording.series(f"weight/satellite/{number}"), [step["weight"][0] for step in steps])
    crosses = [len(row) for row in recording.rows("sky/held_faulty", "LineStrips2D:strips")[2]]
    assert crosses == [2 * int(step["excluded"].sum()) for step in steps] and (max(crosses) > 0) == (scheme == "exclude")
    said = recording.summary()
    assert f"| injected fault | satellite {number}: 21 s to 60 s |" in said and "| alarms | none |" not in said
    assert (f"| held faulty | satellite {number}: " in said) == (scheme == "exclude")


def test_network(tmp_path):
    fault = {"node": 2, "from_s": 3.0, "to_s": 7.0, "rate": 40.0}
    path = scenario(tmp_path / "net.json", "projectile --nodes 8", faults=[fault], monitor={"false_alarm": 1e-6})
    header, steps = simulate(path, tmp_path / "run.cbor", "--filter", "rkfdu", "--monitor", "exclude", "--steps", "100")
    recording = show(tmp_path / "run.cbor")
    assert check(header, steps, recording) > 0
    held = np.array([sum(step["excluded"][i] for i, k in enumerate(sum(header["slots"], [])) if k == 2) for step in steps])
    assert held.max() > 0 and "| held faulty | node 2: " in recording.summary()
    steps_marked, _, marked = recording.rows("network/held_faulty", "Points2D:positions")
    (places,) = recording.rows("network/nodes", "Points2D:positions", static=True)[2]
    assert [places[2] in row for row in marked] == [bool(held[t]) for t in steps_marked]


def test_no_monitor_no_marks(tmp_path):
    simulate(scenario(tmp_path / "flight.json", "gnss-ins"), tmp_path / "run.cbor", "--filter", "ekf", "--steps", "20")
    entities = show(tmp_path / "run.cbor").entities()
    assert "sky/satellites" in entities and not [name for name in entities if name.startswith(("monitor", "sky/held"))]
