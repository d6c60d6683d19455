# SPDX-License-Identifier: MIT
"""<meshkal/monitor.h> for Python by ctypes: monitors of any dimensions and either precision."""
import ctypes
from ctypes import byref, c_double, c_float, c_int, c_uint8, c_uint16, c_uint32, c_void_p

import numpy as np
from scipy import stats

RCTM, AIME, IMPROVED, EXCLUDE = range(4)


class Types:
    """The structs of one precision."""

    def __init__(self, bits):
        real = self.real = {32: c_float, 64: c_double}[bits]
        self.numpy, self.suffix = {32: np.float32, 64: np.float64}[bits], f"_f{bits}"

        def struct(name, *fields):
            return type(name, (ctypes.Structure,), {"_fields_": fields})
        self.config = struct("Config", ("m", c_uint16), ("places", c_uint16), ("window", c_uint16), ("threshold", c_void_p), ("jump", real),
                             ("separation", real), ("evidence", real), ("zero", c_void_p), ("back", c_void_p), ("level", real), ("slope", real),
                             ("most", c_uint16), ("patience", c_uint16), ("scheme", c_uint8))
        self.watched = struct("Watched", ("id", c_uint16), ("used", c_uint8), ("rows", c_uint8), ("faulty", c_uint8), ("begun", c_uint8), ("w", real),
                              ("ratio", real), ("evidence", real), *((name, c_uint32) for name in ("speaking", "counted", "since", "until", "faults")))
        self.core = struct("Core", ("config", c_void_p), *((name, real) for name in ("rctm", "aime", "rctm_ratio", "aime_ratio", "rho", "median")),
                           *((name, c_uint16) for name in ("rows", "window_rows", "held", "faulty", "failed")),
                           *((name, c_uint8) for name in ("alarm", "ended", "unresolved")),
                           *((name, c_uint32) for name in ("epoch", "alarm_since", "alarms", "ends", "crowded", "rejected")),
                           *((name, c_uint16) for name in ("front", "back", "quiet", "waited")), ("rhos", real * 3))
        self.fault = struct("Fault", ("level", real), ("slope", real), ("P", real * 3), ("sum", real), ("all", real))
        self.view = struct("View", *((name, c_void_p) for name in ("core", "sensor", "fault", "information", "v", "seen", "work")))


TYPES = {32: Types(32), 64: Types(64)}


def pack(S):
    return np.asarray(S)[np.tril_indices(len(S))]


def covariance(g, n):
    """Well conditioned, correlated throughout, different in every epoch."""
    A = g.standard_normal((n, n + 2))
    return A @ A.T / n + 0.3 * np.eye(n)


class Monitor:
    """`code` is the library. Scratch memory holds NaN before every epoch, and behind it numbers that must stay."""

    def __init__(self, code, m, places, window, scheme=AIME, bits=64, false_alarm=8e-10, early=0.01, epochs=1000, zero=1e-3, back=0.1, **config):
        self.code, self.types, self.window, N = code, TYPES[bits], window, m * places
        t = self.types
        self.threshold = stats.chi2.isf(false_alarm, np.arange(1, N + 1)).astype(t.numpy)
        self.zero, self.back = (stats.chi2.isf(p, np.arange(1, m + 1)).astype(t.numpy) for p in (zero, back))
        self.config = t.config(m=m, places=places, window=window, threshold=self.threshold.ctypes.data, jump=2 * window, evidence=np.log(epochs / early),
                               zero=self.zero.ctypes.data, back=self.back.ctypes.data, level=0.01, slope=1e-4, most=places, scheme=scheme)
        for name, value in config.items():
            setattr(self.config, name, value)
        self.core, self.sensor, self.fault = t.core(), (t.watched * places)(), (t.fault * N)()
        packed = N * (N + 1) // 2
        self.information, self.v = np.zeros((window + 1, packed), t.numpy), np.zeros((window + 1, N), t.numpy)
        self.seen, self.used = np.zeros(window, np.uint32), 3 * packed + 4 * N
        self.work = np.full(self.used + 16, 12345, t.numpy)
        self.view = t.view(*(ctypes.addressof(s) for s in (self.core, self.sensor, self.fault)),
                           *(a.ctypes.data for a in (self.information, self.v, self.seen, self.work)))
        assert self.call("start", m, places, window, byref(self.view), byref(self.config)) == 0

    def call(self, name, *arguments):
        return getattr(self.code, f"mk_monitor_{name}{self.types.suffix}")(*arguments)

    def watch(self, ids, rows, r, S):
        """S is dense. Returns the status."""
        return self.watch_packed(np.asarray(ids, np.uint16), np.asarray(rows, np.uint8), np.ascontiguousarray(r, self.types.numpy),
                                 np.ascontiguousarray(pack(S) if len(r) else [], self.types.numpy))

    def watch_packed(self, ids, rows, r, S):
        self.work[:self.used] = np.nan
        found = self.call("watch", byref(self.view), c_int(len(ids)), *(c_void_p(a.ctypes.data) for a in (ids, rows, r, S)))
        assert (self.work[self.used:] == 12345).all(), "scratch memory overrun"
        return found

    def of(self, id):
        """What is known of this sensor, or None."""
        found = [s for s in self.sensor if s.used and s.id == id]
        assert len(found) < 2
        return found[0] if found else None

    def faults(self, id):
        """The trackers of its rows."""
        place = next(p for p, s in enumerate(self.sensor) if s.used and s.id == id)
        return self.fault[place * self.config.m:(place + 1) * self.config.m]
