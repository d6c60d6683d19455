# SPDX-License-Identifier: MIT
"""Large networks: the same results for every number of threads, fixed points that the plain recursion reaches as well, memory a node."""
import json
import os
import pathlib
import re
import subprocess
import sys

import numpy as np
import pytest
from scipy.optimize import fsolve

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "reference"))
import reference as ref  # noqa: E402


@pytest.fixture(scope="session")
def sanitized(program):
    return b"__asan_init" in pathlib.Path(program).read_bytes()


def write(path, content):
    path.write_text(json.dumps(content))
    return path


# --- the plain recursion, many at once -------------------------------------------------------------------------------

def theta_roots(P, c):
    """theta of many P (B x n x n) and c (B): bisection of gamma = c over the spectrum."""
    lam = np.linalg.eigvalsh(P)
    low, high = np.zeros(len(P)), np.ones(len(P)) / lam[:, -1]
    for _ in range(70):
        middle = 0.5 * (low + high)
        x = middle[:, None] * lam
        with np.errstate(divide="ignore", invalid="ignore"):
            d = x / (1 - x)
            below = (d - np.log1p(d)).sum(axis=1) < c
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return np.where(c > 0, low, 0.0)


def settle(A, Q, P0, S, c, limit):
    """P, theta of the recursion from V(0) = P0 for many S and c; NaN where it has not come to rest after `limit` steps."""
    B, n = len(S), len(A)
    W, P = np.repeat(np.linalg.inv(P0)[None], B, axis=0), np.repeat(P0[None], B, axis=0)
    theta, rest, idle, least = np.zeros(B), np.zeros(B, bool), np.zeros(B, int), np.full(B, np.inf)
    for _ in range(limit):
        new = A @ np.linalg.inv(W + S) @ A.T + Q
        new = (new + new.transpose(0, 2, 1)) / 2
        deviation = np.sqrt(np.einsum("bii->bi", new))
        change = (np.abs(new - P) / (deviation[:, :, None] * deviation[:, None, :])).max(axis=(1, 2))
        P, theta = new, theta_roots(new, c)
        W = np.linalg.inv(P) - theta[:, None, None] * np.eye(n)
        idle, least = np.where(change < least, 0, idle + 1), np.minimum(change, least)
        rest |= (change < 1e-15) | ((least < 1e-11) & (idle > 50))
        if rest.all():
            break
    P[~rest], theta[~rest] = np.nan, np.nan
    return P, theta


def model(rng, n, kind):
    X = rng.standard_normal((n, n)) + np.eye(n)
    Q = 0.05 * (X @ X.T / n + 0.2 * np.eye(n))
    if kind == "integrating":
        return np.eye(n) + 0.2 * np.eye(n, k=-1), Q
    A = rng.standard_normal((n, n))
    return A * {"stable": 0.9, "unstable": 1.05}[kind] / max(abs(np.linalg.eigvals(A))), Q


@pytest.mark.parametrize("n,kind,c", [(2, "stable", 0.0), (2, "unstable", 0.3), (2, "integrating", 0.05), (3, "unstable", 2.0), (4, "integrating", 0.02),
                                      (4, "stable", 10.0), (6, "integrating", 0.5), (6, "unstable", 0.1), (6, "stable", 1.0), (8, "unstable", 0.02)])
def test_fixed_points_are_those_of_the_recursion(run, tmp_path, n, kind, c):
    """Nodes without neighbours, each with sensors of its own: as many fixed points as nodes."""
    rng = np.random.default_rng([n, len(kind), int(100 * c)])
    A, Q = model(rng, n, kind)
    sensors = [(rng.standard_normal((n, n)), np.diag(10 ** rng.uniform(-1, 3) * rng.uniform(0.5, 2, n))) for _ in range(40)]
    path = write(tmp_path / "net.json", {"model": {"A": A.tolist(), "Q": Q.tolist()}, "edges": [], "tolerance": c,
                                         "nodes": [{"C": C.tolist(), "R": R.tolist()} for C, R in sensors]})
    S = np.array([C.T @ np.linalg.inv(R) @ C for C, R in sensors])
    run("design", path, "--c-max", "none", "--json", tmp_path / "out.json")
    nodes = json.loads((tmp_path / "out.json").read_text())["nodes"]
    P, theta = settle(A, Q, np.eye(n), S, np.array([v["tolerance"] for v in nodes]), 20000)
    for k, v in enumerate(nodes):
        deviation = np.sqrt(np.diag(P[k]))
        assert (np.abs(np.array(v["P"]) - P[k]) / np.outer(deviation, deviation)).max() < 1e-8, f"node {k}"
        assert v["theta"] == pytest.approx(theta[k], rel=1e-8, abs=0), f"node {k}"
        assert v["trace_P"] == pytest.approx(np.trace(P[k]), rel=1e-8) and v["trace_V"] == pytest.approx(np.trace(np.array(v["V"])), rel=1e-14)


# Noise reaches the second state through the first only; with a large tolerance its covariance cycles.
FRAGILE = {"model": {"A": [[0.4, 0.2], [-0.7, 0.5]], "Q": [[1.0, 0.0], [0.0, 0.0]]}, "nodes": [{"C": [[1.0, 0.0]], "R": [[10.0]]}], "edges": []}


@pytest.mark.parametrize("A,R", [([[0.4, 0.2], [-0.7, 0.5]], 10.0), ([[0.2, 0.9], [-0.9, 0.1]], 10.0)])
def test_cycles_are_refused_where_the_recursion_cycles(run, tmp_path, A, R):
    """The tolerance at which the plain recursion stops to converge, found by the recursion alone; the design on both sides of it."""
    A, Q, S = np.array(A), np.diag([1.0, 0.0]), np.array([[[1 / R, 0.0], [0.0, 0.0]]])
    path = write(tmp_path / "net.json", {"model": {"A": A.tolist(), "Q": Q.tolist()}, "nodes": [{"C": [[1.0, 0.0]], "R": [[R]]}], "edges": []})
    many = np.geomspace(0.05, 30.0, 80)
    P, _ = settle(A, Q, np.eye(2), np.repeat(S, len(many), axis=0), many, 8000)
    good = np.isfinite(P[:, 0, 0])
    assert good[0] and not good[-1], "no threshold in this range"
    last = int(np.argmin(good)) - 1
    for c in (many[0], many[last // 2], many[last]):
        run("design", path, "--tolerance", repr(float(c)), "--c-max", "none")
    # At the threshold itself 8000 steps may be too few.
    for c in (many[last + 3], many[last + 8]):
        said = run("design", path, "--tolerance", repr(float(c)), "--c-max", "none", status=2).stderr.decode()
        assert "the centralised filter does not converge" in said


def test_a_fixed_point_that_repels_is_not_taken_for_the_answer(run, tmp_path):
    """Started so that it comes as near as 1e-7 to a fixed point that repels, the recursion then leaves it for a cycle: its approach, and
    Newton's method, speak for convergence, only the derivative speaks against it."""
    A, Q, S, c = np.array([[0.2, 0.9], [-0.9, 0.1]]), np.diag([1.0, 0.0]), np.diag([0.1, 0.0]), 0.5
    lower = np.tril_indices(2)

    def full(p):
        return np.array([[p[0], p[1]], [p[1], p[2]]])

    def step(p, times=1):
        for _ in range(times):
            p = (A @ np.linalg.inv(np.linalg.inv(ref.inflate(full(p), ref.theta_root(full(p), c))) + S) @ A.T + Q)[lower]
        return p

    rest = fsolve(lambda p: step(p) - p, [7.7, -0.2, 5.2])
    J = np.array([(step(rest + 1e-6 * e) - step(rest - 1e-6 * e)) / 2e-6 for e in np.eye(3)]).T
    values, vectors = np.linalg.eig(J)
    inward, outward = int(np.argmin(abs(values))), int(np.argmax(values.imag))
    assert abs(values[inward]) < 0.6 and abs(values[outward]) > 1.03
    part = np.linalg.inv(vectors)[outward]

    def start(ab):
        return rest + 0.05 * vectors[:, inward].real + ab[0] * vectors[:, outward].real + ab[1] * vectors[:, outward].imag

    def left(ab):
        left_over = part @ (step(start(ab), 20) - rest) - 1e-7
        return [left_over.real, left_over.imag]

    first = start(fsolve(left, [0.0, 0.0], xtol=1e-9))
    away = [np.abs(step(first, t) - rest).max() for t in (14, 22)]
    assert 1e-9 < away[1] < 0.2 * away[0] < 1e-5
    V = ref.inflate(full(first), ref.theta_root(full(first), c))
    P, _ = settle(A, Q, V, S[None], np.array([c]), 2000)
    assert np.isnan(P).all()
    write(tmp_path / "net.json", {"model": {"A": A.tolist(), "Q": Q.tolist(), "P0": V.tolist()}, "edges": [], "tolerance": c,
                                  "nodes": [{"C": [[1.0, 0.0]], "R": [[10.0]]}]})
    assert b"does not converge" in run("design", tmp_path / "net.json", "--c-max", "none", status=2).stderr


# --- threads ---------------------------------------------------------------------------------------------------------

def test_any_number_of_threads_gives_the_same_bytes(run, tmp_path):
    net, made = tmp_path / "net.json", []
    net.write_bytes(run("scenario", "projectile", "--nodes", 40, "--seed", 4).stdout)
    for threads in (1, 2, 5):
        run("design", net, "--threads", threads, "--per-step", 7, "--json", tmp_path / "out.json")
        made.append((tmp_path / "out.json").read_bytes())
    assert made[0] == made[1] == made[2]
    assert len(json.loads(made[0])["per_step"]) == 7 and "c_max" in json.loads(made[0])["nodes"][0]


@pytest.mark.parametrize("threads", [1, 2, 4])
def test_the_first_node_that_does_not_converge_is_named(refused, tmp_path, threads):
    """Two of 600 lonely nodes have a poor sensor, on which the recursion cycles."""
    good, poor = {"C": [[1.0, 0.0]], "R": [[0.01]]}, {"C": [[1.0, 0.0]], "R": [[10.0]]}
    write(tmp_path / "net.json", FRAGILE | {"nodes": [poor if k in (333, 590) else good for k in range(600)]})
    said = refused(tmp_path, "design", tmp_path / "net.json", "--tolerance", 10, "--threads", threads, "--json", "{}/j")
    assert re.match(r"tolerance 10: the filter of node 333, with its local tolerance 9\.9\S*, does not converge$", said), said


@pytest.mark.parametrize("threads", [0, "two", 1025])
def test_threads_out_of_range(refused, tmp_path, threads):
    write(tmp_path / "net.json", FRAGILE)
    assert f"--threads {threads}: must be an integer from 1 to 1024" in refused(tmp_path, "design", tmp_path / "net.json", "--threads", threads)


# --- files of many nodes ---------------------------------------------------------------------------------------------

def test_the_first_error_of_a_large_file(refused, tmp_path):
    """Nodes are read in parts, at the same time; lines and columns are still those of the file."""
    nodes = [{"C": [[1.0, 0.0]], "R": [[1.0]]} for _ in range(5000)]
    edges = [[k, k + 1] for k in range(4999)]

    text = json.dumps(FRAGILE | {"nodes": nodes, "edges": edges}).replace("}, {", "},\n{").replace("], [", "],\n[")
    lines = text.split("\n")
    first, first_edge = (next(i for i, line in enumerate(lines) if word in line) for word in ('"C"', '"edges"'))

    def said(*changes):
        broken = list(lines)
        for i, old, new in changes:
            assert old in broken[i], broken[i]
            broken[i] = broken[i].replace(old, new)
        (tmp_path / "net.json").write_text("\n".join(broken))
        return refused(tmp_path, "design", tmp_path / "net.json").removeprefix(str(tmp_path / "net.json"))

    poor, node, edge = ('"R": [[1.0]]', '"R": [[-1.0]]'), lambda k: first + k, lambda i: first_edge + i
    assert said(*((node(k), *poor) for k in (4990, 2500, 2501))) == \
        f":{first + 2501}: nodes[2500].R: is not positive definite: smallest eigenvalue -1"
    text = said((node(4000), "1.0", "1.0,"), (node(4990), "1.0", "1.0.0"))
    assert text.startswith(f":{first + 4001}:") and "unexpected token near ','" in text
    text = said((edge(4000), "4000,", "4000;"), (edge(4500), "4501", "4500"))
    assert text.startswith(f":{first_edge + 4001}:") and "near ';'" in text
    text = said((edge(4500), "4501", "4500"), (edge(4700), "4701", "9999"))
    assert text == f":{first_edge + 4501}: edges[4500]: joins node 4500 to itself: a node hears itself without an edge"


# --- size ------------------------------------------------------------------------------------------------------------

class Part(ref.Network):
    """What the reference needs of a large network, without its matrix of weights."""

    def __init__(self, scenario):
        m = scenario["model"]
        self.A, self.Q, self.P0 = (np.array(m[k], float) for k in ("A", "Q", "P0"))
        self.c, self.n, self.N = scenario["tolerance"], len(self.A), len(scenario["nodes"])
        C, R = (np.array([v[k] for v in scenario["nodes"]]) for k in ("C", "R"))
        self.S = C.transpose(0, 2, 1) @ np.linalg.inv(R) @ C
        self.near = [[k] for k in range(self.N)]
        for a, b in scenario["edges"]:
            self.near[a].append(b)
            self.near[b].append(a)

    def information(self, nodes):
        return self.S[list(nodes)].sum(axis=0)


def test_twenty_thousand_nodes(run, tmp_path, sanitized):
    nodes = 2000 if sanitized else 20000
    net, out = tmp_path / "net.json", tmp_path / "out.json"
    net.write_bytes(run("scenario", "projectile", "--nodes", nodes, "--seed", 7).stdout)
    run("design", net, "--c-max", "none", "--json", out, timeout=300)
    got, part = json.loads(out.read_text()), Part(json.loads(net.read_text()))
    # Above 10 000 nodes their matrices stay out of the file.
    assert ["P" in v for v in got["nodes"][:2]] == [nodes <= 10000] * 2 and np.array(got["central"]["P"]).shape == (6, 6)
    assert [v["node"] for v in got["nodes"]] == list(range(nodes))
    P, theta, V = ref.fixed_point(part, part.information(range(part.N)), part.c)
    assert got["central"]["theta"] == pytest.approx(theta, rel=1e-8)
    sample = [0, 1, nodes // 3, nodes // 2, nodes - 1]
    c = np.array([ref.local_tolerance_closed(part, k, V, V - P) for k in sample])
    P, theta = settle(part.A, part.Q, part.P0, np.array([part.information(part.near[k]) for k in sample]), c, 20000)
    for i, k in enumerate(sample):
        v = got["nodes"][k]
        assert v["degree"] == len(part.near[k]) and v["unobservable"] == 0
        assert v["tolerance"] == pytest.approx(c[i], rel=1e-8), f"node {k}"
        assert v["theta"] == pytest.approx(theta[i], rel=1e-8) and v["trace_P"] == pytest.approx(np.trace(P[i]), rel=1e-8), f"node {k}"


def test_matrices_on_request(run, tmp_path):
    """All nodes alike: ten thousand are quick."""
    nodes = [{"C": [[1.0, 0.0]], "R": [[1.0]]}] * 10001
    write(tmp_path / "net.json", FRAGILE | {"nodes": nodes, "tolerance": 0.01})
    for option, there in (((), False), (("--covariances",), True)):
        run("design", tmp_path / "net.json", "--c-max", "none", "--json", tmp_path / "out.json", *option)
        made = json.loads((tmp_path / "out.json").read_text())["nodes"]
        assert all(("P" in v) == there == ("V" in v) and v["trace_P"] == made[0]["trace_P"] for v in made)
    assert np.trace(np.array(made[-1]["V"])) == pytest.approx(made[-1]["trace_V"], rel=1e-14)


def test_bytes_a_node(program, run, tmp_path, sanitized):
    """The growth of peak memory from a small network to one of 50 000 nodes, as the kernel counts it, and what the program says of it."""
    if sanitized:
        pytest.skip("the sanitizer keeps freed memory")
    peak, nodes = [], (1000, 50000)
    for count in nodes:
        (tmp_path / "net.json").write_bytes(run("scenario", "projectile", "--nodes", count).stdout)
        with open(tmp_path / "said", "w+") as said:
            job, seen = subprocess.Popen([program, "design", tmp_path / "net.json", "--c-max", "none", "--json", tmp_path / "out.json"], stdout=said), 0
            while job.poll() is None:
                status = pathlib.Path(f"/proc/{job.pid}/status").read_text()
                seen = max(seen, *(1024 * int(kb) for kb in re.findall(r"VmHWM:\s+(\d+) kB", status)), 0)
            assert job.returncode == 0
            said.seek(0)
            mebibytes, each = (int(v) for v in re.search(r"peak memory (\d+) MiB, (\d+) bytes a node", said.read()).groups())
        # The last look may have come before the last page.
        assert 0.8 * 2**20 * mebibytes - 2**20 <= seen <= 2**20 * (mebibytes + 1) and each * count == pytest.approx(2**20 * mebibytes, abs=2**20)
        peak.append(each * count)
    assert (peak[1] - peak[0]) / (nodes[1] - nodes[0]) < 650
