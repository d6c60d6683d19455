# SPDX-License-Identifier: MIT
"""Logs decoded with nothing but CBOR and NumPy, for tests of what is computed from them."""

from pathlib import Path

import cbor2
import numpy as np

_TYPES = {86: "<f8", 85: "<f4", 70: "<u4", 64: "u1"}


class Decoded:
    """`header`, and arrays (T, length) of one run by key."""

    def __init__(self, path: Path, run: int = 0) -> None:
        with open(path, "rb") as stream:
            decoder = cbor2.CBORDecoder(stream)
            self.header = decoder.decode()
            items = []
            while "end" not in (item := decoder.decode()):
                if item["run"] == run:
                    items.append(item)
        self.step = np.array([item["step"] for item in items])
        self.arrays = {key: np.stack([_array(item[key]) for item in items]) for key in items[0] if key not in ("run", "step")}

    def __getitem__(self, key: str) -> np.ndarray:
        return self.arrays[key]

    def estimates(self) -> np.ndarray:
        """(T, E, n)"""
        return self["estimate"].astype(float).reshape(len(self.step), self.header["estimators"], -1)


def _array(value: object) -> np.ndarray:
    if isinstance(value, cbor2.CBORTag):
        return np.frombuffer(value.value, _TYPES[value.tag])
    # Newer cbor2 decode typed arrays themselves.
    return np.asarray(value)
