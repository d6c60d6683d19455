# SPDX-License-Identifier: MIT
"""What a run log holds: its header, a batch of its steps, and how long each array is. The format is port/host/log-format.md."""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

LINEAR, TRACKING, NAVIGATION = "linear", "tracking", "navigation"
# Of the filter, for each kind of log: those of a centre, and those that run in every node.
CENTRAL = {
    LINEAR: ("kfc", "rkfc"),
    TRACKING: ("ekf", "ukf", "iukf", "iukf-literal", "pukf", "mpukf"),
    NAVIGATION: ("ekf", "rekf-n", "rekf-t"),
}
DISTRIBUTED = {LINEAR: ("kfd", "rkfdu", "rkfdnu", "rkfdnu2"), TRACKING: ("duif", "kcf", "rekfd"), NAVIGATION: ()}
MONITORS = ("rctm", "aime", "aime-improved", "exclude")
NAVIGATION_STATES = 17


@dataclass(frozen=True)
class Header:
    program: str
    scenario: str
    scenario_sha256: str
    filter: str
    real: str
    source: str
    seed: int
    runs: int
    steps: int
    loss: float
    dt_s: float
    states: int
    positions: int  # states that are coordinates of a position
    nodes: int
    estimators: int
    rows: tuple[int, ...]
    slots: tuple[tuple[int, ...], ...]
    estimator_nodes: tuple[int, ...]  # node of each estimator; of a centre none
    kind: str
    start_s: float  # time of x0 of a log that has times, else 0
    iterations: int  # of the consensus of a tracking log, else 0
    protocol: str
    increments: int
    gate: float  # significance, 0 without one
    monitor: str  # of MONITORS, empty without one
    monitor_window: int
    monitor_false_alarm: float
    satellites: tuple[int, ...]  # numbers of the nodes of a navigation log, else empty
    truth: str = ""  # what it was drawn from: "nominal" or "least-favourable"; "recorded" or "unknown"

    @property
    def tracking(self) -> bool:
        return self.kind == TRACKING

    @property
    def navigation(self) -> bool:
        return self.kind == NAVIGATION

    @property
    def timed(self) -> bool:
        """Whether steps have times of their own, `time_s`."""
        return self.kind != LINEAR

    @property
    def central(self) -> bool:
        return self.filter in CENTRAL[self.kind]

    @property
    def heard(self) -> tuple[int, ...]:
        """From how many of its slots, the first ones, an estimator gets readings; consensus spreads them in other ways."""
        return (1,) * self.estimators if self.filter in ("duif", "kcf") else tuple(len(s) for s in self.slots)

    @property
    def messages(self) -> int:
        """How many messages of a neighbour an estimator of a tracking log waits for in a step."""
        return self.iterations if self.filter == "duif" else 1

    @property
    def slot_starts(self) -> np.ndarray:
        """Where each estimator's slots start in an array over the slots of all estimators."""
        return np.concatenate(([0], np.cumsum([len(s) for s in self.slots])[:-1])).astype(np.intp)

    @property
    def own_rows(self) -> tuple[int, ...]:
        """How many numbers of `innovation` each estimator of a linear log has: rows of its own sensor, of a centre those of all."""
        return (sum(self.rows),) if self.central else tuple(self.rows[k] for k in self.estimator_nodes)

    def sensor_number(self, node: int) -> int:
        return self.satellites[node] if self.satellites else node

    def sensor_path(self, node: int) -> str:
        return f"{'satellite' if self.satellites else 'node'}/{self.sensor_number(node)}"

    def sensor_name(self, node: int) -> str:
        return self.sensor_path(node).replace("/", " ")


@dataclass(frozen=True)
class Batch:
    """Consecutive steps of one run: `step` has shape (T,), the others (T, length). What the log leaves out is None."""

    step: np.ndarray
    measurements: np.ndarray
    measurements_arrived: np.ndarray
    estimate: np.ndarray  # (T, E, n)
    trace_covariance: np.ndarray
    nis: np.ndarray
    nis_rows: np.ndarray
    faults: np.ndarray
    theta: np.ndarray | None = None
    tolerance: np.ndarray | None = None
    truth: np.ndarray | None = None
    error: np.ndarray | None = None
    estimates_arrived: np.ndarray | None = None
    variance: np.ndarray | None = None  # (T, E, n), the diagonal of the covariance
    position_covariance: np.ndarray | None = None  # (T, E, p (p + 1) / 2), rows of the lower triangle
    fault: np.ndarray | None = None  # (T, rows of all nodes): what was added to the readings
    frozen: np.ndarray | None = None
    # Of a linear log: (T, sum of own_rows); of a navigation log only the first: (T, N). NaN: no reading.
    innovation: np.ndarray | None = None
    innovation_variance: np.ndarray | None = None
    # Of a tracking log, some of them also of a navigation log.
    time_s: np.ndarray | None = None  # (T,)
    measuring: np.ndarray | None = None  # (T, N)
    faulty: np.ndarray | None = None
    decision: np.ndarray | None = None  # (T, slots), numbers of `Decision`
    gate_ratio: np.ndarray | None = None  # 0: not judged
    gate_stacked_ratio: np.ndarray | None = None
    nees: np.ndarray | None = None
    messages_arrived: np.ndarray | None = None
    disagreement: np.ndarray | None = None  # (T,)
    consensus_disagreement: np.ndarray | None = None  # (T, L + 1)
    # Of a navigation log: (T, N).
    azimuth_deg: np.ndarray | None = None
    elevation_deg: np.ndarray | None = None
    innovation_covariance: np.ndarray | None = None  # (T, N (N + 1) / 2), rows of the lower triangle
    correction: np.ndarray | None = None  # (T, n)
    # Of filters that weigh readings: (T, slots).
    weight: np.ndarray | None = None
    weight_statistic: np.ndarray | None = None
    # Of a log with a monitor.
    monitor_rctm: np.ndarray | None = None  # (T, E), as all that begin so
    monitor_rctm_rows: np.ndarray | None = None
    monitor_aime: np.ndarray | None = None
    monitor_aime_rows: np.ndarray | None = None
    monitor_threshold: np.ndarray | None = None
    monitor_alarm: np.ndarray | None = None
    monitor_ended: np.ndarray | None = None
    monitor_rho: np.ndarray | None = None
    monitor_median: np.ndarray | None = None
    excluded: np.ndarray | None = None  # (T, slots), and these
    isolation: np.ndarray | None = None
    end_ratio: np.ndarray | None = None


class Decision(IntEnum):
    """What became of a reading; LOST is not in logs: the sensor gave it, and it did not reach the estimator."""

    NONE, USED, REJECTED, INFLATED, REFUSED, LOST = range(6)


_OPTIONAL = ("truth", "error", "estimates_arrived", "variance", "position_covariance", "fault", "weight", "weight_statistic")
_OPTIONAL_OF = {
    LINEAR: ("innovation", "innovation_variance", "frozen"),
    TRACKING: ("theta", "tolerance", "nees", "messages_arrived", "disagreement", "consensus_disagreement"),
    NAVIGATION: ("nees", "innovation", "innovation_covariance", "correction"),
}


def optional(header: Header) -> tuple[str, ...]:
    return _OPTIONAL + _OPTIONAL_OF[header.kind]


def lengths(header: Header) -> dict[str, tuple[np.dtype, int]]:
    """Type and length of each array that a step of this log may have."""
    real = np.dtype("<f8" if header.real == "float64" else "<f4")
    double, byte, word = np.dtype("<f8"), np.dtype("u1"), np.dtype("<u4")
    e = header.estimators
    slots = sum(len(s) for s in header.slots)
    every = {
        "truth": (double, header.states),
        "measurements": (double, sum(header.rows)),
        "measurements_arrived": (byte, slots),
        # A navigation filter computes the error of an estimate that is float64 in any precision.
        "estimate": (double if header.navigation else real, e * header.states),
        "error": (double, e),
        "variance": (real, e * header.states),
        "trace_covariance": (real, e),
        "position_covariance": (real, e * header.positions * (header.positions + 1) // 2),
        "nis": (real, e),
        "nis_rows": (word, e),
        "faults": (word, e),
        "fault": (double, sum(header.rows)),
        "weight": (real, slots),
        "weight_statistic": (real, slots),
    }
    network = {"estimates_arrived": (byte, slots), "theta": (real, e), "tolerance": (real, e)}
    own = {"innovation": (real, sum(header.own_rows)), "innovation_variance": (real, sum(header.own_rows))}
    timed = {"time_s": (double, 1), "decision": (byte, slots), "nees": (double, e)}
    tracking = {
        "measuring": (byte, header.nodes),
        "faulty": (byte, header.nodes),
        "gate_ratio": (real, slots),
        "gate_stacked_ratio": (real, e),
        "messages_arrived": (word, slots),
        "disagreement": (double, 1),
        "consensus_disagreement": (double, header.iterations + 1),
    }
    sky = {
        "azimuth_deg": (double, header.nodes),
        "elevation_deg": (double, header.nodes),
        "innovation": (real, header.nodes),
        "innovation_covariance": (real, header.nodes * (header.nodes + 1) // 2),
        "correction": (real, header.states),
    }
    of_kind = {LINEAR: network | own | {"frozen": (byte, e)}, TRACKING: network | timed | tracking, NAVIGATION: timed | sky}
    return every | of_kind[header.kind] | monitor_lengths(header)


def monitor_lengths(header: Header) -> dict[str, tuple[np.dtype, int]]:
    """Those that a log with a monitor has besides."""
    if not header.monitor:
        return {}
    real, byte, word = np.dtype("<f8" if header.real == "float64" else "<f4"), np.dtype("u1"), np.dtype("<u4")
    each = {"rctm": real, "rctm_rows": word, "aime": real, "aime_rows": word, "threshold": real, "alarm": byte, "ended": byte}
    if header.monitor == "aime-improved":
        each |= {"rho": real, "median": real}
    of_slots = {"excluded": byte, "isolation": real}
    if header.monitor == "exclude":
        of_slots["end_ratio"] = real
    slots = sum(len(s) for s in header.slots)
    return {f"monitor_{key}": (dtype, header.estimators) for key, dtype in each.items()} | {key: (dtype, slots) for key, dtype in of_slots.items()}
