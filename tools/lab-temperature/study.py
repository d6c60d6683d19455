#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Filters on real readings: temperatures of a sensor network, fitted on day one, tested on the rest.

The first day (48 half hours) fits everything: offsets, noise, model, tolerance. Later days are only used to score.
README.md beside this file says what the result does and does not show.
"""
import argparse
import csv
import json
import math
import os
import subprocess
import sys

import numpy as np
from scipy.optimize import minimize
from scipy.stats import chi2

HERE = os.path.dirname(os.path.abspath(__file__))
ROOT = os.path.dirname(os.path.dirname(HERE))
DAY = 48                      # half hours
DT_S = 1800
FILTERS = ("kfc", "rkfc", "kfd", "rkfdu", "rkfdnu", "rkfdnu2")
REACH = 2                     # the ring joins each mote to this many before and after it
Q_DIVISOR = 10                # the wrong model of the second run

# Limits of the search, not tuned. A slope that alternates in sign is no temperature, and at 1 the slope would have no
# stationary variance to start from. A process noise under a hundredth of a degree cannot be seen in readings of a
# tenth of a degree; the floor keeps Q positive definite when the likelihood would rather have one noise at zero.
PHI_LIMITS = (0.0, 0.99)
Q_LIMITS = (1e-4, 1e2)
CONFIDENCE = 0.95             # of the region of models that the tolerance covers


class StudyError(Exception):
    """Something the user can put right: input, binary or its output."""


def read_csv(path):
    """Readings as motes x half hours; an empty cell or "nan" is a missing reading."""
    rows = []
    try:
        with open(path, newline="", encoding="utf-8") as f:
            lines = csv.reader(f)
            for cells in filter(None, lines):
                where = "%s: line %d" % (path, lines.line_num)
                if rows and len(cells) != len(rows[0]):
                    raise StudyError("%s has %d cells, the lines before it %d" % (where, len(cells), len(rows[0])))
                row = []
                for column, cell in enumerate(cells, 1):
                    try:
                        row.append(float(cell) if cell.strip() else math.nan)
                    except ValueError:
                        raise StudyError("%s, cell %d: not a number: %r" % (where, column, cell)) from None
                    if math.isinf(row[-1]):
                        raise StudyError("%s, cell %d: infinite" % (where, column))
                rows.append(row)
    except (OSError, UnicodeDecodeError, csv.Error) as e:
        raise StudyError("cannot read %s: %s" % (path, e)) from None
    if len(rows) < 3 or len(rows[0]) < 2 * DAY:
        raise StudyError("%s: %d motes, %d half hours; at least 3 motes and two days (%d half hours) are needed"
                         % (path, len(rows), len(rows[0]) if rows else 0, 2 * DAY))
    y = np.array(rows)
    if np.isnan(y).all(axis=0).any():
        raise StudyError("%s: column %d has no reading at all" % (path, np.isnan(y).all(axis=0).argmax() + 1))
    few = np.isfinite(y[:, :DAY]).sum(axis=1) < 2
    if few.any():
        raise StudyError("%s: row %d has fewer than two readings on day one: no offset" % (path, few.argmax() + 1))
    return y


def fit_offsets(y):
    """Offsets of the motes (their sum is zero) and the variance R of what level + offset leaves over.

    Least squares of a two-way table: without gaps each mote's mean minus the mean of all. Gaps need the loop.

    One R for all motes: the level is the plain mean, so a mean with unequal weights would aim at another quantity than
    the one scored; and one day of strongly correlated deviations says little about 50 variances.
    """
    offset = np.zeros(y.shape[0])
    for _ in range(1000):
        level = np.nanmean(y - offset[:, None], axis=0)
        new = np.nanmean(y - level, axis=1)
        new -= new.mean()
        offset, old = new, offset
        if np.allclose(offset, old, rtol=0, atol=1e-12):
            break
    residual = y - offset[:, None] - np.nanmean(y - offset[:, None], axis=0)
    freedom = np.isfinite(y).sum() - y.shape[0] - y.shape[1] + 1
    r = np.nansum(residual ** 2) / freedom if freedom > 0 else 0.0
    if not r > 1e-9:
        raise StudyError("the motes do not differ on day one beyond constant offsets: no noise to fit")
    return offset, float(r)


def filter_mean(mean, r, phi, q_level, q_slope):
    """Kalman filter of [level, slope] on the network mean, written out in scalars.

    mean[t] measures the level with variance r[t]. Starts on the first mean and the stationary variance of the slope, so
    no number is chosen for it. Returns the log likelihood of mean[1:] given mean[0] and the prediction of the step
    after the last.
    """
    level, slope = mean[0], 0.0
    a, b, d = r[0], 0.0, q_slope / (1 - phi * phi)          # covariance [[a, b], [b, d]]
    log_likelihood = 0.0
    for t in range(1, len(mean) + 1):
        level, slope = level + slope, phi * slope
        a, b, d = a + 2 * b + d + q_level, phi * (b + d), phi * phi * d + q_slope
        if t == len(mean):
            break
        s = a + r[t]
        e = mean[t] - level
        log_likelihood -= 0.5 * (math.log(2 * math.pi * s) + e * e / s)
        level, slope = level + a / s * e, slope + b / s * e
        a, b, d = a * r[t] / s, b * r[t] / s, d - b * b / s
    return log_likelihood, (level, slope), ((a, b), (b, d))


def fit_process(mean, r):
    """phi, q_level, q_slope of greatest innovation likelihood.

    A random walk (phi = 0) and, nearly, a level with an undamped slope (phi = 1) are both inside this family, so the
    day itself chooses between them.
    """
    mean, r = [float(v) for v in mean], [float(v) for v in r]
    variance = max(float(np.var(np.diff(mean))), 10 * Q_LIMITS[0])
    bounds = [PHI_LIMITS] + [tuple(math.log(v) for v in Q_LIMITS)] * 2

    def cost(p):
        return -filter_mean(mean, r, p[0], math.exp(p[1]), math.exp(p[2]))[0]

    best = None
    # Starts only, the best end counts: phi, and the share of the level in the variance of one step.
    for phi, share in ((0.1, 0.1), (0.1, 0.9), (0.5, 0.1), (0.5, 0.9), (0.9, 0.1), (0.9, 0.9)):
        start = [phi, math.log(share * variance), math.log((1 - share) * variance * (1 - phi * phi))]
        start = [min(max(v, low), high) for v, (low, high) in zip(start, bounds)]
        end = minimize(cost, start, method="L-BFGS-B", bounds=bounds)
        if np.isfinite(end.fun) and (best is None or end.fun < best.fun):
            best = end
    if best is None:
        raise StudyError("the model cannot be fitted to day one")
    return float(best.x[0]), math.exp(best.x[1]), math.exp(best.x[2])


def fit_tolerance(steps):
    """Tolerance c, in the unit of the filters (twice the relative entropy of one step, in nats).

    By Wilks, twice the relative entropy between the fitted model and the model that the day was drawn from, summed over
    the fitted steps, is about chi-squared with as many degrees of freedom as parameters fitted. The ball that holds
    the true model with 95 % confidence has therefore the radius below for each step. Three parameters (phi, q_level,
    q_slope) shape the law of the state; offsets and R shape the readings, which the filters take as given. No
    error of prediction was looked at to choose it.
    """
    return float(chi2.ppf(CONFIDENCE, 3) / steps)


def fit(day):
    """Everything that is fitted, from day one alone; x0 and P0 are the prediction for the first step of day two."""
    offset, r = fit_offsets(day)
    mean = np.nanmean(day - offset[:, None], axis=0)
    r_mean = r / np.isfinite(day).sum(axis=0)
    phi, q_level, q_slope = fit_process(mean, r_mean)
    log_likelihood, x0, p0 = filter_mean(mean, r_mean, phi, q_level, q_slope)
    return {"offsets": offset.tolist(), "R": r, "phi": phi, "q_level": q_level, "q_slope": q_slope,
            "tolerance": fit_tolerance(day.shape[1] - 1), "log_likelihood": float(log_likelihood),
            "x0": np.array(x0).tolist(), "P0": np.array(p0).tolist()}


def ring(motes):
    """Edges of the ring, each once, also when the ring is so short that both ways round meet."""
    edges = {tuple(sorted((k, (k + d) % motes))) for k in range(motes) for d in range(1, REACH + 1)}
    return sorted(list(e) for e in edges if e[0] != e[1])


def scenario(name, fitted, motes, steps, divisor):
    return {"name": name,
            "model": {"A": [[1.0, 1.0], [0.0, fitted["phi"]]],
                      "Q": [[fitted["q_level"] / divisor, 0.0], [0.0, fitted["q_slope"] / divisor]],
                      "input": [0.0, 0.0], "x0": fitted["x0"], "P0": fitted["P0"], "dt_s": DT_S},
            "nodes": [{"C": [[1.0, 0.0]], "R": [[fitted["R"]]]} for _ in range(motes)],
            "edges": ring(motes), "weights": "relative-degree",
            "tolerance": fitted["tolerance"], "steps": steps, "seed": 1}


def persistence(y, mean):
    """Scores of predictions that need no model, on the same steps as the filters (all after day one)."""
    truth = mean[DAY:]
    near = np.eye(y.shape[0])
    for i, j in ring(y.shape[0]):
        near[i, j] = near[j, i] = 1
    with np.errstate(invalid="ignore"):           # 0 / 0 where a whole neighbourhood is missing: not scored
        local = near @ np.nan_to_num(y) / (near @ np.isfinite(y))
    slope = 2 * mean[DAY - 1:-1] - mean[DAY - 2:-2]
    guess = {"persistence": mean[DAY - 1:-1], "constant_slope": slope, "neighbourhood": local[:, DAY - 1:-1]}
    return {name: float(np.sqrt(np.nanmean((g - truth) ** 2))) for name, g in guess.items()}


def write_json(out, name, value):
    with open(os.path.join(out, name), "w", encoding="utf-8") as f:
        json.dump(value, f, indent=1)


def write_inputs(out, y, mean):
    """The model has no term for offsets, so the readings go out without them."""
    with open(os.path.join(out, "measurements.csv"), "w", encoding="utf-8") as f:
        f.write("t,node,row,value\n")
        for t in range(DAY, y.shape[1]):
            for k in np.flatnonzero(np.isfinite(y[:, t])):
                f.write("%d,%d,0,%.10g\n" % (t - DAY, k, y[k, t]))
    with open(os.path.join(out, "truth.csv"), "w", encoding="utf-8") as f:
        f.write("t,state,value\n")
        f.writelines("%d,0,%.10g\n" % pair for pair in enumerate(mean[DAY:]))


def simulate(meshkal, out, name):
    """Run all six filters; RMSE of the level for each."""
    result = os.path.join(out, name + "-result.json")
    command = [meshkal, "simulate", os.path.join(out, name + ".json"), "--filter", "all", "--json", result,
               "--measurements", os.path.join(out, "measurements.csv"), "--truth", os.path.join(out, "truth.csv")]
    if os.path.exists(result):
        os.remove(result)             # an old result must not pass for a new one
    try:
        run = subprocess.run(command, capture_output=True, text=True, errors="replace", timeout=600)
    except (OSError, subprocess.TimeoutExpired) as e:
        raise StudyError("cannot run %s: %s" % (meshkal, e)) from None
    if run.returncode:
        raise StudyError("%s: status %d:\n%s" % (" ".join(command), run.returncode, run.stderr[-2000:].strip()))
    try:
        with open(result, encoding="utf-8") as f:
            scores = {item["filter"]: float(item["state_rmse"][0]) for item in json.load(f)["filters"]}
    except (OSError, ValueError, KeyError, IndexError, TypeError) as e:
        raise StudyError("%s wrote no usable result to %s: %r" % (meshkal, result, e)) from None
    for f in FILTERS:
        if not math.isfinite(scores.get(f, math.nan)):
            raise StudyError("%s: no error of the level for %s" % (result, f))
    return {f: scores[f] for f in FILTERS}


def report(r):
    """The table and what it says, from the numbers alone."""
    base, near, fitted = r["baselines"]["persistence"], r["baselines"]["neighbourhood"], r["fitted"]
    right, wrong = r["filters"], r["filters_q10"]

    def gain(error):
        return 100 - 100 * error / base

    print("Real input: %d motes, fitted on day one, tested on the next %d half hours" % (r["motes"], r["steps"]))
    noise = tuple(fitted[v] ** 0.5 for v in ("q_level", "q_slope", "R"))
    print("level + damped slope: phi %.3f, noise sd of level %.3f, slope %.3f, mote %.2f C; tolerance c %.3f\n"
          % (fitted["phi"], *noise, fitted["tolerance"]))
    print("One-step prediction (30 min) of the network mean; gain is the cut in error against persistence")
    print("%-34s RMSE [C]   gain" % "")
    line = "%-34s %8.3f %5.0f%%"
    labels = ("last mean (persistence)", "last mean + last change", "last mean of what a mote hears")
    for label, error in zip(labels, r["baselines"].values()):
        print(line % (label, error, gain(error)))
    print("%-34s %15s   %15s" % ("", "fitted Q", "Q / %d" % Q_DIVISOR))
    for f in FILTERS:
        label = f + (" (hears all motes)" if f in FILTERS[:2] else " (hears its neighbours)")
        print((line + "   %8.3f %5.0f%%") % (label, right[f], gain(right[f]), wrong[f], gain(wrong[f])))
    best = min(FILTERS, key=right.get)
    print("\nBest filter: %s, which %s persistence." % (best, "beats" if right[best] < base else "does NOT beat"))
    for f, plain in (("rkfc", "kfc"), ("rkfdu", "kfd"), ("rkfdnu", "kfd"), ("rkfdnu2", "kfd")):
        print("%-8s against %s: error %+.1f%% with the fitted Q, %+.1f%% with Q / %d"
              % (f, plain, 100 * right[f] / right[plain] - 100, 100 * wrong[f] / wrong[plain] - 100, Q_DIVISOR))
    print("A mote does not see the network mean: judge kfd and rkfd* against the last mean it hears (%.3f C)." % near)


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("input", nargs="?", default=os.path.join(HERE, "temperature.csv"),
                        help="CSV, a row a mote, a column a half hour from 00:00, at least two days")
    parser.add_argument("--meshkal", default=os.path.join(ROOT, "build", "meshkal"), help="the simulator")
    parser.add_argument("--out", default=os.path.join(ROOT, "build", "lab-temperature"), help="folder for all results")
    args = parser.parse_args(argv)
    try:
        y = read_csv(args.input)
        if not (os.path.isfile(args.meshkal) and os.access(args.meshkal, os.X_OK)):
            raise StudyError("no simulator at %s (build it with make, or name it with --meshkal)" % args.meshkal)
        fitted = fit(y[:, :DAY])      # the only use of readings before scoring
        y = y - np.array(fitted["offsets"])[:, None]
        mean, steps = np.nanmean(y, axis=0), y.shape[1] - DAY
        os.makedirs(args.out, exist_ok=True)
        write_inputs(args.out, y, mean)
        results = {"motes": len(y), "steps": steps, "unit": "degree Celsius", "fitted": fitted,
                   "baselines": persistence(y, mean)}
        for key, name, divisor in (("filters", "scenario", 1), ("filters_q10", "scenario-q10", Q_DIVISOR)):
            title = "lab temperature, Q / %d" % divisor
            write_json(args.out, name + ".json", scenario(title, fitted, len(y), steps, divisor))
            results[key] = simulate(os.path.abspath(args.meshkal), args.out, name)
        write_json(args.out, "results.json", results)
        report(results)
    except (StudyError, OSError) as e:
        print("study.py: error: %s" % e, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
