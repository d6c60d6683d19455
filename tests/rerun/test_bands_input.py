# SPDX-License-Identifier: MIT
"""Variances of states and of innovations: read, left out by older logs, refused where they are wrong."""

import io

import numpy as np
import pytest
from synthetic import Log, showcase
from synthetic_monitor import NavigationLog
from synthetic_tracking import TrackingLog

from meshkal_log.reader import LogError, LogReader

KEYS = ("variance", "innovation", "innovation_variance")
KINDS = {
    "nodes": (lambda **more: Log(nodes=4, rows=(2, 1, 1, 3), **more), KEYS),
    "float32": (lambda **more: Log(nodes=3, real="float32", **more), KEYS),
    "centre": (lambda **more: Log(nodes=4, rows=(2, 1, 1, 3), filter="rkfc", **more), KEYS),
    "tracking": (TrackingLog, KEYS[:1]),
    "tracking centre": (lambda **more: TrackingLog(filter="ukf", **more), KEYS[:1]),
    "navigation": (NavigationLog, ("variance", "innovation")),
}


def read(log: Log):
    reader = LogReader(io.BufferedReader(io.BytesIO(log.data())))
    [batch] = reader.batches(0)
    assert reader.end == "complete" and not reader.warnings
    return reader.header, batch


@pytest.mark.parametrize("kind", KINDS)
def test_each_kind_of_log(kind):
    make, keys = KINDS[kind]
    log = make()
    header, batch = read(log)
    assert batch.variance.shape == (len(batch.step), header.estimators, header.states)
    real = np.float64 if header.real == "float64" else np.float32
    for key in KEYS:
        values = getattr(batch, key)
        if key in keys:
            assert values.dtype == real
            np.testing.assert_array_equal(values.reshape(len(values), -1), log.arrays[key][0].astype(real))
        else:
            assert values is None
    np.testing.assert_allclose(batch.variance.sum(axis=2), batch.trace_covariance, rtol=1e-5)


@pytest.mark.parametrize("kind", KINDS)
def test_older_logs(kind):
    make, keys = KINDS[kind]
    _, old = read(make(bands=False))
    _, new = read(make())
    for name, values in vars(new).items():
        if name in KEYS and not (name == "innovation" and kind == "navigation"):
            assert getattr(old, name) is None
        else:
            np.testing.assert_array_equal(getattr(old, name), values)


@pytest.mark.parametrize("key, length", [("variance", 16), ("innovation", 7), ("innovation_variance", 7)])
def test_wrong_lengths_are_refused(key, length):
    log = Log(nodes=4, rows=(2, 1, 1, 3))
    assert log.arrays[key].shape[2] == length
    log.arrays[key] = log.arrays[key][..., 1:]
    with pytest.raises(LogError, match=rf"{key} has {length - 1} numbers instead of {length}"):
        read(log)


def test_rows_of_the_estimators_own_sensors():
    assert read(Log(nodes=4, rows=(2, 1, 1, 3)))[0].own_rows == (2, 1, 1, 3)
    assert read(Log(nodes=4, rows=(2, 1, 1, 3), filter="kfc"))[0].own_rows == (7,)
    header, batch = read(showcase(9, 5))
    assert batch.innovation.shape == (5, 9)
    # The own reading is the first slot's.
    np.testing.assert_array_equal(np.isfinite(batch.innovation), batch.measurements_arrived[:, header.slot_starts] == 1)
