# SPDX-License-Identifier: MIT
"""The tables of the experiment and of what the covariances are worth."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import tables
from statements import evaluate
from tables import Row
from tracking import nees_verdict

from . import published
from .batches import FROM_STEP, LOSS, PROTOCOLS, RUNS, SWEEP, Batch
from .properties import PROPERTIES, central_rmse, excess, node_rmse, rates

_INTRO = f"""A batch: {RUNS} runs; RMSE of the position, metres, and disagreement over steps {FROM_STEP} to 80. Centralised: the same filter where every node
hears all. The paper has no table; "independent" is another reproduction. Disagreement: largest distance between two nodes' positions.
"""
TEXT = {
    "all, paper, 10": "all visible, paper's protocol, L = 10",
    "all, metropolis, 50": "all visible, Metropolis, L = 50",
    "100 m, paper, 10": "range 100 m, paper's protocol, L = 10",
    "85 m, paper, 1": "range 85 m, paper's protocol, L = 1",
    "85 m, paper, 3": "range 85 m, paper's protocol, L = 3",
    "85 m, paper, 10": "range 85 m, paper's protocol, L = 10",
    "alone": "no consensus, one range sensor alone",
}
_CENTRALISED = {"all": "all visible", "100 m": "range 100 m", "85 m": "range 85 m"}
_MORE = {
    "all, perron, 10": "all visible, paper's protocol scaled, L = 10",
    "all, metropolis, 10": "all visible, Metropolis, L = 10",
    "all, ratio, 10": "all visible, ratio, L = 10",
    "all, paper, 10, loss": f"{100 * LOSS:.0f} % of messages lost, paper's protocol, L = 10",
    "all, metropolis, 10, loss": f"{100 * LOSS:.0f} % of messages lost, Metropolis, L = 10",
    "all, ratio, 10, loss": f"{100 * LOSS:.0f} % of messages lost, ratio, L = 10",
    "100 m, metropolis, 10": "range 100 m, Metropolis, L = 10",
    "100 m, ratio, 10": "range 100 m, ratio, L = 10",
    "all, kcf": "all visible, Kalman-consensus filter",
    "all, rekfd": "all visible, robust extended diffusion filter, c = 0.02",
    "all, ukf": "all visible, UKF of all readings stacked",
}


def write(out: Path, batches: list[Batch], errors: dict[int, str]) -> int:
    report = tables.Report(
        title=f"{tables.count(batches, 'batch')} of the distributed unscented information filter",
        intro=_INTRO,
        independent="independent",
        rows=comparison(batches) if batches else [],
        outcomes=evaluate(PROPERTIES, batches),
        seeds=[batch.seed for batch in batches],
        errors=errors,
        one="batch",
        extra=[_together(batches), _covariances(batches)] if batches else [],
    )
    return tables.write(out, report)


def comparison(batches: list[Batch]) -> list[Row]:
    def over(measure: Callable[[Batch], float]) -> dict[int, float]:
        return {batch.seed: float(measure(batch)) for batch in batches}

    rows = []
    for variant, text in TEXT.items():
        independent = published.NODES[variant]
        rows.append(Row(f"RMSE, best node: {text}", over(lambda b: node_rmse(b, variant).min()), 4, None, independent[:1]))
        rows.append(Row(f"RMSE, worst node: {text}", over(lambda b: node_rmse(b, variant).max()), 4, None, independent[-1:]))
    for where, text in _CENTRALISED.items():
        rows.append(Row(f"RMSE, centralised: {text}", over(lambda b: central_rmse(b, where)), 4, None, (published.CENTRALISED[where],)))
    for variant, text in TEXT.items():
        largest = over(lambda b: b.of[variant]["disagreement_largest"])
        rows.append(Row(f"disagreement, largest: {text}", largest, -1, None, (published.DISAGREEMENT[variant],)))
    for variant, text in TEXT.items():
        rows.append(Row(f"disagreement, rms: {text}", over(lambda b: b.of[variant]["disagreement_rms"]), -1))
    for variant, text in _MORE.items():
        rows.append(Row(f"RMSE, worst node: {text}", over(lambda b: node_rmse(b, variant).max()), 4))
    for variant, text in [*TEXT.items(), *_MORE.items()]:
        if variant not in ("alone", "all, ukf"):
            rows.append(Row(f"off the centralised RMSE, %: {text}", over(lambda b: 100.0 * excess(b, variant)), -1))
    for p in PROTOCOLS:
        rows.append(Row(f"disagreement, factor an iteration: {p}", over(lambda b: float(np.median(rates(b, p)))), 4, None, None))
        rows.append(Row(f"second eigenvalue that design tells: {p}", over(lambda b: b.eigenvalue(p)), 4))
    return rows


def _together(batches: list[Batch]) -> str:
    """Rare mirrored runs decide an RMSE: batches as one."""
    header = [f"all {RUNS * len(batches)} runs together", "RMSE, best node", "worst node", "centralised", "farthest node off, %"]
    body = []
    for variant, text in [*TEXT.items(), *_MORE.items()]:
        if variant in ("alone", "all, ukf"):
            continue
        nodes = np.sqrt(np.mean([node_rmse(b, variant) ** 2 for b in batches], axis=0))
        central = float(np.sqrt(np.mean([central_rmse(b, variant.split(",")[0]) ** 2 for b in batches])))
        off = 100.0 * float(np.abs(nodes / central - 1.0).max())
        body.append([text, f"{nodes.min():.4f}", f"{nodes.max():.4f}", f"{central:.4f}", f"{off:.2g}"])
    return tables.table(header, body)


def _covariances(batches: list[Batch]) -> str:
    """NEES a state: 1 where the covariance is that of the error."""
    header = [f"NEES / 4, steps {FROM_STEP} to 80, mean of the nodes", "mean", "+- 95 %", "steps in their band", "verdict"]
    shown = {
        "all, centralised": "all visible, centralised",
        "all, ukf": "all visible, UKF of all readings stacked",
        "all, centralised, information as published": "all visible, centralised, information as published",
        **{f"all, {p}, {steps}": f"all visible, {p}, L = {steps}" for p in PROTOCOLS for steps in SWEEP[p] if steps in (1, 3, 10, 50)},
        "all, metropolis, 10, information as published": "all visible, metropolis, L = 10, information as published",
        **{v: _MORE[v] for v in _MORE if "loss" in v},
        "100 m, centralised": "range 100 m, centralised",
        **{f"100 m, {p}, 10": f"range 100 m, {p}, L = 10" for p in ("paper", "metropolis", "ratio")},
        "85 m, centralised": "range 85 m, centralised",
        **{v: text for v, text in TEXT.items() if v.startswith("85 m")},
        "alone": TEXT["alone"],
        "all, kcf": _MORE["all, kcf"],
        "all, rekfd": _MORE["all, rekfd"],
    }
    return tables.table(header, [[text, *nees_verdict([batch.of[variant] for batch in batches])] for variant, text in shown.items()])
