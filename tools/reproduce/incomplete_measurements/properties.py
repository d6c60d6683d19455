# SPDX-License-Identifier: MIT
"""What the paper says, and what must hold, of every batch."""

from statements import CLAIM, MUST, OPEN, Property

from .batches import Batch

# "The same to three digits": of numbers about -5 and -8.
SAME = 0.005
LABEL = {"ekf": "EKF", "ukf": "UKF", "iukf": "IUKF", "iukf-literal": "IUKF as published", "pukf": "PUKF", "mpukf": "MPUKF"}


def position(batch: Batch, variant: str, name: str) -> float:
    return batch.of[variant][name]["mean_log_mse_position"]


def velocity(batch: Batch, variant: str, name: str) -> float:
    return batch.of[variant][name]["mean_log_mse_velocity"]


def fired(batch: Batch, variant: str) -> float:
    """Share of the updates that rule (20) ended early."""
    counts = batch.of[variant]["mpukf"]["counts"]
    return counts["rule_fired"] / counts["updates"]


def _below(kind: str, measure, what: str, better: str, worse: str, variant: str = "published", of: str = "") -> Property:  # noqa: ANN001
    text = f"{what} error of {LABEL[better]} below {LABEL[worse]}{of}"
    return Property(kind, text, "gap, ln", lambda b: measure(b, variant, worse) - measure(b, variant, better), ">", 0.0)


def _difference(batch: Batch, one: tuple[str, str], other: tuple[str, str]) -> float:
    return max(abs(measure(batch, *one) - measure(batch, *other)) for measure in (position, velocity))


def _same(kind: str, text: str, one: tuple[str, str], other: tuple[str, str], limit: float) -> Property:
    return Property(kind, text, "larger difference, ln", lambda b: _difference(b, one, other), "<", limit)


def _fastest(batch: Batch) -> float:
    return batch.ns["mpukf"] / min(batch.ns["iukf-literal"], batch.ns["pukf"])


def _lost(batch: Batch, name: str) -> float:
    return batch.policy(name, tight=True)["targets_lost"]


def _failures(batch: Batch) -> float:
    return float(sum(sum(item["failures"].values()) for filters in batch.of.values() for item in filters.values()))


PROPERTIES = [
    _below(CLAIM, position, "position", "mpukf", "pukf"),
    _below(MUST, position, "position", "pukf", "iukf-literal"),
    _below(CLAIM, velocity, "velocity", "mpukf", "pukf"),
    _below(MUST, velocity, "velocity", "pukf", "iukf-literal"),
    Property(CLAIM, "MPUKF the fastest of the three", "time, ratio to the next", _fastest, "<", 1.0),
    _same(CLAIM, "one gate for both: PUKF and MPUKF the same to three digits", ("one gate", "pukf"), ("one gate", "mpukf"), SAME),
    _same(MUST, "one gate, no rule: MPUKF is PUKF", ("no rule", "mpukf"), ("one gate", "pukf"), 1e-12),
    Property(MUST, "the literal rule ends fewer than 1 % of the updates", "share", lambda b: fired(b, "published"), "<", 0.01),
    Property(OPEN, "the Mahalanobis form ends more than 1 %", "share", lambda b: fired(b, "mahalanobis"), ">", 0.01),
    Property(OPEN, "the Mahalanobis form fires more often than the literal", "share", lambda b: fired(b, "mahalanobis") - fired(b, "published"), ">", 0.0),
    Property(MUST, "no update failed, in any filter and variant", "failures", _failures, "<", 1.0),
    _below(OPEN, position, "position", "mpukf", "ukf", "one gate", ", one gate for both"),
    _below(OPEN, position, "position", "iukf", "iukf-literal"),
    Property(OPEN, "tight gate, no faults: re-initialising loses fewer targets", "fewer", lambda b: _lost(b, "skip") - _lost(b, "re-initialise"), ">", 0.0),
    Property(OPEN, "tight gate, no faults: inflation loses none", "lost", lambda b: _lost(b, "inflate"), "<", 1.0),
]
