"""Input number ``i`` of a run: which seed, and how it is changed. Both follow from the run's seed and the number."""

from __future__ import annotations

import random
import tempfile
import zlib
from dataclasses import dataclass
from pathlib import Path

from tests.fuzz.corpus import seeds
from tests.fuzz.mutate import mutated
from tests.fuzz.seed import ROOT, Seed
from tests.fuzz.targets import TARGETS, failure

BATCH = 250
OUT = ROOT / "out" / "fuzz"


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


def batch(run: int, count: int, first: int) -> list[str]:
    """What failed, and how."""
    found = []
    with tempfile.TemporaryDirectory() as folder:
        for number in range(first, min(first + BATCH, count)):
            changed = fuzz_input(run, number)
            place = Path(folder) / changed.seed.target / changed.seed.name
            place.mkdir(parents=True, exist_ok=True)
            if what := failure(changed.seed, changed.content, place, deep=True):
                name = f"{changed.seed.target}-{changed.seed.name}-{zlib.crc32(changed.content):08x}"
                OUT.mkdir(parents=True, exist_ok=True)
                (OUT / (name + TARGETS[changed.seed.target].suffix)).write_bytes(changed.content)
                found.append(f"{name}: {what}")
    return found
