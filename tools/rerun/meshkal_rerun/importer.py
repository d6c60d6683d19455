# SPDX-License-Identifier: MIT
"""What the viewer calls for each file that it opens: a run log goes to standard output as a recording. Exit status: 0 done, 66 the file is none of ours,
1 it is a log and could not be read whole; what was readable is there, and the viewer shows what standard error says."""

import argparse
import os
import select
import stat
import sys
import threading
import time
from pathlib import Path

# Nothing that takes long is imported here: the viewer asks for every file, and waits.

EXIT_DAMAGED = 1
EXIT_NOT_OURS = 66

# The first key of the header and its value, in CBOR, behind what begins a map: one byte, or with a long count in it more.
_MAGIC = b"\x66format\x6bmeshkal-log"
_MAP_MAJOR_TYPE = 5
_LONG_COUNTS = {24: 2, 25: 3, 26: 5, 27: 9}
# The viewer may have all it wants a little before this program ends.
_GRACE_S = 2.0


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="rerun-importer-meshkal", description="Lets the rerun viewer open Meshkal run logs: with this program on the PATH, "
                                     "rerun run.cbor shows it. Writes the recording of run 0 to standard output.")
    parser.add_argument("path", type=Path)
    parser.add_argument("--recording-id", help="of the recording; the viewer gives one")
    # What else the viewer says is about files that have no times and no entities of their own.
    options, _ = parser.parse_known_args(arguments)
    if not is_log(options.path):
        return EXIT_NOT_OURS
    # The viewer has ended, or is to end.
    try:
        return _to_stdout(options)
    except KeyboardInterrupt:
        return 130


def _end_with_the_viewer() -> None:
    """rerun waits for ever for a thread of its own that could neither write to a viewer that is gone nor tell it so."""
    output = select.poll()
    output.register(1, 0)
    output.poll()
    time.sleep(_GRACE_S)
    os._exit(EXIT_DAMAGED)


def is_log(path: Path) -> bool:
    """Whether its first bytes are those of a run log."""
    try:
        # Opening a FIFO waits for its other end.
        if not stat.S_ISREG(os.stat(path).st_mode):
            return False
        with open(path, "rb") as file:
            first = file.read(max(_LONG_COUNTS.values()) + len(_MAGIC))
    except (OSError, ValueError):
        return False
    return bool(first) and first[0] >> 5 == _MAP_MAJOR_TYPE and first.startswith(_MAGIC, _LONG_COUNTS.get(first[0] & 31, 1))


def _to_stdout(options: argparse.Namespace) -> int:
    from contextlib import ExitStack

    import rerun as rr

    from meshkal_log.reader import LogError

    from .conversion import Logs, Wanted, convert_logs
    from .recording.output import recording_to_stdout

    rr.set_strict_mode(True)
    threading.Thread(target=_end_with_the_viewer, daemon=True).start()
    # An id of its own each time: what is opened again is shown beside what was there, and not added to it.
    into = recording_to_stdout if options.recording_id is None else lambda _, blueprint: recording_to_stdout(options.recording_id, blueprint)
    try:
        with open(options.path, "rb") as stream, ExitStack() as keep:
            logs = Logs({str(options.path): stream}, keep)
            done = convert_logs(logs, into, Wanted())
    except (LogError, OSError) as error:
        print(f"{options.path}: {error}", file=sys.stderr)
        return EXIT_DAMAGED
    for remark in done.remarks:
        print(f"{options.path}: {remark}", file=sys.stderr)
    return EXIT_DAMAGED if logs.damage else 0


if __name__ == "__main__":
    sys.exit(main())
