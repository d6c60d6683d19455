# SPDX-License-Identifier: MIT
"""`meshkal-rerun --live SOURCE -o RUN.rrd`. Exit status: 0 the run has ended, 1 the source was lost or is damaged, 2 nothing could be written,
130 ended by Ctrl-C or SIGTERM. What came by then is in the recording in all cases but 2."""

import argparse
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import rerun as rr

from meshkal_log.reader import LogError
from .. import conversion
from .datagrams import Datagrams
from .keeping import Keeping
from .queue import DropOldest
from .sources import File, Pipe, Source, UnixSocket
from .status import Status
from .viewers import Viewers

PROGRAM = "meshkal-rerun"
EXIT_PART, EXIT_BAD, EXIT_INTERRUPTED = 1, 2, 130
_LOCAL = "127.0.0.1"
_POLL_S = 0.1
# In a pipe, Ctrl-C reaches the simulator too: it has so long to end its log.
_GRACE_S = 3.0
_LAST_SHOW_S = 3.0
_QUEUE_ITEMS, _QUEUE_BYTES = 20000, 64 << 20


def add_arguments(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("while a run goes on")
    group.add_argument("--live", metavar="SOURCE", help="serve viewers and record: - (standard input), a file that grows, unix:PATH or udp:[HOST:]PORT, "
                       "the telemetry of meshkal-node (HOST: where to listen, default 127.0.0.1)")
    group.add_argument("--port", type=_port, default=9876, help="for viewers (default: 9876; 0: a free one)")
    group.add_argument("--bind", metavar="ADDRESS", default=_LOCAL, help="for viewers (default: 127.0.0.1; anyone who reaches another one sees all)")
    group.add_argument("--spawn", action="store_true", help="start a viewer")
    group.add_argument("--wait", type=_seconds, metavar="S", help="end when nothing has come for so long (default: at the end of the log or by Ctrl-C)")
    group.add_argument("--window", type=_seconds, default=60.0, metavar="S", help="time that plots show (default: 60)")
    group.add_argument("--memory", default="256MiB", help="kept for viewers that come later (default: 256MiB)")
    # Small queues show what is dropped when: for tests.
    group.add_argument("--queue", type=int, default=_QUEUE_ITEMS, help=argparse.SUPPRESS)


def main(options: argparse.Namespace) -> int:
    """options: those of `add_arguments`, and output, run, view, node. Does not return if a viewer holds up the end of the process."""
    try:
        with ExitStack() as close:
            return _Session(options, close).go()
    except (LogError, OSError) as error:
        _say(f"{options.live}: {error}" if isinstance(error, LogError) else str(error))
        return EXIT_BAD


class _Session:
    def __init__(self, options: argparse.Namespace, close: ExitStack) -> None:
        self._options, self._close = options, close
        if not options.output:
            raise LogError("a recording of a live run needs a name: -o RUN.rrd")
        self._output = Path(options.output)
        _check_output(self._output)
        self._signals = close.enter_context(_signals())
        self._source = _source(options.live)
        close.callback(self._source.close)
        if options.bind != _LOCAL:
            _say(f"warning: viewers are served on {options.bind}: whoever reaches it sees all, and can send, too")
        port = _free_port(options.bind, options.port)
        self._url = f"rerun+http://{_LOCAL if options.bind in ('0.0.0.0', '::') else options.bind}:{port}/proxy"
        rr.set_strict_mode(True)
        sink = rr.GrpcServerSink(options.bind, port, server_memory_limit=options.memory)
        self._queue = DropOldest(options.queue, _QUEUE_BYTES)
        self._viewers = Viewers(self._queue, sink, options.run, options.view, options.node, options.window)
        self._keeping = Keeping(self._source, self._output, options.run, self._queue, self._viewers)
        self._status = Status(self._keeping, self._queue, self._viewers, self._source)

    def go(self) -> int:
        self._viewers.start()
        print(f"{PROGRAM}: to look at it:  rerun {self._url}", file=sys.stderr, flush=True)
        if self._options.spawn:
            _spawn(self._url)
        status, reason = self._take()
        # A second signal ends the program at once from here on, and what is kept stays.
        self._signals.restore()
        can_end = True
        try:
            can_end = self._viewers.finish(self._end(status), _LAST_SHOW_S)
            status = self._record(status, reason)
        except KeyboardInterrupt:
            self._say_kept()
            status = EXIT_INTERRUPTED
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
                if self._signals.came and not self._left_to_pipe():
                    self._keeping.finish()
                    return (0, "") if self._source.over and self._keeping.ended else (EXIT_INTERRUPTED, f"stopped by {self._signals.name}")
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

    def _left_to_pipe(self) -> bool:
        pipe = isinstance(self._source, Pipe) and self._signals.number == signal.SIGINT and self._signals.count == 1
        return pipe and time.monotonic() - self._signals.when < _GRACE_S

    def _end(self, status: int) -> str | None:
        return "interrupted" if status == EXIT_INTERRUPTED else self._keeping.end

    def _record(self, status: int, reason: str) -> int:
        """The recording as it is made of files, out of what was kept."""
        keeping = self._keeping
        if reason:
            _say(f"{self._options.live}: {reason}")
        for remark in self._remarks():
            _say(f"{self._options.live}: {remark}")
        for log in keeping.logs.values():
            # Of several nodes, those that have not said their end have been interrupted, too.
            log.close("interrupted" if status == EXIT_INTERRUPTED and not log.end else log.end)
        if not keeping.steps:
            for log in keeping.logs.values():
                log.path.unlink(missing_ok=True)
            _say(f"{self._options.live}: no step has come; nothing is written")
            return EXIT_INTERRUPTED if status == EXIT_INTERRUPTED else EXIT_BAD
        wanted = conversion.Wanted(self._options.run, self._options.view, self._options.node)
        try:
            with ExitStack() as files:
                streams = {str(log.path): files.enter_context(open(log.path, "rb")) for log in keeping.logs.values() if log.steps}
                conversion.convert(streams, self._output, wanted)
        except (LogError, OSError) as error:
            _say(f"{self._output}: {error}")
            self._say_kept()
            return EXIT_PART
        for log in keeping.logs.values():
            log.path.unlink()
        _say(f"{self._output}: {keeping.steps} steps, to step {keeping.last_step}")
        return status

    def _remarks(self) -> list[str]:
        out = self._keeping.remarks()
        if self._queue.dropped:
            out.append(f"{self._queue.dropped} steps were not shown live: a viewer was too slow; the recording has them")
        if self._keeping.other_runs:
            out.append(f"{self._keeping.other_runs} steps are of other runs than {self._options.run}")
        if self._viewers.failure:
            out.append(f"nothing was shown live any more: {self._viewers.failure}")
        return out

    def _say_kept(self) -> None:
        for log in self._keeping.logs.values():
            _say(f"what came is kept as a log: {log.path}")


class _Signals:
    """The first ones are noted, not raised: what comes stays whole."""

    def __init__(self) -> None:
        self.number, self.count, self.when = 0, 0, 0.0
        self._before = {number: signal.signal(number, self._note) for number in (signal.SIGINT, signal.SIGTERM)}

    def _note(self, number: int, _frame: object) -> None:
        self.number, self.count = number, self.count + 1
        self.when = self.when or time.monotonic()

    @property
    def came(self) -> bool:
        return self.count > 0

    @property
    def name(self) -> str:
        return "Ctrl-C" if self.number == signal.SIGINT else signal.Signals(self.number).name

    def restore(self) -> None:
        for number in self._before:
            signal.signal(number, signal.default_int_handler)

    def close(self) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)


@contextmanager
def _signals() -> Iterator[_Signals]:
    signals = _Signals()
    try:
        yield signals
    finally:
        signals.close()


def _source(text: str) -> Source:
    if text == "-":
        return Pipe(sys.stdin.fileno())
    if text.startswith("unix:"):
        return UnixSocket(text[5:])
    if text.startswith("udp:"):
        host, _, port = text[4:].rpartition(":")
        host = host.removeprefix("[").removesuffix("]") or _LOCAL
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
    subprocess.Popen([program, url], start_new_session=True, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def _say(text: str) -> None:
    print(f"{PROGRAM}: {text}", file=sys.stderr)


def _port(text: str) -> int:
    if not text.isdecimal() or int(text) > 65535:
        raise argparse.ArgumentTypeError(f"{text!r} is not a port")
    return int(text)


def _seconds(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0.0 < value < 1e9:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number of seconds")
    return value
