# SPDX-License-Identifier: MIT
"""Emulated boards and their Ethernet cables: one QEMU for each node, its port a pair of unix datagram sockets. Messages: link.h."""
import ctypes
import json
import pathlib
import select
import shutil
import signal
import socket
import struct
import subprocess
import tempfile
import time

FRAME, HELLO, SENSOR, END, REPORT = range(5)
NAMES = ("frame", "hello", "sensor reading", "end of stage", "report")
ETHERNET = struct.Struct("<6s6s2sBBH")
ALL = b"\xff" * 6
SWITCH = b"\x02\x00\x00\x00\xff\xff"
TYPE = b"\x88\xb5"
KILL_WITH_PARENT = 1  # PR_SET_PDEATHSIG


class Failure(Exception):
    """The network did not do what it had to. One line for the user."""


def pack(kind, content):
    return struct.pack("<BBH", kind, 0, len(content)) + content


def die_with_parent():
    ctypes.CDLL(None).prctl(KILL_WITH_PARENT, signal.SIGKILL)


class Boards:
    """Context manager. given[k] and sent[k]: one list for each life of node k, of the packed messages in their order."""

    def __init__(self, emulator, images, logs, limit, resettable=()):
        self.emulator, self.images, self.logs, self.limit, self.resettable = emulator, images, pathlib.Path(logs), limit, resettable
        self.nodes = range(len(images))
        self.process, self.socket, self.monitor = [], [], {}
        self.given, self.sent = [[[]] for _ in self.nodes], [[[]] for _ in self.nodes]
        self.waiting = [[] for _ in self.nodes]

    def __enter__(self):
        self.room = pathlib.Path(tempfile.mkdtemp(prefix="meshkal-"))
        try:
            for k in self.nodes:
                self._start(k)
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *unused):
        for process in self.process:
            process.kill()
        for process in self.process:
            process.wait()
        for open_socket in (*self.socket, *self.monitor.values()):
            open_socket.close()
        shutil.rmtree(self.room, ignore_errors=True)

    def _start(self, k):
        cable = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.socket.append(cable)
        cable.bind(str(self.room / f"switch{k}"))
        arguments = [*self.emulator, "-kernel", self.images[k], "-net", "nic,netdev=cable,model=lan9118", "-netdev",
                     f"dgram,id=cable,local.type=unix,local.path={self.room}/node{k},remote.type=unix,remote.path={self.room}/switch{k}"]
        if k in self.resettable:
            arguments += ["-qmp", f"unix:{self.room}/monitor{k},server=on,wait=off"]
        with open(self.logs / f"node-{k:02}.log", "wb") as log:
            self.process.append(subprocess.Popen(arguments, stdin=subprocess.DEVNULL, stdout=log, stderr=log, preexec_fn=die_with_parent))

    def send(self, k, kind, content=b""):
        message = pack(kind, content)
        self.given[k][-1].append(message)
        self.socket[k].settimeout(self.limit)
        try:
            self.socket[k].sendto(ETHERNET.pack(ALL, SWITCH, TYPE, kind, 0, len(content)) + content, str(self.room / f"node{k}"))
        except OSError as error:
            raise Failure(f"node {k}: does not take messages: {error}{self._last_words(k)}") from None

    def receive(self, k, kind):
        """Content of the next message of node k, which must be of this kind."""
        deadline = time.monotonic() + self.limit
        while not self.waiting[k]:
            self._look(k, kind, deadline)
        message = self.waiting[k].pop(0)
        if message[0] != kind:
            raise Failure(f"node {k}: sent a {NAMES[message[0]]} where a {NAMES[kind]} was due")
        return message[4:]

    def reset(self, k):
        """The reset button. Returns when the node has started again."""
        if self.waiting[k]:
            raise Failure(f"node {k}: sent more than it should have before its reset")
        self._command(k, "system_reset")
        self.given[k].append([])
        self.sent[k].append([])
        self.receive(k, HELLO)

    def _look(self, k, kind, deadline):
        """Takes in what node k has sent."""
        if not select.select([self.socket[k]], [], [], 0.2)[0]:
            for other in self.nodes:
                if self.process[other].poll() is not None:
                    raise Failure(f"node {other}: ended with status {self.process[other].returncode}{self._last_words(other)}")
            if time.monotonic() > deadline:
                raise Failure(f"node {k}: no {NAMES[kind]} within {self.limit:g} s{self._last_words(k)}")
            return
        data = self.socket[k].recv(2048)
        if len(data) < ETHERNET.size or data[12:14] != TYPE:
            return
        length = struct.unpack_from("<H", data, 16)[0]
        message = data[14:18 + length]
        if data[14] >= len(NAMES) or len(message) != 4 + length:
            raise Failure(f"node {k}: sent a message that is none: {data.hex()}")
        self.waiting[k].append(message)
        self.sent[k][-1].append(message)

    def _last_words(self, k):
        text = (self.logs / f"node-{k:02}.log").read_text(errors="replace").strip().splitlines()
        return ": " + text[-1] if text else ""

    def _command(self, k, name):
        """To QEMU's monitor, which greets first."""
        monitor = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self.monitor[k] = monitor
        monitor.settimeout(self.limit)
        try:
            monitor.connect(str(self.room / f"monitor{k}"))
            with monitor.makefile("rw") as stream:
                stream.readline()
                for command in ("qmp_capabilities", name):
                    stream.write(json.dumps({"execute": command}) + "\n")
                    stream.flush()
                    while "return" not in (answer := json.loads(stream.readline())):
                        if "error" in answer:
                            raise Failure(f"node {k}: monitor: {answer['error']}")
        except (OSError, ValueError) as error:
            raise Failure(f"node {k}: monitor: {error}") from None
