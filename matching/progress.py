"""The step that a function is at, told where somebody watches, and how long it will still take."""

from __future__ import annotations

import logging
import os
import re
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager

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


OF_A_COUNT: Mapping[str, float | tuple[float, float]] = {"": (0.0, 1.0)}  # "12 of 100 points": equally long ones

LOGGER = "rigmatch"
PROGRESS_ALWAYS = "RIGMATCH_PROGRESS"  # in the environment: progress is told although nobody seems to watch
Progress = Callable[[str], None]


@contextmanager
def shown(
    what: str, progress: Progress | None = None, shares: Mapping[str, float | tuple[float, float]] | None = None
) -> Iterator[Progress]:
    """Where a function tells its steps: to the caller's ``progress``, else in one line where somebody watches.

    Each step goes to the logger ``rigmatch`` as well (level INFO).

    Parameters
    ----------
    what : str
        The command.
    progress : callable, optional
        Is called with a line of text at every step.
    shares : mapping, optional
        What is known of the time that is over by a step, see above.
    """
    log = logging.getLogger(LOGGER)
    if progress is not None:

        def told(done: str) -> None:
            log.info("%s: %s", what, done)
            progress(done)

        yield told
        return
    from tqdm import tqdm

    tqdm.monitor_interval = 0  # no thread of its own: a process that has threads cannot be forked
    begun, looks = time.monotonic(), {"bar_format": "{desc} [{elapsed}]", "mininterval": 0, "miniters": 1}
    with tqdm(desc=what, file=sys.stderr, disable=not watched(), leave=False, **looks) as line:

        def tell(done: str) -> None:
            left = time_left(done, time.monotonic() - begun, shares or {})
            log.info("%s: %s", what, done)
            line.set_description_str(f"{what}: {done}{left}", refresh=False)
            line.update()

        yield tell


def watched() -> bool:
    """Whether somebody follows the progress: a terminal, a notebook, or a program that has said so."""
    return sys.stderr.isatty() or PROGRESS_ALWAYS in os.environ or "ipykernel.zmqshell" in sys.modules
