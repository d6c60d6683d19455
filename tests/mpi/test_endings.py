# SPDX-License-Identifier: MIT
"""Campaigns on several ranks that end before their time: how, and what they leave behind."""
import io
import json
import os
import pathlib
import signal
import time

import cbor2
import pytest

MIXED = pathlib.Path(__file__).resolve().parents[1] / "host" / "mixed.json"
ENDLESS = (MIXED, "--steps", 20, "--runs", 10**7)


def runs_kept(path):
    """Run numbers in a file of kept runs, whose last item may be cut."""
    stream, found = io.BytesIO(path.read_bytes()), []
    while True:
        try:
            item = cbor2.load(stream)
        except cbor2.CBORDecodeEOF:
            return found
        found += [item["run"]] if "run" in item else []


def wait_for(path, size):
    end = time.monotonic() + 30
    while not (path.exists() and path.stat().st_size > size):
        assert time.monotonic() < end, f"no {path} of {size} bytes"
        time.sleep(0.01)


def rank_process(job, rank):
    """Process of a rank among the children of mpirun."""
    for entry in pathlib.Path("/proc").iterdir():
        try:
            parent = int((entry / "stat").read_text().rpartition(")")[2].split()[1])
            if parent == job.pid and f"OMPI_COMM_WORLD_RANK={rank}".encode() in (entry / "environ").read_bytes().split(b"\0"):
                return int(entry.name)
        except (OSError, IndexError):
            continue
    raise AssertionError(f"no rank {rank}")


@pytest.fixture
def goes_on(alone, mpi, figures, tmp_path):
    """What was complete counts: with it, one process and several come to the figures of a campaign that nobody disturbed."""
    def call(kept):
        done = runs_kept(kept)
        assert done == list(range(len(done))) and done
        options = (MIXED, "--steps", 20, "--runs", len(done) + 8)
        alone(*options, "--json", tmp_path / "want")
        data = kept.read_bytes()
        alone(*options, "--json", tmp_path / "got", "--resume", kept)
        assert figures(tmp_path / "got") == figures(tmp_path / "want")
        kept.write_bytes(data)
        mpi(3, *options, "--json", tmp_path / "got", "--resume", kept)
        assert figures(tmp_path / "got") == figures(tmp_path / "want")
        assert json.loads((tmp_path / "got").read_text())["filters"][0]["runs_kept"] == len(done)
        assert runs_kept(kept) == list(range(len(done) + 8))
    return call


@pytest.mark.parametrize("split,rank", [("runs", 0), ("runs", 2), ("nodes", 1)])
def test_rank_killed(launch, wait, goes_on, tmp_path, split, rank):
    """All end, at once, and not as if nothing had happened."""
    kept, summary = tmp_path / "kept", tmp_path / "json"
    job = launch(3, "simulate", *ENDLESS, "--split", split, "--resume", kept, "--json", summary)
    wait_for(kept, 3000)
    os.kill(rank_process(job, rank), signal.SIGKILL)
    assert wait(job, 20).returncode not in (0, 2) and not summary.exists()
    goes_on(kept)


@pytest.mark.parametrize("split", ["runs", "nodes"])
@pytest.mark.parametrize("rank", [0, 1])
def test_one_rank_is_told_to_stop(launch, wait, goes_on, tmp_path, split, rank):
    """It tells the others. No run is counted after one that was not made."""
    kept, summary = tmp_path / "kept", tmp_path / "json"
    job = launch(2, "simulate", *ENDLESS, "--split", split, "--resume", kept, "--json", summary)
    wait_for(kept, 3000)
    os.kill(rank_process(job, rank), signal.SIGTERM)
    assert wait(job, 20).returncode == 1 and job.said == []
    got = json.loads(summary.read_text())
    assert got["filters"][0]["interrupted"] and got["filters"][0]["runs_done"] == len(runs_kept(kept))
    goes_on(kept)


def is_interrupted(summary, alone, folder):
    """The figures are those of the runs that were complete, of which it returns the number."""
    cut = json.loads(summary.read_text())["filters"][0]
    alone(MIXED, "--steps", 20, "--runs", cut["runs_done"], "--json", folder / "want")
    want = json.loads((folder / "want").read_text())["filters"][0]
    assert cut["interrupted"]
    assert all(cut[key] == want[key] for key in ("runs_done", "msd", "msd_ci95", "node_msd", "state_rmse", "nis_ratio"))
    return cut["runs_done"]


@pytest.mark.parametrize("ranks,split", [(3, "runs"), (2, "nodes")])
def test_mpirun_passes_a_signal_on(launch, wait, alone, tmp_path, ranks, split):
    """SIGUSR1 to mpirun reaches all ranks, and nobody is killed: the log and the summary are those of an interrupted campaign."""
    out, summary = tmp_path / "log", tmp_path / "json"
    job = launch(ranks, "simulate", *ENDLESS, "--split", split, "--out", out, "--json", summary)
    wait_for(out, 100000)
    job.send_signal(signal.SIGUSR1)
    assert wait(job, 20).returncode == 1 and b"interrupted: the figures are of the runs that were complete" in job.out
    runs = is_interrupted(summary, alone, tmp_path)
    stream = io.BytesIO(out.read_bytes())
    cbor2.load(stream)
    begin = stream.tell()
    alone(MIXED, "--steps", 20, "--runs", runs + 1, "--out", tmp_path / "whole")
    whole = io.BytesIO((tmp_path / "whole").read_bytes())
    cbor2.load(whole)
    end = out.read_bytes().rindex(b"\xa2\x63end")
    assert whole.read(end - begin) == out.read_bytes()[begin:end], "not a beginning of the whole log"
    last = cbor2.loads(out.read_bytes()[end:])
    assert last["end"] == "interrupted" and 0 <= last["items"] - 20 * runs <= 20


@pytest.mark.parametrize("number,ranks,split", [(signal.SIGINT, 2, "nodes"), (signal.SIGTERM, 3, "runs")])
def test_mpirun_is_told_to_stop(launch, wait, alone, tmp_path, number, ranks, split):
    """It wakes all ranks, after a while tells them to end, and after another while kills them. The second is enough for a summary."""
    summary = tmp_path / "json"
    job = launch(ranks, "simulate", *ENDLESS, "--split", split, "--resume", tmp_path / "kept", "--json", summary,
                 OMPI_MCA_odls_base_sigkill_timeout="2")
    wait_for(tmp_path / "kept", 3000)
    job.send_signal(number)
    assert wait(job, 20).returncode != 0
    assert is_interrupted(summary, alone, tmp_path) == len(runs_kept(tmp_path / "kept"))


def test_mpirun_kills(launch, wait, goes_on, tmp_path):
    """Killed at once, the ranks write no summary: the runs that were kept are there all the same."""
    kept = tmp_path / "kept"
    job = launch(4, "simulate", *ENDLESS, "--split", "runs", "--resume", kept)
    wait_for(kept, 3000)
    job.send_signal(signal.SIGTERM)
    assert wait(job, 20).returncode != 0
    goes_on(kept)
