#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Integrity monitors on the projectile network: their false alarms, the law of their statistics, and a ramp on one sensor.

README.md beside this file says what the numbers show.
"""

import argparse
import json
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
from meshkal_log.reader import LogReader
from scipy import stats

NODES, SEED = 16, 1           # a monitor takes 32 rows: the largest network of which a centre can watch all
FILTERS = ("kfc", "kfd", "rkfdnu2")
SCHEMES = ("rctm", "aime", "aime-improved", "exclude")
NODE, ROW = 4, 0              # the sensor with the ramp: noise of 1.06 m, the best of five that its node hears
FROM_S, TO_S, END_S = 20.0, 40.0, 60.0
SETTLED = 200
RUN_STEPS = 2500              # of a run that counts false alarms


class StudyError(Exception):
    """Something the user can put right. One line."""


class Study:
    def __init__(self, program: Path, out: Path) -> None:
        self.program, self.out = program.resolve(), out
        if not self.program.is_file():
            raise StudyError(f"no program at {program}: run make all, or give --meshkal")
        out.mkdir(parents=True, exist_ok=True)
        self.scenario = json.loads(self.run("scenario", "projectile", "--nodes", NODES, "--seed", SEED))
        self.network = self.write("network", self.scenario)

    def run(self, *arguments: object) -> str:
        words = [str(a) for a in arguments]
        done = subprocess.run([str(self.program), *words], capture_output=True, text=True, check=False)
        if done.returncode != 0:
            raise StudyError(f"meshkal {' '.join(words)}: {done.stderr.strip()}")
        return done.stdout

    def write(self, name: str, scenario: dict) -> Path:
        path = self.out / f"{name}.json"
        path.write_text(json.dumps(scenario, indent=1))
        return path

    def ramp(self, rate: float) -> Path:
        fault = {"node": NODE, "row": ROW, "from_s": FROM_S, "to_s": TO_S, "rate": rate}
        return self.write(f"ramp-{rate:g}", {**self.scenario, "faults": [fault]})

    def simulate(self, scenario: Path, *options: object) -> dict:
        path = self.out / "summary.json"
        self.run("simulate", scenario, *options, "--json", path)
        return json.loads(path.read_text())["filters"][0]

    def log(self, keys: list[str], *options: object) -> list[np.ndarray]:
        """Quantities of a run, steps first, once it has settled."""
        path = self.out / "law.cbor"
        self.run("simulate", self.network, *options, "--out", path)
        with path.open("rb") as stream:
            batches = list(LogReader(stream).batches(0))
        path.unlink()
        return [np.concatenate([getattr(batch, key) for batch in batches])[SETTLED:] for key in keys]


def law(study: Study, steps: int) -> list[dict]:
    """How far the statistics are from chi-square: mean over degrees, and the distance of Kolmogorov and Smirnov."""
    table = []
    for name in FILTERS:
        keys = [f"monitor_{statistic}{of}" for statistic in ("rctm", "aime") for of in ("", "_rows")]
        found = study.log(keys, "--filter", name, "--steps", steps, "--monitor", "aime")
        for (statistic, apart), q, rows in zip((("rctm", 1), ("aime", 10)), found[::2], found[1::2], strict=True):
            upper = stats.chi2.sf(q, rows)[::apart]  # epochs without common window
            distance = [stats.kstest(node, "uniform") for node in upper.T]
            table.append({"filter": name, "statistic": statistic, "ratio": (q.mean(0) / rows.mean(0)).tolist(),
                          "distance": [d.statistic for d in distance], "p": [d.pvalue for d in distance],
                          "tails": {f"{tail:g}": float((stats.chi2.sf(q, rows) < tail).mean()) for tail in (1e-1, 1e-2, 1e-3)}})
    return table


def false_alarms(study: Study, node_steps: float) -> list[dict]:
    table = []
    for name in FILTERS:
        for scheme, rate, most in (("rctm", 1e-4, 1), ("aime", 1e-4, 1), ("exclude", 1e-4, 1), ("rctm", 1e-6, 4), ("aime", 1e-6, 4)):
            # A centre makes one node-step a step.
            wanted = node_steps * (most if name != "kfc" else 1)
            runs = math.ceil(wanted / RUN_STEPS / (1 if name == "kfc" else NODES))
            found = study.simulate(study.network, "--filter", name, "--steps", RUN_STEPS, "--runs", runs, "--monitor", scheme, "--false-alarm", rate)
            table.append({"filter": name, "scheme": scheme, "configured": rate, **found["monitor"]})
    return table


def span(found: dict) -> slice:
    dt = 0.1
    return slice(round(found[0] / dt) + 1, round(found[1] / dt) + 1)


def decibel(value: float) -> float:
    return 10.0 * math.log10(value)


def ramps(study: Study, rates: list[float], runs: int) -> list[dict]:
    steps = round(END_S / study.scenario["model"]["dt_s"])
    table = []
    for name in FILTERS:
        common = ("--filter", name, "--steps", steps, "--runs", runs)
        calm = study.simulate(study.network, *common)["msd_over_time"]
        for rate in rates:
            path = study.ramp(rate)
            row = {"filter": name, "rate": rate, "schemes": {},
                   "calm": {phase: decibel(np.mean(calm[span(ends)])) for phase, ends in (("during", (FROM_S, TO_S)), ("after", (TO_S, END_S)))},
                   "faulty": study.simulate(path, *common)["phase_msd"]}
            for scheme in SCHEMES:
                found = study.simulate(path, *common, "--monitor", scheme, "--false-alarm", 1e-6)
                row["schemes"][scheme] = {**found["monitor"]["faults"][0], "phase_msd": found["phase_msd"], "wrong": found["monitor"]["wrong_exclusions"]}
            table.append(row)
    return table


# --- tables ------------------------------------------------------------------------------------------------------------------


def median(values: list[float | None]) -> str:
    value = float(np.median([math.inf if v is None else v for v in values]))
    return f"{value:.1f}" if math.isfinite(value) else "never"


def law_table(rows: list[dict]) -> str:
    lines = ["| filter | statistic | mean over degrees of freedom, nodes | distance from chi-square (KS), nodes | share above the 0.1, 0.01, 0.001 quantile |",
             "|---|---|---|---|---|"]
    for r in rows:
        tails = ", ".join(f"{share:.3g}" for share in r["tails"].values())
        ratio, distance = r["ratio"], r["distance"]
        if len(ratio) == 1:
            between = f"{ratio[0]:.3f} | {distance[0]:.3f} (p {r['p'][0]:.2f})"
        else:
            between = f"{min(ratio):.3f} to {max(ratio):.3f} | {min(distance):.3f} to {max(distance):.3f}"
        lines.append(f"| {r['filter']} | {r['statistic']} | {between} | {tails} |")
    return "\n".join(lines)


def false_table(rows: list[dict]) -> str:
    lines = ["| filter | monitor | configured | node-steps | in alarm | rate, 95 % interval | begun | good sensors excluded |", "|---|---|---|---|---|---|---|---|"]
    for r in rows:
        low, high = r["false_alarm_rate_ci95"]
        lines.append(f"| {r['filter']} | {r['scheme']} | {r['configured']:g} | {r['clean_node_steps']:.3g} | {r['false_alarm_node_steps']:.0f} | "
                     f"{r['false_alarm_rate']:.2g}, {low:.2g} to {high:.2g} | {r['false_alarms_begun']:.0f} | "
                     f"{r['mistaken_exclusions']:.0f} |")
    return "\n".join(lines)


def time_table(rows: list[dict]) -> str:
    lines = ["| filter | rate, m/s | monitor | alarm: first, median node, s | isolated: first, median node, s | nodes that isolate | "
             "end: first, median node, s | ends found | early | others excluded |", "|---|---|---|---|---|---|---|---|---|---|"]
    for r in rows:
        for scheme, f in r["schemes"].items():
            ended = f["ended"]
            ends = f"{median(ended['first_s'])}, {median(ended['median_s'])} | {ended['estimators'] / ended['of']:.3f} | {f['early_ends']:.0f}" \
                if ended["of"] else "| |"
            lines.append(f"| {r['filter']} | {r['rate']:g} | {scheme} | {median(f['alarm']['first_s'])}, {median(f['alarm']['median_s'])} | "
                         f"{median(f['isolated']['first_s'])}, {median(f['isolated']['median_s'])} | "
                         f"{f['isolated']['estimators'] / f['isolated']['of']:.3f} | {ends} | {f['wrong']:.0f} |")
    return "\n".join(lines)


def error_table(rows: list[dict]) -> str:
    lines = ["| filter | rate, m/s | before | during: no fault | fault, no monitor | fault, exclude | after: no fault | fault, no monitor | fault, exclude |",
             "|---|---|---|---|---|---|---|---|---|"]
    for r in rows:
        bare, held = r["faulty"], r["schemes"]["exclude"]["phase_msd"]
        cells = [decibel(bare["before"][0])]
        for phase in ("during", "after"):
            cells += [r["calm"][phase], decibel(bare[phase][0]), decibel(held[phase][0])]
        lines.append(f"| {r['filter']} | {r['rate']:g} | " + " | ".join(f"{c:.2f}" for c in cells) + " |")
    return "\n".join(lines)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--meshkal", type=Path, default=Path("build/meshkal"))
    parser.add_argument("--out", type=Path, default=Path("build/network-monitor"))
    parser.add_argument("--law-steps", type=int, default=20000, help="of the run whose statistics are compared with chi-square")
    parser.add_argument("--node-steps", type=float, default=1e6, help="for each rate of false alarms; four times that for the small one")
    parser.add_argument("--runs", type=int, default=100, help="of each ramp")
    parser.add_argument("--rates", type=float, nargs="+", default=[0.1, 0.2, 0.5], help="of the ramp, metres a second")
    a = parser.parse_args()
    try:
        study = Study(a.meshkal, a.out)
        results = {"law": law(study, a.law_steps), "false_alarms": false_alarms(study, a.node_steps), "ramps": ramps(study, a.rates, a.runs)}
    except StudyError as error:
        print(f"study: {error}", file=sys.stderr)
        return 1
    text = "\n\n".join(("Statistics without fault", law_table(results["law"]), "False alarms", false_table(results["false_alarms"]),
                        f"Ramp on node {NODE} from {FROM_S:g} to {TO_S:g} s, {a.runs} runs, false alarm 1e-6, window 10", time_table(results["ramps"]),
                        "Mean squared deviation, dB", error_table(results["ramps"]))) + "\n"
    (a.out / "tables.md").write_text(text)
    (a.out / "results.json").write_text(json.dumps(results, indent=1))
    (a.out / "summary.json").unlink()
    print(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
