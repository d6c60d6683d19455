# SPDX-License-Identifier: MIT
"""Runs as files and streams: repeatable, interruptible, fed with recorded data. The numbers themselves are compared with an
independent reference in tests/reference."""
import json
import os
import resource
import signal
import subprocess
import time

import numpy as np
import pytest
from logs import items, log

ONE = {"model": {"A": [[0.9]], "Q": [[0.2]]}, "nodes": [{"C": [[1.0]], "R": [[0.5]]}], "edges": [], "tolerance": 0.05}


def steps_of(data):
    """The bytes of the step items: what has to repeat, whatever the header says of the command line."""
    found, _ = items(data)
    return data[found[0][1]:found[-2][1]]


@pytest.fixture(scope="module")
def scenario(run, tmp_path_factory):
    path = tmp_path_factory.mktemp("runs") / "projectile.json"
    path.write_bytes(run("scenario", "projectile", "--nodes", 8, "--seed", 2).stdout)
    return path


@pytest.fixture(scope="module")
def logged(run, scenario):
    """The bytes of a log on standard output; of the 8-node scenario unless another is given."""
    def call(*arguments, path=scenario, **options):
        return run("simulate", path, *arguments, "--out", "-", **options).stdout
    return call


# --- the same again ------------------------------------------------------------------------------------------------

@pytest.mark.parametrize("options", [(), ("--real", "float32"), ("--filter", "rkfdnu", "--loss", 0.3), ("--filter", "rkfc", "--loss", 0.3), ("--runs", 3)])
def test_same_seed_same_bytes(logged, options):
    options = ("--steps", 40, *options)
    first = logged("--seed", 5, *options)
    assert logged("--seed", 5, *options) == first
    other = logged("--seed", 6, *options)
    assert len(other) == len(first) and steps_of(other) != steps_of(first)
    a, b = log(first)[1], log(other)[1]
    assert all((x["measurements"] != y["measurements"]).all() for x, y in zip(a, b))
    if "--loss" in options:
        assert any((x["measurements_arrived"] != y["measurements_arrived"]).any() for x, y in zip(a, b))


def test_design_and_scenario_repeat(run, scenario, tmp_path):
    for place in ("a", "b"):
        run("design", scenario, "--json", tmp_path / f"{place}.json", "--c-header", tmp_path / place, "--per-step", 20)
    assert (tmp_path / "a.json").read_bytes() == (tmp_path / "b.json").read_bytes()
    names = sorted(p.name for p in (tmp_path / "a").iterdir())
    assert names == [f"node_{k:02}.h" for k in range(8)]
    assert all((tmp_path / "a" / n).read_bytes() == (tmp_path / "b" / n).read_bytes() for n in names)
    draws = [run("scenario", "projectile", "--seed", s).stdout for s in (1, 1, 2)]
    assert draws[0] == draws[1] != draws[2]


def test_runs_are_separate_draws(logged):
    three, one = log(logged("--steps", 20, "--runs", 3)), log(logged("--steps", 20))
    assert [(i["run"], i["step"]) for i in three[1]] == [(r, t) for r in range(3) for t in range(20)]
    assert three[0]["runs"] == 3 and three[2] == {"end": "complete", "items": 60}
    assert steps_of(logged("--steps", 20, "--runs", 3)).startswith(steps_of(logged("--steps", 20)))
    for r in (1, 2):
        # A run starts from the prior again, with another truth.
        assert (three[1][20 * r]["estimate"] == one[1][0]["estimate"]).all()
        assert all((three[1][20 * r + t]["truth"] != one[1][t]["truth"]).all() for t in range(20))


def test_no_loss_is_loss_zero(logged):
    assert logged("--steps", 20, "--loss", 0) == logged("--steps", 20)
    everything = log(logged("--steps", 5, "--loss", 1))[1]
    firsts = np.cumsum([0] + [len(s) for s in log(logged("--steps", 5))[0]["slots"]])[:-1]
    for item in everything:
        # A node always hears itself.
        assert sorted(np.flatnonzero(item["measurements_arrived"])) == list(firsts) == sorted(np.flatnonzero(item["estimates_arrived"]))


def test_losses_do_not_know_the_noise(logged):
    """Whether a message arrives has nothing to do with the noise in it, nor with that of the node that waits for it."""
    header, steps, _ = log(logged("--steps", 1000, "--loss", 0.5))
    C = np.concatenate([n["C"] for n in json.loads(header["scenario"])["nodes"]])
    noise = np.array([(i["measurements"] - C @ i["truth"])[0::2] for i in steps])
    noise /= noise.std(axis=0)
    links = [(e, l) for e, slots in enumerate(header["slots"]) for l in slots]
    for key in ("measurements_arrived", "estimates_arrived"):
        arrived = np.array([i[key] for i in steps]) - 0.5
        for end in (0, 1):
            products = np.array([(arrived[:, i] * noise[:, link[end]]).sum() for i, link in enumerate(links) if link[0] != link[1]])
            assert abs(np.mean(arrived[:, [a != b for a, b in links]])) < 0.02
            assert np.abs(products).max() < 4.5 * 0.5 * np.sqrt(1000), key


def test_options_replace_the_scenario(logged, scenario, tmp_path):
    text = json.loads(scenario.read_text())
    for option, value in (("seed", 77), ("tolerance", 0.3), ("steps", 31)):
        path = tmp_path / f"{option}.json"
        path.write_text(json.dumps(text | {option: value}))
        with_option, with_file = logged(f"--{option}", value), logged(path=path)
        assert steps_of(with_option) == steps_of(with_file) != steps_of(logged())
        if option != "tolerance":
            assert log(with_option)[0][option] == value
    # More steps do not change the first ones.
    assert steps_of(logged()).startswith(steps_of(logged("--steps", 31)))


def test_stream_is_the_file(run, scenario, tmp_path):
    for options in (("--steps", 30), ("--steps", 30, "--real", "float32", "--filter", "kfc")):
        on_file = run("simulate", scenario, *options, "--out", tmp_path / "log", "--json", tmp_path / "a.json")
        on_stream = run("simulate", scenario, *options, "--out", "-", "--json", tmp_path / "b.json")
        assert (tmp_path / "log").read_bytes() == on_stream.stdout
        # The table goes where the log does not.
        assert b"filter " in on_file.stdout and b"filter " in on_stream.stderr and on_file.stderr == b""
        a, b = (json.loads((tmp_path / f"{n}.json").read_text()) for n in "ab")
        assert a["filters"][0]["node_msd"] == b["filters"][0]["node_msd"]
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.json", "b.json", "log"]


def test_summary_in_a_fifo(program, run, scenario, tmp_path):
    """A place that is no file, such as /dev/stdout or /dev/null, is written to: never replaced."""
    fifo = tmp_path / "fifo"
    os.mkfifo(fifo)
    for command in ("simulate", "design"):
        reader = subprocess.Popen(["timeout", "20", "cat", fifo], stdout=subprocess.PIPE)
        try:
            run(command, scenario, "--json", fifo)
            assert fifo.is_fifo(), "the fifo was replaced by a file"
            json.loads(reader.communicate()[0])
        finally:
            reader.kill()
            reader.wait()


# --- small networks ------------------------------------------------------------------------------------------------

@pytest.mark.parametrize("real", ["float32", "float64"])
@pytest.mark.parametrize("name", ["kfc", "rkfc", "kfd", "rkfdu", "rkfdnu", "rkfdnu2"])
def test_single_node(logged, tmp_path, name, real):
    path = tmp_path / "one.json"
    path.write_text(json.dumps(ONE))
    header, steps, end = log(logged("--filter", name, "--real", real, "--steps", 60, path=path))
    assert header["slots"] == [[0]] and header["real"] == real and len(steps) == 60 and end["end"] == "complete"
    assert steps[0]["estimate"].dtype == steps[0]["theta"].dtype == np.dtype(real)
    # Alone, every filter is the centre: with theta where c > 0, without where c = 0.
    assert (steps[-1]["theta"][0] > 0) == (name not in ("kfc", "kfd"))
    twin = log(logged("--filter", "kfc" if name in ("kfc", "kfd") else "rkfc", "--steps", 60, path=path))[1]
    a, b = (np.array([i["estimate"][0] for i in s], float) for s in (steps, twin))
    assert np.abs(a - b).max() < (1e-12 if real == "float64" else 1e-5)


# --- interrupted, cut, refused -------------------------------------------------------------------------------------

@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("runs", [1, 10**6])
def test_interrupted(program, logged, scenario, tmp_path, number, runs):
    out, summary = tmp_path / "log", tmp_path / "summary"
    length = 10**6 if runs == 1 else 100
    job = subprocess.Popen([program, "simulate", scenario, "--steps", str(length), "--runs", str(runs), "--out", out, "--json", summary],
                           stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    for _ in range(2000):
        if out.exists() and out.stat().st_size > 300000:
            break
        time.sleep(0.01)
    job.send_signal(number)
    said = job.communicate(timeout=30)[0]
    assert job.returncode == 1
    header, steps, end = log(out.read_bytes())
    assert end == {"end": "interrupted", "items": len(steps)} and len(steps) > 20
    assert [(i["run"], i["step"]) for i in steps] == [divmod(i, length) for i in range(len(steps))]
    whole = logged("--steps", min(length, len(steps)), "--runs", -(-len(steps) // length))
    assert steps_of(whole).startswith(steps_of(out.read_bytes()))
    figures = json.loads(summary.read_text())["filters"][0]
    # The signal may have come in the last step of a run.
    assert figures["interrupted"] is True and figures["runs_done"] in (len(steps) // length, (len(steps) - 1) // length)
    assert b"interrupted: the figures are of the runs that were complete" in said
    assert sorted(p.name for p in tmp_path.iterdir()) == ["log", "summary"]


def test_figures_of_interrupted_runs(program, run, scenario, tmp_path):
    """They are those of the complete runs alone: what a run that was cut short left in the sums does not count."""
    out, job = tmp_path / "log", None
    for _ in range(5):
        job = subprocess.Popen([program, "simulate", scenario, "--steps", "300", "--runs", "1000000", "--out", out, "--json", tmp_path / "cut"],
                               stdout=subprocess.DEVNULL)
        while not out.exists() or out.stat().st_size < 1500000:
            time.sleep(0.001)
        job.send_signal(signal.SIGINT)
        assert job.wait(30) == 1
        if 100 < log(out.read_bytes())[2]["items"] % 300 < 280:
            break
        out.unlink()
    cut = json.loads((tmp_path / "cut").read_text())["filters"][0]
    assert cut["runs_done"] >= 2
    run("simulate", scenario, "--steps", 300, "--runs", cut["runs_done"], "--json", tmp_path / "whole")
    whole = json.loads((tmp_path / "whole").read_text())["filters"][0]
    for key in ("msd", "msd_ci95", "position_msd_db", "msd_over_time", "node_msd", "state_rmse", "mean_theta", "mean_tolerance", "nis_ratio"):
        assert cut[key] == pytest.approx(whole[key], rel=1e-12), key


def test_interrupted_stream(program, scenario):
    job = subprocess.Popen([program, "simulate", scenario, "--steps", "1000000", "--out", "-"], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
    data = job.stdout.read(300000)
    job.send_signal(signal.SIGINT)
    _, steps, end = log(data + job.stdout.read())
    assert job.wait(30) == 1 and end == {"end": "interrupted", "items": len(steps)}


def test_cut_anywhere(logged, tmp_path):
    path = tmp_path / "one.json"
    path.write_text(json.dumps(ONE))
    data = logged("--steps", 4, path=path)
    whole, _ = items(data)
    assert len(whole) == 6
    for length in range(len(data)):
        found, cut = items(data[:length])
        complete = [end for _, end in whole if end <= length]
        assert [end for _, end in found] == complete
        assert cut == (length not in [0, *complete])


def test_reader_goes_away(program, scenario):
    job = subprocess.Popen([program, "simulate", scenario, "--steps", "1000000", "--out", "-"], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert len(job.stdout.read(5000)) == 5000
    job.stdout.close()
    said = job.stderr.read()
    assert job.wait(30) == 1 and said == b"meshkal: writing the log: Broken pipe\n"


def test_full_disk(run, scenario, tmp_path):
    full = b"No space left on device"
    with open("/dev/full", "wb") as device:
        for steps in (1, 1000):
            assert full in run("simulate", scenario, "--steps", steps, "--out", "/dev/full", status=1).stderr
            assert full in run("simulate", scenario, "--steps", steps, "--out", "-", stdout=device, status=1).stderr
        # Tables and scenarios on standard output are results too.
        assert full in run("scenario", "projectile", "--nodes", 300, stdout=device, status=1).stderr
        assert full in run("design", scenario, stdout=device, status=1).stderr
        assert full in run("simulate", scenario, stdout=device, status=1).stderr


@pytest.mark.parametrize("limit", [100, 6000])
def test_file_that_cannot_grow(run, scenario, tmp_path, limit):
    """An error while writing, at once or when the buffer is full: status 1, said, and nothing there that looks whole."""
    def small_files():
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
    options = {"preexec_fn": small_files, "restore_signals": False, "status": 1}
    for command in (("simulate", scenario, "--steps", 400, "--json", tmp_path / "x"), ("design", scenario, "--json", tmp_path / "x"),
                    ("design", scenario, "--c-header", tmp_path / "x"), ("simulate", scenario, "--out", tmp_path / "log")):
        said = run(*command, **options).stderr
        assert said.startswith(b"meshkal: ") and b"File too large" in said, said
        # Headers that were complete before stay.
        assert all(p.name == "log" or p.name.startswith("node_") and p.read_text().endswith("\n#endif\n") for p in tmp_path.rglob("*") if p.is_file())
    found, _ = items((tmp_path / "log").read_bytes())
    assert all(item.get("end") != "complete" for item, _ in found)


# --- recorded data -------------------------------------------------------------------------------------------------

def write_csv(path, values, drop=()):
    """values: {(t, node, row): y} or {(t, state): x}; keys in `drop` are left out."""
    names = "t,node,row,value" if len(next(iter(values))) == 3 else "t,state,value"
    lines = [",".join(map(str, k)) + f",{v!r}" for k, v in values.items() if k not in drop]
    path.write_text("\n".join([names, *lines]) + "\n")


def recorded(data):
    """Measurements and truth of a log, as dictionaries."""
    header, steps, _ = log(data)
    place = [(k, r) for k, rows in enumerate(header["rows"]) for r in range(rows)]
    y = {(i["step"], *p): float(v) for i in steps for p, v in zip(place, i["measurements"])}
    return y, {(i["step"], s): float(v) for i in steps for s, v in enumerate(i["truth"])}


def without(data, *keys):
    return [{k: v for k, v in item.items() if k not in keys} for item in log(data)[1]]


UNKNOWN = ("truth", "measurements", "innovation", "innovation_variance")  # may be NaN


def same(a, b):
    return len(a) == len(b) and all(x.keys() == y.keys() and all(np.array_equal(x[k], y[k], equal_nan=k in UNKNOWN)
                                                                   for k in x) for x, y in zip(a, b))


@pytest.mark.parametrize("options", [(), ("--loss", 0.3), ("--real", "float32"), ("--filter", "rkfdnu"), ("--filter", "rkfc", "--loss", 0.3)])
def test_recording_replays(logged, tmp_path, options):
    """Drawn, written as CSV, read again: every bit of every step."""
    drawn = logged("--steps", 50, *options)
    y, x = recorded(drawn)
    write_csv(tmp_path / "y.csv", y)
    write_csv(tmp_path / "x.csv", x)
    again = logged("--measurements", tmp_path / "y.csv", "--truth", tmp_path / "x.csv", *options)
    assert log(again)[0]["source"] == "recorded" and log(drawn)[0]["source"] == "drawn" and log(again)[0]["steps"] == 50
    assert steps_of(again) == steps_of(drawn)
    blind = logged("--measurements", tmp_path / "y.csv", *options)
    assert same(without(blind), without(drawn, "truth", "error"))


def arrivals(data):
    """What arrived, by the log: (t, stage, from, to)."""
    header, steps, _ = log(data)
    links = [(node, k) for k, slots in enumerate(header["slots"]) for node in slots]
    return {(i["step"], stage, *link) for i in steps for stage, key in ((1, "measurements_arrived"), (2, "estimates_arrived"))
            for link, arrived in zip(links, i[key]) if arrived and link[0] != link[1]}


def write_arrivals(path, lines):
    path.write_text("t,stage,from,to\n" + "".join("%d,%d,%d,%d\n" % line for line in lines))


@pytest.mark.parametrize("options", [(), ("--real", "float32"), ("--filter", "kfd"), ("--filter", "rkfdnu", "--truth", "least-favourable")])
def test_arrivals_replay(logged, tmp_path, options):
    """Drawn with losses, the arrivals written as CSV in any order, read again: every bit of every step."""
    drawn = logged("--steps", 60, "--loss", 0.3, *options)
    lines = sorted(arrivals(drawn), key=hash)
    header, _, _ = log(drawn)
    links = sum(len(slots) - 1 for slots in header["slots"])
    assert 0.5 * 120 * links < len(lines) < 0.9 * 120 * links
    write_arrivals(tmp_path / "a.csv", lines)
    again = logged("--steps", 60, "--arrivals", tmp_path / "a.csv", *options)
    assert steps_of(again) == steps_of(drawn)
    assert log(again)[0]["loss"] == pytest.approx(1 - len(lines) / (120 * links), abs=1e-12)
    # One arrival fewer, and the node that missed it differs from then on, no other before.
    t, stage, sender, to = lost = next(line for line in sorted(lines) if line[0] == 30)
    write_arrivals(tmp_path / "b.csv", [line for line in lines if line != lost])
    other = log(logged("--steps", 60, "--arrivals", tmp_path / "b.csv", *options))[1]
    for a, b in zip(log(drawn)[1], other):
        x, y = (i["estimate"].reshape(8, -1) for i in (a, b))
        differs = [k for k in range(8) if x[k].tobytes() != y[k].tobytes()]
        assert differs == [] if a["step"] <= t else to in differs
        assert a["step"] != t + 1 or stage == 1 or differs == [to]


def test_no_arrivals(logged, tmp_path):
    write_arrivals(tmp_path / "a.csv", [])
    assert without(logged("--steps", 20, "--arrivals", tmp_path / "a.csv")) and same(
        without(logged("--steps", 20, "--arrivals", tmp_path / "a.csv")), without(logged("--steps", 20, "--loss", 1)))


def test_arrivals_beyond_the_run(logged, tmp_path):
    drawn = logged("--steps", 40, "--loss", 0.5)
    write_arrivals(tmp_path / "a.csv", sorted(arrivals(drawn)))
    first = logged("--steps", 15, "--arrivals", tmp_path / "a.csv")
    assert steps_of(drawn).startswith(steps_of(first))


def test_lost_readings_may_be_left_out(logged, tmp_path):
    """To the centre, a reading that was lost on the way and one that was never made are the same."""
    drawn = logged("--steps", 80, "--filter", "rkfc", "--loss", 0.4)
    y, x = recorded(drawn)
    steps = log(drawn)[1]
    lost = {(t, k, r) for (t, k, r) in y if not steps[t]["measurements_arrived"][k]}
    assert 0.2 * len(y) < len(lost) < 0.6 * len(y)
    write_csv(tmp_path / "y.csv", y, lost)
    again = logged("--filter", "rkfc", "--measurements", tmp_path / "y.csv", "--steps", 80)
    assert same(without(again, "measurements"), without(drawn, "measurements", "truth", "error"))
    for item in log(again)[1]:
        assert (np.isnan(item["measurements"].reshape(-1, 2)).all(axis=1) == (item["measurements_arrived"] == 0)).all()


def test_partial_readings_are_left_out(run, logged, scenario, tmp_path):
    y, _ = recorded(logged("--steps", 30))
    rng = np.random.default_rng(3)
    whole = {(t, k): rng.uniform() for (t, k, r) in y}
    gone = {(t, k, r) for (t, k, r) in y if whole[t, k] < 0.2}
    half = {(t, k, r) for (t, k, r) in y if 0.2 <= whole[t, k] < 0.3 and r == k % 2}
    rest = {(t, k, r) for (t, k, r) in y if 0.2 <= whole[t, k] < 0.3}
    write_csv(tmp_path / "half.csv", y, gone | half)
    write_csv(tmp_path / "none.csv", y, gone | rest)
    assert logged("--measurements", tmp_path / "half.csv") == logged("--measurements", tmp_path / "none.csv")
    said = run("simulate", scenario, "--measurements", tmp_path / "half.csv").stdout.decode()
    assert f"{len(half)} readings with some of their rows missing were left out whole." in said
    # The arrivals are those of the file, slot by slot.
    header, steps, _ = log(logged("--measurements", tmp_path / "half.csv"))
    slots = np.concatenate(header["slots"])
    for item in steps:
        there = np.array([whole[item["step"], k] >= 0.3 for k in range(8)])
        assert (item["measurements_arrived"] == there[slots]).all()
        assert (item["nis_rows"] == [2 * there[s].sum() for s in header["slots"]]).all()


def test_partial_truth(logged, tmp_path):
    y, x = recorded(logged("--steps", 20))
    unknown = {(t, s) for (t, s) in x if s < 3 or t % 4 == 1}
    write_csv(tmp_path / "y.csv", y)
    write_csv(tmp_path / "x.csv", x, unknown)
    for item in log(logged("--measurements", tmp_path / "y.csv", "--truth", tmp_path / "x.csv"))[1]:
        t = item["step"]
        assert [np.isnan(v) for v in item["truth"]] == [(t, s) in unknown for s in range(6)]
        known = ~np.isnan(item["truth"])
        gap = item["truth"] - item["estimate"].reshape(8, 6)
        assert item["error"] == pytest.approx(np.linalg.norm(gap[:, known], axis=1), rel=1e-12)


def test_steps_of_a_recording(logged, tmp_path):
    y, _ = recorded(logged("--steps", 20))
    write_csv(tmp_path / "y.csv", y)
    for steps in (7, 20, 33):
        header, made, _ = log(logged("--measurements", tmp_path / "y.csv", "--steps", steps))
        assert header["steps"] == len(made) == steps
        # Beyond the end there is nothing to hear, and the filter goes on.
        assert all(i["measurements_arrived"].all() == (i["step"] < 20) and i["measurements_arrived"].any() == (i["step"] < 20) for i in made)
