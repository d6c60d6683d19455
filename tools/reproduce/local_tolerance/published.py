# SPDX-License-Identifier: MIT
"""Numbers that were not computed here, all for c = 0.02: the paper's Table 1, and (minimum, median, maximum) of an independent
reproduction over 30 random draws, geometric networks with 4.4 to 8.7 neighbours on average. MSD of the full state, dB."""

MSD_DB = {"rkfc": -2.9174, "rkfdu": -1.5553, "rkfdnu": -1.6182, "rkfdnu2": -1.6182}
TOLERANCE = {"rkfc": 0.02, "rkfdu": 0.02, "rkfdnu": 0.0144, "rkfdnu2": 0.0144}
THETA = {"rkfc": 1.3366, "rkfdu": 0.3764, "rkfdnu": 0.3576, "rkfdnu2": 0.3576}
GAIN_DB = 0.0629

INDEPENDENT_MSD_DB = {"rkfc": (-3.69, -2.95, -1.41), "kfd": (-1.89, -1.00, 0.41), "rkfdu": (-2.57, -1.56, 0.09), "rkfdnu": (-2.58, -1.59, -0.07)}
INDEPENDENT_TOLERANCE = {"rkfdnu": (0.0146, 0.0151, 0.0159)}
INDEPENDENT_THETA = {"rkfc": (0.94, 1.38, 1.59), "rkfdu": (0.28, 0.41, 0.68), "rkfdnu": (0.27, 0.39, 0.65)}
INDEPENDENT_GAIN_DB = (0.003, 0.060, 0.160)
