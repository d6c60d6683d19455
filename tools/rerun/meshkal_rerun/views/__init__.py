# SPDX-License-Identifier: MIT
"""Blueprints: what the viewer shows of a recording."""

# By their names on the command line, which is quicker to understand without rerun.
VIEWS = ("overview", "node", "compare", "integrity", "consensus", "summary")
