# SPDX-License-Identifier: MIT
"""Dense reference of the least favourable model and of every filter's error under it.

Written from the definitions alone: the process noise and all measurement noises are one unit vector v, every matrix is
stacked and full, nothing is reduced to n x n. Slow on purpose, like reference.py, whose notation it keeps.

The model exists for t = 0 .. T and has no future: Oi(T+1) = 0. theta(t) belongs to P(t+1), c_k(t) is used in step t.
"""
from functools import lru_cache
import json

import numpy as np
from scipy.linalg import block_diag

from reference import CENTRAL, Network, covariance_step, design, local_tolerances, sym, tolerances_per_step

TRUTHS = ("least-favourable", "nominal")


class TooLarge(Exception):
    """The tolerance: at `step`, I - Bg' W Bg is not positive definite."""

    def __init__(self, step):
        super().__init__(f"step {step}")
        self.step = step


def root(S):
    """Some X with X X' = S, S positive semidefinite. Nothing below depends on which one."""
    lam, U = np.linalg.eigh(S)
    return U * np.sqrt(np.maximum(lam, 0))


def unit_noise(net):
    """B and D: process noise is B v, all measurement noises stacked are D v. Process noise comes first in v."""
    m = sum(net.rows)
    B = np.hstack([root(net.Q), np.zeros((net.n, m))])
    D = np.hstack([np.zeros((m, net.n)), block_diag(*[root(R) for R in net.R])])
    return B, D


# --- the central filter and the adversary --------------------------------------------------------------------------

class Central:
    """RKFC over t = 0 .. T: V[t] with V[T+1] as well; P[t], theta[t] and G[t] of step t, P[t] being P(t+1)."""

    def __init__(self, net, T):
        C, R = net.stack(range(net.N))
        S = net.information(range(net.N))
        self.V, self.P, self.theta, self.G = [net.P0], [], [], []
        for _ in range(T + 1):
            V = self.V[-1]
            self.G.append(net.A @ V @ C.T @ np.linalg.inv(C @ V @ C.T + R))
            _, P, theta, new = covariance_step(net, V, S, net.c)
            self.P.append(P)
            self.theta.append(theta)
            self.V.append(new)


class Model:
    """The law of v given e for t = 0 .. T: v = H[t] e + noise of covariance K[t]. Nominal: H = 0, K = I."""

    def __init__(self, net, T, truth="least-favourable"):
        self.net, self.T, self.truth = net, T, truth
        self.central = Central(net, T)
        self.B, self.D = unit_noise(net)
        self.C, _ = net.stack(range(net.N))
        size = self.B.shape[1]
        self.Ag = [net.A - G @ self.C for G in self.central.G]
        self.Bg = [self.B - G @ self.D for G in self.central.G]
        self.H = [np.zeros((size, net.n))] * (T + 1)
        self.K = [np.eye(size)] * (T + 1)
        self.Oi = [np.zeros((net.n, net.n))] * (T + 2)
        if truth == "nominal":
            return
        for t in reversed(range(T + 1)):
            W = self.Oi[t + 1] + self.central.theta[t] * np.eye(net.n)
            Ag, Bg = self.Ag[t], self.Bg[t]
            X = sym(np.eye(size) - Bg.T @ W @ Bg)
            if np.linalg.eigvalsh(X)[0] <= 0:
                raise TooLarge(t)
            self.K[t] = sym(np.linalg.inv(X))
            self.H[t] = self.K[t] @ Bg.T @ W @ Ag
            self.Oi[t] = sym(Ag.T @ W @ Ag + self.H[t].T @ X @ self.H[t])

    def error_covariance(self, start):
        """E[e(t) e(t)'] of RKFC for t = 0 .. T+1, e(0) of covariance `start`."""
        E = [start]
        for t in range(self.T + 1):
            F = self.Ag[t] + self.Bg[t] @ self.H[t]
            E.append(sym(F @ E[-1] @ F.T + self.Bg[t] @ self.K[t] @ self.Bg[t].T))
        return E


# --- a filter ------------------------------------------------------------------------------------------------------

class Gains:
    """Filter `name` over t = 0 .. T: tolerance[t, e], theta[t, e], M[t][e] of every estimator e; heard[e], its sensors."""

    def __init__(self, scenario, name, T):
        net = Network(scenario)
        self.heard = [list(range(net.N))] if name in CENTRAL else net.near
        E = len(self.heard)
        if name in ("kfc", "kfd"):
            self.tolerance = np.zeros((T + 1, E))
        elif name in ("rkfc", "rkfdu"):
            self.tolerance = np.full((T + 1, E), net.c)
        elif name == "rkfdnu":
            self.tolerance = tolerances_per_step(net, T + 1)
        else:
            central = design(scenario)["central"]
            self.tolerance = np.tile(local_tolerances(net, central["V"], central["V"] - central["P"]), (T + 1, 1))
        self.theta, self.M = np.zeros((T + 1, E)), []
        V = [net.P0] * E
        S = [net.information(nodes) for nodes in self.heard]
        for t in range(T + 1):
            self.M.append([])
            for e in range(E):
                M, _, self.theta[t, e], V[e] = covariance_step(net, V[e], S[e], self.tolerance[t, e])
                self.M[t].append(M)


def step_matrices(model, name, gains, t):
    """Fx and Ex of step t: chi(t+1) = Fx chi + Ex L eps, chi = [x - xh_1; ..; x - xh_E; e]."""
    net, E = model.net, len(gains.heard)
    first = np.concatenate([[0], np.cumsum(net.rows)])
    F, noise = [], []
    for e in range(E):
        AM = net.A @ gains.M[t][e]
        F.append(net.A - AM @ net.information(gains.heard[e]))
        noise.append(model.B - AM @ sum(net.F[j] @ model.D[first[j]:first[j + 1]] for j in gains.heard[e]))
    F, noise = block_diag(*F), np.vstack(noise)
    if name not in CENTRAL:
        average = np.kron(net.W.T, np.eye(net.n))         # node k: sum over l of w[l, k] psi_l
        F, noise = average @ F, average @ noise
    Fx, Ex = block_diag(F, model.Ag[t]), np.vstack([noise, model.Bg[t]])
    Fx[:, E * net.n:] += Ex @ model.H[t]
    return Fx, Ex


class Errors:
    """Filter `name` under a truth. X[t] for t = 0 .. T+1; steady step T // 2; msd and the like for t = 0 .. T."""

    def __init__(self, scenario, name, T, truth):
        net = self.net = Network(scenario)
        self.model, self.gains, self.T, self.steady = model(scenario, T, truth), gains(scenario, name, T), T, T // 2
        self.E = len(self.gains.heard)
        self.X = [np.tile(net.P0, (self.E + 1, self.E + 1))]
        for t in range(T + 1):
            Fx, Ex = step_matrices(self.model, name, self.gains, t)
            self.X.append(sym(Fx @ self.X[-1] @ Fx.T + Ex @ self.model.K[t] @ Ex.T))
        self.positions = scenario["model"].get("position_states")

    def block(self, t, i, j):
        """E[chi_i chi_j'], estimator E being RKFC."""
        n = self.net.n
        return self.X[t][i * n:(i + 1) * n, j * n:(j + 1) * n]

    def squares(self, states=None):
        """Mean square error over `states`, for t = 0 .. T and every estimator, RKFC last."""
        states = range(self.net.n) if states is None else states
        return np.array([[sum(self.block(t, i, i)[s, s] for s in states) for i in range(self.E + 1)] for t in range(self.T + 1)])

    @property
    def msd(self):
        return self.squares()[:, :self.E].mean(axis=1)

    @property
    def position_msd(self):
        return self.squares(self.positions)[:, :self.E].mean(axis=1)


@lru_cache(maxsize=None)
def _model(text, T, truth):
    return Model(Network(json.loads(text)), T, truth)


@lru_cache(maxsize=None)
def _gains(text, name, T):
    return Gains(json.loads(text), name, T)


@lru_cache(maxsize=None)
def _errors(text, name, T, truth):
    return Errors(json.loads(text), name, T, truth)


def model(scenario, T, truth="least-favourable"):
    return _model(json.dumps(scenario, sort_keys=True), T, truth)


def gains(scenario, name, T):
    return _gains(json.dumps(scenario, sort_keys=True), name, T)


def errors(scenario, name, T, truth="least-favourable"):
    return _errors(json.dumps(scenario, sort_keys=True), name, T, truth)
