# SPDX-License-Identifier: MIT
"""The wire format of <meshkal/frame.h> against struct, zlib and numpy: every byte, every number, every size that the header states."""
import ctypes
import pathlib
import re
import struct
import zlib

import numpy
import pytest

ROOT = pathlib.Path(__file__).resolve().parents[2]
OK, NOT_FINITE = 0, 3
FORMATS = {0: numpy.float32, 1: numpy.float64, 2: numpy.float16}
BYTES = ctypes.c_char_p


class Frame(ctypes.Structure):
    _fields_ = [("model", ctypes.c_uint32), ("step", ctypes.c_uint32), ("node", ctypes.c_uint16), ("stage", ctypes.c_uint8), ("numbers", ctypes.c_uint8),
                ("with_model", ctypes.c_uint8), ("sealed", ctypes.c_uint8), ("length", ctypes.c_uint16), ("payload", ctypes.c_void_p)]


@pytest.fixture(scope="module")
def library(shared):
    code = shared("src/meshkal/meshkal.c")
    code.mk_crc32.restype = ctypes.c_uint32
    code.mk_crc32.argtypes = [ctypes.c_uint32, BYTES, ctypes.c_size_t]
    code.mk_frame_write.restype = ctypes.c_size_t
    code.mk_frame_read.argtypes = [BYTES, ctypes.c_size_t, ctypes.POINTER(Frame)]
    return code


def status_of(header, name):
    """Number of a status in the enum of base.h."""
    names = re.findall(r"^    (MK_\w+)", (ROOT / "include/meshkal/base.h").read_text().split("typedef enum {")[1].split("}")[0], re.M)
    return names.index(name)


def random_numbers(kind, count, seed):
    """Every bit pattern is as likely as any other."""
    return numpy.random.default_rng(seed).integers(0, 2**(8 * kind().itemsize), count, dtype=f"u{kind().itemsize}").view(kind)


def around(kind, edges):
    """The numbers beside each edge, of both signs."""
    edges = numpy.asarray(edges, kind)
    near = [edges]
    for way in (numpy.inf, -numpy.inf):
        number = edges
        for _ in range(3):
            number = numpy.nextafter(number, kind(way), dtype=kind)
            near.append(number)
    near = numpy.concatenate(near)
    return numpy.concatenate([near, -near])


def hard(kind, format):
    """Zeros, limits, and ties between neighbours of the narrow format, with the numbers beside them."""
    with numpy.errstate(all="ignore"):
        info = numpy.finfo(format)
        edges = [0.0, info.smallest_subnormal / 2, info.smallest_subnormal, info.tiny, info.max, 1.0, numpy.finfo(kind).max, numpy.finfo(kind).tiny]
        edges.append(float(info.max) * (1 + float(info.eps) / 4))
        if numpy.finfo(kind).nmant > info.nmant:
            low = random_numbers(format, 20000, 3)
            low = numpy.abs(low[numpy.isfinite(low)])
            low = low[low < info.max]
            edges += list((low.astype(kind) + numpy.nextafter(low, format(numpy.inf), dtype=format).astype(kind)) / 2)
        return around(kind, numpy.array(edges).astype(kind))


def call(function, format, count, source, target):
    return function(format, count, source.ctypes.data_as(ctypes.c_void_p), target.ctypes.data_as(ctypes.c_void_p))


def convert_all(function, format, source, wanted, size):
    """Converts finite results in one call and tries the others one by one."""
    good = numpy.isfinite(wanted)
    inputs, outputs = numpy.ascontiguousarray(source[good]), numpy.zeros(good.sum() * size + 8, numpy.uint8)
    outputs[-8:] = 0x5a
    assert call(function, format, len(inputs), inputs, outputs) == OK
    assert outputs[:-8].tobytes() == wanted[good].tobytes()
    assert (outputs[-8:] == 0x5a).all(), "written beyond the end"
    bad = source[~good]
    for i in numpy.random.default_rng(1).permutation(len(bad))[:2000]:
        assert call(function, format, 1, bad[i:i + 1].copy(), numpy.zeros(8, numpy.uint8)) == NOT_FINITE, bad[i]


@pytest.mark.parametrize("format", FORMATS)
@pytest.mark.parametrize("own", [numpy.float32, numpy.float64])
def test_numbers(library, own, format):
    """To the nearest, ties to even, subnormals, overflow, NaN: the bits of numpy, in both directions."""
    other = FORMATS[format]
    put, get = (getattr(library, f"mk_numbers_{way}_f{8 * own().itemsize}") for way in ("put", "get"))
    with numpy.errstate(all="ignore"):
        values = numpy.concatenate([random_numbers(own, 1000000, 1), hard(own, other), random_numbers(other, 200000, 2).astype(own),
                                    (10.0 ** numpy.random.default_rng(4).uniform(-9, 6, 300000)).astype(own)])
        convert_all(put, format, values, values.astype(other), other().itemsize)
        values = numpy.arange(65536, dtype=numpy.uint16).view(other) if other is numpy.float16 else \
            numpy.concatenate([random_numbers(other, 1000000, 5), hard(other, own), values[:300000].astype(other)])
        convert_all(get, format, values, values.astype(own), own().itemsize)


def test_numbers_stop(library):
    """One bad number among good ones is found wherever it stands."""
    for place in range(5):
        values = numpy.ones(5)
        values[place] = 65520.0
        assert call(library.mk_numbers_put_f64, 2, 5, values, numpy.zeros(40, numpy.uint8)) == NOT_FINITE
        values[place] = 65519.99
        assert call(library.mk_numbers_put_f64, 2, 5, values, numpy.zeros(40, numpy.uint8)) == OK


def test_crc(library):
    random = numpy.random.default_rng(6)
    assert library.mk_crc32(0, b"123456789", 9) == 0xCBF43926
    for length in list(range(70)) + [1000, 65551]:
        text = random.bytes(length)
        assert library.mk_crc32(0, text, length) == zlib.crc32(text)
        cut = int(random.integers(0, length + 1))
        assert library.mk_crc32(library.mk_crc32(0, text[:cut], cut), text[cut:], length - cut) == zlib.crc32(text)


def plain(stage, numbers, flags, node, model, step, payload, version=1):
    text = struct.pack("<BBHII", version, stage | numbers << 2 | flags, node, model, step) + payload
    return text + struct.pack("<I", zlib.crc32(text))


def test_plain(library):
    """Written, the frame is the page of the header; read, it is what was written."""
    random = numpy.random.default_rng(7)
    for _ in range(3000):
        stage, numbers, with_model = int(random.integers(1, 3)), int(random.integers(0, 3)), int(random.integers(0, 2))
        with_model &= stage == 1
        payload = random.bytes(int(random.integers(0, 200)))
        node, model, step = int(random.integers(0, 2**16)), int(random.integers(0, 2**32)), int(random.integers(0, 2**32))
        wanted = plain(stage, numbers, with_model << 4, node, model, step, payload)
        text = ctypes.create_string_buffer(b"\xee" * (len(wanted) + 4), len(wanted) + 4)
        ctypes.memmove(ctypes.byref(text, 12), payload, len(payload))
        frame = Frame(model, step, node, stage, numbers, with_model, 0, len(payload), None)
        assert library.mk_frame_write(ctypes.byref(frame), text, None, ctypes.c_uint64(0)) == len(wanted)
        assert text.raw == wanted + b"\xee" * 4
        found = Frame()
        assert library.mk_frame_read(wanted, len(wanted), ctypes.byref(found)) == OK
        assert all(getattr(found, name) == getattr(frame, name) for name, _ in Frame._fields_[:-1])
        assert ctypes.string_at(found.payload, found.length) == payload


SEAL = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.POINTER(ctypes.c_uint8), ctypes.POINTER(ctypes.c_uint8), ctypes.c_size_t,
                        ctypes.POINTER(ctypes.c_uint8), ctypes.c_size_t, ctypes.POINTER(ctypes.c_uint8))


def test_sealed(library):
    """Where a seal's nonce, header, text and tag stand; the seal itself is the caller's, here one that can be told at a glance."""
    class Aead(ctypes.Structure):
        _fields_ = [("seal", SEAL), ("open", SEAL), ("context", ctypes.c_void_p)]

    seen = {}

    @SEAL
    def seal(_, nonce, header, header_length, text, length, tag):
        seen.update(nonce=bytes(nonce[:12]), header=bytes(header[:header_length]), text=bytes(text[:length]))
        for i in range(length):
            text[i] ^= 0xff
        for i in range(16):
            tag[i] = i
        return seen.get("good", 1)

    aead = Aead(seal, seal, None)
    payload, sequence = b"seventeen bytes..", 0x1122334455667788
    header = struct.pack("<BBHIIQ", 1, 2 | 1 << 2 | 32, 0xabcd, 0xdeadbeef, 0x01020304, sequence)
    wanted = header + bytes(b ^ 0xff for b in payload) + bytes(range(16))
    text = ctypes.create_string_buffer(len(wanted))
    ctypes.memmove(ctypes.byref(text, 20), payload, len(payload))
    frame = Frame(0xdeadbeef, 0x01020304, 0xabcd, 2, 1, 0, 1, len(payload), None)
    assert library.mk_frame_write(ctypes.byref(frame), text, ctypes.byref(aead), ctypes.c_uint64(sequence)) == len(wanted)
    assert text.raw == wanted
    assert seen == {"nonce": struct.pack("<HHQ", 0xabcd, 0, sequence), "header": header, "text": payload}
    found = Frame()
    assert library.mk_frame_read(wanted, len(wanted), ctypes.byref(found)) == OK
    assert found.sealed == 1 and found.length == len(payload) and ctypes.string_at(found.payload, found.length) == wanted[20:37]
    seen["good"] = 0
    assert library.mk_frame_write(ctypes.byref(frame), text, ctypes.byref(aead), ctypes.c_uint64(sequence)) == 0


@pytest.mark.parametrize("sealed", [0, 1])
def test_types(library, sealed):
    """All 256 type bytes: those that the page does not know are refused, the others say what they said."""
    for kind in range(256):
        if bool(kind & 32) != bool(sealed):
            continue
        text = plain(0, 0, 0, 5, 6, 7, bytes(40))
        text = bytes([text[0], kind]) + text[2:-4]
        text += struct.pack("<I", zlib.crc32(text))
        stage, numbers = kind & 3, kind >> 2 & 3
        known = kind < 64 and stage in (1, 2, 3) and numbers < 3 and not (kind & 16 and stage != 1)
        found = Frame()
        assert library.mk_frame_read(text, len(text), ctypes.byref(found)) == (OK if known else status_of("base.h", "MK_ERROR_TYPE"))
        if known:
            assert (found.stage, found.numbers, found.with_model, found.sealed) == (stage, numbers, kind >> 4 & 1, sealed)
        else:
            assert bytes(found) == bytes(Frame()), "written although it was refused"


def test_sizes():
    """The table of frame.h is arithmetic on the layout, and says what fits."""
    text = (ROOT / "include/meshkal/frame.h").read_text()
    rows = re.findall(r"^ \* +(\d+), (\d+) +(\d+) +(\d+) +(\d+) +(\d+) +(\d+) +(\d+) +(\d+)$", text, re.M)
    assert len(rows) == 4
    for row in rows:
        n, m, *sizes = map(int, row)
        model = m * (n + 1)
        assert sizes == [16 + 4 * m, 16 + 4 * n, 16 + 8 * n, 36 + 4 * n, 36 + 8 * n, 16 + 4 * model, 16 + 2 * model]
    rows = re.findall(r"^ \* +(\d+)" + 12 * r" +(\d+)" + "$", text, re.M)
    assert len(rows) == 3
    for row in rows:
        n, *sizes = map(int, row)
        count = n + n * (n + 1) // 2
        assert sizes == [other + 3 + size * numbers for other, numbers in ((16, count), (36, count), (16, count + 1), (16, count + n)) for size in (4, 8, 2)]
