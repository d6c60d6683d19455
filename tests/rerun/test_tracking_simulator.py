# SPDX-License-Identifier: MIT
"""Tracking logs of the simulator itself, where it has been built."""

import json
import os
import subprocess
from pathlib import Path

import cbor2
import numpy as np
import pytest
from readback import Recording

SIMULATOR = Path(os.environ.get("MESHKAL", Path(__file__).resolve().parents[2] / "build" / "meshkal"))
SCENARIO = Path(__file__).resolve().parents[2] / "tools" / "rerun" / "tracking.json"
DTYPES = {64: "u1", 70: "<u4", 85: "<f4", 86: "<f8"}

pytestmark = pytest.mark.skipif(not SIMULATOR.exists(), reason=f"{SIMULATOR} is not built")


def array(*arguments: object) -> np.ndarray:
    tag = next(argument for argument in arguments if isinstance(argument, cbor2.CBORTag))
    return np.frombuffer(tag.value, DTYPES[tag.tag])


def simulate(scenario: Path, log: Path, *options) -> tuple[dict, list[dict]]:
    done = subprocess.run([SIMULATOR, "simulate", scenario, *options, "--out", log], capture_output=True, check=False)
    assert done.returncode == 0, done.stderr.decode()
    items = []
    with log.open("rb") as stream:
        decoder = cbor2.CBORDecoder(stream, tag_hook=array)
        while stream.peek(1):
            items.append(decoder.decode())
    assert items[-1]["end"] == "complete"
    return items[0], items[1:-1]


def show(*logs: Path) -> Recording:
    from meshkal_rerun import cli

    output = logs[0].with_suffix(".rrd")
    assert cli.main([*map(str, logs), "-o", str(output)]) == 0
    return Recording(output)


@pytest.mark.parametrize("filter_name", ["ekf", "ukf", "iukf", "iukf-literal", "pukf", "mpukf", "duif", "kcf", "rekfd"])
@pytest.mark.parametrize("real", ["float64", "float32"])
def test_every_filter(tmp_path, filter_name, real, capsys):
    header, steps = simulate(SCENARIO, tmp_path / "run.cbor", "--filter", filter_name, "--real", real, "--steps", "25", "--loss", "0.2")
    recording = show(tmp_path / "run.cbor")
    assert capsys.readouterr().err == ""
    e, n = header["estimators"], header["states"]
    names = json.loads(header["scenario"])["model"]["states"]
    where = [names.index("px"), names.index("py")]
    estimate = np.array([step["estimate"] for step in steps], dtype=np.float64).reshape(25, e, n)
    truth = np.array([step["truth"] for step in steps])
    error = np.linalg.norm((truth[:, None] - estimate)[:, :, where], axis=2)
    for k in range(e):
        path = "centre" if e == 1 else f"node/{k}"
        np.testing.assert_allclose(recording.series(f"position_error/{path}"), error[:, k], rtol=1e-9)
        np.testing.assert_array_equal(recording.series(f"nees/{path}"), [step["nees"][k] for step in steps])
    lengths = [len(row) for row in recording.rows("scene/readings", "LineStrips3D:strips")[2]]
    assert lengths == [int(step["measuring"].sum()) for step in steps] and sum(lengths) > 25
    judged = [name for name in recording.entities() if name.startswith("gate_ratio/") and "/sensor/" in name]
    drawn = sum(len(recording.rows(name, "Scalars:scalars")[0]) for name in judged if not name.endswith(("rejected", "inflated")))
    assert drawn == sum(int((step["gate_ratio"] > 0).sum()) for step in steps) > 25
    if e > 1:
        np.testing.assert_array_equal(recording.series("disagreement/positions"), [step["disagreement"][0] for step in steps])
    if filter_name == "duif":
        np.testing.assert_array_less(recording.series("consensus/after/10"), recording.series("consensus/after/0"))


def test_no_iterations_wait_for_no_messages(tmp_path):
    _, steps = simulate(SCENARIO, tmp_path / "run.cbor", "--filter", "duif", "--iterations", "0", "--steps", "10")
    recording = show(tmp_path / "run.cbor")
    assert not any(recording.series("missing_messages/network/total"))
    assert not any((step["faults"] & 2).any() for step in steps)
    assert all(len(row) == 0 for row in recording.rows("scene/messages", "LineStrips3D:strips")[2])


def test_recorded_readings_at_irregular_times(tmp_path):
    """Ranges of three anchors to a tag, one at a time, without truth."""
    rng = np.random.default_rng(1)
    anchors = np.array([[0.0, 0.0], [10.0, 0.0], [5.0, 9.0]])
    scenario = {
        "name": "tag", "model": {"motion": "constant-velocity", "states": ["px", "vx", "py", "vy"], "acceleration_psd": 0.2, "dt_s": 0.1,
                                 "x0": [4, 0, 3, 0], "P0": np.diag([1.0, 1, 1, 1]).tolist()},
        "nodes": [{"sensor": "range", "position_m": p.tolist(), "R": [[0.01]]} for p in anchors], "edges": [[0, 1], [1, 2]], "steps": 10,
        "tracking": {"gate": {"significance": 0.001, "stacked": False}},
    }
    (tmp_path / "tag.json").write_text(json.dumps(scenario))
    t = 1000.0 + np.cumsum(rng.exponential(0.05, 60))
    rows = ["t,node,row,value"]
    for i, at in enumerate(t):
        k = int(rng.integers(3))
        distance = np.linalg.norm([4 + 0.1 * (at - 1000), 3] - anchors[k]) + rng.normal(0, 0.1) + (5.0 if i == 40 else 0.0)
        rows.append(f"{float(at)!r},{k},0,{float(distance)!r}")
    (tmp_path / "ranges.csv").write_text("\n".join(rows) + "\n")
    for name in ("mpukf", "duif"):
        _, steps = simulate(tmp_path / "tag.json", tmp_path / f"{name}.cbor", "--filter", name, "--measurements", tmp_path / "ranges.csv")
    recording = show(tmp_path / "mpukf.cbor", tmp_path / "duif.cbor")
    instants, times, _ = recording.rows("scene/estimates", "Points3D:positions")
    assert instants.tolist() == list(range(1, 61))
    np.testing.assert_allclose(times / 1e9, t, atol=1e-6)
    assert [row[0] for row in recording.rows("rejections", "TextLog:text")[2]] and 41 in recording.rows("rejections", "TextLog:text")[0]
    assert "no truth in the log" in recording.summary() and "recorded" in recording.summary()
    assert len(recording.series("disagreement/compared/duif")) == len(steps) == 60


def test_settings_as_used_and_not_as_in_the_scenario(tmp_path):
    ids = set()
    for i, options in enumerate(([], ["--gate", "none"], ["--gate", "0.01"], ["--iterations", "3"], ["--protocol", "ratio"])):
        header, _ = simulate(SCENARIO, tmp_path / f"{i}.cbor", "--filter", "duif", "--steps", "5", *options)
        recording = show(tmp_path / f"{i}.cbor")
        gate = f"significance {header['gate']:g}, skip" if header["gate"] else "none"
        assert f"| gate | {gate} |" in recording.summary()
        assert f"| consensus | {header['protocol']}, {header['iterations']} iterations |" in recording.summary()
        ids.add(recording.reader.recordings()[0].recording_id)
        wanted = dict(zip(options[::2], options[1::2]))
        assert header["gate"] == float(wanted.get("--gate", "0.001").replace("none", "0"))
        assert header["protocol"] == wanted.get("--protocol", "metropolis") and header["iterations"] == int(wanted.get("--iterations", 10))
    assert len(ids) == 5
