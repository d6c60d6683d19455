# SPDX-License-Identifier: MIT
"""Runs tools/reproduce once, over few draws, with the program that MESHKAL names (default build/meshkal of this checkout)."""

import os

import pytest
from tool import MESHKAL, SEEDS, command


@pytest.fixture(scope="session")
def needs_program():
    if not os.access(MESHKAL, os.X_OK):
        message = f"no program at {MESHKAL}: build it or set MESHKAL"
        (pytest.fail if os.environ.get("MESHKAL_REQUIRED") == "1" else pytest.skip)(message)


@pytest.fixture(scope="session")
def reproduced(needs_program, tmp_path_factory):
    """(folder, finished process). Started in another directory, with a folder named relative to it."""
    elsewhere = tmp_path_factory.mktemp("elsewhere")
    done = command("--meshkal", MESHKAL, "--out", "of three/draws", "--draws", len(SEEDS), "--first-seed", SEEDS[0], cwd=elsewhere)
    return elsewhere / "of three" / "draws", done
