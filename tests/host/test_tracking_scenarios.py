# SPDX-License-Identifier: MIT
"""Tracking scenarios: what is wrong is named by file, line and key, and the schema agrees; the ready ones are right."""
import copy
import json
import pathlib
import re

import jsonschema
import pytest

ROOT = pathlib.Path(__file__).resolve().parents[2]
SCHEMA = jsonschema.Draft202012Validator(json.loads((ROOT / "port" / "host" / "scenario.schema.json").read_text()))


def diagonal(*values):
    return [[value if i == j else 0.0 for j in range(len(values))] for i, value in enumerate(values)]


# Every key of the schema but those of own models and Q.
RIGHT = {
    "name": "all keys",
    "model": {"motion": "constant-turn", "states": ["px", "vx", "py", "vy", "omega", "bias"], "dt_s": 0.5, "acceleration_psd": [0.01, 0.02],
              "turn_rate_psd": 0.001, "x0": [1.0, 2.0, 3.0, 4.0, 0.1, 0.0], "P0": diagonal(1.0, 1.0, 1.0, 1.0, 0.1, 1.0), "start": "truth", "start_s": 2.5},
    "nodes": [{"sensor": "range", "position_m": [0.0, 50.0], "R": [[0.1]], "range_limit_m": 90.0, "loss": 0.1, "fault": {"probability": 0.1, "sigma": 2.0}},
              {"sensor": "tdoa", "position_m": [0.0, 0.0], "reference_m": [100.0, 0.0], "R": [[0.1]]},
              {"sensor": "range-bearing", "position_m": [-50.0, 0.0], "R": diagonal(0.1, 0.01), "fault": {"probability": 0.1, "sigma": [2.0, 0.1]}},
              {"sensor": "bearing", "position_m": [0.0, -50.0], "R": [[0.01]]}, {"sensor": "range-rate", "position_m": [-5.0, -50.0], "R": [[0.01]]},
              {"sensor": "none", "position_m": [5.0, 5.0]}, {"sensor": "none"}],
    "edges": [[0, 1], [1, 2], [2, 3]], "weights": "metropolis", "tolerance": 0.1, "steps": 30, "seed": 4, "reading_loss": 0.05,
    "tracking": {"transform": {"kind": "scaled", "kappa": 0.0, "alpha": 0.9, "beta": 2.0}, "increments": 20, "rule": "mahalanobis",
                 "gate": {"significance": 1e-3, "sensor": True, "stacked": False, "policy": "inflate", "patience": 5, "filters": ["ukf", "duif"]},
                 "consensus": {"protocol": "ratio", "iterations": 7, "information": "paper"}},
}


def steps_of(key):
    """"nodes[2].R" -> ["nodes", 2, "R"]"""
    return [int(a) if a else b for a, b in re.findall(r"\[(\d+)\]|([^.\[\]]+)", key)]


def change(settings, key, value):
    """A copy with another value at the key; `...` removes it."""
    settings = copy.deepcopy(settings)
    *way, last = steps_of(key)
    place = settings
    for step in way:
        place = place[step]
    if value is ...:
        del place[last]
    else:
        place[last] = value
    return settings


def line_of(settings, key):
    """Where the value at the key stands in the indented text: found by a mark put there."""
    way = steps_of(key)
    text = json.dumps(change(settings, key, "@@@@"), indent=1) if way else "@@@@"
    return 1 + text[:text.index('"@@@@"' if way else "@")].count("\n")


NO_MOTION = 'model.motion: must be "constant-velocity", "constant-turn" or "plugin"'
# Key; wrong value; message, which begins with the key that is to be named; does the schema refuse it, too?
WRONG = [
    ("model.motion", "random-walk", NO_MOTION, True), ("model.motion", 3, NO_MOTION, True), ("model.motion", "plugin", 'model: key "name" is missing', True),
    ("model.A", [[1.0]], "model.A: unknown key; known are motion, name, parameters, states", True),
    ("model.name", "car", "model.name: is for own models only", True), ("model.parameters", [1], "model.parameters: is for own models only", True),
    ("model.states", ..., 'model: key "states" is missing', True), ("model.states", [], "model.states: must be an array of 1 to 64 names", True),
    ("model.states", "px", "model.states: must be an array", True), ("model.states", [f"s{i}" for i in range(65)], "model.states: must be an array", True),
    ("model.states[5]", "vx", "model.states[5]: is vx again, as entry 1", True), ("model.states[5]", "", "model.states[5]: must be a name", True),
    ("model.states[5]", 7, "model.states[5]: must be a name", True), ("model.states[2]", "y", "model.states: a position needs px and py", False),
    ("model.states[3]", "y", "model.states: constant-turn needs vy", False), ("model.states[4]", "w", "model.states: constant-turn needs omega", False),
    ("model.states[5]", "pz", "model.states: constant-turn needs vz", False), ("model.states[5]", "vz", "model.states: name vz without pz", False),
    ("model.states", ["a", "b"], "model.states: constant-turn needs px, py, vx and vy", False),
    ("model.dt_s", 0, "model.dt_s: must be a number of seconds above 0", True), ("model.dt_s", "1", "model.dt_s: must be a number of seconds", True),
    ("model.acceleration_psd", ..., "model: key \"acceleration_psd\" or \"Q\" is missing", True),
    ("model.acceleration_psd", -1, "model.acceleration_psd: must be a number, 0 or above", True),
    ("model.acceleration_psd", [1.0], "model.acceleration_psd: has 1 entries, not 2", True),
    ("model.acceleration_psd", [1.0, -2.0], "model.acceleration_psd: entry 1 must be a number, 0 or above", True),
    ("model.dt_s", 1e200, "model.acceleration_psd: makes noise beyond all numbers", False),
    ("model.turn_rate_psd", -1, "model.turn_rate_psd: must be a number, 0 or above", True),
    ("model.Q", diagonal(*[1.0] * 6), "model.acceleration_psd: is Q already: give one of them", True),
    ("model.x0", ..., 'model: key "x0" is missing', True), ("model.x0", [1.0], "model.x0: has 1 entries, not 6", False),
    ("model.P0", ..., 'model: key "P0" is missing', True), ("model.P0", diagonal(1, 1, 1, 1, 1, 0), "model.P0: is not positive definite", False),
    ("model.start", "random", 'model.start: must be "truth" or "estimate"', True), ("model.start_s", "now", "model.start_s: must be a number of seconds", True),
    ("nodes[0].sensor", "sonar", 'nodes[0].sensor: must be "none", "range", "bearing", "range-bearing", "range-rate", "tdoa" or "plugin"', True),
    ("nodes[0].sensor", ..., 'nodes[0]: key "sensor" is missing', True), ("nodes[0].C", [[1.0]], "nodes[0].C: unknown key", True),
    ("nodes[0].position_m", ..., 'nodes[0]: key "position_m" is missing', True), ("nodes[0].position_m", [1.0], "nodes[0].position_m: must be 2 numbers", True),
    ("nodes[0].position_m", [1.0, 2.0, 3.0], "nodes[0].position_m: must be 2 numbers, as the states have", False),
    ("nodes[0].R", ..., 'nodes[0]: key "R" is missing', True), ("nodes[0].R", diagonal(1.0, 1.0), "nodes[0].R: must be an array of 1 rows", False),
    ("nodes[2].R", [[1.0]], "nodes[2].R: must be an array of 2 rows", False), ("nodes[3].R", [[0.0]], "nodes[3].R: is not positive definite", False),
    ("nodes[0].range_limit_m", 0, "nodes[0].range_limit_m: must be a number of metres above 0", True),
    ("nodes[0].loss", 1.5, "nodes[0].loss: must be a probability, from 0 to 1", True), ("nodes[0].loss", "0", "nodes[0].loss: must be a probability", True),
    ("nodes[0].fault", 0.1, "nodes[0].fault: must be an object", True), ("nodes[0].fault.sigma", ..., 'nodes[0].fault: key "sigma" is missing', True),
    ("nodes[0].fault.probability", ..., 'nodes[0].fault: key "probability" is missing', True),
    ("nodes[0].fault.probability", -0.1, "nodes[0].fault.probability: must be a probability", True),
    ("nodes[0].fault.sigma", 0, "nodes[0].fault.sigma: must be a number above 0", True), ("nodes[0].fault.mean", 1, "nodes[0].fault.mean: unknown key", True),
    ("nodes[2].fault.sigma", [1.0], "nodes[2].fault.sigma: has 1 entries, not 2", False),
    ("nodes[2].fault.sigma[1]", -1.0, "nodes[2].fault.sigma: entry 1 is negative", True),
    ("nodes[1].reference_m", ..., 'nodes[1]: key "reference_m" is missing', True),
    ("nodes[1].reference_m", [0.0, 0.0], "nodes[1].reference_m: is position_m itself", False),
    ("nodes[0].reference_m", [1.0, 1.0], "nodes[0].reference_m: is for tdoa and own models only", True),
    ("nodes[5].R", [[1.0]], "nodes[5].R: unknown key; known are sensor, position_m", True), ("nodes[5].loss", 0.1, "nodes[5].loss: unknown key", True),
    ("nodes[0].name", "x", "nodes[0].name: is for own models only", True), ("nodes[3].sensor", "plugin", 'nodes[3]: key "name" is missing', True),
    ("edges[1]", [1, 9], "edges[1]: must be two node numbers from 0 to 6", False),
    ("reading_loss", 2, "reading_loss: must be a probability", True), ("tracking", 1, "tracking: must be an object", True),
    ("tracking.filter", "ukf", "tracking.filter: unknown key; known are transform, increments, rule, gate, consensus", True),
    ("tracking.increments", 0, "tracking.increments: must be an integer from 1 to 65535", True),
    ("tracking.increments", 2.5, "tracking.increments: must be an integer", True),
    ("tracking.rule", "20", 'tracking.rule: must be "none", "innovation" or "mahalanobis"', True),
    ("tracking.transform", {}, 'tracking.transform: key "kind" is missing', True),
    ("tracking.transform.kind", "simplex", 'tracking.transform.kind: must be "julier", "cubature" or "scaled"', True),
    ("tracking.transform.kind", "julier", "tracking.transform.alpha: does not go with kind julier", True),
    ("tracking.transform", {"kind": "cubature", "kappa": 0}, "tracking.transform.kappa: does not go with kind cubature", True),
    ("tracking.transform.kappa", -6, "tracking.transform.kappa: must be above -6, the number of states", False),
    ("tracking.transform.alpha", 0, "tracking.transform.alpha: must be a number above 0", True), ("tracking.transform.beta", "2", "tracking.transform.beta: must be a number", True),
    ("tracking.gate.significance", ..., 'tracking.gate: key "significance" is missing', True),
    ("tracking.gate.significance", 0, "tracking.gate.significance: must be between 0 and 1", True),
    ("tracking.gate.significance", 1, "tracking.gate.significance: must be between 0 and 1", True),
    ("tracking.gate.sensor", 1, "tracking.gate.sensor: must be true or false", True),
    ("tracking.gate.sensor", False, "tracking.gate: judges nothing: sensor and stacked are both false", False),
    ("tracking.gate.policy", "drop", 'tracking.gate.policy: must be "skip" or "inflate"', True),
    ("tracking.gate.patience", -1, "tracking.gate.patience: must be an integer from 0", True),
    ("tracking.gate.filters", [], "tracking.gate.filters: must be an array of filters", True),
    ("tracking.gate.filters[1]", "kalman", 'tracking.gate.filters[1]: must be "ekf", "ukf", "iukf"', True),
    ("tracking.consensus.protocol", "gossip", 'tracking.consensus.protocol: must be "paper", "perron", "metropolis" or "ratio"', True),
    ("tracking.consensus.iterations", -1, "tracking.consensus.iterations: must be an integer from 0", True),
    ("tracking.consensus.information", "all", 'tracking.consensus.information: must be "residual" or "paper"', True),
    ("tracking.consensus.rounds", 3, "tracking.consensus.rounds: unknown key", True),
    ("readings", 3, "readings: unknown key; known are name, model, nodes, edges, weights, tolerance, steps, seed, faults, monitor, reading_loss, tracking", True),
]


def test_every_key_is_read(run, tmp_path):
    (tmp_path / "s.json").write_text(json.dumps(RIGHT))
    SCHEMA.validate(RIGHT)
    run("draw", tmp_path / "s.json")


@pytest.mark.parametrize("key,value,message,by_schema", WRONG, ids=[f"{i}-{w[0]}" for i, w in enumerate(WRONG)])
def test_wrong_key(refused, tmp_path, key, value, message, by_schema):
    wrong = change(RIGHT, key, value)
    assert SCHEMA.is_valid(wrong) != by_schema
    (tmp_path / "s.json").write_text(json.dumps(wrong, indent=1))
    said = refused(tmp_path, "draw", "{}/s.json", "--truth", "{}/x.csv")
    named = message.split(": ")[0]
    assert said.startswith(f"{tmp_path}/s.json:{line_of(wrong, named)}: {message}"), said


OWN = {"model": {"motion": "plugin", "name": "own", "states": ["a", "b"], "x0": [0.0, 0.0], "P0": diagonal(1.0, 1.0)},
       "nodes": [{"sensor": "plugin", "name": "own", "R": [[1.0]]}], "edges": []}
WRONG_OWN = [
    ("model.name", "", "model.name: must be the name of an own model", False), ("model.parameters", 3, "model.parameters: must be an array of numbers", True),
    ("model.parameters", ["3"], "model.parameters[0]: must be a number", True),
    ("model.acceleration_psd", 1.0, "model.acceleration_psd: an own model's noise is Q, or its own", True),
    ("model.turn_rate_psd", 1.0, "model.turn_rate_psd: goes with motion constant-turn", True),
    ("nodes[0].R", [], "nodes[0].R: must be an array of 1 to 64 rows", True),
    ("nodes[0]", {"sensor": "range", "position_m": [0.0, 0.0], "R": [[1.0]]}, "nodes[0].sensor: range needs px and py among model.states", False),
    ("nodes[0].range_limit_m", 5.0, "nodes[0].range_limit_m: needs position_m", True),
    ("nodes[0]", OWN["nodes"][0] | {"position_m": [0.0, 0.0], "range_limit_m": 5.0}, "nodes[0].range_limit_m: needs px and py among model.states", False),
]


@pytest.mark.parametrize("key,value,message,by_schema", WRONG_OWN, ids=[f"{i}-{w[0]}" for i, w in enumerate(WRONG_OWN)])
def test_wrong_key_of_own_models(refused, tmp_path, key, value, message, by_schema):
    SCHEMA.validate(OWN)
    wrong = change(OWN, key, value)
    assert SCHEMA.is_valid(wrong) != by_schema
    (tmp_path / "s.json").write_text(json.dumps(wrong, indent=1))
    said = refused(tmp_path, "draw", "{}/s.json", "--truth", "{}/x.csv")
    assert said.startswith(f"{tmp_path}/s.json:{line_of(wrong, message.split(': ')[0])}: {message}"), said


def test_range_rate_needs_velocities(refused, tmp_path):
    own = change(OWN, "model.states", ["px", "py"]) | {"nodes": [{"sensor": "range-rate", "position_m": [0.0, 0.0], "R": [[1.0]]}]}
    (tmp_path / "s.json").write_text(json.dumps(own))
    assert "nodes[0].sensor: range-rate needs vx and vy among model.states" in refused(tmp_path, "draw", "{}/s.json")


def test_keys_of_tracking_are_no_keys_of_linear_scenarios(refused, tmp_path):
    linear = {"model": {"A": [[0.5]], "Q": [[1.0]]}, "nodes": [{"C": [[1.0]], "R": [[1.0]]}], "edges": []}
    SCHEMA.validate(linear)
    for key, value, message in (("reading_loss", 0.1, "reading_loss: unknown key; known are name, model, nodes, edges, weights, tolerance, steps, seed, faults, monitor"),
                                ("model.states", ["px"], "model.states: unknown key; known are A, Q, input, x0, P0, dt_s, position_states"),
                                ("nodes[0].sensor", "range", "nodes[0].sensor: unknown key; known are C, R, position_m")):
        wrong = change(linear, key, value)
        assert not SCHEMA.is_valid(wrong)
        (tmp_path / "s.json").write_text(json.dumps(wrong, indent=1))
        assert refused(tmp_path, "draw", "{}/s.json") == f"{tmp_path}/s.json:{line_of(wrong, key)}: {message}"
    (tmp_path / "s.json").write_text(json.dumps(linear))
    assert refused(tmp_path, "draw", "{}/s.json").endswith('s.json: the model is linear (no "motion", no "navigation"): draw is for tracking and navigation')


@pytest.mark.parametrize("command", ["analyze", "fit"])
def test_commands_for_linear_scenarios(refused, tmp_path, command):
    (tmp_path / "s.json").write_text(json.dumps(RIGHT, indent=1))
    extra = ("--states", "x.csv", "--measurements", "y.csv") if command == "fit" else ()
    said = refused(tmp_path, command, "{}/s.json", *extra)
    assert said == f"{tmp_path}/s.json:4: model.motion: a scenario of tracking: here the model must be linear, with A and Q"


@pytest.mark.parametrize("kind,options", [("incomplete-measurements", ()), ("distributed-unscented", ()), ("distributed-unscented", ("--range-limit", "85.5"))])
def test_published_scenarios(run, tmp_path, kind, options):
    """The numbers of specification 2.5 and 4.3."""
    text = run("scenario", kind, "--seed", 7, *options).stdout
    scenario = json.loads(text)
    SCHEMA.validate(scenario)
    (tmp_path / "s.json").write_bytes(text)
    run("draw", tmp_path / "s.json")
    assert scenario["seed"] == 7 and scenario["name"] == kind and scenario["model"]["dt_s"] == 1.0 and len(scenario["nodes"]) == 3
    if kind == "incomplete-measurements":
        assert scenario["model"]["x0"] == [3, 0.05, 3, 0.05] and scenario["model"]["states"] == ["px", "vx", "py", "vy"] and scenario["steps"] == 60
        assert [n["position_m"] for n in scenario["nodes"]] == [[0, 0], [2, 0], [0, 2]] and scenario["reading_loss"] == 0.1
        assert all(n["R"] == [[2e-3]] and n["fault"] == {"probability": 0.1, "sigma": 0.2} for n in scenario["nodes"])
        assert scenario["tracking"]["increments"] == 30 and scenario["tracking"]["gate"]["significance"] == 1e-3
    else:
        assert scenario["model"]["x0"] == [10, 20, 1, 0.6] and scenario["model"]["acceleration_psd"] == 0.01 and scenario["steps"] == 80
        assert [n["position_m"] for n in scenario["nodes"]] == [[0, 0], [100, 0], [50, 90]] and scenario["edges"] == [[0, 1], [1, 2]]
        assert all(n["R"] == [[1]] and n.get("range_limit_m") == (85.5 if options else None) for n in scenario["nodes"])


@pytest.mark.parametrize("arguments,message", [
    (("scenario", "projectile", "--range-limit", 5), "scenario projectile: --range-limit is for another kind"),
    (("scenario", "incomplete-measurements", "--range-limit", 5), "scenario incomplete-measurements: --range-limit is for another kind"),
    (("scenario", "distributed-unscented", "--nodes", 5), "scenario distributed-unscented: --nodes is for another kind"),
    (("scenario", "distributed-unscented", "--range-limit", 0), "--range-limit 0: must be a number from 0.001"),
    (("draw",), "draw: the scenario file is missing"), (("draw", "none.json"), "none.json: No such file"),
    (("draw", "{}/s.json", "--steps", 0), "--steps 0: must be an integer from 1"), (("draw", "{}/s.json", "--run", -1), "--run -1: must be an integer from 0"),
    (("draw", "{}/s.json", "--truth", "{}/none/x.csv"), "none/x.csv: No such file"),
    (("draw", "{}/s.json", "--measurements", "{}/y.csv", "--truth", "{}/none/x.csv"), "none/x.csv: No such file"),
])
def test_bad_arguments(refused, tmp_path, arguments, message):
    (tmp_path / "s.json").write_text(json.dumps(RIGHT))
    assert message in refused(tmp_path, *arguments)
