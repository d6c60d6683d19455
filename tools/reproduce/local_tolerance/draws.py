# SPDX-License-Identifier: MIT
"""One random draw of the published experiment: the program's results as files, and these files as arrays."""

import json
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import seeds as by_seed
from program import Program, ReproduceError
from seeds import read_json

from . import networks

FILTERS = ("kfc", "rkfc", "kfd", "rkfdu", "rkfdnu", "rkfdnu2")
# Of what is shown step by step, and of the published reading: half way.
HORIZON = 200
# Weakly connected nodes need hundreds of steps to forget how they began: steady values are read half way through the first of these
# horizons in which they stand still.
STEADY_HORIZONS = (800, 2400, 4800)
# Stands for the paper's second example. The least favourable model exists for it on all draws.
LARGER_TOLERANCE = 0.1
# Mean number of neighbours, the node itself included. The first is the draw itself.
DENSITIES = (5, 8, 12)


def compute(program: Program, out: Path, seeds: range, jobs: int) -> None:
    by_seed.compute(out, seeds, jobs, lambda folder, seed: _run(program, folder, seed))


def _run(program: Program, folder: Path, seed: int) -> None:
    scenario = folder / "scenario.json"
    scenario.write_text(program("scenario", "projectile", "--seed", seed, "--density", DENSITIES[0]))
    drawn = json.loads(scenario.read_text())

    program("design", scenario, "--c-max", "none", "--per-step", HORIZON + 1, "--json", folder / "design.json")
    _analyze(program, scenario, folder / "over-time.json", HORIZON, "all", "--per-step")
    _steady(program, scenario, folder / "least-favourable.json", "all")
    _steady(program, scenario, folder / "nominal.json", "all", "--truth", "nominal")
    _steady(program, scenario, folder / "larger-tolerance.json", "all", "--tolerance", LARGER_TOLERANCE)
    for name, network in [(f"density-{d}", networks.denser(drawn, d)) for d in DENSITIES[1:]] + [("complete", networks.complete(drawn))]:
        source = folder / f"{name}-scenario.json"
        source.write_text(json.dumps(network))
        _steady(program, source, folder / f"{name}.json", "rkfdnu")
    # What is sent does not depend on the step, so one is enough.
    program("simulate", scenario, "--filter", "all", "--steps", 1, "--json", folder / "communication.json")


def _analyze(program: Program, source: Path, result: Path, horizon: int, filters: str, *options: object) -> None:
    program("analyze", source, "--filter", filters, "--horizon", horizon, "--threads", 1, "--json", result, *options)


def _steady(program: Program, source: Path, result: Path, filters: str, *options: object) -> None:
    """Leaves the last result there, steady or not: reading it decides."""
    for horizon in STEADY_HORIZONS:
        _analyze(program, source, result, horizon, filters, *options)
        found = json.loads(result.read_text())
        if all(item["steady"] for item in found.get("filters", [found])):
            return


@dataclass(frozen=True)
class Analysis:
    """One filter under one truth in steady state, but for `msd`, which is over time. `node_` arrays have one number a node."""

    horizon: int
    msd: np.ndarray
    msd_db: float
    position_msd_db: float
    node_msd: np.ndarray
    node_tolerance: np.ndarray
    node_theta: np.ndarray
    mean_tolerance: float
    mean_theta: float


@dataclass(frozen=True)
class OverTime:
    """One filter under the least favourable model of HORIZON steps: MSD (step), tolerance and theta (step x node)."""

    msd: np.ndarray
    tolerance: np.ndarray
    theta: np.ndarray


@dataclass(frozen=True)
class Draw:
    seed: int
    scenario: dict
    design: dict
    over_time: dict[str, OverTime]
    least_favourable: dict[str, Analysis]
    nominal: dict[str, Analysis]
    larger: dict[str, Analysis]
    # RKFDNU and its scenario, by density; the first is the draw itself.
    densities: dict[int, tuple[dict, Analysis]]
    complete: Analysis
    communication: dict[str, dict]

    @property
    def tolerance(self) -> float:
        return self.scenario["tolerance"]

    @property
    def design_tolerances(self) -> np.ndarray:
        """c_k at the fixed point of RKFC."""
        return np.array([node["tolerance"] for node in self.design["nodes"]])


def load(out: Path, seeds: range) -> tuple[list[Draw], dict[int, str]]:
    """The draws, and for each seed that has none, why."""
    return by_seed.load(out, seeds, _load)


def _load(folder: Path, seed: int) -> Draw:
    def read(name: str) -> dict:
        return read_json(folder / f"{name}.json")

    def by_filter(name: str) -> dict[str, dict]:
        return {item["filter"]: item for item in read(name)["filters"]}

    def steady(name: str) -> dict[str, Analysis]:
        found = by_filter(name)
        return {f: _analysis(found[f], name) for f in FILTERS}

    scenario, least_favourable, over_time = read("scenario"), steady("least-favourable"), by_filter("over-time")
    densities = {DENSITIES[0]: (scenario, least_favourable["rkfdnu"])}
    for density in DENSITIES[1:]:
        name = f"density-{density}"
        densities[density] = read(f"{name}-scenario"), _analysis(read(name), name)
    return Draw(
        seed=seed,
        scenario=scenario,
        design=read("design"),
        over_time={f: _over_time(over_time[f]) for f in FILTERS},
        least_favourable=least_favourable,
        nominal=steady("nominal"),
        larger=steady("larger-tolerance"),
        densities=densities,
        complete=_analysis(read("complete"), "complete"),
        communication=by_filter("communication"),
    )


def _analysis(item: dict, name: str) -> Analysis:
    if not item["steady"] or item["msd_db"] is None or not math.isfinite(item["msd_db"]):
        raise ReproduceError(f"{name}: {item['filter']} is not steady half way through a horizon of {item['horizon']} steps")

    return Analysis(
        horizon=item["horizon"],
        msd=np.array(item["msd"]),
        msd_db=item["msd_db"],
        position_msd_db=item["position_msd_db"],
        node_msd=np.array(item["node_msd"]),
        node_tolerance=np.array(item["node_tolerance"]),
        node_theta=np.array(item["node_theta"]),
        mean_tolerance=item["mean_tolerance"],
        mean_theta=item["mean_theta"],
    )


def _over_time(item: dict) -> OverTime:
    return OverTime(*(np.array(item[key]) for key in ("msd", "tolerance_over_time", "theta_over_time")))
