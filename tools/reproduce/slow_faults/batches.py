# SPDX-License-Identifier: MIT
"""Runs of the published experiment: the program's logs, and of these what monitors decided, run by run.

All runs of a case have the first seed, so that all schemes see the same noise. Draws of the command are so many times RUNS_A_DRAW runs.
"""

import copy
import json
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import seeds as by_seed
from program import Program
from run_logs import every_run
from seeds import read_json

from . import clairvoyant, published

# Runs for each draw asked for: 30 draws are 210 runs.
RUNS_A_DRAW = 7
SATELLITE = 0
BEGIN_S = 150
# Samples of the inertial unit a second; the scenario's 100 give the same numbers and take twice as long.
IMU_HZ = 20
RATES = (0.10, 0.15, 0.25)
FAULTS = ((0.10, 299), (0.15, 299), (0.25, 299), (0.15, 250), (0.15, 280))
NEAR = clairvoyant.NEAR
# Epochs after the fault in which alarms are counted.
AFTER = 60
# The published rule's eta, and the evidence that ours asks for.
ETA = 20.0
ETAS = (3.0, 5.0, 7.0, 10.0, 14.0, ETA, 28.0, 40.0, 60.0, 100.0)
EVIDENCE = (2.0, 4.0, 7.0, 18.0)
NEVER = 1e30
_KEYS = ("monitor_alarm", "monitor_ended", "monitor_aime", "monitor_threshold", "monitor_rho", "monitor_median")
_KEYS += ("excluded", "end_ratio", "innovation", "error")
QUANTILES = (0.05, 0.5, 0.95)

Fault = tuple[float, int]  # rate, m/s; last second


@dataclass(frozen=True)
class Case:
    scheme: str  # filter
    monitor: str
    fault: Fault
    settings: tuple[tuple[str, float], ...] = ()

    @property
    def file(self) -> str:
        rate, last = self.fault
        return "-".join([self.scheme, self.monitor, f"{rate:.2f}", str(last), *(f"{key}-{value:g}" for key, value in self.settings)])

    def scenario(self, base: dict) -> dict:
        rate, last = self.fault
        scenario = copy.deepcopy(base)
        scenario["model"]["navigation"]["imu_hz"] = IMU_HZ
        scenario["faults"] = [{"node": SATELLITE, "from_s": BEGIN_S, "to_s": last, "rate": rate}]
        scenario["monitor"] = scenario.get("monitor", {}) | dict(self.settings)
        return scenario


def plain(scheme: str, fault: Fault) -> Case:
    """A published scheme: filter, and its monitor."""
    return Case(scheme, "aime-improved" if scheme == "rekf-t" else "aime", fault)


def unending(fault: Fault) -> Case:
    """The published rule with an eta that nothing exceeds: the ratio goes on as it would until any rule's first decision."""
    return Case("rekf-t", "aime-improved", fault, (("jump", NEVER),))


def ours(fault: Fault, evidence: float | None = None) -> Case:
    return Case("rekf-t", "exclude", fault, () if evidence is None else (("evidence", evidence),))


# One run for the viewer: the first is shown, the others beside it.
RECORDED = {"ours": ours((0.15, 299)), "published": plain("rekf-t", (0.15, 299)), "ekf": plain("ekf", (0.15, 299))}
CASES = [plain(scheme, (rate, 299)) for scheme in published.SCHEMES for rate in RATES] + [
    case for fault in FAULTS for case in (plain("rekf-t", fault), unending(fault), ours(fault), *(ours(fault, e) for e in EVIDENCE))
]
CASES = list(dict.fromkeys(CASES))


@dataclass(frozen=True)
class Watched:
    """What a monitor said of the runs of a case; times in s, NaN where there is none."""

    alarm: np.ndarray  # the first one after the fault's begin
    false: np.ndarray  # epochs with an alarm before it
    wrong: np.ndarray  # 1: another satellite was held faulty
    end: np.ndarray  # of the fault, as first declared after this alarm
    after: np.ndarray  # alarms in the AFTER epochs that follow the fault
    ends: dict[float, np.ndarray]  # the same by eta
    threshold: float
    # Over time: QUANTILES of the runs, and the first run.
    statistic: np.ndarray
    innovation: np.ndarray
    mean_innovation: np.ndarray
    position_m: float  # RMS of the position's error while the fault is on
    one: dict[str, np.ndarray]

    def offset(self, last: int, eta: float | None = None) -> np.ndarray:
        """Of the declared end from the first epoch without fault."""
        return (self.end if eta is None else self.ends[eta]) - (last + 1)


@dataclass(frozen=True)
class Shares:
    """Of runs: declared more than NEAR epochs early, within NEAR epochs, in the first epoch without fault."""

    runs: int
    early: int
    near: int
    exact: int

    @property
    def rest(self) -> int:
        return self.runs - self.early - self.near


def shares(offset: np.ndarray) -> Shares:
    return Shares(len(offset), *(int(np.sum(part)) for part in (offset < -NEAR, np.abs(offset) <= NEAR, offset == 0)))


@dataclass(frozen=True)
class Limit:
    """Of a fault, what the clairvoyant test reaches by threshold, and the bound by share of early ends."""

    known: clairvoyant.Known
    first_free: int
    reached: tuple[np.ndarray, np.ndarray, np.ndarray]

    @property
    def distances(self) -> tuple[float, float]:
        """After one epoch without fault, and after as many as a hit may take."""
        return tuple(clairvoyant.distance(self.known, self.first_free, epochs) for epochs in (1, 1 + NEAR))

    def bound(self, early: np.ndarray, *, exact: bool) -> np.ndarray:
        return clairvoyant.bound(self.known, self.first_free, early, exact=exact)


@dataclass(frozen=True)
class Batch:
    seed: int
    runs: int
    of: dict[Case, Watched]
    limit: dict[Fault, Limit]
    fault: dict[Fault, np.ndarray]  # true, over time

    def declared(self, case: Case, eta: float | None = None) -> Shares:
        return shares(self.of[case].offset(case.fault[1], eta))


def compute(program: Program, out: Path, seeds: range, jobs: int) -> None:
    by_seed.compute(out, seeds[:1], 1, lambda folder, seed: _run(program, folder, seed, RUNS_A_DRAW * len(seeds), jobs))


def _run(program: Program, folder: Path, seed: int, runs: int, jobs: int) -> None:
    base = json.loads(program("scenario", "gnss-ins"))
    (folder / "scenario.json").write_text(json.dumps(base, indent=1))

    def one(case: Case) -> None:
        file = folder / f"{case.file}-scenario.json"
        file.write_text(json.dumps(case.scenario(base), indent=1))
        options = ("--filter", case.scheme, "--monitor", case.monitor, "--runs", runs, "--seed", seed, "--threads", 1, "--out", "-")
        log = program.reading(lambda stream: every_run(stream, _KEYS), "simulate", file, *options)
        (folder / f"{case.file}.json").write_text(json.dumps(_plain(measure(case, log))))

    with ThreadPoolExecutor(jobs) as pool:
        list(pool.map(one, CASES))
    for name, case in RECORDED.items():
        options = ("--filter", case.scheme, "--monitor", case.monitor, "--seed", seed)
        program("simulate", folder / f"{case.file}-scenario.json", *options, "--out", folder / f"{name}.cbor")


def measure(case: Case, log: dict[str, np.ndarray]) -> Watched:
    """Of the log's arrays (runs, epochs, length); epoch t is the t-th, at t s."""
    _, last = case.fault
    excluding = case.monitor == "exclude"
    alarm = log["monitor_alarm"][:, :, 0] > 0
    held = log["excluded"] > 0
    t = np.arange(1, alarm.shape[1] + 1)
    seen = held[:, :, SATELLITE] if excluding else alarm
    first = _first(seen & (t > BEGIN_S), t)
    later = t > first[:, None]
    over = ~held[:, :, SATELLITE] if excluding else log["monitor_ended"][:, :, 0] > 0
    ends = {}
    if case == unending(case.fault):
        excess = log["monitor_rho"][:, :, 0] - log["monitor_median"][:, :, 0]
        since = _since(alarm)
        ends = {eta: _first((since >= 2) & (excess > eta) & later, t) for eta in ETAS}
    # 0 while the window is empty.
    statistic = np.where(log["monitor_aime"][:, :, 0] > 0, log["monitor_aime"][:, :, 0], np.nan)
    innovation = log["innovation"][:, :, SATELLITE]
    names = {"monitor_rho": 0, "monitor_median": 0, "end_ratio": SATELLITE, "excluded": SATELLITE}
    return Watched(
        alarm=first,
        false=np.sum((alarm | held.any(axis=2)) & (t <= BEGIN_S), axis=1),
        wrong=np.delete(held, SATELLITE, axis=2).any(axis=(1, 2)),
        end=_first(over & later, t),
        after=np.sum(alarm & (t > last) & (t <= last + AFTER), axis=1),
        ends=ends,
        threshold=float(log["monitor_threshold"][0, BEGIN_S - 1, 0]),
        statistic=_quantiles(statistic),
        innovation=_quantiles(innovation),
        mean_innovation=innovation.mean(axis=0),
        position_m=float(np.sqrt(np.mean(log["error"][:, (t > BEGIN_S) & (t <= last)] ** 2))),
        one={name: log[name][0, :, column].astype(float) for name, column in names.items() if name in log},
    )


def _quantiles(values: np.ndarray) -> np.ndarray:
    """Over time, of the runs that have a value in an epoch; NaN where fewer than half do."""
    few = np.isfinite(values).sum(axis=0) * 2 < len(values)
    return np.where(few, np.nan, np.nanquantile(np.where(few, 0.0, values), QUANTILES, axis=0))


def _first(mask: np.ndarray, t: np.ndarray) -> np.ndarray:
    return np.where(mask.any(axis=1), t[mask.argmax(axis=1)], np.nan)


def _since(alarm: np.ndarray) -> np.ndarray:
    """Epochs since an unbroken alarm began; -1 where there is none."""
    since = np.full(alarm.shape, -1)
    count = np.full(len(alarm), -1)
    for k in range(alarm.shape[1]):
        count = np.where(alarm[:, k], count + 1, -1)
        since[:, k] = count
    return since


def _plain(watched: Watched) -> dict:
    def known(values: np.ndarray) -> list:
        return np.where(np.isfinite(values), values, None).tolist()

    def one(value: object) -> object:
        if isinstance(value, dict):
            return {str(key): known(values) for key, values in value.items()}
        return known(value) if isinstance(value, np.ndarray) else value

    return {key: one(value) for key, value in vars(watched).items()}


def _restore(content: dict) -> Watched:
    content["ends"] = {float(eta): np.array(values, float) for eta, values in content["ends"].items()}
    content["one"] = {name: np.array(values, float) for name, values in content["one"].items()}
    return Watched(**{key: np.array(value, float) if isinstance(value, list) else value for key, value in content.items()})


def load(out: Path, seeds: range) -> tuple[list[Batch], dict[int, str]]:
    return by_seed.load(out, seeds[:1], _load)


def _load(folder: Path, seed: int) -> Batch:
    of = {case: _restore(read_json(folder / f"{case.file}.json")) for case in CASES}
    base = read_json(folder / "scenario.json")
    epochs = len(of[CASES[0]].mean_innovation)
    limits = {fault: limit(base, fault, of[ours(fault)].alarm) for fault in FAULTS}
    return Batch(seed, len(of[CASES[0]].alarm), of, limits, dict(_true(FAULTS, epochs)))


def _true(faults: Iterable[Fault], epochs: int) -> Iterable[tuple[Fault, np.ndarray]]:
    t = np.arange(1, epochs + 1)
    for rate, last in faults:
        yield (rate, last), np.where((t > BEGIN_S) & (t <= last), rate * (t - BEGIN_S), 0.0)


THRESHOLDS = np.concatenate([np.linspace(0.25, 8.0, 32), np.linspace(9.0, 40.0, 32)])


def limit(scenario: dict, fault: Fault, alarm: np.ndarray) -> Limit:
    """The end is looked for from the epoch after our median alarm on, as ours does."""
    rate, last = fault
    first = int(np.nanmedian(alarm)) + 1
    known = clairvoyant.known(scenario, SATELLITE, BEGIN_S, rate, first, last + 1 + NEAR)
    return Limit(known, last + 1, clairvoyant.reached(known, last + 1, THRESHOLDS))
