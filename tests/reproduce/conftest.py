# SPDX-License-Identifier: MIT
"""Runs tools/reproduce once, over few draws, with the program that MESHKAL names (default build/meshkal of this checkout)."""

import os

import pytest
from tool import BATCHES, MESHKAL, SEEDS, command


@pytest.fixture(scope="session")
def needs_program():
    if not os.access(MESHKAL, os.X_OK):
        message = f"no program at {MESHKAL}: build it or set MESHKAL"
        (pytest.fail if os.environ.get("MESHKAL_REQUIRED") == "1" else pytest.skip)(message)


@pytest.fixture(scope="session")
def reproduced(needs_program, tmp_path_factory):
    """(folder, finished process). Started in another directory, with a folder named relative to it."""
    elsewhere = tmp_path_factory.mktemp("elsewhere")
    done = command("local-tolerance", "--meshkal", MESHKAL, "--out", "of three/draws", "--draws", len(SEEDS), "--first-seed", SEEDS[0], cwd=elsewhere)
    return elsewhere / "of three" / "draws", done


@pytest.fixture(scope="session")
def incomplete(needs_program, tmp_path_factory):
    """Tracking with incomplete measurements, two batches; the second loses a target."""
    return _batches("incomplete-measurements", tmp_path_factory)


@pytest.fixture(scope="session")
def distributed(needs_program, tmp_path_factory):
    return _batches("distributed-unscented", tmp_path_factory)


@pytest.fixture(scope="session")
def slow(needs_program, tmp_path_factory):
    """Slow faults, 14 runs."""
    return _batches("slow-faults", tmp_path_factory)


def _batches(paper, tmp_path_factory):
    out = tmp_path_factory.mktemp(paper)
    return out, command(paper, "--meshkal", MESHKAL, "--out", out, "--draws", len(BATCHES), "--first-seed", BATCHES[0], cwd=out)
