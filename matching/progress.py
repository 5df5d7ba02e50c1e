"""A progress bar where a terminal watches, and how long a command will still take."""

from __future__ import annotations

import os
import re
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

# --- When a command that works in steps will end, from what share of its time each step is over by.

# Shares of the time of a match by which a step was over, rounded from three cases.
OF_A_MATCH: Mapping[str, float | tuple[float, float]] = {
    "controller": 0.15, "residual vehicle and adapters": 0.5, "what to order": 0.85, "verification on fresh beds": 0.95,
    "bound and curves": 0.97,
}  # fmt: skip
_COUNTED = re.compile(r"(\d+) of (\d+)")


def share_over(step: str, shares: Mapping[str, float | tuple[float, float]]) -> float | None:
    """Share of the whole time that is over when a step has ended; None where nothing is known of the step."""
    begins = max((name for name in shares if step.startswith(name)), key=len, default=None)
    if begins is None:
        return None
    share = shares[begins]
    if not isinstance(share, tuple):
        return share
    counted = _COUNTED.search(step)
    part = int(counted[1]) / max(int(counted[2]), 1) if counted else 0.0
    return share[0] + (share[1] - share[0]) * min(part, 1.0)


def time_left(step: str, seconds: float, shares: Mapping[str, float | tuple[float, float]]) -> str:
    """In words how long it will go on, when a step has ended after so many seconds; empty where nothing is known."""
    share = share_over(step, shares)
    if not share:
        return ""
    left = seconds * (1 / share - 1)
    return f", about {left:.0f} s left" if left < 90 else f", about {left / 60:.0f} min left"


PROGRESS_ALWAYS = "RIGMATCH_PROGRESS"  # in the environment: progress is told although no terminal watches


@contextmanager
def progress(what: str) -> Iterator[Callable[[int, int], None]]:
    """A progress bar on standard error while a terminal watches; yields a function of (done, of how many)."""
    with _bar(what) as bar:

        def advance(done: int, total: int) -> None:
            bar.total = total
            bar.update(done - bar.n)

        yield advance


@contextmanager
def steps(
    what: str, shares: Mapping[str, float | tuple[float, float]] | None = None
) -> Iterator[Callable[[str], None]]:
    """The same for work in steps; yields a function of a word on what was just done.

    ``shares``: what is known of the time that is over by then, see :mod:`matching.progress`.
    """
    begun = time.monotonic()
    with _bar(what, bar_format="{desc} [{elapsed}]", mininterval=0) as bar:  # steps are few: each is shown

        def tell(done: str) -> None:
            left = time_left(done, time.monotonic() - begun, shares or {})
            bar.set_description_str(f"{what}: {done}{left}", refresh=False)
            bar.update()

        yield tell


def watched() -> bool:
    """Whether somebody follows the progress: a terminal, or a program that has said so."""
    return sys.stderr.isatty() or PROGRESS_ALWAYS in os.environ


def _bar(what: str, **looks: Any) -> Any:
    from tqdm import tqdm

    tqdm.monitor_interval = 0  # no thread of its own: a process that has threads cannot be forked
    return tqdm(desc=what, file=sys.stderr, disable=not watched(), leave=False, miniters=1, **looks)
