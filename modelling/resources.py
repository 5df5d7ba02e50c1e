"""What a computation may use: cores, threads, time; and the processor's floating-point state."""

from __future__ import annotations

import ctypes
import functools
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass, field
from time import monotonic, process_time


def cores() -> int:
    """Cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@functools.cache
def threads() -> int:
    """How many threads share a batch: ``OMP_NUM_THREADS`` where that is set, as for any library, else all cores."""
    limit = os.environ.get("OMP_NUM_THREADS", "")
    return int(limit) if limit.isdecimal() and int(limit) > 0 else cores()


def restore_floating_point() -> None:
    """Go back to IEEE 754: numbers below 2.2e-308 are no longer flushed to zero.

    Libraries built with -ffast-math switch that on for the thread that loads or calls them. Where the C library does
    not offer ``fesetenv`` with its default environment, nothing happens.
    """
    with suppress(OSError, AttributeError):
        ctypes.CDLL(None).fesetenv(ctypes.c_void_p(-1))


# --- A limit on the time of a long computation, kept by those of its loops that can end with what they have.


@dataclass
class TimeLimit:
    """Seconds that a computation may take, and whether that cut it short.

    Attributes
    ----------
    seconds : float
        Infinite: no limit.
    ended_at : float
        Largest share of the limit at which a loop was ended; 0: none was.
    of_processor : bool
        Whether seconds are those of the processor, which do not depend on what else the machine does.
    """

    seconds: float
    ended_at: float = 0.0
    of_processor: bool = False
    began: float = field(init=False)

    def __post_init__(self) -> None:
        self.began = self._now()

    def _now(self) -> float:
        return process_time() if self.of_processor else monotonic()

    def is_over(self, share: float) -> bool:
        """Whether a share of the time has passed, or an end was asked for; whoever asks ends its loop then."""
        over = self._now() - self.began >= share * self.seconds or bool(_early.asked_by)
        if over:
            self.ended_at = max(self.ended_at, share)
        return over


_limit: ContextVar[TimeLimit | None] = ContextVar("time_limit", default=None)


@contextmanager
def limited(seconds: float | None, of_processor: bool = False) -> Iterator[TimeLimit]:
    """A block that may take so many seconds, by the clock or of the processor; None: what the block around it may, if
    any."""
    limit = (_limit.get() or TimeLimit(float("inf"))) if seconds is None else TimeLimit(seconds, 0.0, of_processor)
    token = _limit.set(limit)
    try:
        yield limit
    finally:
        _limit.reset(token)


def is_limited() -> bool:
    """Whether a block around this has a limit."""
    return _limit.get() is not None


def time_is_over(share: float = 1.0) -> bool:
    """Whether a share of the time that the innermost block may take has passed; never outside of one."""
    limit = _limit.get()
    return limit is not None and limit.is_over(share)


# --- An end that is asked for from outside: a computation that can answer with what it has does so.


@dataclass
class _EarlyEnd:
    """The computations that can end early, and the number of the signal that asked for it; 0: none did."""

    blocks: int = 0
    asked_by: int = 0
    at_once: int = 0
    told: Callable[[bool], None] = field(default=lambda _: None)


_early = _EarlyEnd()


@contextmanager
def ends_early() -> Iterator[None]:
    """A block whose loops ask :func:`time_is_over` and that answers with what it has when they end."""
    _early.blocks += 1
    _early.told(True)
    try:
        yield
    finally:
        _early.blocks -= 1


@contextmanager
def reports_at_once() -> Iterator[None]:
    """A block that a signal interrupts wherever it is, and that then reports what it knows: see :func:`interrupted`."""
    _early.at_once += 1
    _early.told(True)
    try:
        yield
    finally:
        _early.at_once -= 1


def interrupted(number: int) -> None:
    """Say that a signal ended the computation, whose report is still to come."""
    _early.asked_by = number


def end_early(number: int) -> bool:
    """Ask the running computation to end with what it has; False where none can, or it was asked before.

    Parameters
    ----------
    number : int
        Of the signal that asks.
    """
    if not _early.blocks or _early.at_once or _early.asked_by:
        return False
    _early.asked_by = number
    return True


def ended_early_by() -> int:
    """Number of the signal that asked for an early end; 0: none did."""
    return _early.asked_by


def tell_ends_early(told: Callable[[bool], None]) -> None:
    """Let whoever supervises this process know that a computation can end early."""
    _early.told = told
