# SPDX-License-Identifier: MIT
"""Navigation scenarios and recordings: what is wrong is named by file, line and key, and the schema agrees."""
import json

import pytest

from test_tracking_scenarios import SCHEMA, change, line_of

NAVIGATION = {"dt_s": 0.5, "imu_hz": 20, "start_s": 3.0, "speed_m_s": 80.0, "heading_deg": 30.0, "position_m": [1.0, 2.0, 3.0], "gravity_m_s2": 9.8,
              "maneuvers": [{"turn_deg": 45.0, "from_s": 5.0, "to_s": 8.0}, {"climb_m": 20.0, "from_s": 6.0, "to_s": 9.0}],
              "gyro_bias_deg_h": [1e-3, -2e-3, 1e-3], "accelerometer_bias_ug": [30.0, -40.0, 20.0], "angle_random_walk_deg_sqrt_h": 1e-3,
              "velocity_random_walk_ug_sqrt_hz": 20.0, "clock_sf_m2_s": 0.1, "clock_sg_m2_s3": 0.1,
              "initial_sd": {"attitude_rad": 1e-3, "velocity_m_s": 0.1, "position_m": 3.0, "gyro_bias_deg_h": [1e-3, 1e-3, 1e-3],
                             "accelerometer_bias_ug": [50.0, 50.0, 50.0], "clock_bias_m": 5.0, "clock_drift_m_s": 0.5},
              "biases": "drawn", "estimate": [0.0] * 17, "satellite_range_m": 1e7, "weights": {"normal": [1.5, 3.0], "significance": [0.2, 0.02]}}
# Every key of the schema.
RIGHT = {"name": "all keys", "model": {"navigation": NAVIGATION},
         "nodes": [{"satellite": 3 * k + 1, "elevation_deg": 20.0 + 10 * k, "azimuth_deg": 70.0 * k, "sigma_m": 2.0} for k in range(5)], "edges": [],
         "faults": [{"node": 1, "from_s": 8.0, "to_s": 10.0, "rate": 0.5, "step": 1.0}], "monitor": {"window": 5}, "steps": 20, "seed": 4}


def test_right_one_runs(run, tmp_path):
    assert not list(SCHEMA.iter_errors(RIGHT))
    (tmp_path / "s.json").write_text(json.dumps(RIGHT))
    run("simulate", tmp_path / "s.json", "--filter", "all", "--monitor", "exclude", "--runs", 2)


def test_published_one_is_in_the_schema(run):
    published = json.loads(run("scenario", "gnss-ins", "--seed", 5).stdout)
    assert not list(SCHEMA.iter_errors(published)) and published["seed"] == 5 and len(published["nodes"]) == 8


NAV = "model.navigation."
WRONG = [
    (NAV + "speed", 3.0, "unknown key; known are dt_s, imu_hz,"), (NAV + "imu_hz", 3.0, "imu_hz times dt_s must be a whole number, from 1 to 100000, not 1.5"),
    (NAV + "imu_hz", 0.0, "must be a number from 1e-6 to 1e6"), (NAV + "dt_s", "1", "must be a number of seconds from 1e-6 to 1e6"),
    (NAV + "speed_m_s", 0.0, "must be above 0, 1e5 at most"), (NAV + "heading_deg", 361.0, "must be from -360 to 360"),
    (NAV + "position_m", [1.0, 2.0], "has 2 entries, not 3"), (NAV + "gravity_m_s2", -9.8, "must be above 0, 1000 at most"),
    (NAV + "maneuvers", {}, "must be an array, of 1000 at most"), (NAV + "maneuvers[0]", {"from_s": 1, "to_s": 2}, "needs one of turn_deg and climb_m"),
    (NAV + "maneuvers[0].climb_m", 3.0, "needs one of turn_deg and climb_m"), (NAV + "maneuvers[0].to_s", 5.0, "to_s must be above from_s, 5"),
    (NAV + "maneuvers[1].climb_m", 100.0, "is steeper than 30 degrees at 80 m/s: climb less, or longer"),
    (NAV + "maneuvers[1]", {"turn_deg": 10, "from_s": 7, "to_s": 9}, "overlaps maneuver 0, which turns, too"),
    (NAV + "maneuvers[0].turn_deg", "x", "must be a number, 1e6 at most"), (NAV + "maneuvers[0].from_s", ..., 'key "from_s" is missing'),
    (NAV + "gyro_bias_deg_h", 0.1, "must be an array of 3 numbers"), (NAV + "accelerometer_bias_ug[1]", None, "must be a number"),
    (NAV + "angle_random_walk_deg_sqrt_h", -1.0, "must be a number, 0 or above"), (NAV + "clock_sg_m2_s3", -1.0, "must be a number, 0 or above"),
    (NAV + "initial_sd", ..., 'key "initial_sd" is missing'), (NAV + "initial_sd.position_m", ..., 'key "position_m" is missing'),
    (NAV + "initial_sd.position_m", 0.0, "must be a number above 0"), (NAV + "initial_sd.clock", 1.0, "unknown key; known are attitude_rad,"),
    (NAV + "initial_sd.gyro_bias_deg_h", [0.0, 1.0, 1.0], "gyro_bias_deg_h is not above 0 (it is the size of the bias itself where it is not given)"),
    (NAV + "biases", "random", 'must be "fixed" or "drawn"'), (NAV + "estimate", [0.0] * 16, "has 16 entries, not 17"),
    (NAV + "satellite_range_m", 1.0, "must be from 1e3 to 1e12"), (NAV + "weights.normal", [3.0, 2.0], "must be k0 and k1 with 0 < k0 < k1"),
    (NAV + "weights.significance", [0.01, 0.1], "must be those of k0 and k1, two-sided, between 0 and 1, the first one above the other"),
    ("nodes[2].sensor", "range", "unknown key; known are satellite, elevation_deg, azimuth_deg, sigma_m"),
    ("nodes[2].satellite", 1, "is 1 again, as in nodes[0]"), ("nodes[2].satellite", 0, "must be an integer from 1 to 65535"),
    ("nodes[1].sigma_m", 0.0, "must be a number of metres from 1e-12 to 1e9"), ("nodes[1].elevation_deg", 91.0, "must be from -90 to 90"),
    ("nodes[4].azimuth_deg", ..., 'key "azimuth_deg" is missing'), ("edges", [[0, 1]], "must be []: satellites have no links"),
    ("faults[0].node", 5, "must be an integer from 0 to 4"), ("faults[0].row", 1, "must be an integer from 0 to 0"),
    ("model.A", [[1.0]], "unknown key; known are navigation"), ("tracking", {}, "unknown key; known are name, model,"),
]
# What a schema does not see: conditions between values.
UNSEEN = ["imu_hz times", "to_s must be above", "steeper", "overlaps", "size of the bias", "with 0 < k0 < k1", "the first one above", "again, as in nodes",
          "must be an integer from 0 to 4", "must be an integer from 0 to 0"]


@pytest.mark.parametrize("key, value, words", WRONG, ids=[f"{key}-{words[:20]}" for key, _, words in WRONG])
def test_wrong_scenarios_are_named(refused, tmp_path, key, value, words):
    settings = change(RIGHT, key, value)
    (tmp_path / "s.json").write_text(json.dumps(settings, indent=1))
    message = refused(tmp_path, "simulate", "{}/s.json", "--out", "{}/log", "--json", "{}/out.json")
    assert message.startswith(f"{tmp_path}/s.json:") and words in message, message
    shown = key if value is not ... else key.rpartition(".")[0]
    if not words.startswith("needs one of") and not words.startswith(("to_s", "gyro_bias")):
        assert message.split(":")[1] == str(line_of(settings, shown)), message
    assert bool(list(SCHEMA.iter_errors(settings))) != any(word in words for word in UNSEEN)


def test_too_many_satellites(refused, tmp_path):
    settings = change(RIGHT, "nodes", [RIGHT["nodes"][0] | {"satellite": k + 1} for k in range(33)])
    (tmp_path / "s.json").write_text(json.dumps(settings))
    assert refused(tmp_path, "simulate", "{}/s.json").endswith("nodes: has 33 satellites; at most 32")


def test_other_commands_say_so(refused, tmp_path):
    (tmp_path / "s.json").write_text(json.dumps(RIGHT))
    assert "model.navigation: a scenario of navigation: here the model must be linear, with A and Q" in refused(tmp_path, "analyze", "{}/s.json")
    assert refused(tmp_path, "design", "{}/s.json").endswith("a navigation scenario: design is for linear and tracking ones")
    assert refused(tmp_path, "draw", "{}/s.json", "--models", "x.so") == "--models is for tracking scenarios"


@pytest.mark.parametrize("options, words", [
    (("--filter", "ukf"), "--filter ukf: for a navigation scenario it must be one of ekf, rekf-n, rekf-t, all"),
    (("--loss", "0.1"), "--loss is not for navigation scenarios"), (("--models", "x.so"), "--models is not for navigation scenarios"),
    (("--monitor", "raim"), "--monitor raim: must be none, rctm, aime, aime-improved or exclude"),
    (("--false-alarm", "1", "--monitor", "aime"), "--false-alarm 1: must be a probability, above 0 and below 1"),
    (("--false-alarm", "0", "--monitor", "aime"), "--false-alarm 0: must be a probability, above 0 and below 1"),
    (("--measurements", "pr.csv"), "--measurements goes with --imu: a recorded run needs both"), (("--imu", "i.csv"), "--imu goes with --measurements: a recorded run needs both"),
    (("--truth", "t.csv"), "--truth FILE.csv goes with --measurements and --imu"), (("--from-step", "21"), "--from-step 21: must be an integer from 1 to 20"),
    (("--filter", "all", "--out", "{}/log"), "--out: a log holds one filter; choose one with --filter"), (("--real", "half"), "--real half: must be float32 or float64"),
    (("--steps", "900000000"), "900000000 epochs of 10 samples each: at most 50000000 samples can be drawn"),
])
def test_wrong_options_are_named(refused, tmp_path, options, words):
    (tmp_path / "s.json").write_text(json.dumps(RIGHT))
    assert refused(tmp_path, "simulate", "{}/s.json", *options) == words


@pytest.fixture
def recording(run, tmp_path):
    (tmp_path / "s.json").write_text(json.dumps(change(RIGHT, "faults", [])))
    run("draw", tmp_path / "s.json", "--measurements", tmp_path / "pr.csv", "--imu", tmp_path / "imu.csv", "--truth", tmp_path / "truth.csv")
    return tmp_path


FILES = "simulate", "{}/s.json", "--measurements", "{}/pr.csv", "--imu", "{}/imu.csv", "--truth", "{}/truth.csv", "--json", "{}/out.json"


def edit(path, line, text):
    """Line `line`, from 1, becomes the text: a function of it, or a string. Negative lines count from the end."""
    lines = path.read_text().splitlines()
    index = line - 1 if line > 0 else line
    lines[index] = text(lines[index]) if callable(text) else text
    path.write_text("\n".join(lines) + "\n")


def column(number, value):
    return lambda line: ",".join(value if i == number else part for i, part in enumerate(line.split(",")))


@pytest.mark.parametrize("name, line, text, words", [
    ("pr", 1, "t,node,row,value", "pr.csv:1: the header must be t,satellite,value,x,y,z, not t,node,row,value"),
    ("pr", 3, column(1, "5"), "pr.csv:3: satellite 5 is not among the scenario's nodes: add it there, or leave the line out"),
    ("pr", 3, column(1, "1"), "pr.csv:3: satellite 1 twice at t = 3.5: keep one of them"),
    ("pr", 3, column(3, "nan"), "pr.csv:3: a pseudorange without the satellite's position"),
    ("pr", 3, column(2, "inf"), "pr.csv:3: column value is not finite"), ("pr", 3, column(1, "nan"), "pr.csv:3: column satellite is not finite"),
    ("pr", 7, column(0, "3.25"), "pr.csv:7: t is 3.25, before that of line 6: times must ascend"),
    ("pr", 2, column(0, "2.5"), "pr.csv:2: t is 2.5: before model.navigation.start_s, 3"),
    ("imu", 4, column(6, ""), "imu.csv:4: column fz: expected a number and the end of the line"), ("imu", 4, column(2, "nan"), "imu.csv:4: column wy is not finite"),
    ("imu", 4, column(0, "3.1"), "imu.csv:4: t is 3.1, that of line 3: times must ascend"),
    ("imu", -1, "", "imu.csv:200: the samples end at t = 12.95, 0.05 s before the last pseudorange, t = 13: give samples for all the time, or fewer epochs"),
    ("truth", 3, column(0, "x"), "truth.csv:3: column t: expected a number and a comma"),
    ("truth", 1, "t,state,value", "truth.csv:1: the header must be t,roll,pitch,heading,ve,vn,vu,pe,pn,pu,gx"),
])
def test_wrong_recordings_are_named(refused, recording, name, line, text, words):
    edit(recording / f"{name}.csv", line, text)
    message = refused(recording, *FILES)
    assert words in message, message


def test_recordings_that_do_not_fit_in_time(refused, recording):
    lines = (recording / "imu.csv").read_text().splitlines()
    (recording / "imu.csv").write_text("\n".join(lines[:1] + lines[41:]) + "\n")
    assert "the samples begin at t = 5.05, 2.05 s after model.navigation.start_s, 3: the run can begin no sooner" in refused(recording, *FILES)
    (recording / "imu.csv").write_text("\n".join(lines) + "\n")
    truth = (recording / "truth.csv").read_text().splitlines()
    moved = [truth[0]] + [f"{float(line.split(',')[0]) + 1e6},{line.split(',', 1)[1]}" for line in truth[1:]]
    (recording / "truth.csv").write_text("\n".join(moved) + "\n")
    assert "no truth at any epoch: it is for 1000003 to 1000013 s, the pseudoranges are for 3.5 to 13 s: two clocks, or two units?" in refused(recording, *FILES)
    for name, words in (("pr", "no measurements"), ("imu", "needs two samples at least")):
        kept = (recording / f"{name}.csv").read_text()
        (recording / f"{name}.csv").write_text(kept.split("\n", 1)[0] + "\n")
        assert words in refused(recording, *FILES)
        (recording / f"{name}.csv").write_text(kept)


def test_what_is_worth_a_note_is_noted(run, recording):
    lines = (recording / "imu.csv").read_text().splitlines()
    (recording / "imu.csv").write_text("\n".join(lines[:100] + lines[160:]) + "\n")
    settings = change(change(RIGHT, "faults", [{"node": 0, "from_s": 50, "step": 1}]), "model.navigation.estimate", ...)
    (recording / "s.json").write_text(json.dumps(settings))
    run(*(str(a).replace("{}", str(recording)) for a in FILES), "--steps", 19)
    notes = json.loads((recording / "out.json").read_text())["notes"]
    assert any(note.startswith("no inertial sample for 3.05 s from t = 7.95 on") for note in notes), notes
    assert any("model.navigation.estimate is not given" in note for note in notes)
    assert any(note.startswith("faults[0] begins at 50 s: after the last epoch, 12.5 s") for note in notes)
    few = change(settings, "nodes", settings["nodes"][:3])
    (recording / "few.json").write_text(json.dumps(few))
    out = run("simulate", recording / "few.json", "--monitor", "aime").stdout.decode()
    assert "there are 3 satellites: position and clock take four" in out and "3 satellites: with fewer than five no statistic can say which of them is faulty" in out
    one = change(settings, "nodes", settings["nodes"][:1])
    (recording / "one.json").write_text(json.dumps(one))
    assert "there is 1 satellite: position and clock" in run("simulate", recording / "one.json").stdout.decode()
    lines = (recording / "pr.csv").read_text().splitlines()
    (recording / "pr.csv").write_text("\n".join([lines[0]] + [",".join([*line.split(",")[:2], "nan", *line.split(",")[3:]]) for line in lines[1:]]) + "\n")
    run(*(str(a).replace("{}", str(recording)) for a in FILES), "--steps", 19)
    assert any(note.startswith("the poorest epoch has 0 satellites: ") for note in json.loads((recording / "out.json").read_text())["notes"])
