# SPDX-License-Identifier: MIT
"""Figures for paper: what their lines, bands and marks say, read back and compared with the log and with SciPy."""

import io
from contextlib import ExitStack

import numpy as np
import pytest
from scipy.stats import chi2
from synthetic import Log
from synthetic_monitor import FALSE_ALARM, NavigationLog, add_monitor
from synthetic_tracking import TrackingLog

from meshkal_log.reader import LogError
from meshkal_rerun import conversion
from meshkal_rerun.pictures import paper, pictures
from meshkal_rerun.pictures import run as runs
from meshkal_rerun.pictures.maps import ellipses


def read(*logs: Log, time_s: float | None = None, **wanted):
    with ExitStack() as keep:
        opened = conversion.Logs({f"log {i}": io.BufferedReader(io.BytesIO(log.data())) for i, log in enumerate(logs)}, keep)
        asked = conversion.Wanted(**wanted)
        return runs.read(opened, conversion.plan(opened, asked), asked, time_s)


def drawn(*logs: Log, **options) -> dict:
    with paper.style():
        return {picture.name: picture for picture in pictures(read(*logs, **options))}


def lines(picture, panel: int = 0) -> dict[str, np.ndarray]:
    return {line.get_label(): np.asarray(line.get_ydata(), dtype=float) for line in picture.figure.axes[panel].lines}


def test_error_of_a_network():
    log = Log(nodes=12, steps=30)
    error = log.arrays["error"][0]
    shown = lines(drawn(log)["error"])
    np.testing.assert_allclose(shown["RMS"], 20 * np.log10(np.sqrt((error**2).mean(axis=1))), rtol=1e-9)
    np.testing.assert_allclose(shown["median"], 20 * np.log10(np.median(error, axis=1)), rtol=1e-9)
    worst = np.argsort(-np.sqrt((error**2).mean(axis=0)))[:5]
    assert [name for name in shown if name.startswith("node")][::-1] == [f"node {k}" for k in worst]
    for k in worst:
        np.testing.assert_allclose(shown[f"node {k}"], 20 * np.log10(error[:, k]), rtol=1e-9)
    x = drawn(log)["error"].figure.axes[0].lines[0].get_xdata()
    np.testing.assert_allclose(x, 0.1 * np.arange(30))


def test_test_quantity_has_its_chi_square_band():
    log = Log(nodes=5, steps=20, rows=2)
    picture = drawn(log)["consistency"]
    (band,) = [c for c in picture.figure.axes[0].collections if "95 %" in c.get_label()]
    rows = int(log.arrays["nis_rows"][0, 0, 0])
    heights = np.unique(np.round(band.get_paths()[0].vertices[:, 1], 12))
    np.testing.assert_allclose([heights.min(), heights.max()], chi2.ppf([0.025, 0.975], rows) / rows, rtol=1e-6)
    pooled = log.arrays["nis"][0].sum(axis=1) / log.arrays["nis_rows"][0].sum(axis=1)
    np.testing.assert_allclose(lines(picture)["all nodes together"], pooled, rtol=1e-12)


def test_theta_and_tolerance():
    log = Log(nodes=5, steps=20)
    picture = drawn(log)["theta"]
    for panel, key in enumerate(("theta", "tolerance")):
        np.testing.assert_allclose(lines(picture, panel)["median"], np.median(log.arrays[key][0], axis=1), rtol=1e-12)
    assert "theta" not in drawn(Log(nodes=4, steps=5, filter="kfd") | zeroed("theta", "tolerance"))


class zeroed:  # noqa: N801: read as a word
    def __init__(self, *keys: str) -> None:
        self.keys = keys

    def __ror__(self, log: Log) -> Log:
        for key in self.keys:
            log.arrays[key] = np.zeros_like(log.arrays[key])
        return log


def test_missing_messages():
    log = Log(nodes=6, steps=15)
    shown = lines(drawn(log)["missing"])
    for key, name in (("measurements_arrived", "measurements"), ("estimates_arrived", "estimates")):
        np.testing.assert_array_equal(shown[name], (~log.arrays[key][0]).sum(axis=1))


def test_network_map():
    log = Log(nodes=9, steps=12)
    for time_s, step in ((None, 11), (0.35, 3)):
        axes = drawn(log, time_s=time_s)["network"].figure.axes[0]
        marks = [c for c in axes.collections if c.get_array() is not None][0]
        places, values = np.asarray(marks.get_offsets()), np.asarray(marks.get_array())
        order = np.argsort(log.arrays["error"][0, step])
        np.testing.assert_allclose(places, log.positions_m[order], rtol=1e-12)
        np.testing.assert_allclose(values, 20 * np.log10(log.arrays["error"][0, step][order]), rtol=1e-9)
        links = {tuple(sorted((k, j))) for k, slots in enumerate(log.header["slots"]) for j in slots if j != k}
        assert len(axes.collections[0].get_segments()) == len(links)


def test_a_moment_before_the_run_is_refused():
    log = TrackingLog(steps=8)
    with pytest.raises(LogError, match="there is nothing at 3 s"):
        read(log, time_s=3.0)
    assert read(log, time_s=1e9).moment.step == 8


def test_positions_and_their_ellipses():
    log = Log(nodes=5, steps=12, position_states=(2, 0))
    axes = drawn(log)["position"].figure.axes[0]
    shown = {line.get_label(): line for line in axes.lines}
    truth = log.arrays["truth"][0][:, [2, 0]]
    np.testing.assert_allclose(np.stack(shown["truth"].get_data(), axis=1), truth, rtol=1e-6)
    estimate = log.arrays["estimate"][0, -1].reshape(5, 4)[:, [2, 0]]
    (points,) = [c for c in axes.collections if c.get_label() == "estimates now"]
    np.testing.assert_allclose(points.get_offsets(), estimate, rtol=1e-6)
    packed = log.arrays["position_covariance"][0, -1].reshape(5, 3)
    width, height, angle = ellipses(packed, 0, 1)
    for k, (a, b, c) in enumerate(packed):
        values, vectors = np.linalg.eigh([[a, b], [b, c]])
        np.testing.assert_allclose([height[k], width[k]], 2 * 3 * np.sqrt(values), rtol=1e-9)
        long = np.array([np.cos(np.deg2rad(angle[k])), np.sin(np.deg2rad(angle[k]))])
        assert abs(long @ vectors[:, 1]) == pytest.approx(1.0, abs=1e-9)


def test_monitors():
    log = add_monitor(Log(nodes=4, steps=30), "exclude")
    run = read(log)
    with paper.style():
        picture = {p.name: p for p in pictures(run)}["integrity"]
    rows = log.arrays["monitor_aime_rows"][0]
    ratio = log.arrays["monitor_aime"][0] / chi2.isf(FALSE_ALARM, rows)
    shown = lines(picture)
    np.testing.assert_allclose(shown["AIME, median"], np.median(ratio, axis=1), rtol=1e-6)
    np.testing.assert_allclose(shown["largest"], ratio.max(axis=1), rtol=1e-6)
    alarm = log.arrays["monitor_alarm"][0]
    np.testing.assert_array_equal(lines(picture, 1)["_child0"], alarm.sum(axis=1))
    assert shown["alarm"].shape == (alarm.any(axis=1).sum(),)
    # The fault of node 1 lasts for the middle third; it is held faulty two steps later.
    assert run.spans == {"injected": {1: [[pytest.approx(1.0), pytest.approx(1.9)]]}, "held": {1: [[pytest.approx(1.2), pytest.approx(1.9)]]}}
    assert "Node 1 is held faulty 1.2 s to 1.9 s" in picture.alt


def test_tracking():
    log = TrackingLog(steps=25)
    shown = drawn(log)
    error = np.linalg.norm((log.arrays["estimate"][0].reshape(25, 5, 4) - log.arrays["truth"][0][:, None])[..., :2], axis=2)
    np.testing.assert_allclose(lines(shown["error"])["RMS"], np.sqrt((error**2).mean(axis=1)), rtol=1e-9)
    (band,) = [c for c in shown["consistency"].figure.axes[0].collections if "chi-square" in c.get_label()]
    heights = band.get_paths()[0].vertices[:, 1]
    np.testing.assert_allclose([heights.min(), heights.max()], chi2.ppf([0.025, 0.975], 4), rtol=1e-6)
    np.testing.assert_array_equal(shown["agreement"].figure.axes[0].lines[0].get_ydata(), log.arrays["disagreement"][0, :, 0])
    consensus = lines(shown["agreement"], 1)
    np.testing.assert_allclose(consensus["after 4"], 20 * np.log10(log.arrays["consensus_disagreement"][0, :, 4]), rtol=1e-9)
    np.testing.assert_allclose(shown["error"].figure.axes[0].lines[0].get_xdata(), log.arrays["time_s"][0, :, 0])


def test_navigation():
    log = NavigationLog()
    shown = drawn(add_monitor(log, "exclude"))
    away = log.arrays["estimate"][0] - log.arrays["truth"][0]
    for panel, state in enumerate((6, 7, 8)):
        axis = lines(shown["axes"], panel)
        np.testing.assert_allclose(axis["estimate less truth"], away[:, state], rtol=1e-9)
        np.testing.assert_allclose(axis["3 sigma of the filter"], 3 * np.sqrt(log.arrays["position_covariance"][0, :, (0, 2, 5)[panel]]), rtol=1e-9)
    sky = [c for c in shown["sky"].figure.axes[0].collections if c.get_array() is not None][0]
    np.testing.assert_allclose(sky.get_array(), log.arrays["weight"][0, -1])
    from_zenith = np.linalg.norm(np.asarray(sky.get_offsets()), axis=1)
    np.testing.assert_allclose(from_zenith, 90.0 - log.arrays["elevation_deg"][0, -1], rtol=1e-9)


def test_compared_logs():
    shown, other = TrackingLog(steps=20, filter="ukf"), TrackingLog(steps=20, filter="ekf")
    other.arrays["estimate"] = shown.arrays["estimate"] + 3.0
    curves = lines(drawn(shown, other)["error"])
    label = next(name for name in curves if name.startswith("ekf"))
    away = (other.arrays["estimate"][0] - other.arrays["truth"][0])[:, :2]
    np.testing.assert_allclose(curves[label], np.linalg.norm(away, axis=1), rtol=1e-9)


KINDS = {
    "linear": lambda: Log(nodes=9, steps=10),
    "centre": lambda: Log(nodes=4, steps=10, filter="rkfc"),
    "one node": lambda: Log(nodes=1, steps=10),
    "no truth": lambda: Log(nodes=4, steps=10, truth=False),
    "no positions": lambda: Log(nodes=4, steps=10, position_states=None, positions=None),
    "one coordinate": lambda: Log(nodes=4, steps=10, position_states=(1,)),
    "in space": lambda: Log(nodes=4, steps=10, position_states=(0, 1, 2), positions="3d"),
    "one step": lambda: Log(nodes=4, steps=1),
    "monitored": lambda: add_monitor(Log(nodes=4, steps=30), "aime-improved"),
    "tracking": lambda: TrackingLog(steps=10),
    "tracking, centre": lambda: TrackingLog(steps=10, filter="mpukf", truth=False),
    "tracking, space": lambda: TrackingLog(steps=10, dimensions=3, filter="rekfd"),
    "tracking, dates": lambda: dated(TrackingLog(steps=10)),
    "navigation": lambda: NavigationLog(),
    "navigation, no truth": lambda: NavigationLog(filter="ekf", truth=False),
}


def dated(log: Log) -> Log:
    log.header["start_s"] = 1.7e9
    log.arrays["time_s"] = log.arrays["time_s"] + 1.7e9
    return log


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_log(kind, recwarn):
    shown = drawn(KINDS[kind]())
    assert {"consistency"} <= set(shown)
    assert ("error" in shown) == ("no truth" not in kind and kind != "tracking, centre")
    for picture in shown.values():
        assert len(picture.alt) > 20 and picture.title
        axes = [axes for axes in picture.figure.axes if axes.axison]
        assert axes or picture.name in ("sky", "network")
        for each in axes:
            # Every axis that has numbers has a unit.
            labelled = [each.get_ylabel()] if each.get_xlabel() == "" else [each.get_xlabel(), each.get_ylabel()]
            assert all("," in label or label == "" and picture.name == "integrity" for label in labelled), (picture.name, labelled)
        assert any(each.get_xlabel() for each in axes) or not [a for a in axes if a.lines]
        picture.figure.savefig(io.BytesIO(), format="svg")
    assert not [str(w.message) for w in recwarn]


def test_nothing_known_draws_gaps():
    log = Log(nodes=4, steps=12)
    log.arrays["estimate"][0, 5:8] = np.inf
    log.arrays["error"][0, 5:8] = np.inf
    log.arrays["truth"][0, 2] = np.nan
    shown = drawn(log)
    rms = lines(shown["error"])["RMS"]
    assert np.isnan(rms[[2, 5, 6, 7]]).all() and np.isfinite(rms[[0, 1, 3, 4, 8]]).all()


def test_colours_on_paper_can_be_read():
    def luminance(text: str) -> float:
        channels = np.array([int(text[i : i + 2], 16) for i in (1, 3, 5)]) / 255.0
        linear = np.where(channels <= 0.04045, channels / 12.92, ((channels + 0.055) / 1.055) ** 2.4)
        return float(linear @ (0.2126, 0.7152, 0.0722))

    from meshkal_rerun.recording import colours

    inks = [paper.ink(c) for c in (*colours.cycled(8), *colours.COMPARED.values(), colours.WORST, colours.BOUND)]
    assert all(1.05 / (luminance(ink) + 0.05) >= 2.99 for ink in inks)
    assert len(set(inks[:8])) == 8
    assert paper.ink(colours.TRUTH) == "#000000"
