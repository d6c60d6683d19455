# SPDX-License-Identifier: MIT
"""The paper has no table: numbers of an independent reproduction, steps 21 to 80 of 50 runs. RMSE of the position at the nodes (least, most) and
of the centralised filter, and the largest disagreement, metres."""

NODES = {
    "all, paper, 10": (0.766,),
    "all, metropolis, 50": (0.763,),
    "100 m, paper, 10": (0.912, 0.915),
    "85 m, paper, 1": (8.0, 11.0),
    "85 m, paper, 3": (7.2,),
    "85 m, paper, 10": (5.26,),
    "alone": (45.0, 64.0),
}
CENTRALISED = {"all": 0.763, "100 m": 0.918, "85 m": 5.22}
DISAGREEMENT = {
    "all, paper, 10": 1e-3,
    "all, metropolis, 50": 1e-9,
    "100 m, paper, 10": 3e-3,
    "85 m, paper, 1": 4.8,
    "85 m, paper, 3": 0.24,
    "85 m, paper, 10": 0.012,
    "alone": 80.0,
}
