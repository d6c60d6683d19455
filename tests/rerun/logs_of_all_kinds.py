# SPDX-License-Identifier: MIT
"""Synthetic logs of all kinds, and what must be found of each of their numbers: by table, column and row, made here from the arrays that were put in."""

import numpy as np
from synthetic import Log
from synthetic_monitor import NavigationLog, add_monitor
from synthetic_tracking import TrackingLog

EACH = ("error", "nees", "trace_covariance", "theta", "tolerance", "nis", "nis_rows", "frozen", "faults", "gate_stacked_ratio")
STEP = ("disagreement",)
NODE = ("measuring", "faulty", "azimuth_deg", "elevation_deg")
ROW = ("measurements", "fault", "innovation", "innovation_variance")
SLOT = ("measurements_arrived", "estimates_arrived", "messages_arrived", "decision", "gate_ratio", "weight", "weight_statistic", "excluded",
        "isolation", "end_ratio")
NAVIGATION = ("roll pitch heading velocity_east velocity_north velocity_up east north up gyro_bias_right gyro_bias_forward gyro_bias_up "
              "accelerometer_bias_right accelerometer_bias_forward accelerometer_bias_up clock_bias clock_drift").split()


def odd_numbers(log: Log) -> Log:
    """Numbers that are hard to write down, and those that are none."""
    for key, odd in (("measurements", np.nan), ("measurements", 5e-324), ("estimate", np.inf), ("estimate", -np.inf), ("trace_covariance", np.nan),
                     ("theta", 1e-42 if log.real == "float32" else 1.7976931348623157e308), ("nis", -0.0), ("nis", 1 / 3)):
        if key in log.arrays:
            values = np.array(log.arrays[key], dtype=np.float64)
            values.reshape(-1)[np.random.default_rng(len(key) + int(np.isnan(odd))).integers(values.size)] = odd
            log.arrays[key] = values
    return log


def frozen() -> Log:
    log = Log(nodes=3, steps=6)
    log.arrays["frozen"] = np.arange(18).reshape(1, 6, 3) % 2
    log.dtypes["frozen"] = "u1"
    return log


def navigation(**options) -> Log:
    log = NavigationLog(steps=9, **options)
    rng = np.random.default_rng(3)
    log.arrays["correction"] = rng.normal(0, 1, (1, 9, 17))
    log.arrays["innovation_covariance"] = rng.normal(0, 1, (1, 9, 15))
    log.arrays["innovation_covariance"][0, 2, 4] = np.nan
    return log


def mixed_rows() -> Log:
    """Nodes without a row, with one and with two; links one way; estimators of some nodes only."""
    log = Log(nodes=4, steps=7, filter="rkfdnu2")
    log.header |= {"rows": [0, 2, 1, 1], "estimator_nodes": [1, 3], "estimators": 2, "slots": [[1, 0, 3], [3]]}
    log._draw(np.random.default_rng(5), False, True)
    return log


LOGS = {
    "linear": lambda: odd_numbers(Log(nodes=5, steps=8)),
    "float32": lambda: odd_numbers(Log(nodes=5, steps=8, real="float32")),
    "central": lambda: odd_numbers(Log(nodes=3, steps=8, filter="rkfc")),
    "no truth": lambda: Log(nodes=3, steps=5, truth=False, position_states=None, positions=None),
    "three coordinates": lambda: Log(nodes=3, steps=5, position_states=(2, 0, 1), positions="3d"),
    "one node": lambda: Log(nodes=1, steps=5),
    "an older log": lambda: Log(nodes=3, steps=5, bands=False),
    "one step": lambda: Log(nodes=2, steps=1),
    "frozen": frozen,
    "some nodes": mixed_rows,
    "exclude": lambda: add_monitor(Log(nodes=4, steps=12), "exclude"),
    "aime-improved": lambda: add_monitor(Log(nodes=4, steps=12, filter="kfc", real="float32"), "aime-improved"),
    "duif": lambda: odd_numbers(TrackingLog(filter="duif")),
    "rekfd": lambda: TrackingLog(filter="rekfd", real="float32", dimensions=3),
    "ekf": lambda: TrackingLog(filter="ekf", gate=False),
    "plugin": lambda: TrackingLog(filter="kcf", positions=False),
    "navigation": lambda: odd_numbers(navigation()),
    "navigation, monitor": lambda: add_monitor(navigation(real="float32", truth=False), "exclude"),
}


def state_names(log: Log) -> list[str]:
    if log.header.get("kind") == "navigation":
        return NAVIGATION
    return log.scenario["model"].get("states") or [str(i) for i in range(log.header["states"])]


def position_names(log: Log) -> list[str]:
    kind = log.header.get("kind")
    if kind == "navigation":
        return ["east", "north", "up"]
    return ["px", "py", "pz"][: log.header["positions"]] if kind else [str(i) for i in log.scenario["model"].get("position_states", [])]


def stored(log: Log, key: str, run: int = 0) -> np.ndarray:
    """(T, length) as it is in the file, with its precision."""
    return np.ascontiguousarray(log.arrays[key][run]).astype(log.type_of(key)).reshape(log.header["steps"], -1)


def beside_measurements(log: Log, values: np.ndarray) -> np.ndarray:
    """Innovations of the estimators' own rows among the rows of all nodes."""
    h = log.header
    if values.shape[1] == sum(h["rows"]):
        return values
    rows, columns = [node for node, count in enumerate(h["rows"]) for _ in range(count)], iter(values.T)
    return np.array([next(columns) if node in h["estimator_nodes"] else np.full(len(values), np.nan) for node in rows]).T.astype(values.dtype)


def expected(log: Log, run: int = 0) -> dict[str, dict[str, np.ndarray]]:
    """By table and column: (T, rows of the table)."""
    h, steps = log.header, log.header["steps"]
    nodes = h.get("estimator_nodes") or (list(range(h["nodes"])) if h["estimators"] > 1 or "estimates_arrived" in log.arrays else [None])
    slots = [(node, sender) for node, listens in zip(nodes, h["slots"]) for sender in listens]
    rows = [(node, row) for node, count in enumerate(h["rows"]) for row in range(count)]
    pairs = [(i, j) for i in range(h["nodes"]) for j in range(i + 1)]
    keys = {"steps": [()], "nodes": [(k,) for k in nodes], "sensors": [(k,) for k in range(h["nodes"])], "readings": rows, "links": slots,
            "innovation_covariance": pairs}
    names = {"steps": (), "nodes": ("node",), "sensors": ("node",), "readings": ("node", "row"), "links": ("node", "sender"),
             "innovation_covariance": ("node", "other")}
    out: dict[str, dict[str, np.ndarray]] = {"steps": {}}
    for key in log.arrays:
        value = stored(log, key, run)
        if key == "time_s":
            continue
        if key in ("truth", "correction"):
            columns = {f"{key}_{name}": value[:, i : i + 1] for i, name in enumerate(state_names(log))}
            table = "steps"
        elif key in ("estimate", "variance"):
            value = value.reshape(steps, h["estimators"], -1)
            table, columns = "nodes", {f"{key}_{name}": value[:, :, i] for i, name in enumerate(state_names(log))}
        elif key == "position_covariance":
            value, p = value.reshape(steps, h["estimators"], -1), position_names(log)
            places = [(i, j) for i in range(len(p)) for j in range(i + 1)]
            table, columns = "nodes", {f"{key}_{p[j]}_{p[i]}": value[:, :, at] for at, (i, j) in enumerate(places)}
        elif key == "consensus_disagreement":
            table, columns = "steps", {f"{key}_{i}": value[:, i : i + 1] for i in range(value.shape[1])}
        else:
            of = {"nodes": EACH, "steps": STEP, "sensors": NODE, "readings": ROW, "links": SLOT, "innovation_covariance": ("innovation_covariance",)}
            table = next((t for t, some in of.items() if key in some), "nodes" if key.startswith("monitor_") else None)
            assert table, key
            columns = {key: beside_measurements(log, value) if key.startswith("innovation") and table == "readings" else value}
        out.setdefault(table, {}).update(columns)
    seconds = stored(log, "time_s", run)[:, 0] if "time_s" in log.arrays else np.arange(steps) * h["dt_s"]
    for table, columns in list(out.items()):
        count = len(keys[table])
        if not count:
            del out[table]
            continue
        fixed = {name: np.array([[key[i] for key in keys[table]]] * steps, dtype=object) for i, name in enumerate(names[table])}
        if "satellites" in h:
            fixed |= {"satellite" if name in ("node", "sender") else "other_satellite": np.vectorize(lambda k: h["satellites"][k])(values.astype(int))
                      for name, values in fixed.items() if (name, table) not in (("node", "links"), ("node", "nodes")) and name != "row"}
        when = {"run": np.full((steps, count), run), "step": np.tile(log.first_step + np.arange(steps)[:, None], (1, count)),
                "time_s": np.tile(seconds[:, None], (1, count))}
        out[table] = when | fixed | columns
    return out
