# SPDX-License-Identifier: MIT
"""make reproduce, distributed unscented information filter: what it writes, and that every statement can fail."""

import copy
import json
import math
import shutil
import subprocess

import numpy as np
import pytest
from rerun.chunk import RrdReader
from tool import BATCHES, MESHKAL, command, shows_something, tables


@pytest.fixture(scope="module")
def batches(distributed):
    from distributed_unscented.batches import load

    found, errors = load(distributed[0], range(BATCHES[0], BATCHES[-1] + 1))
    assert not errors
    return found


def outcomes(batches):
    from distributed_unscented.properties import PROPERTIES
    from statements import evaluate

    return {o.property.text: o for o in evaluate(PROPERTIES, batches)}


def test_succeeds_and_prints_the_table(distributed):
    folder, done = distributed
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stderr == ""
    assert (folder / "table.md").read_text() in done.stdout


@pytest.mark.parametrize("name", ["nodes", "rmse", "iterations", "disagreement", "theorem"])
def test_figures_show_something(distributed, name):
    shows_something(distributed[0] / f"{name}.png")


def test_recording_holds_the_run(distributed):
    entities = {chunk.entity_path for chunk in RrdReader(distributed[0] / "distributed-unscented.rrd").stream()}
    assert len(entities) > 20


def test_table_numbers_are_those_of_the_results(distributed, batches):
    rows = tables(distributed[1].stdout)
    for variant, text in (("all, paper, 10", "all visible, paper's protocol, L = 10"), ("85 m, paper, 1", "range 85 m, paper's protocol, L = 1")):
        for row, best in (("best", min), ("worst", max)):
            values = [best(b.of[variant]["node_position_rmse"]) for b in batches]
            median, spread = rows[f"RMSE, {row} node: {text}"][1:3]
            assert median == f"{np.median(values):.4f}"
            low, high = (f"{limit(values):.4f}" for limit in (min, max))
            assert spread == (low if low == high else f"{low} .. {high}")
    assert rows["RMSE, best node: all visible, paper's protocol, L = 10"][3] == "0.7660"
    assert rows["RMSE, worst node: no consensus, one range sensor alone"][3] == "64.0000"
    assert rows["disagreement, largest: range 85 m, paper's protocol, L = 3"][3] == "0.24"


def test_all_visible_is_what_another_found(batches):
    """RMSE of the centralised filter: 0.763 m by an independent reproduction of as many runs. Both move by their own chance."""
    values = [b.of["all, centralised"]["position_rmse"] for b in batches]
    halves = [b.of["all, centralised"]["position_rmse_ci95"] for b in batches]
    assert 0.0 < max(halves) < 0.06
    mean, spread = np.mean(values), math.hypot(np.mean(halves) / math.sqrt(len(values)), np.mean(halves))
    assert abs(mean - 0.763) < 2 * spread


def test_complete_graph_is_the_centralised_filter(batches):
    """One Metropolis iteration on it is the average: all nodes say the same."""
    for where in ("all", "100 m", "85 m"):
        item = batches[0].of[f"{where}, centralised"]
        assert item["disagreement_largest"] < 1e-6
        assert np.ptp(item["node_position_rmse"]) < 1e-7


def test_eigenvalues_are_those_of_the_weights(batches):
    metropolis = np.array([[2, 1, 0], [1, 1, 1], [0, 1, 2]]) / 3
    paper = np.array([[1 / 2, 1 / 2, 0], [1 / 3, 1 / 3, 1 / 3], [0, 1 / 2, 1 / 2]])
    for protocol, weights in (("metropolis", metropolis), ("paper", paper), ("perron", paper)):
        expected = np.sort(np.abs(np.linalg.eigvals(weights)))[-2]
        assert math.isclose(batches[0].eigenvalue(protocol), expected, rel_tol=1e-12)
    from distributed_unscented.graphs import GRAPHS

    one = next(case for case in batches[0].design["consensus"]["cases"] if case.get("measuring") == "one")
    graph = next(graph for graph in GRAPHS if graph.title == "path, one end measures")
    assert math.isclose(one["second_eigenvalue"], graph.second_eigenvalue(), rel_tol=1e-12)


def test_rate_of_a_known_curve():
    from distributed_unscented.properties import rate

    steps = np.arange(41)
    assert math.isclose(rate(0.5**steps), 0.5, rel_tol=1e-9)
    assert math.isclose(rate(0.9**steps + 5 * 0.2**steps), 0.9, rel_tol=1e-6)
    assert math.isclose(rate(0.5**steps + 1e-16), 0.5, rel_tol=1e-3)
    assert rate(np.full(41, 0.3)) == 1.0
    assert math.isnan(rate(np.zeros(41)))


# Statements


def more(variant, factor, key="node_position_rmse"):
    def apply(batch):
        item = batch.of[variant]
        item[key] = [factor * value for value in item[key]] if isinstance(item[key], list) else factor * item[key]

    return apply


def move(name, to=None):
    def apply(batch):
        batch.estimates[name] = batch.estimates[to] if to else batch.estimates[name] * (1 + 1e-6)

    return apply


def drift(protocol):
    def apply(batch):
        curves = batch.disagreement[protocol]
        batch.disagreement[protocol] = curves * 1.02 ** np.arange(curves.shape[1])

    return apply


def still(title):
    """Values that stay as they began."""

    def apply(batch):
        batch.graphs[title] = np.tile(batch.graphs[title][0], (len(batch.graphs[title]), 1))

    return apply


def agree(title):
    def apply(batch):
        values = batch.graphs[title].copy()
        values[-4:] = values[-4:].mean()
        batch.graphs[title] = values

    return apply


def nudge(title, amount, last=False):
    def apply(batch):
        values = batch.graphs[title].copy()
        values[-1 if last else 7] += amount * np.ptp(values[0])
        batch.graphs[title] = values

    return apply


PATH = "path, all measure"
NAMES = {
    "Metropolis, L = 100: the centralised filter": move("metropolis"),
    "paper's protocol, scaled, L = 100: the centralised filter": move("perron"),
    "ratio consensus, L = 100: the centralised filter": move("ratio"),
    "paper's protocol, L = 100: its Perron mean": move("paper"),
    "paper's protocol, L = 100: not the centralised filter": move("paper", "centralised, information as published"),
    "RMSE of every node within 1 % of the centralised: all visible, paper's protocol, L = 10": more("all, paper, 10", 1.03),
    "RMSE of every node within 1 % of the centralised: all visible, Metropolis, L = 10": more("all, metropolis, 10", 0.98),
    "RMSE of every node within 1 % of the centralised: range 100 m, paper's protocol, L = 10": more("100 m, paper, 10", 1.1),
    **{f"disagreement falls as the second eigenvalue that design tells: {p}": drift(p) for p in ("paper", "perron", "metropolis", "ratio")},
    **{
        f"theorem met, agrees: {title}": still(title)
        for title in (
            PATH,
            "path, one end measures",
            "triangle, none measures",
            "directed ring of 4, one measures",
            "directed tree, its root measures",
        )
    },
    **{
        f"theorem broken, never agrees: {title}": agree(title)
        for title in ("path, none measures", "directed ring of 4, none measures", "two parts, all measure", "two roots measure, one node hears both")
    },
    "iterations of the library: powers of the weight matrix": nudge(PATH, 1e-10),
    "their limit, undirected: sum of pi_j s_j": nudge(PATH, 1e-10, last=True),
    "more iterations, less disagreement: range 85 m, L = 1, 3, 10": more("85 m, paper, 10", 100.0, "disagreement_rms"),
    "without consensus ten times the error": more("alone", 0.1),
}


@pytest.mark.parametrize("text", NAMES)
def test_every_property_can_fail(batches, text):
    # Range 100 m holds on few batches: then it is made to hold first.
    first = copy.deepcopy(batches[0])
    if "range 100 m, paper" in text:
        item = first.of["100 m, paper, 10"]
        item["node_position_rmse"] = [first.of["100 m, centralised"]["position_rmse"]] * 3
    assert outcomes([first])[text].failed == []
    NAMES[text](first)
    assert outcomes([first])[text].failed == [1]


def test_no_property_is_left_untampered():
    from distributed_unscented.properties import PROPERTIES
    from statements import OPEN

    assert {p.text for p in PROPERTIES if p.kind != OPEN} == set(NAMES)


def test_wrong_scale_of_the_information_is_seen(distributed, batches, tmp_path):
    """The trap of the Perron weights: with R / pi instead of R / (N pi) the mean is another, by much."""
    from distributed_unscented.properties import EQUAL
    from run_logs import over_time

    folder = distributed[0] / "draws" / "seed-1"
    scenario = json.loads((folder / "limit-Perron-mean-scenario.json").read_text())
    for node in scenario["nodes"]:
        node["R"][0][0] /= 3
    (tmp_path / "s.json").write_text(json.dumps(scenario))
    subprocess.run(
        [MESHKAL, "simulate", tmp_path / "s.json", "--filter", "duif", "--measurements", folder / "measurements.csv", "--out", tmp_path / "l.cbor"],
        check=True, capture_output=True,
    )  # fmt: skip
    paper = batches[0].estimates["paper"]
    assert np.abs(over_time(tmp_path / "l.cbor", "estimate") - paper).max() / np.abs(paper).max() > 1e6 * EQUAL


def test_missing_helper_program_is_named(needs_program, tmp_path):
    shutil.copy(MESHKAL, tmp_path / "meshkal")
    done = command("distributed-unscented", "--meshkal", tmp_path / "meshkal", "--out", tmp_path / "out", "--draws", 1, cwd=tmp_path)
    assert done.returncode == 1
    assert f"- seed 1: no program at {tmp_path / 'consensus-run'}: run make all" in done.stdout


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "no protocol"),
        ("paper 5 0", "too many or too few"),
        ("paper 0 3", "too many or too few"),
        ("gossip 5 1\n1 2.0 0", "unknown protocol"),
        ("paper 5 2\n1 2.0 1 1\n1 3.0 1 7", "a node is wrong"),
        ("paper 5 2\n1 2.0 1 1\n1 3.0", "a node is wrong"),
        ("paper 5 1\n1 nan 0", "MK_ERROR_NOT_FINITE"),
    ],
)
def test_consensus_program_refuses(needs_program, text, said):
    done = subprocess.run([MESHKAL.with_name("consensus-run")], input=text, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert said in done.stderr
