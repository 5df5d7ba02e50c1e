"""A limit on the time of a long computation, kept by those of its loops that can end with what they have."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from time import monotonic


@dataclass
class TimeLimit:
    """Seconds that a computation may take, and whether that cut it short.

    Attributes
    ----------
    seconds : float
        Infinite: no limit.
    ended_at : float
        Largest share of the limit at which a loop was ended; 0: none was.
    """

    seconds: float
    ended_at: float = 0.0
    began: float = field(default_factory=lambda: monotonic())

    def is_over(self, share: float) -> bool:
        """Whether a share of the time has passed; whoever asks ends its loop then."""
        over = monotonic() - self.began >= share * self.seconds
        if over:
            self.ended_at = max(self.ended_at, share)
        return over


_limit: ContextVar[TimeLimit | None] = ContextVar("time_limit", default=None)


@contextmanager
def limited(seconds: float | None) -> Iterator[TimeLimit]:
    """A block that may take so many seconds; None: as many as it needs."""
    limit = TimeLimit(float("inf") if seconds is None else seconds)
    token = _limit.set(limit)
    try:
        yield limit
    finally:
        _limit.reset(token)


def time_is_over(share: float = 1.0) -> bool:
    """Whether a share of the time that the innermost block may take has passed; never outside of one."""
    limit = _limit.get()
    return limit is not None and limit.is_over(share)
