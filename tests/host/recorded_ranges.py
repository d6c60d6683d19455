# SPDX-License-Identifier: MIT
"""Recordings as an indoor network of ultra-wideband anchors gives them: a walking tag, one range at a time at irregular times, positive outliers in
bursts (no line of sight), missing frames and gaps, lines out of order and twice, time stamps of the Unix epoch; motion capture at other times.

    python tests/host/recorded_ranges.py FOLDER [--seed S] [--outliers P] ...    scenario.json, ranges.csv, truth.csv
    python tests/host/recorded_ranges.py [--seed S] [--outliers P] ...           what gates are worth on 20 recordings from seed S on, in Markdown
"""
import argparse
import concurrent.futures
import dataclasses
import json
import math
import os
import pathlib
import subprocess
import sys
import tempfile

import numpy as np

ROOM = (12.0, 8.0)
EPOCH = 1.7e9
SIGMA = 0.1
STATES = {2: ["px", "py", "vx", "vy"], 3: ["px", "py", "pz", "vx", "vy", "vz"]}
CAPTURE = 100.0  # Hz

GATE = {"significance": 1e-4, "policy": "skip", "patience": 10}
INFLATE = {"significance": 1e-2, "policy": "inflate", "patience": 10}
# The table: its columns, and of each row whether there are outliers, and the gate.
FILTERS = ["ekf", "ukf", "pukf", "mpukf", "duif", "kcf", "rekfd"]
POLICIES = [("no outliers, no gate", False, None), ("no gate", True, None),
            ("skip, significance 1e-4, no way back", True, GATE | {"patience": 0}), ("**the same, P := P0 after `patience` 10**", True, GATE),
            ("inflate, significance 1e-2, patience 10", True, INFLATE)]
RECORDINGS = 20
LOST = 5.0  # s
PROGRAM = pathlib.Path(__file__).resolve().parents[2] / "build" / "meshkal"


@dataclasses.dataclass
class Recording:
    anchors: np.ndarray  # anchors x dimensions
    t: np.ndarray        # of each range, Unix time in whole microseconds
    anchor: np.ndarray
    value: np.ndarray    # m, in whole millimetres
    outlier: np.ndarray  # bool
    truth_t: np.ndarray
    truth: np.ndarray    # positions
    order: np.ndarray    # of the lines of the file: indices of ranges, some twice


def walk(rng, seconds, dimensions):
    """Positions at CAPTURE Hz: from place to place at up to 1.5 m/s, stops of 1 to 4 s at half of them; the height nods, and falls where the tag stops."""
    step, count = 1 / CAPTURE, int(seconds * CAPTURE) + 1
    p, v, wait = np.array([rng.uniform(2, ROOM[0] - 2), rng.uniform(2, ROOM[1] - 2)]), np.zeros(2), 0.0
    goal, speed, low, path = p, 1.5, 0.0, np.empty((count, 3))
    for i in range(count):
        if np.linalg.norm(goal - p) < 0.4:
            wait = rng.uniform(1, 4) if rng.random() < 0.5 else 0.0
            goal, speed = np.array([rng.uniform(1, ROOM[0] - 1), rng.uniform(1, ROOM[1] - 1)]), rng.uniform(0.8, 1.5)
        wait -= step
        wanted = np.zeros(2) if wait > 0 else speed * (goal - p) / max(np.linalg.norm(goal - p), 1e-9)
        v = v + (wanted - v) * step / 0.35
        p = p + v * step
        low += ((0.5 if wait > 0 else 0.0) - low) * step / 0.4
        path[i] = [*p, 1.2 - low + 0.03 * np.linalg.norm(v) / 1.5 * np.sin(2 * np.pi * 1.8 * i * step)]
    return path[:, :dimensions]


def place_anchors(count, dimensions):
    """Along the walls, in 3-D below the ceiling and at two heights: all at one height would leave the tag's ambiguous."""
    turn = 2 * np.pi * (np.arange(count) + 0.5) / count
    ray = np.stack([np.cos(turn), np.sin(turn)], 1)
    ray /= np.abs(ray).max(1, keepdims=True)
    anchors = (ray + 1) / 2 * np.array(ROOM)
    height = np.where(np.arange(count) % 3 == 1, 1.8, 2.9)[:, None]
    return np.round(np.hstack([anchors, height]) if dimensions == 3 else anchors, 3)


def bursts(rng, t, share):
    """Which of the times of one anchor are without line of sight: bursts of 0.5 to 3 s, `share` of the time."""
    blocked = np.zeros(len(t), bool)
    bias = np.zeros(len(t))
    if share <= 0:
        return blocked, bias
    at = t[0] + rng.exponential(1.75 * (1 - share) / share)
    while at < t[-1]:
        length = rng.uniform(0.5, 3.0)
        now = (t >= at) & (t < at + length)
        blocked |= now
        bias[now] = rng.uniform(0.5, 2.5)
        at += length + rng.exponential(1.75 * (1 - share) / share)
    return blocked, np.where(blocked, np.maximum(bias + rng.normal(0, 0.2, len(t)), 0.2), 0.0)


def record(seed, anchors=8, dimensions=2, seconds=60.0, rate=30.0, outliers=0.1, missing=0.1, gaps=2, places=None, epoch=EPOCH):
    """One draw. With another share of outliers the same seed gives the same walk, times and noise."""
    motion, radio, clock = (np.random.default_rng([seed, i]) for i in range(3))
    path = walk(motion, seconds, dimensions)
    grid = np.arange(len(path)) / CAPTURE
    place = place_anchors(anchors, dimensions) if places is None else np.asarray(places, float)
    polls = int(seconds * rate)
    t = (np.arange(polls) + clock.uniform(0.1, 0.7, polls)) / rate
    anchor = np.arange(polls) % len(place)
    keep = (clock.random(polls) >= missing) & (t < grid[-1])
    for _ in range(gaps):
        start = clock.uniform(0.1, 0.9) * seconds
        keep &= (t < start) | (t > start + clock.uniform(1.0, 3.0))
    noise = clock.normal(0, SIGMA, polls)
    bias, outlier = np.zeros(polls), np.zeros(polls, bool)
    for k in range(len(place)):
        mine = anchor == k
        outlier[mine], bias[mine] = bursts(radio, t[mine], outliers)
    t, anchor, noise, bias, outlier = t[keep], anchor[keep], noise[keep], bias[keep], outlier[keep]
    at = np.stack([np.interp(t, grid, path[:, i]) for i in range(dimensions)], 1)
    value = np.round(np.linalg.norm(at - place[anchor], axis=1) + noise + bias, 3)
    order = np.concatenate([np.arange(len(t)), clock.choice(len(t), len(t) // 100, False)])
    order = order[np.argsort(t[order] + clock.uniform(0, 0.3, len(order)))]  # what was buffered comes late
    return Recording(place, np.round((epoch + t) * 1e6) / 1e6, anchor, value, outlier, np.round((epoch + grid + 0.0037) * 1e6) / 1e6, path, order)


def scenario(recording, **tracking):
    """What one who has such a recording writes: a walk, the room's middle as x0, noise of the data sheet, a ring of links and its long diagonals."""
    n, dimensions = len(recording.anchors), recording.anchors.shape[1]
    middle = [ROOM[0] / 2, ROOM[1] / 2, 1.0][:dimensions]
    return {"model": {"motion": "constant-velocity", "states": STATES[dimensions], "acceleration_psd": [0.3, 0.3, 0.1][:dimensions],
                      "x0": middle + [0.0] * dimensions, "P0": np.diag([9.0, 4.0, 0.25][:dimensions] + [1.0] * dimensions).tolist()},
            "nodes": [{"sensor": "range", "position_m": list(map(float, p)), "R": [[round(SIGMA**2, 9)]]} for p in recording.anchors],
            "edges": [[i, (i + 1) % n] for i in range(n)] + [[i, i + n // 2] for i in range(n // 2)], "tracking": tracking}


def lines(recording):
    return ["t,node,row,value"] + [f"{recording.t[i]:.6f},{recording.anchor[i]},0,{recording.value[i]:.3f}" for i in recording.order]


def truth_lines(recording, positions=True):
    rows = zip(recording.truth_t, recording.truth)
    return ["t,state,value"] + [f"{t:.6f},{i},{x:.5f}" for t, p in rows for i, x in enumerate(p)]


def write(folder, recording, **tracking):
    folder = pathlib.Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "ranges.csv").write_text("\n".join(lines(recording)) + "\n")
    (folder / "truth.csv").write_text("\n".join(truth_lines(recording)) + "\n")
    (folder / "scenario.json").write_text(json.dumps(scenario(recording, **tracking), indent=1) + "\n")


def judge(summary):
    """Error after the first 5 s, and the longest time with more than 1 m."""
    t, e = np.array(summary["time_s"]), np.array([np.nan if v is None else v for v in summary["position_rmse_over_time"]])
    with_truth = ~np.isnan(e)
    t, e = t[with_truth], e[with_truth]
    return np.sqrt((e[t > t[0] + 5]**2).mean()), np.diff([t[0], *t[e < 1], t[-1]]).max()


# --- what gates are worth ----------------------------------------------------------------------------------------------------

def judged(program, real, seed, made):
    """policies x filters x what judge says, of one seed."""
    rows, recordings = [], {}
    for row, outliers, gate in POLICIES:
        if outliers not in recordings:
            recordings[outliers] = record(seed, **made | ({} if outliers else {"outliers": 0.0}))
        with tempfile.TemporaryDirectory() as place:
            folder = pathlib.Path(place)
            write(folder, recordings[outliers], **({"gate": gate} if gate else {}))
            done = subprocess.run([program, "simulate", folder / "scenario.json", "--measurements", folder / "ranges.csv", "--truth", folder / "truth.csv",
                                   "--filter", "all", "--real", real, "--threads", "1", "--json", folder / "summary"], stdout=subprocess.DEVNULL)
            if done.returncode:  # of which it has said why
                raise RuntimeError(f"{row}, seed {seed}: {program} failed")
            of = {f["filter"]: f for f in json.loads((folder / "summary").read_text())["filters"]}
        failed = [name for name in FILTERS if of[name]["failures"]]
        if failed:
            raise RuntimeError(f"{row}, seed {seed}: failed: {', '.join(failed)}")
        rows.append([judge(of[name]) for name in FILTERS])
    return rows


def digits(value, count):
    return f"{value:.{min(3, max(0, count - 1 - math.floor(math.log10(value))))}f}"


def print_table(program, real, seed, made):
    """A seed in each thread: the work is the program's. RMSE, in brackets that of the worst recording; on standard error who was lost for long."""
    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        seeds = range(seed, seed + RECORDINGS)
        error, lost = np.moveaxis(np.array(list(pool.map(lambda one: judged(program, real, one, made), seeds))), 3, 0)
    print("| | " + " | ".join(FILTERS) + " |\n|" + "---|" * (len(FILTERS) + 1))
    for (name, *_), total, worst in zip(POLICIES, np.sqrt((error**2).mean(0)), error.max(0), strict=True):
        print(f"| {name} | " + " | ".join(f"{digits(a, 3)} ({digits(b, 2)})" for a, b in zip(total, worst, strict=True)) + " |")
    for (name, *_), longest in zip(POLICIES, lost.max(0), strict=True):
        long = [f"{f} {t:.0f} s" for f, t in zip(FILTERS, longest, strict=True) if t > LOST]
        print(f"{name.strip('*')}: more than 1 m off for more than {LOST:g} s: {', '.join(long) or 'nobody'}", file=sys.stderr)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", nargs="?", help="for the files of one recording; without it: the table")
    parser.add_argument("--meshkal", default=PROGRAM, help="of the table: the program")
    parser.add_argument("--real", default="float64", choices=("float32", "float64"), help="of the table: precision of the filters")
    for name, value in (("seed", 0), ("anchors", 8), ("dimensions", 2), ("gaps", 2), ("seconds", 60.0), ("rate", 30.0), ("outliers", 0.1), ("missing", 0.1)):
        parser.add_argument(f"--{name}", type=type(value), default=value)
    options = vars(parser.parse_args())
    folder, program, real, seed = (options.pop(name) for name in ("folder", "meshkal", "real", "seed"))
    if folder:
        write(folder, record(seed, **options))
        return None
    if not os.access(program, os.X_OK):
        return f"recorded_ranges.py: no program at {program}: make all, or --meshkal"
    try:
        print_table(program, real, seed, options)
    except RuntimeError as failure:
        return f"recorded_ranges.py: {failure}"
    return None


if __name__ == "__main__":
    sys.exit(main())
