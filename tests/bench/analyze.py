# SPDX-License-Identifier: MIT
"""Cost of meshkal analyze against the number of nodes: time and memory of one filter over 200 steps.

    .venv/bin/python tests/bench/analyze.py build/meshkal build/bench [--large]

Prints a table and the fitted exponent, writes analyze.json and analyze.png into the folder. --large goes up to 1000 nodes.
"""
import argparse
import json
import math
import os
import pathlib
import subprocess
import tempfile

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt

HORIZON, DEGREE, FILTER = 200, 6, "rkfdnu2"


def measure(program, folder, nodes):
    scenario, out = folder / f"{nodes}.json", folder / "out.json"
    scenario.write_bytes(subprocess.run([program, "scenario", "projectile", "--nodes", str(nodes), "--density", str(DEGREE)],
                                        check=True, stdout=subprocess.PIPE).stdout)
    subprocess.run([program, "analyze", scenario, "--filter", FILTER, "--horizon", str(HORIZON), "--json", out], check=True, stdout=subprocess.DEVNULL)
    result = json.loads(out.read_text())
    return {"nodes": nodes, "seconds": result["seconds"], "mib": result["peak_memory_bytes"] / 2**20, "msd_db": result["msd_db"]}


def exponent(rows, key):
    """Least squares of log y on log nodes."""
    x, y = [math.log(r["nodes"]) for r in rows], [math.log(r[key]) for r in rows]
    mean_x, mean_y = sum(x) / len(x), sum(y) / len(y)
    return sum((a - mean_x) * (b - mean_y) for a, b in zip(x, y)) / sum((a - mean_x) ** 2 for a in x)


def plot(rows, slope, path):
    figure, axes = plt.subplots(figsize=(6, 4), layout="constrained")
    nodes = [r["nodes"] for r in rows]
    axes.loglog(nodes, [r["seconds"] for r in rows], "o-", label="seconds")
    axes.loglog(nodes, [r["mib"] for r in rows], "s-", label="MiB, whole process")
    last = rows[-1]
    axes.loglog(nodes, [last["seconds"] * (n / last["nodes"]) ** 2 for n in nodes], ":", color="grey", label="square of the nodes")
    axes.set(xlabel="nodes", title=f"meshkal analyze, {FILTER}, {HORIZON} steps: seconds grow as N^{slope:.2f}")
    axes.grid(True, which="both", alpha=0.3)
    axes.legend()
    figure.savefig(path, dpi=120)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program", type=pathlib.Path)
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--large", action="store_true", help="up to 1000 nodes")
    arguments = parser.parse_args()
    sizes = [20, 50, 100, 200, 500] + [1000] * arguments.large
    cores = len(os.sched_getaffinity(0))
    print(f"meshkal analyze: {FILTER}, 6 states, mean degree {DEGREE}, {HORIZON} steps, {cores} cores\n\n{'nodes':>7} {'seconds':>9} {'MiB':>7} {'MSD [dB]':>9}")
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for nodes in sizes:
            row = measure(arguments.program.resolve(), pathlib.Path(folder), nodes)
            rows.append(row)
            msd = "-" if row["msd_db"] is None else f"{row['msd_db']:.3f}"
            print(f"{nodes:7d} {row['seconds']:9.3f} {row['mib']:7.0f} {msd:>9}", flush=True)
    large = [r for r in rows if r["nodes"] >= 100]
    slope, memory = exponent(large, "seconds"), exponent(large, "mib")
    print(f"\nfrom 100 nodes on: seconds grow as N^{slope:.2f}, memory as N^{memory:.2f}")
    arguments.folder.mkdir(parents=True, exist_ok=True)
    result = {"filter": FILTER, "horizon": HORIZON, "degree": DEGREE, "cores": cores, "sizes": rows, "exponent_seconds": slope, "exponent_memory": memory}
    (arguments.folder / "analyze.json").write_text(json.dumps(result, indent=1) + "\n")
    plot(rows, slope, arguments.folder / "analyze.png")
    print(f"{arguments.folder / 'analyze.json'}, {arguments.folder / 'analyze.png'}")


if __name__ == "__main__":
    main()
