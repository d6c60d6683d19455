# SPDX-License-Identifier: MIT
"""Logs of one network that are compared: numbers against the logs decoded on their own, and where two logs differ first."""

import dataclasses
import re

import numpy as np
import pytest
from decoded import Decoded
from readback import Recording, command
from synthetic import Log
from synthetic_tracking import TrackingLog


@pytest.fixture
def compare(tmp_path):
    def run(*logs: Log, options=(), status=0):
        paths = []
        for i, log in enumerate(logs):
            paths.append(tmp_path / f"{i}.cbor")
            paths[-1].write_bytes(log if isinstance(log, bytes) else log.data())
        done = command(*paths, "-o", tmp_path / "run.rrd", *options)
        assert done.returncode == status, done.stderr.decode()
        if status:
            assert not (tmp_path / "run.rrd").exists()
            return done.stderr.decode()
        return Recording(tmp_path / "run.rrd"), [Decoded(path) for path in paths]

    return run


def text(recording: Recording) -> str:
    (said,) = recording.rows("compare/summary", "TextDocument:text", static=True)[2]
    return said[0]


def row(said: str, name: str) -> str:
    return re.search(rf"^\| {re.escape(name)} \| (.*) \|$", said, re.M)[1]


def pair(nodes=12, steps=60, other="kfd", **changes) -> tuple[Log, Log]:
    """Two filters of the same truth and readings."""
    first, second = Log(nodes, steps, filter="rkfdu"), Log(nodes, steps, filter=other, **changes)
    if second.header["estimators"] == nodes:
        noise = np.random.default_rng(3).normal(0, 1.0, second.arrays["estimate"].shape)
        second.arrays["estimate"] = second.arrays["estimate"] + noise
    return first, recomputed(second)


def recomputed(log: Log) -> Log:
    estimate = log.arrays["estimate"].reshape(*log.arrays["estimate"].shape[:2], log.header["estimators"], -1)
    log.arrays["error"] = np.linalg.norm(estimate - log.arrays["truth"][:, :, None], axis=3)
    return log


def db(values: np.ndarray) -> np.ndarray:
    return 20.0 * np.log10(values)


def band(recording: Recording, path: str) -> np.ndarray:
    """Lower and upper edge."""
    middle, variance = (np.array(recording.rows(f"{path}/over_nodes/band", f"Measurements:{key}")[2])[:, 0] for key in ("values", "variances"))
    return np.stack([middle - np.sqrt(variance), middle + np.sqrt(variance)])


def test_linear_filters(compare):
    first, second = pair()
    estimate = first.arrays["estimate"].copy()
    estimate[:, :, 4 * 4 : 6 * 4] += 3.0  # the shown one is worse in nodes 4 and 5, better in others
    first.arrays["estimate"] = estimate
    recording, (a, b) = compare(recomputed(first), second)
    apart = db(a["error"]) - db(b["error"])
    for key, log in (("shown", a), ("kfd", b)):
        np.testing.assert_allclose(recording.series(f"compare/rms/{key}"), db(np.sqrt((log["error"] ** 2).mean(axis=1))), rtol=1e-9)
    np.testing.assert_allclose(recording.series("error_db/compared/kfd"), recording.series("compare/rms/kfd"), rtol=1e-12)
    path = "compare/kfd/difference"
    np.testing.assert_allclose(recording.series(f"{path}/over_nodes/median"), np.median(apart, axis=1), rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(band(recording, path), np.percentile(apart, [5, 95], axis=1), rtol=1e-9, atol=1e-9)
    striking = np.argsort(-np.abs(apart.mean(axis=0)))[:3]
    assert {int(name.rsplit("/")[-1]) for name in recording.entities() if name.startswith(f"{path}/node/")} == set(striking)
    for k in striking:
        np.testing.assert_allclose(recording.series(f"{path}/node/{k}"), apart[:, k], rtol=1e-9, atol=1e-9)
    distance = np.sqrt(((a.estimates() - b.estimates()) ** 2).sum(axis=2))
    np.testing.assert_allclose(recording.series("compare/distance/kfd"), db(np.sqrt((distance**2).mean(axis=1))), rtol=1e-9)
    said = text(recording)
    assert row(said, "RMS error, rkfdu") == f"{db(np.sqrt((a['error'] ** 2).mean())):.1f} dB"
    assert row(said, "RMS error, kfd") == f"{db(np.sqrt((b['error'] ** 2).mean())):.1f} dB"
    assert row(said, "mean difference") == f"{apart.mean():+.2g} dB"
    assert row(said, "nodes and steps, rkfdu better") == f"{100 * (a['error'] < b['error']).mean():.1f} %"
    t, k = np.unravel_index(apart.argmax(), apart.shape)
    assert row(said, "largest difference") == f"{apart.max():+.1f} dB, node {k} at step {t}"
    t, k = np.unravel_index(apart.argmin(), apart.shape)
    assert row(said, "smallest difference") == f"{apart.min():+.1f} dB, node {k} at step {t}"
    assert row(said, "RMS distance of the estimates") == f"{np.sqrt((distance**2).mean()):.3g}"
    t, k = np.unravel_index(distance.argmax(), distance.shape)
    assert row(said, "largest distance") == f"{distance.max():.3g}, node {k} at step {t}"
    k = apart.mean(axis=0).argmax()
    assert row(said, "highest mean of a node") == f"{apart.mean(axis=0)[k]:+.2g} dB, node {k}"
    low, high = re.fullmatch(r"(\S+) to (\S+) dB", row(said, "its 95 % interval")).groups()
    assert float(low) < apart.mean() < float(high)
    mean = apart.mean(axis=0)
    for who, wanted in (("better", mean < 0), ("worse", mean > 0)):
        values, places = (recording.rows(f"compare/kfd/nodes/{who}", f"BarChart:{key}", static=True)[2][0][0]["buffer"] for key in ("values", "abscissa"))
        np.testing.assert_allclose(values, mean[wanted], rtol=1e-9)
        np.testing.assert_allclose(np.array(places) + 0.4, np.flatnonzero(wanted))


def cut(batches, steps: int):
    """The same in batches of so many steps."""
    for batch in batches:
        for at in range(0, len(batch.step), steps):
            arrays = {field.name: getattr(batch, field.name) for field in dataclasses.fields(batch)}
            yield dataclasses.replace(batch, **{name: value[at : at + steps] for name, value in arrays.items() if value is not None})


def test_the_map_is_a_mean_over_bins(compare):
    import io

    from meshkal_log.reader import LogReader
    from meshkal_log.scenario import parse_scenario
    from meshkal_rerun.numbers.difference import Differences

    logs = pair(nodes=5, steps=1300)
    _, (a, b) = compare(*logs)
    readers = [LogReader(io.BufferedReader(io.BytesIO(log.data()))) for log in logs]
    differences = Differences(readers[0].header, readers[1].header, parse_scenario(readers[0].header), cut(readers[1].batches(0), 37))
    for batch in cut(readers[0].batches(0), 100):
        differences.batch(batch)
    found = differences.result()
    apart = db(a["error"]) - db(b["error"])
    assert found.steps == 1300 and found.only_mine == found.only_theirs == 0 and found.mean.value == pytest.approx(apart.mean())
    np.testing.assert_allclose(found.mean_db, apart.mean(axis=0), rtol=1e-9)
    # 1300 steps in at most 512 bins are 4 in each.
    assert found.map_db.shape == (5, 325)
    np.testing.assert_allclose(found.map_db, apart.reshape(325, 4, 5).mean(axis=1).T, rtol=1e-9)
    np.testing.assert_allclose(found.map_s, 0.1 * 4 * np.arange(325))


def test_the_picture_says_who_is_better():
    from meshkal_rerun.recording.difference_map import _LEVELS, picture

    values = np.array([[-3.0, 0.0, 3.0], [np.nan, 1.5, -1.5]])
    made = picture(values, (0, 7), np.array([0.0, 1.0, 2.0]))
    tall, wide = made.ids.shape[0] // 2, made.width // 3
    cells = made.ids[tall // 2 :: tall, wide // 2 : made.width : wide]
    assert made.reach_db == 3.0
    assert cells.tolist() == [[1, _LEVELS + 1, 2 * _LEVELS + 1], [0, 1.5 * _LEVELS + 1, 0.5 * _LEVELS + 1]]
    assert [text for _, _, text in made.ticks[:2]] == ["node 0", "7"]
    assert {"0 s", "1 s", "2 s", "+3 dB", "0", "-3 dB"} <= {text for _, _, text in made.ticks}


def test_equal_logs(compare):
    log = Log(4, 40)
    recording, _ = compare(log, log)
    said = text(recording)
    assert "**Equal bit for bit in all 40 steps**" in said and "| Differs" not in said and "better" not in said.split("**How")[0]
    assert not recording.series("compare/rkfdu-2/difference/over_nodes/median").any()


@pytest.mark.parametrize(("key", "step", "node"), [("theta", 17, 2), ("estimate", 31, 0), ("trace_covariance", 5, 3)])
def test_the_first_difference_is_found(compare, key, step, node):
    first, second = Log(4, 40), Log(4, 40)
    values = second.arrays[key].copy()
    width = values.shape[2] // 4
    at = (0, step, node * width)
    values[at] = np.nextafter(values[at], np.inf)
    second.arrays[key] = values
    recording, (a, b) = compare(first, second)
    differing = np.argwhere(a[key] != b[key])
    assert differing.tolist() == [[step, node * width]]
    said = text(recording)
    name = {"theta": "theta", "estimate": "estimates", "trace_covariance": "trace of the covariance"}[key]
    assert f"The first difference is in step {step}: {name} (node {node})." in said
    assert row(said, name).startswith(f"{step}, node {node} | 2.5 % |") and said.count(f"| {step}, node") == 1


def test_different_precisions_are_compared_as_numbers(compare):
    first, second = Log(4, 30), Log(4, 30, real="float32")
    first.arrays["theta"] = second.arrays["theta"] = np.float32(first.arrays["theta"]).astype(float)
    recording, (a, b) = compare(first, second)
    said = text(recording)
    assert row(said, "arithmetic") == "float64 | float32" and "theta" in said.split("Equal: ")[1].split("\n")[0]
    largest = np.abs(a["estimate"] - b["estimate"].astype(float)).max()
    assert row(said, "estimates") == f"0, 4 of 4 nodes | 100.0 % | {largest:.3g}"
    assert "rkfdu float64 beside rkfdu float32" in said


def test_what_differs(compare):
    first, second = Log(4, 30), Log(4, 30)
    second.header |= {"loss": 0.3, "program": "meshkal 0.0.1"}
    second.scenario["tolerance"] = 0.5
    said = text(compare(first, second)[0])
    assert row(said, "message loss") == "0.1 | 0.3" and row(said, "program") == "meshkal 0.0.0 | meshkal 0.0.1"
    assert row(said, "differs in the scenario") == "tolerance | tolerance" and "scenario SHA-256" in said
    assert "| filter |" not in said and "rkfdu loss 0.1 beside rkfdu loss 0.3" in said


def test_other_truths_are_said(compare):
    first, second = Log(4, 100), Log(4, 100)
    truth = second.arrays["truth"].copy()
    truth[0, 3:] += 1.0
    second.arrays["truth"] = truth
    second.header["seed"] = 8
    recording, _ = compare(first, recomputed(second))
    said = text(recording)
    assert "**The truths differ** (from step 3)" in said and "| RMS distance of the estimates |" not in said
    assert row(said, "seed") == "7 | 8" and "compare/distance/rkfdu-2" not in recording.entities()


def test_steps_that_one_log_lacks(compare):
    first, second = pair(steps=50)
    items = second.items()
    recording, _ = compare(first, b"".join([items[0], *items[11:31], *items[36:]]))
    a, b = arrays_of(first), arrays_of(second)
    kept = np.r_[10:30, 35:50]
    apart = db(a["error"][kept]) - db(b["error"][kept])
    steps, _, values = recording.rows("compare/kfd/difference/over_nodes/median", "Scalars:scalars")
    assert steps.tolist() == kept.tolist()
    np.testing.assert_allclose(np.array(values)[:, 0], np.median(apart, axis=1), rtol=1e-9, atol=1e-12)
    said = text(recording)
    assert row(said, "steps compared") == "35, 15 only in rkfdu" and row(said, "mean difference") == f"{apart.mean():+.2g} dB"


def test_steps_that_the_shown_log_lacks(compare):
    first, second = pair(steps=50)
    items = first.items()
    recording, _ = compare(b"".join([*items[:21], items[-1]]), second)
    assert row(text(recording), "steps compared") == "20, 30 only in kfd"


def arrays_of(log: Log) -> dict:
    return {key: values[0] for key, values in log.arrays.items()}


def test_one_node(compare):
    first, second = pair(nodes=1, steps=40)
    recording, (a, b) = compare(first, second)
    apart = (db(a["error"]) - db(b["error"]))[:, 0]
    np.testing.assert_allclose(recording.series("compare/kfd/difference/over_nodes/median"), apart, rtol=1e-9)
    assert row(text(recording), "steps, rkfdu better") == f"{100 * (a['error'] < b['error']).mean():.1f} %"


def test_a_centre_beside_nodes(compare):
    recording, (a, b) = compare(*pair(other="rkfc"))
    apart = db(a["error"]) - db(b["error"])
    np.testing.assert_allclose(band(recording, "compare/rkfc/difference")[1], np.percentile(apart, 95, axis=1), rtol=1e-9)
    said = text(recording)
    assert "A centre stands beside each node" in said and row(said, "estimators") == "12 | 1"
    assert row(said, "estimates").startswith("0, 12 of 12 nodes") and "| theta |" not in said


def test_unknown_and_zero_errors(compare):
    first, second = pair(nodes=3, steps=40)
    first.arrays["estimate"][0, 0] = second.arrays["estimate"][0, 0] = np.tile(first.arrays["truth"][0, 0], 3)
    second.arrays["truth"] = first.arrays["truth"]
    for log in (first, second):
        log.arrays["truth"] = log.arrays["truth"].copy()
        log.arrays["truth"][0, 20] = np.nan
        recomputed(log)
        log.arrays["error"][0, 20] = 0.0
    first.arrays["error"][0, 30, 1] = np.inf
    recording, (a, b) = compare(first, second)
    with np.errstate(all="ignore"):
        apart = db(a["error"]) - db(b["error"])
    apart[0], apart[20], apart[30, 1] = 0.0, np.nan, np.nan
    np.testing.assert_allclose(recording.series("compare/kfd/difference/node/1"), apart[:, 1], rtol=1e-9, atol=1e-12)
    said = text(recording)
    assert row(said, "mean difference") == f"{np.nanmean(np.delete(apart, 20, axis=0), axis=1).mean():+.2g} dB"
    judged = np.delete(np.arange(40), 20)
    assert row(said, "nodes and steps, rkfdu better").startswith(f"{100 * (a['error'] < b['error'])[judged].mean():.1f} %")


def test_tracking_logs_of_two_scenarios_meet_by_time(compare):
    first, second = TrackingLog(), TrackingLog(filter="rekfd")
    second.scenario["name"] = "another"
    second.first_step = 5  # the same instants under other numbers
    recording, (a, b) = compare(first, second)
    truth = a["truth"][:, None, :2]
    error = [np.linalg.norm(log.estimates()[:, :, :2] - truth, axis=2) for log in (a, b)]
    np.testing.assert_allclose(recording.series("compare/rekfd/difference/over_nodes/median"), np.median(db(error[0]) - db(error[1]), axis=1), rtol=1e-9)
    distance = np.linalg.norm((a.estimates() - b.estimates())[:, :, :2], axis=2)
    said = text(recording)
    assert row(said, "RMS distance of the estimates") == f"{np.sqrt((distance**2).mean()):.3g} m" and row(said, "steps compared") == "12"


def test_the_view_in_front(compare):
    from meshkal_rerun.views import blueprint

    assert "compare" in blueprint.VIEWS
    said = compare(Log(4, 20), status=2, options=("--view", "compare"))
    assert "nothing for the view compare" in said
    compare(*pair(steps=20), options=("--view", "overview"))
    compare(*pair(steps=20), options=("--view", "compare"))


def test_the_id_is_that_of_all_logs(compare):
    ids = set()
    for log in (Log(4, 20), Log(4, 20, real="float32"), Log(4, 20, filter="kfd")):
        recording, _ = compare(Log(4, 20), log)
        ids.add(recording.reader.recordings()[0].recording_id)
    ids.add(compare(Log(4, 20))[0].reader.recordings()[0].recording_id)
    assert len(ids) == 4


@pytest.mark.parametrize(("change", "message"), [
    ({"nodes": 5}, "its number of nodes is 5 instead of 4"),
    ({"states": 5}, "its number of states is 5 instead of 4"),
    ({"dt_s": 0.2}, "its dt_s is 0.2 instead of 0.1"),
    ({"position_states": None}, "its number of position states is 0 instead of 2"),
])
def test_what_cannot_be_compared_is_said(compare, change, message):
    said = compare(Log(**{"nodes": 4, "steps": 12}), Log(**{"nodes": 4, "steps": 12, "filter": "kfd", **change}), status=2)
    assert "1.cbor cannot be compared with " in said and message in said and said.count("\n") == 1


def test_no_common_step(compare):
    first, second = Log(4, 12), Log(4, 12, filter="kfd")
    second.first_step = 100
    assert "no step of run 0 in common" in compare(first, second, status=2)


def test_a_damaged_log_is_named(compare):
    first, second = Log(4, 12), Log(4, 12, filter="kfd")
    second.arrays["theta"] = second.arrays["theta"][:, :, :3]
    said = compare(first, second, status=2)
    assert "1.cbor: item 2" in said and "theta has 3 numbers instead of 4" in said


@pytest.mark.parametrize("phi", [0.0, 0.8, 0.95])
def test_intervals_hold_what_they_say(phi):
    """Of 1000 values of an AR(1) process; 95 of 100 intervals hold the mean. 400 of them: 3 sigma of the share is 3.3 %; long correlation costs a little."""
    from meshkal_rerun.numbers.batch_means import batch_means

    rng = np.random.default_rng(1)
    runs, steps = 400, 1000
    values = rng.normal(size=(runs, steps))
    values[:, 0] /= np.sqrt(1 - phi**2)
    for t in range(1, steps):
        values[:, t] += phi * values[:, t - 1]
    found = [batch_means(row) for row in values]
    share = np.mean([m.low <= 0.0 <= m.high for m in found])
    assert 0.955 - 0.04 - (0.02 if phi > 0.9 else 0.0) < share < 0.95 + 0.033
    # Not by being wide: the standard error of the mean is known.
    exact = 1.96 / np.sqrt(steps) / (1 - phi)
    assert np.median([(m.high - m.low) / 2 for m in found]) < 1.5 * exact


def test_few_values_have_no_interval():
    from meshkal_rerun.numbers.batch_means import batch_means

    assert np.isnan(batch_means(np.zeros(0)).value)
    found = batch_means(np.array([1.0, np.nan, 3.0]))
    assert found.value == 2.0 and np.isnan(found.low)


def test_student_quantiles():
    """Abramowitz and Stegun, table 26.10."""
    from meshkal_rerun.numbers.quantiles import student

    for degrees, value in ((1, 12.706), (2, 4.303), (7, 2.365), (10, 2.228), (15, 2.131), (30, 2.042), (120, 1.980)):
        assert abs(student(0.025, degrees) - value) < 6e-4


def test_lines_of_nodes_in_long_runs_are_means(compare):
    recording, (a, b) = compare(*pair(nodes=3, steps=502))
    apart = db(a["error"]) - db(b["error"])
    steps, _, values = recording.rows("compare/kfd/difference/node/1", "Scalars:scalars")
    assert steps.tolist() == [*range(3, 500, 4), 501]
    wanted = [*apart[:500, 1].reshape(125, 4).mean(axis=1), apart[500:, 1].mean()]
    np.testing.assert_allclose(np.array(values)[:, 0], wanted, rtol=1e-9, atol=1e-12)
    assert recording.rows("compare/kfd/difference/node/1", "SeriesLines:names", static=True)[2] == [["node 1, mean of 4 steps"]]


def test_means_over_batches():
    """Blocks that begin in one batch and end in another."""
    from meshkal_rerun.recording.smooth import Smoothed

    sent = []

    class Series:
        def lines(self, path, times, values, **style):
            sent.extend(zip(times, values))

    class Clock:
        def times(self, batch, at):
            return batch[at]

    smooth = Smoothed(Series(), Clock(), steps=480)
    values = np.arange(23.0)
    for part in np.split(values, [1, 2, 9, 10, 22]):
        smooth.line("a", part, part)
    smooth.finish()
    assert sent == [(3.0, 1.5), (7.0, 5.5), (11.0, 9.5), (15.0, 13.5), (19.0, 17.5), (22.0, 21.0)]


def test_what_only_one_log_has_is_said(compare):
    second = Log(4, 20)
    for key in ("variance", "innovation", "innovation_variance"):
        del second.arrays[key]
    said = text(compare(Log(4, 20), second)[0])
    assert "Equal bit for bit" in said and "Only in rkfdu (1): innovations, variances, variances of innovations." in said
