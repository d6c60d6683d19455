# SPDX-License-Identifier: MIT
"""Logs of tracking scenarios with invented numbers, by port/host/log-format.md.

Run as a program it writes one log:  python synthetic_tracking.py OUT.cbor [filter]
"""

import sys

import numpy as np
from synthetic import Log, ring_slots

CENTRAL = ("ekf", "ukf", "iukf", "iukf-literal", "pukf", "mpukf")
ROWS = {2: {"range": 1, "bearing": 1, "range-bearing": 2, "range-rate": 1, "tdoa": 1, "none": 0},
        3: {"range": 1, "bearing": 2, "range-bearing": 3, "range-rate": 1, "tdoa": 1, "none": 0}}
_BYTES = ("measuring", "faulty", "decision", "measurements_arrived", "estimates_arrived")
_DOUBLES = ("time_s", "nees", "disagreement", "consensus_disagreement", "truth", "measurements", "error")


class TrackingLog(Log):
    """A target that circles among sensors on a grid, with irregular times. decision, gate_ratio and the like fit each other."""

    first_step = 1

    def __init__(self, sensors=("range", "bearing", "range-bearing", "range-rate", "none"), steps=12, *, filter="duif", real="float64", runs=1,
                 dimensions=2, truth=True, seed=7, iterations=4, limits=True, gate=True, positions=True, name="synthetic tracking", bands=True):
        rng = np.random.default_rng(seed)
        nodes, central = len(sensors), filter in CENTRAL
        self.real, self.end, self.dtypes = real, "complete", {}
        states = [*"px py pz".split()[:dimensions], *"vx vy vz".split()[:dimensions]] if positions else ["a", "b", "c", "d"]
        self.positions_m = rng.uniform(0, 100, (nodes, dimensions))
        self.limits = rng.uniform(30, 60, nodes)
        slots = [list(range(nodes))] if central else ring_slots(nodes, 1)
        rows = [ROWS[dimensions][kind] for kind in sensors]
        listed = []
        for kind, position, limit in zip(sensors, self.positions_m, self.limits):
            node = {"sensor": kind}
            if kind != "none":
                node |= {"position_m": position.tolist(), "R": [[1.0]]} | ({"range_limit_m": limit} if limits else {})
            listed.append(node)
        self.scenario = {
            "name": name, "model": {"motion": "constant-velocity", "states": states, "dt_s": 0.5, "acceleration_psd": 0.1}, "nodes": listed,
            "edges": [], "tracking": {"gate": {"significance": 0.001, "policy": "skip"}, "consensus": {"protocol": "metropolis"}},
        }
        e = 1 if central else nodes
        self.header = {
            "format": "meshkal-log", "format_version": 1, "program": "meshkal 0.0.0", "filter": filter, "real": real, "kind": "tracking",
            "source": "drawn" if truth else "recorded", "seed": seed, "runs": runs, "steps": steps, "loss": 0.1, "dt_s": 0.5, "start_s": 10.0,
            "iterations": iterations if filter == "duif" else 0, "protocol": "metropolis", "increments": 30, "gate": 0.001 if gate else 0.0, "states": len(states), "positions": dimensions if positions else 0,
            "nodes": nodes, "estimators": e, "rows": rows, "slots": slots,
        }
        self._draw_tracking(rng, truth, gate, dimensions if positions else 0)
        if bands:
            trace = self.arrays["trace_covariance"]
            self.arrays["variance"] = (rng.dirichlet(np.full(len(states), 5.0), trace.shape) * trace[..., None]).reshape(*trace.shape[:2], -1)

    def heard(self) -> list[tuple[int, int, int]]:
        """(place in arrays over slots, estimator, node) of each slot that readings come to."""
        out, first = [], 0
        for e, slots in enumerate(self.header["slots"]):
            count = 1 if self.header["filter"] in ("duif", "kcf") else len(slots)
            out += [(first + i, e, node) for i, node in enumerate(slots[:count]) if self.header["rows"][node]]
            first += len(slots)
        return out

    def _draw_tracking(self, rng, truth: bool, gate: bool, p: int) -> None:
        h = self.header
        runs, steps, n, e, nodes = h["runs"], h["steps"], h["states"], h["estimators"], h["nodes"]
        shape, slots = (runs, steps), sum(map(len, h["slots"]))
        time_s = 10.0 + np.cumsum(rng.choice([0.1, 0.35, 1.0], steps))
        x = np.zeros((runs, steps, n))
        x[..., 0], x[..., 1 % n] = 50 + 30 * np.cos(time_s / 10), 50 + 30 * np.sin(time_s / 10)
        x += rng.normal(0, 0.1, x.shape)
        estimate = x[:, :, None] + rng.normal(0, 1, (*shape, e, n))
        measuring = (rng.random((*shape, nodes)) < 0.7) & (np.array(h["rows"]) > 0)
        row_node = np.repeat(np.arange(nodes), h["rows"])
        readings = np.where(measuring[..., row_node], rng.uniform(0.1, 3.0, (*shape, len(row_node))), np.nan)
        arrived, decision, ratio = (np.zeros((*shape, slots)) for _ in range(3))
        for at, _, node in self.heard():
            arrived[..., at] = measuring[..., node] & (rng.random(shape) < 0.8)
            judged = np.where(arrived[..., at] > 0, np.exp(rng.normal(-1, 1, shape)), 0.0)
            ratio[..., at] = judged if gate else 0.0
            decision[..., at] = np.where(arrived[..., at] > 0, np.where(ratio[..., at] > 1, rng.choice([2, 3], shape), 1), 0)
        self.arrays = {
            "time_s": np.broadcast_to(time_s[:, None], (*shape, 1)), "measurements": readings, "measuring": measuring,
            "faulty": measuring & (rng.random(measuring.shape) < 0.2), "measurements_arrived": arrived, "decision": decision, "gate_ratio": ratio,
            "gate_stacked_ratio": np.where(rng.random((*shape, e)) < 0.5, 0.4, 0.0) if gate else np.zeros((*shape, e)),
            "estimate": estimate.reshape(*shape, e * n), "trace_covariance": rng.uniform(1, 2, (*shape, e)),
            "nis": rng.chisquare(2, (*shape, e)), "nis_rows": np.full((*shape, e), 2), "faults": np.zeros((*shape, e)),
        }
        if h["estimators"] == nodes:
            expected = h["iterations"] if h["filter"] == "duif" else 1
            self.arrays["messages_arrived"] = rng.integers(0, expected + 1, (*shape, slots))
            self.arrays["estimates_arrived"] = self.arrays["messages_arrived"] > 0
            self.arrays["disagreement"] = rng.uniform(0, 3, (*shape, 1))
        if h["filter"] == "duif":
            self.arrays["consensus_disagreement"] = rng.uniform(0.1, 2, (*shape, h["iterations"] + 1))
        if h["filter"] == "rekfd":
            self.arrays |= {"theta": rng.uniform(0, 1, (*shape, e)), "tolerance": np.full((*shape, e), 0.02)}
        if p:
            root = rng.normal(0, 1, (*shape, e, p, p))
            rows, columns = np.tril_indices(p)
            self.arrays["position_covariance"] = (root @ np.swapaxes(root, -1, -2))[..., rows, columns].reshape(*shape, -1)
        if truth:
            self.arrays |= {"truth": x, "error": np.linalg.norm(estimate - x[:, :, None], axis=3), "nees": rng.chisquare(n, (*shape, e))}

    def dtype(self, key: str) -> str:
        if key in _BYTES:
            return "u1"
        if key in ("nis_rows", "faults", "messages_arrived"):
            return "<u4"
        return "<f8" if key in _DOUBLES or self.real == "float64" else "<f4"


if __name__ == "__main__":
    with open(sys.argv[1], "wb") as out:
        out.write(TrackingLog(steps=120, **({"filter": sys.argv[2]} if len(sys.argv) > 2 else {})).data())
