# SPDX-License-Identifier: MIT
"""Strapdown navigation, its error model and the flight, the C functions themselves: against closed forms, the matrix exponential, and differences."""
import ctypes

import numpy as np
import pytest
import scipy.linalg
from scipy.spatial.transform import Rotation

from navigation_cases import G, body_to_level, discretise, dynamics

D = ctypes.c_double


class Sample(ctypes.Structure):
    _fields_ = [("h", D), ("w", D * 3), ("f", D * 3)]


class State(ctypes.Structure):
    _fields_ = [("q", D * 4), ("v", D * 3), ("p", D * 3), ("gyro", D * 3), ("accelerometer", D * 3), ("clock_bias", D), ("clock_drift", D)]


class Transition(ctypes.Structure):
    _fields_ = [("T", D), ("blocks", D * 54), ("phi", D), ("noise", D * 45)]


class Maneuver(ctypes.Structure):
    _fields_ = [("climbs", ctypes.c_int), ("amount", D), ("from_s", D), ("to_s", D)]


@pytest.fixture(scope="module")
def c(shared):
    return shared("tools/meshkal/navigation/strapdown.c", "src/meshkal/meshkal.c")


def numbers(values):
    return (D * len(values))(*values)


def state(rng, biases=True):
    x = np.concatenate([rng.normal(0, 0.3, 3), rng.normal(0, 50, 3), rng.normal(0, 1000, 3), rng.normal(0, 1e-3, 6) * biases, rng.normal(0, 10, 2)])
    return x


def take(c, x):
    s = State()
    c.mk_nav_state_take(numbers(x), ctypes.byref(s))
    return s


def put(c, s):
    x = (D * 17)()
    c.mk_nav_state_put(ctypes.byref(s), x)
    return np.array(x)


def step(c, s, h, w, f):
    C, force = (D * 9)(), (D * 3)()
    c.mk_nav_step(ctypes.byref(s), ctypes.byref(Sample(h, (D * 3)(*w), (D * 3)(*f))), D(G), C, force)
    return np.array(C).reshape(3, 3), np.array(force)


def test_rotations_are_scipys(c):
    rng = np.random.default_rng(1)
    for scale in (1e-9, 1e-5, 1e-3, 0.5, 3.1):
        vector = rng.normal(size=3)
        vector *= scale / np.linalg.norm(vector)
        q, back, C = (D * 4)(), (D * 3)(), (D * 9)()
        c.mk_rotation_quaternion(numbers(vector), q)
        c.mk_rotation_vector(q, back)
        c.mk_rotation_matrix(q, C)
        np.testing.assert_allclose(np.array(back), vector, rtol=1e-12)
        np.testing.assert_allclose(np.array(C).reshape(3, 3), Rotation.from_rotvec(vector).as_matrix(), atol=1e-15)


def test_angles_are_those_of_the_header(c):
    rng = np.random.default_rng(2)
    for _ in range(20):
        angles = rng.uniform([-3, -1.5, -3], [3, 1.5, 3])
        q, C, back = (D * 4)(), (D * 9)(), (D * 3)()
        c.mk_rotation_from_angles(numbers(angles), q)
        c.mk_rotation_matrix(q, C)
        c.mk_rotation_angles(q, back)
        np.testing.assert_allclose(np.array(C).reshape(3, 3), body_to_level(*angles), atol=4e-15)
        np.testing.assert_allclose(np.array(back), angles, atol=1e-13)
    C = body_to_level(0.3, 0.2, np.pi / 2)
    assert C[:, 1] @ [1, 0, 0] > 0.9, "heading 90 degrees: the nose points east"
    assert body_to_level(0.0, 0.2, 0.0)[2, 1] > 0, "pitch: nose up"
    assert body_to_level(0.3, 0.0, 0.0)[2, 0] < 0, "roll: right side down"


@pytest.mark.parametrize("h", [0.01, 0.5])
def test_constant_turn_is_the_closed_form(c, h):
    """A level turn, 10 degrees a second, with the coordinated bank: velocity and attitude are exact whatever the interval."""
    rate, speed = np.radians(10), 50.0
    bank = np.arctan(speed * rate / G)
    w = body_to_level(bank, 0, 0).T @ [0, 0, -rate]
    f = np.array([0, 0, np.hypot(G, speed * rate)])
    s = take(c, np.concatenate([[bank, 0, 0], [0, speed, 0], np.zeros(11)]))
    steps = round(9 / h)
    for _ in range(steps):
        step(c, s, h, w, f)
    x = put(c, s)
    np.testing.assert_allclose(x[:3], [bank, 0, np.pi / 2], atol=1e-11)
    np.testing.assert_allclose(x[3:6], [speed, 0, 0], atol=1e-9)
    radius = speed / rate
    # Trapezoid rule: h^2 / 12 of the acceleration's change.
    np.testing.assert_allclose(x[6:9], [radius, radius, 0], atol=1.1 * h * h / 12 * speed * rate * np.sqrt(2) + 1e-8)


def test_straight_acceleration_is_the_closed_form(c):
    angles, force, T, h = np.array([0.1, 0.2, 2.0]), np.array([0.5, 1.0, 9.0]), 20.0, 0.05
    a = body_to_level(*angles) @ force - [0, 0, G]
    v, p = np.array([1.0, -2.0, 3.0]), np.array([10.0, 20.0, 30.0])
    s = take(c, np.concatenate([angles, v, p, np.zeros(6), [5.0, 0.25]]))
    for _ in range(400):
        step(c, s, h, np.zeros(3), force)
    x = put(c, s)
    np.testing.assert_allclose(x[:3], angles, atol=1e-12)
    np.testing.assert_allclose(x[3:6], v + a * T, rtol=1e-12)
    np.testing.assert_allclose(x[6:9], p + v * T + a * T * T / 2, rtol=1e-12)
    assert x[15] == pytest.approx(5 + 0.25 * T, rel=1e-13) and x[16] == 0.25


def test_biases_are_taken_off(c):
    rng = np.random.default_rng(3)
    x = state(rng)
    without = np.concatenate([x[:9], np.zeros(6), x[15:]])
    a, b = take(c, x), take(c, without)
    w, f = rng.normal(size=3), rng.normal(0, 10, 3)
    step(c, a, 0.01, w, f)
    step(c, b, 0.01, w - x[9:12], f - x[12:15])
    np.testing.assert_allclose(put(c, a)[:9], put(c, b)[:9], rtol=1e-13, atol=1e-13)


def test_samples_lead_from_state_to_state(c):
    rng = np.random.default_rng(4)
    for size in (1e-3, 1.0):
        x, y = state(rng, biases=False), state(rng, biases=False)
        y[:3] = x[:3] + size * rng.normal(0, 0.3, 3)
        a, b, sample = take(c, x), take(c, y), Sample()
        c.mk_nav_sample(ctypes.byref(a), ctypes.byref(b), D(0.02), D(G), ctypes.byref(sample))
        step(c, a, 0.02, list(sample.w), list(sample.f))
        got = put(c, a)
        np.testing.assert_allclose(got[:3], y[:3], atol=1e-13)
        np.testing.assert_allclose(got[3:6], y[3:6], rtol=1e-12, atol=1e-12)


def test_error_and_correction_are_one_another(c):
    rng = np.random.default_rng(5)
    x = state(rng)
    truth, estimate, error = take(c, x), take(c, x), (D * 17)()
    given = np.concatenate([rng.normal(0, 0.05, 3), rng.normal(0, 2, 14)])
    c.mk_nav_correct(ctypes.byref(estimate), numbers(-given))
    c.mk_nav_error(ctypes.byref(estimate), ctypes.byref(truth), error)
    np.testing.assert_allclose(np.array(error), given, rtol=1e-11, atol=1e-11)
    # phi: C_estimate = (I - [phi x]) C to first order, that is exp(-phi) C.
    E = Rotation.from_rotvec(-given[:3]).as_matrix() @ body_to_level(*x[:3])
    np.testing.assert_allclose(body_to_level(*put(c, estimate)[:3]), E, atol=1e-12)
    c.mk_nav_correct(ctypes.byref(estimate), error)
    np.testing.assert_allclose(put(c, estimate), x, rtol=1e-11, atol=1e-11)


def way(rng, c, s, count, h):
    """Samples of a tumbling flight; C and force of each interval."""
    w, f = rng.normal(0, 0.3, 3), rng.normal([0, 0, 10], 3)
    seen = []
    for _ in range(count):
        w, f = w + rng.normal(0, 0.05, 3), f + rng.normal(0, 0.5, 3)
        seen.append((*step(c, s, h, w, f), w.copy(), f.copy()))
    return seen


def transition(c, seen, h, gyro, accelerometer, sf, sg):
    t, Phi, Q = Transition(), (D * 289)(), (D * 153)()
    c.mk_nav_transition_start(ctypes.byref(t))
    for C, force, _, _ in seen:
        c.mk_nav_transition_add(ctypes.byref(t), D(h), numbers(C.ravel()), numbers(force), D(gyro), D(accelerometer))
    c.mk_nav_transition_put(ctypes.byref(t), D(sf), D(sg), Phi, Q)
    full = np.zeros((17, 17))
    full[np.tril_indices(17)] = Q
    return np.array(Phi).reshape(17, 17), full + np.tril(full, -1).T


@pytest.mark.parametrize("count, h", [(1, 0.3), (100, 0.01), (7, 0.2)])
def test_transition_and_noise_are_those_of_the_matrix_exponential(c, count, h):
    rng = np.random.default_rng(6)
    seen = way(rng, c, take(c, state(rng)), count, h)
    densities = 2e-4, 3e-2, 0.036, 0.141
    Phi, Q = transition(c, seen, h, *densities)
    noise = np.zeros(17)
    noise[0:3], noise[3:6], noise[15], noise[16] = densities
    want, Qs = np.eye(17), np.zeros((17, 17))
    for C, force, _, _ in seen:
        A, B = discretise(dynamics(C, force), noise, h)
        want, Qs = A @ want, A @ Qs @ A.T + B
    np.testing.assert_allclose(Phi, want, rtol=1e-11, atol=1e-12)
    np.testing.assert_allclose(Q, Qs, rtol=1e-10, atol=1e-15)


def test_transition_is_the_derivative_of_the_strapdown(c):
    """Errors of the estimate at the start, by differences, against Phi."""
    rng = np.random.default_rng(7)
    x = state(rng, biases=False)
    h, count = 0.01, 100
    seen = way(rng, c, take(c, x), count, h)
    Phi, _ = transition(c, seen, h, 0, 0, 0, 0)
    truth = take(c, x)
    for _, _, w, f in seen:
        step(c, truth, h, w, f)
    got = np.zeros((17, 17))
    for j in range(17):
        size = 1e-5 if j < 3 or 9 <= j < 15 else 1.0
        ends = []
        for sign in (1, -1):
            estimate, push, error = take(c, x), np.zeros(17), (D * 17)()
            push[j] = -sign * size
            c.mk_nav_correct(ctypes.byref(estimate), numbers(push))
            for _, _, w, f in seen:
                step(c, estimate, h, w, f)
            c.mk_nav_error(ctypes.byref(estimate), ctypes.byref(truth), error)
            ends.append(np.array(error))
        got[:, j] = (ends[0] - ends[1]) / (2 * size)
    # The error model holds C and f constant in an interval: parts of h^2.
    np.testing.assert_allclose(got, Phi, rtol=2e-5, atol=2e-4)
    assert np.abs(Phi[3:6, 0:3]).max() > 5 and np.abs(Phi[6:9, 9:12]).max() > 1, "it is there to be seen"
