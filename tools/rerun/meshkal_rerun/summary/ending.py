# SPDX-License-Identifier: MIT
"""How a log ended, in words for a summary."""

ENDINGS = {
    "complete": "complete",
    "interrupted": "run was interrupted",
    "failed": "**the run failed: a node could not go on**",
    "damaged": "**damaged: the rest cannot be read**",
    "stopped": "**not read to its end: the conversion was stopped**",
    "live": "goes on",
    None: "**cut: the end is missing**",
}
