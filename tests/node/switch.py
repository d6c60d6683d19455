# SPDX-License-Identifier: MIT
"""An Ethernet switch in user space between TAP devices, with the faults of a radio: loss, delay, duplication, reordering, partitions. It stands where
`tc netem` would, on kernels that have none, and carries unicast and multicast of IPv4 and IPv6 alike.

switch.py FD ...: frames of port k come and go through descriptor FD k, whose device has the hardware address 02:00:00:00:00:k. Lines of JSON on standard
input change the faults: {"loss": p, "delay_ms": mean, "jitter_ms": +-, "duplicate": p, "groups": [number of each port], "record": path}.
"""
import heapq
import json
import os
import random
import select
import sys
import time


class Switch:
    def __init__(self, ports):
        self.ports = ports
        self.random = random.Random(1)
        self.faults = {"loss": 0.0, "delay_ms": 0.0, "jitter_ms": 0.0, "duplicate": 0.0, "groups": [0] * len(ports), "record": None}
        self.waiting = []  # (time, number, port, frame)
        self.number = 0
        self.record = None

    def control(self, line):
        self.faults |= json.loads(line)
        if self.faults["record"] and not self.record:
            self.record = open(self.faults["record"], "wb")
        elif not self.faults["record"] and self.record:
            self.record.close()
            self.record = None

    def take(self, port, frame):
        now = time.monotonic()
        groups, faults = self.faults["groups"], self.faults
        if self.record:
            self.record.write(len(frame).to_bytes(4, "little") + frame)
            self.record.flush()
        if frame[0] & 1:
            receivers = [k for k in range(len(self.ports)) if k != port]
        else:
            receivers = [frame[5]] if frame[:5] == b"\2\0\0\0\0" and frame[5] < len(self.ports) and frame[5] != port else []
        for receiver in receivers:
            if groups[receiver] != groups[port]:
                continue
            for _ in range(2 if self.random.random() < faults["duplicate"] else 1):
                if self.random.random() < faults["loss"]:
                    continue
                delay = faults["delay_ms"] + self.random.uniform(-1, 1) * faults["jitter_ms"]
                self.number += 1
                heapq.heappush(self.waiting, (now + max(0.0, delay) / 1000, self.number, receiver, frame))

    def deliver(self):
        while self.waiting and self.waiting[0][0] <= time.monotonic():
            _, _, port, frame = heapq.heappop(self.waiting)
            try:
                os.write(self.ports[port], frame)
            except OSError:
                pass  # its queue is full, or the device is down: lost

    def run(self):
        poll = select.poll()
        poll.register(0, select.POLLIN)
        names = {fd: k for k, fd in enumerate(self.ports)}
        for fd in self.ports:
            os.set_blocking(fd, False)
            poll.register(fd, select.POLLIN)
        text = b""
        print("ready", flush=True)
        while True:
            left = max(0.0, self.waiting[0][0] - time.monotonic()) * 1000 if self.waiting else None
            for fd, _ in poll.poll(left):
                if fd == 0:
                    more = os.read(0, 65536)
                    if not more:
                        return
                    *lines, text = (text + more).split(b"\n")
                    for line in lines:
                        self.control(line)
                        print("done", flush=True)
                    continue
                try:
                    for _ in range(32):
                        self.take(names[fd], os.read(fd, 2048))
                except OSError:
                    pass
            self.deliver()


if __name__ == "__main__":
    Switch([int(fd) for fd in sys.argv[1:]]).run()
