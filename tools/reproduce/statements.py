# SPDX-License-Identifier: MIT
"""What a paper says of every draw. Each property measures one number of a draw and compares it with a limit.

MUST     a failure is one of the program: it decides the exit status
CLAIM    said in general, and false on some draws (tools/reproduce/README.md says why): reported, decides nothing
OPEN     not claimed: reported because one would like to know
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

MUST, CLAIM, OPEN = "must hold", "claim", "not claimed"


@dataclass(frozen=True)
class Property:
    kind: str
    text: str
    number: str  # what `measure` gives, with its unit
    measure: Callable[[Any], float]
    sense: str  # "<" or ">"
    limit: float

    def holds(self, value: float) -> bool:
        """NaN never does."""
        return value < self.limit if self.sense == "<" else value > self.limit


@dataclass(frozen=True)
class Outcome:
    property: Property
    values: dict[int, float]  # by seed

    @property
    def failed(self) -> list[int]:
        return [seed for seed, value in self.values.items() if not self.property.holds(value)]

    @property
    def breaks(self) -> bool:
        return self.property.kind == MUST and bool(self.failed)

    @property
    def median(self) -> float:
        return float(np.median(list(self.values.values())))

    @property
    def worst(self) -> float:
        values = list(self.values.values())
        return float(np.max(values) if self.property.sense == "<" else np.min(values))


def evaluate(properties: Iterable[Property], draws: list) -> list[Outcome]:
    return [Outcome(p, {draw.seed: float(p.measure(draw)) for draw in draws}) for p in properties]
