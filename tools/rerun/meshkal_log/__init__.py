# SPDX-License-Identifier: MIT
"""Reads Meshkal run logs (port/host/log-format.md)."""
