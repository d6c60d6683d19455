# SPDX-License-Identifier: MIT
"""Runs the nodes: gives them their readings, carries their frames, and is their clock. A stage of a node is over when it has been
given all that it is to hear in it, and not before: what arrives is decided by the seed, not by how busy the machine is."""
import random
import struct
import zlib

from boards import END, FRAME, HELLO, REPORT, SENSOR, Failure

FAST = 0.35  # probability that a node's clock is ahead of the others', by up to a stage
HEADER = struct.Struct("<BBHII")


def check_frame(k, position, content):
    """A node must send what is due, intact."""
    if len(content) < HEADER.size + 4 or zlib.crc32(content[:-4]) != struct.unpack("<I", content[-4:])[0]:
        raise Failure(f"node {k}: sent a frame whose checksum is wrong")
    _, kind, node, _, step = HEADER.unpack_from(content)
    if node != k:
        raise Failure(f"node {k}: sent a frame of node {node}")
    if (2 * step + (kind & 3) - 1) != position:
        raise Failure(f"node {k}: sent a frame of step {step}, stage {kind & 3} at step {position // 2}, stage {position % 2 + 1}")


class Network:
    """readings[t][k]: bytes of float32 numbers. reports[k]: (t, content of the report) for every step that node k has ended. reboot:
    (node, step) or None: the node is reset in the second stage of that step and takes part again from the next one."""

    def __init__(self, boards, medium, readings, seed, reboot=None, spoil=None):
        self.boards, self.medium, self.readings, self.reboot, self.spoil = boards, medium, readings, reboot, spoil
        self.random = random.Random(seed + 1)
        self.reports = [[] for _ in boards.nodes]

    def run(self, progress):
        for k in self.boards.nodes:
            self.boards.receive(k, HELLO)
        self.measure(self.boards.nodes, 0)
        for position in range(2 * len(self.readings)):
            off = None
            if self.reboot and position == 2 * self.reboot[1] + 1:
                off = self.reboot[0]
                self.boards.reset(off)
            fast = [k for k in self.boards.nodes if self.random.random() < FAST]
            self.end_stage([k for k in fast if k != off], position)
            self.end_stage([k for k in self.boards.nodes if k not in fast and k != off], position)
            if off is not None and position + 1 < 2 * len(self.readings):
                self.medium.forget(off, position + 1)
                self.measure([off], position // 2 + 1)
            progress(position)

    def measure(self, nodes, t):
        for k in nodes:
            self.boards.send(k, SENSOR, self.readings[t][k])
        self.collect(nodes, 2 * t)

    def end_stage(self, nodes, position):
        for k in nodes:
            for content in self.medium.deliver(k, position):
                self.boards.send(k, FRAME, self.alter(k, position, content))
            self.boards.send(k, END)
        if position % 2 == 0:
            self.collect(nodes, position + 1)
            return
        t = position // 2
        for k in nodes:
            self.reports[k].append((t, self.boards.receive(k, REPORT)))
        if t + 1 < len(self.readings):
            self.measure(nodes, t + 1)

    def collect(self, nodes, position):
        for k in nodes:
            content = self.boards.receive(k, FRAME)
            if not self.reboot or k != self.reboot[0] or position < 2 * self.reboot[1]:
                check_frame(k, position, content)
            self.medium.transmit(k, position, content)

    def alter(self, k, position, content):
        """With --spoil frame: one bit of one estimate that arrives in the second half, under a checksum that hides it."""
        wanted = self.spoil == "frame" and position >= len(self.readings) and position % 2 == 1 and len(content) > HEADER.size + 4
        if not wanted or zlib.crc32(content[:-4]) != struct.unpack("<I", content[-4:])[0]:
            return content
        _, kind, node, _, step = HEADER.unpack_from(content)
        if 2 * step + (kind & 3) - 1 != position or node not in self.medium.neighbours[k]:
            return content
        self.spoil = None
        spoiled = bytearray(content[:-4])
        spoiled[HEADER.size + 1] ^= 0x40 # the 14th bit of the first number: the lowest might be rounded away
        return bytes(spoiled) + struct.pack("<I", zlib.crc32(spoiled))
