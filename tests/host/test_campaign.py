# SPDX-License-Identifier: MIT
"""Monte Carlo campaigns on threads: the same bytes for any number of them, whatever interrupts them, and campaigns that go on from a
file of kept runs. Processes are tested in tests/mpi."""
import json
import os
import random
import resource
import signal
import stat
import subprocess
import time

import numpy as np
import pytest
from scipy import stats

from test_runs import ONE, items, log, steps_of

FILTERS = ("kfc", "rkfc", "kfd", "rkfdu", "rkfdnu", "rkfdnu2")
# What of a summary may differ when the same campaign is run in another way.
HOW = {"threads", "peak_memory_bytes", "seconds", "node_steps_per_second", "runs_kept"}
FOREVER = 10**7


def strip(value):
    if isinstance(value, dict):
        return {k: strip(v) for k, v in value.items() if k not in HOW}
    return [strip(v) for v in value] if isinstance(value, list) else value


def star(leaves):
    """Only the centre measures; a leaf that does not hear it for long fails."""
    nodes = [{"C": [[float(k == 0)]], "R": [[0.5]]} for k in range(leaves + 1)]
    return {"model": {"A": [[2.0]], "Q": [[0.2]]}, "nodes": nodes, "edges": [[0, k] for k in range(1, leaves + 1)], "tolerance": 0.0}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("campaign")


@pytest.fixture(scope="module")
def scenario(run, folder):
    path = folder / "projectile.json"
    path.write_bytes(run("scenario", "projectile", "--nodes", 8, "--seed", 2).stdout)
    return path


@pytest.fixture(scope="module")
def one(folder):
    path = folder / "one.json"
    path.write_text(json.dumps(ONE))
    return path


@pytest.fixture
def figures(run, scenario, tmp_path):
    """The summary's figures of a campaign, as text, so that equal means equal in every digit."""
    def call(*options, path=scenario, **more):
        out = tmp_path / "figures.json"
        run("simulate", path, *options, "--json", out, **more)
        return json.dumps(strip(json.loads(out.read_text())))
    return call


@pytest.fixture
def start(program, scenario, tmp_path):
    """A campaign under way, and a function that waits until it has done some work."""
    def call(*options, path=scenario, **more):
        out = tmp_path / f"summary{time.monotonic_ns()}"
        job = subprocess.Popen([program, "simulate", path, *map(str, options), "--json", out],
                               **{"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE} | more)
        end = time.monotonic() + 20
        # Its place for the summary is opened when the work begins.
        while not out.with_suffix(".partial").exists() and job.poll() is None and time.monotonic() < end:
            time.sleep(0.002)
        return job, out
    return call


# --- threads -------------------------------------------------------------------------------------------------------

@pytest.mark.parametrize("options", [
    ("--filter", "kfc", "--real", "float32"), ("--filter", "rkfc", "--loss", 0.3), ("--filter", "kfd", "--truth", "least-favourable"),
    ("--filter", "rkfdu", "--real", "float32", "--loss", 0.3), ("--filter", "rkfdnu", "--truth", "least-favourable", "--loss", 0.1),
    ("--filter", "rkfdnu2", "--truth", "least-favourable", "--real", "float32"), ("--runs", 1), ("--runs", 2)])
def test_threads_give_the_same_bytes(run, figures, tmp_path, options):
    want = None
    for threads in (1, 2, 3, 7):
        out = tmp_path / str(threads)
        done = out, figures("--runs", 10, "--steps", 30, "--out", out, *options, "--threads", threads)
        want = want or done
        assert out.read_bytes() == want[0].read_bytes() and done[1] == want[1], threads
    assert len(log(want[0].read_bytes())[1]) == 30 * (options[1] if options[0] == "--runs" else 10)


@pytest.mark.parametrize("real", ["float32", "float64"])
@pytest.mark.parametrize("truth", ["nominal", "least-favourable"])
@pytest.mark.parametrize("loss", [0, 0.3])
def test_threads_give_the_same_figures(figures, real, truth, loss):
    options = ("--filter", "all", "--runs", 60, "--steps", 25, "--real", real, "--truth", truth, "--loss", loss, "--threads")
    want = figures(*options, 1)
    assert [f["filter"] for f in json.loads(want)["filters"]] == list(FILTERS)
    assert all(f["runs_done"] == 60 for f in json.loads(want)["filters"])
    assert figures(*options, 2) == figures(*options, 7) == want


@pytest.mark.parametrize("options", [(), ("--loss", 0.2, "--real", "float32"), ("--truth", "least-favourable", "--filter", "rkfdnu")])
def test_threads_share_the_nodes_of_one_run(run, figures, folder, tmp_path, options):
    """All of a step on several threads: that is worth while for thousands of nodes only."""
    path = folder / "large.json"
    if not path.exists():
        path.write_bytes(run("scenario", "projectile", "--nodes", 6000).stdout)
    made = [(figures("--steps", 3, *options, "--threads", n, "--out", tmp_path / str(n), path=path), (tmp_path / str(n)).read_bytes())
            for n in (1, 2, 3, 40)]
    assert made[0] == made[1] == made[2] == made[3]
    header, steps, _ = log(made[0][1])
    assert header["estimators"] == 6000 and all(
        (a["estimate"] != b["estimate"]).reshape(6000, 6).any(axis=1).all() for a, b in zip(steps, steps[1:]))


@pytest.mark.parametrize("options", [("--real", "float32", "--loss", 0), ("--real", "float32", "--loss", 0.9), ("--filter", "kfc", "--seed", 4, "--loss", 0.99)])
def test_a_node_that_fails(run, tmp_path, options):
    """All threads name the failure that one thread meets, and leave its log; no summary."""
    path, said, T = tmp_path / "star.json", set(), 1000 if "kfc" in options else 120
    s = star(40)
    if options[-1] == 0:
        # Two parts, one of which measures nothing: its nodes fail all at once.
        s["edges"] = [[0, k] for k in range(1, 20)] + [[k, k + 1] for k in range(20, 40)]
    path.write_text(json.dumps(s))
    for threads in (1, 2, 3, 7):
        for out in ((), ("--out", tmp_path / "log")):
            said.add(run("simulate", path, "--runs", 40, "--steps", T, "--filter", "kfd", *options, "--threads", threads, "--json", tmp_path / "json", *out,
                         status=1).stderr)
        said.add((tmp_path / "log").read_bytes())
    assert len(said) == 2 and sorted(p.name for p in tmp_path.iterdir()) == ["log", "star.json"]
    text, data = sorted(said, key=len)
    assert text.startswith(b"meshkal: run ") and b"MK_ERROR_NOT_POSITIVE_DEFINITE" in text and text.count(b"\n") == 1
    header, steps, end = log(data)
    words = text.decode().replace(",", "").replace(":", "").split()
    where = int(words[2]), int(words[4]), int(words[7 if "kfc" in options else 6])
    assert end == {"end": "failed", "items": len(steps)} and len(steps) == T * where[0] + where[1]
    assert where == (0, 63, 20) if options[-1] == 0 else where[0] > 0, where


def test_a_later_filter_fails(run, tmp_path):
    """Something was done and shown: that is no wrong input."""
    blind = star(3) | {"tolerance": 0.02}
    blind["nodes"][0]["C"] = [[0.0]]
    (tmp_path / "s.json").write_text(json.dumps(blind))
    done = run("simulate", tmp_path / "s.json", "--filter", "all", "--steps", 5, "--json", tmp_path / "j", status=1)
    assert done.stderr == b"meshkal: tolerance 0.02: the centralised filter does not converge\n"
    assert b"\nkfc " in done.stdout and not (tmp_path / "j").exists()


# --- figures -------------------------------------------------------------------------------------------------------

@pytest.mark.parametrize("runs", [2, 12])
@pytest.mark.parametrize("options", [("--filter", "rkfdnu2", "--loss", 0.3), ("--filter", "rkfc", "--loss", 0.5, "--real", "float32"),
                                     ("--filter", "rkfdnu", "--truth", "least-favourable"), ("--filter", "kfd", "--steps", 21)])
def test_intervals_are_those_of_the_runs(run, scenario, tmp_path, runs, options):
    """Figures out of the log, run by run, and SciPy's intervals of their means."""
    options = ("--steps", 30, *options)
    T = options[-1] if options[-2] == "--steps" else 30
    run("simulate", scenario, "--runs", runs, *options, "--threads", 3, "--out", tmp_path / "log", "--json", tmp_path / "json")
    got = json.loads((tmp_path / "json").read_text())["filters"][0]
    header, steps, _ = log((tmp_path / "log").read_bytes())
    E, n, from_ = header["estimators"], header["states"], T // 2
    position = json.loads(header["scenario"])["model"]["position_states"]
    gap = np.array([i["truth"] - i["estimate"].reshape(E, n).astype(float) for i in steps]).reshape(runs, T, E, n)
    of = {key: np.array([i[key].astype(float) for i in steps]).reshape(runs, T, E) for key in ("theta", "tolerance", "nis", "nis_rows")}
    msd, rows = (gap**2).sum(axis=3), of["nis_rows"].sum(axis=2)
    per_run = {
        "msd": msd[:, from_:].mean(axis=(1, 2)), "position_msd": (gap[..., position]**2).sum(axis=3)[:, from_:].mean(axis=(1, 2)),
        "mean_theta": of["theta"][:, from_:].mean(axis=(1, 2)), "mean_tolerance": of["tolerance"][:, from_:].mean(axis=(1, 2)),
        "nis_ratio": (of["nis"].sum(axis=2) / np.where(rows, rows, 1))[:, from_:].mean(axis=1),
        "node_msd": msd[:, from_:].mean(axis=1), "msd_over_time": msd.mean(axis=2), "state_rmse": (gap**2).mean(axis=(1, 2))}
    for key, values in per_run.items():
        mean, half = values.mean(axis=0), stats.t.ppf(0.975, runs - 1) * stats.sem(values, axis=0)
        if key == "state_rmse":
            mean, half = np.sqrt(mean), half / (2 * np.sqrt(mean))
        assert got[key] == pytest.approx(mean, rel=1e-11, abs=1e-300), key
        assert got[key + "_ci95"] == pytest.approx(half, rel=1e-8, abs=1e-13 * np.abs(mean).max()), key
    assert got["msd_db"] == pytest.approx(10 * np.log10(got["msd"]), rel=1e-12)
    assert got["msd_ci95"] > 1e-3 * got["msd"]


def test_one_run_has_no_interval(figures):
    got = json.loads(figures("--steps", 20))["filters"][0]
    assert got["msd"] > 0 and got["msd_ci95"] is None and set(got["node_msd_ci95"]) == {None}


# --- interrupted ---------------------------------------------------------------------------------------------------

@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("threads", [2, 7])
@pytest.mark.parametrize("logs", [False, True])
def test_interrupted(start, figures, tmp_path, number, threads, logs):
    out = ("--out", tmp_path / "cut") if logs else ()
    job, summary = start("--runs", FOREVER, "--steps", 40, "--threads", threads, *out, stdout=subprocess.PIPE)
    while logs and not ((tmp_path / "cut").exists() and (tmp_path / "cut").stat().st_size > 200000):
        time.sleep(0.002)
    time.sleep(0 if logs else 0.2)
    job.send_signal(number)
    said = job.communicate(timeout=30)
    assert job.returncode == 1 and said[1] == b""
    assert b"interrupted: the figures are of the runs that were complete" in said[0]
    cut = strip(json.loads(summary.read_text()))
    runs = cut["filters"][0]["runs_done"]
    assert cut["filters"][0].pop("interrupted") is True and runs > 1 and cut.pop("runs") == FOREVER
    whole = json.loads(figures("--runs", runs + 1 if logs else runs, "--steps", 40, "--threads", 1, *(("--out", tmp_path / "whole") if logs else ())))
    if logs:
        data, want = ((tmp_path / name).read_bytes() for name in ("cut", "whole"))
        assert steps_of(want).startswith(steps_of(data))
        _, steps, end = log(data)
        assert end == {"end": "interrupted", "items": len(steps)} and 0 <= len(steps) - 40 * runs <= 40
        whole = json.loads(figures("--runs", runs, "--steps", 40))
    del whole["runs"], whole["filters"][0]["interrupted"]
    assert cut == whole


@pytest.mark.parametrize("threads", [1, 3])
def test_log_that_cannot_be_written(program, run, scenario, threads):
    options = ("--runs", FOREVER, "--steps", 40, "--threads", threads)
    assert run("simulate", scenario, *options, "--out", "/dev/full", status=1).stderr == b"meshkal: writing the log: No space left on device\n"
    job = subprocess.Popen([program, "simulate", scenario, *map(str, options), "--out", "-"], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert len(job.stdout.read(100000)) == 100000
    job.stdout.close()
    assert job.stderr.read() == b"meshkal: writing the log: Broken pipe\n" and job.wait(30) == 1


def test_the_next_run_is_shown_as_it_goes(program, scenario):
    """A reader of a pipe need not wait for a run's end, however many threads run others meanwhile."""
    job = subprocess.Popen([program, "simulate", scenario, "--runs", "3", "--steps", "60000", "--threads", "2", "--out", "-"],
                           stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
    data = job.stdout.read(50000)
    job.send_signal(signal.SIGINT)
    _, steps, end = log(data + job.stdout.read())
    assert job.wait(30) == 1 and end == {"end": "interrupted", "items": len(steps)} and steps[-1]["run"] == 0


# --- kept runs -----------------------------------------------------------------------------------------------------

def kept(path, name="rkfdnu2"):
    return [i["run"] for i, _ in items(path.read_bytes())[0] if i.get("filter") == name]


def test_kept_runs_give_the_same_figures(figures, tmp_path):
    """One after another, in two goes, in one go, with other threads, from a longer file: always the same."""
    file = tmp_path / "kept"
    options, whole = ("--steps", 20, "--loss", 0.2), {}
    for runs in (1, 2, 7, 30):
        whole[runs] = figures(*options, "--runs", runs)
        assert figures(*options, "--runs", runs, "--resume", file, "--threads", 1 + runs % 3) == whole[runs]
        assert kept(file) == list(range(runs))
    data = file.read_bytes()
    for runs in (7, 1, 30, 2):
        assert figures(*options, "--runs", runs, "--resume", file) == whole[runs]
    assert file.read_bytes() == data, "nothing was run, yet the file changed"
    file.unlink()
    assert figures(*options, "--runs", 30, "--resume", file) == whole[30] and file.read_bytes() == data


def test_kept_runs_of_all_filters(figures, tmp_path):
    file, options = tmp_path / "kept", ("--steps", 20, "--runs")
    assert figures(*options, 4, "--filter", "rkfc", "--resume", file) == figures(*options, 4, "--filter", "rkfc")
    assert figures(*options, 6, "--filter", "all", "--resume", file) == figures(*options, 6, "--filter", "all")
    assert figures(*options, 9, "--filter", "kfd", "--resume", file) == figures(*options, 9, "--filter", "kfd")
    assert {name: len(kept(file, name)) for name in FILTERS} == dict.fromkeys(FILTERS, 6) | {"kfd": 9}
    data = file.read_bytes()
    assert figures(*options, 6, "--filter", "all", "--resume", file) == figures(*options, 6, "--filter", "all")
    assert file.read_bytes() == data


def test_kept_runs_are_said(run, scenario, tmp_path):
    run("simulate", scenario, "--runs", 3, "--steps", 5, "--resume", tmp_path / "kept")
    done = run("simulate", scenario, "--runs", 5, "--steps", 5, "--resume", tmp_path / "kept", "--json", tmp_path / "json")
    assert b"3 runs were there from an earlier call" in done.stdout
    got = json.loads((tmp_path / "json").read_text())["filters"][0]
    assert (got["runs_kept"], got["runs_done"]) == (3, 5)


@pytest.mark.parametrize("numbers", [(signal.SIGKILL,), (signal.SIGKILL, signal.SIGINT, signal.SIGTERM)])
def test_killed_and_resumed(start, figures, tmp_path, numbers):
    """Killed over and over at any moment: what was complete counts, nothing twice, nothing left out."""
    file, rng, cuts, before = tmp_path / "kept", random.Random(len(numbers)), 0, 0
    # A slow machine needs more turns until enough of them have cut something.
    for turn in range(100):
        if turn >= 12 and cuts > 5 and before > 50:
            break
        job, _ = start("--steps", 40, "--runs", FOREVER, "--threads", 1 + turn % 5, "--resume", file)
        time.sleep(rng.uniform(0.0, 0.08))
        job.send_signal(rng.choice(numbers))
        _, said = job.communicate(timeout=30)
        assert said == b"", said
        done = kept(file) if file.exists() else []
        assert done == list(range(len(done))) and len(done) >= before
        cuts += before < len(done)
        before = len(done)
    assert cuts > 5 and before > 50
    options = ("--steps", 40, "--runs", before + 10)
    assert figures(*options, "--resume", file) == figures(*options, "--threads", 1)


def test_cut_anywhere(run, figures, one, tmp_path):
    """Whatever is left of the file after a cut, the same file and the same figures come of it."""
    file, options = tmp_path / "kept", ("--steps", 3, "--runs", 3, "--threads", 1)
    want = figures(*options, "--resume", file, path=one)
    data = file.read_bytes()
    ends = [end for _, end in items(data)[0]]
    assert len(ends) == 4
    near = {e + d for e in ends for d in (-1, 0, 1)} | set(range(0, ends[0], 37)) | set(range(ends[-2] - 3, len(data)))
    for length in sorted(near & set(range(len(data)))):
        file.write_bytes(data[:length])
        assert figures(*options, "--resume", file, path=one) == want, length
        assert file.read_bytes() == data, length


@pytest.mark.parametrize("place", [0, 1, 2, -1])
def test_damaged(refused, one, run, tmp_path, place):
    file, options = tmp_path / "kept", ("simulate", one, "--steps", 3, "--runs", 3, "--resume")
    run(*options, file)
    data = file.read_bytes()
    begin = [0, *(end for _, end in items(data)[0])][place]
    for damage in (b"\xff\xff\xff", b"\x1c\x1c\x1c", b"\0\0\0", b"{}\n"):
        file.write_bytes(data[:begin] + damage + data[begin + 3:])
        said = refused(tmp_path, *options, file)
        assert said.startswith(f"{file}: ") and ("damaged" in said or place == 0 and "not a file of kept runs" in said), said
        assert file.read_bytes() == data[:begin] + damage + data[begin + 3:], "a damaged file was changed"
    # A record less than there were.
    ends = [end for _, end in items(data)[0]]
    file.write_bytes(data[:ends[0]] + data[ends[1]:])
    assert "the record of run 0 of rkfdnu2 is damaged" in refused(tmp_path, *options, file)


def test_file_of_another_campaign(refused, run, scenario, tmp_path):
    file, other = tmp_path / "kept", tmp_path / "other.json"
    run("simulate", scenario, "--steps", 20, "--resume", file)
    data = file.read_bytes()
    other.write_bytes(scenario.read_bytes().replace(b"{", b"{ ", 1))
    for path, options in ((other, ()), (scenario, ("--seed", 3)), (scenario, ("--steps", 21)), (scenario, ("--loss", 0.1)),
                          (scenario, ("--tolerance", 0.1)), (scenario, ("--real", "float32")), (scenario, ("--truth", "least-favourable"))):
        said = refused(tmp_path, "simulate", path, "--steps", 20, *options, "--resume", file)
        assert said.startswith(f"{file}: holds runs of another campaign"), said
    run("simulate", scenario, "--steps", 20, "--truth", "least-favourable", "--resume", tmp_path / "worst")
    said = refused(tmp_path, "simulate", scenario, "--steps", 20, "--truth", "least-favourable", "--horizon", 30, "--resume", tmp_path / "worst")
    assert "another campaign" in said and file.read_bytes() == data


def test_not_a_file_of_kept_runs(refused, run, scenario, tmp_path):
    options = ("simulate", scenario, "--steps", 5, "--resume")
    run("simulate", scenario, "--steps", 5, "--out", tmp_path / "log")
    for name, data in (("text", b"not at all\n"), ("json", b"{}"), ("zeros", bytes(1000)), ("byte", b"\xa3"), ("other", b"\xa1aa\x01"),
                       ("scenario", scenario.read_bytes()), ("log", (tmp_path / "log").read_bytes()), ("noise", random.Random(1).randbytes(500)[::-1])):
        (tmp_path / name).write_bytes(data)
        if name != "byte":  # the first byte of a file of kept runs: cut
            assert refused(tmp_path, *options, tmp_path / name) == f"{tmp_path / name}: not a file of kept runs"
            assert (tmp_path / name).read_bytes() == data
    os.mkfifo(tmp_path / "fifo")
    for place, why in ((tmp_path, "not a plain file"), (tmp_path / "fifo", "not a plain file"), ("/dev/null", "not a plain file"),
                       ("/dev/full", "not a plain file"), (tmp_path / "none" / "kept", "No such file or directory")):
        assert refused(tmp_path, *options, place) == f"{place}: {why}"
    run(*options, tmp_path / "byte")
    (tmp_path / "empty").touch()
    run(*options, tmp_path / "empty")
    assert kept(tmp_path / "byte") == kept(tmp_path / "empty") == [0]


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_read_only(refused, run, scenario, tmp_path):
    run("simulate", scenario, "--steps", 5, "--resume", tmp_path / "kept")
    (tmp_path / "kept").chmod(stat.S_IRUSR)
    assert "Permission denied" in refused(tmp_path, "simulate", scenario, "--steps", 5, "--runs", 2, "--resume", tmp_path / "kept")


def test_two_campaigns_one_file(start, refused, scenario, tmp_path):
    file = tmp_path / "kept"
    job, _ = start("--steps", 40, "--runs", FOREVER, "--resume", file)
    while not file.exists() or len(file.read_bytes()) < 2000:
        time.sleep(0.01)
    before = set(tmp_path.rglob("*"))
    try:
        said = refused(tmp_path, "simulate", scenario, "--steps", 40, "--runs", 5, "--resume", file)
        assert said == f"{file}: another campaign is writing to it" and set(tmp_path.rglob("*")) == before
    finally:
        job.kill()
        job.communicate()
    assert kept(file) == list(range(len(kept(file))))


def test_no_room_for_kept_runs(run, figures, one, tmp_path):
    """Complete runs stay, and go on when there is room again; without room for any nothing is left."""
    file, options = tmp_path / "kept", ("--steps", 3, "--runs", 30, "--threads", 2)

    def limit(size):
        def small_files():
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
            resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))
        return {"preexec_fn": small_files, "restore_signals": False}
    assert b"File too large" in run("simulate", one, *options, "--resume", file, status=2, **limit(50)).stderr
    assert not file.exists()
    said = run("simulate", one, *options, "--resume", file, status=1, **limit(1000)).stderr
    assert said == f"meshkal: {file}: File too large\n".encode() and 0 < len(kept(file)) < 30
    assert figures(*options, "--resume", file, path=one) == figures(*options, path=one)


def test_what_does_not_go_together(refused, scenario, one, tmp_path):
    (tmp_path / "y.csv").write_text("t,node,row,value\n0,0,0,1.5\n")
    for options, why in (
            (("--resume", "{}/kept", "--out", "{}/log"), "--resume keeps figures, not logs: leave --out away"),
            (("--resume", "{}/kept", "--measurements", "{}/y.csv"), "--resume: recorded measurements are one run"),
            (("--runs", 2, "--measurements", "{}/y.csv"), "--runs: recorded measurements can be run once only"),
            (("--truth", "least-favourable", "--measurements", "{}/y.csv"), "--truth least-favourable is for drawn data, not with --measurements"),
            (("--arrivals", "{}/a.csv", "--loss", 0.1), "--loss: with --arrivals the file says what is lost"),
            (("--arrivals", "{}/a.csv", "--runs", 2), "--runs: recorded arrivals can be run once only"),
            (("--arrivals", "{}/a.csv", "--resume", "{}/kept"), "--resume: recorded arrivals are one run"),
            (("--arrivals", "{}/a.csv", "--filter", "rkfc"), "--arrivals is for one distributed filter; choose one with --filter"),
            (("--arrivals", "{}/a.csv", "--filter", "all"), "--arrivals is for one distributed filter; choose one with --filter"),
            (("--truth", "worst"), "--truth worst: must be nominal or least-favourable; a file goes with --measurements"),
            (("--horizon", 300), "--horizon goes with --truth least-favourable"),
            (("--truth", "least-favourable", "--steps", 50, "--horizon", 48), "--horizon 48: the least favourable model must reach the last step, 49"),
            (("--truth", "least-favourable", "--horizon", -1), "--horizon -1: must be an integer from 0 to 100000000"),
            (("--threads", 0), "--threads 0: must be an integer from 1 to 4096"),
            (("--split", "runs"), "simulate: unknown option --split (meshkal help lists them)"),
            (("--resume",), "simulate: option --resume needs a value")):
        assert refused(tmp_path, "simulate", one, *options) == why
    # The last step and no further is enough; its figures are not those of the default.
    blind = tmp_path / "blind.json"
    blind.write_text(json.dumps(star(1) | {"model": {"A": [[1e200]], "Q": [[1.0]]}, "tolerance": 0.1}))
    said = refused(tmp_path, "simulate", blind, "--truth", "least-favourable", "--filter", "kfd")
    assert said.startswith("tolerance 0.1: "), said


def test_shortest_horizon(figures):
    options = ("--truth", "least-favourable", "--steps", 30)
    assert figures(*options, "--horizon", 29) != figures(*options, "--horizon", 130) == figures(*options)
