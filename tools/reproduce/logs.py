# SPDX-License-Identifier: MIT
"""Arrays of a tracking run's log (port/host/log-format.md)."""

from pathlib import Path

import cbor2
import numpy as np
from program import ReproduceError

# RFC 8746 tags of little-endian arrays.
_TYPES = {64: "u1", 70: "<u4", 85: "<f4", 86: "<f8"}


def over_time(path: Path, key: str) -> np.ndarray:
    """One quantity of the first run, steps x its length."""
    values, ended = [], False
    with path.open("rb") as stream:
        decoder = cbor2.CBORDecoder(stream)
        decoder.decode()
        while not ended:
            try:
                item = decoder.decode()
            except cbor2.CBORDecodeEOF:
                raise ReproduceError(f"{path}: the log was cut") from None
            ended = "end" in item
            if not ended and item["run"] == 0:
                values.append(np.frombuffer(item[key].value, _TYPES[item[key].tag]))
    return np.array(values)
