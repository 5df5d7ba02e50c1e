"""A second list of cases, of what real recordings are like: model error, wrong noise, three effects, newer kinds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from plant.case import Case, in_reach, make_case
from plant.hidden import INSIDE, KINDS, NEWER
from plant.systems import SYSTEMS

CATEGORIES = ("model_error", "wrong_noise", "newer", "triple", "closed_loop", "clean_error")
SMALL = ("compliance", "coulomb_friction")  # what a model leaves out though it is there
STATED = (0.3, 3.0)  # times the noise


@dataclass(frozen=True)
class HardOrder:
    """What to make; where it is out of reach, another system is tried."""

    category: str
    system: str
    effects: tuple[str, ...]
    size: float
    seed: int
    closed_loop: bool = False
    background: tuple[str, ...] = ()
    stated_noise: float = 1.0

    def make(self, duration: float = 8.0, rate: float = 1000.0, *, rivals: bool = True) -> Case:
        case = in_reach(
            self.system,
            lambda system: make_case(
                system, self.effects, self.size, "normal", self.seed, duration, rate, closed_loop=self.closed_loop,
                moving=self.seed % 2 == 0, rivals=rivals, background=self.background, stated_noise=self.stated_noise,
            ),
        )  # fmt: skip
        case.answer["category"] = self.category
        return case


def hard_cases(n: int, seed: int) -> list[HardOrder]:
    """n orders, the categories in turn, kinds, systems and seeds drawn."""
    rng = np.random.default_rng([12, seed])
    orders = []
    for k in range(n):
        category, system = CATEGORIES[k % len(CATEGORIES)], str(rng.choice(list(SYSTEMS)))
        kinds = NEWER if category == "newer" else INSIDE
        effects = (str(rng.choice(kinds)),)
        if category == "triple":
            effects = _of_different_groups(rng)
        if category == "clean_error":
            effects = ()
        stated = float(rng.choice(STATED)) if category == "wrong_noise" else 1.0
        background = SMALL if category in ("model_error", "closed_loop", "clean_error") else ()
        size = 15.0 if category == "triple" else 30.0
        seed_of_case, loop = int(rng.integers(2**31)), category == "closed_loop"
        orders.append(HardOrder(category, system, effects, size, seed_of_case, loop, background, stated))
    return orders


def _of_different_groups(rng: np.random.Generator) -> tuple[str, ...]:
    groups: dict[str, str] = {}
    for kind in rng.permutation(INSIDE):
        groups.setdefault(KINDS[str(kind)].group, str(kind))
    return tuple(groups.values())[:3]
