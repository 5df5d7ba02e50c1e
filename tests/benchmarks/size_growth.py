"""Large models: processor time and memory over the number of inertias or gears, with the exponents of their growth.

Every size runs in a process of its own. Memory is what comes on top of the imports.
"""

import json
import math
import resource
import subprocess
import sys
import time

from modelling.equations.casadi_code import compiled
from modelling.equations.lagrange import derive
from modelling.modal.modes import modes
from modelling.model_file import from_dict
from modelling.system import System

SIZES = (375, 750, 1500, 3000)
LARGEST_EXPONENT = 1.3  # asked for


def chain(count: int) -> System:
    """Inertias in a row on shafts."""
    parts = {f"i{i}": {"J": 1.0 + 0.01 * (i % 7)} for i in range(count)}
    shafts = {
        f"s{i}": {"between": [f"i{i}", f"i{i + 1}"], "stiffness": 100.0 + i % 11, "damping": 0.1}
        for i in range(count - 1)
    }
    return from_dict({"inertias": parts, "shafts": shafts})


def gear_train(count: int) -> System:
    """Rigid gears in a row, the last wheel on a shaft."""
    parts = {f"i{i}": {"J": 1.0} for i in range(count + 1)}
    gears = {f"g{i}": {"between": [f"i{i}", f"i{i + 1}"], "ratio": 1.1 if i % 2 else 0.9} for i in range(count - 1)}
    shafts = {"s": {"between": [f"i{count - 1}", f"i{count}"], "stiffness": 100.0}}
    return from_dict({"inertias": parts, "gears": gears, "shafts": shafts})


KINDS = {"chain": chain, "gear train": gear_train}


def measured(kind: str, count: int) -> dict[str, float]:
    """Processor seconds and megabytes of the steps from a model's content to its modes."""

    def megabytes() -> float:
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024

    modes(chain(3))  # what is imported and set up once
    before, began = megabytes(), time.process_time()
    system = KINDS[kind](count)
    read = time.process_time()
    derive(system)
    derived = time.process_time()
    modes(compiled(system).system)
    return {
        "read": read - began,
        "derived": derived - read,
        "modes": time.process_time() - derived,
        "memory": megabytes() - before,
    }


def main() -> None:
    for kind in KINDS:
        found = []
        for count in SIZES:
            command = [sys.executable, "-m", "tests.benchmarks.size_growth", kind, str(count)]
            found.append(json.loads(subprocess.run(command, capture_output=True, check=True, text=True).stdout))
            each = "  ".join(f"{what} {value:7.2f}" for what, value in found[-1].items())
            print(f"{kind} of {count:5}: {each}  (s, MB)", flush=True)
        octaves = math.log2(SIZES[-1] / SIZES[1])
        growth = {what: math.log2(found[-1][what] / max(found[1][what], 1e-9)) / octaves for what in found[0]}
        each = "  ".join(f"{what} {value:.2f}" for what, value in growth.items())
        print(f"{kind}: exponents {SIZES[1]} to {SIZES[-1]}: {each}  asked for: {LARGEST_EXPONENT} at most", flush=True)


if __name__ == "__main__":
    if len(sys.argv) > 1:
        print(json.dumps(measured(sys.argv[1], int(sys.argv[2]))))
    else:
        main()
