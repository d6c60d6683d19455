# SPDX-License-Identifier: MIT
"""A batch of Monte Carlo runs of the experiment: the program's results as files, and these as numbers."""

import copy
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import seeds as by_seed
from run_logs import over_time
from program import Program, ReproduceError
from seeds import read_json
from tracking import settings, summary

from .graphs import GRAPHS, iterate

RUNS, FROM_STEP = 50, 21
NODES = 3
COMPLETE = [[0, 1], [1, 2], [0, 2]]
PROTOCOLS = ("paper", "perron", "metropolis", "ratio")
# On three nodes nothing is left to agree on after so many.
MANY = 100
WATCHED = 40
# The first is shown, the others beside it.
RECORDED = ("duif", "ukf", "kcf", "rekfd")


@dataclass(frozen=True)
class Variant:
    protocol: str = "metropolis"
    iterations: int = 10
    range_m: float | None = None
    complete: bool = False
    filter: str = "duif"
    information: str = "residual"
    loss: float = 0.0

    def scenario(self, base: dict) -> dict:
        made = copy.deepcopy(base)
        settings(consensus={"protocol": self.protocol, "iterations": self.iterations, "information": self.information})(made)
        if self.range_m:
            for node in made["nodes"]:
                node["range_limit_m"] = self.range_m
        if self.complete:
            made["edges"] = COMPLETE
        return made


def _central(**settings: object) -> Variant:
    """Metropolis weights of a complete graph are all 1 / N: one iteration is the average, and every node the centralised filter."""
    return Variant(iterations=1, complete=True, **settings)


SWEEP = {"paper": (1, 2, 3, 5, 10), "perron": (1, 2, 3, 5, 10), "metropolis": (1, 2, 3, 5, 10, 20, 50), "ratio": (1, 2, 3, 5, 10)}
LOSS = 0.2
VARIANTS = {
    "all, centralised": _central(),
    **{f"all, {p}, {steps}": Variant(p, steps) for p, sweep in SWEEP.items() for steps in sweep},
    "all, ukf": Variant(filter="ukf"),
    "all, kcf": Variant(filter="kcf"),
    "all, rekfd": Variant(filter="rekfd"),
    "alone": Variant(iterations=0),
    "all, centralised, information as published": _central(information="paper"),
    "all, metropolis, 10, information as published": Variant(information="paper"),
    **{f"all, {p}, 10, loss": Variant(p, loss=LOSS) for p in ("paper", "metropolis", "ratio")},
    "100 m, centralised": _central(range_m=100.0),
    "100 m, paper, 10": Variant("paper", range_m=100.0),
    "100 m, metropolis, 10": Variant(range_m=100.0),
    "100 m, ratio, 10": Variant("ratio", range_m=100.0),
    "85 m, centralised": _central(range_m=85.0),
    **{f"85 m, paper, {steps}": Variant("paper", steps, range_m=85.0) for steps in (1, 3, 10)},
}


@dataclass(frozen=True)
class Batch:
    """of: summaries by variant. estimates: of one run on the same measurements, steps x nodes x states, by what it shows.
    disagreement: of the consensus of one run, steps x iterations, by protocol. graphs: values at the nodes over the iterations."""

    seed: int
    of: dict[str, dict]
    design: dict
    estimates: dict[str, np.ndarray]
    disagreement: dict[str, np.ndarray]
    graphs: dict[str, np.ndarray]

    def eigenvalue(self, protocol: str) -> float:
        """Second largest modulus, as `design` says. The scales of `perron` leave the weights of `paper` as they are."""
        wanted = {"weights": "paper" if protocol == "perron" else protocol}
        if wanted["weights"] == "paper":
            wanted["measuring"] = "all"
        return next(c["second_eigenvalue"] for c in self.design["consensus"]["cases"] if all(c.get(k) == v for k, v in wanted.items()))


def compute(program: Program, out: Path, seeds: range, jobs: int) -> None:
    by_seed.compute(out, seeds, jobs, lambda folder, seed: _run(program, folder, seed))


def _run(program: Program, folder: Path, seed: int) -> None:
    base = json.loads(program("scenario", "distributed-unscented"))

    def written(name: str, scenario: dict) -> Path:
        file = folder / f"{name}-scenario.json"
        file.write_text(json.dumps(scenario, indent=1))
        return file

    original = written("published", base)
    program("design", original, "--json", folder / "design.json")
    for name, variant in VARIANTS.items():
        file = written(_file(name), variant.scenario(base))
        options = ("--runs", RUNS, "--seed", seed, "--from-step", FROM_STEP, "--loss", variant.loss, "--threads", 1)
        program("simulate", file, "--filter", variant.filter, *options, "--json", folder / f"{_file(name)}.json")
    for f in RECORDED:
        program("simulate", original, "--filter", f, "--seed", seed, "--out", folder / f"{f}.cbor")
    for protocol in PROTOCOLS:
        file = written(f"watched-{protocol}", Variant(protocol, WATCHED).scenario(base))
        program("simulate", file, "--filter", "duif", "--seed", seed, "--out", folder / f"watched-{protocol}.cbor")
    _limits(program, folder, seed, base, original, written)
    generator = np.random.default_rng(seed)
    values = {graph.title: iterate(program, graph, generator.standard_normal(len(graph.hears))).tolist() for graph in GRAPHS}
    (folder / "graphs.json").write_text(json.dumps(values))


LIMITS = {
    "centralised": _central(),
    "metropolis": Variant("metropolis", MANY),
    "perron": Variant("perron", MANY),
    "ratio": Variant("ratio", MANY),
    "paper": Variant("paper", MANY, information="paper"),
    "centralised, information as published": _central(information="paper"),
    "Perron mean": _central(information="paper"),
}


def _limits(program: Program, folder: Path, seed: int, base: dict, original: Path, written) -> None:  # noqa: ANN001
    """Estimates of one run on the same measurements. With information as published, I = H' R^-1 H, a node whose R is divided by N pi counts
    N pi times: the centralised filter that hears these is the Perron mean of the paper's protocol."""
    data = folder / "measurements.csv"
    program("draw", original, "--seed", seed, "--measurements", data)
    for name, variant in LIMITS.items():
        scenario = variant.scenario(base)
        if name == "Perron mean":
            for node, weight in zip(scenario["nodes"], perron_weights(base)):
                node["R"] = [[node["R"][0][0] / (NODES * weight)]]
        log = folder / f"limit-{_file(name)}.cbor"
        program("simulate", written(f"limit-{_file(name)}", scenario), "--filter", "duif", "--measurements", data, "--out", log)


def perron_weights(scenario: dict) -> np.ndarray:
    """(deg + g) / sum, all nodes measuring."""
    degree = np.array([sum(k in edge for edge in scenario["edges"]) for k in range(len(scenario["nodes"]))])
    return (degree + 1.0) / (degree + 1.0).sum()


def _file(variant: str) -> str:
    return variant.replace(", ", "-").replace(" ", "-")


def load(out: Path, seeds: range) -> tuple[list[Batch], dict[int, str]]:
    return by_seed.load(out, seeds, _load)


def _load(folder: Path, seed: int) -> Batch:
    of = {name: summary(folder / f"{_file(name)}.json")[variant.filter] for name, variant in VARIANTS.items()}
    for name, item in of.items():
        if item["runs_done"] != RUNS:
            raise ReproduceError(f"{name}: made {item['runs_done']} of {RUNS} runs")
    values = read_json(folder / "graphs.json")
    return Batch(
        seed=seed,
        of=of,
        design=read_json(folder / "design.json"),
        estimates={name: over_time(folder / f"limit-{_file(name)}.cbor", "estimate") for name in LIMITS},
        disagreement={p: over_time(folder / f"watched-{p}.cbor", "consensus_disagreement") for p in PROTOCOLS},
        graphs={graph.title: np.array(values[graph.title]) for graph in GRAPHS},
    )
