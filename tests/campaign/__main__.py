"""The long diagnosis campaign: many recordings of the truth plant with something hidden in them, diagnosed and scored.

``python -m tests.campaign [--cases 400] [--seed 1] [--out out/campaign] [--workers 2]``; started again, it goes
on where it was stopped.
"""

import argparse
import json
import multiprocessing
import subprocess
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from functools import partial
from pathlib import Path
from typing import Any

from tqdm import tqdm

from tests.campaign.work import diagnosed, prepared


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=400, help="how many recordings the campaign is made of")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--first", type=int, help="only so many of them; they come in random order")
    parser.add_argument("--seconds", type=float, default=8.0, help="length of a recording (at 1 kHz)")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("out/campaign"))
    parser.add_argument("--make", action="store_true", help="only make the recordings")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    name = f"{given.cases}_{given.seed}_{given.seconds:g}s"
    kept = given.out / f"cases_{name}.jsonl"
    rows = [json.loads(line) for line in kept.read_text().splitlines()] if kept.exists() else []
    from plant.campaign import campaign_cases

    orders = list(enumerate(campaign_cases(given.cases, given.seed)))[: given.first]
    task = partial(prepared if given.make else diagnosed, made=given.out / f"made_{name}", seconds=given.seconds)
    done = {row["number"] for row in rows}
    with kept.open("a") as file:
        for row in run(task, [own for own in orders if own[0] not in done], given.workers):
            if not given.make:
                rows.append(row)
                file.write(json.dumps(row) + "\n")
                file.flush()
    if not given.make:
        from tests.campaign.score import report

        told = ["git", "describe", "--always", "--dirty"]
        commit = subprocess.run(told, capture_output=True, text=True).stdout.strip()
        report(rows, given.out, given.seed, given.cases, given.seconds, commit)


def run(task: Callable[..., Any], orders: list[tuple[int, Any]], workers: int) -> Iterator[Any]:
    """Results of a task for every order, as they come."""
    fresh = multiprocessing.get_context("spawn")
    bar = tqdm(total=len(orders), disable=not sys.stderr.isatty())
    for some in batched(orders, 20 * workers):  # then new processes, which gives memory back
        with ProcessPoolExecutor(workers, fresh) as pool:
            jobs = [pool.submit(task, number, order) for number, order in some]
            for job in as_completed(jobs):
                bar.update()
                yield job.result()


def batched(items: list[Any], size: int) -> Iterator[list[Any]]:
    """Stretches of a list."""
    return (items[first : first + size] for first in range(0, len(items), size))


if __name__ == "__main__":
    main()
