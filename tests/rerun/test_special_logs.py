# SPDX-License-Identifier: MIT
"""Logs that are whole and out of the ordinary: no steps, one node, no numbers, fields of a later version."""

import io

import cbor2
import numpy as np
import pytest
from readback import Recording, command, convert
from synthetic import Log, typed
from synthetic_monitor import NavigationLog
from synthetic_tracking import TrackingLog
from test_kinds import blueprint_text

KINDS = [Log, lambda **options: Log(filter="kfc", **options), TrackingLog, NavigationLog]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("end", ["complete", "interrupted", None])
def test_no_steps(tmp_path, kind, end):
    """A run that has only begun: what is known of it is shown."""
    items = kind(steps=6).items()
    data = items[0] + (cbor2.dumps({"end": end, "items": 0}) if end else b"")
    (tmp_path / "run.cbor").write_bytes(data)
    done = command(tmp_path / "run.cbor")
    said = done.stderr.decode()
    assert done.returncode == 0 and "warning: the log has no step of run 0 yet\n" in said
    assert ("the log was cut: it ends after 0 step items" in said) == (end is None)
    summary = Recording(tmp_path / "run.rrd").summary()
    assert "**The log has no step of run 0**" in summary and "6 steps asked for" in summary
    assert "summary" in blueprint_text(Recording(tmp_path / "run.rrd"))


def test_a_run_that_has_not_begun(tmp_path):
    items = Log(nodes=2, steps=2, runs=3).items()
    (tmp_path / "run.cbor").write_bytes(b"".join(items[:4]))
    done = command(tmp_path / "run.cbor", "--run", "2")
    assert done.returncode == 0 and b"the log has no step of run 2 yet" in done.stderr


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("value", [np.nan, np.inf, -1e308, 0.0])
@pytest.mark.filterwarnings("error")  # they would be seen
def test_numbers_that_are_none(tmp_path, kind, value):
    """Everything that a filter computes is not a number, or infinite, or too large."""
    log = kind(steps=6)
    for key, values in log.arrays.items():
        if np.dtype(log.type_of(key)).kind == "f" and key not in ("time_s",):
            log.arrays[key] = np.full(np.shape(values), value)
    recording, remarks = convert(log.data(), tmp_path / "run.rrd")
    assert remarks == []
    who = "centre" if log.header["estimators"] == 1 else "node/1"
    shown = recording.series(f"trace_covariance/{who}")
    assert len(shown) == 6
    if np.isfinite(value) and log.real == "float64":
        np.testing.assert_array_equal(shown, value)
    else:
        assert not np.isfinite(shown).any() or log.real != "float64"


@pytest.mark.parametrize("filter", ["rkfdu", "kfc"])
@pytest.mark.parametrize("steps", [1, 5])
def test_one_node(tmp_path, filter, steps):
    log = Log(nodes=1, steps=steps, filter=filter)
    recording, remarks = convert(log.data(), tmp_path / "run.rrd")
    assert remarks == []
    who = "centre" if filter == "kfc" else "node/0"
    np.testing.assert_array_equal(recording.series(f"theta/{who}").reshape(-1), log.arrays["theta"][0, :, 0])


@pytest.mark.parametrize("kind", KINDS)
def test_fields_of_a_later_version(tmp_path, kind):
    """They are left out, and that is said once."""
    log = kind(steps=6)
    plain, _ = convert(log.data(), tmp_path / "plain.rrd")
    items = log.items()
    later = {"weather": "fair", "drift": typed([1.0, 2.0], "<f8"), "nested": {"a": [1, {}]}, "big": 1 << 80}
    data = [cbor2.dumps({**cbor2.loads(item), **later}) for item in items]
    recording, remarks = convert(b"".join(data), tmp_path / "run.rrd")
    assert remarks == ["left out, because this program does not know what it is: big, drift, nested, weather"]
    assert recording.entities() == plain.entities()
    who = "centre" if log.header["estimators"] == 1 else "node/1"
    np.testing.assert_array_equal(recording.series(f"nis_ratio/{who}"), plain.series(f"nis_ratio/{who}"))


@pytest.mark.parametrize("version", [0, 2, "1", None, [1]])
def test_a_later_format_is_refused(tmp_path, version):
    log = Log(nodes=2, steps=2)
    log.header["format_version"] = version
    (tmp_path / "run.cbor").write_bytes(log.data())
    done = command(tmp_path / "run.cbor")
    assert done.returncode == 2 and f"log format version {version!r} is not supported, only version 1".encode() in done.stderr
    assert not (tmp_path / "run.rrd").exists()


@pytest.mark.parametrize(("kind", "asked", "message"), [
    (Log, "4", "there is no node 4; the log has 0 to 3"),
    (lambda: Log(filter="kfc"), "9", "there is no node 9; the log has 0 to 3"),
    (NavigationLog, "99", "there is no satellite 99; the log has "),
])
def test_a_node_that_is_not_there(tmp_path, kind, asked, message):
    (tmp_path / "run.cbor").write_bytes(kind().data())
    done = command(tmp_path / "run.cbor", "--node", asked)
    assert done.returncode == 2 and message in done.stderr.decode() and not (tmp_path / "run.rrd").exists()


def test_a_satellite_is_named_by_its_number():
    from meshkal_log.fields import Header
    from meshkal_log.reader import LogReader
    from meshkal_rerun.conversion import _ranges, node_numbers

    header: Header = LogReader(io.BufferedReader(io.BytesIO(NavigationLog().data()))).header
    assert node_numbers(header, [header.satellites[3], header.satellites[0]]) == (3, 0)
    assert _ranges([0, 1, 2, 5, 7, 8]) == "0 to 2, 5, 7 to 8"
