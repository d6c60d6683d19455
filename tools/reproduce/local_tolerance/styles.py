# SPDX-License-Identifier: MIT
"""One colour a filter, everywhere: of Okabe and Ito, told apart by the colour-blind."""

ON_WHITE = {"kfc": "#999999", "rkfc": "#000000", "kfd": "#e69f00", "rkfdu": "#56b4e9", "rkfdnu": "#d55e00", "rkfdnu2": "#009e73"}
# Black vanishes on rerun's background.
ON_DARK = ON_WHITE | {"rkfc": "#ffffff"}
