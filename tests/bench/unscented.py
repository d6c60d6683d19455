# SPDX-License-Identifier: MIT
"""Meshkal's unscented and extended filters beside FilterPy and Stone Soup: equal on the same inputs, and time a step.

    PYTHONPATH=build/bench/python .venv/bin/python tests/bench/unscented.py build/bench

Reads what the programs unscented (unscented.c) and, if there, that of rust have written there. Prints tables, writes unscented-python.json. Exit status 1 if estimates or covariances
differ by more than 1e-9 standard deviations, never for a time. Both packages draw new sigma points from the predicted mean and covariance before
an update, as Meshkal does: FilterPy at the end of predict, Stone Soup in predict_measurement.
"""
import datetime
import json
import pathlib
import statistics
import sys
import time

import numpy as np

STEPS, ROWS, ROUNDS = 64, 3, 7
ALPHA, BETA = 0.5, 2.0  # as in unscented.h
LIMIT = 1e-9
START = datetime.datetime(2000, 1, 1)


def unpack(packed, n):
    full = np.zeros((n, n))
    full[np.tril_indices(n)] = packed
    return full + np.tril(full, -1).T


class Scene:
    def __init__(self, path):
        numbers = np.array(path.read_text().split(), float)
        self.at, self.numbers = 0, numbers
        n, bearings, self.dt, self.variance = self.take(4)
        self.name, self.n, self.bearings = path.stem.removeprefix("unscented-"), int(n), bool(bearings)
        half = self.n * (self.n + 1) // 2
        self.position = self.take(3 * ROWS).reshape(ROWS, 3)[:, :self.n // 2]
        self.x0, self.P0, self.Q = self.take(self.n), unpack(self.take(half), self.n), unpack(self.take(half), self.n)
        self.z = self.take(STEPS * ROWS).reshape(STEPS, ROWS)
        self.meshkal = {name: [(self.take(self.n), unpack(self.take(half), self.n)) for _ in range(STEPS)] for name in ("UKF", "UKF scaled", "EKF")}
        self.A = np.kron(np.eye(self.n // 2), [[1, self.dt], [0, 1]])
        self.R = self.variance * np.eye(ROWS)

    def take(self, count):
        self.at += count
        return self.numbers[self.at - count:self.at]

    def h(self, x):
        """Of one state, or of columns."""
        d = x[None, ::2] - (self.position if x.ndim == 1 else self.position[:, :, None])
        return np.arctan2(d[:, 1], d[:, 0]) if self.bearings else np.sqrt((d * d).sum(axis=1))

    def jacobian(self, x):
        d, H = x[None, ::2] - self.position, np.zeros((ROWS, self.n))
        square = (d * d).sum(axis=1)[:, None]
        H[:, ::2] = np.column_stack([-d[:, 1], d[:, 0]]) / square if self.bearings else d / np.sqrt(square)
        return H


def filterpy(scene, name):
    from filterpy.kalman import ExtendedKalmanFilter, JulierSigmaPoints, MerweScaledSigmaPoints, UnscentedKalmanFilter
    n = scene.n
    if name == "EKF":
        f = ExtendedKalmanFilter(n, ROWS)
        f.F, f.x = scene.A, scene.x0.copy()
    else:
        points = JulierSigmaPoints(n, 3 - n) if name == "UKF" else MerweScaledSigmaPoints(n, ALPHA, BETA, 3 - n)
        f = UnscentedKalmanFilter(n, ROWS, scene.dt, scene.h, lambda x, dt: scene.A @ x, points)
        f.x = scene.x0.copy()
    f.P, f.Q, f.R = scene.P0.copy(), scene.Q, scene.R
    for z in scene.z:
        f.predict()
        f.update(z, *((scene.jacobian, scene.h) if name == "EKF" else ()))
        yield f.x, f.P


def stone_soup(scene, name):
    from stonesoup.models.measurement.nonlinear import NonLinearGaussianMeasurement
    from stonesoup.models.transition.linear import CombinedLinearGaussianTransitionModel, ConstantVelocity
    from stonesoup.predictor.kalman import ExtendedKalmanPredictor, UnscentedKalmanPredictor
    from stonesoup.types.array import StateVector, StateVectors
    from stonesoup.types.detection import Detection
    from stonesoup.types.hypothesis import SingleHypothesis
    from stonesoup.types.state import GaussianState
    from stonesoup.updater.kalman import ExtendedKalmanUpdater, UnscentedKalmanUpdater

    class Sensors(NonLinearGaussianMeasurement):
        ndim_meas = ROWS

        def function(self, state, noise=False, **kwargs):
            x = np.asarray(state.state_vector, float)
            return StateVectors(scene.h(x)) if x.shape[1] > 1 else StateVector(scene.h(x))

        def jacobian(self, state, **kwargs):
            return scene.jacobian(np.asarray(state.state_vector, float)[:, 0])

    sensors = Sensors(ndim_state=scene.n, mapping=tuple(range(scene.n)), noise_covar=scene.R)
    moves = CombinedLinearGaussianTransitionModel([ConstantVelocity(scene.Q[1, 1]) for _ in range(scene.n // 2)])
    if name == "EKF":
        predictor, updater = ExtendedKalmanPredictor(moves), ExtendedKalmanUpdater(sensors)
    else:
        # The plain transform is the scaled one with alpha = 1, beta = 0.
        options = {"alpha": 1.0, "beta": 0.0} if name == "UKF" else {"alpha": ALPHA, "beta": BETA}
        options["kappa"] = 3 - scene.n
        predictor, updater = UnscentedKalmanPredictor(moves, **options), UnscentedKalmanUpdater(sensors, **options)
    state = GaussianState(scene.x0.reshape(-1, 1), scene.P0, timestamp=START)
    for t, z in enumerate(scene.z):
        now = START + datetime.timedelta(seconds=(t + 1) * scene.dt)
        prediction = predictor.predict(state, timestamp=now)
        state = updater.update(SingleHypothesis(prediction, Detection(StateVector(z), timestamp=now, measurement_model=sensors)))
        yield np.asarray(state.state_vector, float)[:, 0], np.asarray(state.covar, float)


def difference(ours, theirs):
    """Largest, in standard deviations and their products."""
    (x, P), (y, S) = ours, theirs
    sigma = np.sqrt(np.diag(P))
    return max(np.max(np.abs(x - y) / sigma), np.max(np.abs(P - S) / np.outer(sigma, sigma)))


def rust(path, native):
    """A table of what rust/src/main.rs measured."""
    if not path.exists():
        return
    print("\nCrates in Rust, built for this machine, their models inlined; ns a step (medians), float64. Their unscented filters take the propagated sigma points\n"
          "for the update and draw no new ones: less work, and another estimate.\n")
    print("| scene, states | filter | Meshkal unrolled, ns | crate | ns | times | difference |\n|---|---|---|---|---|---|---|")
    for line in path.read_text().splitlines():
        scene, n, name, bits, crate, ns, apart = line.split("|")
        ours = meshkal(native, scene, name)
        print(f"| {scene}, {n} | {name} | {ours:.0f} | {crate} | {ns} | {float(ns) / ours:.1f} | {apart} |")


def meshkal(native, scene, name):
    """ns of Meshkal's first."""
    return next(iter(next(row for row in native if (row["scene"], row["filter"], row["bits"]) == (scene, name, 64))["ns"].values()))


def main(folder):
    native = json.loads((folder / "unscented-native.json").read_text())
    rows, good = [], True
    rust(folder / "unscented-rust.txt", native)
    print("\nThe same filters in Python, microseconds a step in their own process (medians), and times Meshkal unrolled, called from C; float64.\n")
    print("| scene, states | filter | Meshkal, us | FilterPy, us | times | Stone Soup, us | times | difference: FilterPy | Stone Soup |\n|---|---|---|---|---|---|---|---|---|")
    for path in (folder / f"unscented-{name}.txt" for name in ("ranges", "bearings", "space")):
        scene = Scene(path)
        for name, ours in scene.meshkal.items():
            ns = meshkal(native, scene.name, name)
            cells, apart, record = [], [], {"scene": scene.name, "n": scene.n, "filter": name, "meshkal_us": ns / 1e3}
            for title, run in (("FilterPy", filterpy), ("Stone Soup", stone_soup)):
                most = max(difference(a, b) for a, b in zip(ours, run(scene, name), strict=True))
                times = []
                for _ in range(ROUNDS):
                    begin = time.perf_counter()
                    for _ in run(scene, name):
                        pass
                    times.append((time.perf_counter() - begin) / STEPS * 1e6)
                us = statistics.median(times)
                record[title] = {"us": us, "times": us * 1e3 / ns, "difference": most}
                cells += [f"{us:.0f}", f"{us * 1e3 / ns:.0f}"]
                apart.append(f"{most:.1e}")
                if not most <= LIMIT:
                    print(f"unscented: {scene.name}, {name}: {title} differs from Meshkal by {most:.2g} standard deviations, more than {LIMIT:g}", file=sys.stderr)
                    good = False
            rows.append(record)
            print(f"| {scene.name}, {scene.n} | {name} | {ns / 1e3:.2f} | " + " | ".join(cells + apart) + " |", flush=True)
    (folder / "unscented-python.json").write_text(json.dumps(rows, indent=1) + "\n")
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main(pathlib.Path(sys.argv[1])))
