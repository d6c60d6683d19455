# SPDX-License-Identifier: MIT
"""A folder of results for each seed. A failure belongs to its seed, and is told with the table: the others go on."""

import json
import shutil
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from program import ReproduceError


def compute(out: Path, seeds: range, jobs: int, run: Callable[[Path, int], None]) -> None:
    """run(folder, seed) for each, into an empty folder. Threads suffice, the work is in the program."""

    def one(seed: int) -> None:
        folder = folder_of(out, seed)
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        try:
            run(folder, seed)
        except ReproduceError as error:
            (folder / "error.txt").write_text(f"{error}\n")

    with ThreadPoolExecutor(jobs) as pool:
        list(pool.map(one, seeds))


def folder_of(out: Path, seed: int) -> Path:
    return out / "draws" / f"seed-{seed}"


def load(out: Path, seeds: range, read: Callable[[Path, int], Any]) -> tuple[list[Any], dict[int, str]]:
    """read(folder, seed) for each, and for each seed that has no result, why."""
    draws, errors = [], {}
    for seed in seeds:
        folder = folder_of(out, seed)
        try:
            if (folder / "error.txt").exists():
                raise ReproduceError((folder / "error.txt").read_text().strip())
            draws.append(read(folder, seed))
        except ReproduceError as error:
            errors[seed] = str(error)
        except KeyError as error:
            errors[seed] = f"{folder}: a result has no {error}"
    return draws, errors


def read_json(path: Path) -> dict:
    try:
        return json.loads(path.read_text())
    except (OSError, ValueError) as error:
        raise ReproduceError(f"cannot read {path}: {error}") from None
