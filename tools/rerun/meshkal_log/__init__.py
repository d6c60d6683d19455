# SPDX-License-Identifier: MIT
"""Reads Meshkal run logs (port/host/log-format.md): `read` gives numpy arrays, `convert` writes CSV, Parquet or MCAP (tables.md)."""

from .reader import LogError
from .run import LogWarning, Run, read, read_runs

__all__ = ["LogError", "LogWarning", "Run", "convert", "read", "read_runs"]


def convert(*arguments, **options) -> list[str]:
    """See `meshkal_log.converting.convert`."""
    # pyarrow takes longer to import than many logs to read.
    from .converting import convert as write

    return write(*arguments, **options)
