# SPDX-License-Identifier: MIT
"""Random scenarios as plain dictionaries, ready for json.dump. The same arguments give the same scenario.

Every neighbourhood can observe the whole state (rank test): the theory asks for it, and without it a node has no
steady state to compare.
"""
import numpy as np

from reference import Network, NotConverged, design, observability_rank


# --- graphs --------------------------------------------------------------------------------------------------------

def connected(N, edges):
    reached, frontier = {0}, [0]
    while frontier:
        i = frontier.pop()
        for a, b in edges:
            for j in ((b,) if a == i else (a,) if b == i else ()):
                if j not in reached:
                    reached.add(j)
                    frontier.append(j)
    return len(reached) == N


def geometric(rng, N, mean_degree):
    """Points in the unit square; the closest pairs are joined until the mean degree, node included, is reached."""
    count = round(N * (mean_degree - 1) / 2)
    pairs = [(i, j) for i in range(N) for j in range(i + 1, N)]
    while True:
        X = rng.uniform(size=(N, 2))
        edges = sorted(sorted(pairs, key=lambda p: np.linalg.norm(X[p[0]] - X[p[1]]))[:count])
        if connected(N, edges):
            return X, edges


def graph(rng, kind, N):
    X = rng.uniform(size=(N, 2))
    if kind == "single":
        return X[:1], []
    if kind == "ring":
        return X, [(i, (i + 1) % N) for i in range(N)]
    if kind == "path":
        return X, [(i, i + 1) for i in range(N - 1)]
    if kind == "star":
        return X, [(0, i) for i in range(1, N)]
    if kind == "complete":
        return X, [(i, j) for i in range(N) for j in range(i + 1, N)]
    if kind == "geometric":
        return geometric(rng, N, min(N, 3.5))
    raise ValueError(kind)


# --- models --------------------------------------------------------------------------------------------------------

def spd(rng, n, scale):
    """A full, correlated covariance whose condition stays moderate."""
    X = rng.standard_normal((n, n)) + np.eye(n)
    return scale * (X @ X.T / n + 0.2 * np.eye(n))


def dynamics(rng, kind, n):
    if kind == "integrating":                             # a chain of integrators, slightly coupled
        return np.eye(n) + 0.2 * np.eye(n, k=-1) if n > 1 else np.eye(1)
    A = rng.standard_normal((n, n))
    A *= {"stable": 0.9, "unstable": 1.06}[kind] / max(abs(np.linalg.eigvals(A)))
    return A


def observable(scenario):
    net = Network(scenario)
    return all(observability_rank(net.A, net.stack(net.near[k])[0]) == net.n for k in range(net.N))


def with_weights(rng, scenario, weights):
    """`weights` is a rule's name, or "matrix" for random columns, every member of a neighbourhood positive."""
    if weights == "matrix":
        scenario["weights"] = "uniform"
        W = np.zeros((len(scenario["nodes"]),) * 2)
        for k, nodes in enumerate(Network(scenario).near):
            W[nodes, k] = rng.dirichlet(np.full(len(nodes), 3.0))
        weights = W.tolist()
    scenario["weights"] = weights
    return scenario


def random_scenario(name, seed, n, dynamic, kind, N, weights, tolerance, steps=40, noise=0.05, check=False):
    """`check`: draw again until the central filter and every node have a steady state. Needed for large tolerances only."""
    rng = np.random.default_rng(seed)
    while True:
        X, edges = graph(rng, kind, N)
        nodes = []
        for x in X:
            rows = int(rng.integers(1, 4))
            C = rng.standard_normal((rows, n))
            C[rng.uniform(size=C.shape) < 0.3] = 0.0      # sensors do not see every state
            nodes.append({"C": C.tolist(), "R": spd(rng, rows, 0.5).tolist(), "position_m": (100 * x).tolist()})
        scenario = {
            "name": name,
            "model": {"A": dynamics(rng, dynamic, n).tolist(), "Q": spd(rng, n, noise).tolist(),
                      "input": rng.normal(scale=0.2, size=n).tolist(), "x0": rng.normal(size=n).tolist(),
                      "P0": spd(rng, n, 1.0).tolist(), "dt_s": 0.2, "position_states": list(range(min(n, 3)))},
            "nodes": nodes, "edges": [list(map(int, e)) for e in edges], "weights": "uniform",
            "tolerance": tolerance, "steps": steps, "seed": seed}
        # A row of zeros would be a sensor that measures nothing.
        if min(np.linalg.norm(c) for v in nodes for c in v["C"]) < 0.2 or not observable(scenario):
            continue
        scenario = with_weights(rng, scenario, weights)
        if check:
            try:
                design(scenario)
            except NotConverged:
                continue
        return scenario


def projectile(name, seed, N=20, tolerance=0.02, mean_degree=5.0, complete=False, weights="relative-degree", steps=100):
    """The published experiment with a draw of its own."""
    rng = np.random.default_rng(seed)
    delta = 0.1
    A = np.eye(6)
    A[3:, :3] = delta * np.eye(3)
    X, edges = geometric(rng, N, mean_degree)
    if complete:
        edges = [(i, j) for i in range(N) for j in range(i + 1, N)]
    noise = np.array([rng.permutation([0.5, 2.0, 3.5]) for _ in range(N)])
    while True:
        nodes = []
        for k in range(N):
            pair = np.sort(rng.choice(3, 2, replace=False))
            C = np.zeros((2, 6))
            C[[0, 1], 3 + pair] = 1.0
            nodes.append({"C": C.tolist(), "R": np.diag(np.sqrt(k + 1) * noise[k, pair]).tolist(),
                          "position_m": (1000 * X[k]).tolist()})
        scenario = {
            "name": name,
            "model": {"A": A.tolist(), "Q": (0.001 * np.eye(6)).tolist(), "input": [0.0, 0.0, -10 * delta, 0.0, 0.0, 0.0],
                      "x0": [10.0, 5.0, 40.0, 0.0, 0.0, 0.0], "P0": np.eye(6).tolist(), "dt_s": delta,
                      "position_states": [3, 4, 5]},
            "nodes": nodes, "edges": [list(map(int, e)) for e in edges], "weights": "uniform",
            "tolerance": tolerance, "steps": steps, "seed": seed}
        net = Network(scenario)
        if all(all(net.stack(s)[0][:, i].any() for i in (3, 4, 5)) for s in net.near) and observable(scenario):
            return with_weights(rng, scenario, weights)


def blind_node():
    """Node 0 and its only neighbour see the first state; the second, slow one is invisible to node 0 and inflated at each step."""
    def cell(i, j):
        return {"C": [[float(i), float(j)]], "R": [[0.1]], "position_m": [0.0, 0.0]}
    return {"name": "blind-node",
            "model": {"A": [[0.9, 0.0], [0.0, 0.999]], "Q": [[0.1, 0.0], [0.0, 0.1]], "input": [0.0, 0.0], "x0": [0.0, 0.0],
                      "P0": [[1.0, 0.0], [0.0, 1.0]], "dt_s": 1.0, "position_states": [0]},
            "nodes": [cell(1, 0), cell(1, 0), cell(0, 1)], "edges": [[0, 1], [1, 2]], "weights": "uniform",
            "tolerance": 0.5, "steps": 20, "seed": 1}


# --- the collection ------------------------------------------------------------------------------------------------

MAKERS = {
    "projectile": lambda s: projectile(s, 1),
    "projectile-8": lambda s: projectile(s, 2, N=8, mean_degree=4.0, tolerance=1e-6, weights="metropolis"),
    "projectile-complete": lambda s: projectile(s, 3, N=8, complete=True, weights="uniform"),
    "n1-stable-ring": lambda s: random_scenario(s, 11, 1, "stable", "ring", 5, "uniform", 0.5, check=True),
    "n1-integrating-single": lambda s: random_scenario(s, 12, 1, "integrating", "single", 1, "relative-degree", 0.02),
    "n2-unstable-star": lambda s: random_scenario(s, 13, 2, "unstable", "star", 6, "metropolis", 0.02),
    "n2-stable-path-zero": lambda s: random_scenario(s, 14, 2, "stable", "path", 4, "matrix", 0.0),
    "n3-integrating-complete": lambda s: random_scenario(s, 15, 3, "integrating", "complete", 5, "uniform", 0.02),
    "n3-unstable-geometric": lambda s: random_scenario(s, 16, 3, "unstable", "geometric", 9, "matrix", 1e-6),
    "n4-stable-path": lambda s: random_scenario(s, 17, 4, "stable", "path", 6, "relative-degree", 0.5, check=True),
    "n4-integrating-ring": lambda s: random_scenario(s, 18, 4, "integrating", "ring", 6, "metropolis", 1e-6),
    "n6-unstable-geometric": lambda s: random_scenario(s, 19, 6, "unstable", "geometric", 10, "relative-degree", 0.02,
                                                       check=True),
    "n6-stable-star": lambda s: random_scenario(s, 20, 6, "stable", "star", 7, "matrix", 0.5, check=True),
    "n9-stable-ring": lambda s: random_scenario(s, 21, 9, "stable", "ring", 7, "metropolis", 0.02, check=True),
    "n9-unstable-complete": lambda s: random_scenario(s, 22, 9, "unstable", "complete", 4, "matrix", 0.02, check=True),
    "n9-integrating-single": lambda s: random_scenario(s, 23, 9, "integrating", "single", 1, "uniform", 1e-6),
    "n6-integrating-path": lambda s: random_scenario(s, 24, 6, "integrating", "path", 5, "uniform", 0.0),
}
_made = {}


def scenario(name):
    if name not in _made:
        _made[name] = MAKERS[name](name)
    return _made[name]


def cycling_node():
    """A tolerance so large that node 6 alternates between two covariances for ever: bounded, yet without a steady state."""
    return {**scenario("n6-stable-star"), "name": "cycling-node", "tolerance": 50.0}
