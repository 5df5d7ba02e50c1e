"""The long diagnosis campaign: many recordings of the truth plant with something hidden in them, diagnosed and scored.

``python -m tests.campaign [--cases 400] [--seed 1] [--out out/campaign] [--workers 2 | --scheduler ADDRESS]``; started
again, it goes on where it was stopped. From Python on any executor: ``tests.campaign.run``.
"""

import argparse
import json
import subprocess
from pathlib import Path
from typing import Any

from matching.progress import progress
from matching.worker_pool import executor_of
from modelling.errors import InputError
from tests.campaign.run import Campaign, run

RENEWED = 20  # recordings a process; then new ones, which gives memory back


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=400, help="how many recordings the campaign is made of")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--first", type=int, help="only so many of them; they come in random order")
    parser.add_argument("--seconds", type=float, default=8.0, help="length of a recording (at 1 kHz)")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--scheduler", help="address of a Dask scheduler, instead of processes of this machine")
    parser.add_argument("--out", type=Path, default=Path("out/campaign"))
    parser.add_argument(
        "--hard", action="store_true", help="the second campaign: model error, wrong noise, three effects"
    )
    parser.add_argument(
        "--vocabulary", action="store_true", help="the third campaign: newer causes, torques as a curve"
    )
    parser.add_argument("--make", action="store_true", help="only make the recordings")
    given = parser.parse_args()
    campaign = Campaign(given.cases, given.seed, given.seconds, given.hard, given.vocabulary)
    try:
        rows = diagnosed(campaign, given)
    except InputError as fault:
        parser.exit(2, f"{fault}\n")
    if (given.hard or given.vocabulary) and not given.make:
        from tests.campaign.hard import hard_summary
        from tests.campaign.vocabulary import vocabulary_summary

        text = json.dumps(hard_summary(rows) if given.hard else vocabulary_summary(rows), indent=1)
        (given.out / ("hard.json" if given.hard else "vocabulary.json")).write_text(text)
        print(text)
    elif not given.make:
        from tests.campaign.score import report

        told = ["git", "describe", "--always", "--dirty"]
        commit = subprocess.run(told, capture_output=True, text=True).stdout.strip()
        report(rows, given.out, given.seed, given.cases, given.seconds, commit)


def diagnosed(campaign: Campaign, given: argparse.Namespace) -> list[dict[str, Any]]:
    """Rows of the campaign, by processes of this machine or by a cluster."""
    every = min(given.cases, given.first or given.cases)
    stretch = every if given.scheduler or given.make else RENEWED * given.workers
    with progress("campaign") as advance:
        for first in [*range(stretch, every, stretch), every]:
            with executor_of(given.workers, given.scheduler) as executor:
                rows = run(
                    campaign, given.out, executor, first=first, make_only=given.make,
                    progress=lambda done, _: advance(done, every),
                )  # fmt: skip
    return rows


if __name__ == "__main__":
    main()
