# SPDX-License-Identifier: MIT
"""`meshkal scenario projectile`: what the published example (spec 1.9) says of every draw, small and large."""
import json
import time

import numpy as np
import pytest

LEVELS = [0.5, 2.0, 3.5]  # 0.5 (1, 4, 7)


def draw(run, *options):
    return json.loads(run("scenario", "projectile", *options).stdout)


def neighbours(s):
    near = [{k} for k in range(len(s["nodes"]))]
    for a, b in s["edges"]:
        near[a].add(b)
        near[b].add(a)
    return near


def connected(near):
    seen, todo = {0}, [0]
    while todo:
        new = near[todo.pop()] - seen
        seen |= new
        todo.extend(new)
    return len(seen) == len(near)


def axes(node):
    """The two axes that a node measures."""
    return [row.index(1.0) - 3 for row in node["C"]]


def check(s, nodes, seed):
    assert s["name"] == f"projectile-{nodes}-{seed}" and s["seed"] == seed and len(s["nodes"]) == nodes
    assert s["tolerance"] == 0.02 and s["weights"] == "relative-degree"
    pairs = [tuple(sorted(e)) for e in s["edges"]]
    assert len(set(pairs)) == len(pairs) and all(a != b for a, b in pairs)
    near = neighbours(s)
    assert connected(near)
    for k, node in enumerate(s["nodes"]):
        C, R = np.array(node["C"]), np.array(node["R"])
        assert C.shape == (2, 6) and R.shape == (2, 2)
        assert (np.sort(C, axis=1) == [[0, 0, 0, 0, 0, 1]] * 2).all() and len(set(axes(node))) == 2 and min(axes(node)) >= 0
        # Two different entries of the permutation, times sqrt(k), nodes counted from 1.
        assert R[0, 1] == R[1, 0] == 0
        levels = np.diag(R) / np.sqrt(k + 1)
        assert levels[0] != levels[1] and np.abs(np.subtract.outer(levels, LEVELS)).min(axis=1).max() < 1e-12
        assert set().union(*(axes(s["nodes"][l]) for l in near[k])) == {0, 1, 2}, f"neighbourhood of node {k}"
    return near


def test_model(run):
    model, phi = draw(run)["model"], np.zeros((6, 6))
    phi[3:, :3] = np.eye(3)
    assert np.array_equal(model["A"], np.eye(6) + 0.1 * phi) and np.array_equal(model["Q"], 0.001 * np.eye(6))
    assert np.array_equal(model["P0"], np.eye(6)) and len(model["x0"]) == 6
    assert model["input"] == [0, 0, -1, 0, 0, 0] and model["dt_s"] == 0.1 and model["position_states"] == [3, 4, 5]


@pytest.mark.parametrize("nodes", [2, 3, 5, 20, 60])
@pytest.mark.parametrize("seed", range(1, 9))
def test_small_draws(run, nodes, seed):
    s = draw(run, "--nodes", nodes, "--seed", seed)
    mean = np.mean([len(l) for l in check(s, nodes, seed)])
    # Pairs are counted out, so only the edges that connect the network come on top of the request.
    wanted = min(5, nodes)
    assert wanted - 1 / nodes <= mean < wanted + 0.6


@pytest.mark.parametrize("nodes,limit", [(1000, 5), (20000, 15)])
def test_large_draws(run, nodes, limit):
    begin = time.monotonic()
    s = draw(run, "--nodes", nodes, "--seed", 5)
    assert time.monotonic() - begin < limit
    mean = np.mean([len(l) for l in check(s, nodes, 5)])
    assert 4.8 < mean < 5.5


@pytest.mark.parametrize("nodes,density", [(20, 2), (20, 8), (20, 20), (20, 1000), (1000, 12), (3000, 12)])
def test_density(run, nodes, density):
    s = draw(run, "--nodes", nodes, "--density", density)
    near = check(s, nodes, 1)
    mean, wanted = np.mean([len(l) for l in near]), min(density, nodes)
    # A connected network has at least nodes - 1 edges; beyond 2000 nodes the border costs a little.
    least = 3 - 2 / nodes
    assert max(wanted, least) * 0.9 <= mean <= max(wanted + 0.6, least + 0.4)


def test_neighbours_are_the_nearest(run):
    """Geometric: with few exceptions, made to connect the network, whoever is joined is nearer than whoever is not."""
    s = draw(run, "--nodes", 100, "--seed", 3)
    X = np.array([n["position_m"] for n in s["nodes"]])
    assert X.shape == (100, 2) and X.min() >= 0
    distance = np.linalg.norm(X[:, None] - X[None], axis=2)
    joined = np.zeros((100, 100), bool)
    for a, b in s["edges"]:
        joined[a, b] = joined[b, a] = True
    radius = distance[~joined & ~np.eye(100, dtype=bool)].min()
    assert (distance[joined] > radius).mean() < 0.1


def test_draws_are_fair(run):
    """Pairs of axes and noise levels over a large draw: each of the three kinds about as often as the others."""
    s = draw(run, "--nodes", 3000, "--seed", 9)
    missing = np.bincount([3 - sum(axes(n)) for n in s["nodes"]], minlength=3)
    levels = np.array([np.diag(n["R"]) / np.sqrt(k + 1) for k, n in enumerate(s["nodes"])])
    for row in range(2):
        counts = [np.isclose(levels[:, row], v).sum() for v in LEVELS]
        assert sum(counts) == 3000 and np.abs(np.array(counts) - 1000).max() < 3.9 * np.sqrt(3000 * 2 / 9)
    assert np.abs(missing - 1000).max() < 3.9 * np.sqrt(3000 * 2 / 9)
    # Neither order of the two rows' levels is preferred.
    assert abs((levels[:, 0] < levels[:, 1]).sum() - 1500) < 3.9 * np.sqrt(3000 / 4)
