# SPDX-License-Identifier: MIT
"""What is drawn of a navigation log besides the quantities of derive.py. Numbers only, no rerun."""

from dataclasses import dataclass

import numpy as np

from meshkal_log.fields import Batch
from meshkal_log.scenario import NAVIGATION_POSITION, Scenario
from . import derive
from . import tracking as numbers

_DEGREES_AN_HOUR = np.rad2deg(1.0) * 3600.0
_MICRO_G = 1e6 / 9.80665
_AXES, _BODY = ("east", "north", "up"), ("right", "forward", "up")


@dataclass(frozen=True)
class Group:
    """States that are drawn together, in a unit of their own."""

    key: str
    name: str
    unit: str
    first: int
    labels: tuple[str, ...]
    scale: float = 1.0  # from SI
    angle: bool = False


GROUPS = (
    Group("attitude", "Attitude", "mrad", 0, ("roll", "pitch", "heading"), 1e3, angle=True),
    Group("velocity", "Velocity", "m/s", 3, _AXES),
    Group("position", "Position", "m", NAVIGATION_POSITION[0], _AXES),
    Group("gyro_bias", "Gyro bias", "deg/h", 9, _BODY, _DEGREES_AN_HOUR),
    Group("accelerometer_bias", "Accelerometer bias", "micro-g", 12, _BODY, _MICRO_G),
    Group("clock_bias", "Clock bias", "m", 15, ("clock bias",)),
    Group("clock_drift", "Clock drift", "m/s", 16, ("clock drift",)),
)
POSITION = next(group for group in GROUPS if group.key == "position")


def per_estimator(batch: Batch, scenario: Scenario) -> dict[str, np.ndarray]:
    """Arrays (T, 1) by the name of the quantity."""
    quantities = {}
    if batch.nees is not None:
        quantities["nees"] = derive.finite(batch.nees)
    error = numbers.position_error(batch, scenario)
    if error is not None:
        quantities["position_error"] = error
    return quantities


def errors(batch: Batch, group: Group) -> np.ndarray:
    """Estimate less truth (T, ..) in the group's unit; of angles the shorter way round."""
    some = slice(group.first, group.first + len(group.labels))
    away = batch.estimate[:, 0, some] - batch.truth[:, some]
    if group.angle:
        with np.errstate(invalid="ignore"):
            away = np.where(np.abs(away) > np.pi, np.remainder(away + np.pi, 2.0 * np.pi) - np.pi, away)
    return derive.finite(group.scale * away)


def estimates(batch: Batch, group: Group) -> np.ndarray:
    return derive.finite(group.scale * batch.estimate[:, 0, group.first : group.first + len(group.labels)])


def position_sigma(batch: Batch) -> np.ndarray:
    """Standard deviations east, north, up (T, 3)."""
    return np.sqrt(np.maximum(derive.finite(batch.position_covariance[:, 0, [0, 2, 5]]), 0.0))


def sky(azimuth_deg: np.ndarray, elevation_deg: np.ndarray) -> np.ndarray:
    """Places (.., 2) in a picture whose y points down: zenith in the middle, a degree is 1, north up, east right. NaN where unknown."""
    from_zenith, azimuth = 90.0 - np.asarray(elevation_deg, dtype=np.float64), np.deg2rad(azimuth_deg)
    return np.stack([from_zenith * np.sin(azimuth), -from_zenith * np.cos(azimuth)], axis=-1)
