# SPDX-License-Identifier: MIT
"""Logs of some nodes of a network, as running nodes write them."""

from contextlib import ExitStack

import numpy as np
import pytest
from readback import Recording, command, convert
from synthetic import Log

from meshkal_log.joined import JoinedReader
from meshkal_log.reader import LogReader

KEEP = [1, 3]


def some(log: Log, keep: list[int] = KEEP) -> Log:
    """The same log with the estimators of some nodes of the network only."""
    n = log.header["states"]
    first = np.concatenate(([0], np.cumsum([len(s) for s in log.header["slots"]])))
    slots = np.concatenate([np.arange(first[k], first[k + 1]) for k in keep])
    own = np.concatenate(([0], np.cumsum(log.header["rows"])))
    for key, values in log.arrays.items():
        width = values.shape[2] // log.header["estimators"]
        if key in ("measurements_arrived", "estimates_arrived"):
            log.arrays[key] = values[:, :, slots]
        elif key.startswith("innovation"):
            log.arrays[key] = values[:, :, np.concatenate([np.arange(own[k], own[k + 1]) for k in keep])]
        elif key not in ("measurements", "truth"):
            log.arrays[key] = np.concatenate([values[:, :, k * width : (k + 1) * width] for k in keep], axis=2)
    assert log.arrays["estimate"].shape[2] == n * len(keep)
    log.header |= {"estimators": len(keep), "estimator_nodes": keep, "slots": [log.header["slots"][k] for k in keep], "source": "live"}
    return log


def test_each_quantity_is_the_right_node_s(tmp_path):
    whole, _ = convert(Log(nodes=5).data(), tmp_path / "whole.rrd")
    part, remarks = convert(some(Log(nodes=5)).data(), tmp_path / "part.rrd")
    assert not remarks
    for k in KEEP:
        for quantity in ("error_db", "theta", "tolerance", "nis_ratio", "missing_measurements", "missing_estimates"):
            np.testing.assert_array_equal(part.series(f"{quantity}/node/{k}"), whole.series(f"{quantity}/node/{k}"))
    assert not {f"theta/node/{k}" for k in range(5) if k not in KEEP} & part.entities()
    # The picture still has all nodes; those without an estimator are grey.
    colours = part.rows("network/nodes", "Points2D:colors")[2]
    assert all(len(row) == 5 and row[0] == row[2] == row[4] and row[1] != row[0] != row[3] for row in colours)
    assert "node 1, node 3" in part.summary() and "from a running node" in part.summary()


def test_a_repeated_header_is_left_out(tmp_path):
    items = some(Log(nodes=5)).items()
    _, remarks = convert(b"".join([items[0], *items[1:4], items[0], *items[4:]]), tmp_path / "log.rrd")
    assert not remarks


@pytest.mark.parametrize("nodes", [[3, 1], [1, 1], [1], [1, 5], [1, -1], "no"])
def test_wrong_nodes(tmp_path, nodes):
    from meshkal_log.reader import LogError

    log = some(Log(nodes=5))
    log.header["estimator_nodes"] = nodes
    with pytest.raises(LogError, match="estimator_nodes"):
        convert(log.data(), tmp_path / "log.rrd")
    assert not (tmp_path / "log.rrd").exists()


def one_by_one(tmp_path, nodes=5, rows=1, old=()):
    """Logs of all nodes of the same run, each its own; node 2 is away for three steps and has two logs. old: nodes whose logs are of an older program."""
    names = []
    for k in range(nodes):
        for part in range(2 if k == 2 else 1):
            items = some(Log(nodes=nodes, rows=rows, truth=False, bands=k not in old), [k]).items()
            path = tmp_path / f"{k}-{part}.cbor"
            path.write_bytes(b"".join(items if k != 2 else items[:5] if part == 0 else [items[0], *items[8:]]))
            names.append(path)
    return names


def test_logs_of_all_nodes_are_one(tmp_path):
    whole, _ = convert(Log(nodes=5, truth=False).data(), tmp_path / "whole.rrd")
    done = command(*one_by_one(tmp_path), "-o", tmp_path / "joined.rrd")
    assert done.returncode == 0 and done.stderr.count(b"\n") == 2 and b"2-0.cbor: the log was cut" in done.stderr, done.stderr
    joined = Recording(tmp_path / "joined.rrd")
    for k in range(5):
        for quantity in ("theta", "tolerance", "nis_ratio", "trace_covariance", "missing_measurements"):
            mine, all_ = joined.series(f"{quantity}/node/{k}"), whole.series(f"{quantity}/node/{k}")
            if k == 2:
                away = slice(4, 7)
                assert (mine[away] == 5).all() if quantity == "missing_measurements" else np.isnan(mine[away]).all()
                mine[away] = all_[away]
            np.testing.assert_array_equal(mine, all_)
    np.testing.assert_array_equal(joined.series("measurement/node/0"), whole.series("measurement/node/0"))


@pytest.mark.parametrize("old", [(), (1, 2), range(5)])
def test_bands_of_joined_logs(tmp_path, old):
    """Each node's numbers where it has them, in a network whose sensors differ; what no log has the joined one has not."""
    rows = (2, 1, 3, 1, 2)
    whole = Log(nodes=5, rows=rows, truth=False).arrays
    paths = one_by_one(tmp_path, rows=rows, old=old)
    with ExitStack() as stack:
        reader = JoinedReader({path.name: LogReader(stack.enter_context(path.open("rb"))) for path in paths})
        [batch] = reader.batches(0)
    keys = ("variance", "innovation", "innovation_variance")
    if len(old) == 5:
        assert all(getattr(batch, key) is None for key in keys)
        return
    node = {"variance": np.repeat(np.arange(5), 4), "innovation": np.repeat(np.arange(5), rows), "innovation_variance": np.repeat(np.arange(5), rows)}
    for key in keys:
        want = whole[key][0].copy()
        want[:, np.isin(node[key], old)] = np.nan
        want[4:7, node[key] == 2] = np.nan
        np.testing.assert_array_equal(getattr(batch, key).reshape(want.shape), want)
        assert np.isfinite(want).mean() > 0.4


def test_logs_of_two_networks(tmp_path):
    (tmp_path / "a.cbor").write_bytes(some(Log(nodes=5), [1]).data())
    (tmp_path / "b.cbor").write_bytes(some(Log(nodes=6), [2]).data())
    done = command(tmp_path / "a.cbor", tmp_path / "b.cbor", "-o", tmp_path / "c.rrd")
    assert done.returncode == 2 and b"does not belong to" in done.stderr and not (tmp_path / "c.rrd").exists()
    (tmp_path / "b.cbor").write_bytes(b"\xa1")
    done = command(tmp_path / "a.cbor", tmp_path / "b.cbor", "-o", tmp_path / "c.rrd")
    assert done.returncode == 2 and b"b.cbor: the input ends inside the header" in done.stderr, done.stderr
