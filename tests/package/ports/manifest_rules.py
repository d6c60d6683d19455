#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""What two package systems demand, whose own checkers no package registry has. Usage: manifest_rules.py zephyr|arduino DIRECTORY

Written after Zephyr's documentation of modules and the Arduino library specification; the directory is a package as make dist lays it out.
Prints every violation; exit status 1 if there is one."""
import pathlib
import re
import sys

from ruamel.yaml import YAML

SEMVER = re.compile(r"(0|[1-9]\d*)\.(0|[1-9]\d*)\.(0|[1-9]\d*)$")
CATEGORIES = {"Display", "Communication", "Signal Input/Output", "Sensors", "Device Control", "Timing", "Data Storage", "Data Processing", "Other"}


def zephyr(root):
    """zephyr/module.yml: only known keys; the directories it names, relative to the module, hold CMakeLists.txt and a Kconfig file."""
    meta = YAML(typ="safe").load(root / "zephyr/module.yml")
    yield from (f"unknown key {key}" for key in set(meta) - {"name", "build", "tests", "samples", "boards", "blobs"})
    build = meta.get("build", {})
    yield from (f"unknown key build: {key}" for key in set(build) - {"cmake", "kconfig", "depends", "settings"})
    yield from (f"{key} is no text" for key in ("cmake", "kconfig") if not isinstance(build.get(key), str))
    if not re.fullmatch(r"[a-z][a-z0-9_-]*", str(meta.get("name"))):
        yield "name"
    for path in (root / str(build.get("cmake")) / "CMakeLists.txt", root / str(build.get("kconfig"))):
        if not path.is_file():
            yield f"{path} is not there"


def arduino(root):
    """library.properties: the fields of the specification; layout 1.5: sources in src/ only, the headers of includes= at its top."""
    lines = [line for line in (root / "library.properties").read_text().splitlines() if line and not line.startswith("#")]
    fields = dict(line.split("=", 1) for line in lines)
    if len(fields) != len(lines):
        yield "a field is given twice"
    for key in ("name", "version", "author", "maintainer", "sentence", "paragraph", "category", "url", "architectures"):
        if not fields.get(key):
            yield f"{key} is missing"
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_.-]{0,62}", fields.get("name", "")) or re.search("arduino", fields.get("name", ""), re.I):
        yield "name"
    if not SEMVER.match(fields.get("version", "")):
        yield "version"
    if fields.get("category") not in CATEGORIES:
        yield "category"
    if not re.match(r"https?://\S+$", fields.get("url", "")):
        yield "url"
    if not re.fullmatch(r"\*|[a-z0-9_]+(,[a-z0-9_]+)*", fields.get("architectures", "")):
        yield "architectures"
    if fields.get("paragraph", "").startswith(fields.get("sentence", "?")):
        yield "paragraph repeats the sentence"
    for header in fields.get("includes", "").split(","):
        if not (root / "src" / header).is_file():
            yield f"includes={header}: not in src/"
    if not (root / "src").is_dir() or list(root.glob("*.[ch]*")):
        yield "sources stand beside src/"


if __name__ == "__main__":
    violations = list({"zephyr": zephyr, "arduino": arduino}[sys.argv[1]](pathlib.Path(sys.argv[2])))
    print("\n".join(violations))
    sys.exit(bool(violations))
