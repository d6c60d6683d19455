# SPDX-License-Identifier: MIT
"""Files and folders that are written whole or not at all: beside the place where they belong, and renamed when they are whole."""

import os
import shutil
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path


def _beside(output: Path, ending: str) -> Path:
    # In the same directory, so that the rename is one step of the file system.
    return output.with_name(f".{output.name}.{os.getpid()}.{ending}")


@contextmanager
def whole_file(output: Path) -> Iterator[Path]:
    """An empty file to write to. `output` is there when the block ends without an exception, and is as it was otherwise. Raises OSError."""
    if output.is_dir():
        raise IsADirectoryError(f"{output} is a directory")
    temporary = _beside(output, "tmp")
    try:
        try:
            # Where the file cannot be made, Python says so more clearly than what will write to it.
            temporary.touch()
        except OSError as error:
            raise OSError(f"{output} cannot be written: {error.strerror}") from None
        yield temporary
        os.replace(temporary, output)
    finally:
        temporary.unlink(missing_ok=True)


@contextmanager
def whole_folder(output: Path, own: Collection[str]) -> Iterator[Path]:
    """The same of a folder. One that is there is replaced if all that is in it has a name of `own`; otherwise OSError is raised."""
    _check_replaceable(output, own)
    temporary, old = _beside(output, "tmp"), _beside(output, "old")
    try:
        temporary.mkdir()
        yield temporary
        _check_replaceable(output, own)
        try:
            if output.exists():
                os.rename(output, old)
            os.rename(temporary, output)
        except BaseException:
            if old.exists() and not output.exists():
                os.rename(old, output)
            raise
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
        if output.exists():
            shutil.rmtree(old, ignore_errors=True)


def _check_replaceable(output: Path, own: Collection[str]) -> None:
    if not output.exists():
        return
    if not output.is_dir():
        raise NotADirectoryError(f"{output} is there and is not a folder")
    others = sorted(entry.name for entry in output.iterdir() if entry.name not in own or not entry.is_file())
    if others:
        raise FileExistsError(f"{output} has other files ({others[0]}); name a folder that is empty or not there")
