# SPDX-License-Identifier: MIT
"""When a node went wrong: departures that were put into logs are found where they are, and healthy runs have none."""

import io
import math

import numpy as np
import pytest
from scipy import integrate, stats
from synthetic import Log

from meshkal_log.reader import LogReader
from meshkal_log.scenario import parse_scenario
from meshkal_rerun.numbers import departures
from meshkal_rerun.numbers.departures import NETWORK, error_episodes, quantile
from meshkal_rerun.numbers.survey import focus, survey

NODES, STEPS = 20, 200


def surveyed(log: Log, run: int = 0):
    reader = LogReader(io.BufferedReader(io.BytesIO(log.data())))
    scenario = parse_scenario(reader.header)
    return reader.header, survey(reader.batches(run), reader.header, scenario)


def healthy(seed: int, nodes=NODES, steps=STEPS, states=6) -> np.ndarray:
    """Norms of errors that are a part of all nodes and a part of each, both slowly changing, after a start that is ten times as large."""
    rng = np.random.default_rng(seed)
    parts = rng.normal(0, 1, (steps, nodes + 1, states))
    for t in range(1, steps):
        parts[t] = 0.8 * parts[t - 1] + 0.6 * parts[t]
    quality = np.exp(rng.normal(0, 0.3, nodes))[:, None]
    error = 0.5 * parts[:, :1] + quality * parts[:, 1:]
    return np.linalg.norm(error, axis=2) * (1.0 + 9.0 * np.exp(-np.arange(steps) / 8.0))[:, None]


def test_healthy_runs_have_no_departure_of_the_error():
    """Of 150 runs of 20 nodes and 200 steps at most some have one: the upper end of the 95 % interval of their share is 5 %."""
    with_one = sum(bool(error_episodes(healthy(seed), 6)[0]) for seed in range(150))
    upper = stats.beta.ppf(0.975, with_one + 1, 150 - with_one)
    assert upper < 0.05, (with_one, upper)


@pytest.mark.parametrize("nodes", [1, 2, 3])
def test_few_estimators_are_compared_with_themselves(nodes):
    with_one = sum(bool(error_episodes(healthy(seed, nodes), 6)[0]) for seed in range(150))
    assert stats.beta.ppf(0.975, with_one + 1, 150 - with_one) < 0.05
    error = healthy(1, nodes)
    error[120:150, 0] *= 8.0
    ((who, begin, end, *_),), _ = error_episodes(error, 6)
    assert who == 0 and abs(begin - 120) <= 3 and abs(end - 149) <= 3


def test_a_planted_departure_is_found_at_once():
    """Four times the error, from a step on: begin and end within three steps, in all of 60 runs, and nobody else."""
    for seed in range(60):
        error, at, who = healthy(seed), 60 + seed, seed % NODES
        # A node that is larger by a jump and not by a factor, as a faulty sensor makes it.
        error[at : at + 50, who] += 6.0 * np.median(error[100:])
        found, _ = error_episodes(error, 6)
        assert [row[0] for row in found] == [who]
        _, begin, end, peak, ratio, value, against = found[0]
        assert abs(begin - at) <= 3 and abs(end - (at + 49)) <= 3
        assert begin <= peak <= end and value == error[peak, who] and ratio >= 3
        assert against == pytest.approx(error[peak, who] / np.median(error[peak]))


def test_a_diverging_node_and_one_that_becomes_infinite():
    error = healthy(3)
    error[100:, 4] = error[100, 4] * np.exp(0.08 * np.arange(100))
    error[150:, 9] = np.inf
    found = {row[0]: row for row in error_episodes(error, 6)[0]}
    assert set(found) == {4, 9}
    assert 100 < found[4][1] < 125 and found[4][2] == STEPS - 1
    assert found[9][1] == 150 and found[9][4] == math.inf


def test_the_network_as_a_whole():
    error = healthy(5)
    error[100:140] *= 5.0
    found, _ = error_episodes(error, 6)
    (network,) = [row for row in found if row[0] == NETWORK]
    assert abs(network[1] - 100) <= 3 and abs(network[2] - 139) <= 3 and math.isnan(network[6])
    assert [row[0] for row in found] == [NETWORK]


def test_settling_is_no_departure_and_being_worse_throughout_neither():
    error = healthy(6)
    error[:40, 2] += 30.0 * np.exp(-np.arange(40) / 15.0)
    error[:, 11] *= 6.0
    found, levels = error_episodes(error, 6)
    assert found == [] and 3.0 < levels[11] < 12.0


def test_gaps_belong_to_what_is_around_them():
    error = healthy(7)
    error[80:120, 5] += 20.0
    error[90:95, 5] = np.nan
    error[100] = np.nan
    ((who, begin, end, *_),), _ = error_episodes(error, 6)
    assert (who, begin, end) == (5, 80, 119)
    assert error_episodes(np.full((30, 4), np.nan), 6)[0] == [] and error_episodes(np.zeros((30, 4)), 6)[0] == []
    assert error_episodes(healthy(1, 1, 1), 6)[0] == [] and error_episodes(healthy(1, 5, 2), 6)[0] == []


def test_quantile_leaves_unknown_out():
    rng = np.random.default_rng(2)
    values = rng.normal(0, 1, (41, 7))
    np.testing.assert_allclose(quantile(values, 0.25, axis=0), np.quantile(values, 0.25, axis=0))
    values[rng.random(values.shape) < 0.3] = np.nan
    np.testing.assert_allclose(quantile(values, 0.5, axis=0), np.nanquantile(values, 0.5, axis=0, method="averaged_inverted_cdf"), atol=0.5)
    np.testing.assert_allclose(quantile(values, 0.5, axis=0), np.nanmedian(values, axis=0))


def test_threshold_is_that_of_the_bound():
    h = departures.threshold()
    r = math.log(1e6) / h
    moment, _ = integrate.quad(lambda x: math.exp(r * (x - 1.5)) * stats.chi2.pdf(x, 1), 0, 400)
    assert moment == pytest.approx(1.0, abs=1e-6) and r > 0.1


def test_false_departures_of_the_test_quantity():
    """White innovations, 4 million node steps: the bound gives at most 4 rises; one in 10000 such tests has more than the quantile."""
    rng, count, size = np.random.default_rng(8), 0, 0
    for rows in (1, 5, 12):
        nis = rng.chisquare(rows, (4000, 334))
        count += len(departures.test_episodes(nis, np.full(nis.shape, rows)))
        size += nis.size
    assert count <= stats.poisson.ppf(0.9999, 1e-6 * size), count


def test_innovations_that_grow_are_found_at_once():
    """Three times the expected for 40 steps. The begin is the best guess of a random walk's turn: within three steps in nine of ten runs."""
    near, late = 0, 0
    for seed in range(100):
        rng, at = np.random.default_rng(seed), 60 + seed
        nis, rows = rng.chisquare(8, (250, 6)), np.full((250, 6), 8)
        nis[at : at + 40, 2] *= 3.0
        ((who, begin, end, peak, ratio, *_),) = departures.test_episodes(nis, rows)
        assert who == 2 and begin <= peak <= end and ratio == pytest.approx(nis[begin : end + 1, 2].max() / 8)
        near += abs(begin - at) <= 3 and abs(end - (at + 39)) <= 3
        late += begin > at + 6
    assert near >= stats.binom.ppf(1e-3, 100, 0.9) and late == 0, (near, late)


def test_a_model_that_is_off_throughout_has_no_departure():
    rng = np.random.default_rng(4)
    nis, rows = 4.0 * rng.chisquare(8, (300, 5)), np.full((300, 5), 8)
    assert departures.test_episodes(nis, rows) == []
    nis[200:240, 3] *= 4.0
    ((who, begin, *_),) = departures.test_episodes(nis, rows)
    assert who == 3 and abs(begin - 200) <= 6  # one draw; the law is above


def test_steps_without_readings_say_nothing():
    nis, rows = np.zeros((50, 2)), np.zeros((50, 2), dtype=int)
    nis[:, 1] = np.nan
    assert departures.test_episodes(nis, rows) == []
    rows[:] = 3
    nis[:, 0], nis[20:, 0] = 3.0, np.inf
    ((who, begin, end, *_),) = departures.test_episodes(nis, rows)
    assert (who, begin, end) == (0, 20, 49)


def test_times_and_batches(monkeypatch):
    from meshkal_log import reader

    log = Log(nodes=9, steps=120, dt_s=0.1, seed=2)
    log.arrays["error"][0, 70:95, 6] *= 15.0
    header, whole = surveyed(log)
    (episode,) = whole.departures.of(6)
    assert (episode.begin_step, episode.end_step, episode.lasts) == (70, 94, False)
    assert episode.begin_s == pytest.approx(7.0) and episode.end_s == pytest.approx(9.4)
    assert whole.moment == episode or whole.rank[0] != 6
    monkeypatch.setattr(reader, "BATCH_STEPS", 7)
    _, parts = surveyed(log)
    assert repr(parts.departures.episodes) == repr(whole.departures.episodes) and repr(parts.departures.silences) == repr(whole.departures.silences)


def test_without_truth_the_test_quantity_tells():
    log = Log(nodes=9, steps=150, truth=False)
    log.arrays["nis"][0, 100:, 3] *= 5.0
    _, found = surveyed(log)
    (episode,) = found.departures.episodes
    assert episode.estimator == 3 and not episode.of_error and abs(episode.begin_step - 100) <= 3 and episode.lasts
    assert found.departures.levels is None


def test_who_departs_is_named_beside_the_worst():
    log = Log(nodes=30, steps=150)
    error = log.arrays["error"][0]
    error[:] = healthy(3, 30, 150)
    for k in (1, 2, 3, 4, 5, 6):
        error[:, k] *= 10.0
    error[100:110, 17] += 30.0
    header, found = surveyed(log)
    named = focus(header, found)
    assert 17 in named and found.moment.estimator == 17 and len(named) == 5
    assert sorted(named, key=found.rank.index) == list(named)
    assert focus(header, found, (29, 28))[:2] == (29, 28) and len(focus(header, found, (29, 28))) == 5


@pytest.mark.parametrize("steps", [3, 120])
def test_silence(steps, monkeypatch):
    """All of node 2's neighbours from a step on; a lossy link beside it is none."""
    from meshkal_log import reader

    monkeypatch.setattr(reader, "BATCH_STEPS", 17)
    log = Log(nodes=8, steps=steps)
    rng = np.random.default_rng(1)
    first = np.cumsum([0, *map(len, log.header["slots"])])
    for key in ("measurements_arrived", "estimates_arrived"):
        log.arrays[key] = (rng.random(log.arrays[key].shape) > 0.1).astype(float)
        log.arrays[key][..., first[:-1]] = 1.0
        log.arrays[key][0, 50:90, first[2] + 1 : first[3]] = 0.0
    log.arrays["measurements_arrived"][0, 30:60, first[5]] = 0.0
    _, found = surveyed(log)
    if steps == 3:
        assert found.departures.silences == ()
        return
    (own, own_span), (silence, span) = found.departures.silences
    assert (own.estimator, own.nodes, own.own, own_span.begin_step) == (5, (), True, 30) and own_span.end_step == 59
    assert (silence.estimator, silence.of, silence.own) == (2, 4, False) and set(silence.nodes) <= set(log.header["slots"][2][1:])
    # A message that was lost just before makes it begin earlier.
    assert 46 <= span.begin_step <= 50 and len(silence.nodes) >= 2 and 89 <= span.end_step <= 90
    gone = [1 - log.arrays[key][0][:, first[2] + 1 : first[3]].mean() for key in ("measurements_arrived", "estimates_arrived")]
    assert found.departures.missing[2] == pytest.approx(np.mean(gone))


def test_of_a_run_that_goes_on_the_last_steps_are_kept(monkeypatch):
    """What began before them begins with them, and what ended before them is forgotten."""
    from meshkal_log import reader
    from meshkal_rerun.numbers.survey import per_estimator

    monkeypatch.setattr(reader, "BATCH_STEPS", 10)
    log = Log(nodes=9, steps=200)
    log.arrays["error"][0] = healthy(11, 9, 200)
    log.arrays["error"][0, 40:60, 1] += 40.0
    log.arrays["error"][0, 150:170, 6] += 40.0
    first = np.cumsum([0, *map(len, log.header["slots"])])
    for key in ("measurements_arrived", "estimates_arrived"):
        log.arrays[key] = np.ones(log.arrays[key].shape)
        log.arrays[key][0, 80:120, first[2] + 1 : first[3]] = 0
    source = LogReader(io.BufferedReader(io.BytesIO(log.data())))
    watch = departures.Watch(source.header, most=100)
    for batch in source.batches(0):
        watch.batch(batch, per_estimator(batch, source.header, parse_scenario(source.header)))
        assert watch.departures().watched
    found = watch.departures()
    (episode,) = found.episodes
    assert (episode.estimator, episode.begin_step, episode.end_step) == (6, 150, 169)
    ((silence, span),) = found.silences
    assert silence.estimator == 2 and (span.begin_step, span.end_step) == (100, 119)
