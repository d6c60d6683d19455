# SPDX-License-Identifier: MIT
"""A record as a C header for replay.c. Usage: replay_data.py RECORD HEADER [KIND NUMBER BYTE]: bit 0 of that byte in the content of the NUMBERth item (from 0)
of KIND (meshkal/record.h) is changed and its CRC made good: the image must find it."""

import struct
import sys
import zlib


def changed(data: bytearray, kind: int, number: int, byte: int) -> None:
    at = 0
    while True:
        found, _, length = struct.unpack_from("<BBI", data, at)
        end = at + 6 + length
        if found == kind:
            number -= 1
        if number < 0:
            break
        at = end + 4
    data[at + 6 + byte] ^= 1
    struct.pack_into("<I", data, end, zlib.crc32(data[at:end]))


def main(record: str, header: str, *change: str) -> None:
    with open(record, "rb") as stream:
        data = bytearray(stream.read())
    if change:
        changed(data, *map(int, change))
    lines = ["/* A record of meshkal simulate. Made by replay_data.py. */", f"enum {{ replay_size = {len(data)} }};", "static const uint8_t replay_record[replay_size] = {"]
    lines += ["    " + " ".join(f"{byte}," for byte in data[at : at + 32]) for at in range(0, len(data), 32)]
    with open(header, "w") as out:
        out.write("\n".join([*lines, "};"]) + "\n")


main(*sys.argv[1:])
