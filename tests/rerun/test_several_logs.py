# SPDX-License-Identifier: MIT
"""Which of several logs are joined to one, which are compared, and which are refused."""

import numpy as np
import pytest
from readback import Recording, command
from synthetic import Log
from test_some_nodes import one_by_one, some


@pytest.fixture
def show(tmp_path):
    def run(*logs, options=()):
        paths = []
        for i, log in enumerate(logs):
            paths.append(tmp_path / f"{i}.cbor")
            paths[-1].write_bytes(log if isinstance(log, bytes) else log.data())
        done = command(*paths, "-o", tmp_path / "run.rrd", *options)
        return (Recording(tmp_path / "run.rrd") if done.returncode == 0 else None), done.stderr.decode()

    return run


def compared(recording: Recording) -> bool:
    return "compare/summary" in recording.entities()


def said(recording: Recording) -> str:
    return recording.rows("compare/summary", "TextDocument:text", static=True)[2][0][0]


def test_nodes_of_one_network_are_joined(show):
    recording, _ = show(*(some(Log(5, truth=False), nodes) for nodes in ([0, 3], [1], [2, 4])))
    assert not compared(recording) and {f"theta/node/{k}" for k in range(5)} <= recording.entities()


def test_a_node_that_was_started_again_is_joined(show):
    items = some(Log(5, truth=False), [2]).items()
    recording, _ = show(some(Log(5, truth=False), [1]), b"".join(items[:5]), b"".join([items[0], *items[8:]]))
    assert not compared(recording) and np.isnan(recording.series("theta/node/2")[4:7]).all()


def test_two_runs_of_one_node_are_compared(show):
    log = some(Log(5, truth=False), [2])
    theta = log.arrays["theta"].copy()
    theta[0, 7] += 1.0
    log.arrays["theta"] = theta
    recording, _ = show(some(Log(5, truth=False), [2]), log)
    assert "The first difference is in step 7: theta." in said(recording)


def test_only_a_running_node_goes_on_in_another_log(show):
    items = Log(5).items()
    recording, text = show(b"".join(items[:6]), b"".join([items[0], *items[6:]]))
    assert recording is None and "no step of run 0 in common" in text


def test_all_logs_of_the_same_filter_are_compared(show):
    recording, _ = show(Log(5), Log(5, real="float32"), Log(5))
    assert recording.rows("compare/summary", "TextDocument:text", static=True)[2][0][0].count("## against") == 2


def test_a_simulated_run_beside_the_logs_of_its_nodes(show, tmp_path):
    """The nodes of a network, each with its own log, against the simulator: the bits are the question."""
    parts = [path.read_bytes() for path in one_by_one(tmp_path)]
    recording, _ = show(Log(5, truth=False), *parts)
    text = said(recording)
    # Node 2 was away for three of twelve steps; there nothing is known of it.
    assert "| theta | 4, node 2 | 25.0 % | unknown in one |" in text and "| data | recorded | live |" in text
    assert "| file | 0.cbor | 1.cbor and 5 more |" in text and "The mean of the differences" not in text
    recording, _ = show(Log(5, truth=False), some(Log(5, truth=False), [1, 3]))
    assert "Equal bit for bit in all 12 steps" in said(recording)


def test_a_planted_difference_of_one_node(show):
    log = some(Log(5, truth=False), [1, 3])
    values = log.arrays["estimate"].copy()
    values[0, 9, 4] += 1e-12 + abs(values[0, 9, 4]) * 1e-12
    log.arrays["estimate"] = values
    recording, _ = show(Log(5, truth=False), log)
    text = said(recording)
    assert "The first difference is in step 9: estimates (node 3)." in text and "| estimates ever differ of | 1 of 2 nodes: node 3 |" in text and "| estimates | 9, node 3 | 8.3 % |" in text


def test_parts_of_two_networks_stand_beside_each_other(show):
    """Two nodes each, of two filters: two joined logs, compared."""
    logs = [some(Log(5, truth=False, filter=name), [k]) for name in ("rkfdu", "kfd") for k in (1, 3)]
    recording, _ = show(*logs)
    assert "# rkfdu beside kfd" in said(recording) and {"theta/node/1", "theta/node/3"} <= recording.entities()


@pytest.mark.parametrize(("first", "second", "message"), [
    (lambda: some(Log(5), [1]), lambda: some(Log(5, real="float32"), [2]), "its real is another, and they cannot be compared: they have no node in common"),
    (lambda: some(Log(5), [1]), lambda: some(Log(6), [2]), "1.cbor does not belong to "),
    (lambda: Log(5), lambda: Log(6), "its number of nodes is 6 instead of 5"),
    (lambda: Log(5), lambda: some(Log(6), [5]), "1.cbor does not belong to "),
])
def test_neither(show, first, second, message):
    recording, text = show(first(), second())
    assert recording is None and message in text and text.count("\n") == 1


def test_equal_names_are_told_apart():
    from dataclasses import replace
    from io import BytesIO, BufferedReader

    from meshkal_log.reader import LogReader
    from meshkal_log.together import labels

    header = LogReader(BufferedReader(BytesIO(Log(5, filter="kfd").data()))).header
    other = replace(header, filter="rkfdu")

    def texts(*headers):
        return [label.text for label in labels(headers)]

    assert texts(header, other) == ["kfd", "rkfdu"]
    assert texts(header, replace(header, loss=0.0)) == ["kfd loss 0.1", "kfd loss 0"]
    assert texts(header, replace(header, seed=9), other, replace(header, real="float32")) == ["kfd", "kfd seed 9", "rkfdu", "kfd float32"]
    assert texts(header, header) == ["kfd (1)", "kfd (2)"]
    assert texts(header, replace(header, monitor="rctm")) == ["kfd monitor none", "kfd monitor rctm"]
    assert [label.key for label in labels([header, other, header])] == ["kfd-1", "rkfdu", "kfd-3"]
