"""A balanced list of cases over kinds, systems, sizes and noise; clean, double and outside ones among them."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from plant.calibrate import OutOfReach
from plant.case import Case, make_case
from plant.hidden import INSIDE, KINDS, OUTSIDE
from plant.systems import SYSTEMS

SHARES = {"single": 0.57, "clean": 0.15, "double": 0.13, "outside": 0.15}
QUIETER = {"high": "normal", "normal": "low"}


@dataclass(frozen=True)
class Order:
    """What to make. Where a size cannot be reached, `make()` lowers the noise, then changes the system."""

    category: str
    system: str
    effects: tuple[str, ...]
    size: str | float
    noise: str
    seed: int
    closed_loop: bool = False
    moving: bool = False
    missing: int = 0

    def make(self, duration: float = 16.0, rate: float = 1000.0, *, rivals: bool = True) -> Case:
        others = [name for name in SYSTEMS if name != self.system]
        why = ""
        for system in (self.system, *others):
            noise: str | None = self.noise
            while noise:
                try:
                    case = make_case(
                        system,
                        self.effects,
                        self.size,
                        noise,
                        self.seed,
                        duration,
                        rate,
                        closed_loop=self.closed_loop,
                        moving=self.moving,
                        missing=self.missing,
                        rivals=rivals,
                    )
                    case.answer["category"] = self.category
                    return case
                except OutOfReach as reason:
                    why, noise = str(reason), QUIETER.get(noise)
        raise OutOfReach(why)


def campaign_cases(n: int, seed: int) -> list[Order]:
    """n orders; every kind of the vocabulary in plain and subtle, rotating through systems, noise and circumstances."""
    rng = np.random.default_rng([11, seed])
    counts = {name: round(share * n) for name, share in SHARES.items()}
    counts["single"] += n - sum(counts.values())
    pairs = [pair for pair in combinations(INSIDE, 2) if KINDS[pair[0]].group != KINDS[pair[1]].group]
    menu: dict[str, list[tuple[tuple[str, ...], str | float]]] = {
        "single": [((kind,), size) for kind in INSIDE for size in ("plain", "subtle")],
        "clean": [((), "plain")],
        "double": [
            (pair, size) for pair in (pairs[i] for i in rng.permutation(len(pairs))) for size in ("plain", 10.0)
        ],
        "outside": [((kind,), size) for kind in OUTSIDE for size in ("plain", "subtle")],
    }
    orders = []
    for category, count in counts.items():
        choices = menu[category]
        for k in range(count):
            effects, size = choices[k % len(choices)]
            turn = k + k // len(choices)  # so that a kind meets another system in the next round
            orders.append(
                Order(
                    category,
                    list(SYSTEMS)[turn % 3],
                    effects,
                    size,
                    ("normal", "low", "high")[k // 2 % 3],
                    int(rng.integers(2**31)),
                    bool(rng.random() < 0.4),
                    bool(rng.random() < 0.4),
                    int(rng.random() < 0.15),
                )
            )
    return [orders[i] for i in rng.permutation(len(orders))]
