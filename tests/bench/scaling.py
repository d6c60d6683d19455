# SPDX-License-Identifier: MIT
"""Strong and weak scaling of meshkal simulate on the cores there are, bytes exchanged a step, and a model of the time of a step.

    .venv/bin/python tests/bench/scaling.py build/meshkal build/meshkal-mpi build/bench/cuts build/bench [--full]

Prints tables; writes scaling.json and scaling.png into the folder. Model, of the slowest rank:

    t_step = a * nodes of a rank + b * bytes that it sends a step + c * (1 if there are other ranks)

by least squares of the relative error, 95 % intervals by Student's t, from networks whose parts fit the caches, as those of the target do.
b is told from the others by links drawn at random, most of which are cut. c is both exchanges with one peer and the share of a step in the
sum that comes every 64 steps. Two cores cannot tell what a message costs among many ranks: how c and the sum grow is taken from the
assumptions below. --full divides a million nodes; otherwise 100 000, with as many nodes a part.
"""
import argparse
import json
import math
import os
import pathlib
import random
import subprocess
import sys
import tempfile
import time

import matplotlib
import numpy as np
import scipy.stats

matplotlib.use("Agg")
import matplotlib.pyplot as plt

FILTER, DENSITY = "rkfdnu2", 9
TARGET_NODES, TARGET_RANKS = 1_000_000, 1000
# Sums of 64 steps, six each of 68 digits of 8 bytes, and one that says who is in trouble: what all ranks add up at once (runner.c).
SUM_STEPS, SUM_BYTES = 64, (64 * 6 + 1) * 68 * 8
# ASSUMED, not measured: InfiniBand HDR, 200 Gbit/s a machine of 64 ranks, every message leaving its machine; sum by halving and doubling.
NETWORK = {"name": "InfiniBand HDR", "latency_s": 1.5e-6, "bytes_per_s": 25e9 / 64}


class Bench:
    def __init__(self, arguments, folder):
        self.program, self.mpi, self.cuts = (str(p.resolve()) for p in (arguments.program, arguments.mpi, arguments.cuts))
        self.folder, self.cores = folder, len(os.sched_getaffinity(0))
        self.environment = os.environ | {"OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1"}

    def scenario(self, nodes, far=False):
        """Neighbours that are near, as in the example but denser: a plane and not a chain; or `far`: links drawn at random, most of them cut."""
        path = self.folder / f"{'far' if far else 'near'}-{nodes}.json"
        if not path.exists():
            text = subprocess.run([self.program, "scenario", "projectile", "--nodes", str(nodes), "--density", str(DENSITY)], check=True,
                                  stdout=subprocess.PIPE).stdout
            if far:
                parsed, draw = json.loads(text), random.Random(1)
                ring = {(k, k + 1) for k in range(nodes - 1)}
                for k, node in enumerate(parsed["nodes"]):  # with those beside it on the ring a node sees all three axes
                    node["C"] = [[float(j == i) for j in range(6)] for i in (3, 4, 5) if i != 3 + k % 3]
                while len(ring) < nodes * (DENSITY - 1) // 2:
                    ring.add(tuple(sorted(draw.sample(range(nodes), 2))))
                text = json.dumps(parsed | {"edges": sorted(ring)}).encode()
            path.write_bytes(text)
        return path

    def simulate(self, scenario, steps, ranks=0, threads=1, runs=1, split="nodes"):
        """ranks 0: the program without MPI."""
        out = self.folder / "out.json"
        # Ranks that wait give their core away only where others need it.
        idle = ["--mca", "mpi_yield_when_idle", str(int(ranks > self.cores))]
        command = [self.program] if ranks == 0 else ["mpirun", "--oversubscribe", "--bind-to", "none", *idle, "-n", str(ranks), self.mpi]
        options = ["simulate", scenario, "--filter", FILTER, "--steps", str(steps), "--runs", str(runs), "--threads", str(threads), "--json", out]
        command += options + (["--split", split] if ranks else [])
        if subprocess.run(command, stdout=subprocess.DEVNULL, env=self.environment).returncode != 0:
            print("once more, what has just failed:", *command, file=sys.stderr)  # mpirun does not start now and then
            subprocess.run(command, check=True, stdout=subprocess.DEVNULL, env=self.environment)
        result = json.loads(out.read_text())
        return {"nodes": result["nodes"], "ranks": max(ranks, 1), "threads": threads, "steps": steps, "runs": runs,
                "step_s": result["filters"][0]["seconds"] / (steps * runs), "rank_0_bytes": result["peak_memory_bytes"],
                "bytes_a_step": result.get("bytes_exchanged_per_step", 0.0), "cut_links": result.get("cut_links", 0)}

    def fastest(self, jobs, repeats):
        """Each job's fastest run: other programs on the machine only add. Repeats are spread over the whole time."""
        best = [None] * len(jobs)
        for _ in range(repeats):
            for i, job in enumerate(jobs):
                row = self.simulate(**job)
                if best[i] is None or row["step_s"] < best[i]["step_s"]:
                    best[i] = row
        return best

    def divide(self, scenario, parts):
        """METIS alone, and the time to read the scenario, on one core."""
        core = {min(os.sched_getaffinity(0))}
        done = subprocess.run([self.cuts, scenario, *map(str, parts)], check=True, stdout=subprocess.PIPE,
                              preexec_fn=lambda: os.sched_setaffinity(0, core))
        return json.loads(done.stdout)


def least_squares(columns, y):
    """Coefficients and half-widths of their 95 % intervals, and the root mean square of the relative error."""
    X = np.array(columns).T / np.array(y)[:, None]
    solution, *_ = np.linalg.lstsq(X, np.ones(len(y)), rcond=None)
    error = X @ solution - 1.0
    degrees = len(y) - X.shape[1]
    spread = np.sqrt(np.diag(np.linalg.inv(X.T @ X)) * (error @ error) / degrees)
    return solution, spread * scipy.stats.t.ppf(0.975, degrees), math.sqrt(float(np.mean(error**2)))


def say(row, first, cores, weak=False):
    """A line of a table. Efficiency: of the ideal, as fast as there are workers, or as slow as alone with weak scaling."""
    workers = row["ranks"] * row["threads"]
    speedup = first["step_s"] / row["step_s"] * (row["nodes"] / first["nodes"] if weak else 1.0)
    note = f"  more than the {cores} cores: no measure" if workers > cores else ""
    print(f"{row['nodes']:8d} {row['ranks']:6d} {row['threads']:8d} {1e3 * row['step_s']:12.3f} {row['nodes'] / row['step_s'] / 1e6:14.2f} "
          f"{speedup:8.2f} {100 * speedup / workers:10.0f} % {row['bytes_a_step']:10.0f} {row['cut_links']:9d}{note}")
    return row | {"speedup": speedup, "oversubscribed": workers > cores}


def table(title, rows, cores, weak=False):
    print(f"\n{title}\n{'nodes':>8} {'ranks':>6} {'threads':>8} {'ms a step':>12} {'M node-steps/s':>14} {'speedup':>8} {'efficiency':>12} "
          f"{'bytes/step':>10} {'links cut':>9}")
    return [say(row, rows[0], cores, weak) for row in rows]


def scale(bench):
    near, small, share = bench.scenario(20000), bench.scenario(1000), 10000
    ranks = sorted({1, 2, 4, bench.cores})
    jobs = {"strong": [dict(scenario=near, steps=20, ranks=k) for k in ranks],
            "threads": [dict(scenario=near, steps=20, threads=k) for k in sorted({1, bench.cores})],
            "runs": [dict(scenario=small, steps=50, runs=8, ranks=k, split="runs") for k in ranks if k <= bench.cores],
            "weak": [dict(scenario=bench.scenario(share * k), steps=20, ranks=k) for k in ranks]}
    rows = bench.fastest([job for part in jobs.values() for job in part], 3)
    titles = {"strong": "Strong scaling, a network shared by processes", "threads": "The same by threads of one process, without MPI",
              "runs": "Runs shared by processes", "weak": f"Weak scaling, {share} nodes a process"}
    result = {}
    for name, part in jobs.items():
        result[name], rows = table(titles[name], rows[:len(part)], bench.cores, name == "weak"), rows[len(part):]
    return result


def fit_step(bench):
    jobs = [dict(scenario=bench.scenario(nodes, far), steps=50_000 // nodes * ranks, ranks=ranks)
            for nodes, far in ((60, False), (60, True), (200, False), (200, True), (600, False), (600, True), (1000, False), (2000, False),
                               (2000, True))
            for ranks in (1, 2) if ranks <= bench.cores and nodes <= 1000 * ranks]
    rows = bench.fastest(jobs, 4)  # short runs, often: some are undisturbed
    nodes, sent = [r["nodes"] / r["ranks"] for r in rows], [r["bytes_a_step"] / r["ranks"] for r in rows]
    step = [r["step_s"] for r in rows]
    columns = [nodes, sent, [float(r["ranks"] > 1) for r in rows]]
    if bench.cores < 2:
        columns = columns[:1]
    solution, half, error = least_squares(columns, step)
    names = ("a_s_per_node", "b_s_per_byte", "c_s_per_exchange")
    model = {name: {"value": float(v), "ci95": float(h)} for name, v, h in zip(names, solution, half)}
    print(f"\nModel of a step, {len(rows)} points of 1 and 2 ranks, {min(nodes):.0f} to {max(nodes):.0f} nodes a rank; relative error {100 * error:.1f} % (rms)")
    for name, unit, text in zip(names, (1e9, 1e9, 1e6), ("ns a node", "ns a byte sent", "us a step with another rank: two exchanges and 1/64 of a sum")):
        if name in model:
            print(f"  {name[0]} = {unit * model[name]['value']:8.3f} +- {unit * model[name]['ci95']:.3f} {text}")
    for row, value in zip(rows, np.array(columns).T @ solution):
        row["model_s"] = float(value)
    return model, error, rows


def divide(bench, full):
    """Links cut against the square-root law, and the parts of the target."""
    found = [bench.divide(bench.scenario(20000), (2, 4, 8, 16, 32, 64)), bench.divide(bench.scenario(100000), (2, 4, 8, 16, 32, 64, 100))]
    points = [(f["nodes"], c["parts"], c["cut_links"]) for f in found for c in f["cuts"]]
    # Lines that divide a square into parts: 2 (sqrt(parts) - 1), each crossed by links as sqrt(nodes).
    X = np.array([[1.0, math.log(n), math.log(math.sqrt(p) - 1.0)] for n, p, _ in points])
    y = np.log([c for *_, c in points])
    law, *_ = np.linalg.lstsq(X, y, rcond=None)
    print(f"\nLinks cut by METIS, mean degree {DENSITY - 1} in the plane: grow as nodes^{law[1]:.2f} (sqrt(parts) - 1)^{law[2]:.2f}; "
          f"square-root law: 0.5 and 1\n"
          f"{'nodes':>8} {'parts':>6} {'links cut':>10} {'of all':>8} {'bytes/step':>11} {'most nodes':>11} {'most bytes':>11} {'most peers':>11} {'seconds':>8}")
    if full:
        found.append(bench.divide(bench.scenario(TARGET_NODES), (TARGET_RANKS,)))
    for f in found:
        for c in f["cuts"]:
            print(f"{f['nodes']:8d} {c['parts']:6d} {c['cut_links']:10d} {100 * c['cut_links'] / f['links']:6.2f} % {c['bytes_a_step']:11d} "
                  f"{c['most_nodes']:11d} {c['most_bytes']:11d} {c['most_peers']:11d} {c['seconds']:8.2f}")
    return found, {"exponent_nodes": float(law[1]), "exponent_sqrt_parts_less_1": float(law[2])}


def extrapolate(model, found):
    """The target by the model, for a part like the largest of the division with as many nodes a part."""
    source, part = found[-1], found[-1]["cuts"][-1]
    grow = TARGET_NODES / source["nodes"]
    nodes, sent, peers = part["most_nodes"], part["most_bytes"], part["most_peers"]
    compute, half = (model["a_s_per_node"][k] * nodes for k in ("value", "ci95"))
    shared, shared_half = 0.0, 0.0
    for name, count in (("b_s_per_byte", sent), ("c_s_per_exchange", peers)):
        if name in model:
            shared += count * model[name]["value"]
            shared_half = math.hypot(shared_half, count * model[name]["ci95"])
    wire, latency = NETWORK["bytes_per_s"], NETWORK["latency_s"]
    exchange = 2 * peers * latency + sent / wire
    sums = (2 * math.ceil(math.log2(TARGET_RANKS)) * latency + 2 * SUM_BYTES / wire) / SUM_STEPS
    read, metis = grow * source["load_seconds"], grow * part["seconds"]
    step = compute + exchange + sums
    print(f"\n{TARGET_NODES} nodes on {TARGET_RANKS} cores, by the model: {1e3 * step:.2f} ms a step, {TARGET_NODES / step / 1e6:.0f} million node-steps a second\n"
          f"  measured here, carried over:  {1e3 * compute:.3f} +- {1e3 * half:.3f} ms, {nodes} nodes of the largest part (cores as fast as these)\n"
          f"  ASSUMED: {NETWORK['name']}, {1e6 * latency:.1f} us a message, {wire / 1e9:.2f} GB/s a rank:  {1e6 * exchange:.0f} us for {peers} peers "
          f"and {sent} bytes; {1e6 * sums:.0f} us for sums\n"
          f"  for comparison, b and c of these cores' shared memory, c for each peer: {1e6 * shared:.0f} +- {1e6 * shared_half:.0f} us instead\n"
          f"  before the first step: {read:.0f} s to read the scenario, whole, on every rank; {metis:.1f} s METIS on the first rank\n"
          f"  not in it: ranks that wait for the slowest, noise of the system, a file system that {TARGET_RANKS} ranks read at once, memory bandwidth shared by\n"
          f"  more than {min(os.cpu_count() or 1, 2)} cores. Division measured: {source['nodes']} nodes in {part['parts']} parts"
          f"{'' if grow == 1 else f'; reading and METIS {grow:.0f} times as long'}.")
    return {"nodes": TARGET_NODES, "ranks": TARGET_RANKS, "step_s": step, "node_steps_per_second": TARGET_NODES / step,
            "compute_s": compute, "compute_ci95": half, "exchange_s_assumed": exchange, "sum_s_assumed": sums,
            "exchange_s_shared_memory": shared, "exchange_ci95_shared_memory": shared_half, "read_s": read, "metis_s": metis,
            "division": {"nodes": source["nodes"]} | part, "assumed_network": NETWORK}


def plot(scaling, rows, found, path):
    figure, (left, middle, right) = plt.subplots(1, 3, figsize=(14, 4.2), layout="constrained")
    for name, style in (("strong", "o-"), ("weak", "s-"), ("runs", "^-"), ("threads", "d-")):
        workers = [r["ranks"] * r["threads"] for r in scaling[name]]
        left.plot(workers, [r["speedup"] for r in scaling[name]], style, label=name)
        over = [(w, r["speedup"]) for w, r in zip(workers, scaling[name]) if r["oversubscribed"]]
        left.plot([w for w, _ in over], [v for _, v in over], "kx", ms=12)
    left.plot([1, 4], [1, 4], ":", color="grey", label="ideal")
    left.set(xlabel="processes or threads (crossed: more than cores)", ylabel="speedup", title="scaling")
    middle.loglog([1e3 * r["step_s"] for r in rows], [1e3 * r["model_s"] for r in rows], "o")
    ends = [1e3 * min(r["step_s"] for r in rows), 1e3 * max(r["step_s"] for r in rows)]
    middle.plot(ends, ends, ":", color="grey")
    middle.set(xlabel="measured, ms a step", ylabel="model, ms a step", title="a nodes + b bytes + c")
    for f in found[:2]:
        parts, cut = [c["parts"] for c in f["cuts"]], [c["cut_links"] for c in f["cuts"]]
        right.loglog(parts, cut, "o-", label=f"{f['nodes']} nodes")
        right.loglog(parts, [cut[2] * (math.sqrt(p) - 1) / (math.sqrt(parts[2]) - 1) for p in parts], ":", color="grey")
    right.set(xlabel="parts", ylabel="links cut", title="METIS and the square-root law (dotted)")
    for axes in (left, right):
        axes.legend()
    for axes in (left, middle, right):
        axes.grid(True, which="both", alpha=0.3)
    figure.savefig(path, dpi=120)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name in ("program", "mpi", "cuts", "folder"):
        parser.add_argument(name, type=pathlib.Path)
    parser.add_argument("--full", action="store_true", help="divide a million nodes into a thousand parts")
    arguments = parser.parse_args()
    from_time = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        bench = Bench(arguments, pathlib.Path(folder))
        load = os.getloadavg()[0]
        print(f"meshkal simulate: {FILTER}, float64, 6 states, mean degree {DENSITY - 1}, {bench.cores} cores in one machine; load before: {load:.1f}")
        scaling = scale(bench)
        model, error, rows = fit_step(bench)
        found, law = divide(bench, arguments.full)
    target = extrapolate(model, found)
    arguments.folder.mkdir(parents=True, exist_ok=True)
    result = {"filter": FILTER, "density": DENSITY, "cores": bench.cores, "load_before": load, "scaling": scaling,
              "model": model, "model_error_rms": error, "points": rows, "divisions": found, "cut_law": law, "extrapolation": target}
    (arguments.folder / "scaling.json").write_text(json.dumps(result, indent=1) + "\n")
    plot(scaling, rows, found, arguments.folder / "scaling.png")
    print(f"\n{arguments.folder / 'scaling.json'}, {arguments.folder / 'scaling.png'}; {time.monotonic() - from_time:.0f} s")


if __name__ == "__main__":
    main()
