# SPDX-License-Identifier: MIT
"""The reference checks itself: against other forms of the same definitions, and against the published numbers."""
from decimal import Decimal, localcontext

import numpy as np
import pytest
from scipy.linalg import eigh, solve_discrete_are

import reference as ref
from reference import Network
from scenarios import MAKERS, blind_node, cycling_node, projectile, scenario, spd

SMALL = [name for name in MAKERS if name != "projectile"]


# --- gamma and its root --------------------------------------------------------------------------------------------

def test_gamma_is_the_matrix_expression():
    rng = np.random.default_rng(0)
    for n in (1, 2, 4, 9):
        P = spd(rng, n, 2.0)
        for u in (0.1, 0.5, 0.9, 0.999):
            theta = u / np.linalg.eigvalsh(P)[-1]
            I, X = np.eye(n), np.eye(n) - theta * P
            literal = np.linalg.slogdet(X)[1] + np.trace(np.linalg.inv(X) - I)
            assert ref.gamma(P, theta) == pytest.approx(literal, rel=1e-11)


def test_gamma_is_twice_the_divergence_of_v_from_p():
    rng = np.random.default_rng(1)
    P = spd(rng, 3, 1.0)
    theta = 0.4 / np.linalg.eigvalsh(P)[-1]
    V = np.linalg.inv(np.linalg.inv(P) - theta * np.eye(3))
    divergence = 0.5 * (np.trace(np.linalg.solve(P, V)) - 3 - np.linalg.slogdet(np.linalg.solve(P, V))[1])
    assert ref.gamma(P, theta) == pytest.approx(2 * divergence, rel=1e-12)


def test_excess_series_meets_the_logarithm():
    d = np.array([0.09, 0.0999999, 0.1, 0.11, -0.0999999, -0.1])
    for x in d:
        assert ref.excess(x) == pytest.approx(x - np.log1p(x), rel=3e-14)
    assert ref.excess(1e-8) == pytest.approx(0.5e-16 * (1 - 2e-8 / 3), rel=1e-15)


@pytest.mark.parametrize("c", [1e-9, 1e-7, 1e-4, 0.02, 0.5, 3.0, 10.0])
def test_theta_root(c):
    rng = np.random.default_rng(2)
    for n in (1, 2, 3, 6, 9):
        P = spd(rng, n, 10.0 ** rng.uniform(-4, 4))
        theta = ref.theta_root(P, c)
        assert 0 < theta < 1 / np.linalg.eigvalsh(P)[-1]
        # gamma grows at least like theta squared near zero, so this bounds the relative error of theta by 1e-12 too.
        assert ref.gamma(P, theta) == pytest.approx(c, rel=1e-12)
        assert ref.gamma(P, theta * (1 - 1e-12)) < c < ref.gamma(P, theta * (1 + 1e-12))


@pytest.mark.parametrize("c", [1e-9, 0.02, 10.0])
def test_theta_root_in_sixty_digits(c):
    """One state: bisection of the definition in decimal arithmetic, no rounding shared with the reference."""
    with localcontext() as context:
        context.prec = 60
        low, high = Decimal(0), Decimal(1)
        for _ in range(150):
            u = (low + high) / 2
            low, high = (u, high) if (1 - u).ln() + u / (1 - u) < Decimal(c) else (low, u)
    assert ref.theta_root(np.array([[4.0]]), c) * 4 == pytest.approx(float(low), rel=1e-12)


def test_no_tolerance_is_the_plain_filter():
    P = spd(np.random.default_rng(3), 4, 1.0)
    assert ref.theta_root(P, 0) == 0.0
    assert np.allclose(ref.inflate(P, 0.0), P, rtol=1e-14)


def test_inflate_is_the_inverse_expression():
    P = spd(np.random.default_rng(4), 5, 1.0)
    theta = ref.theta_root(P, 0.3)
    assert np.allclose(ref.inflate(P, theta), np.linalg.inv(np.linalg.inv(P) - theta * np.eye(5)), rtol=1e-11)


# --- weights and observability -------------------------------------------------------------------------------------

@pytest.mark.parametrize("name", SMALL)
def test_weights_average_over_the_neighbourhood(name):
    net = Network(scenario(name))
    assert np.allclose(net.W.sum(axis=0), 1, rtol=1e-14)
    for k in range(net.N):
        assert (net.W[:, k] >= 0).all() and set(np.flatnonzero(net.W[:, k])) <= set(net.near[k])
        assert net.degree[k] == len(net.near[k]) and k in net.near[k]


def test_weights_by_hand():
    near = [[0, 1], [0, 1, 2], [1, 2]]                    # a path of three: degrees 2, 3, 2
    W = ref.weights("relative-degree", near)
    assert np.allclose(W, [[2 / 5, 2 / 7, 0], [3 / 5, 3 / 7, 3 / 5], [0, 2 / 7, 2 / 5]])
    W = ref.weights("metropolis", near)
    assert np.allclose(W, [[2 / 3, 1 / 3, 0], [1 / 3, 1 / 3, 1 / 3], [0, 1 / 3, 2 / 3]])
    W = ref.weights("uniform", near)
    assert np.allclose(W, [[1 / 2, 1 / 3, 0], [1 / 2, 1 / 3, 1 / 2], [0, 1 / 3, 1 / 2]])


def test_observability_rank():
    A = np.array([[1.0, 0], [0.1, 1]])                    # velocity, position
    assert ref.observability_rank(A, np.array([[0.0, 1]])) == 2
    assert ref.observability_rank(A, np.array([[1.0, 0]])) == 1


# --- local tolerances ----------------------------------------------------------------------------------------------

@pytest.mark.parametrize("name", list(MAKERS))
def test_definition_and_closed_form_agree(name):
    s = scenario(name)
    net, d = Network(s), ref.design(s)
    D = d["central"]["V"] - d["central"]["P"]
    for k in range(net.N):
        by_definition = ref.local_tolerance(net, k, d["central"]["V"], D)
        closed = ref.local_tolerance_closed(net, k, d["central"]["V"], D)
        # trace minus log det of matrices near I: the definition is exact to rounding of the trace, not of its value.
        assert closed == pytest.approx(by_definition, rel=1e-11, abs=2e-14 * (net.n + sum(net.rows)))


@pytest.mark.parametrize("name", ["projectile-8", "n4-stable-path", "n3-integrating-complete", "n9-stable-ring"])
def test_local_tolerance_never_exceeds_the_global_one(name):
    net = Network(scenario(name))
    c = ref.tolerances_per_step(net, 30)
    assert (c <= net.c * (1 + 1e-12)).all() and (c > 0).all()
    full = [k for k in range(net.N) if net.degree[k] == net.N]
    assert np.allclose(c[:, full], net.c, rtol=1e-11)


def test_perturbing_only_the_state_matters():
    """Were the whole of z perturbed, every node's tolerance would be close to c."""
    s = scenario("projectile")
    c = np.array([v["tolerance"] for v in ref.design(s)["nodes"]])
    assert c.max() < 0.95 * s["tolerance"]


# --- steady state --------------------------------------------------------------------------------------------------

@pytest.mark.parametrize("name", ["projectile-8", "n2-unstable-star", "n4-stable-path", "n9-integrating-single"])
def test_steady_state_stays(name):
    s = scenario(name)
    net, d = Network(s), ref.design(s)
    for node in d["nodes"]:
        _, P, theta, V = ref.covariance_step(net, node["V"], net.information(net.near[node["node"]]), node["tolerance"])
        assert np.allclose(P, node["P"], rtol=1e-11, atol=1e-11 * np.abs(P).max())
        assert theta == pytest.approx(node["theta"], rel=1e-10)
        assert np.allclose(V, node["V"], rtol=1e-11, atol=1e-11 * np.abs(V).max())


def test_without_tolerance_the_steady_state_solves_riccati():
    s = scenario("n6-integrating-path")
    net, d = Network(s), ref.design(s)
    assert np.allclose(d["central"]["P"], ref.riccati(net, range(net.N)), rtol=1e-10)
    for node in d["nodes"]:
        C, R = net.stack(net.near[node["node"]])
        assert np.allclose(node["P"], solve_discrete_are(net.A.T, C.T, net.Q, R), rtol=1e-9)


def test_tolerance_per_step_reaches_its_steady_value():
    s = scenario("n4-stable-path")
    net = Network(s)
    assert np.allclose(ref.tolerances_per_step(net, 200)[-1], ref.steady_tolerances(net), rtol=1e-11)


def test_node_that_cannot_see_a_state_does_not_converge():
    s = blind_node()
    with pytest.raises(ref.NotConverged, match="node 0"):
        ref.design(s)

def test_large_tolerance_can_cycle():
    """With every neighbourhood observable V stays bounded for any c (V <= s P with s - 1 - log s = c: a Riccati recursion
    with sqrt(s) A lies above it), so what ends convergence is a cycle, not growth."""
    s = cycling_node()
    net = Network(s)
    P, _, V = ref.central_fixed_point(net)
    c = ref.local_tolerances(net, V, V - P)
    for k in (0, 5, 6):
        traces, V = [], net.P0
        for _ in range(600):
            _, _, _, V = ref.covariance_step(net, V, net.information(net.near[k]), c[k])
            traces.append(np.trace(V))
        step = abs(traces[-1] / traces[-2] - 1)
        assert (step > 0.05 and abs(traces[-1] / traces[-3] - 1) < 1e-6) if k == 6 else step < 1e-12


# --- published numbers ---------------------------------------------------------------------------------------------

@pytest.fixture(scope="module")
def draws():
    """Draws of the published experiment."""
    return [scenario("projectile")] + [projectile(f"draw-{seed}", seed) for seed in (31, 32)]


def test_published_theta_and_tolerance(draws):
    for s in draws:
        d = ref.design(s)
        c = np.array([v["tolerance"] for v in d["nodes"]])
        assert 0.0140 < c.mean() < 0.0162                 # published 0.0144, independent draws 0.0146 to 0.0159
        assert c.max() <= 0.02
        assert 0.9 < d["central"]["theta"] < 1.7          # published 1.3366, independent draws 0.94 to 1.59
        assert 0.2 < np.mean([v["theta"] for v in d["nodes"]]) < 0.7


def test_local_theta_below_uniform_theta(draws):
    s = draws[0]
    net, d = Network(s), ref.design(s)
    for node in d["nodes"][::4]:
        _, theta, _ = ref.fixed_point(net, net.information(net.near[node["node"]]), net.c)
        assert node["theta"] < theta


def measurements(s, steps, seed=0):
    net, rng = Network(s), np.random.default_rng(seed)
    x, ys = rng.multivariate_normal(net.x0, net.P0), []
    for _ in range(steps):
        ys.append([C @ x + rng.multivariate_normal(np.zeros(len(R)), R) for C, R in zip(net.C, net.R)])
        x = net.A @ x + net.r + rng.multivariate_normal(np.zeros(net.n), net.Q)
    return ys


def test_per_step_and_stored_tolerances_end_in_the_same_estimate():
    s = scenario("projectile-8")
    s = {**s, "tolerance": 0.02}
    y = measurements(s, 120)
    a, b = ref.run(s, "rkfdnu", y), ref.run(s, "rkfdnu2", y)
    gap = np.abs(a["estimate"] - b["estimate"]).max(axis=(1, 2))
    assert gap[100:].max() < 1e-3 and gap[100:].max() < 0.02 * gap.max()


# --- relations between the filters ---------------------------------------------------------------------------------

def test_complete_graph_is_central():
    s = scenario("projectile-complete")
    y = measurements(s, 15)
    assert np.allclose(ref.run(s, "kfd", y)["estimate"], ref.run(s, "kfc", y)["estimate"], rtol=1e-11)
    assert np.allclose(ref.run(s, "rkfdnu", y)["estimate"], ref.run(s, "rkfc", y)["estimate"], rtol=1e-10)


def test_central_filter_is_the_textbook_kalman_filter():
    s = scenario("n3-unstable-geometric")
    net, y = Network(s), measurements(s, 10)
    C, R = net.stack(range(net.N))
    x, P, got = net.x0, net.P0, ref.run(s, "kfc", y)["estimate"][:, 0]
    for t in range(10):
        assert np.allclose(got[t], x, rtol=1e-10, atol=1e-12)
        K = P @ C.T @ np.linalg.inv(C @ P @ C.T + R)
        x = net.A @ (x + K @ (np.concatenate(y[t]) - C @ x)) + net.r
        P = net.A @ (P - K @ C @ P) @ net.A.T + net.Q


def test_lost_readings_and_estimates():
    """Everything lost but a node's own estimate: the node predicts with the model alone."""
    s = scenario("n2-unstable-star")
    net, y = Network(s), measurements(s, 4)
    none = [[[0] * len(p) for p in net.slots]] * 4
    own = [[[1] + [0] * (len(p) - 1) for p in net.slots]] * 4
    got = ref.run(s, "kfd", y, none, own)
    x = net.x0
    for t in range(4):
        assert np.allclose(got["estimate"][t], x, rtol=1e-12)
        x = net.A @ x + net.r
    assert (got["nis_rows"] == 0).all()


# --- guaranteed tolerance ------------------------------------------------------------------------------------------

@pytest.mark.parametrize("name", SMALL)
def test_phi_by_bisection_and_by_schur_complement(name):
    """Om + theta J'(theta M - I)^-1 J > 0 with theta M < I says that [Om J'; J I/theta - M] is positive, hence
    I/theta > M + J Om^-1 J': phi is one over the largest eigenvalue."""
    net = Network(scenario(name))
    for L in (net.n, 2 * net.n):
        Om, J, M = ref.horizon_matrices(net, range(net.N), L)
        phi = 1 / eigh(M + J @ np.linalg.solve(Om, J.T), eigvals_only=True)[-1]
        assert ref.phi_bisection(Om, J, M) == pytest.approx(phi, rel=1e-7)


def test_c_max_grows_with_the_horizon_and_has_the_published_size():
    """Eight sensors on the projectile: 1.4e-4 at L = 12, 1.3e-3 at 24, 5.5e-3 at 48 for another draw."""
    net = Network({**scenario("projectile-8"), "tolerance": 0.02})
    got = [ref.c_max(net, L) for L in (12, 24, 48)]
    assert got == sorted(got)
    for value, published in zip(got, (1.4e-4, 1.3e-3, 5.5e-3)):
        assert published / 5 < value < published * 5


def test_block_matrices_by_simulation():
    """The block model reproduces a trajectory: outputs and states of L steps from the first state and the noise."""
    net, L, rng = Network(scenario("n3-unstable-geometric")), 5, np.random.default_rng(5)
    B = np.linalg.cholesky(net.Q)
    C, _ = net.stack(range(net.N))
    x, w = [rng.normal(size=net.n)], rng.normal(size=(L, net.n))
    for t in range(L - 1):
        x.append(net.A @ x[-1] + B @ w[t])
    noise = np.concatenate(w[::-1])
    powers = [np.linalg.matrix_power(net.A, i) for i in reversed(range(L))]
    states = np.vstack(powers) @ x[0] + ref.toeplitz(np.eye(net.n), net.A, B, L) @ noise
    outputs = np.vstack([C @ X for X in powers]) @ x[0] + ref.toeplitz(C, net.A, B, L) @ noise
    assert np.allclose(states, np.concatenate(x[::-1]))
    assert np.allclose(outputs, np.concatenate([C @ v for v in x[::-1]]))
