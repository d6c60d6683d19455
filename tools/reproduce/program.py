# SPDX-License-Identifier: MIT
"""Runs the host program."""

import subprocess
from pathlib import Path


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

    def beside(self, name: str, text: str) -> str:
        """What another program, built beside this one, answers to a text."""
        path = self.path.with_name(name)
        if not path.is_file():
            raise ReproduceError(f"no program at {path}: run make all")
        return _run([str(path)], f"{name}: ", text)


def _run(command: list[str], name: str, text: str | None = None) -> str:
    done = subprocess.run(command, input=text, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        said = done.stderr.strip().splitlines()[-1:] or [f"exit status {done.returncode}"]
        raise ReproduceError(name + said[0].removeprefix("meshkal: ").removeprefix(name))
    return done.stdout
