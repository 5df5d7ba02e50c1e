"""A third list of cases: what the vocabulary got last, and torques that it keeps as a table."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from plant.case import Case, in_reach, make_case
from plant.hidden import DRIFTS
from plant.systems import SYSTEMS

CATEGORIES: dict[str, tuple[str, ...]] = {
    "table": ("table",),
    "position": ("position_torque",),
    **{kind: (kind,) for kind in DRIFTS},
    "clean": (),
}
SIZE = 30.0  # times the noise


@dataclass(frozen=True)
class VocabularyOrder:
    """What to make; where it is out of reach, another system is tried."""

    category: str
    system: str
    effects: tuple[str, ...]
    size: float
    seed: int

    def make(self, duration: float = 8.0, rate: float = 1000.0, *, rivals: bool = True) -> Case:
        case = in_reach(
            self.system,
            lambda system: make_case(
                system, self.effects, self.size, "normal", self.seed, duration, rate, rivals=rivals
            ),
        )
        case.answer["category"] = self.category
        return case


def vocabulary_cases(n: int, seed: int) -> list[VocabularyOrder]:
    """n orders, the categories in turn, systems and seeds drawn."""
    rng = np.random.default_rng([13, seed])
    return [
        VocabularyOrder(category, str(rng.choice(list(SYSTEMS))), CATEGORIES[category], SIZE, int(rng.integers(2**31)))
        for category in (list(CATEGORIES)[k % len(CATEGORIES)] for k in range(n))
    ]
