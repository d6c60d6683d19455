# SPDX-License-Identifier: MIT
"""meshkal-mpi on 1 to 4 ranks against one process: the same bytes. Every start of mpirun takes half a second, so that cases are chosen, not
multiplied out."""
import io
import json
import pathlib
import subprocess

import cbor2
import pytest

MIXED = pathlib.Path(__file__).resolve().parents[1] / "host" / "mixed.json" # nodes of different rows


def network(nodes, edges, *, C=None, A=((0.95, 0.1), (0.0, 0.9)), **keys):
    """Two states; node k measures one or both of them."""
    C = C or (lambda k: [[[1.0, 0.0]], [[0.0, 1.0]], [[1.0, 0.5], [0.0, 1.0]]][k % 3])
    sensors = [{"C": C(k), "R": [[0.5 * (i == j) for j in range(len(C(k)))] for i in range(len(C(k)))]} for k in range(nodes)]
    return {"model": {"A": A, "Q": [[0.2, 0.0], [0.0, 0.1]], "position_states": [1]}, "nodes": sensors, "edges": edges, "tolerance": 0.05,
            "steps": 40} | keys


def ring(nodes):
    return [[k, (k + 1) % nodes] for k in range(nodes)]


def grid(width, height):
    return [[y * width + x, y * width + x + d] for y in range(height) for x in range(width) for d in (1, width)
            if (d == width or x + 1 < width) and y * width + x + d < width * height]


NETWORKS = {
    "mixed": None, "projectile": None,
    "grid": network(150, grid(15, 10)),
    "faulty": network(60, grid(10, 6), faults=[{"node": 7, "from_s": 10, "to_s": 25, "rate": 0.5}, {"node": 31, "from_s": 12, "step": 6}],
                      monitor={"window": 5, "false_alarm": 1e-3}),
    # So many that one process, too, has them in an order of its own.
    "large": network(5000, grid(100, 50), C=lambda k: [[1.0, 0.5], [0.0, 1.0]][k % 3 // 2:], steps=3),
    "one": network(1, []), "three": network(3, ring(3)), "complete": network(9, [[i, j] for i in range(9) for j in range(i)]),
    # Two rings, a pair, and nodes by themselves.
    "apart": network(12, ring(4) + [[4 + a, 4 + b] for a, b in ring(3)] + [[7, 8]], C=lambda k: [[1.0, 0.0], [0.0, 1.0]]),
    "star": network(13, [[6, k] for k in range(13) if k != 6]),
}


@pytest.fixture(scope="session")
def scenario(program, alone, tmp_path_factory):
    folder = tmp_path_factory.mktemp("networks")

    def path(name):
        if name == "mixed":
            return MIXED
        file = folder / f"{name}.json"
        if not file.exists() and name == "projectile":
            file.write_bytes(subprocess.run([program, "scenario", "projectile", "--nodes", "9"], capture_output=True, check=True).stdout)
        elif not file.exists():
            file.write_text(json.dumps(NETWORKS[name]))
        return file
    return path


@pytest.fixture
def as_one(alone, mpi, figures, tmp_path, scenario):
    """Runs a campaign in one process, then each (ranks, options): log, figures and what is left behind are the same."""
    def call(name, options, *ways, log=True):
        def made(place, how, *arguments):
            place.mkdir()
            how(*arguments, scenario(name), *options, *(("--out", place / "log") if log else ()), "--json", place / "json")
            assert sorted(p.name for p in place.iterdir()) == (["json", "log"] if log else ["json"])
            return figures(place / "json"), (place / "log").read_bytes() if log else b""
        want = made(tmp_path / "alone", alone)
        for i, (ranks, *more) in enumerate(ways):
            got = made(tmp_path / str(i), lambda *arguments: mpi(ranks, *arguments, *more))
            assert got[1] == want[1], (ranks, more)
            assert got[0] == want[0], (ranks, more)
            summary = json.loads((tmp_path / str(i) / "json").read_text())
            assert summary.get("processes", 1) == ranks and summary.get("split", more[1]) == more[1]
        return json.loads(want[0])
    return call


NODES, RUNS = ("--split", "nodes"), ("--split", "runs")


@pytest.mark.parametrize("name,options,ways", [
    ("mixed", ("--loss", 0.3, "--real", "float32", "--runs", 3),
     [(1, *NODES), (2, *NODES), (3, *NODES), (4, *NODES), (1, *RUNS), (3, *RUNS)]),
    ("projectile", ("--filter", "rkfdnu", "--truth", "least-favourable", "--runs", 5), [(2, *NODES), (4, *NODES), (2, *RUNS), (4, *RUNS)]),
    ("grid", ("--filter", "rkfdu", "--truth", "least-favourable", "--real", "float32", "--loss", 0.1),
     [(2, *NODES), (3, *NODES), (4, *NODES)]),
    ("large", ("--filter", "rkfdnu2", "--truth", "least-favourable", "--loss", 0.1), [(1, *NODES), (2, *NODES), (3, *NODES, "--threads", 2)]),
    ("grid", ("--filter", "kfd", "--runs", 7, "--steps", 21), [(3, *NODES, "--threads", 2), (3, *RUNS, "--threads", 2), (4, *RUNS)]),
    ("faulty", ("--filter", "kfd", "--monitor", "exclude", "--loss", 0.1, "--runs", 3), [(1, *NODES), (2, *NODES), (3, *NODES, "--threads", 2), (3, *RUNS)]),
    ("large", ("--filter", "kfd", "--monitor", "aime-improved", "--false-alarm", 0.01, "--real", "float32"), [(2, *NODES)]),
    # A centre is not divided: its runs are shared, whatever is asked for.
    ("mixed", ("--filter", "kfc", "--loss", 0.3, "--runs", 5, "--real", "float32"), [(2, *RUNS), (3, *NODES)]),
    ("projectile", ("--filter", "rkfc", "--truth", "least-favourable", "--runs", 2), [(4, *RUNS), (2, *NODES)])])
def test_same_bytes(as_one, name, options, ways):
    as_one(name, options, *ways)


@pytest.mark.parametrize("options,ways", [
    (("--filter", "all", "--runs", 9, "--steps", 150, "--loss", 0.2), [(2, *NODES), (3, *RUNS), (4, *NODES, "--threads", 2)]),
    (("--filter", "all", "--runs", 4, "--steps", 64, "--truth", "least-favourable", "--real", "float32"),
     [(3, *NODES), (2, *RUNS, "--threads", 3)])])
def test_same_figures_of_all_filters(as_one, options, ways):
    """Without a log, sums of many steps wait and are added up together."""
    assert len(as_one("projectile", options, *ways, log=False)["filters"]) == 6


@pytest.mark.parametrize("name,ranks", [("one", 2), ("three", 4), ("complete", 4), ("apart", 4), ("star", 3)])
def test_odd_networks(as_one, name, ranks):
    as_one(name, ("--truth", "least-favourable", "--loss", 0.2, "--runs", 2), (ranks, *NODES), *([(3, *NODES)] if name == "apart" else []))


def test_default_split(mpi, alone, scenario, figures, tmp_path):
    """Runs, if there are enough of them."""
    for runs, split in ((3, "runs"), (2, "nodes")):
        mpi(3, scenario("three"), "--runs", runs, "--json", tmp_path / "got")
        assert json.loads((tmp_path / "got").read_text())["split"] == split
        alone(scenario("three"), "--runs", runs, "--json", tmp_path / "want")
        assert figures(tmp_path / "got") == figures(tmp_path / "want")


def test_standard_output(mpi, alone, scenario):
    """The log of one process, once; the table, once."""
    options = (scenario("three"), "--runs", 4, "--steps", 30)
    got = mpi(3, *options, *RUNS, "--out", "-")
    assert got.out == alone(*options, "--out", "-").stdout and got.err.count(b"filter ") == 1
    got = mpi(3, *options, *NODES)
    assert got.out.count(b"\nrkfdnu2 ") == 1 and b"3 processes share the nodes" in got.out and b" links cut" in got.out and got.err == b""


def test_table_that_does_not_arrive(program, environment, scenario):
    """Also without mpirun: one process by itself."""
    with open("/dev/full", "wb") as full:
        done = subprocess.run([program + "-mpi", "simulate", scenario("three")], stdout=full, stderr=subprocess.PIPE, env=environment, timeout=60)
    assert done.returncode == 1 and done.stderr == b"meshkal: standard output: No space left on device\n"


# --- recorded data -------------------------------------------------------------------------------------------------

@pytest.fixture
def recording(tmp_path):
    y, x = tmp_path / "y.csv", tmp_path / "x.csv"
    y.write_text("t,node,row,value\n" + "".join(f"{t},{k},{r},{(7 * t + 3 * k + r) % 5 - 2}\n" for t in range(30) for k in range(9)
                                               for r in range(1 + (k % 3 == 2)) if (t + k) % 4))
    x.write_text("t,state,value\n" + "".join(f"{t},{i},{t % 3 - 1}\n" for t in range(30) for i in range(2) if t % 7))
    return y, x


def test_recorded_data(as_one, recording):
    as_one("complete", ("--measurements", recording[0], "--truth", recording[1]), (2, *NODES), (4, *NODES), (2, *RUNS))


def test_ranks_with_different_recordings(mpi, scenario, recording, tmp_path):
    y, x = recording
    other = tmp_path / "other.csv"
    other.write_text(y.read_text().replace("\n0,1,0,1\n", "\n0,1,0,1.25\n"))
    assert other.read_text() != y.read_text()
    for mine, theirs in (((y,), (other,)), ((y, "--truth", x), (y,))):
        job = mpi([(1, scenario("complete"), "--measurements", *mine), (1, scenario("complete"), "--measurements", *theirs)], status=2)
        assert len(job.said) == 1 and job.said[0].startswith("meshkal: rank 1: data is "), job.said


@pytest.fixture
def arrivals(tmp_path):
    def call(name, leave_out=()):
        lines = [(t, stage, *link) for t in range(NETWORKS[name]["steps"]) for stage in (1, 2) for a, b in NETWORKS[name]["edges"]
                 for link in ((a, b), (b, a)) if (5 * t + 3 * link[0] + link[1] + stage) % 4]
        path = tmp_path / f"{name}{len(leave_out)}.csv"
        path.write_text("t,stage,from,to\n" + "".join("%d,%d,%d,%d\n" % line for line in lines if line not in leave_out))
        return path, lines
    return call


def test_recorded_arrivals(as_one, arrivals):
    as_one("grid", ("--arrivals", arrivals("grid")[0]), (2, *NODES), (4, *NODES), (2, *RUNS))


def test_recorded_arrivals_in_another_order(as_one, alone, arrivals, scenario):
    path, lines = arrivals("large")
    as_one("large", ("--arrivals", path), (3, *NODES), log=False)
    items = io.BytesIO(alone(scenario("large"), "--arrivals", path, "--out", "-").stdout)
    links = [(node, k) for k, slots in enumerate(cbor2.load(items)["slots"]) for node in slots]
    found = {(t, stage, *link) for t in range(3) for item in [cbor2.load(items)] for stage, key in ((1, "measurements_arrived"), (2, "estimates_arrived"))
             for link, arrived in zip(links, item[key].value) if arrived and link[0] != link[1]}
    assert found == set(lines)


def test_ranks_with_different_arrivals(mpi, scenario, arrivals):
    path, lines = arrivals("complete")
    job = mpi([(1, scenario("complete"), "--arrivals", path), (1, scenario("complete"), "--arrivals", arrivals("complete", lines[:1])[0])], status=2)
    assert len(job.said) == 1 and job.said[0].startswith("meshkal: rank 1: "), job.said


# --- failures: said once, by every rank, and nothing left behind ---------------------------------------------------

SAME = "all processes need the same scenario and options"


@pytest.mark.parametrize("first,second,said", [
    (("three",), ("one",), "rank 1: scenario is "), (("three", "--steps", 12), ("three",), "rank 1: steps is 40, but 12 on rank 0: "),
    (("three", "--filter", "kfd"), ("three", "--filter", "kfc"), "rank 1: filter is kfc, but kfd on rank 0: "),
    (("three", "--real", "float32"), ("three",), "rank 1: real is float64, but float32 on rank 0: "),
    (("three", *RUNS), ("three", *NODES), "rank 1: split is nodes, but runs on rank 0: "),
    (("three", "--threads", 2), ("three", "--threads", 1), "rank 1: threads is 1, but 2 on rank 0: "),
    (("three", "--out", "{}/log"), ("three",), "rank 1: out is 0, but 1 on rank 0: ")])
def test_ranks_that_differ(mpi, scenario, tmp_path, first, second, said):
    def group(name, *options):
        return (1, scenario(name), "--runs", 4, "--json", tmp_path / "json", *(str(o).replace("{}", str(tmp_path)) for o in options))
    job = mpi([group(*first), group(*second)], status=2)
    assert len(job.said) == 1 and job.said[0].startswith("meshkal: " + said) and job.said[0].endswith(SAME), job.err
    assert job.out == b"" and not list(tmp_path.iterdir())


def test_what_one_process_refuses(mpi, alone, scenario, tmp_path):
    """The message of one process, from all ranks or from one, and nothing written."""
    good, cut = scenario("three"), tmp_path / "cut.json"
    cut.write_text(good.read_text()[:300])
    (tmp_path / "kept").write_bytes(b"something else")
    for bad, everywhere in (((cut,), 3), ((cut,), 0), ((tmp_path / "none.json",), 0), ((good, "--loss", 2), 3), ((good, "--filter", "kf"), 0),
                            ((good, "--out", tmp_path / "none" / "log"), 3), ((good, "--resume", tmp_path / "kept"), 2),
                            ((good, "--json", tmp_path / "none" / "json"), 2)):
        want = alone(*bad, status=2).stderr.decode().strip()
        job = mpi(everywhere, *bad, status=2) if everywhere else mpi([(2, good), (1, *bad)], status=2)
        assert job.said == [want] and job.out == b"", job.err
        assert sorted(p.name for p in tmp_path.iterdir()) == ["cut.json", "kept"]


def test_words_of_its_own(launch, wait, scenario):
    for words, status, said in (((), 2, b"mpirun -n K meshkal-mpi simulate"), (("--help",), 0, b"--split runs|nodes"), (("design", "x"), 2, b"unknown command design"),
                                (("simulate", scenario("three"), "--split", "rows"), 2, b"--split rows: must be nodes or runs")):
        job = wait(launch(2, *words))
        assert job.returncode == status and (job.out + job.err).count(said) == 1, job.err


@pytest.mark.parametrize("options", [("--filter", "kfd"), ("--filter", "kfd", "--real", "float32", "--runs", 4), ("--filter", "kfc")])
def test_a_node_that_fails(alone, mpi, tmp_path, options):
    """Many nodes fail in the same step, in all parts: the one that is named is the one that one process names."""
    path = tmp_path / "grow.json"
    # Nobody measures what grows, but for three neighbours of a distributed filter.
    C = [[1.0, 0.0]], [[0.0, 1.0]] if "kfd" in options else [[1.0, 0.0]]
    path.write_text(json.dumps(network(20, ring(20), C=lambda k: C[k == 13], A=((0.9, 0.0), (0.0, 2.0)), tolerance=0.0)))
    for log in ((), ("--out", tmp_path / "log")):
        command = (path, "--steps", 900, *options, "--json", tmp_path / "json", *log)
        want, data = alone(*command, status=1).stderr.decode().strip(), log and log[1].read_bytes()
        assert "MK_ERROR_NOT_POSITIVE_DEFINITE" in want, want
        for ranks, split in ((2, NODES), (3, NODES), (2, RUNS)) if log else ((3, NODES), (4, NODES)):
            job = mpi(ranks, *command, *split, status=1)
            assert job.said == [want] and not (tmp_path / "json").exists(), (ranks, split)
            assert not log or log[1].read_bytes() == data


@pytest.mark.parametrize("nodes,seeing", [*((24, k) for k in range(1, 12, 2)), (4100, 2000)])
def test_first_of_the_nodes_that_fail(alone, mpi, tmp_path, nodes, seeing):
    """Wherever it is in its part: among the inner nodes, or at the border of another part; and in whatever order they are worked on."""
    path = tmp_path / "grow.json"
    path.write_text(json.dumps(network(nodes, ring(nodes), C=lambda k: [[0.0, float(k < seeing)]], A=((0.9, 0.0), (0.0, 2.0)), tolerance=0.0)))
    options = (path, "--steps", 100, "--real", "float32", "--filter", "kfd")
    want = alone(*options, status=1).stderr.decode().strip()
    assert f"step 63, node {seeing + 1}: " in want, want
    assert alone(*options, "--threads", 3, status=1).stderr.decode().strip() == want
    assert mpi(3, *options, *NODES, status=1).said == [want]


def test_start_that_fails(alone, mpi, tmp_path):
    """In float32 the prior is singular: at every node, of which one process names the first."""
    path = tmp_path / "prior.json"
    s = network(12, ring(12), tolerance=0.0)
    s["model"]["P0"] = [[1.0, 1.0 - 1e-9], [1.0 - 1e-9, 1.0]]
    path.write_text(json.dumps(s))
    want = alone(path, "--real", "float32", "--filter", "kfd", status=1).stderr.decode().strip()
    assert "step 0, node 0: " in want
    assert mpi(3, path, "--real", "float32", "--filter", "kfd", *NODES, status=1).said == [want]


@pytest.mark.parametrize("nodes,odd", [(12, (4, 8)), (12, (3, 9)), (4200, (100, 4190))])
def test_tolerances_that_cannot_be_computed(alone, mpi, tmp_path, nodes, odd):
    """Numbers out of all proportion: who hears an odd node has none, in several parts. The lowest is named."""
    path = tmp_path / "odd.json"
    C, R = {0: [[1e150, 0.0]]} | {k: [[1.0, 1e-9]] for k in odd}, {0: 100.0} | {k: 3.8e-20 for k in odd}
    s = network(nodes, ring(nodes), C=lambda k: C.get(k, [[1.0, 0.0]]), A=((1.19, 0.0), (0.0, -0.31)), tolerance=0.003, steps=10)
    for k in range(nodes):
        s["nodes"][k]["R"] = [[R.get(k, 1e12)]]
    s["model"] |= {"Q": [[9e-118, 0.0], [0.0, 1e-128]], "P0": [[1.3e119, 0.0], [0.0, 3.3e109]]}
    path.write_text(json.dumps(s))
    want = alone(path, "--filter", "rkfdnu", status=2).stderr.decode().strip()
    assert want == f"meshkal: the local tolerance of node {odd[0] - 1} cannot be computed in step 0"
    for ranks in (2, 3, 4):
        assert mpi(ranks, path, "--filter", "rkfdnu", *NODES, status=2).said == [want], ranks
