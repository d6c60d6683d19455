# SPDX-License-Identifier: MIT
"""Wrong command lines and CSV files, models that a filter cannot follow: each named, exit status 2, nothing written."""
import json
import os
import subprocess

import pytest

ONE = {"model": {"A": [[0.5]], "Q": [[1.0]]}, "nodes": [{"C": [[1.0]], "R": [[1.0]]}], "edges": [], "tolerance": 0.1}
PAIR = {"model": {"A": [[0.9, 0.1], [0.0, 0.8]], "Q": [[1.0, 0.0], [0.0, 1.0]]},
        "nodes": [{"C": [[1.0, 0.0]], "R": [[1.0]]}, {"C": [[1.0, 0.0], [0.0, 1.0]], "R": [[1.0, 0.0], [0.0, 1.0]]}], "edges": [[0, 1]]}


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "one.json").write_text(json.dumps(ONE))
    (tmp_path / "pair.json").write_text(json.dumps(PAIR))
    return tmp_path


SIM, DES, GEN = ("simulate", "{}/one.json", "--out", "{}/o", "--json", "{}/j"), ("design", "{}/one.json", "--json", "{}/j", "--c-header", "{}/h"), \
    ("scenario", "projectile")
BAD = [
    (("run",), "unknown command run (meshkal help lists them)"),
    (("--steps", 3), "unknown command --steps"),
    (("simulate",), "simulate: the scenario file is missing"),
    (("design", "--real", "float32"), "design: the scenario file is missing"),
    (("scenario",), "scenario: the kind of scenario is missing"),
    (("scenario", "rocket"), "scenario rocket: must be projectile, incomplete-measurements, distributed-unscented or gnss-ins"),
    ((*SIM, "more.json"), "simulate: unexpected argument more.json"),
    ((*SIM, "--step", 3), "simulate: unknown option --step (meshkal help lists them)"),
    ((*DES, "--filter", "kfd"), "design: unknown option --filter"),
    ((*GEN, "--edges", 3), "scenario: unknown option --edges"),
    ((*SIM, "--seed"), "simulate: option --seed needs a value"),
    ((*DES, "--tolerance"), "design: option --tolerance needs a value"),
    ((*SIM, "--filter", "kf"), "--filter kf: must be kfc, rkfc, kfd, rkfdu, rkfdnu, rkfdnu2 or all"),
    ((*SIM, "--filter", "all"), "--out: a log holds one filter; choose one with --filter"),
    ((*SIM, "--real", "float16"), "--real float16: must be float32 or float64"),
    ((*DES, "--real", "double"), "--real double: must be float32 or float64"),
    ((*DES, "--c-max", "some"), "--c-max some: must be none, central or all"),
    (("design", "{}/one.json", "--per-step", 3), "--per-step goes with --json"),
    ((*SIM, "--truth", "x.csv"), "--truth x.csv: must be nominal or least-favourable; a file goes with --measurements"),
    ((*SIM, "--measurements", "x.csv", "--runs", 2), "--runs: recorded measurements can be run once only"),
    *(((*SIM, "--steps", v), f"--steps {v}: must be an integer from 1 to 1000000000") for v in (0, -1, 1.5, "", "ten", "5x", 10**9 + 1, 10**30)),
    *(((*SIM, "--runs", v), f"--runs {v}: must be an integer from 1 to 100000000") for v in (0, "1e3", 10**8 + 1)),
    *(((*SIM, "--seed", v), f"--seed {v}: must be an integer from 0 to 9223372036854775807") for v in (-1, 2**63, "x")),
    *(((*SIM, "--loss", v), f"--loss {v}: must be a number from 0 to 1") for v in (-0.1, 1.01, "nan", "10%", "inf", "")),
    *(((*SIM, "--tolerance", v), f"--tolerance {v}: must be a number from 0 to ") for v in (-1, "nan", "inf", 1e300, "c")),
    *(((*DES, "--tolerance", v), f"--tolerance {v}: must be a number from 0 to ") for v in (-1, "nan", "0,1")),
    ((*DES, "--per-step", 0), "--per-step 0: must be an integer from 1 to 100000000"),
    *(((*GEN, "--nodes", v), f"--nodes {v}: must be an integer from 2 to 10000000") for v in (1, "x", 10**8)),
    ((*GEN, "--seed", -1), "--seed -1: must be an integer from 0 to"),
    *(((*GEN, "--density", v), f"--density {v}: must be a number from 1 to 1e+06") for v in (0.5, "nan", "")),
    ((*SIM[:2], "--out", "{}/none/o"), "none/o: No such file or directory"),
    ((*SIM[:2], "--out", "{}"), ": Is a directory"),
    ((*SIM[:2], "--json", "{}/none/j"), "none/j: No such file or directory"),
    ((*SIM[:4], "--json", "{}/none/j"), "none/j: No such file or directory"),
]


@pytest.mark.parametrize("arguments,message", BAD, ids=range(len(BAD)))
def test_bad_arguments(refused, folder, arguments, message):
    said = refused(folder, *arguments)
    assert message in said, said


@pytest.mark.parametrize("option,status", [("--json", 2), ("--c-header", 1)])
def test_design_without_a_place(run, folder, option, status):
    """The place is found wanting before the work or after it: either way an error that names it, and nothing half-written."""
    (folder / "file").write_text("kept")
    for place in ("none/x", "file/x"):
        before = sorted(folder.rglob("*"))
        done = run("design", folder / "one.json", option, folder / place, status=status)
        assert f"{folder / place}".encode() in done.stderr and b": No such file" in done.stderr or b": Not a directory" in done.stderr
        assert sorted(folder.rglob("*")) == before and (folder / "file").read_text() == "kept"


def test_help_and_version(run):
    for word in ("help", "--help", "-h"):
        text = run(word).stdout.decode()
        assert all(f"meshkal {command} " in text for command in ("design", "simulate", "scenario"))
    assert run("--version").stdout.startswith(b"meshkal ")
    run(status=2)


def test_help_names_every_option(run, folder):
    """An option in the help that the program does not know would answer `unknown option`, not `needs a value` or, a flag, look for the file."""
    command, seen = None, 0
    for line in run("help").stdout.decode().splitlines():
        words = line.split()
        command = words[1] if line.startswith("meshkal ") and len(words) > 2 else command
        for word in (w for w in words if w.startswith("--") and line.startswith("    ")):
            done = run(command, "projectile", word, status=2).stderr.decode()
            assert "needs a value" in done or "projectile: No such file" in done, f"{command} {word}: {done}"
            seen += 1
    assert seen > 15


# --- models ----------------------------------------------------------------------------------------------------------

def test_unobservable_node_is_named(run, refused, folder):
    blind = PAIR | {"nodes": [*PAIR["nodes"], {"C": [[0.0, 1.0]], "R": [[1.0]]}, {"C": [[0.0, 0.0]], "R": [[1.0]]}], "edges": [[0, 1], [0, 2]]}
    (folder / "blind.json").write_text(json.dumps(blind))
    # Node 2 hears node 0 and sees all; node 3 is alone and sees nothing.
    said = refused(folder, "design", folder / "blind.json", "--json", "{}/j", "--c-header", "{}/h")
    assert said.startswith("node 3: ") and "2 of 2 state dimensions are not observable" in said and "--allow-unobservable" in said
    done = run("design", folder / "blind.json", "--json", folder / "j", "--allow-unobservable")
    assert [n["unobservable"] for n in json.loads((folder / "j").read_text())["nodes"]] == [0, 0, 0, 2]
    assert b"nodes that do not observe all states: 1\n" in done.stdout
    # [0 1; 0 1]: what node 0 measures does not feel the second state.
    blind = PAIR | {"model": PAIR["model"] | {"A": [[0.9, 0.0], [0.1, 0.8]]}, "edges": []}
    (folder / "blind.json").write_text(json.dumps(blind))
    said = refused(folder, "design", folder / "blind.json")
    assert said.startswith("node 0: ") and "1 of 2 state dimensions are not observable" in said


def test_many_unobservable_nodes_are_listed(refused, folder):
    blind = ONE | {"nodes": [{"C": [[float(k == 4)]], "R": [[1.0]]} for k in range(20)]}
    (folder / "blind.json").write_text(json.dumps(blind))
    said = refused(folder, "design", folder / "blind.json")
    assert said.startswith("node 0, node 1, node 2, node 3, node 5, ") and "node 10, ...: " in said and "node 4" not in said


def test_noise_that_does_not_reach_a_state(refused, run, folder):
    still = PAIR | {"model": {"A": [[0.9, 0.0], [0.0, 0.8]], "Q": [[1.0, 0.0], [0.0, 0.0]]}}
    (folder / "still.json").write_text(json.dumps(still))
    assert "the noise Q does not reach 1 of 2 state dimensions" in refused(folder, "design", folder / "still.json", "--json", "{}/j")
    still["model"]["A"] = [[0.9, 0.0], [0.1, 0.8]]
    (folder / "still.json").write_text(json.dumps(still))
    run("design", folder / "still.json")


# Noise reaches the second state through the first only; with a large tolerance its covariance cycles.
FRAGILE = {"model": {"A": [[0.4, 0.2], [-0.7, 0.5]], "Q": [[1.0, 0.0], [0.0, 0.0]]}, "nodes": [{"C": [[1.0, 0.0]], "R": [[10.0]]}], "edges": []}


@pytest.mark.parametrize("where", ["option", "file"])
def test_tolerance_without_convergence(refused, run, folder, where):
    (folder / "fragile.json").write_text(json.dumps(FRAGILE | ({"tolerance": 10.0} if where == "file" else {})))
    option = ("--tolerance", 10) if where == "option" else ()
    for command in (("design", "--json", "{}/j", "--c-header", "{}/h"), ("simulate", "--out", "{}/o", "--json", "{}/j"), ("simulate", "--out", "-")):
        said = refused(folder, command[0], folder / "fragile.json", *option, *command[1:])
        assert said == "tolerance 10: the centralised filter does not converge"
    run("design", folder / "fragile.json", "--tolerance", 0.01)


def test_tolerance_that_one_node_does_not_survive(refused, folder):
    """Node 0 has a good sensor, and the centre with it; node 1 is alone with a poor one."""
    (folder / "node.json").write_text(json.dumps(FRAGILE | {"nodes": [{"C": [[1.0, 0.0]], "R": [[0.01]]}, *FRAGILE["nodes"]]}))
    said = refused(folder, "design", folder / "node.json", "--tolerance", 10, "--json", "{}/j", "--c-header", "{}/h")
    assert said.startswith("tolerance 10: the filter of node 1, with its local tolerance 9.9") and said.endswith(", does not converge"), said


@pytest.mark.parametrize("command", ["design", "simulate"])
def test_more_slots_than_a_node_can_number(program, folder, command):
    """A slot number has 16 bits. Node 0 of this star has 65536 slots: refused by name, or used to the last one."""
    nodes = 65536
    star = ONE | {"nodes": [{"C": [[1.0]], "R": [[1.0]]}] * nodes, "edges": [[0, k] for k in range(1, nodes)], "steps": 1}
    (folder / "star.json").write_text(json.dumps(star))
    extra = ("--c-max", "none", "--json", folder / "out") if command == "design" else ("--filter", "kfd", "--out", folder / "out")
    done = subprocess.run([program, command, folder / "star.json", *extra], capture_output=True, timeout=60)
    assert done.returncode == 2 and b"node 0" in done.stderr and not (folder / "out").exists(), done


# --- recorded data ---------------------------------------------------------------------------------------------------

HEAD, STATE = "t,node,row,value\n", "t,state,value\n"
CSV = [
    # measurements, truth, words after the path of the file that is wrong (y or x)
    ("", None, "y.csv: empty"),
    ("t,node,value\n0,0,1\n", None, "y.csv:1: the header must be t,node,row,value"),
    (HEAD, None, "y.csv: no measurements"),
    (HEAD + "0,0,0,1\n0,0,0\n", None, "y.csv:3: column row: expected a number and a comma"),
    (HEAD + "0,0,0,\n", None, "y.csv:2: column value: expected a number"),
    (HEAD + "0,0,0,NaN\n", None, "y.csv:2: column value is not finite"),
    (HEAD + "0,0,0,1;2\n", None, "y.csv:2: column value: expected a number and the end of the line"),
    (HEAD + "0,2,0,1\n", None, "y.csv:2: node is 2: must be an integer from 0 to 1"),
    (HEAD + "\n0,-1,0,1\n", None, "y.csv:3: node is -1: must be an integer"),
    (HEAD + "0,0,1,1\n", None, "y.csv:2: row is 1: must be an integer from 0 to 0"),
    (HEAD + "0,1,2,1\n", None, "y.csv:2: row is 2: must be an integer from 0 to 1"),
    (HEAD + "0.5,1,1,1\n", None, "y.csv:2: t is 0.5: must be an integer"),
    (HEAD + "-1,1,1,1\n", None, "y.csv:2: t is -1: must be an integer"),
    (HEAD + "0,1,1,1\n1,1,1,1\n0,1,1,1\n", None, "y.csv:4: a second value for the same place"),
    (HEAD + "999999999,1,1,1\n", None, "y.csv: t up to 999999999 for 3 rows does not fit in memory"),
    (HEAD + "0,1,1,1\n\0 1,1,1,1\n", None, "y.csv"),
    (HEAD + "0,0,0,1\n", "", "x.csv: empty"),
    (HEAD + "0,0,0,1\n", HEAD, "x.csv:1: the header must be t,state,value"),
    (HEAD + "0,0,0,1\n", STATE + "0,2,1\n", "x.csv:2: state is 2: must be an integer from 0 to 1"),
    (HEAD + "0,0,0,1\n", STATE + "0,1,1\n0,1,1\n", "x.csv:3: a second value for the same place"),
    (HEAD + "0,0,0,1\n", STATE + "0,1,inf\n", "x.csv:2: column value is not finite"),
]


@pytest.mark.parametrize("y,x,message", CSV, ids=range(len(CSV)))
def test_bad_csv(refused, folder, y, x, message):
    (folder / "y.csv").write_text(y)
    if x is not None:
        (folder / "x.csv").write_text(x)
    said = refused(folder, "simulate", "{}/pair.json", "--measurements", "{}/y.csv", *(() if x is None else ("--truth", "{}/x.csv")),
                   "--out", "{}/o", "--json", "{}/j")
    assert said.startswith(f"{folder}/{message}"), said


ARRIVAL = "t,stage,from,to\n"
ARRIVALS = [
    ("", "a.csv: empty"),
    ("t,from,to\n", "a.csv:1: the header must be t,stage,from,to"),
    (ARRIVAL + "0,1,0\n", "a.csv:2: column from: expected a number and a comma"),
    (ARRIVAL + "0,0,0,1\n", "a.csv:2: stage is 0: must be 1 (reading) or 2 (estimate)"),
    (ARRIVAL + "0,1,0,1\n\n0,3,0,1\n", "a.csv:4: stage is 3: must be 1 (reading) or 2 (estimate)"),
    (ARRIVAL + "-1,1,0,1\n", "a.csv:2: t is -1: must be an integer"),
    (ARRIVAL + "0,1.5,0,1\n", "a.csv:2: stage is 1.5: must be an integer"),
    (ARRIVAL + "0,1,2,1\n", "a.csv:2: from is 2: must be an integer from 0 to 1"),
    (ARRIVAL + "0,1,1,-3\n", "a.csv:2: to is -3: must be an integer from 0 to 1"),
    (ARRIVAL + "0,1,1,1\n", "a.csv:2: from and to are node 1: a node always hears itself, leave the line out"),
    (ARRIVAL + "1,1,0,1\n0,1,0,1\n1,1,1,0\n1,1,0,1\n0,1,0,1\n", "a.csv:5: this arrival stands in the file already"),
    # Of steps that are not run, too.
    (ARRIVAL + "900000000,1,0,5\n", "a.csv:2: to is 5: must be an integer from 0 to 1"),
]


@pytest.mark.parametrize("text,message", ARRIVALS, ids=range(len(ARRIVALS)))
def test_bad_arrivals(refused, folder, text, message):
    (folder / "a.csv").write_text(text)
    said = refused(folder, "simulate", "{}/pair.json", "--arrivals", "{}/a.csv", "--out", "{}/o", "--json", "{}/j")
    assert said.startswith(f"{folder}/{message}"), said


def test_arrivals_need_an_edge(refused, folder):
    (folder / "a.csv").write_text(ARRIVAL + "3,2,0,1\n3,2,1,2\n3,2,0,2\n")
    chain = {"model": {"A": [[0.9]], "Q": [[0.2]]}, "nodes": [{"C": [[1.0]], "R": [[0.5]]}] * 3, "edges": [[0, 1], [1, 2]], "tolerance": 0.05}
    (folder / "chain.json").write_text(json.dumps(chain))
    said = refused(folder, "simulate", "{}/chain.json", "--arrivals", "{}/a.csv", "--out", "{}/o")
    assert said == f"{folder}/a.csv:4: node 2 does not hear node 0: the scenario has no edge between them"
    assert refused(folder, "simulate", "{}/chain.json", "--arrivals", "{}/b.csv").endswith("b.csv: No such file or directory")


def test_missing_csv(refused, folder):
    assert refused(folder, "simulate", "{}/pair.json", "--measurements", "{}/y.csv", "--out", "{}/o").endswith("y.csv: No such file or directory")
    (folder / "y.csv").write_text(HEAD + "0,0,0,1\n")
    assert refused(folder, "simulate", "{}/pair.json", "--measurements", "{}/y.csv", "--truth", "{}").endswith(": Is a directory")


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_forbidden_file(refused, folder):
    (folder / "pair.json").chmod(0)
    assert refused(folder, "simulate", "{}/pair.json").endswith("pair.json: Permission denied")
