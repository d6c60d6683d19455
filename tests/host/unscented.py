# SPDX-License-Identifier: MIT
"""<meshkal/unscented.h> for Python: filters of any dimensions and either precision by ctypes, with models that are Python functions of whole
arrays."""
import ctypes
import pathlib
import re
from ctypes import POINTER, byref, c_double, c_float, c_int, c_uint8, c_uint16, c_uint32, c_void_p

import numpy as np

ROOT = pathlib.Path(__file__).resolve().parents[2]
UNSCENTED, EXTENDED, PROGRESSIVE, ITERATED, LITERAL = range(5)
NO_RULE, INNOVATION, MAHALANOBIS = range(3)
SKIP, INFLATE = range(2)
NORMAL, STUDENT = range(2)
NAMES = re.findall(r"^    MK_(\w+)", (ROOT / "include/meshkal/base.h").read_text().split("typedef enum {")[1].split("}")[0], re.M)
OK = NAMES.index("OK")


def status(name):
    return NAMES.index("ERROR_" + name)


class Model:
    """function(x, dt), jacobian(x, dt): x is points x n and may be of any float type; difference(a, b) and mean(weights, y) on rows."""

    def __init__(self, rows, function, jacobian=None, difference=None, mean=None):
        self.rows, self.function, self.jacobian, self.difference, self.mean = rows, function, jacobian, difference, mean


class Types:
    """The structs of one precision."""

    def __init__(self, bits):
        real = self.real = {32: c_float, 64: c_double}[bits]
        pointer = POINTER(real)
        self.bits, self.numpy, self.suffix = bits, {32: np.float32, 64: np.float64}[bits], f"_f{bits}"
        self.function = ctypes.CFUNCTYPE(c_int, c_void_p, real, c_int, pointer, pointer)
        self.jacobian = ctypes.CFUNCTYPE(c_int, c_void_p, real, pointer, pointer)
        self.difference = ctypes.CFUNCTYPE(None, c_void_p, pointer, pointer, pointer)
        self.mean = ctypes.CFUNCTYPE(None, c_void_p, c_int, pointer, pointer, pointer)

        def struct(name, *fields):
            return type(name, (ctypes.Structure,), {"_fields_": fields})
        self.gate = struct("Gate", ("sensor", c_void_p), ("stacked", c_void_p), ("patience", c_uint16), ("policy", c_uint8))
        self.weights = struct("Weights", ("k0", c_void_p), ("k1", c_void_p), ("weight", c_void_p), ("statistic", c_void_p), ("kind", c_uint8))
        self.record = struct("Record", ("d2", real), ("ratio", real), ("accepted", c_uint32), ("rejected", c_uint32), ("inflated", c_uint32),
                             ("since_accepted", c_uint32))
        self.transform = struct("Transform", ("spread", real), ("correction", real))
        self.space = struct("Space", ("difference", self.difference), ("mean", self.mean), ("context", c_void_p))
        self.model = struct("Model", ("function", self.function), ("jacobian", self.jacobian), ("context", c_void_p), ("space", c_void_p))
        self.sensor = struct("Sensor", ("model", self.model), ("R", c_void_p), ("rows", c_uint8))
        self.transition = struct("Transition", ("model", self.model), ("A", c_void_p), ("Q", c_void_p))
        self.config = struct("Config", ("n", c_uint16), ("m", c_uint16), ("slots", c_uint16), ("transition", self.transition), ("sensor", c_void_p),
                             ("x0", c_void_p), ("P0", c_void_p), ("transform", self.transform), ("gate", c_void_p), ("increments", c_uint16),
                             ("update", c_uint8), ("rule", c_uint8), ("one_at_a_time", c_uint8), ("weights", c_void_p))
        self.core = struct("Core", ("config", c_void_p), ("stacked", self.record), ("nis", real),
                           *((name, c_uint16) for name in ("nis_rows", "measurements", "increments", "gated_updates", "failed")),
                           ("stopped", c_uint8), ("started", c_uint8),
                           *((name, c_uint32) for name in ("predictions", "updates", "rule_fired", "reinitialised", "rejected")),
                           ("weighted_rows", c_uint16), ("unused_rows", c_uint16))
        self.view = struct("View", *((name, c_void_p) for name in ("core", "x", "L", "z", "have", "record", "work")))


TYPES = {32: Types(32), 64: Types(64)}


def pack(S):
    return np.asarray(S)[np.tril_indices(len(S))]


def unpack(packed, n):
    S = np.zeros((n, n), np.asarray(packed).dtype)
    S[np.tril_indices(n)] = packed
    return S + np.tril(S, -1).T


def transform(n, alpha=1.0, beta=0.0, kappa=0.0):
    """What MK_TRANSFORM_SCALED says, which is MK_TRANSFORM_JULIER for alpha = 1, beta = 0."""
    return alpha**2 * (n + kappa), beta - alpha**2


class Filter:
    """`code` is the library. Calls return the status. Scratch memory holds NaN before every call, and behind it numbers that must stay.

    motion: a Model, or a matrix A; sensors: pairs (Model, R); gate: dictionary of sensor, stacked (arrays), patience, policy; weights: (kind, k0, k1).
    fail: called before every call of a model with "motion" or the slot; what it returns, unless None, is returned (a status), or "nan".
    """

    def __init__(self, code, n, motion, Q, sensors, x0, P0, bits=64, kind=UNSCENTED, increments=1, rule=NO_RULE, transform=None, gate=None,
                 one=0, m=None, fail=None, config=None, weights=None):
        self.code, self.n, self.types, self.keep, self.fail = code, n, TYPES[bits], [], fail or (lambda which: None)
        self.slots, self.m = len(sensors), m or max(model.rows for model, _ in sensors)
        t, slots, rows = self.types, self.slots, self.m * len(sensors)
        packed = n * (n + 1) // 2
        self.config = c = t.config(n=n, m=self.m, slots=slots, increments=increments, update=kind, rule=rule, one_at_a_time=one)
        if isinstance(motion, Model):
            c.transition.model = self.convert(motion, "motion")
        else:
            c.transition.A = self.address(motion)
        c.transition.Q = self.address(pack(Q))
        self.sensor = (t.sensor * slots)(*(t.sensor(model=self.convert(model, slot), R=self.address(pack(R)), rows=model.rows)
                                           for slot, (model, R) in enumerate(sensors)))
        c.sensor = ctypes.addressof(self.sensor)
        c.x0, c.P0 = self.address(x0), self.address(pack(P0))
        c.transform = t.transform(*(transform or (n, -1)))
        if gate:
            self.gate = t.gate(sensor=self.address(gate.get("sensor")), stacked=self.address(gate.get("stacked")), patience=gate.get("patience", 0),
                               policy=gate.get("policy", SKIP))
            c.gate = ctypes.addressof(self.gate)
        self.weight, self.statistic = (np.full(rows, np.nan, t.numpy) for _ in range(2))
        if weights:
            kind, k0, k1 = weights
            self.weights = t.weights(self.address(k0), self.address(k1), self.weight.ctypes.data, self.statistic.ctypes.data, kind)
            c.weights = ctypes.addressof(self.weights)
        for name, value in (config or {}).items():
            setattr(c, name, value)
        self.core, self.record = t.core(), (t.record * slots)()
        self.x, self.L, self.z = (np.zeros(k, t.numpy) for k in (n, packed, rows))
        self.have = np.zeros(slots, np.uint8)
        # MK_UNSCENTED_.._WORK, written again.
        predict = 2 * n * (2 * n + 1) + 4 * n
        update = (rows * (2 * n + 3) + rows * (rows + 1) // 2 + 2 * packed + n + 2 * self.m + 2 * slots +
                  max((n + self.m) * (2 * n + 1), rows * (n + 1) + rows * (rows + 1) // 2 + 3 * n + packed))
        other = n * n + 2 * packed + 2 * n + self.m * (self.m + 1) // 2
        self.sizes = {"predict": predict, "update": update, "contribution": update, "innovations": update}
        self.other, self.work = other, np.zeros(max(predict, update, other) + 16, t.numpy)
        self.view = t.view(ctypes.addressof(self.core), *(a.ctypes.data for a in (self.x, self.L, self.z, self.have)),
                           ctypes.addressof(self.record), self.work.ctypes.data)

    def address(self, values):
        if values is None:
            return None
        self.keep.append(np.ascontiguousarray(values, self.types.numpy))
        return self.keep[-1].ctypes.data

    def convert(self, model, which):
        t, n, rows = self.types, self.n, model.rows

        def array(pointer, *shape):
            return np.ctypeslib.as_array(pointer, shape)

        def failing(y):
            answer = self.fail(which)
            if answer == "nan":
                y.flat[-1] = np.nan
            return answer if isinstance(answer, int) else OK

        def function(_, dt, count, x, y):
            out = array(y, count, rows)
            out[:] = model.function(array(x, count, n), dt)
            return failing(out)

        def jacobian(_, dt, x, J):
            out = array(J, rows, n)
            out[:] = model.jacobian(array(x, 1, n), dt)
            return failing(out)

        def difference(_, a, b, d):
            array(d, rows)[:] = model.difference(array(a, rows), array(b, rows))

        def mean(_, count, weight, y, out):
            array(out, rows)[:] = model.mean(array(weight, count), array(y, count, rows))
        made = t.model(function=t.function(function))
        if model.jacobian:
            made.jacobian = t.jacobian(jacobian)
        if model.difference:
            space = t.space(difference=t.difference(difference))
            if model.mean:
                space.mean = t.mean(mean)
            made.space = ctypes.addressof(space)
            self.keep.append(space)
        self.keep.append(made)
        return made

    def call(self, name, *arguments):
        end = self.sizes.get(name, self.other)
        self.work[:end] = np.nan
        self.work[end:] = 12345
        found = getattr(self.code, f"mk_unscented_{name}{self.types.suffix}")(*arguments)
        assert (self.work[end:] == 12345).all(), "scratch memory overrun"
        return found

    def start(self):
        return self.call("start", self.n, self.m, self.slots, byref(self.view), byref(self.config))

    def restart(self, x0, P0):
        return self.call("restart", self.n, self.slots, byref(self.view), c_void_p(self.address(x0)), c_void_p(self.address(pack(P0))))

    def predict(self, dt=1.0, Q=None):
        return self.call("predict", self.n, byref(self.view), self.types.real(dt), c_void_p(None if Q is None else self.address(pack(Q))))

    def put(self, slot, z):
        return self.call("put", self.m, self.slots, byref(self.view), slot, c_void_p(self.address(z)))

    def drop(self, slot):
        return self.call("drop", self.slots, byref(self.view), slot)

    def move(self, dx):
        return self.call("move", self.n, byref(self.view), c_void_p(self.address(dx)))

    def innovations(self):
        """Status, r, S, rows."""
        most = self.m * self.slots
        r, S, rows = np.full(most, np.nan, self.types.numpy), np.full(most * (most + 1) // 2, np.nan, self.types.numpy), np.full(self.slots, 77, np.uint8)
        found = self.call("innovations", self.n, self.m, self.slots, byref(self.view), *(c_void_p(a.ctypes.data) for a in (r, S, rows)))
        if found != OK:
            return found, r, S, rows
        count = int(rows.sum())
        assert np.isnan(r[count:]).all() and np.isnan(S[count * (count + 1) // 2:]).all()
        return found, r[:count], unpack(S[:count * (count + 1) // 2], count), rows

    def update(self):
        return self.call("update", self.n, self.m, self.slots, byref(self.view))

    def covariance(self):
        P = np.zeros(len(self.L), self.types.numpy)
        assert self.call("covariance", self.n, byref(self.view), c_void_p(P.ctypes.data)) == OK
        return unpack(P, self.n)

    P = property(covariance)

    def exact(self):
        """x and L L' in the longest float type."""
        L = np.zeros((self.n, self.n), np.longdouble)
        L[np.tril_indices(self.n)] = self.L
        return self.x.astype(np.longdouble), L @ L.T

    def contribution(self, without_residual=0):
        s, S = np.full(self.n, np.nan, self.types.numpy), np.full(len(self.L), np.nan, self.types.numpy)
        found = self.call("contribution", self.n, self.m, self.slots, byref(self.view), without_residual, c_void_p(s.ctypes.data), c_void_p(S.ctypes.data))
        return found, s, unpack(S, self.n)

    def inform(self, scale, s, S):
        s, S = self.address(s), self.address(pack(S))
        return self.call("inform", self.n, byref(self.view), self.types.real(scale), c_void_p(s), c_void_p(S))

    def state(self, failed=False):
        """Everything that the object holds, as bytes; without core.failed unless asked for."""
        core = self.types.core.from_buffer_copy(self.core)
        if not failed:
            core.failed = 0
        return b"".join((bytes(core), bytes(self.record), *(a.tobytes() for a in (self.x, self.L, self.z, self.have))))
