# SPDX-License-Identifier: MIT
"""Tracking logs that are cut or wrong, and logs of several filters together."""

import io

import cbor2
import numpy as np
import pytest
from readback import Recording, convert
from synthetic import Log, typed
from synthetic_tracking import TrackingLog
from test_kinds import blueprint_text


@pytest.fixture
def program(capsys):
    """The command in this process: exit status and what it said."""
    from meshkal_rerun import cli

    def run(*arguments) -> tuple[int, str]:
        return cli.main([str(argument) for argument in arguments]), capsys.readouterr().err

    return run


def small(**options) -> TrackingLog:
    return TrackingLog(sensors=("range", "bearing", "none"), steps=3, **options)


def test_every_cut_reads_up_to_the_cut():
    from meshkal_log.reader import LogError, LogReader

    items = small().items()
    data, ends = b"".join(items), np.cumsum([len(item) for item in items])
    for cut in range(len(data)):
        stream = io.BufferedReader(io.BytesIO(data[:cut]))
        if cut < ends[0]:
            with pytest.raises(LogError):
                LogReader(stream)
            continue
        reader = LogReader(stream)
        batches = list(reader.batches(0))
        assert sum(len(batch.step) for batch in batches) == min(int((ends <= cut).sum()) - 1, 3)
        assert reader.end is None and "the log was cut" in reader.warnings[0]


def test_a_cut_log_is_shown(tmp_path):
    items = TrackingLog(steps=10).items()
    recording, remarks = convert(b"".join(items[:7]) + items[7][:40], tmp_path / "run.rrd")
    assert len(remarks) == 1 and "it ends after 6 step items" in remarks[0]
    assert len(recording.series("nees/node/1")) == 6 and "cut: the end is missing" in recording.summary()


def header_with(**changes) -> bytes:
    log = small()
    log.header |= changes
    return log.data()


def without(key: str) -> bytes:
    log = small()
    del log.header[key]
    return log.data()


def step_with(**changes) -> bytes:
    items = small().items()
    item = cbor2.loads(items[1])
    for key, value in changes.items():
        if value is None:
            del item[key]
        else:
            item[key] = value
    return b"".join([items[0], cbor2.dumps(item), *items[2:]])


def scenario_with(change) -> bytes:
    log = small()
    change(log.scenario)
    return log.data()


BAD = {
    "unknown kind": (header_with(kind="chess"), "header: kind is missing or wrong"),
    "linear filter": (header_with(filter="rkfdu"), "header: filter is missing or wrong"),
    "tracking filter without kind": (without("kind"), "header: filter is missing or wrong"),
    "no start": (without("start_s"), "header: start_s is missing or wrong"),
    "no iterations": (without("iterations"), "header: iterations is missing or wrong"),
    "gate of text": (header_with(gate="wide"), "header: gate is missing or wrong"),
    "no protocol": (without("protocol"), "header: protocol is missing or wrong"),
    "negative iterations": (header_with(iterations=-1), "header: iterations is missing or wrong"),
    "other iterations": (header_with(iterations=7), "consensus_disagreement has 5 numbers instead of 8"),
    "one estimator": (header_with(estimators=1), "header: 1 estimators do not fit filter duif with 3 nodes"),
    "no time": (step_with(time_s=None), "): time_s is missing"),
    "time not finite": (step_with(time_s=typed([np.nan], "<f8")), "): time_s is not finite"),
    "time beyond the clock": (step_with(time_s=typed([1e12], "<f8")), "time_s = 1e+12 is beyond the clock"),
    "no decisions": (step_with(decision=None), "): decision is missing"),
    "unknown decision": (step_with(decision=typed([9] * 9, "|u1")), "): decision 9 is unknown"),
    "ratio in other precision": (step_with(gate_ratio=typed(np.zeros(9), "<f4")), "gate_ratio is missing or not an array of float64"),
    "states without names": (scenario_with(lambda s: s["model"].pop("states")), "model.states are not the names of 4 states"),
    "other positions": (scenario_with(lambda s: s["model"].update(states=list("abcd"))), "0 of model.states are positions, the header says 2"),
    "nodes missing": (scenario_with(lambda s: s["nodes"].pop()), "nodes are not 3 objects"),
    "range limit of text": (scenario_with(lambda s: s["nodes"][0].update(range_limit_m="far")), "range_limit_m of a node is not a number"),
    "position of text": (scenario_with(lambda s: s["nodes"][0].update(position_m="here")), "position_m of a node is not a list of 2 or 3 numbers"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_refused(tmp_path, case, program):
    data, message = BAD[case]
    (tmp_path / "run.cbor").write_bytes(data)
    status, said = program(tmp_path / "run.cbor", "-o", tmp_path / "run.rrd")
    assert status == 2 and message in said, said
    assert said.count("\n") == 1 and [path.name for path in tmp_path.iterdir()] == ["run.cbor"]


def filters(tmp_path, *names, **changes) -> list:
    """Logs of the same run by several filters: target and readings are the same."""
    out, first = [], TrackingLog(filter=names[0])
    for i, name in enumerate(names):
        log = TrackingLog(filter=name)
        log.arrays["truth"] = first.arrays["truth"]
        path = tmp_path / f"{i}.cbor"
        path.write_bytes(log.data())
        out.append((path, log))
    return out


def positions(log) -> np.ndarray:
    return log.arrays["estimate"][0].reshape(12, -1, 4)[:, :, :2]


def test_filters_are_compared(tmp_path, program):
    logs = filters(tmp_path, "duif", "ukf", "rekfd")
    status, said = program(*(path for path, _ in logs), "-o", tmp_path / "run.rrd")
    assert status == 0 and not said, said
    recording = Recording(tmp_path / "run.rrd")
    truth = logs[0][1].arrays["truth"][0][:, None, :2]
    rms = {log.header["filter"]: np.sqrt(((positions(log) - truth) ** 2).sum(axis=2).mean(axis=1)) for _, log in logs}
    np.testing.assert_allclose(recording.series("position_error/network/rms"), rms["duif"], rtol=1e-12)
    total = {name: np.sqrt((values**2).mean()) for name, values in rms.items()}
    for name, (_, log) in zip(("ukf", "rekfd"), logs[1:]):
        np.testing.assert_allclose(recording.series(f"position_error/compared/{name}"), rms[name], rtol=1e-12)
        apart = positions(logs[0][1]) - positions(log).mean(axis=1, keepdims=True)
        apart = np.sqrt((apart**2).sum(axis=2).mean(axis=1))
        np.testing.assert_allclose(recording.series(f"disagreement/compared/{name}"), apart, rtol=1e-4)
        shown = np.array(recording.rows(f"scene/compared/{name}/estimates", "Points3D:positions")[2])
        np.testing.assert_allclose(shown[:, :, :2], positions(log), rtol=1e-6)
        row = f"| position RMSE against {name} | {total['duif']:.4g} m / {total[name]:.4g} m = {total['duif'] / total[name]:.3f} |"
        assert row in recording.summary()
    said = blueprint_text(recording)
    assert "orange: ukf" in said and "turquoise: rekfd" in said and "$origin/compared/**" in said
    # Beside it, the shown one is as it is alone.
    np.testing.assert_array_equal(recording.series("nees/node/1"), logs[0][1].arrays["nees"][0, :, 1])


def test_equal_filters_have_numbers(tmp_path, program):
    logs = filters(tmp_path, "ukf", "ukf")
    status, said = program(*(path for path, _ in logs), "-o", tmp_path / "run.rrd")
    assert status == 0, said
    recording = Recording(tmp_path / "run.rrd")
    assert "= 1.000 |" in recording.summary()
    np.testing.assert_array_equal(recording.series("disagreement/compared/ukf-2"), np.zeros(12))


def test_a_shorter_log_is_compared_where_both_are(tmp_path, program):
    (first, a), (second, b) = filters(tmp_path, "duif", "ukf")
    items = b.items()
    second.write_bytes(b"".join(items[:1] + items[3:9]))
    status, said = program(first, second, "-o", tmp_path / "run.rrd")
    assert status == 0 and "1.cbor: the log was cut" in said, said
    common = slice(2, 8)
    truth = a.arrays["truth"][0][common, None, :2]
    ours, theirs = (np.sqrt(((positions(log)[common] - truth) ** 2).sum(axis=2).mean()) for log in (a, b))
    assert f"| {ours:.4g} m / {theirs:.4g} m = {ours / theirs:.3f} |" in Recording(tmp_path / "run.rrd").summary()


def test_without_truth_only_distances_are_compared(tmp_path, program):
    for i, name in enumerate(("duif", "ukf")):
        (tmp_path / f"{i}.cbor").write_bytes(TrackingLog(filter=name, truth=False).data())
    status, said = program(tmp_path / "0.cbor", tmp_path / "1.cbor", "-o", tmp_path / "run.rrd")
    assert status == 0, said
    recording = Recording(tmp_path / "run.rrd")
    assert len(recording.series("disagreement/compared/ukf")) == 12
    assert "RMSE" not in recording.summary() and not [e for e in recording.entities() if e.startswith("position_error")]


def test_what_cannot_be_compared(tmp_path, program):
    paths = {}
    for name, log in {"a": small(), "seed": small(seed=8), "linear": Log(nodes=3), "runs": small(runs=2)}.items():
        paths[name] = tmp_path / f"{name}.cbor"
        paths[name].write_bytes(log.data())
    changed = small()
    changed.header["dt_s"] = 1.0
    paths["dt"] = tmp_path / "dt.cbor"
    paths["dt"].write_bytes(changed.data())
    for names, options, message in (
        (("a", "dt"), (), "dt.cbor cannot be compared with "),
        (("a", "seed"), (), "seed.cbor cannot be compared with "),
        (("a", "linear"), (), "linear.cbor is not the log of a tracking scenario"),
        (("linear", "a"), (), "a.cbor is the log of a tracking scenario"),
        (("runs", "a"), ("--run", "1"), "a.cbor: run 1 is not in the log"),
    ):
        status, said = program(*(paths[name] for name in names), "-o", tmp_path / "run.rrd", *options)
        assert status == 2 and message in said, said
        assert not (tmp_path / "run.rrd").exists() and not list(tmp_path.glob(".*"))
