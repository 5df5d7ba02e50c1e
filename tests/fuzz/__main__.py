"""``python -m tests.fuzz [--count 100000] [--seed 1] [--workers 2]``: the fuzzer.

Inputs are tried in batches, each in a process of its own, so that a crash ends a batch and not the run. An input that
fails is written to ``out/fuzz``; moved to ``tests/fuzz/found``, it is tried by every ``make test``.
"""

import argparse
import multiprocessing
import sys
from concurrent.futures import ProcessPoolExecutor
from functools import partial

from tests.fuzz.inputs import BATCH, batch


def main() -> int:
    """Try all inputs; exit code 1 if one failed."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description="Fuzz every kind of input.")
    parser.add_argument("--count", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2)
    given = parser.parse_args()
    batches, failed = range(0, given.count, BATCH), 0
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(given.workers, mp_context=context, max_tasks_per_child=20) as pool:
        for first, found in zip(batches, pool.map(partial(batch, given.seed, given.count), batches)):
            failed += len(found)
            print(*found, f"{first + BATCH} inputs, {failed} failures", sep="\n", flush=True)
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
