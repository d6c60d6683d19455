# SPDX-License-Identifier: MIT
"""What a broken scenario says: the file, the line and the key, in words that tell what to mend. Each case changes one place of a
good scenario; the schema has to refuse those that a schema can express, and no others."""
import json
import math
import pathlib

import jsonschema
import pytest

SCHEMA = pathlib.Path(__file__).resolve().parents[2] / "port" / "host" / "scenario.schema.json"

GOOD = """{
  "name": "small",
  "model": {
    "A": [[0.9, 0.1], [0.0, 0.8]],
    "Q": [[0.1, 0.05], [0.05, 0.2]],
    "input": [0.0, 0.1],
    "x0": [1.0, 2.0],
    "P0": [[1.0, 0.1], [0.1, 1.0]],
    "dt_s": 0.5,
    "position_states": [0, 1]
  },
  "nodes": [
    {
      "C": [[1.0, 0.0]],
      "R": [[0.5]],
      "position_m": [0.0, 0.0]
    },
    {
      "C": [
        [1.0, 0.0],
        [0.0, 1.0]
      ],
      "R": [
        [0.5, 0.1],
        [0.1, 0.4]
      ],
      "position_m": [1.0, 0.0, 2.0]
    },
    {
      "C": [[1.0, 1.0]],
      "R": [[0.3]]
    }
  ],
  "edges": [
    [0, 1],
    [1, 2]
  ],
  "weights": [
    [0.6, 0.4, 0.0],
    [0.4, 0.2, 0.4],
    [0.0, 0.4, 0.6]
  ],
  "tolerance": 0.02,
  "steps": 20,
  "seed": 4
}
"""
TOP = "name, model, nodes, edges, weights, tolerance, steps, seed, faults, monitor"
WEIGHTS = GOOD[GOOD.index('"weights"'):GOOD.index('"tolerance"')]
PAIR = "must be two node numbers from 0 to 2"

# (old text, new text with @ before what is on the line to be named, key to be named, message, does the schema refuse it too)
BROKEN = [
    # keys
    ('"name"', '@"title"', "title", f"unknown key; known are {TOP}", True),
    ('"dt_s"', '@"dt"', "model.dt", "unknown key; known are A, Q, input, x0, P0, dt_s, position_states", True),
    ('"position_m": [1.0', '@"position": [1.0', "nodes[1].position", "unknown key; known are C, R, position_m", True),
    ('{\n  "name"', '@{\n  "name"', "", 'key "model" is missing', True, '"model": {', '"nodes"', '"nodes"'),
    ('"model": {\n    "A": [[0.9, 0.1], [0.0, 0.8]],', '@"model": {', "model", 'key "A" is missing', True),
    ('"model": {\n    "A": [[0.9, 0.1], [0.0, 0.8]],\n    "Q": [[0.1, 0.05], [0.05, 0.2]],',
     '@"model": {\n    "A": [[0.9, 0.1], [0.0, 0.8]],', "model", 'key "Q" is missing', True),
    ('{\n      "C": [[1.0, 1.0]],', "@{", "nodes[2]", 'key "C" is missing', True),
    ('{\n      "C": [[1.0, 1.0]],\n      "R": [[0.3]]', '@{\n      "C": [[1.0, 1.0]]', "nodes[2]", 'key "R" is missing', True),
    ('{\n  "name": "small",', "@{", "", 'key "nodes" is missing', True, '"nodes": [', '"edges"', '"edges"'),
    ('{\n  "name": "small",', "@{", "", 'key "edges" is missing', True, '"edges": [', '"weights"', '"weights"'),
    # kinds of values
    ('"small"', "@7", "name", "must be a string", True),
    ('"model": {', '@"model": [{', "model", "must be an object", True, '"dt_s"', "  \"nodes\"", '"dt_s": 1}], "nodes"'),
    ("[[0.9, 0.1], [0.0, 0.8]]", "@0.9", "model.A", "must be an array of rows", True),
    ("[[0.9, 0.1], [0.0, 0.8]]", "@[]", "model.A", "must be an array of rows", True),
    ("[[0.9, 0.1], [0.0, 0.8]]", "@" + json.dumps([[0.0] * 65] * 65), "model.A", "has 65 rows; at most 64 states", False),
    ("[[0.9, 0.1], [0.0, 0.8]]", "@[[0.9, 0.1], 0.0]", "model.A[1]", "must be an array of 2 numbers", True),
    ("[[0.9, 0.1], [0.0, 0.8]]", "@[[0.9, 0.1], [0.0]]", "model.A[1]", "has 1 entries, not 2", False),
    ("[[0.9, 0.1], [0.0, 0.8]]", "@[[0.9, 0.1, 0.0], [0.0, 0.8, 0.0]]", "model.A[0]", "has 3 entries, not 2", False),
    ("0.9, 0.1", '@0.9, "0.1"', "model.A[0][1]", "must be a number", True),
    ("0.9, 0.1", "@0.9, null", "model.A[0][1]", "must be a number", True),
    ("[[0.1, 0.05], [0.05, 0.2]]", "@[[0.1, 0.05]]", "model.Q", "must be an array of 2 rows of 2 numbers", False),
    ("[0.0, 0.1],\n", "@[0.0, 0.1, 0.2],\n", "model.input", "has 3 entries, not 2", False),
    ("[0.0, 0.1],\n", "@0.1,\n", "model.input", "must be an array of 2 numbers", True),
    ("[1.0, 2.0]", "@[1.0]", "model.x0", "has 1 entries, not 2", False),
    ("[1.0, 2.0]", "@[1.0, true]", "model.x0[1]", "must be a number", True),
    ("0.5,\n    \"pos", "@0,\n    \"pos", "model.dt_s", "must be a number of seconds above 0", True),
    ("0.5,\n    \"pos", "@\"1 s\",\n    \"pos", "model.dt_s", "must be a number of seconds above 0", True),
    ("[0, 1]\n  },", "@[]\n  },", "model.position_states", "must be an array of 1 to 3 state numbers", True),
    ("[0, 1]\n  },", "@[0, 1, 0, 1]\n  },", "model.position_states", "must be an array of 1 to 3 state numbers", True),
    ("[0, 1]\n  },", "@[0, 2]\n  },", "model.position_states", "entry 1 must be a state number from 0 to 1", False),
    ("[0, 1]\n  },", "@[0.5, 1]\n  },", "model.position_states", "entry 0 must be a state number from 0 to 1", True),
    ("[0, 1]\n  },", "@[-1, 1]\n  },", "model.position_states", "entry 0 must be a state number from 0 to 1", True),
    ('"nodes": [', '@"nodes": [', "nodes", "must be an array with at least one node", True, '\n    {', "\n  ],\n", "],\n"),
    ('[[1.0, 1.0]],', "@[],", "nodes[2].C", "must be an array of rows", True),
    ('[[1.0, 1.0]],', "@" + json.dumps([[1.0, 0.0]] * 65) + ",", "nodes[2].C", "has 65 rows; at most 64", False),
    ("[0.0, 1.0]\n", "@[0.0, 1.0, 0.0]\n", "nodes[1].C[1]", "has 3 entries, not 2", False),
    ("[[0.3]]", "@[[0.3, 0.0], [0.0, 0.3]]", "nodes[2].R", "must be an array of 1 rows of 1 numbers", False),
    ("[[0.3]]", "@0.3", "nodes[2].R", "must be an array of 1 rows of 1 numbers", True),
    ("[1.0, 0.0, 2.0]", "@[1.0]", "nodes[1].position_m", "must be 2 or 3 numbers", True),
    ("[1.0, 0.0, 2.0]", '@[1.0, "north"]', "nodes[1].position_m[1]", "must be a number", True),
    # covariances
    ("[[0.1, 0.05], [0.05, 0.2]]", "@[[0.1, 0.05], [0.06, 0.2]]", "model.Q", "is not symmetric: entries [1][0] and [0][1] differ", False),
    ("[[0.1, 0.05], [0.05, 0.2]]", "@[[0.1, 0.2], [0.2, 0.1]]", "model.Q", "is not positive semidefinite: smallest eigenvalue -0.1", False),
    ("[[0.1, 0.05], [0.05, 0.2]]", "@[[-0.1, 0.0], [0.0, -0.1]]", "model.Q", "is not positive semidefinite: smallest eigenvalue -0.1", False),
    ("[[1.0, 0.1], [0.1, 1.0]]", "@[[1.0, 1.0], [1.0, 1.0]]", "model.P0", "is not positive definite: smallest eigenvalue ", False),
    ("[[1.0, 0.1], [0.1, 1.0]]", "@[[1.0, 0.1], [-0.1, 1.0]]", "model.P0", "is not symmetric", False),
    ("[[0.3]]", "@[[0.0]]", "nodes[2].R", "is not positive definite: smallest eigenvalue 0", False),
    ("[[0.3]]", "@[[-0.3]]", "nodes[2].R", "is not positive definite: smallest eigenvalue -0.3", False),
    ('"R": [\n        [0.5, 0.1],', '@"R": [\n        [0.5, 0.11],', "nodes[1].R", "is not symmetric: entries [1][0] and [0][1] differ", False),
    # edges
    ('[\n    [0, 1],\n    [1, 2]\n  ]', '@{}', "edges", "must be an array of pairs of node numbers", True),
    ("[1, 2]", "@[2, 2]", "edges[1]", "joins node 2 to itself", False),
    ("[1, 2]", "[1, 2],\n    @[2, 1]", "edges[2]", "repeats the edge between nodes 1 and 2", False),
    ("[0, 1],\n    [1, 2]", "[0, 1],\n    [1, 2],\n    [2, 0],\n    @[0, 1]", "edges[3]", "repeats the edge between nodes 0 and 1", False),
    ("[1, 2]", "@[1, 3]", "edges[1]", PAIR, False),
    ("[1, 2]", "@[-1, 2]", "edges[1]", PAIR, True),
    ("[1, 2]", "@[1, 2, 0]", "edges[1]", PAIR, True),
    ("[1, 2]", "@[1]", "edges[1]", PAIR, True),
    ("[1, 2]", "@[1.5, 2]", "edges[1]", PAIR, True),
    ("[1, 2]", "@12", "edges[1]", PAIR, True),
    # weights
    (WEIGHTS, '@"weights": "equal",\n', "weights", 'must be "relative-degree", "metropolis", "uniform" or a matrix', True),
    (WEIGHTS, '@"weights": null,\n', "weights", 'must be "relative-degree", "metropolis", "uniform" or a matrix', True),
    (WEIGHTS, '@"weights": [[1.0]],\n', "weights", "must be an array of 3 rows of 3 numbers", False),
    ("[0.4, 0.2, 0.4]", "@[0.4, 0.2]", "weights[1]", "has 2 entries, not 3", False),
    ("[0.6, 0.4, 0.0]", "@[0.6, 0.4, 0.1]", "weights[0][2]", "must be 0: nodes 0 and 2 are not neighbours", False),
    ("[0.0, 0.4, 0.6]", "@[0.0, -0.4, 0.6]", "weights[2][1]", "is negative", False),
    ('"weights": [\n    [0.6, 0.4', '@"weights": [\n    [0.6, 0.3', "weights", "column 1 sums to 0.9, not to 1 (weights[l][k] goes from l to k)", False),
    # the rest
    ("0.02", "@-0.02", "tolerance", "must be a number, 0 or above", True),
    ("0.02", '@"0.02"', "tolerance", "must be a number, 0 or above", True),
    ('"steps": 20', '@"steps": 0', "steps", "must be an integer from 1 to 1e9", True),
    ('"steps": 20', '@"steps": 20.5', "steps", "must be an integer from 1 to 1e9", True),
    ('"steps": 20', '@"steps": 1000000001', "steps", "must be an integer from 1 to 1e9", True),
    ('"seed": 4', '@"seed": -1', "seed", "must be an integer, 0 or above", True),
    ('"seed": 4', '@"seed": "4"', "seed", "must be an integer, 0 or above", True),
    # faults and monitors
    ('"seed": 4', '@"faults": {}', "faults", "must be an array of faults", True),
    ('"seed": 4', '"faults": [\n@3]', "faults[0]", "must be an object", True),
    ('"seed": 4', '"faults": [\n@{"node": 1, "rate": 1}]', "faults[0]", 'key "from_s" is missing', True),
    ('"seed": 4', '"faults": [\n@{"from_s": 1, "rate": 1}]', "faults[0]", 'key "node" is missing', True),
    ('"seed": 4', '"faults": [{"node": 1, "from_s": 1, "rate": 1}, {"node": 1, "from_s": 1,\n@"rates": 1}]', "faults[1].rates",
     "unknown key; known are node, row, from_s, to_s, rate, step", True),
    ('"seed": 4', '"faults": [{\n@"node": 3, "from_s": 1, "rate": 1}]', "faults[0].node", "must be an integer from 0 to 2", False),
    ('"seed": 4', '"faults": [{"node": 2,\n@"row": 1, "from_s": 1, "rate": 1}]', "faults[0].row", "must be an integer from 0 to 0", False),
    ('"seed": 4', '"faults": [{"node": 2,\n@"row": -1, "from_s": 1, "rate": 1}]', "faults[0].row", "must be an integer from 0 to 0", True),
    ('"seed": 4', '"faults": [{"node": 2,\n@"from_s": "1", "rate": 1}]', "faults[0].from_s", "must be a number of seconds", True),
    ('"seed": 4', '"faults": [{"node": 2, "from_s": 1,\n@"to_s": 1, "rate": 1}]', "faults[0].to_s", "must be after from_s, 1", False),
    ('"seed": 4', '"faults": [{"node": 2, "from_s": 1,\n@"rate": null}]', "faults[0].rate", "must be a number, in the unit of the row a second", True),
    ('"seed": 4', '"faults": [{"node": 2, "from_s": 1,\n@"step": []}]', "faults[0].step", "must be a number, in the unit of the row", True),
    ('"seed": 4', '"faults": [\n@{"node": 2, "from_s": 1}]', "faults[0]", "adds nothing: give rate or step, other than 0", True),
    ('"seed": 4', '"faults": [\n@{"node": 2, "from_s": 1, "step": 0}]', "faults[0]", "adds nothing: give rate or step, other than 0", False),
    ('"seed": 4', '@"monitor": "aime"', "monitor", "must be an object", True),
    ('"seed": 4', '"monitor": {\n@"scheme": "aime"}', "monitor.scheme",
     "unknown key; known are window, false_alarm, jump, evidence, level, slope, separation, most", True),
    ('"seed": 4', '"monitor": {\n@"window": 0}', "monitor.window", "must be an integer from 1 to 4096", True),
    ('"seed": 4', '"monitor": {\n@"window": 2.5}', "monitor.window", "must be an integer from 1 to 4096", True),
    ('"seed": 4', '"monitor": {\n@"false_alarm": 0}', "monitor.false_alarm", "must be a probability, above 0 and below 1", True),
    ('"seed": 4', '"monitor": {\n@"false_alarm": 1}', "monitor.false_alarm", "must be a probability, above 0 and below 1", True),
    ('"seed": 4', '"monitor": {\n@"jump": 0}', "monitor.jump", "must be a number above 0", True),
    ('"seed": 4', '"monitor": {\n@"evidence": -1}', "monitor.evidence", "must be a log likelihood ratio above 0", True),
    ('"seed": 4', '"monitor": {\n@"level": -1}', "monitor.level", "must be a variance, 0 or above", True),
    ('"seed": 4', '"monitor": {\n@"slope": -1}', "monitor.slope", "must be a variance, 0 or above", True),
    ('"seed": 4', '"monitor": {\n@"separation": -1}', "monitor.separation", "must be a number, 0 or above", True),
    ('"seed": 4', '"monitor": {\n@"most": 33}', "monitor.most", "must be an integer from 1 to 32", True),
]


def broken_text(old, new, *cut):
    """The scenario with one change, and the line that @ marks. `cut`: begin and end of what goes as well, and what comes instead."""
    assert GOOD.count(old) == 1, f"{old!r} is not one place"
    text = GOOD.replace(old, new)
    if cut:
        begin, end, instead = cut
        start = text.index(begin)
        text = text[:start] + instead + text[text.index(end, start) + len(end):]
    line = text[:text.index("@")].count("\n") + 1
    return text.replace("@", ""), line


@pytest.fixture(scope="module")
def validator():
    schema = json.loads(SCHEMA.read_text())
    jsonschema.Draft202012Validator.check_schema(schema)
    return jsonschema.Draft202012Validator(schema)


def by_both(refused, folder, path):
    """The same line from design and simulate, whatever output they were asked for."""
    first = refused(folder, "design", path, "--json", "{}/a.json", "--c-header", "{}/headers", "--per-step", 3)
    second = refused(folder, "simulate", path, "--out", "{}/a.cbor", "--json", "{}/b.json")
    assert first == second == refused(folder, "simulate", path, "--filter", "kfc", "--out", "-")
    return first


@pytest.mark.parametrize("case", BROKEN, ids=[f"{i}-{c[2]:.24}" for i, c in enumerate(BROKEN)])
def test_broken_scenario(refused, validator, tmp_path, case):
    old, new, key, message, by_schema, *cut = case
    text, line = broken_text(old, new, *cut)
    path = tmp_path / "broken.json"
    path.write_text(text)
    said = by_both(refused, tmp_path, path)
    wanted = f"{path}:{line}: {key}" + (": " if key else "")
    assert said.startswith(wanted), f"\nsaid   {said}\nwanted {wanted}"
    assert message in said
    assert validator.is_valid(json.loads(text)) == (not by_schema)


@pytest.mark.parametrize("old,new", [('"name"', '"a.b"'), ('"name"', '"model.x"'), ('"dt_s"', '"A[0]"'), ('"dt_s"', '"x]"'), ('"name"', '""'),
                                     ('"name"', '"' + "k" * 300 + '"'), ('"dt_s"', '"\\u0041\\u0041"'), ('"dt_s"', '"\\\\"')])
def test_line_of_odd_keys(refused, tmp_path, old, new):
    """A key may hold the signs that paths are written with. The line is right all the same, and the key can be recognised."""
    text, line = broken_text(old, "@" + new)
    path = tmp_path / "broken.json"
    path.write_text(text)
    said = by_both(refused, tmp_path, path)
    assert said.startswith(f"{path}:{line}: ") and "unknown key" in said, said
    assert json.loads(new)[:40] in said


# Text, with @ before the line that jansson gives up on (it tells lines of syntax errors, not keys), and words of the message.
SYNTAX = [
    ("@", "expected"),
    ("   \n\n@", "expected"),
    ("@nonsense", "expected near 'nonsense'"),
    ("@[]", "must be an object"),
    (GOOD[:-3] + "@", "'}' expected near end of file"),
    (GOOD.replace('"small",', '"small"').replace('"model"', '@"model"'), "'}' expected near '\"model\"'"),
    (GOOD.replace("[1, 2]\n  ]", "[1, 2],\n  @]"), "near ']'"),
    (GOOD + "@{}", "end of file expected"),
    (GOOD.replace("0.02", "@NaN"), "near 'NaN'"),
    (GOOD.replace("0.02", "@Infinity"), "near 'Infinity'"),
    (GOOD.replace("0.02", "@-Infinity"), "near '-'"),
    (GOOD.replace("0.02", "@1e999"), "real number overflow near '1e999'"),
    (GOOD.replace("20,", "@9223372036854775808,"), "too big integer near '9223372036854775808'"),
    (GOOD.replace("0.02", "@0x10"), "near 'x"),
    (GOOD.replace("0.02", "@02"), "invalid token near '0'"),
    (GOOD.replace('"steps": 20,\n  "seed"', '"seed": 20,\n  @"seed"'), "duplicate object key near '\"seed\"'"),
    (GOOD.replace('"dt_s": 0.5', '@"Q": [[1, 0], [0, 1]]'), "duplicate object key near '\"Q\"'"),
    (GOOD.replace("small", "@sm\tall"), "control character 0x9"),
    (GOOD.replace("small", "@sm\\u0000all"), "\\u0000"),
    (GOOD.replace("0.02", "@0.02 // comment"), "near '/'"),
    ("@" + "[" * 3000, "maximum parsing depth reached"),
    (b"@\xff\xfe{}", "unable to decode byte 0xff"),
    (GOOD.encode().replace(b"small", b"@sm\xc3all"), "unable to decode byte 0xc3"),
    (b"\x00\x01\x02\xff", "a zero byte: not a JSON text"),
    (GOOD.encode() + b"\0", "a zero byte: not a JSON text"),
]


@pytest.mark.parametrize("text,words", SYNTAX, ids=range(len(SYNTAX)))
def test_syntax(refused, tmp_path, text, words):
    text = text if isinstance(text, bytes) else text.encode()
    place = f":{text[:text.index(b'@')].count(10) + 1}:" if b"@" in text else ":"
    path = tmp_path / "broken.json"
    path.write_bytes(text.replace(b"@", b""))
    said = by_both(refused, tmp_path, path)
    assert said.startswith(f"{path}{place}") and words in said, said


def test_no_scenario(refused, tmp_path):
    assert by_both(refused, tmp_path, tmp_path / "none.json") == f"{tmp_path}/none.json: No such file or directory"
    assert by_both(refused, tmp_path, tmp_path) == f"{tmp_path}: Is a directory"


# --- what is not broken --------------------------------------------------------------------------------------------

SMALLEST = {"model": {"A": [[0.5]], "Q": [[1]]}, "nodes": [{"C": [[1]], "R": [[1]]}], "edges": []}
ACCEPTED = {
    "good": json.loads(GOOD),
    "smallest": SMALLEST,
    "names": SMALLEST | {"name": "ä \u2603 \" \\ \n"},
    "largest numbers": SMALLEST | {"seed": 2**63 - 1, "steps": 10**9, "tolerance": 0},
    "no process noise": SMALLEST | {"model": {"A": [[0.5]], "Q": [[0]]}},
    "rounded covariance": SMALLEST | {"model": {"A": [[1, 0], [0, 1]], "Q": [[1, 0.1], [0.1 + 1e-17, 1]]}, "nodes": [{"C": [[1, 0]], "R": [[1]]}]},
    "64 states": {"model": {"A": [[0.0] * 64] * 64, "Q": [[float(i == j) for j in range(64)] for i in range(64)]},
                  "nodes": [{"C": [[1.0] * 64], "R": [[1]]}], "edges": []},
}
for rule in ("relative-degree", "metropolis", "uniform"):
    ACCEPTED[rule] = json.loads(GOOD) | {"weights": rule}


@pytest.mark.parametrize("name", ACCEPTED)
def test_accepted(run, validator, tmp_path, name):
    validator.validate(ACCEPTED[name])
    path = tmp_path / "good.json"
    path.write_text(json.dumps(ACCEPTED[name]))
    run("simulate", path, "--filter", "kfd", "--steps", 3)


def test_generated_scenarios_fit_the_schema(run, validator):
    for nodes in (2, 20, 300):
        validator.validate(json.loads(run("scenario", "projectile", "--nodes", nodes).stdout))


def test_weight_rules(run, tmp_path):
    """The named rules are the matrices of the literature: the same bits in a run as that matrix, up to its own rounding."""
    base, degree, near = json.loads(GOOD), [2, 3, 2], [[0, 1], [0, 1, 2], [1, 2]]
    matrix = {rule: [[0.0] * 3 for _ in range(3)] for rule in ("relative-degree", "metropolis", "uniform")}
    for k in range(3):
        for l in near[k]:
            matrix["relative-degree"][l][k] = degree[l] / sum(degree[j] for j in near[k])
            matrix["uniform"][l][k] = 1 / degree[k]
            matrix["metropolis"][l][k] = 1 / max(degree[l], degree[k]) if l != k else 0.0
        matrix["metropolis"][k][k] = 1 - math.fsum(matrix["metropolis"][l][k] for l in near[k])
    seen = {}
    for rule, full in matrix.items():
        msd = []
        for weights in (rule, full):
            (tmp_path / "w.json").write_text(json.dumps(base | {"weights": weights}))
            run("simulate", tmp_path / "w.json", "--json", tmp_path / "out.json")
            msd.append(json.loads((tmp_path / "out.json").read_text())["filters"][0]["node_msd"])
        assert msd[0] == pytest.approx(msd[1], rel=1e-12)
        seen[rule] = msd[0]
    assert seen["uniform"] != pytest.approx(seen["relative-degree"], rel=1e-6) != pytest.approx(seen["metropolis"], rel=1e-6)
