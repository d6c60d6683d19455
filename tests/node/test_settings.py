# SPDX-License-Identifier: MIT
"""Every key of the settings wrong once: the message names file and key, the exit status is 2, nothing is written."""
import copy
import json
import pathlib
import subprocess

import jsonschema
import pytest
from nodes import KEY, port

ROOT = pathlib.Path(__file__).resolve().parents[2]
SCHEMA = json.loads((ROOT / "tools" / "meshkal-node" / "settings.schema.json").read_text())


@pytest.fixture(scope="module")
def place(program, draw, tmp_path_factory):
    """A folder with a scenario of four nodes, its design, a key; settings that are right; and who are the neighbours of node 1."""
    folder = tmp_path_factory.mktemp("settings")
    network = draw(4)
    (folder / "net.json").write_text(json.dumps(network))
    (folder / "other.json").write_text(json.dumps(draw(5)))
    (folder / "broken.json").write_text("{")
    (folder / "wrong.json").write_text(json.dumps(network | {"tolerance": -1}))
    for name in ("net", "other"):
        subprocess.run([program, "design", folder / f"{name}.json", "--json", folder / f"{name}.design"], check=True, capture_output=True)
    (folder / "key").write_text(KEY + "\n")
    (folder / "key").chmod(0o600)
    (folder / "open.key").write_text(KEY)
    (folder / "short.key").write_text(KEY[:-1])
    (folder / "short.key").chmod(0o600)
    (folder / "bad.boots").write_text("a lot\n")
    neighbours = sorted({j for e in network["edges"] if 1 in e for j in e} - {1})
    stranger = next((k for k in range(4) if k != 1 and k not in neighbours), 1)
    right = {
        "scenario": "net.json", "design": "net.design", "node": 1, "real": "float32", "numbers": "float16",
        "clock": {"period_ms": 20, "split": 0.4, "epoch_s": 0}, "listen": f"127.0.0.1:{port()}",
        "peers": {str(j): f"127.0.0.1:{17995 + j}" for j in neighbours},
        "security": {"key_file": "key", "boot_file": "boots"}, "gate": {"reading": 0.999, "estimate": 100, "patience": 5}, "catch_up": 16,
        "state": {"file": "state", "every_s": 1}, "readings": f"udp:127.0.0.1:{port()}", "telemetry": "log.cbor",
    }
    return folder, right, neighbours, stranger


def change(settings, path, value):
    out = copy.deepcopy(settings)
    *way, last = path.split(".")
    at = out
    for name in way:
        at = at.setdefault(name, {})
    if value is ...:
        del at[last]
    else:
        at[last] = value
    return out


def run(program, folder, settings, **options):
    path = folder / "config.json"
    path.write_text(settings if isinstance(settings, str) else json.dumps(settings, indent=1))
    node = str(pathlib.Path(program).with_name("meshkal-node"))
    return path, subprocess.run([node, str(path)], stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=20, **options)


# Key; wrong value; what the message says; whether the schema says so, too.
WRONG = [
    ("scenario", 1, "scenario: must be a text", True), ("scenario", ..., '"scenario" is missing', True),
    ("scenario", "none.json", "none.json: No such file", False), ("scenario", "broken.json", "broken.json:1:", False),
    ("scenario", "wrong.json", "wrong.json:", False),
    ("design", [], "design: must be a text", True), ("design", "none", "design: ", False), ("design", "net.json", "design: ", False),
    ("design", "broken.json", "design: ", False), ("design", "other.design", "design: ", False),
    ("node", ..., '"node" is missing', True), ("node", 4, "node: must be an integer from 0 to 3", False), ("node", -1, "node: must be an integer", True),
    ("node", 1.5, "node: must be an integer", True), ("real", "float16", "real: must be one of: float32, float64", True),
    ("real", 32, "real: must be one of", True), ("numbers", "float8", "numbers: must be one of", True), ("numbers", "float64", "numbers: are float64, more than", False),
    ("clock", 5, "clock: must be an object", True), ("clock.period_ms", 0.5, "clock.period_ms: must be a number from 1 to", True),
    ("clock.period_ms", "50", "clock.period_ms: must be a number", True), ("clock.split", 0, "clock.split: must be a number from 0.05 to 0.95", True),
    ("clock.epoch_s", -1, "clock.epoch_s: must be a number", True), ("clock.period", 5, "clock.period: unknown key; known are period_ms, split, epoch_s", True),
    ("listen", ..., '"listen" is missing', True), ("listen", 7000, "listen: must be a text", True), ("listen", "7000", "listen: 7000: must be host:port", False),
    ("listen", "127.0.0.1:0", "listen: ", False), ("listen", "127.0.0.1:99999", "listen: ", False), ("listen", "::1:7000", "listen: ::1:7000: must be", False),
    ("listen", "192.0.2.1:17991", "listen: 192.0.2.1:17991: Cannot assign", False), ("listen", "239.1.1.1:17991", "listen: 239.1.1.1:17991 is a multicast address", False),
    ("listen", "300.1.2.3:17991", "listen: 300.1.2.3:17991: ", False),
    ("peers", ..., "peers: are missing", True), ("peers", [], "peers: must be an object", True), ("peers.9", "127.0.0.1:1", "peers.9: 9 is not the number of a neighbour", False),
    ("peers.x", "127.0.0.1:1", "x is not the number of a neighbour", True), ("peers.1", "127.0.0.1:1", "1 is not the number of a neighbour of node 1", False),
    ("multicast", {"group": "239.1.1.1:7000", "interface": "lo"}, 'stand beside "multicast"', True),
    ("security", "yes", "security: must be an object", True), ("security.key_file", ..., 'security: key "key_file" is missing', True),
    ("security.boot_file", ..., 'security: key "boot_file" is missing', True), ("security.key_file", "none", "security.key_file: ", False),
    ("security.key_file", "open.key", "security.key_file: ", False), ("security.key_file", "short.key", "must hold 64 hexadecimal digits", False),
    ("security.boot_file", "bad.boots", "security.boot_file: ", False), ("security.boot_file", "no/such/boots", "security.boot_file: ", False),
    ("security.key", "x", "security.key: unknown key", True), ("gate", [], "gate: must be an object", True),
    ("gate.reading", 0.2, "gate.reading: must be a number from 0.5 to 1", True), ("gate.estimate", -1, "gate.estimate: must be", True),
    ("gate.patience", 70000, "gate.patience: must be an integer from 0 to 65535", True), ("gate.readings", 1, "gate.readings: unknown key", True),
    ("catch_up", -1, "catch_up: must be an integer from 0 to 65535", True), ("state", "file", "state: must be an object", True),
    ("state.file", ..., 'state: key "file" is missing', True), ("state.file", "", "state.file: must be a text", True),
    ("state.every_s", 0, "state.every_s: must be a number from 0.01", True), ("state.every", 1, "state.every: unknown key", True),
    ("readings", "file.csv", "readings: must be -, udp:HOST:PORT", True), ("readings", 5, "readings: must be a text", True),
    ("readings", "udp:nowhere", "readings: nowhere: must be host:port", False), ("readings", "unix:" + "x" * 120, "readings: unix:", False),
    ("readings", "unix:no/such/place", "readings: unix:", False),
    ("telemetry", {}, "telemetry: must be a text", True), ("telemetry", "no/such/log.cbor", "telemetry: ", False),
    ("telemetry", "udp:1", "telemetry: 1: must be host:port", False), ("telemetry", "unix:no/such/place", "telemetry: unix:", False),
    ("colour", "red", "colour: unknown key; known are scenario, design, node", True),
]


@pytest.mark.parametrize("path,value,message,by_schema", WRONG, ids=[f"{i}-{w[0]}" for i, w in enumerate(WRONG)])
def test_wrong_key(program, place, path, value, message, by_schema):
    folder, right, _, _ = place
    settings = change(right, path, value)
    assert jsonschema.Draft202012Validator(SCHEMA).is_valid(settings) != by_schema
    before = sorted(folder.rglob("*"))
    config, done = run(program, folder, settings)
    assert done.returncode == 2 and done.stdout == "", done
    assert done.stderr.startswith("meshkal-node: ") and done.stderr.count("\n") == 1 and message in done.stderr, done.stderr
    # A wrong scenario is named by its own file and line.
    if not (path == "scenario" and isinstance(value, str)):
        line = 1 + config.read_text()[:config.read_text().find(f'"{path.split(".")[-1]}":')].count("\n")
        missing = value is ... or path == "multicast"
        assert f"{config}:" in done.stderr and (missing or f"{config}:{line}: " in done.stderr), (line, done.stderr)
    left = set(folder.rglob("*")) - set(before) - {config, folder / "boots"}
    assert not left, left


@pytest.mark.parametrize("group,message", [
    ({}, '"group" is missing'), ({"group": "239.1.1.1:7000"}, '"interface" is missing'), ({"group": "10.0.0.1:7000", "interface": "lo"}, "is not a multicast address"),
    ({"group": "239.1.1.1", "interface": "lo"}, "multicast.group: 239.1.1.1: must be host:port"),
    ({"group": "239.1.1.1:7000", "interface": "nope7"}, "multicast.interface: nope7: there is no such interface"),
    ({"group": "239.1.1.1:7000", "interface": "lo", "hops": 256}, "multicast.hops: must be an integer from 0 to 255"),
    ({"group": "239.1.1.1:7000", "interface": "lo", "ttl": 1}, "multicast.ttl: unknown key"), (7, "multicast: must be an object"),
])
def test_wrong_multicast(program, place, group, message):
    folder, right, _, _ = place
    settings = change(change(change(right, "peers", ...), "listen", ...), "multicast", group)
    config, done = run(program, folder, settings)
    assert done.returncode == 2 and str(config) in done.stderr and message in done.stderr, done


def test_missing_and_repeated_neighbour(program, place):
    folder, right, neighbours, _ = place
    _, done = run(program, folder, change(right, f"peers.{neighbours[0]}", ...))
    assert done.returncode == 2 and f"node {neighbours[0]}, a neighbour of node 1, is missing" in done.stderr, done
    twice = change(right, f"peers.0{neighbours[0]}", "127.0.0.1:5")
    _, done = run(program, folder, twice)
    assert done.returncode == 2 and f"node {neighbours[0]} stands there twice" in done.stderr, done


def test_no_json_and_arguments(program, place):
    folder = place[0]
    config, done = run(program, folder, '{"node": 1,\n "node": 2}')
    assert done.returncode == 2 and f"{config}:2:" in done.stderr, done
    node = str(pathlib.Path(program).with_name("meshkal-node"))
    assert subprocess.run([node], capture_output=True, timeout=10).returncode == 2
    assert subprocess.run([node, str(folder / "nothing")], capture_output=True, timeout=10).returncode == 2
    shown = subprocess.run([node, "--help"], capture_output=True, text=True, timeout=10)
    assert shown.returncode == 0 and "CONFIG.json" in shown.stdout
    assert subprocess.run([node, "--version"], capture_output=True, text=True, timeout=10).stdout.startswith("meshkal-node ")


def test_the_right_settings_are_right(program, place):
    folder, right, _, _ = place
    jsonschema.validate(right, SCHEMA)
    path = folder / "right.json"
    path.write_text(json.dumps(right))
    node = str(pathlib.Path(program).with_name("meshkal-node"))
    process = subprocess.Popen([node, str(path)], stdin=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    try:
        process.wait(0.5)
    except subprocess.TimeoutExpired:
        pass
    process.terminate()
    try:
        _, text = process.communicate(timeout=5)
    finally:
        process.kill()
    assert process.returncode == 0, text
    for name in ("boots", "log.cbor", "state"):
        (folder / name).unlink()
