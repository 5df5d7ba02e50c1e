"""A random sample of faults over all rooms of the program, by lines."""

import random
from collections import defaultdict
from pathlib import Path

from tests.mutants.coverage_map import PACKAGES, ROOT
from tests.mutants.operators import Fault, faults

LEAST = 2  # of every room


def all_faults(root: Path = ROOT, begins: tuple[str, ...] = ("",)) -> dict[str, list[Fault]]:
    """Every fault of the program, by file; of files whose names begin so."""
    files = [path for package in PACKAGES for path in sorted((root / package).rglob("*.py"))]
    wanted = {str(path.relative_to(root)): path for path in files if str(path.relative_to(root)).startswith(begins)}
    found = {name: faults(path, root) for name, path in wanted.items()}
    return {name: some for name, some in found.items() if some}


def sample(by_file: dict[str, list[Fault]], count: int, seed: int) -> list[Fault]:
    """Rooms in proportion to their lines, a line at random, one kind of fault on it, one fault of the kind."""
    draw = random.Random(seed)
    by_room: dict[str, dict[tuple[str, int], list[Fault]]] = defaultdict(lambda: defaultdict(list))
    for name, some in sorted(by_file.items()):
        for fault in some:
            by_room[str(Path(name).parent)][name, fault.line].append(fault)
    total = sum(map(len, by_room.values()))
    chosen = []
    for _, lines in sorted(by_room.items()):
        wanted = min(len(lines), max(LEAST, -(-count * len(lines) // total)))  # rounded up
        for where in draw.sample(sorted(lines), wanted):
            kinds = defaultdict(list)
            for fault in lines[where]:
                kinds[fault.kind].append(fault)
            chosen.append(draw.choice(kinds[draw.choice(sorted(kinds))]))
    draw.shuffle(chosen)  # a stopped run is a sample, too
    return chosen
