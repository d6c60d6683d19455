# SPDX-License-Identifier: MIT
"""Turns a Meshkal run log (port/host/log-format.md) into a rerun recording."""
