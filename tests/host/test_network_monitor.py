# SPDX-License-Identifier: MIT
"""The study of monitors on the projectile network, tools/network-monitor: small, from end to end."""
import json
import subprocess
import sys
from pathlib import Path

STUDY = Path(__file__).resolve().parents[2] / "tools" / "network-monitor" / "study.py"


def study(*arguments):
    return subprocess.run([sys.executable, STUDY, *map(str, arguments)], capture_output=True, text=True, timeout=300)


def test_study(program, tmp_path):
    done = study("--meshkal", program, "--out", tmp_path, "--law-steps", 400, "--node-steps", 2500, "--runs", 2, "--rates", 1)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "tables.md").read_text() + "\n" == done.stdout
    results = json.loads((tmp_path / "results.json").read_text())
    assert [len(results[key]) for key in ("law", "false_alarms", "ramps")] == [6, 15, 3]
    for row in results["false_alarms"]:
        assert row["clean_node_steps"] >= 2500
    for row in results["ramps"]:
        exclude, faulty = row["schemes"]["exclude"], row["faulty"]
        assert exclude["isolated"]["estimators"] == exclude["isolated"]["of"] and exclude["wrong"] == 0
        assert faulty["during"][0] > 2 * exclude["phase_msd"]["during"][0]


def test_no_program(tmp_path):
    done = study("--meshkal", tmp_path / "none", "--out", tmp_path / "out")
    assert done.returncode == 1 and done.stderr.startswith("study: no program at ") and done.stderr.count("\n") == 1
    assert not (tmp_path / "out").exists()
