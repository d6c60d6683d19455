# SPDX-License-Identifier: MIT
"""Scenario of the slow-fault experiment, written from the specification alone (3.4).

The linear error model is the truth: x[k+1] = Phi[k] x[k] + w, w ~ N(0, Q[k]); Phi and Q over one second are products of 100 steps along the
strapdown trajectory (attitude C, specific force f in the navigation frame, NED). A closed-loop INS with feedback of the estimate differs
from this in second order only. Free choices, not fixed by the specification: bank of a coordinated turn, a climb with a raised-cosine rate,
biases constant (no process noise), first pseudorange at t = 1 s.

States: attitude 0:3, velocity 3:6, position 6:9, gyro bias 9:12, accelerometer bias 12:15, clock bias 15, clock drift 16.
"""
import numpy as np

G = 9.80665
STATES = 17
EPOCHS = 418
ELEVATION = np.radians([75.0, 55, 48, 40, 33, 28, 22, 18])
AZIMUTH = np.radians([20.0, 110, 200, 290, 65, 155, 245, 335])
GYRO_BIAS = np.radians([-0.0009, 0.0013, 0.0008]) / 3600
ACCELEROMETER_BIAS = np.array([30.0, -45, 26]) * 1e-6 * G
ANGLE_WALK = np.radians(5e-4) / 60  # rad/sqrt(s)
VELOCITY_WALK = 10e-6 * G  # m/s/sqrt(s)
CLOCK_SF, CLOCK_SG = 0.036, 0.141
SIGMA = 2.5


def geometry():
    """Rows of the pseudoranges, shape (8, 17)."""
    line = np.stack([np.cos(ELEVATION) * np.cos(AZIMUTH), np.cos(ELEVATION) * np.sin(AZIMUTH), -np.sin(ELEVATION)], axis=1)
    H = np.zeros((8, STATES))
    H[:, 6:9] = -line
    H[:, 15] = 1
    return H


def initial_covariance():
    sd = np.concatenate([np.full(3, 1e-4), np.full(3, 0.05), np.full(3, 2.0), np.abs(GYRO_BIAS), np.abs(ACCELEROMETER_BIAS), [5.0, 0.1]])
    return np.diag(sd**2)


def attitude_and_force(t):
    """Body-to-navigation matrix and specific force at time t: 100 m/s, two turns of 45 degrees, one climb of 500 m."""
    rate = np.radians(45) / 18
    yaw = rate * (np.clip(t - 100, 0, 18) + np.clip(t - 330, 0, 18))
    turning = rate if 100 <= t < 118 or 330 <= t < 348 else 0.0
    up, up_rate = 0.0, 0.0
    if 220 <= t < 270:
        phase = 2 * np.pi * (t - 220) / 50
        up, up_rate = 10 * (1 - np.cos(phase)), 10 * np.sin(phase) * 2 * np.pi / 50
    side = 100 * turning
    acceleration = np.array([-side * np.sin(yaw), side * np.cos(yaw), -up_rate])
    roll, pitch = np.arctan2(side, G), np.arctan2(up, 100)
    cr, sr, cp, sp, cy, sy = np.cos(roll), np.sin(roll), np.cos(pitch), np.sin(pitch), np.cos(yaw), np.sin(yaw)
    C = np.array([[cp * cy, sr * sp * cy - cr * sy, cr * sp * cy + sr * sy], [cp * sy, sr * sp * sy + cr * cy, cr * sp * sy - sr * cy],
                  [-sp, sr * cp, cr * cp]])
    return C, acceleration - np.array([0, 0, G])


def skew(a):
    return np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])


def transitions(steps=100, epochs=EPOCHS):
    """Phi and Q of every second, shape (epochs, 17, 17); row k leads from t = k to t = k + 1."""
    noise = np.zeros(STATES)
    noise[0:3], noise[3:6], noise[15], noise[16] = ANGLE_WALK**2, VELOCITY_WALK**2, CLOCK_SF, CLOCK_SG
    h = 1 / steps
    Phis, Qs = np.empty((epochs, STATES, STATES)), np.empty((epochs, STATES, STATES))
    for k in range(epochs):
        Phi, Q = np.eye(STATES), np.zeros((STATES, STATES))
        for s in range(steps):
            C, f = attitude_and_force(k + (s + 0.5) * h)
            F = np.zeros((STATES, STATES))
            F[0:3, 9:12], F[3:6, 0:3], F[3:6, 12:15], F[6:9, 3:6], F[15, 16] = -C, skew(f), C, np.eye(3), 1
            Fh = F * h
            F2 = Fh @ Fh
            A = np.eye(STATES) + Fh + F2 / 2 + F2 @ Fh / 6  # F is nilpotent of degree 4: this is the exponential
            L = np.diag(noise) * h  # Q of a step, to third order: the integral of exp(F s) W exp(F s)' over the step
            FL = Fh @ L
            step = L + (FL + FL.T) / 2 + FL @ Fh.T / 3 + (Fh @ FL + (Fh @ FL).T) / 6
            Phi, Q = A @ Phi, A @ Q @ A.T + step
        Phis[k], Qs[k] = Phi, (Q + Q.T) / 2
    return Phis, Qs


def root(Q):
    """A square root of a positive semidefinite matrix whose scales differ by orders of magnitude."""
    sd = np.sqrt(np.maximum(np.diag(Q), 0))
    sd[sd == 0] = 1
    values, vectors = np.linalg.eigh(Q / np.outer(sd, sd))
    return sd[:, None] * (vectors * np.sqrt(np.maximum(values, 0)))


def ramp(rate, start=150, last=299, epochs=EPOCHS):
    """Fault of every epoch t = 1 .. epochs: rate (t - start) after start up to and including last."""
    t = np.arange(1, epochs + 1)
    return np.where((t > start) & (t <= last), rate * (t - start), 0.0)


def draw(rng, runs, Phis, Qs, H):
    """True error states (epochs, runs, 17) and fault-free pseudorange residuals (epochs, runs, 8) of t = 1 .. epochs."""
    x = rng.standard_normal((runs, STATES)) * np.sqrt(np.diag(initial_covariance()))
    x[:, 9:12], x[:, 12:15] = GYRO_BIAS, ACCELEROMETER_BIAS
    xs, zs = np.empty((len(Phis), runs, STATES)), np.empty((len(Phis), runs, len(H)))
    for k, (Phi, Q) in enumerate(zip(Phis, Qs)):
        x = x @ Phi.T + rng.standard_normal((runs, STATES)) @ root(Q).T
        xs[k], zs[k] = x, x @ H.T + SIGMA * rng.standard_normal((runs, len(H)))
    return xs, zs
