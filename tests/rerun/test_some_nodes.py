# SPDX-License-Identifier: MIT
"""Logs of some nodes of a network, as running nodes write them."""

import numpy as np
import pytest
from readback import convert
from synthetic import Log

KEEP = [1, 3]


def some(log: Log) -> Log:
    """The same log with the estimators of two nodes of the network only."""
    n = log.header["states"]
    first = np.concatenate(([0], np.cumsum([len(s) for s in log.header["slots"]])))
    slots = np.concatenate([np.arange(first[k], first[k + 1]) for k in KEEP])
    for key, values in log.arrays.items():
        width = values.shape[2] // log.header["estimators"]
        if key in ("measurements_arrived", "estimates_arrived"):
            log.arrays[key] = values[:, :, slots]
        elif key not in ("measurements", "truth"):
            log.arrays[key] = np.concatenate([values[:, :, k * width : (k + 1) * width] for k in KEEP], axis=2)
    assert log.arrays["estimate"].shape[2] == n * len(KEEP)
    log.header |= {"estimators": len(KEEP), "estimator_nodes": KEEP, "slots": [log.header["slots"][k] for k in KEEP], "source": "live"}
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
    colours = part.rows("network/nodes", "GraphNodes:colors")[2]
    assert all(len(row) == 5 and row[0] == row[2] == row[4] and row[1] != row[0] != row[3] for row in colours)
    assert "node 1, node 3" in part.summary() and "from a running node" in part.summary()


def test_a_repeated_header_is_left_out(tmp_path):
    items = some(Log(nodes=5)).items()
    _, remarks = convert(b"".join([items[0], *items[1:4], items[0], *items[4:]]), tmp_path / "log.rrd")
    assert not remarks


@pytest.mark.parametrize("nodes", [[3, 1], [1, 1], [1], [1, 5], [1, -1], "no"])
def test_wrong_nodes(tmp_path, nodes):
    from meshkal_rerun.reader import LogError

    log = some(Log(nodes=5))
    log.header["estimator_nodes"] = nodes
    with pytest.raises(LogError, match="estimator_nodes"):
        convert(log.data(), tmp_path / "log.rrd")
    assert not (tmp_path / "log.rrd").exists()
