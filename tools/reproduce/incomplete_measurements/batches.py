# SPDX-License-Identifier: MIT
"""A batch of Monte Carlo runs of the published experiment and of its variants: the program's results as files, and these as numbers."""

import copy
import json
from dataclasses import dataclass
from pathlib import Path

import seeds as by_seed
from program import Program, ReproduceError
from tracking import Change, settings, summary

RUNS = 60
FILTERS = ("ekf", "ukf", "iukf", "iukf-literal", "pukf", "mpukf")
# A run whose error is larger at its end has lost the target: six times the RMSE.
LOST_M = 0.5
TIMED = ("iukf-literal", "pukf", "mpukf")
# The first is shown, the others beside it.
RECORDED = ("mpukf", "pukf", "iukf-literal")
# The fastest of so many counts, and short ones: the machine does other things too.
TIMINGS, TIMED_RUNS = 8, 15
PATIENCE = 5
TIGHT = 0.05


def _all_filters(scenario: dict) -> None:
    scenario["tracking"]["gate"]["filters"] = list(FILTERS)


def _no_faults(scenario: dict) -> None:
    for node in scenario["nodes"]:
        node.pop("fault", None)


def _together(*changes: Change) -> Change:
    def apply(scenario: dict) -> None:
        for change in changes:
            change(scenario)

    return apply


_PER_SENSOR = {"sensor": True, "stacked": False}
# What is done with readings beyond the gate of MPUKF.
POLICIES = {
    "skip": settings(),
    "inflate": settings(gate={"policy": "inflate"}),
    "per sensor": settings(gate=_PER_SENSOR),
    "per sensor, inflate": settings(gate=_PER_SENSOR | {"policy": "inflate"}),
    "per sensor, then stacked": settings(gate={"sensor": True, "stacked": True}),
    "re-initialise": settings(gate={"patience": PATIENCE}),
}
_TIGHT = _together(_no_faults, settings(gate={"significance": TIGHT}))
VARIANTS: dict[str, tuple[Change, tuple[str, ...]]] = {
    "published": (settings(), FILTERS),
    "one gate": (_all_filters, FILTERS),
    "no gate": (settings(gate=None), FILTERS),
    "own model": (_together(_no_faults, settings(gate=None)), FILTERS),
    "own model, gate": (_together(_no_faults, _all_filters), FILTERS),
    "no rule": (settings(rule="none"), ("mpukf",)),
    "mahalanobis": (settings(rule="mahalanobis"), ("mpukf",)),
    "mahalanobis, no gate": (settings(rule="mahalanobis", gate=None), ("mpukf",)),
    **{f"policy: {name}": (change, ("mpukf",)) for name, change in POLICIES.items() if name != "skip"},
    **{f"tight: {name}": (_together(_TIGHT, change), ("mpukf",)) for name, change in POLICIES.items()},
}


@dataclass(frozen=True)
class Batch:
    """Summaries of the filters by variant, and nanoseconds a step."""

    seed: int
    of: dict[str, dict[str, dict]]
    ns: dict[str, float]

    def policy(self, name: str, *, tight: bool) -> dict:
        key = f"tight: {name}" if tight else f"policy: {name}" if name != "skip" else "published"
        return self.of[key]["mpukf"]


def compute(program: Program, out: Path, seeds: range, jobs: int) -> None:
    by_seed.compute(out, seeds, jobs, lambda folder, seed: _run(program, folder, seed))
    # One at a time, so that the filters are timed alike.
    for seed in seeds:
        folder = by_seed.folder_of(out, seed)
        if not (folder / "error.txt").exists():
            try:
                _time(program, folder, seed)
            except ReproduceError as error:
                (folder / "error.txt").write_text(f"{error}\n")


def _run(program: Program, folder: Path, seed: int) -> None:
    base = json.loads(program("scenario", "incomplete-measurements"))
    for name, (change, filters) in VARIANTS.items():
        scenario = copy.deepcopy(base)
        change(scenario)
        file = folder / f"{_file(name)}-scenario.json"
        file.write_text(json.dumps(scenario, indent=1))
        for f in filters:
            _simulate(program, file, folder / f"{_file(name)}-{f}.json", f, seed)
    for f in RECORDED:
        program("simulate", folder / "published-scenario.json", "--filter", f, "--seed", seed, "--out", folder / f"{f}.cbor")


def _simulate(program: Program, scenario: Path, result: Path, name: str, seed: int, runs: int = RUNS) -> None:
    options = ("--runs", runs, "--seed", seed, "--threads", 1, "--lost-m", LOST_M)
    program("simulate", scenario, "--filter", name, *options, "--json", result)


def _time(program: Program, folder: Path, seed: int) -> None:
    least = dict.fromkeys(TIMED, float("inf"))
    for _ in range(TIMINGS):
        for name in TIMED:
            result = folder / "time.json"
            _simulate(program, folder / "published-scenario.json", result, name, seed, TIMED_RUNS)
            least[name] = min(least[name], summary(result)[name]["ns_per_step"])
    (folder / "time.json").write_text(json.dumps(least))


def _file(variant: str) -> str:
    return variant.replace(": ", "-").replace(", ", "-").replace(" ", "-")


def load(out: Path, seeds: range) -> tuple[list[Batch], dict[int, str]]:
    return by_seed.load(out, seeds, _load)


def _load(folder: Path, seed: int) -> Batch:
    of: dict[str, dict[str, dict]] = {}
    for name, (_, filters) in VARIANTS.items():
        of[name] = {f: summary(folder / f"{_file(name)}-{f}.json")[f] for f in filters}
        for f, item in of[name].items():
            if item["runs_done"] != RUNS:
                raise ReproduceError(f"{name}: {f} made {item['runs_done']} of {RUNS} runs")
    return Batch(seed, of, {f: float(ns) for f, ns in by_seed.read_json(folder / "time.json").items()})
