# SPDX-License-Identifier: MIT
"""Convergence theorem of consensus (tools/meshkal/tracking/graph_convergence.c) against matrix powers, and its rate and limit
(consensus_rate.c) against NumPy's eigenvalues and the protocol itself, on random graphs."""
import ctypes
import itertools
import math

import numpy as np
import pytest


class Links(ctypes.Structure):
    _fields_ = [("nodes", ctypes.c_int), ("first", ctypes.c_void_p), ("slot", ctypes.c_void_p)]


class Convergence(ctypes.Structure):
    _fields_ = [("converges", ctypes.c_int), ("sources", ctypes.c_int), *((n, ctypes.POINTER(ctypes.c_int)) for n in ("source", "period", "size"))]


class Protocol(ctypes.Structure):
    _fields_ = [("links", ctypes.POINTER(Links)), ("measures", ctypes.c_void_p), ("metropolis", ctypes.c_int)]


class Rate(ctypes.Structure):
    _fields_ = [("modulus", ctypes.c_double), ("error", ctypes.c_double), ("steps", ctypes.c_int)]


@pytest.fixture(scope="module")
def lib(shared):
    library = shared("tools/meshkal/tracking/graph_convergence.c", "tools/meshkal/tracking/consensus_rate.c", "port/host/dense.c",
                     "port/host/random.c", "port/host/error.c", "src/meshkal/meshkal.c")
    library.mk_iterations.restype = ctypes.c_long
    return library


class Graph:
    """hears[i, j]: node i hears node j."""

    def __init__(self, hears):
        hears = np.asarray(hears, bool)
        self.first = np.concatenate(([0], np.cumsum(hears.sum(axis=1)))).astype(np.int32)
        self.slot = np.nonzero(hears)[1].astype(np.int32)
        self.links = Links(len(hears), self.first.ctypes.data, self.slot.ctypes.data)
        self.hears = hears


def protocol_matrix(hears, measures):
    """The paper's protocol as a matrix, element by element."""
    n = len(hears)
    P = np.zeros((n, n))
    for i in range(n):
        total = float(measures[i]) + sum(hears[i, j] for j in range(n) if j != i)
        for j in range(n):
            P[i, j] = (float(measures[i]) if i == j else float(hears[i, j])) / total if total else float(i == j)
    return P


def metropolis_matrix(hears):
    n, d = len(hears), hears.sum(axis=1)
    W = np.array([[1.0 / (1 + max(d[i], d[j])) if hears[i, j] else 0.0 for j in range(n)] for i in range(n)])
    return W + np.diag(1 - W.sum(axis=1))


def agrees(P):
    """Does P^k become rank one? 2^60 steps; 2^60 and 2^60 + 1, so that swinging shows."""
    power = P.copy()
    for _ in range(60):
        power = power @ power
        power /= power.sum(axis=1, keepdims=True)
    return np.ptp(power, axis=0).max() < 1e-6 and np.abs(power @ P - power).max() < 1e-6 and np.abs(P @ power - power).max() < 1e-6


def connected(hears):
    n = len(hears)
    return (np.linalg.matrix_power(np.eye(n) + hears, n) > 0).all()


@pytest.fixture(scope="module")
def judge(lib):
    def call(hears, measures=None):
        g, result = Graph(hears), Convergence()
        flags = None if measures is None else np.ascontiguousarray(measures, np.uint8)
        lib.mk_convergence_make(ctypes.byref(result), ctypes.byref(g.links), None if flags is None else ctypes.c_void_p(flags.ctypes.data))
        answer = (bool(result.converges), result.source[:len(hears)], result.period[:result.sources], result.size[:result.sources])
        lib.mk_convergence_free(ctypes.byref(result))
        return answer
    return call


@pytest.fixture(scope="module")
def rate(lib):
    def call(hears, measures=None, metropolis=False):
        g, result = Graph(hears), Rate()
        flags = None if measures is None else np.ascontiguousarray(measures, np.uint8)
        protocol = Protocol(ctypes.pointer(g.links), None if flags is None else flags.ctypes.data, metropolis)
        assert lib.mk_rate(ctypes.byref(protocol), ctypes.byref(result))
        pi = np.empty(len(hears))
        assert lib.mk_perron(ctypes.byref(protocol), ctypes.c_void_p(pi.ctypes.data))
        return result, pi
    return call


def random_undirected(rng, n, p):
    upper = np.triu(rng.random((n, n)) < p, 1)
    return upper | upper.T


def random_connected(rng, n, p=0.3):
    hears = random_undirected(rng, n, p)
    for k in range(1, n):
        j = rng.integers(k)
        hears[k, j] = hears[j, k] = True
    return hears


def sources_by_reach(hears):
    """Closed classes: nodes that everything they reach reaches back."""
    n = len(hears)
    reach = np.linalg.matrix_power(np.eye(n) + hears, n) > 0
    closed = [i for i in range(n) if all(reach[j, i] for j in range(n) if reach[i, j])]
    classes = {}
    for i in closed:
        classes.setdefault(tuple(np.nonzero(reach[i])[0]), []).append(i)
    return list(classes.values())


def period_by_powers(hears, measures, members):
    """gcd of the lengths of closed walks through the first node; all of them up to three times the size."""
    block = hears[np.ix_(members, members)] | np.diag(np.asarray(measures, bool)[members])
    walk, period = np.eye(len(members), dtype=bool), 0
    for length in range(1, 3 * len(members) + 1):
        walk = (walk.astype(int) @ block) > 0
        if walk[0, 0]:
            period = math.gcd(period, length)
    return period or 1


@pytest.mark.parametrize("kind", ["directed", "sparse directed", "cycles", "undirected"])
def test_theorem_on_random_graphs(judge, kind):
    rng = np.random.default_rng(len(kind))
    met = [0, 0]
    for _ in range(250):
        n = int(rng.integers(1, 8))
        if kind == "undirected":
            hears = random_undirected(rng, n, rng.uniform(0.2, 0.9))
        elif kind == "cycles":  # a ring and a few chords: long periods
            hears = np.roll(np.eye(n, dtype=bool), 1, axis=1)
            for _ in range(int(rng.integers(0, 3))):
                hears[rng.integers(n), rng.integers(n)] = True
        else:
            hears = rng.random((n, n)) < (1.2 / n if kind[0] == "s" else rng.uniform(0.1, 0.7))
        np.fill_diagonal(hears, False)
        measures = rng.random(n) < rng.choice([0, 0, 0.2, 0.6])
        converges, source, period, size = judge(hears, measures)
        assert converges == agrees(protocol_matrix(hears, measures)), (hears.astype(int), measures)
        met[converges] += 1
        classes = sources_by_reach(hears)
        assert [[k for k in range(n) if source[k] == c] for c in range(len(period))] == classes
        assert size == [len(c) for c in classes] and period == [period_by_powers(hears, measures, c) for c in classes]
    assert min(met) > 25, met


def test_every_directed_graph_of_three_nodes(judge):
    pairs = [(i, j) for i in range(3) for j in range(3) if i != j]
    for chosen in itertools.product([0, 1], repeat=6):
        hears = np.zeros((3, 3), bool)
        for (i, j), there in zip(pairs, chosen):
            hears[i, j] = there
        for measures in itertools.product([0, 1], repeat=3):
            assert judge(hears, measures)[0] == agrees(protocol_matrix(hears, measures)), (hears, measures)


def test_theorem_on_known_graphs(judge):
    ring = np.roll(np.eye(6, dtype=bool), 1, axis=1)
    assert judge(ring) == (False, [0] * 6, [6], [6])
    assert judge(ring, [0, 0, 1, 0, 0, 0])[0]
    chord = ring.copy()
    chord[0, 2] = True  # a cycle of 5 beside that of 6
    assert judge(chord)[0] and judge(chord)[2] == [1]
    # Nodes 0, 1, 2 listen to each other both ways (an odd cycle), 3 listens to 0: neither strongly connected nor with a measuring root.
    triangle = np.zeros((4, 4), bool)
    triangle[:3, :3] = ~np.eye(3, dtype=bool)
    triangle[3, 0] = True
    assert judge(triangle) == (True, [0, 0, 0, -1], [1], [3])
    # A measuring node outside the source does not help it.
    pair = np.zeros((3, 3), bool)
    pair[0, 1] = pair[1, 0] = pair[2, 0] = True
    assert not judge(pair, [0, 0, 1])[0] and judge(pair, [0, 1, 0])[0]
    # Own number in the lists is no measurement.
    assert judge(np.ones((2, 2)))[2] == [2]
    assert judge(np.zeros((1, 1))) == (True, [0], [1], [1])
    assert judge(np.zeros((3, 3)), [1, 0, 1]) == (False, [0, 1, 2], [1, 1, 1], [1, 1, 1])


def test_a_long_chain_does_not_exhaust_the_stack(judge):
    n = 200000
    first = np.arange(n + 1, dtype=np.int32)
    slot = ((np.arange(n) + 1) % n).astype(np.int32)
    g, result = Links(n, first.ctypes.data, slot.ctypes.data), Convergence()
    library = judge.__closure__[0].cell_contents
    library.mk_convergence_make(ctypes.byref(result), ctypes.byref(g), None)
    assert (result.converges, result.sources, result.period[0], result.size[0]) == (0, 1, n, n)
    library.mk_convergence_free(ctypes.byref(result))


def moduli(P):
    return np.sort(np.abs(np.linalg.eigvals(P)))[::-1]


def test_rate_and_limit_are_those_of_the_matrix(rate, judge):
    rng = np.random.default_rng(7)
    for trial in range(150):
        n = int(rng.integers(2, 25))
        hears = random_connected(rng, n, rng.uniform(0, 0.5))
        measures = rng.random(n) < rng.choice([0.0, 0.1, 0.5, 1.0])
        P, W = protocol_matrix(hears, measures), metropolis_matrix(hears)
        found, pi = rate(hears, measures)
        assert abs(found.modulus - moduli(P)[1]) < 1e-12 and found.steps == 0
        assert np.abs(pi @ P - pi).max() < 1e-15 and abs(pi.sum() - 1) < 1e-14
        if judge(hears, measures)[0]:
            values, vectors = np.linalg.eig(P.T)
            v = np.real(vectors[:, np.argmax(np.real(values))])
            assert np.abs(pi - v / v.sum()).max() < 1e-12
            assert found.modulus < 1 - 1e-6
        else:
            assert not measures.any() and abs(found.modulus - 1) < 1e-13
        found, pi = rate(hears, metropolis=True)
        assert abs(found.modulus - moduli(W)[1]) < 1e-12 and np.abs(pi - 1 / n).max() == 0
        assert found.modulus < 1


def test_rate_of_one_measuring_node(lib):
    """All of them by one eigendecomposition, against an eigendecomposition each."""
    rng = np.random.default_rng(8)
    graphs = [random_connected(rng, int(rng.integers(2, 30)), rng.uniform(0, 0.5)) for _ in range(60)]
    graphs += [~np.eye(n, dtype=bool) for n in (2, 3, 8)]                                       # complete: eigenvalues in bundles
    graphs += [np.abs(np.subtract.outer(range(n), range(n))) == 1 for n in (2, 3, 10, 31)]      # chains
    graphs += [(np.arange(n) == 0)[:, None] ^ (np.arange(n) == 0)[None] for n in (3, 9)]        # stars
    for hears in graphs:
        g, single = Graph(hears), np.empty(len(hears))
        assert lib.mk_rates_single(ctypes.byref(g.links), ctypes.c_void_p(single.ctypes.data))
        for k in range(len(hears)):
            expected = moduli(protocol_matrix(hears, np.arange(len(hears)) == k))[1]
            # A defective-looking bundle in the nonsymmetric problem costs eigvals some digits.
            assert abs(single[k] - expected) < 1e-7 if expected < 1e-6 else abs(single[k] - expected) < 1e-11, (hears.astype(int), k)


def test_iterations_by_the_protocol_itself(lib, rate):
    """L iterations from the worst start bring the disagreement below the accuracy, L - 1 do not; no start is worse."""
    rng = np.random.default_rng(9)
    for trial in range(60):
        n = int(rng.integers(3, 16))
        hears = random_connected(rng, n)
        measures = np.arange(n) == rng.integers(n) if trial % 3 == 0 else np.ones(n, bool)
        metropolis = trial % 3 == 2
        P = metropolis_matrix(hears) if metropolis else protocol_matrix(hears, measures)
        found, pi = rate(hears, measures, metropolis)
        values, vectors = np.linalg.eig(P)
        worst = np.real(vectors[:, np.argsort(np.abs(values))[-2]])
        starts = np.column_stack((worst, rng.standard_normal((n, 5)), np.eye(n)))

        def disagreement(s):
            return np.sqrt(pi @ (s - pi @ s) ** 2)
        for accuracy in (1e-1, 1e-2, 1e-3, 1e-6):
            L = lib.mk_iterations(ctypes.c_double(found.modulus), ctypes.c_double(accuracy))
            s = starts.copy()
            for _ in range(L - 1):
                s = P @ s
            before = disagreement(s)[0] / disagreement(starts)[0]
            after = disagreement(P @ s) / disagreement(starts)
            # Roots of accuracy: a rounding either way.
            assert (after <= accuracy * (1 + 1e-6)).all() and after[0] <= accuracy * (1 + 1e-9)
            assert L == 1 or before > accuracy * (1 - 1e-6)


def test_iterations_at_the_ends(lib):
    def least(modulus, accuracy):
        return lib.mk_iterations(ctypes.c_double(modulus), ctypes.c_double(accuracy))
    assert (least(0.0, 1e-9), least(1e-17, 1e-9), least(0.5, 0.25), least(0.5, 0.24)) == (1, 1, 2, 3)
    assert (least(1.0, 0.1), least(1 - 1e-16, 0.1), least(math.nan, 0.1)) == (-1, -1, -1)


@pytest.mark.parametrize("kind", ["chain", "grid", "random", "bipartite", "complete"])
def test_lanczos_on_large_graphs(rate, kind):
    n = 600
    rng = np.random.default_rng(3)
    if kind == "chain":
        hears = np.abs(np.subtract.outer(range(n), range(n))) == 1
    elif kind == "grid":
        x, y = np.divmod(np.arange(n), 20)
        hears = np.abs(np.subtract.outer(x, x)) + np.abs(np.subtract.outer(y, y)) == 1
    elif kind == "random":
        hears = random_connected(rng, n, 0.01)
    elif kind == "bipartite":
        hears = np.abs(np.subtract.outer(range(n), range(n))) == 1
    else:
        hears = ~np.eye(n, dtype=bool)
    measures = np.arange(n) == 17 if kind == "bipartite" else np.ones(n, bool)
    for metropolis in (False, True):
        P = metropolis_matrix(hears) if metropolis else protocol_matrix(hears, measures)
        found, pi = rate(hears, measures, metropolis)
        root = np.sqrt(pi)
        symmetric = np.linalg.eigvalsh(root[:, None] * P / root[None])
        expected = max(abs(symmetric[0]), abs(symmetric[-2]))
        assert found.steps > 0 and abs(found.modulus - expected) < 1e-11 + found.error and found.error < 1e-9, (found.error, found.steps)


def test_lanczos_on_a_long_chain(lib):
    """Metropolis on a chain, 1/3 to each side: eigenvalues 1 - 2/3 (1 - cos(pi k / n)). The gap, 4e-7, is right, too."""
    n = 3000
    ends = [[j for j in (k - 1, k + 1) if 0 <= j < n] for k in range(n)]
    first = np.concatenate(([0], np.cumsum([len(e) for e in ends]))).astype(np.int32)
    slot = np.concatenate(ends).astype(np.int32)
    links, result = Links(n, first.ctypes.data, slot.ctypes.data), Rate()
    assert lib.mk_rate(ctypes.byref(Protocol(ctypes.pointer(links), None, 1)), ctypes.byref(result))
    gap = 4 / 3 * math.sin(math.pi / 2 / n) ** 2
    assert abs((1 - result.modulus) / gap - 1) < 1e-6 and result.error <= 1e-3 * gap, (result.modulus, result.error, result.steps)
