"""When a command that works in steps will end, from what share of its time each step is over by."""

from __future__ import annotations

import re
from collections.abc import Mapping

# Shares of the time of a match by which a step was over, rounded from three cases: 0.16 to 0.55 at the verification.
# A pair: of the first and the last of "start 3 of 18 at most"; it ends before the last where starts agree.
OF_A_MATCH: Mapping[str, float | tuple[float, float]] = {
    "start": (0.05, 0.45), "drawn beds": 0.1, "weights": 0.45, "verification": 0.4, "verification on fresh beds": 0.66,
    "gains over drawn beds": 0.7, "bound and curves": 0.7,
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
