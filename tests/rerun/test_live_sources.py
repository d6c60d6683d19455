# SPDX-License-Identifier: MIT
"""Live mode from a file that grows, a node's Unix socket and datagrams of nodes; and the parts that put steps in order."""

import io
import random
import signal
import socket
import time

import cbor2
import numpy as np
import pytest
from live_process import DEADLINE_S, live, same, wait_for
from readback import Recording, command, convert
from synthetic import Log
from test_some_nodes import some

from meshkal_log.joined import JoinedReader
from meshkal_log.reader import LogError, LogReader
from meshkal_rerun.live.datagrams import HOLD_S, Order
from meshkal_rerun.live.items import Framer
from meshkal_rerun.live.joining import Joining
from meshkal_rerun.live.queue import DropOldest


def ended(end: str, count: int) -> bytes:
    return cbor2.dumps({"end": end, "items": count})


def test_a_framer_gives_items_however_they_are_cut():
    items = Log(nodes=2, steps=3).items()
    data = b"".join(items)
    for size in (1, 2, 7, 100, 1000, len(data)):
        framer = Framer()
        raw = [raw for at in range(0, len(data), size) for _, raw in framer.feed(data[at : at + size])]
        assert raw == items


def test_a_framer_does_not_wait_for_ever():
    log = Log(nodes=2, steps=3)
    items = log.items()
    framer = Framer()
    list(framer.feed(b"".join(items[:2])))
    framer.expect(LogReader(io.BufferedReader(io.BytesIO(log.data()))).header)
    endless = b"\xa1\x61a\x5b\x00\x00\x00\x7f\xff\xff\xff\xff"  # a map with 500 GB in it
    with pytest.raises(LogError, match="item 3 is damaged: it is longer"):
        for _ in range(100):
            list(framer.feed(endless + bytes(10000)))
            endless = b""


@pytest.mark.parametrize("items, size, kept", [(3, 1000, [7, 8, 9]), (100, 45, [6, 7, 8, 9]), (100, 5, [9]), (100, 1000, list(range(10)))])
def test_a_queue_drops_the_oldest(items, size, kept):
    queue = DropOldest(items, size)
    for k in range(10):
        queue.put({"step": k}, 10)
    taken, _ = queue.take(100, 0.0)
    assert [item["step"] for item in taken] == kept
    assert queue.dropped == 10 - len(kept)
    assert not queue.over
    queue.close()
    assert queue.over and queue.take(100, 10.0)[0] == []


def test_a_growing_file_that_is_begun_anew(tmp_path):
    """It is not there at first, grows in pieces cut anywhere, is written anew in the middle of an item, as by a node that starts again, and ends."""
    log = Log(nodes=3, steps=30)
    items = log.items()
    source = tmp_path / "run.cbor"
    with live(source, tmp_path / "run.rrd") as process:
        wait_for(lambda: f"waiting for {source} to appear" in process.said, "a word about the file")
        data = b"".join(items[:16]) + items[16][:70]
        with open(source, "wb", buffering=0) as file:
            for at in range(0, len(data), 1777):
                file.write(data[at : at + 1777])
                time.sleep(0.01)
            wait_for(lambda: len(process.kept()) >= sum(map(len, items[:16])), "the first steps")
        with open(source, "wb", buffering=0) as file:
            # Its reader looks fifty times a second.
            file.write(items[0][:50])
            time.sleep(0.5)
            file.write(items[0][50:] + items[14] + b"".join(items[16:-1]) + ended("complete", 15))
        status, said = process.end()
    assert status == 0
    assert "1 times the file was begun anew" in said and "1 steps that came again" in said
    convert(log.data(), tmp_path / "offline.rrd")
    same(tmp_path / "run.rrd", tmp_path / "offline.rrd")


def test_a_file_that_no_longer_grows(tmp_path):
    (tmp_path / "run.cbor").write_bytes(b"".join(Log(nodes=3, steps=30).items()[:21]))
    with live(tmp_path / "run.cbor", tmp_path / "run.rrd", "--wait", "0.5") as process:
        status, said = process.end()
    assert status == 1 and "the source was lost" in said
    assert len(Recording(tmp_path / "run.rrd").series("theta/node/0")) == 20


def listening(path) -> socket.socket:
    server = socket.socket(socket.AF_UNIX)
    server.bind(str(path))
    server.listen()
    server.settimeout(DEADLINE_S)
    return server


def serve(server: socket.socket, *pieces: bytes) -> None:
    connection, _ = server.accept()
    with connection:
        for piece in pieces:
            connection.sendall(piece)


def test_a_node_s_socket_and_its_new_start(tmp_path):
    """The socket is not there at first; the node is killed in the middle of an item, and then ends properly and starts again."""
    log = some(Log(nodes=5, steps=30), [2])
    items = log.items()
    path = tmp_path / "node.sock"
    with live(f"unix:{path}", tmp_path / "run.rrd") as process:
        wait_for(lambda: f"waiting for {path} to accept a connection" in process.said, "a word about the socket")
        with listening(path) as server:
            serve(server, *items[:11], items[11][:100])
        path.unlink()
        wait_for(lambda: len(process.kept()) >= sum(map(len, items[:11])), "the first steps")
        with listening(path) as server:
            serve(server, items[0], *items[11:21], ended("complete", 10))
            serve(server, items[0], *items[21:-1], ended("complete", 10))
            wait_for(lambda: len(process.kept()) >= sum(map(len, items[:-1])), "the last steps")
            process.process.send_signal(signal.SIGTERM)
            status = process.process.wait(DEADLINE_S)
        _, said = process.end()
    assert status == 143 and "30 steps, to step 29" in said and "stopped by SIGTERM" in said
    convert(log.data(), tmp_path / "offline.rrd")
    same(tmp_path / "run.rrd", tmp_path / "offline.rrd")


def test_another_scenario_in_the_same_place(tmp_path):
    log, other = some(Log(nodes=5, steps=10), [2]), some(Log(nodes=5, steps=10, name="another"), [2])
    path = tmp_path / "node.sock"
    with listening(path) as server, live(f"unix:{path}", tmp_path / "run.rrd") as process:
        serve(server, *log.items()[:6])
        serve(server, *other.items())
        status, said = process.end()
    assert status == 1 and "another scenario" in said and "5 steps" in said
    np.testing.assert_array_equal(Recording(tmp_path / "run.rrd").series("theta/node/2"), log.arrays["theta"][0, :5, 0])


def test_a_node_s_clock_that_was_put_back(tmp_path):
    """Its run is then another, which the recording does not have; it is not lost."""
    log = some(Log(nodes=5, steps=10, runs=2), [2])
    log.header["runs"] = 1
    whole = log.items()
    log.header["runs"] = 2
    items = [whole[0], *log.items()[1:]]
    (tmp_path / "run.cbor").write_bytes(b"".join(items))
    with live(tmp_path / "run.cbor", tmp_path / "run.rrd") as process:
        status, said = process.end()
    (kept,) = tmp_path.glob("*.part.cbor")
    assert status == 0 and "10 steps are of other runs" in said and "run.rrd: 10 steps, to step 9" in said and str(kept) in said
    assert kept.read_bytes() == b"".join(items)
    np.testing.assert_array_equal(Recording(tmp_path / "run.rrd").series("theta/node/2"), log.arrays["theta"][0, :, 0])


def free_port() -> int:
    with socket.socket(type=socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def test_steps_are_put_in_order_and_held_for_a_while_only():
    def give(now: float) -> list[int]:
        return [item for item, _ in order.ready(now)]

    def put(*steps: int, now: float) -> None:
        for step in steps:
            order.put((0, step), now, step, b"")

    order = Order()
    put(7, now=0.0)
    assert give(0.5 * HOLD_S) == []  # an earlier one may be on its way
    put(6, now=0.5 * HOLD_S)
    assert give(1.4 * HOLD_S) == [] and give(1.6 * HOLD_S) == [6, 7]
    put(8, now=1.6 * HOLD_S)
    assert give(1.6 * HOLD_S) == [8]  # follows
    put(11, 10, now=2.0 * HOLD_S)
    assert give(2.5 * HOLD_S) == []
    put(9, now=2.5 * HOLD_S)
    assert give(2.5 * HOLD_S) == [9, 10, 11]
    put(14, 10, 14, now=3.0 * HOLD_S)
    assert order.late == 2 and give(4.1 * HOLD_S) == [14] and order.missing == 2
    put(13, now=4.2 * HOLD_S)
    assert order.late == 3 and give(9.0 * HOLD_S) == []


def test_datagrams_of_two_nodes(tmp_path):
    """Lost, repeated, damaged and in another order; one node's first steps come before its header. What is recorded is what is made of the logs of
    both without the lost steps."""
    logs = {node: some(Log(nodes=5, steps=40), [node]) for node in (1, 3)}
    items = {node: log.items() for node, log in logs.items()}
    lost = {1: {5, 6, 20}, 3: {11}}
    port, draw = free_port(), random.Random(2)
    with live(f"udp:{port}", tmp_path / "run.rrd", "--wait", "2") as process:
        senders = {node: socket.socket(type=socket.SOCK_DGRAM) for node in items}
        for sender in senders.values():
            sender.connect(("127.0.0.1", port))
        senders[1].send(items[1][0])
        for first in range(0, 40, 4):
            sent = [(node, step) for node in items for step in range(first, first + 4) if step not in lost[node]]
            draw.shuffle(sent)
            for node, step in sent:
                senders[node].send(items[node][1 + step])
            if first == 8:
                senders[3].send(items[3][0])
            if first == 16:
                senders[1].send(items[1][3])  # long over
                senders[1].send(b"\xa1\xff")
            # Within a group the order is lost, and the groups are further apart than steps wait for each other.
            time.sleep(0.15)
        for node, sender in senders.items():
            sender.send(items[node][0])
            sender.send(items[node][-1])
            sender.close()
        status, said = process.end()
    assert status == 0
    assert "4 steps lost, or left out by their nodes" in said and "1 steps that came twice or too late" in said and "1 damaged datagrams" in said
    for node in items:
        left = [items[node][1 + step] for step in range(40) if step not in lost[node]]
        (tmp_path / f"{node}.cbor").write_bytes(b"".join([items[node][0], *left, ended("complete", len(left))]))
    assert command(tmp_path / "1.cbor", tmp_path / "3.cbor", "-o", tmp_path / "offline.rrd").returncode == 0
    same(tmp_path / "run.rrd", tmp_path / "offline.rrd")


def test_steps_of_nodes_are_joined_as_those_of_files():
    """But for the places of nodes that say nothing, which files leave out. A step waits for nodes that speak, not for those that do not."""
    logs = {node: some(Log(nodes=5, steps=6), [node]) for node in (1, 3)}
    readers = {node: LogReader(io.BufferedReader(io.BytesIO(log.data()))) for node, log in logs.items()}
    joining = Joining(readers[1].header)
    assert joining.header.estimator_nodes == (0, 1, 2, 3, 4) and joining.header.slots == tuple(tuple(s) for s in Log(nodes=5).header["slots"])
    steps = {node: list(reader.steps()) for node, reader in readers.items()}
    assert all(joining.node(node, reader.header) for node, reader in readers.items())
    out = []
    for t in range(6):
        joining.put(1, steps[1][t], 10.0)
        if t == 0:
            assert len(joining.ready(10.01)) == 1  # node 3 has not spoken yet
            joining.put(3, steps[3][0], 10.02)
            assert joining.ready(10.02) == [] and joining.late == 1
            continue
        assert joining.ready(10.02) == []
        if t != 4:
            joining.put(3, steps[3][t], 10.03)
        out += joining.ready(10.04)
    assert [item["step"] for item in out] == [1, 2, 3, 4, 5]
    whole = JoinedReader({str(node): LogReader(io.BufferedReader(io.BytesIO(log.data()))) for node, log in logs.items()})
    for item, expected in zip(out, list(whole.steps())[1:]):
        if item["step"] != 4:
            for key in ("theta", "estimate", "nis"):
                wide = item[key].reshape(5, -1)
                np.testing.assert_array_equal(wide[[1, 3]], expected[key].reshape(2, -1))
                assert np.isnan(wide[[0, 2, 4]]).all()
            np.testing.assert_array_equal(item["measurements"], expected["measurements"])


@pytest.mark.parametrize("source, message", [
    ("udp:nowhere", "port of udp"), ("udp:127.0.0.1:70000", "port of udp"), ("udp:192.0.2.1:7000", "udp:192.0.2.1:7000"),
])
def test_sources_that_are_none(tmp_path, source, message):
    with live(source, tmp_path / "run.rrd") as process:
        status, said = process.end()
    assert status == 2 and message in said and said.count("\n") == 1
