# SPDX-License-Identifier: MIT
"""The error model of a navigation scenario, in NumPy from the scenario's own keys: what the clairvoyant test is told (spec 3.4).

17 states: attitude, velocity, position, gyro bias, accelerometer bias (3 each), clock bias, clock drift; east, north, up.
phi' = -C eps, dv' = [f x] phi + C nab, dp' = dv, biases constant, clock a random walk and its integral.
"""

import numpy as np

STATES = 17
GRAVITY = 9.80665
_DEGREE = np.pi / 180.0
# C and f are taken as constant in a part of an epoch; twice as many change no number that is shown.
_PARTS = 4



def sight(scenario: dict) -> tuple[np.ndarray, np.ndarray]:
    """H, a row for each satellite, and R."""
    elevation, azimuth, sigma = (np.array([node[key] for node in scenario["nodes"]]) for key in ("elevation_deg", "azimuth_deg", "sigma_m"))
    elevation, azimuth = elevation * _DEGREE, azimuth * _DEGREE
    H = np.zeros((len(sigma), STATES))
    H[:, 6:9] = -np.stack([np.cos(elevation) * np.sin(azimuth), np.cos(elevation) * np.cos(azimuth), np.sin(elevation)], axis=1)
    H[:, 15] = 1.0
    return H, np.diag(sigma**2)


def initial(scenario: dict) -> np.ndarray:
    navigation = scenario["model"]["navigation"]
    sd = navigation["initial_sd"]
    gyro = np.array(sd.get("gyro_bias_deg_h", np.abs(navigation["gyro_bias_deg_h"]))) * _DEGREE / 3600.0
    accelerometer = np.array(sd.get("accelerometer_bias_ug", np.abs(navigation["accelerometer_bias_ug"]))) * 1e-6 * GRAVITY
    motion = np.repeat([sd["attitude_rad"], sd["velocity_m_s"], sd["position_m"]], 3)
    return np.diag(np.concatenate([motion, gyro, accelerometer, [sd["clock_bias_m"], sd["clock_drift_m_s"]]]) ** 2)


def transitions(scenario: dict, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """Phi and Q of every epoch, (steps, 17, 17)."""
    navigation = scenario["model"]["navigation"]
    dt = navigation.get("dt_s", 1.0)
    h = dt / _PARTS
    times = navigation.get("start_s", 0.0) + (np.arange(steps * _PARTS) + 0.5) * h
    C, force = _flight(navigation, times)
    F = np.zeros((len(times), STATES, STATES))
    F[:, 0:3, 9:12], F[:, 3:6, 12:15] = -C, C
    F[:, 3, 1], F[:, 3, 2], F[:, 4, 2] = -force[:, 2], force[:, 1], -force[:, 0]
    F[:, 4, 0], F[:, 5, 0], F[:, 5, 1] = force[:, 2], -force[:, 1], force[:, 0]
    F[:, 6:9, 3:6], F[:, 15, 16] = np.eye(3), 1.0
    noise = np.zeros(STATES)
    noise[0:3] = (navigation["angle_random_walk_deg_sqrt_h"] * _DEGREE / 60.0) ** 2
    noise[3:6] = (navigation["velocity_random_walk_ug_sqrt_hz"] * 1e-6 * GRAVITY) ** 2
    noise[15], noise[16] = navigation["clock_sf_m2_s"], navigation["clock_sg_m2_s3"]
    half, whole = _exponential(F, h / 2), _exponential(F, h)
    W = np.diag(noise)
    part = h / 6.0 * (W + 4.0 * half @ W @ half.swapaxes(1, 2) + whole @ W @ whole.swapaxes(1, 2))  # Simpson's rule
    Phi, Q = np.tile(np.eye(STATES), (steps, 1, 1)), np.zeros((steps, STATES, STATES))
    for i in range(_PARTS):
        A = whole[i::_PARTS]
        Phi, Q = A @ Phi, A @ Q @ A.swapaxes(1, 2) + part[i::_PARTS]
    return Phi, Q


def _exponential(F: np.ndarray, h: float) -> np.ndarray:
    """F is nilpotent of degree 4."""
    A = F * h
    return np.eye(STATES) + A @ (np.eye(STATES) + A @ (np.eye(STATES) + A / 3.0) / 2.0)


def _flight(navigation: dict, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Body-to-level matrix, body axes right, forward, up, and specific force in level axes. Heading and height change by raised cosines."""
    speed, gravity = navigation.get("speed_m_s", 100.0), navigation.get("gravity_m_s2", GRAVITY)
    heading = np.full(len(times), navigation.get("heading_deg", 0.0) * _DEGREE)
    turn, climb, climb_rate = (np.zeros(len(times)) for _ in range(3))
    for maneuver in navigation.get("maneuvers", []):
        T = maneuver["to_s"] - maneuver["from_s"]
        phase = 2.0 * np.pi * np.clip((times - maneuver["from_s"]) / T, 0.0, 1.0)
        done, rate, change = (phase - np.sin(phase)) / (2.0 * np.pi), (1.0 - np.cos(phase)) / T, 2.0 * np.pi * np.sin(phase) / T**2
        if "turn_deg" in maneuver:
            heading += maneuver["turn_deg"] * _DEGREE * done
            turn += maneuver["turn_deg"] * _DEGREE * rate
        else:
            climb += maneuver["climb_m"] * rate
            climb_rate += maneuver["climb_m"] * change
    level = np.sqrt(speed**2 - climb**2)
    forward = np.stack([np.sin(heading), np.cos(heading), np.zeros(len(times))], axis=1)
    side = np.stack([np.cos(heading), -np.sin(heading), np.zeros(len(times))], axis=1)
    up = np.array([0.0, 0.0, 1.0])
    slowing = -climb * climb_rate / level
    force = forward * slowing[:, None] + side * (level * turn)[:, None] + up * (climb_rate + gravity)[:, None]
    roll, pitch = np.arctan2(level * turn, gravity), np.arctan2(climb, level)
    nose = forward * np.cos(pitch)[:, None] + up * np.sin(pitch)[:, None]
    top = up * np.cos(pitch)[:, None] - forward * np.sin(pitch)[:, None]
    right = side * np.cos(roll)[:, None] - top * np.sin(roll)[:, None]
    above = top * np.cos(roll)[:, None] + side * np.sin(roll)[:, None]
    return np.stack([right, nose, above], axis=2), force
