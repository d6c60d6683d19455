# SPDX-License-Identifier: MIT
"""Logs of meshkal simulate (port/host/log-format.md), read by the tests themselves."""
import io

import cbor2
import numpy as np

TYPES = {86: "<f8", 85: "<f4", 70: "<u4", 64: "u1"}  # RFC 8746


def typed(decoder, tag):
    return np.frombuffer(tag.value, TYPES[tag.tag]) if tag.tag in TYPES else tag


def items(data):
    """(item, end of its bytes) of every whole item, and whether something is left of a cut one."""
    stream, found = io.BytesIO(data), []
    while stream.tell() < len(data):
        try:
            found.append((cbor2.load(stream, tag_hook=typed), stream.tell()))
        except cbor2.CBORDecodeEOF:
            return found, True
    return found, False


def log(data):
    """Header, step items, end item of a whole log."""
    found, cut = items(data)
    assert not cut
    return found[0][0], [item for item, _ in found[1:-1]], found[-1][0]
