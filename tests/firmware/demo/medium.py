# SPDX-License-Identifier: MIT
"""The air between the nodes: what becomes of each frame on its way to each node. Positions count stages: 2 t for the readings of
step t, 2 t + 1 for its estimates. The same seed does the same to the same frames."""
import random
from collections import Counter
from dataclasses import dataclass

LOST, DELAYED, DAMAGED, REPEATED, OVERHEARD = 0.20, 0.04, 0.02, 0.10, 0.05


@dataclass(frozen=True)
class Copy:
    """A frame on its way to one node."""
    position: int
    sender: int
    content: bytes
    damaged: bool = False
    stranger: bool = False


class Medium:
    """neighbours[k]: whom node k hears. arrivals: (t, stage, from, to) of frames that came undamaged and in time, or one stage early."""

    def __init__(self, neighbours, seed):
        self.neighbours, self.random = neighbours, random.Random(seed)
        self.inbox = [[] for _ in neighbours]
        self.delayed = [[] for _ in neighbours]
        self.arrivals = set()
        self.counts = [Counter() for _ in neighbours]

    def transmit(self, sender, position, content):
        """A broadcast, while the receivers are in this stage or, at most, the one before."""
        self.counts[sender]["sent"] += 1
        for k, heard in enumerate(self.neighbours):
            if k != sender:
                self._to(k, Copy(position, sender, content, stranger=sender not in heard))

    def _to(self, k, copy):
        chance = self.random.random()
        repeats = self.random.random() < REPEATED
        if copy.stranger and self.random.random() >= OVERHEARD:
            return
        if chance < LOST:
            self.counts[k]["lost"] += not copy.stranger
        elif chance < LOST + DELAYED:
            self.delayed[k].append(copy)
        elif chance < LOST + DELAYED + DAMAGED:
            self.inbox[k].append(Copy(copy.position, copy.sender, self._damage(copy.content), True))
        else:
            self.inbox[k] += [copy, copy] if repeats else [copy]

    def _damage(self, content):
        """Up to three bits, or the end is cut off."""
        if self.random.random() < 0.25:
            return content[:self.random.randrange(1, len(content))]
        spoiled = bytearray(content)
        for bit in self.random.sample(range(8 * len(content)), self.random.randint(1, 3)):
            spoiled[bit // 8] ^= 1 << bit % 8
        return bytes(spoiled)

    def deliver(self, k, position):
        """What node k hears before its stage ends, in no order. Delayed frames are there at its next stage."""
        copies, self.inbox[k], self.delayed[k] = self.inbox[k], self.delayed[k], []
        self.random.shuffle(copies)
        for copy in copies:
            self.counts[k][self._verdict(k, position, copy)] += 1
        return [copy.content for copy in copies]

    def _verdict(self, k, position, copy):
        arrival = (copy.position // 2, copy.position % 2 + 1, copy.sender, k)
        if copy.damaged:
            return "damaged"
        if copy.stranger:
            return "stranger"
        if copy.position < position:
            return "late"
        if arrival in self.arrivals:
            return "repeated"
        self.arrivals.add(arrival)
        self.counts[k]["early"] += copy.position > position
        return "taken"

    def forget(self, k, position):
        """Node k was off before this position: what was sent by then is gone."""
        for box in (self.inbox, self.delayed):
            box[k] = [copy for copy in box[k] if copy.position >= position]
