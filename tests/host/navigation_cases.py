# SPDX-License-Identifier: MIT
"""Navigation in NumPy, written from the specification (3.4) and the headers' definitions: what the tests of navigation compare with."""
import numpy as np
import scipy.linalg

G = 9.80665
COLUMNS = ("t,roll,pitch,heading,ve,vn,vu,pe,pn,pu,gx,gy,gz,ax,ay,az,clock_bias,clock_drift").split(",")


def skew(a):
    return np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])


def turn(vector):
    """Matrix of a rotation vector, Rodrigues."""
    angle = np.linalg.norm(vector)
    if angle == 0:
        return np.eye(3)
    K = skew(vector / angle)
    return np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K


def vector_of(C):
    """Rotation vector of a matrix near the identity."""
    w = np.array([C[2, 1] - C[1, 2], C[0, 2] - C[2, 0], C[1, 0] - C[0, 1]]) / 2
    size = np.linalg.norm(w)
    return w if size < 1e-12 else w * np.arctan2(size, (np.trace(C) - 1) / 2) / size


def body_to_level(roll, pitch, heading):
    """Right, forward, up to east, north, up."""
    cr, sr, cp, sp, ch, sh = np.cos(roll), np.sin(roll), np.cos(pitch), np.sin(pitch), np.cos(heading), np.sin(heading)
    return (np.array([[ch, sh, 0], [-sh, ch, 0], [0, 0, 1]]) @ np.array([[1, 0, 0], [0, cp, -sp], [0, sp, cp]])
            @ np.array([[cr, 0, sr], [0, 1, 0], [-sr, 0, cr]]))


def dynamics(C, force):
    """F of x' = F x: phi' = -C eps, dv' = [f x] phi + C nab, dp' = dv, b' = d."""
    F = np.zeros((17, 17))
    F[0:3, 9:12], F[3:6, 0:3], F[3:6, 12:15], F[6:9, 3:6], F[15, 16] = -C, skew(force), C, np.eye(3), 1
    return F


def discretise(F, noise, h):
    """Phi and Q of one interval with constant F and densities (Van Loan 1978)."""
    n = len(F)
    M = np.zeros((2 * n, 2 * n))
    M[:n, :n], M[:n, n:], M[n:, n:] = -F, np.diag(noise), F.T
    E = scipy.linalg.expm(M * h)
    Phi = E[n:, n:].T
    return Phi, Phi @ E[:n, n:]


class Navigator:
    """Closed-loop filter over the error: covariance in Joseph form; corrections are fed back after each epoch."""

    def __init__(self, estimate, scenario):
        nav = scenario["model"]["navigation"]
        sd = nav["initial_sd"]
        deg, ug = np.radians(1) / 3600, 1e-6 * G
        self.C, self.v, self.p = body_to_level(*estimate[:3]), estimate[3:6].copy(), estimate[6:9].copy()
        self.gyro, self.accelerometer, self.clock = estimate[9:12].copy(), estimate[12:15].copy(), estimate[15:17].copy()
        self.P = np.diag(np.concatenate([np.full(3, sd["attitude_rad"]), np.full(3, sd["velocity_m_s"]), np.full(3, sd["position_m"]),
                                         np.abs(nav["gyro_bias_deg_h"]) * deg, np.abs(nav["accelerometer_bias_ug"]) * ug,
                                         [sd["clock_bias_m"], sd["clock_drift_m_s"]]])**2)
        self.noise = np.zeros(17)
        self.noise[0:3] = (np.radians(nav["angle_random_walk_deg_sqrt_h"]) / 60)**2
        self.noise[3:6] = (nav["velocity_random_walk_ug_sqrt_hz"] * ug)**2
        self.noise[15], self.noise[16] = nav["clock_sf_m2_s"], nav["clock_sg_m2_s3"]

    def advance(self, h, w, f):
        """One sample. Attitude and velocity of constant w and f, by series of their own: attitude turns evenly, its mean turns the force."""
        w, f = w - self.gyro, f - self.accelerometer
        pieces = 8  # Simpson over the interval
        mean = sum(weight * turn(w * h * i / pieces) for i, weight in enumerate([1, 4, 2, 4, 2, 4, 2, 4, 1])) / 24
        force = self.C @ mean @ f
        middle = self.C @ turn(w * h / 2)
        self.p = self.p + h * self.v + h * h / 2 * (force - [0, 0, G])
        self.v = self.v + h * (force - [0, 0, G])
        self.C = self.C @ turn(w * h)
        self.clock = self.clock + [h * self.clock[1], 0]
        Phi, Q = discretise(dynamics(middle, force), self.noise, h)
        self.P = Phi @ self.P @ Phi.T + Q

    def look(self, satellites, values, sigma):
        """Innovations, H and S."""
        d = satellites - self.p
        size = np.linalg.norm(d, axis=1)
        H = np.zeros((len(values), 17))
        H[:, 6:9], H[:, 15] = d / size[:, None], 1
        return values - size - self.clock[0], H, H @ self.P @ H.T + np.diag(np.full(len(values), sigma**2))

    def update(self, r, H, S, weights, sigma):
        K = np.linalg.solve(S, H @ self.P).T * weights
        A = np.eye(17) - K @ H
        x = K @ r
        self.P = A @ self.P @ A.T + sigma**2 * K @ K.T
        self.C = turn(x[0:3]) @ self.C
        self.v, self.p = self.v - x[3:6], self.p - x[6:9]
        self.gyro, self.accelerometer, self.clock = self.gyro + x[9:12], self.accelerometer + x[12:15], self.clock + x[15:17]
        return x
