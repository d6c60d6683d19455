# SPDX-License-Identifier: MIT
"""Network namespaces, one a node, on one Ethernet with faults. Needs root, `ip netns` and /dev/net/tun; `Fabric` raises Unavailable with the reason.

Where the kernel has netem it makes the faults, on the device of each node; otherwise the switch does.
"""
import ctypes
import fcntl
import json
import os
import pathlib
import signal
import struct
import subprocess
import sys
import threading

DEVICE = "mesh0"
_libc = ctypes.CDLL(None, use_errno=True)
_PR_SET_PDEATHSIG = 1


class Unavailable(Exception):
    pass


def die_with_parent():
    """For preexec_fn: nothing outlives the tests, however they end."""
    _libc.prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)


def _run(*words, **options):
    done = subprocess.run(words, capture_output=True, text=True, timeout=20, **options)
    if done.returncode:
        raise Unavailable(f"{' '.join(words)}: {done.stderr.strip()}")


def _sweep():
    """Namespaces that a run left behind which was killed."""
    for path in pathlib.Path("/run/netns").glob("meshkal-*-*"):
        if not pathlib.Path(f"/proc/{path.name.split('-')[1]}").exists():
            subprocess.run(["ip", "netns", "delete", path.name], capture_output=True, timeout=20)


def inside(namespace, function):
    """function() in a thread of its own in the namespace: threads that are not the first leave no trace."""
    result = []

    def work():
        try:
            fd = os.open(f"/run/netns/{namespace}", os.O_RDONLY)
            if _libc.setns(fd, 0):
                raise OSError(ctypes.get_errno(), "setns")
            os.close(fd)
            result.append(function())
        except BaseException as error:  # noqa: BLE001 - handed on
            result.append(error)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    if isinstance(result[0], BaseException):
        raise result[0]
    return result[0]


def _tap():
    fd = os.open("/dev/net/tun", os.O_RDWR | os.O_CLOEXEC)
    fcntl.ioctl(fd, 0x400454CA, struct.pack("16sH22x", DEVICE.encode(), 0x0002 | 0x1000))  # TUNSETIFF: TAP, no packet information
    return fd


class Fabric:
    def __init__(self, count):
        if os.geteuid() != 0:
            raise Unavailable("network namespaces need root")
        _sweep()
        self.names = [f"meshkal-{os.getpid()}-{k}" for k in range(count)]
        self.switch, self.netem, self.taps = None, False, []
        try:
            for k, name in enumerate(self.names):
                self._make(k, name)
            self._start_switch()
        except (Unavailable, OSError, FileNotFoundError) as error:
            self.close()
            raise Unavailable(str(error)) from None

    def _make(self, k, name):
        _run("ip", "netns", "add", name)
        self.taps.append(inside(name, _tap))
        # No duplicate address detection and no address resolution: both take seconds, longer with losses.
        inside(name, lambda: [pathlib.Path(f"/proc/sys/net/ipv6/conf/{x}/accept_dad").write_text("0") for x in ("all", "default", DEVICE)
                              if pathlib.Path(f"/proc/sys/net/ipv6/conf/{x}").exists()])
        lines = ["link set lo up", f"link set {DEVICE} address 02:00:00:00:00:{k:02x}", f"link set {DEVICE} up",
                 f"address add {self.ipv4(k)}/24 dev {DEVICE}", f"address add {self.ipv6(k)}/64 dev {DEVICE} nodad"]
        for j in range(len(self.names)):
            if j != k:
                lines += [f"neighbour add {a} lladdr 02:00:00:00:00:{j:02x} dev {DEVICE} nud permanent" for a in (self.ipv4(j), self.ipv6(j))]
        _run("ip", "-n", name, "-batch", "-", input="\n".join(lines) + "\n")

    def _start_switch(self):
        self.switch = subprocess.Popen([sys.executable, pathlib.Path(__file__).with_name("switch.py"), *map(str, self.taps)], pass_fds=self.taps,
                                       stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, preexec_fn=die_with_parent)
        if self.switch.stdout.readline() != "ready\n":
            raise Unavailable("the switch does not start")
        probe = subprocess.run(["tc", "-n", self.names[0], "qdisc", "replace", "dev", DEVICE, "root", "netem", "delay", "1ms"], capture_output=True)
        self.netem = probe.returncode == 0
        self.control()

    @staticmethod
    def ipv4(k):
        return f"10.77.0.{k + 1}"

    @staticmethod
    def ipv6(k):
        return f"fd00:77::{k + 1:x}"

    def control(self, *, loss=0.0, delay_ms=0.0, jitter_ms=0.0, duplicate=0.0, groups=None, record=None):
        """What holds from now on. Jitter reorders. groups: nodes of different numbers do not hear each other."""
        faults = {"groups": groups or [0] * len(self.names), "record": record and str(record)}
        mine = {"loss": loss, "delay_ms": delay_ms, "jitter_ms": jitter_ms, "duplicate": duplicate}
        if self.netem:
            words = ["netem", "delay", f"{delay_ms}ms", f"{jitter_ms}ms", "loss", f"{100 * loss}%", "duplicate", f"{100 * duplicate}%"]
            for name in self.names:
                _run("tc", "-n", name, "qdisc", "replace", "dev", DEVICE, "root", *words)
            mine = dict.fromkeys(mine, 0.0)
        self.switch.stdin.write(json.dumps(faults | mine) + "\n")
        self.switch.stdin.flush()
        assert self.switch.stdout.readline() == "done\n", "the switch has ended"

    def command(self, k):
        return ["ip", "netns", "exec", self.names[k]]

    def close(self):
        if self.switch:
            self.switch.kill()
            self.switch.communicate()
        for fd in self.taps:
            os.close(fd)
        for name in self.names:
            subprocess.run(["ip", "netns", "delete", name], capture_output=True, timeout=20)
