# SPDX-License-Identifier: MIT
"""Ten nodes in ten network namespaces, with faults on the links between them."""
import os
import pathlib
import subprocess
import sys
import time

import numpy as np
import pytest
from nodes import World, read_log

PERIOD = 50
STEPS, BEFORE = 160, 12
MEASURED = (85, 125)  # steps after healing whose errors are compared with those of the same steps without faults
FAULTS = {"loss": 0.2, "delay_ms": 5, "jitter_ms": 5, "duplicate": 0.1}
RERUN = pathlib.Path(__file__).resolve().parents[2] / "tools" / "rerun"


def settings(world, fabric, k, variant, epoch, **more):
    base = {"scenario": "net.json", "node": k, "real": "float32", "clock": {"period_ms": PERIOD, "epoch_s": epoch}, "readings": "-", "telemetry": f"{k}.cbor"}
    if variant == "multicast-ipv6":
        base["multicast"] = {"group": "[ff02::4d4b]:7000", "interface": "mesh0"}
    else:
        base["listen"] = "0.0.0.0:7000"
        base["peers"] = {str(j): f"{fabric.ipv4(j)}:7000" for j in world.neighbours[k]}
    return base | more


class Run:
    """All nodes of a world, started together some steps before its first one."""

    def __init__(self, bench, fabric, world, variant, **more):
        self.bench, self.fabric, self.world, self.variant, self.more = bench, fabric, world, variant, more
        bench.write("net.json", world.scenario)
        self.epoch = time.time() + BEFORE * PERIOD / 1000
        self.logs = {k: [] for k in range(world.nodes)}
        self.nodes = [self.start(k) for k in range(world.nodes)]

    def start(self, k, again=""):
        name = f"{k}{again}.cbor"
        self.logs[k].append(name)
        one = settings(self.world, self.fabric, k, self.variant, self.epoch, telemetry=name, state={"file": f"{k}.state", "every_s": 0.2}, **self.more)
        node = self.bench.start(k, one, self.fabric.command(k), again)
        node.feed(self.world.lines(k, 0, max(0, self.now())))
        return node

    def now(self):
        return int((time.time() - self.epoch) * 1000 // PERIOD)

    def wait(self, step):
        """Until a step of the world."""
        left = self.epoch + step * PERIOD / 1000 - time.time()
        assert left < 30
        time.sleep(max(0.0, left))

    def stop(self):
        reports = [node.stop() for node in self.nodes]
        return reports

    def errors(self, begin, end):
        """Norms of the error, (nodes, steps); NaN where a node was not there. Everything in the logs is finite."""
        out = np.full((self.world.nodes, end - begin), np.nan)
        for k, names in self.logs.items():
            for name in names:
                header, items, _ = read_log(self.bench.folder / name)
                assert header["estimator_nodes"] == [k]
                for t, item in items.items():
                    assert np.isfinite(item["estimate"]).all() and np.isfinite(item["trace_covariance"]).all()
                    if begin <= t < end:
                        out[k, t - begin] = np.linalg.norm(item["estimate"] - self.world.truth[t])
        return out


def rms(errors):
    return float(np.sqrt(np.nanmean(np.square(errors))))


def check_counters(reports, world):
    for k, report in enumerate(reports):
        assert report["datagrams received"] == sum(report.frames.values()), report.text
        assert report["frames sent"] > 0 and set(report.frames) <= {"MK_OK", "MK_ERROR_REPEATED", "MK_ERROR_LATE", "MK_ERROR_AHEAD", "MK_ERROR_STRANGER"}


@pytest.fixture(scope="module")
def quiet(program, fabric, draw, tmp_path_factory):
    """The no-fault run: its world, its reports and the errors of its last steps."""
    from nodes import Bench
    world = World(draw(10), STEPS)
    bench = Bench(program, tmp_path_factory.mktemp("quiet"))
    try:
        run = Run(bench, fabric, world, "unicast-ipv4", catch_up=1000)
        run.wait(128)
        reports = run.stop()
        return world, run, reports, run.errors(*MEASURED)
    finally:
        bench.close()


def write_arrivals(run, steps):
    """What the telemetry says was used, as meshkal simulate --arrivals and --measurements want it. A busy machine makes messages late."""
    world, place = run.world, run.bench.folder
    used, lines = set(), ["t,stage,from,to"]
    for k in range(world.nodes):
        _, items, _ = read_log(place / f"{k}.cbor")
        slots = [k, *world.neighbours[k]]
        for t, item in items.items():
            if not 0 <= t < steps:
                continue
            for stage, key in ((1, "measurements_arrived"), (2, "estimates_arrived")):
                lines += [f"{t},{stage},{j},{k}" for j, there in zip(slots[1:], item[key][1:]) if there]
            if item["measurements_arrived"][0]:
                used.add((t, k))
    (place / "arrivals.csv").write_text("\n".join(lines) + "\n")
    world.write_csv(place, used)


def test_the_network_is_the_simulator(quiet, program):
    world, run, reports, live = quiet
    place = run.bench.folder
    assert all(r["started again after long silence"] == 0 for r in reports)
    write_arrivals(run, MEASURED[1])
    subprocess.run([program, "simulate", place / "net.json", "--measurements", place / "y.csv", "--truth", place / "x.csv", "--arrivals", place / "arrivals.csv",
                    "--filter", "rkfdnu2", "--steps", str(MEASURED[1]), "--real", "float32", "--out", place / "simulated.cbor"], check=True, capture_output=True)
    _, items, _ = read_log(place / "simulated.cbor")
    simulated = np.array([items[t]["error"] for t in range(*MEASURED)]).T
    # The nodes started some steps before the simulator; by now both have forgotten how. Telemetry does not tell what a step that was made up for used.
    made_up = sum(r["made up for"] + r["left out"] for r in reports)
    print(f"\n{made_up} steps made up for or left out, RMS {rms(live):.4f}, simulated {rms(simulated):.4f}")
    if made_up == 0:
        np.testing.assert_allclose(live, simulated, rtol=1e-3, atol=1e-4)
    assert np.isfinite(live).mean() > 0.5 and rms(live) < 2 * rms(simulated) and rms(simulated) < 3 * rms(np.array(items[0]["error"]))
    check_counters(reports, world)


@pytest.mark.parametrize("variant", ["unicast-ipv4", "multicast-ipv6"])
def test_loss_restarts_partition(bench, fabric, quiet, variant):
    world, _, _, quiet_errors = quiet
    normal = rms(quiet_errors)
    run = Run(bench, fabric, world, variant)
    try:
        run.wait(5)
        fabric.control(**FAULTS)
        run.wait(25)
        for k in (2, 5, 8):
            run.nodes[k].kill()
        run.wait(32)
        for k in (2, 5, 8):
            run.nodes[k] = run.start(k, "-again")
        run.wait(45)
        fabric.control(**FAULTS, groups=[k % 2 for k in range(10)])
        run.wait(70)
        fabric.control(**FAULTS)
        run.wait(128)
        reports = run.stop()
        errors = run.errors(*MEASURED)
        assert (np.isfinite(errors).mean(axis=1) > 0.5).all(), errors  # a busy machine may keep a node from some of its steps
        assert rms(errors) < 3 * normal, f"{rms(errors)} against {normal} without faults"
        check_counters(reports, world)
        if variant == "unicast-ipv4":
            # The telemetry of all nodes, and of both lives of three, as one recording.
            logs = [bench.folder / name for names in run.logs.values() for name in names]
            done = subprocess.run([sys.executable, "-m", "meshkal_rerun", *logs, "-o", bench.folder / "all.rrd"], capture_output=True, text=True,
                                  env=os.environ | {"PYTHONPATH": str(RERUN)}, timeout=60)
            assert len(logs) == 13 and done.returncode == 0 and done.stderr.count("the log was cut") == 3, done.stderr
        print(f"\n{variant}: without faults {normal:.3f}, divided {rms(run.errors(45, 70)):.3f}, healed {rms(errors):.3f}, ratio {rms(errors) / normal:.2f}")
        print({name: sum(r.frames.get(name, 0) for r in reports) for name in {n for r in reports for n in r.frames}},
              {name: sum(r[name] for r in reports) for name in ("frames sent", "belated", "datagrams sent", "datagrams received", "steps done", "left out")})
    finally:
        fabric.control()
