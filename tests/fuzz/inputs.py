"""Input number ``i`` of a run: which seed, and how it is changed. Both follow from the run's seed and the number."""

from __future__ import annotations

import random
from dataclasses import dataclass

from tests.fuzz.corpus import seeds
from tests.fuzz.mutate import mutated
from tests.fuzz.seed import Seed
from tests.fuzz.targets import TARGETS


@dataclass(frozen=True)
class FuzzInput:
    """A changed seed."""

    seed: Seed
    content: bytes


def fuzz_input(run: int, number: int, kinds: tuple[str, ...] = tuple(TARGETS)) -> FuzzInput:
    """The input of a number in a run of a seed, of one of the kinds."""
    rng = random.Random(f"{run}/{number}")
    kind = rng.choices(kinds, [TARGETS[name].share for name in kinds])[0]
    alike = [seed for seed in seeds() if seed.target == kind]
    seed = rng.choice(alike)
    return FuzzInput(
        seed, mutated(f"{run}/{number}", seed.content, [other.content for other in alike], binary=kind == "binary")
    )
