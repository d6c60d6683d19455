# SPDX-License-Identifier: MIT
"""Consensus and observability of tracking scenarios in NumPy: weights of the protocols, models with numerical Jacobians, singular values of stacked
windows, and the comparison of all that with what `meshkal design` says of a trajectory."""
import math

import numpy as np


def adjacency(s):
    hears = np.zeros((len(s["nodes"]),) * 2)
    for a, b in s["edges"]:
        hears[a, b] = hears[b, a] = 1
    return hears


def paper(hears, measures):
    P = hears + np.diag(np.asarray(measures, float))
    return P / P.sum(axis=1, keepdims=True)


def metropolis(hears):
    d = hears.sum(axis=1)
    W = np.where(hears > 0, 1 / (1 + np.maximum.outer(d, d)), 0.0)
    return W + np.diag(1 - W.sum(axis=1))


def ratio(hears):
    """Equal shares to the neighbours and to itself: columns sum to 1."""
    A = hears + np.eye(len(hears))
    return A / A.sum(axis=0)


def second(P):
    return np.sort(np.abs(np.linalg.eigvals(P)))[-2]


SENSORS = {
    "range": lambda p, v, node: [np.linalg.norm(p - node["position_m"])],
    "bearing": lambda p, v, node: angles(p - node["position_m"]),
    "range-bearing": lambda p, v, node: [np.linalg.norm(p - node["position_m"]), *angles(p - node["position_m"])],
    "range-rate": lambda p, v, node: [(p - node["position_m"]) @ v / np.linalg.norm(p - node["position_m"])],
    "tdoa": lambda p, v, node: [np.linalg.norm(p - node["position_m"]) - np.linalg.norm(p - node["reference_m"])],
}


def angles(d):
    return [math.atan2(d[1], d[0]), *([math.atan2(d[2], math.hypot(d[0], d[1]))] if len(d) == 3 else [])]


def split(s, x):
    names = s["model"]["states"]
    axes = "xyz"[:3 if "pz" in names else 2]
    return np.array([x[names.index("p" + a)] for a in axes]), np.array([x[names.index("v" + a)] for a in axes])


def move(s, x, dt):
    """The turn by Runge-Kutta: independent of the closed form."""
    names = s["model"]["states"]
    p, v = ([names.index(k + a) for a in ("xyz" if "pz" in names else "xy")] for k in "pv")

    def rate(x):
        d, omega = np.zeros(len(x)), x[names.index("omega")] if s["model"]["motion"] == "constant-turn" else 0.0
        d[p] = x[v]
        d[v[0]], d[v[1]] = -omega * x[v[1]], omega * x[v[0]]
        return d
    x = np.array(x, float)
    for _ in range(20):
        h = dt / 20
        a = rate(x)
        b = rate(x + h / 2 * a)
        c = rate(x + h / 2 * b)
        x = x + h / 6 * (a + 2 * b + 2 * c + rate(x + h * c))
    return x


def derivative(f, x):
    """Richardson's extrapolation of central differences; differences of angles the short way."""
    x, columns = np.asarray(x, float), []
    for i in range(len(x)):
        def slope(h, e=np.eye(len(x))[i]):
            return (np.array(f(x + h * e)) - np.array(f(x - h * e))) / (2 * h)
        h = 1e-3 * max(1, abs(x[i]))
        columns.append((4 * slope(h / 2) - slope(h)) / 3)
    return np.array(columns).T


def in_range(s, node, x):
    return node["sensor"] != "none" and np.linalg.norm(split(s, x)[0] - node["position_m"]) <= node.get("range_limit_m", math.inf)


def derivatives(s, path, times):
    """H of every step and node, weighted by R (None: out of range), and Phi from every step to the next."""
    H = [[np.linalg.solve(np.linalg.cholesky(np.array(node["R"])), derivative(lambda x: SENSORS[node["sensor"]](*split(s, x), node), x))
          if in_range(s, node, x) else None for node in s["nodes"]] for x in path]
    return H, [derivative(lambda x: move(s, x, b - a), x) for a, b, x in zip(times, times[1:], path)]


def windows(s, known, length, members):
    """Eigenvalues of P0 against I of every window, ascending: squared singular values of stacked rows."""
    (H, Phi), root, out = known, np.linalg.cholesky(np.array(s["model"]["P0"])), []
    for begin in range(len(H) - length + 1):
        moved, rows = root, [np.zeros((len(root), len(root)))]
        for t in range(begin, begin + length):
            rows += [H[t][k] @ moved for k in members if H[t][k] is not None]
            moved = Phi[t] @ moved if t < len(Phi) else moved
        out.append(np.sort(np.linalg.svd(np.vstack(rows), compute_uv=False) ** 2))
    return np.array(out)


def runs(flags):
    out = []
    for t, flag in enumerate(flags, 1):
        if flag and out and out[-1][1] == t - 1:
            out[-1][1] = t
        elif flag:
            out.append([t, t])
    return out


def mean_path(s):
    path = [np.array(s["model"]["x0"], float)]
    for _ in range(s["steps"]):
        path.append(move(s, path[-1], s["model"].get("dt_s", 1.0)))
    return np.array(path[1:])


def check_sight(s, sight, path, times, length):
    n, hears = len(s["model"]["x0"]), adjacency(s)
    known = derivatives(s, path, times)
    values = windows(s, known, length, range(len(s["nodes"])))
    seen = (values > 1e-10 * values[:, -1:]).sum(axis=1)
    net = sight["network"]
    assert net["states_seen_by_window"] == seen.tolist()
    full = seen == n
    assert np.allclose(np.array(net["eigenvalue_by_window"])[full], values[full, 0], rtol=2e-6, atol=0)
    assert np.allclose([c for c in net["condition_by_window"] if c is not None], values[full, -1] / values[full, 0], rtol=2e-6)
    assert (np.array(net["eigenvalue_by_window"])[~full] == 0).all() and net["windows_unseen"] == (~full).sum()
    assert net["unseen"] == runs(~full) and net["least_states_seen"] == seen.min()
    measuring = [[in_range(s, node, x) for node in s["nodes"]] for x in path]
    assert sight["measuring_nodes"] == [sum(m) for m in measuring]
    assert sight["fewer_than_two_measure"] == runs([sum(m) < 2 for m in measuring])
    assert sight["nobody_measures"] == runs([sum(m) == 0 for m in measuring])
    for k, node in enumerate(sight["nodes"]):
        members = [k, *np.nonzero(hears[k])[0]]
        own = windows(s, known, length, members)
        own_seen = (own > 1e-10 * own[:, -1:]).sum(axis=1)
        assert node["steps_measured"] == sum(m[k] for m in measuring)
        assert node["steps_heard"] == sum(any(m[j] for j in members) for m in measuring)
        assert (node["windows_unseen"], node["least_states_seen"]) == ((own_seen < n).sum(), own_seen.min())
        if (own_seen == n).all():
            worst = own[:, 0].argmin()
            assert abs(node["smallest_eigenvalue"] / own[worst, 0] - 1) < 2e-6
            assert abs(own[node["worst_window"] - 1, 0] / own[worst, 0] - 1) < 2e-6
        else:
            assert node["smallest_eigenvalue"] == 0 and node["worst_window"] == (own_seen < n).argmax() + 1
    return values
