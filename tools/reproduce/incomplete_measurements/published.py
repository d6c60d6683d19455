# SPDX-License-Identifier: MIT
"""Numbers that were not computed here: the paper's table, and those of an independent reproduction (gate in MPUKF only, literal IUKF).
Mean over time of the natural logarithm of the mean squared error, position in m and velocity in m/s; seconds of unknown work."""

FILTERS = ("iukf-literal", "pukf", "mpukf")
POSITION = {"iukf-literal": -4.372, "pukf": -4.981, "mpukf": -5.191}
VELOCITY = {"iukf-literal": -7.894, "pukf": -8.592, "mpukf": -8.787}
TIME_S = {"iukf-literal": 0.126, "pukf": 0.156, "mpukf": 0.108}

INDEPENDENT_POSITION = {"iukf-literal": -4.15, "pukf": -4.80, "mpukf": -5.23}
INDEPENDENT_VELOCITY = {"iukf-literal": -6.60, "pukf": -8.34, "mpukf": -8.61}
