# SPDX-License-Identifier: MIT
"""make reproduce: what it writes, and that its table says what the program's results say."""

import json
import math
import shutil
import subprocess

import numpy as np
import pytest
from rerun.chunk import RrdReader
from tool import MESHKAL, ROOT, SEEDS, command, shows_something, tables

FIGURES = ("network", "msd", "node-msd", "tolerance", "theta", "densities", "transient", "draws")
FILTERS = ("kfc", "rkfc", "kfd", "rkfdu", "rkfdnu", "rkfdnu2")


def result(folder, seed, name):
    return json.loads((folder / "draws" / f"seed-{seed}" / f"{name}.json").read_text())


def filters(folder, seed, name="least-favourable"):
    return {item["filter"]: item for item in result(folder, seed, name)["filters"]}


@pytest.fixture
def copy(reproduced, tmp_path):
    """A copy of all results, to be tampered with."""
    return shutil.copytree(reproduced[0], tmp_path / "copy")


def doctor(folder, seed, name, change):
    path = folder / "draws" / f"seed-{seed}" / f"{name}.json"
    content = json.loads(path.read_text())
    change(content)
    path.write_text(json.dumps(content))


def report(folder):
    return command("local-tolerance", "--out", folder, "--draws", len(SEEDS), "--first-seed", SEEDS[0], "--report-only", cwd=folder)


# What is written


def test_succeeds_and_prints_the_table(reproduced):
    folder, done = reproduced
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stderr == ""
    assert (folder / "table.md").read_text() in done.stdout


@pytest.mark.parametrize("name", FIGURES)
def test_figures_show_something(reproduced, name):
    shows_something(reproduced[0] / f"{name}.png")


def test_recording_holds_the_numbers(reproduced):
    folder, _ = reproduced
    reader = RrdReader(folder / "local-tolerance.rrd")

    def series(entity):
        steps, values = [], []
        for chunk in reader.stream().filter(content=f"/{entity}", is_static=False, components="Scalars:scalars"):
            batch = chunk.to_record_batch()
            steps += batch.column("step").to_pylist()
            values += [row[0] for row in batch.column("Scalars:scalars").to_pylist()]
        order = np.argsort(steps, kind="stable")
        assert np.array_equal(np.array(steps)[order], np.arange(len(steps)))
        return np.array(values)[order]

    found, over_time = filters(folder, SEEDS[0]), filters(folder, SEEDS[0], "over-time")
    for name in FILTERS:
        np.testing.assert_allclose(series(f"msd/{name}"), 10 * np.log10(found[name]["msd"][:201]), rtol=1e-12)
    for node in (0, 19):
        np.testing.assert_array_equal(series(f"tolerance/node/{node}"), np.array(over_time["rkfdnu"]["tolerance_over_time"])[:, node])
        for name in ("rkfdu", "rkfdnu", "rkfdnu2"):
            np.testing.assert_array_equal(series(f"theta/{name}/node/{node}"), np.array(over_time[name]["theta_over_time"])[:, node])
    entities = {chunk.entity_path.lstrip("/") for chunk in reader.stream()}
    assert {"table", "network/rkfdnu/nodes", "network/rkfdnu/edges", "density/12", "transient"} <= entities


def test_table_numbers_are_those_of_the_results(reproduced):
    folder, _ = reproduced
    rows = tables((folder / "table.md").read_text())

    def expect(row, values, digits):
        median, spread = rows[row][1:3]
        low, high = (f"{v:.{digits}f}" for v in (min(values), max(values)))
        assert median == f"{np.median(values):.{digits}f}"
        assert spread == (low if low == high else f"{low} .. {high}")

    def middle(results, name, key):
        return [10 * math.log10(r[name][key][r[name]["horizon"] // 2]) for r in results]

    found = [filters(folder, seed) for seed in SEEDS]
    nominal = [filters(folder, seed, "nominal") for seed in SEEDS]
    over_time = [filters(folder, seed, "over-time") for seed in SEEDS]
    sent = [filters(folder, seed, "communication") for seed in SEEDS]
    for name in FILTERS:
        expect(f"MSD, dB: {name.upper()}", middle(found, name, "msd"), 4)
        expect(f"MSD of the position, dB: {name.upper()}", middle(found, name, "position_msd"), 4)
        expect(f"MSD under the nominal model, dB: {name.upper()}", middle(nominal, name, "msd"), 4)
        expect(f"numbers sent a step by the nodes: {name.upper()}", [f[name]["numbers_sent_per_step"] for f in sent], 0)
    for name in ("rkfc", "rkfdu", "rkfdnu", "rkfdnu2"):
        expect(f"mean tolerance: {name.upper()}", [np.mean(f[name]["node_tolerance"]) for f in found], 4)
        expect(f"mean theta: {name.upper()}", [np.mean(f[name]["node_theta"]) for f in found], 4)
    apart = [max(abs(10 * math.log10(p[name]["msd"][100]) - f[name]["msd_db"]) for name in FILTERS) for p, f in zip(over_time, found)]
    expect("reading at t = 100 of 200 instead: largest change of an MSD, dB", apart, 4)
    assert 0.001 < min(apart) and max(apart) < 0.1
    expect("gain of RKFDNU over RKFDU, dB", [f["rkfdu"]["msd_db"] - f["rkfdnu"]["msd_db"] for f in found], 4)


def test_table_holds_the_published_values(reproduced):
    rows = tables((reproduced[0] / "table.md").read_text())
    published = {name: cells[0] for name, cells in rows.items() if cells[0].replace(".", "").lstrip("-").isdigit()}
    assert published == {
        "MSD, dB: RKFC": "-2.9174",
        "MSD, dB: RKFDU": "-1.5553",
        "MSD, dB: RKFDNU": "-1.6182",
        "MSD, dB: RKFDNU2": "-1.6182",
        "gain of RKFDNU over RKFDU, dB": "0.0629",
        "mean tolerance: RKFC": "0.02",
        "mean tolerance: RKFDU": "0.02",
        "mean tolerance: RKFDNU": "0.0144",
        "mean tolerance: RKFDNU2": "0.0144",
        "mean theta: RKFC": "1.3366",
        "mean theta: RKFDU": "0.3764",
        "mean theta: RKFDNU": "0.3576",
        "mean theta: RKFDNU2": "0.3576",
    }


def test_commands_agree_on_the_tolerances(reproduced):
    """c_k(t) of `analyze` used step by step is what `design` says for the same step."""
    for seed in SEEDS:
        used = np.array(filters(reproduced[0], seed, "over-time")["rkfdnu"]["tolerance_over_time"])
        np.testing.assert_allclose(used, np.array(result(reproduced[0], seed, "design")["per_step"]), rtol=1e-9)


# Properties


def test_claim_that_fails_is_printed_with_its_seed_and_is_no_failure(reproduced):
    """On seed 17 the distributed robust filter with the same tolerance everywhere is worse than the plain one."""
    folder, done = reproduced
    found = filters(folder, 17)
    assert found["rkfdu"]["msd_db"] > found["kfd"]["msd_db"]
    kind, holds, number, seeds = tables(done.stdout)["MSD of RKFDU below KFD"]
    assert (kind, holds, seeds) == ("claim", "**2 of 3**", "17")
    assert f"{found['kfd']['msd_db'] - found['rkfdu']['msd_db']:.3g}" in number
    assert done.returncode == 0


def test_violated_property_is_printed_with_its_seed_and_is_the_exit_status(copy, reproduced):
    def worse(content):
        found = {item["filter"]: item for item in content["filters"]}
        found["rkfdnu"]["msd_db"] = found["rkfdu"]["msd_db"] + 0.001

    doctor(copy, 16, "least-favourable", worse)
    done = report(copy)
    assert done.returncode == 1
    kind, holds, number, seeds = tables(done.stdout)["MSD of RKFDNU below RKFDU"]
    assert (kind, holds, seeds) == ("must hold", "**2 of 3**", "16")
    assert "-0.001" in number
    # Everything else is still there, in print and as files.
    assert list(tables(done.stdout)) == list(tables(reproduced[1].stdout))
    assert all((copy / f"{name}.png").stat().st_mtime > (copy / "draws" / "seed-16" / "least-favourable.json").stat().st_mtime for name in FIGURES)


def of(name, change):
    """A change of one filter in a result that holds all, or in the result itself."""

    def apply(content):
        change(next(item for item in content["filters"] if item["filter"] == name) if "filters" in content else content)

    return apply


def scale(key, factor, *index):
    def apply(item):
        if not index:
            item[key] *= factor
            return
        inner = item[key]
        for i in index[:-1]:
            inner = inner[i]
        inner[index[-1]] *= factor

    return apply


def shift(key, amount):
    def apply(item):
        item[key] += amount

    return apply


TAMPERED = [
    ("MSD of RKFC below RKFDNU", "least-favourable", of("rkfc", shift("msd_db", 3))),
    ("steady MSD of RKFDNU2 that of RKFDNU", "least-favourable", of("rkfdnu2", shift("msd_db", 0.011))),
    ("transient: RKFDNU2 within 0.1 dB of RKFDNU at every step", "least-favourable", of("rkfdnu2", scale("msd", 1.04, 5))),
    ("transient: RKFDNU2 within 0.01 dB of RKFDNU from t = 50 on", "least-favourable", of("rkfdnu2", scale("msd", 1.01, 60))),
    ("theta of RKFDNU below RKFDU, every node and step", "over-time", of("rkfdnu", scale("theta_over_time", 1.5, 3, 7))),
    ("c_k(t) at most c, every node and step", "over-time", of("rkfdnu", scale("tolerance_over_time", 2, 0, 4))),
    ("c_k(t) converges to the designed c_k", "over-time", of("rkfdnu", scale("tolerance_over_time", 1.001, -1, 4))),
    ("MSD of RKFDNU below RKFDU at c = 0.1", "larger-tolerance", of("rkfdnu", shift("msd_db", 1))),
    ("every c_k larger at c = 0.1", "larger-tolerance", of("rkfdnu", scale("node_tolerance", 0.01, 3))),
    ("gap from RKFDNU to RKFDU wider at c = 0.1, in dB", "larger-tolerance", of("rkfdnu", shift("msd_db", 0.1))),
    ("gap from RKFDU to KFD wider at c = 0.1, in dB", "larger-tolerance", of("kfd", shift("msd_db", -1))),
    ("the same gap wider at c = 0.1, in MSD itself", "larger-tolerance", of("rkfc", scale("node_msd", 1.9, 0))),
    ("more edges: MSD of each node with new neighbours falls", "density-12", of("rkfdnu", scale("node_msd", 3, 0))),
    ("more edges: RKFDNU comes nearer to RKFC", "density-8", of("rkfdnu", shift("msd_db", 2))),
    ("complete graph: c_k = c", "complete", of("rkfdnu", scale("node_tolerance", 1.00001, 19))),
    ("complete graph: RKFDNU is RKFC", "complete", of("rkfdnu", shift("msd_db", 0.001))),
    ("MSD of RKFC below KFC", "least-favourable", of("kfc", shift("msd_db", -2))),
    ("nominal truth: KFC the best of the six", "nominal", of("rkfc", shift("msd_db", -2))),
]


@pytest.mark.parametrize(("text", "name", "change"), TAMPERED, ids=[t[0] for t in TAMPERED])
def test_every_property_can_fail(copy, text, name, change):
    from local_tolerance.draws import load
    from local_tolerance.properties import PROPERTIES
    from statements import MUST, evaluate

    seeds = range(SEEDS[0], SEEDS[-1] + 1)

    def failed():
        draws, errors = load(copy, seeds)
        assert not errors
        return {o.property.text: o.failed for o in evaluate(PROPERTIES, draws) if o.property.kind == MUST}

    assert failed()[text] == []
    doctor(copy, 16, name, change)
    assert failed()[text] == [16]


def test_not_a_number_fails(copy):
    doctor(copy, 17, "over-time", of("rkfdnu", scale("theta_over_time", math.nan, 3, 7)))
    done = report(copy)
    assert done.returncode == 1
    assert tables(done.stdout)["theta of RKFDNU below RKFDU, every node and step"][-1] == "17"


# What cannot be computed


def test_draw_that_fails_is_named_and_the_others_remain(needs_program, tmp_path):
    wrapper = tmp_path / "meshkal"
    wrapper.write_text(
        f'#!/bin/sh\ncase "$*" in analyze*seed-16*nominal*) echo "meshkal: net.json: no steady state" >&2; exit 2;; esac\nexec "{MESHKAL}" "$@"\n'
    )
    wrapper.chmod(0o755)
    done = command("local-tolerance", "--meshkal", wrapper, "--out", tmp_path / "out", "--draws", 2, "--first-seed", 16, cwd=tmp_path)
    assert done.returncode == 1
    assert "1 draw could not be computed" in done.stdout
    assert "- seed 16: meshkal analyze: net.json: no steady state" in done.stdout
    assert tables(done.stdout)["MSD of RKFC below RKFDNU"][1] == "all 1"
    assert json.loads((tmp_path / "out" / "results.json").read_text())["seeds"] == [17]


def test_value_that_is_not_steady_is_no_value(copy):
    def unsteady(content):
        of("rkfdu", lambda item: item.update(steady=False, msd_db=None))(content)

    doctor(copy, 16, "nominal", unsteady)
    done = report(copy)
    assert done.returncode == 1
    assert "- seed 16: nominal: rkfdu is not steady half way through a horizon of " in done.stdout


def test_no_draw_at_all(tmp_path):
    done = command("--out", tmp_path, "--report-only", cwd=tmp_path)
    assert done.returncode == 2  # not even a folder
    for paper in ("local-tolerance", "incomplete-measurements", "distributed-unscented", "slow-faults"):
        (tmp_path / paper).mkdir()
    done = command("--out", tmp_path, "--report-only", cwd=tmp_path)
    assert done.returncode == 1
    assert "30 draws could not be computed" in done.stdout
    assert done.stdout.count("30 batches could not be computed") == 2


def test_missing_program_and_wrong_options(tmp_path):
    done = command("--meshkal", tmp_path / "none", "--out", tmp_path / "out", cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == f"reproduce: no program at {tmp_path / 'none'}: run make all, or give --meshkal\n"
    assert not (tmp_path / "out").exists()
    assert command("--draws", "0", cwd=tmp_path).returncode == 2
    assert command("another-paper", cwd=tmp_path).returncode == 2


def test_make_honours_build():
    done = subprocess.run(["make", "-n", "--no-print-directory", "reproduce", "BUILD=some/where", "DRAWS=3"], cwd=ROOT, capture_output=True, text=True, check=True)
    last = done.stdout.strip().splitlines()[-1]
    assert "--meshkal some/where/meshkal --out some/where/reproduce --draws 3" in last


# Networks


def test_edge_sets_are_nested_shortest_first(reproduced):
    folder, _ = reproduced
    for seed in SEEDS:
        scenarios = [result(folder, seed, name) for name in ("scenario", "density-8-scenario", "density-12-scenario", "complete-scenario")]
        sets = [{tuple(sorted(edge)) for edge in s["edges"]} for s in scenarios]
        assert sets[0] < sets[1] < sets[2] < sets[3]
        assert [len(s) for s in sets[1:]] == [70, 110, 190]
        place = [node["position_m"] for node in scenarios[0]["nodes"]]
        added, left = sets[2] - sets[0], sets[3] - sets[2]
        assert max(math.dist(place[i], place[j]) for i, j in added) <= min(math.dist(place[i], place[j]) for i, j in left)
        assert all({**s, "edges": 0, "name": 0} == {**scenarios[0], "edges": 0, "name": 0} for s in scenarios)
