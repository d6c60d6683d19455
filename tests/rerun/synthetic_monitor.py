# SPDX-License-Identifier: MIT
"""What monitors and weights say, with invented numbers, added to any log; and logs of navigation runs. By port/host/log-format.md."""

import numpy as np
from scipy.stats import chi2
from synthetic import Log

FALSE_ALARM = 1e-6
NUMBERS = (1, 3, 7, 12, 31)  # of satellites


def add_monitor(log: Log, scheme: str, seed: int = 1, faulty: int = 1) -> Log:
    """One fault of the first row of `faulty` in the middle third; alarms where the invented statistic is above its threshold."""
    rng, h = np.random.default_rng(seed), log.header
    runs, steps, e, slots = h["runs"], h["steps"], h["estimators"], sum(map(len, h["slots"]))
    shape, real = (runs, steps), "<f8" if log.real == "float64" else "<f4"
    h |= {"monitor": scheme, "monitor_window": 5, "monitor_false_alarm": FALSE_ALARM}
    rows = np.array([sum(h["rows"][k] for k in s) for s in h["slots"]])
    during = (np.arange(steps) >= steps // 3) & (np.arange(steps) < 2 * steps // 3)
    fault = np.zeros((*shape, sum(h["rows"])))
    fault[..., sum(h["rows"][:faulty])] = np.where(during, 0.1 * (1 + np.arange(steps) - steps // 3), 0.0)
    heard = np.concatenate([[k == faulty for k in s] for s in h["slots"]])
    hears = np.array([faulty in s for s in h["slots"]])
    late = during & (np.arange(steps) >= steps // 3 + 2)
    statistic = {key: rng.chisquare(rows, (*shape, e)) for key in ("rctm", "aime")}
    tested = "rctm" if scheme == "rctm" else "aime"
    threshold = np.broadcast_to(chi2.isf(FALSE_ALARM, rows), (*shape, e)).astype(real)
    statistic[tested] = np.where(late[:, None] & hears, threshold * rng.uniform(1.1, 3.0, (*shape, e)), statistic[tested])
    ended = np.zeros((*shape, e))
    ended[:, 2 * steps // 3] = hears & (scheme in ("aime-improved", "exclude"))
    log.arrays |= {f"monitor_{key}": value for key, value in statistic.items()}
    log.arrays |= {f"monitor_{key}_rows": np.broadcast_to(rows, (*shape, e)) for key in statistic}
    log.arrays |= {
        "fault": fault, "monitor_threshold": threshold, "monitor_alarm": statistic[tested] >= threshold, "monitor_ended": ended,
        "excluded": np.broadcast_to(late[:, None] & heard, (*shape, slots)) if scheme == "exclude" else np.zeros((*shape, slots)),
        "isolation": rng.uniform(0, 1, (*shape, slots)) + 10.0 * (late[:, None] & heard),
    }
    if scheme == "exclude":
        log.arrays["end_ratio"] = rng.uniform(0, 1, (*shape, slots))
    if scheme == "aime-improved":
        log.arrays |= {"monitor_rho": rng.uniform(1, 9, (*shape, e)), "monitor_median": rng.uniform(1, 9, (*shape, e))}
    log.dtypes |= dict.fromkeys(("monitor_alarm", "monitor_ended", "excluded"), "u1") | {"fault": "<f8"}
    log.dtypes |= dict.fromkeys(("monitor_rctm_rows", "monitor_aime_rows"), "<u4")
    log.dtypes |= dict.fromkeys((key for key in log.arrays if key not in log.dtypes and key.startswith(("monitor_", "isol", "end_r"))), real)
    return log


class NavigationLog(Log):
    """Five satellites, one of which is not seen at first, and one that moves. Estimates beyond the angle of 180 degrees, too."""

    first_step = 1

    def __init__(self, steps=30, *, filter="rekf-t", real="float64", truth=True, seed=5, start_s=10.0, bands=True):
        rng, nodes, n = np.random.default_rng(seed), len(NUMBERS), 17
        self.real, self.end, self.dtypes = real, "complete", {}
        self.scenario = {
            "name": "synthetic flight", "model": {"navigation": {"start_s": start_s}}, "edges": [],
            "nodes": [{"satellite": k, "elevation_deg": 20 + 10 * i, "azimuth_deg": 70 * i, "sigma_m": 2.5} for i, k in enumerate(NUMBERS)],
        }
        self.header = {
            "format": "meshkal-log", "format_version": 1, "program": "meshkal 0.0.0", "kind": "navigation", "filter": filter, "real": real,
            "source": "drawn" if truth else "recorded", "seed": seed, "runs": 1, "steps": steps, "loss": 0.0, "dt_s": 1.0, "start_s": start_s,
            "states": n, "positions": 3, "nodes": nodes, "estimators": 1, "rows": [1] * nodes, "slots": [list(range(nodes))],
            "satellites": list(NUMBERS),
        }
        shape, every = (1, steps), (1, steps, nodes)
        arrived = np.ones(every)
        arrived[:, :4, 2] = 0
        x = rng.normal(0, 1, (*shape, n))
        x[..., 2] = 3.14
        x[..., 9:15] *= 1e-4
        estimate = x + rng.normal(0, 0.1, x.shape) * np.where(np.arange(n) < 9, 1.0, 1e-5)
        estimate[..., 2] = -3.14
        azimuth = np.broadcast_to([70.0 * i for i in range(nodes)], every).copy()
        azimuth[..., 4] += 0.5 * np.arange(steps)
        elevation = np.broadcast_to([20.0 + 10 * i for i in range(nodes)], every).copy()
        azimuth[:, :4, 2] = elevation[:, :4, 2] = np.nan
        root = rng.normal(0, 1, (*shape, 3, 3))
        rows, columns = np.tril_indices(3)
        weight = np.where(rng.random(every) < 0.3, rng.uniform(0.1, 0.9, every), 1.0) * arrived
        weight[:, 5, 1] = 0.0
        self.arrays = {
            "time_s": (start_s + 1.0 + np.arange(steps))[None, :, None], "measurements": np.where(arrived > 0, 2e7 + rng.normal(0, 9, every), np.nan),
            "measurements_arrived": arrived, "decision": np.where(arrived > 0, np.where(weight < 1, np.where(weight > 0, 3, 2), 1), 0),
            "estimate": estimate, "trace_covariance": rng.uniform(1, 2, (*shape, 1)),
            "position_covariance": (root @ np.swapaxes(root, -1, -2))[..., rows, columns], "nis": rng.chisquare(5, (*shape, 1)),
            "nis_rows": np.full((*shape, 1), 5), "innovation": np.where(arrived > 0, rng.normal(0, 3, every), np.nan),
            "azimuth_deg": azimuth, "elevation_deg": elevation, "faults": np.zeros((*shape, 1)),
        }
        if filter != "ekf":
            self.arrays |= {"weight": weight, "weight_statistic": rng.normal(0, 1, every)}
        if truth:
            self.arrays |= {"truth": x, "error": np.linalg.norm((estimate - x)[..., 6:9], axis=2)[..., None], "nees": rng.chisquare(n, (*shape, 1))}

        if bands:
            self.arrays["variance"] = rng.dirichlet(np.full(n, 5.0), shape) * self.arrays["trace_covariance"]

    def dtype(self, key: str) -> str:
        if key in ("measurements_arrived", "decision"):
            return "u1"
        if key in ("nis_rows", "faults"):
            return "<u4"
        double = ("time_s", "truth", "error", "nees", "measurements", "estimate", "azimuth_deg", "elevation_deg")
        return "<f8" if key in double or self.real == "float64" else "<f4"
