# SPDX-License-Identifier: MIT
"""`meshkal-rerun --live SOURCE -o RUN.rrd`. Exit status: 0 the run has ended; 1 the source was lost or is damaged; 2 nothing could be written; 130 or
143 ended by Ctrl-C or SIGTERM. What came by then is in the recording in all cases but 2; after a second signal it is kept as a log."""

import argparse
import os
import socket
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path

import rerun as rr

from meshkal_log.interrupts import Interrupts
from meshkal_log.reader import LogError
from .. import conversion
from .datagrams import Datagrams
from .keeping import Keeping
from .options import LOCAL
from .queue import DropOldest
from .sources import File, Pipe, Source, UnixSocket
from .status import Status
from .viewers import Viewers

PROGRAM = "meshkal-rerun"
EXIT_PART, EXIT_BAD = 1, 2
_POLL_S = 0.1
# In a pipe, Ctrl-C reaches the simulator too: it has so long to end its log.
_GRACE_S = 3.0
_LAST_SHOW_S = 3.0
_QUEUE_BYTES = 64 << 20


def main(options: argparse.Namespace) -> int:
    """options: those of options.py, and output, run, view, node. Does not return if a viewer holds up the end of the process."""
    try:
        with Interrupts(stay=True) as interrupts, ExitStack() as close:
            return _Session(options, interrupts, close).go()
    except (LogError, OSError) as error:
        _say(f"{options.live}: {error}" if isinstance(error, LogError) else str(error))
        return EXIT_BAD


class _Session:
    def __init__(self, options: argparse.Namespace, interrupts: Interrupts, close: ExitStack) -> None:
        self._options, self._interrupts, self._close = options, interrupts, close
        if not options.output:
            raise LogError("a recording of a live run needs a name: -o RUN.rrd")
        self._output = Path(options.output)
        _check_output(self._output)
        self._source = _source(options.live)
        interrupts.spare = isinstance(self._source, Pipe)
        self._left = None  # when Ctrl-C was left to who writes into the pipe
        close.callback(self._source.close)
        if options.bind != LOCAL:
            _say(f"warning: viewers are served on {options.bind}: whoever reaches it sees all, and can send, too")
        port = _free_port(options.bind, options.port)
        self._url = f"rerun+http://{LOCAL if options.bind in ('0.0.0.0', '::') else options.bind}:{port}/proxy"
        rr.set_strict_mode(True)
        sink = rr.GrpcServerSink(options.bind, port, server_memory_limit=options.memory)
        self._queue = DropOldest(options.queue, _QUEUE_BYTES)
        self._viewers = Viewers(self._queue, sink, options.run, options.view, options.window)
        self._keeping = Keeping(self._source, self._output, options, self._queue, self._viewers)
        self._status = Status(self._keeping, self._queue, self._viewers, self._source)

    def go(self) -> int:
        self._viewers.start()
        print(f"{PROGRAM}: to look at it:  rerun --connect {self._url}", file=sys.stderr, flush=True)
        if self._options.spawn:
            _spawn(self._url)
        can_end = True
        try:
            status, reason = self._take()
            stopped = status >= 128
            can_end = self._viewers.finish("interrupted" if stopped else self._keeping.end, _LAST_SHOW_S)
            status = self._record(status, reason, stopped)
        except KeyboardInterrupt:  # one more signal
            self._say_kept()
            status = self._interrupts.exit_status
        if not can_end:
            # A viewer that has stopped would hold up rerun's own end for as long as it is there.
            self._close.close()
            sys.stderr.flush()
            os._exit(status)
        return status

    def _take(self) -> tuple[int, str]:
        """Until the end; how it ended."""
        try:
            while not self._source.over:
                self._keeping.poll(_POLL_S)
                self._status.show()
                if self._stopped():
                    self._keeping.finish()
                    return self._interrupts.exit_status, f"stopped by {self._interrupts.name if self._interrupts.came else 'Ctrl-C'}"
                if self._options.wait is not None and time.monotonic() - self._keeping.heard > self._options.wait:
                    break
            self._keeping.finish()
        except LogError as error:
            return EXIT_PART, str(error)
        except OSError as error:
            return EXIT_PART, f"what comes cannot be kept: {error.strerror or error}"
        finally:
            self._status.close()
        if self._keeping.ended:
            return (EXIT_PART, "the run failed: a node could not go on") if self._keeping.end == "failed" else (0, "")
        return EXIT_PART, f"the source was lost: nothing comes from {self._options.live}, and its log has no end item"

    def _stopped(self) -> bool:
        """Ctrl-C in a pipe is left to who writes into it, for a while."""
        if isinstance(self._source, Pipe) and not self._interrupts.spare and self._left is None:
            self._left = time.monotonic()
        return self._interrupts.came or (self._left is not None and time.monotonic() - self._left > _GRACE_S)

    def _record(self, status: int, reason: str, stopped: bool) -> int:
        """The recording as it is made of files, out of what was kept."""
        keeping = self._keeping
        if reason:
            _say(f"{self._options.live}: {reason}")
        for remark in self._remarks():
            _say(f"{self._options.live}: {remark}")
        for log in keeping.logs.values():
            # Of several nodes, those that have not said their end have been interrupted, too.
            log.close("interrupted" if stopped and not log.end else log.end)
        if not keeping.steps:
            for log in keeping.logs.values():
                log.path.unlink(missing_ok=True)
            _say(f"{self._options.live}: no step has come; nothing is written")
            return status if stopped else EXIT_BAD
        try:
            try:
                self._convert(self._options.view)
            except LogError as error:
                if not self._options.view:
                    raise
                _say(f"{self._output}: {error}; its own view is in front")
                self._convert(None)
        except (LogError, OSError) as error:
            _say(f"{self._output}: {error}")
            self._say_kept()
            return EXIT_PART
        recorded = keeping.steps - keeping.other_runs
        _say(f"{self._output}: {recorded} steps{f', to step {keeping.last_step}' if recorded else ''}")
        if keeping.other_runs and keeping.from_nodes:
            # A clock was put back, and nothing else has what came afterwards.
            self._say_kept()
        else:
            for log in keeping.logs.values():
                log.path.unlink()
        return status

    def _convert(self, view: str | None) -> None:
        keeping = self._keeping
        wanted = conversion.Wanted(self._options.run, view, keeping.nodes_of_recording())
        with ExitStack() as files:
            streams = {str(log.path): files.enter_context(open(log.path, "rb")) for log in keeping.logs.values() if log.steps}
            conversion.convert(streams, self._output, wanted)

    def _remarks(self) -> list[str]:
        out = self._keeping.remarks()
        if self._queue.dropped:
            out.append(f"{self._queue.dropped} steps were not shown live: a viewer was too slow; the recording has them")
        if self._keeping.other_runs:
            out.append(f"{self._keeping.other_runs} steps are of other runs than {self._options.run}, and neither shown nor recorded")
        if self._viewers.failure:
            out.append(f"nothing was shown live any more: {self._viewers.failure}")
        return out

    def _say_kept(self) -> None:
        for log in self._keeping.logs.values():
            _say(f"what came is kept as a log: {log.path}")


def _source(text: str) -> Source:
    if text == "-":
        return Pipe(sys.stdin.fileno())
    if text.startswith("unix:"):
        return UnixSocket(text[5:])
    if text.startswith("udp:"):
        host, _, port = text[4:].rpartition(":")
        host = host.removeprefix("[").removesuffix("]") or LOCAL
        if not port.isdecimal() or int(port) > 65535:
            raise LogError("the port of udp:[HOST:]PORT is a number up to 65535")
        try:
            return Datagrams(host, int(port))
        except OSError as error:
            raise OSError(f"{text}: {error.strerror or error}") from None
    if Path(text).is_dir():
        raise LogError("it is a directory")
    return File(Path(text))


def _check_output(output: Path) -> None:
    if output.is_dir():
        raise IsADirectoryError(f"{output} is a directory")
    folder = output.parent
    if not os.access(folder, os.W_OK | os.X_OK):
        raise OSError(f"{output} cannot be written: {folder} is not there, or not writable")


def _free_port(bind: str, port: int) -> int:
    """rerun says only in a log that a port is taken."""
    family = socket.AF_INET6 if ":" in bind else socket.AF_INET
    with socket.socket(family) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((bind, port))
            probe.listen()
        except OSError as error:
            raise OSError(f"viewers cannot be served on {bind}, port {port}: {error.strerror}; --port 0 takes a free one") from None
        return probe.getsockname()[1]


def _spawn(url: str) -> None:
    import rerun_cli

    # It stays when this program ends, and does not get its Ctrl-C.
    program = Path(rerun_cli.__file__).with_name("rerun")
    quiet = {"stdin": subprocess.DEVNULL, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    subprocess.Popen([program, "--connect", url, "--bind", LOCAL], start_new_session=True, **quiet)


def _say(text: str) -> None:
    print(f"{PROGRAM}: {text}", file=sys.stderr)
