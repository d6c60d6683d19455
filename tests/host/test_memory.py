# SPDX-License-Identifier: MIT
"""Memory of meshkal simulate against the number of nodes: the number that the README states."""
import json

import pytest

SMALL, LARGE = 1000, 50000
# Measured 1173 and 861 (mean degree 4), and a tenth more.
MOST = {"float64": 1290, "float32": 950}


@pytest.fixture(scope="module")
def networks(run, tmp_path_factory):
    folder = tmp_path_factory.mktemp("memory")
    for count in (SMALL, LARGE):
        (folder / f"{count}.json").write_bytes(run("scenario", "projectile", "--nodes", count).stdout)
    return folder


@pytest.mark.parametrize("real", MOST)
def test_bytes_a_node(program, run, networks, real):
    if "sanitize" in program:
        pytest.skip("the sanitizer keeps freed memory")
    peak = []
    for count in (SMALL, LARGE):
        run("simulate", networks / f"{count}.json", "--real", real, "--steps", 4, "--json", networks / "out.json")
        peak.append(json.loads((networks / "out.json").read_text())["peak_memory_bytes"])
    assert 0.5 * MOST[real] < (peak[1] - peak[0]) / (LARGE - SMALL) < MOST[real]
