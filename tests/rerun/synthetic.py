# SPDX-License-Identifier: MIT
"""Writes logs exactly by port/host/log-format.md, with invented numbers: what a recording shows is compared with what was put in.

Run as a program it writes one log:  python synthetic.py OUT.cbor [nodes steps filter]
"""

import hashlib
import json
import sys

import cbor2
import numpy as np

TAGS = {"<f8": 86, "<f4": 85, "<u4": 70, "|u1": 64}


def typed(values, dtype: str) -> cbor2.CBORTag:
    array = np.ascontiguousarray(values, dtype=np.dtype(dtype)).reshape(-1)
    return cbor2.CBORTag(TAGS[array.dtype.str], array.tobytes())


def ring_slots(nodes: int, reach: int = 2) -> list[list[int]]:
    """Each node listens to `reach` nodes on either side."""
    out = []
    for k in range(nodes):
        near = {(k + d) % nodes for d in range(-reach, reach + 1)} - {k}
        out.append([k, *sorted(near)])
    return out


def near_slots(positions: np.ndarray, distance: float) -> list[list[int]]:
    apart = np.linalg.norm(positions[:, None] - positions[None], axis=2)
    return [[k, *(int(j) for j in np.flatnonzero(apart[k] < distance) if j != k)] for k in range(len(positions))]


class Log:
    """The arrays of one log, all runs: `arrays[key]` has shape (runs, steps, length). Change what you like, then `items` or `data`.
    rows: of every sensor, or of each. bands: the arrays that older logs have not."""

    first_step = 0

    def __init__(self, nodes=4, steps=12, *, filter="rkfdu", real="float64", runs=1, states=4, rows=1, dt_s=0.1, truth=True, seed=7,
                 position_states=(0, 1), positions="2d", name="synthetic", bands=True):
        rng = np.random.default_rng(seed)
        central = filter in ("kfc", "rkfc")
        e = 1 if central else nodes
        positions_m = rng.uniform(0, 100, (nodes, 3))
        if positions == "2d":
            positions_m = positions_m[:, :2]
        slots = [list(range(nodes))] if central else ring_slots(nodes, min(2, (nodes - 1) // 2))
        rows = [rows] * nodes if isinstance(rows, int) else list(rows)
        self.real, self.bands = real, bands
        self.scenario = {
            "name": name,
            "model": {"A": np.eye(states).tolist(), "dt_s": dt_s},
            "nodes": [{"C": [[1.0] * states] * m, "R": np.eye(m).tolist()} for m in rows],
            "edges": sorted({(min(k, j), max(k, j)) for k, s in enumerate(slots) for j in s if j != k}) if not central else [],
            "tolerance": 0.02, "weights": "metropolis", "steps": steps, "seed": seed,
        }
        if position_states is not None:
            self.scenario["model"]["position_states"] = list(position_states)
        if positions is not None:
            for node, position in zip(self.scenario["nodes"], positions_m):
                node["position_m"] = position.tolist()
        self.header = {
            "format": "meshkal-log", "format_version": 1, "program": "meshkal 0.0.0", "filter": filter, "real": real,
            "source": "drawn" if truth else "recorded", "seed": seed, "runs": runs, "steps": steps, "loss": 0.1, "dt_s": dt_s,
            "states": states, "positions": len(position_states or ()), "nodes": nodes, "estimators": e, "rows": rows, "slots": slots,
        }
        self.positions_m = positions_m
        self.end, self.dtypes = "complete", {}
        self._draw(rng, central, truth)

    def _draw(self, rng, central: bool, truth: bool) -> None:
        h = self.header
        runs, steps, n, e = h["runs"], h["steps"], h["states"], h["estimators"]
        slots = sum(map(len, h["slots"]))
        shape = (runs, steps)
        t = np.arange(steps)
        x = np.zeros((runs, steps, n))
        x[..., 0] = 50 + 35 * np.cos(2 * np.pi * t / 120)
        x[..., 1 % n] = 50 + 25 * np.sin(4 * np.pi * t / 120)
        x += rng.normal(0, 0.2, (runs, 1, n))
        quality = np.exp(rng.normal(0, 0.5, e))
        size = quality * (0.4 + 8 * np.exp(-t / 12))[:, None]
        deviation = rng.normal(0, 1, (*shape, e, n))
        for i in range(1, steps):
            deviation[:, i] = 0.9 * deviation[:, i - 1] + 0.44 * deviation[:, i]
        estimate = x[:, :, None] + deviation * size[..., None]
        nis_rows = np.array([sum(h["rows"][j] for j in s) for s in h["slots"]])
        self.arrays = {
            "measurements": rng.normal(0, 1, (*shape, sum(h["rows"]))),
            "measurements_arrived": rng.random((*shape, slots)) > 0.1,
            "estimate": estimate.reshape(*shape, e * n),
            "trace_covariance": np.broadcast_to(n * size**2, (*shape, e)),
            "theta": 0.3 * quality * (1 - 0.5 * np.exp(-t / 25))[:, None] * np.exp(rng.normal(0, 0.01, (*shape, e))),
            "tolerance": np.broadcast_to(0.02 / (1 + 0.3 * np.arange(e) / e), (*shape, e)),
            "nis": rng.chisquare(nis_rows, (*shape, e)),
            "nis_rows": np.broadcast_to(nis_rows, (*shape, e)),
            "faults": np.zeros((*shape, e)),
        }
        if not central:
            self.arrays["estimates_arrived"] = rng.random((*shape, slots)) > 0.1
        p = h["positions"]
        if p:
            root = rng.normal(0, 1, (*shape, e, p, p))
            rows, columns = np.tril_indices(p)
            self.arrays["position_covariance"] = (root @ np.swapaxes(root, -1, -2))[..., rows, columns].reshape(*shape, -1)
        if truth:
            self.arrays["truth"] = x
            self.arrays["error"] = np.linalg.norm(estimate - x[:, :, None], axis=3)
        if self.bands:
            self._draw_bands(rng, central)

    def _draw_bands(self, rng, central: bool) -> None:
        h, first = self.header, np.cumsum([0, *map(len, self.header["slots"])])
        trace, rows = self.arrays["trace_covariance"], h["rows"]
        self.arrays["variance"] = (rng.dirichlet(np.full(h["states"], 5.0), trace.shape) * trace[..., None]).reshape(*trace.shape[:2], -1)
        own = np.concatenate([np.repeat(np.arange(len(s) if central else 1), [rows[k] for k in (s if central else s[:1])]) + i
                              for s, i in zip(h["slots"], first)])
        arrived = np.asarray(self.arrays["measurements_arrived"])[..., own] > 0
        variance = rng.uniform(0.5, 2.0, arrived.shape)
        self.arrays["innovation"] = np.where(arrived, rng.normal(0, np.sqrt(variance)), np.nan)
        self.arrays["innovation_variance"] = np.where(arrived, variance, np.nan)

    def type_of(self, key: str) -> str:
        return self.dtypes.get(key) or self.dtype(key)

    def dtype(self, key: str) -> str:
        if key in ("measurements_arrived", "estimates_arrived"):
            return "u1"
        if key in ("nis_rows", "faults"):
            return "<u4"
        if key in ("truth", "measurements", "error") or self.real == "float64":
            return "<f8"
        return "<f4"

    def items(self) -> list[bytes]:
        """The encoded items, header first and end last."""
        text = json.dumps(self.scenario)
        header = dict(self.header, scenario=text, scenario_sha256=hashlib.sha256(text.encode()).hexdigest())
        out = [cbor2.dumps(header)]
        for run in range(self.header["runs"]):
            for step in range(self.header["steps"]):
                item = {"run": run, "step": self.first_step + step}
                item |= {key: typed(values[run, step], self.type_of(key)) for key, values in self.arrays.items()}
                out.append(cbor2.dumps(item))
        out.append(cbor2.dumps({"end": self.end, "items": len(out) - 1}))
        return out

    def data(self) -> bytes:
        return b"".join(self.items())


def showcase(nodes: int, steps: int, filter: str = "rkfdu") -> Log:
    """A network over an area with neighbours within reach and a few faults: for pictures."""
    log = Log(nodes, steps, filter=filter, name=f"target over {nodes} sensors")
    if log.header["estimators"] == nodes:
        log.header["slots"] = near_slots(log.positions_m, 160 / np.sqrt(nodes))
        log._draw(np.random.default_rng(3), False, True)
        log.arrays["faults"][0, steps // 2 : steps // 2 + 3, nodes // 2] = 4
        log.arrays["faults"][0, steps // 3, nodes // 3] = 8
    return log


if __name__ == "__main__":
    size = [int(a) for a in sys.argv[2:4]] or [20, 200]
    with open(sys.argv[1], "wb") as out:
        out.write(showcase(*size, *sys.argv[4:5]).data())
