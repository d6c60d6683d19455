# SPDX-License-Identifier: MIT
"""Runs the host program."""

import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, BinaryIO


class ReproduceError(Exception):
    """Something could not be computed or read. The message is one line for the user."""


class Program:
    def __init__(self, path: Path) -> None:
        self.path = path.resolve()
        if not self.path.is_file():
            raise ReproduceError(f"no program at {path}: run make all, or give --meshkal")

    def __call__(self, *arguments: object) -> str:
        """Standard output. A failure is an error that repeats what the program said."""
        words = [str(a) for a in arguments]
        return _run([str(self.path), *words], f"meshkal {words[0]}: ")

    def reading(self, read: Callable[[BinaryIO], Any], *arguments: object) -> Any:
        """read(standard output), while the program writes it. The program's failure comes before one of reading."""
        words = [str(a) for a in arguments]
        with tempfile.TemporaryFile("w+") as said, subprocess.Popen([str(self.path), *words], stdout=subprocess.PIPE, stderr=said) as process:
            try:
                result, error = read(process.stdout), None
            except ReproduceError as failure:
                result, error = None, failure
            process.stdout.close()
            status = process.wait()
            said.seek(0)
            if status != 0:
                raise _failure(f"meshkal {words[0]}: ", said.read(), status)
        if error:
            raise error
        return result

    def beside(self, name: str, text: str) -> str:
        """What another program, built beside this one, answers to a text."""
        path = self.path.with_name(name)
        if not path.is_file():
            raise ReproduceError(f"no program at {path}: run make all")
        return _run([str(path)], f"{name}: ", text)


def _run(command: list[str], name: str, text: str | None = None) -> str:
    done = subprocess.run(command, input=text, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise _failure(name, done.stderr, done.returncode)
    return done.stdout


def _failure(name: str, text: str, status: int) -> ReproduceError:
    said = text.strip().splitlines()[-1:] or [f"exit status {status}"]
    return ReproduceError(name + said[0].removeprefix("meshkal: ").removeprefix(name))
