# SPDX-License-Identifier: MIT
"""Dense reference of the robust distributed Kalman filter with local tolerances.

Written from the definitions alone (Emanuele, Gasparotto, Guerra, Zorzi, Sensors 20(11):3244, 2020): large stacked
matrices, eigenvalues and general-purpose root finders, where the product uses small factorisations. Slow on purpose:
two programs that share no formula beyond the definition can only agree if both are right.

A tolerance c is twice the Kullback-Leibler divergence in nats everywhere. Matrices named as in the paper. Nodes count
from 0. A neighbourhood contains the node itself.
"""
from functools import lru_cache
import json

import numpy as np
from scipy.linalg import block_diag, cholesky, eigh, solve_discrete_are, solve_triangular
from scipy.optimize import brentq

FILTERS = ("kfc", "rkfc", "kfd", "rkfdu", "rkfdnu", "rkfdnu2")
CENTRAL = ("kfc", "rkfc")


def sym(X):
    return (X + X.T) / 2


# --- tolerance and risk sensitivity --------------------------------------------------------------------------------

_K = np.arange(2, 30)
_SERIES = (-1.0) ** _K / _K


def excess(d):
    """Sum over i of d_i - log(1 + d_i), all d_i > -1. Near zero the two terms cancel, so the series takes over."""
    d = np.atleast_1d(np.asarray(d, float))
    small = np.abs(d) < 0.1
    near = d[small, None] ** _K @ _SERIES
    far = d[~small] - np.log1p(d[~small])
    return near.sum() + far.sum()


def gamma(P, theta):
    """log det(I - theta P) + tr[(I - theta P)^-1 - I]. With x = theta lam_i and d = x/(1-x) a term is d - log(1 + d)."""
    x = theta * np.linalg.eigvalsh(P)
    return excess(x / (1 - x))


def theta_root(P, c):
    """The only theta in [0, 1/lam_max) with gamma(P, theta) = c."""
    if c == 0:
        return 0.0
    lam = np.linalg.eigvalsh(P)
    lam_max = lam[-1]
    lam = lam / lam_max                                   # unknown u = theta lam_max lies in (0, 1)
    # 1/(1-u) = 2c + 4 makes the largest eigenvalue's term alone exceed c; u = sqrt(c/(n + c))/2 keeps the sum below it.
    upper = 1 - 1 / (2 * c + 4)
    lower = 0.5 * np.sqrt(c / (len(lam) + c))
    def residual(u):
        return excess(u * lam / (1 - u * lam)) - c
    while residual(lower) > 0:
        lower /= 2
    return brentq(residual, lower, upper, xtol=1e-300, rtol=4 * np.finfo(float).eps) / lam_max


def inflate(P, theta):
    """V = (P^-1 - theta I)^-1, by eigenvalues: theta near zero must not lose V - P to two inversions."""
    lam, U = np.linalg.eigh(P)
    return sym((U * (lam / (1 - theta * lam))) @ U.T)


# --- the network ---------------------------------------------------------------------------------------------------

class Network:
    """A scenario with its matrices; derived facts straight from the definitions."""

    def __init__(self, scenario):
        m = scenario["model"]
        self.A, self.Q, self.P0 = (np.array(m[k], float) for k in ("A", "Q", "P0"))
        self.r, self.x0 = np.array(m["input"], float), np.array(m["x0"], float)
        self.C = [np.array(v["C"], float) for v in scenario["nodes"]]
        self.R = [np.array(v["R"], float) for v in scenario["nodes"]]
        self.c = float(scenario["tolerance"])
        self.n, self.N = len(self.A), len(self.C)
        self.rows = [len(C) for C in self.C]
        near = [{k} for k in range(self.N)]
        for i, j in scenario["edges"]:
            near[i].add(j)
            near[j].add(i)
        self.near = [sorted(s) for s in near]
        # Slot order of the log: the node itself, then its neighbours ascending.
        self.slots = [[k] + [l for l in self.near[k] if l != k] for k in range(self.N)]
        self.degree = [len(s) for s in self.near]
        self.F = [C.T @ np.linalg.inv(R) for C, R in zip(self.C, self.R)]
        self.S = [sym(F @ C) for F, C in zip(self.F, self.C)]
        self.W = weights(scenario["weights"], self.near)

    def information(self, nodes):
        return sum((self.S[l] for l in nodes), np.zeros((self.n, self.n)))

    def stack(self, nodes):
        """C and R of several nodes, stacked."""
        return np.vstack([self.C[l] for l in nodes]), block_diag(*[self.R[l] for l in nodes])


def weights(rule, near):
    """w[l, k]: what node k gives to the estimate of node l. Columns sum to one."""
    if not isinstance(rule, str):
        return np.array(rule, float)
    W = np.zeros((len(near), len(near)))
    degree = [len(s) for s in near]
    for k, nodes in enumerate(near):
        for l in nodes:
            if rule == "relative-degree":
                W[l, k] = degree[l] / sum(degree[j] for j in nodes)
            elif rule == "uniform":
                W[l, k] = 1 / degree[k]
            elif rule == "metropolis":
                W[l, k] = 1 / max(degree[l], degree[k]) if l != k else 0.0
            else:
                raise ValueError(rule)
        if rule == "metropolis":
            W[k, k] = 1 - W[:, k].sum()
    return W


def observability_rank(A, C):
    n = len(A)
    blocks = [C]
    for _ in range(n - 1):
        blocks.append(blocks[-1] @ A)
    return int(np.linalg.matrix_rank(np.vstack(blocks)))


# --- covariance recursion ------------------------------------------------------------------------------------------

def correct(V, S):
    """M = (V^-1 + S)^-1."""
    return sym(np.linalg.inv(np.linalg.inv(V) + S))


def covariance_step(net, V, S, c):
    """(M, P(t+1), theta(t), V(t+1)) from V(t)."""
    M = correct(V, S)
    P = sym(net.A @ M @ net.A.T + net.Q)
    theta = theta_root(P, c)
    return M, P, theta, inflate(P, theta)


class NotConverged(Exception):
    pass


def fixed_point(net, S, c, limit=20000):
    """(P, theta, V) of the recursion at rest, started at P0.

    Ends when V changes by less than 1e-14 of its size, or when it moves by rounding only: less than 1e-12, and no
    smaller change for 50 steps. Gives up when V has grown beyond reason or the step limit is reached.
    """
    V, best, since = net.P0, np.inf, 0
    start = max(np.linalg.norm(net.P0), np.linalg.norm(net.Q))
    for _ in range(limit):
        _, P, theta, new = covariance_step(net, V, S, c)
        change = np.linalg.norm(new - V) / np.linalg.norm(new)
        V = new
        if not np.isfinite(change) or np.linalg.norm(V) > 1e9 * start:
            break
        best, since = (change, 0) if change < best else (best, since + 1)
        if change < 1e-14 or (best < 1e-12 and since >= 50):
            return P, theta, V
    raise NotConverged


# --- local tolerances ----------------------------------------------------------------------------------------------

def local_tolerance(net, k, V, D):
    """c_k by the definition: divergence between the laws of what node k sees, z = [x(t+1); y of its neighbours]."""
    C, R = net.stack(net.near[k])
    AC = np.vstack([net.A, C])
    K = AC @ V @ AC.T + block_diag(net.Q, R)
    Kt = K.copy()
    Kt[:net.n, :net.n] += D                               # only the state is perturbed
    E = np.linalg.solve(K, Kt)
    return np.trace(E - np.eye(len(K))) - np.linalg.slogdet(E)[1]


def local_tolerance_closed(net, k, V, D):
    """The same number from n x n matrices, keeping its digits when c is tiny."""
    Pc = sym(net.A @ correct(V, net.information(net.near[k])) @ net.A.T + net.Q)
    return excess(eigh(D, Pc, eigvals_only=True))


def local_tolerances(net, V, D, rule=local_tolerance_closed):
    if net.c == 0:
        return np.zeros(net.N)
    return np.array([rule(net, k, V, D) for k in range(net.N)])


def central_fixed_point(net):
    return fixed_point(net, net.information(range(net.N)), net.c)


def steady_tolerances(net, rule=local_tolerance_closed):
    P, _, V = central_fixed_point(net)
    return local_tolerances(net, V, V - P, rule)


def tolerances_per_step(net, steps, rule=local_tolerance_closed):
    """c_k(t) from V(t) and D = V(t+1) - P(t+1) of the central filter, every sensor present: a matter of the model alone."""
    S, V, out = net.information(range(net.N)), net.P0, []
    for _ in range(steps):
        _, P, _, new = covariance_step(net, V, S, net.c)
        out.append(local_tolerances(net, V, new - P, rule))
        V = new
    return np.array(out).reshape(steps, net.N)


@lru_cache(maxsize=None)
def _design(text):
    net = Network(json.loads(text))
    P, theta, V = central_fixed_point(net)
    tolerance = local_tolerances(net, V, V - P)
    nodes = []
    for k in range(net.N):
        try:
            p, t, v = fixed_point(net, net.information(net.near[k]), tolerance[k])
        except NotConverged:
            raise NotConverged(f"node {k}") from None
        nodes.append({"node": k, "degree": net.degree[k], "tolerance": tolerance[k], "theta": t, "P": p, "V": v})
    return {"central": {"theta": theta, "P": P, "V": V}, "nodes": nodes, "tolerance": net.c}


def design(scenario):
    """Steady state of the central filter and of every node with its own fixed tolerance."""
    return _design(json.dumps(scenario, sort_keys=True))


# --- the filters ---------------------------------------------------------------------------------------------------

def run(scenario, name, y, measured=None, heard=None):
    """Filter `name` over measurements y[t][k] (each m_k values).

    measured[t][e] and heard[t][e] say, slot by slot of estimator e, whose reading and whose estimate arrived; None
    means all. A reading that did not arrive is left out of the information and of the sum; a missing estimate is left
    out of the average and the other weights are scaled up to one again.
    """
    net, steps = Network(scenario), len(y)
    central = name in CENTRAL
    slots = [list(range(net.N))] if central else net.slots
    E = len(slots)
    if name in ("kfc", "kfd"):
        tolerance = np.zeros((steps, E))
    elif name in ("rkfc", "rkfdu"):
        tolerance = np.full((steps, E), net.c)
    elif name == "rkfdnu":
        tolerance = tolerances_per_step(net, steps)
    else:
        tolerance = np.tile(steady_tolerances(net), (steps, 1))
    xh, V = [net.x0] * E, [net.P0] * E
    out = {key: np.zeros((steps, E)) for key in ("theta", "trace_covariance", "nis")}
    out.update(tolerance=tolerance, estimate=np.zeros((steps, E, net.n)), nis_rows=np.zeros((steps, E), int))
    out.update(variance=np.zeros((steps, E, net.n)), innovation=[], innovation_variance=[])
    for t in range(steps):
        psi = []
        for e in range(E):
            used = [l for s, l in enumerate(slots[e]) if measured is None or measured[t][e][s]]
            out["estimate"][t, e], out["trace_covariance"][t, e] = xh[e], np.trace(V[e])
            out["variance"][t, e] = np.diag(V[e])
            for l in slots[e] if central else slots[e][:1]:
                there = 0.0 if l in used else np.nan
                out["innovation"].append(y[t][l] - net.C[l] @ xh[e] + there)
                out["innovation_variance"].append(np.diag(net.C[l] @ V[e] @ net.C[l].T + net.R[l]) + there)
            if used:
                C, R = net.stack(used)
                d = np.concatenate([y[t][l] for l in used]) - C @ xh[e]
                out["nis"][t, e], out["nis_rows"][t, e] = d @ np.linalg.solve(C @ V[e] @ C.T + R, d), len(d)
            M, _, theta, V[e] = covariance_step(net, V[e], net.information(used), tolerance[t, e])
            gain = sum((net.F[l] @ (y[t][l] - net.C[l] @ xh[e]) for l in used), np.zeros(net.n))
            psi.append(net.A @ xh[e] + net.r + net.A @ M @ gain)
            out["theta"][t, e] = theta
        if central:
            xh = psi
            continue
        for k in range(E):
            came = [l for s, l in enumerate(slots[k]) if heard is None or heard[t][k][s]]
            xh[k] = sum(net.W[l, k] * psi[l] for l in came) / sum(net.W[l, k] for l in came)
    for key in ("innovation", "innovation_variance"):
        out[key] = np.concatenate(out[key]).reshape(steps, -1)
    return out


# --- largest tolerance with guaranteed convergence -----------------------------------------------------------------

def toeplitz(first, A, B, L):
    """Strictly causal block Toeplitz map from noise to `first` x, latest time on top: 0, fB, fAB, .. in the first row."""
    p, q = first.shape[0], B.shape[1]
    T = np.zeros((L * p, L * q))
    block = first @ B
    power = A @ B
    for lag in range(1, L):
        for i in range(L - lag):
            T[i * p:(i + 1) * p, (i + lag) * q:(i + lag + 1) * q] = block
        block, power = first @ power, A @ power
    return T


def horizon_matrices(net, nodes, L):
    """Om, J, M of the L-step block model."""
    A, B = net.A, cholesky(net.Q, lower=True)
    C, R = net.stack(nodes)
    powers = [np.eye(net.n)]
    for _ in range(L - 1):
        powers.append(A @ powers[-1])
    Ob = np.vstack([C @ X for X in reversed(powers)])
    ObR = np.vstack(list(reversed(powers)))
    H, Lm = toeplitz(C, A, B, L), toeplitz(np.eye(net.n), A, B, L)
    RR = np.kron(np.eye(L), R)                            # DR DR'
    X = np.linalg.solve(RR + H @ H.T, Ob)
    Om = sym(Ob.T @ X)
    J = ObR - Lm @ H.T @ X
    M = sym(Lm @ np.linalg.solve(np.eye(H.shape[1]) + H.T @ np.linalg.solve(RR, H), Lm.T))
    return Om, J, M


def phi_bisection(Om, J, M):
    """sup of theta in (0, 1/lam_max(M)) with Om + theta J' (theta M - I)^-1 J > 0. The expression falls with theta."""
    lam, U = np.linalg.eigh(M)
    G = cholesky(Om, lower=True)                          # a congruence with G^-1 keeps the sign and scales Om to I
    Z = solve_triangular(G, (U.T @ J).T, lower=True)
    def positive(theta):
        return np.linalg.eigvalsh(np.eye(len(Om)) - (Z * (theta / (1 - theta * lam))) @ Z.T)[0] > 0
    low, high = 0.0, 1 / lam[-1] if lam[-1] > 0 else 1e300
    if not np.isfinite(high) or high >= 1e300:            # L = 1: no noise inside the block, only the prior counts
        high = 1.0
        while positive(high):
            high *= 2
    while high - low > 1e-14 * high:
        middle = (low + high) / 2
        if middle in (low, high):
            break
        low, high = (middle, high) if positive(middle) else (low, middle)
    return low


def riccati(net, nodes):
    """Prediction covariance of the plain filter at rest: the control Riccati equation of the dual system."""
    C, R = net.stack(nodes)
    return sym(solve_discrete_are(net.A.T, C.T, net.Q, R))


def c_max(net, L, nodes=None):
    """Largest tolerance for which block contraction over L steps is guaranteed; inf if every tolerance is."""
    nodes = list(range(net.N)) if nodes is None else nodes
    phi, Pq = phi_bisection(*horizon_matrices(net, nodes, L)), riccati(net, nodes)
    return gamma(Pq, phi) if phi * np.linalg.eigvalsh(Pq)[-1] < 1 else np.inf
