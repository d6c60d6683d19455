#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Writes the node library as one pair of files, for projects that copy sources. Usage: amalgamate.py DIRECTORY

    DIRECTORY/meshkal.h      every public header and the kernels, which MK_RKFD_UNROLLED compiles in the caller's unit
    DIRECTORY/meshkal.c      what libmeshkal.a holds; includes meshkal.h
    DIRECTORY/meshkal/*.h    one line each: #include <meshkal/rkfd.h> and generated node headers compile unchanged

What belongs to it follows from the include lines. A header with a guard is expanded where it is first met. A file without one (templates,
real.h) is compiled once for each precision, so it is expanded at every place that includes it. Only standard headers stay as they are."""
import pathlib
import re
import sys

ROOT = pathlib.Path(__file__).resolve().parents[2]
SEARCH = [ROOT / "include", ROOT / "src"]
# Headers that a freestanding compiler has, and the two that the node library may ask of a C library.
STANDARD = {"float.h", "iso646.h", "limits.h", "stdalign.h", "stdarg.h", "stdbool.h", "stddef.h", "stdint.h", "string.h", "math.h"}
# Arduino's builder takes no compiler flags from a library. Nothing is restored at the end: macros put kernels into what follows.
CONTRACTION = """#ifdef ARDUINO
#if defined(__clang__)
#pragma STDC FP_CONTRACT OFF
#elif defined(__GNUC__)
#pragma GCC optimize("fp-contract=off")
#endif
#endif

"""
INCLUDE = re.compile(r'\s*#\s*include\s*([<"])([^>"]+)[>"]')
GUARD = re.compile(r"\A(?:\s|/\*.*?\*/|//[^\n]*)*#\s*ifndef\s+(\w+)\s+#\s*define\s+\1\b", re.S)
SPDX = re.compile(r"/\* SPDX-License-Identifier: MIT \*/\n")


def fail(path, number, message):
    sys.exit(f"amalgamate: {path.relative_to(ROOT)}:{number}: {message}")


def has_guard(path):
    return GUARD.match(path.read_text()) is not None


def resolve(path, number, quote, name):
    """The file of the tree that an include line means; none for a standard header."""
    places = [path.parent] if quote == '"' else []
    for place in places + SEARCH:
        if (place / name).is_file():
            return (place / name).resolve()
    if name not in STANDARD:
        fail(path, number, f"#include {name}: neither a file of the node library nor a header that it may use")
    return None


def expand(path, done):
    """Text of a file with its includes expanded; `done` holds the guarded headers that stand further up."""
    guarded = has_guard(path)
    lines = [f"/* ---- {path.relative_to(ROOT).as_posix()} ---- */\n"]
    depth = 0
    for number, line in enumerate(SPDX.sub("", path.read_text(), count=1).splitlines(keepends=True), 1):
        found = INCLUDE.match(line)
        directive = re.match(r"\s*#\s*(\w+)", line)
        if not found:
            word = directive.group(1) if directive else ""
            if word == "include":
                fail(path, number, "an include line whose file is a macro cannot be expanded")
            depth += word.startswith("if") - (word == "endif")
            lines.append(line)
            continue
        target = resolve(path, number, *found.groups())
        if target is None:
            lines.append(line)
        elif not has_guard(target):
            lines.append(expand(target, done))
        elif target not in done:
            # Where the condition is false, the place that stands for all later ones would be empty.
            if depth > guarded:
                fail(path, number, "a header with a guard is included under a condition: include it before")
            done.add(target)
            lines.append(expand(target, done))
    text = "".join(lines)
    return text if text.endswith("\n") else text + "\n"


def main():
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    out = pathlib.Path(sys.argv[1])
    version = re.search(r'#define MK_VERSION "(.*)"', (ROOT / "include/meshkal/base.h").read_text()).group(1)
    licence = "".join(f" * {line}".rstrip() + "\n" for line in (ROOT / "LICENSE").read_text().splitlines())
    title = f"/* SPDX-License-Identifier: MIT */\n/* Meshkal {version}, all of the node library: %s\n *\n{licence} */\n"

    # Templates are no headers of their own; what lies deeper in src is private to its layer.
    public = [p for p in sorted((ROOT / "include/meshkal").rglob("*.h")) + sorted((ROOT / "src/meshkal").glob("*.h")) if has_guard(p)]
    done, header = set(), []
    for path in public:
        if path not in done:
            done.add(path)
            header.append(expand(path, done))
    # The unit that keeps loops comes first: it says so before any kernel.
    units = sorted((ROOT / "src/meshkal").rglob("*.c"), key=lambda p: ("#define MK_ROLLED" not in p.read_text(), p))
    source = [expand(path, done) for path in units]

    (out / "meshkal").mkdir(parents=True, exist_ok=True)
    for old in (out / "meshkal").rglob("*.h"):
        old.unlink()
    (out / "meshkal.h").write_text("".join([title % "public headers and kernels.", "#ifndef MESHKAL_AMALGAMATION_H\n#define MESHKAL_AMALGAMATION_H\n\n",
                                            CONTRACTION, "\n".join(header), "\n#endif\n"]))
    (out / "meshkal.c").write_text("".join([title % "the functions. Compile with -ffp-contract=off.", '#define MK_ROLLED\n#include "meshkal.h"\n\n',
                                            "\n".join(source)]))
    for path in public:
        name = path.relative_to(ROOT / ("include" if path.is_relative_to(ROOT / "include") else "src"))
        up = "../" * (len(name.parts) - 1)
        (out / name).parent.mkdir(parents=True, exist_ok=True)
        (out / name).write_text(f'/* SPDX-License-Identifier: MIT */\n#include "{up}meshkal.h"\n')


if __name__ == "__main__":
    main()
