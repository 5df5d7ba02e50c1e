"""Ctrl-C and SIGTERM: asked for once, never lost, and not in the middle of moving results to their places."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

ENDING_SIGNALS = tuple(  # Windows has no SIGHUP
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
)


class Interrupted(KeyboardInterrupt):
    """A signal that ends the program, by its number."""

    def __init__(self, number: int = signal.SIGINT):
        super().__init__(number)
        self.number = int(number)

    @property
    def exit_code(self) -> int:
        """As shells have it: 130 for Ctrl-C, 143 for SIGTERM."""
        return 128 + self.number

    def __str__(self) -> str:
        return "interrupted" if self.number == signal.SIGINT else f"ended by {signal.Signals(self.number).name}"


_asked: list[int] = []  # numbers of the signals that came
_put_off: list[bool] = []  # one for each block that is not to be interrupted


def install() -> None:
    """Let the first signal that ends the program raise :class:`Interrupted`; one that is ignored stays ignored."""
    for number in ENDING_SIGNALS:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _raise_once)


def _raise_once(number: int, _frame: FrameType | None) -> None:
    """Raise the first time; later signals must not disturb the clearing up after the first."""
    _asked.append(number)
    if len(_asked) == 1 and not _put_off:
        raise Interrupted(number)


def raise_if_asked() -> None:
    """Raise what a library swallowed: solvers in C catch the exception and return as if they had ended.

    Raises
    ------
    Interrupted
        If a signal came that ends the program.
    """
    if _asked:
        raise Interrupted(_asked[0])


@contextmanager
def whatever_it_became() -> Iterator[None]:
    """An error after a signal that ends the program is that signal again.

    Python and libraries wrap the exception in their own where it comes in certain places: a class being made, a
    callback from C.

    Raises
    ------
    Interrupted
        If the block ends with another error and a signal came before.
    """
    try:
        yield
    except Exception:
        raise_if_asked()
        raise


@contextmanager
def none_swallowed() -> Iterator[None]:
    """Ctrl-C that a library in C swallows in the block ends it all the same, in a notebook too.

    There the handler is Python's own or the notebook's: what it raised is kept, and raised again after the block.

    Raises
    ------
    KeyboardInterrupt
        Or whatever the handler of Ctrl-C raised.
    """
    before = signal.getsignal(signal.SIGINT)
    if before is _raise_once or not callable(before) or threading.current_thread() is not threading.main_thread():
        yield
        raise_if_asked()
        return
    raised: list[BaseException] = []

    def keep(number: int, frame: FrameType | None) -> None:
        try:
            before(number, frame)
        except BaseException as end:
            raised.append(end)
            raise

    signal.signal(signal.SIGINT, keep)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
    if raised:
        raise raised[0]
    raise_if_asked()


@contextmanager
def put_off() -> Iterator[None]:
    """Signals that end the program wait until the block is done, which has to take milliseconds."""
    raise_if_asked()
    _put_off.append(True)
    try:
        yield
    finally:
        _put_off.pop()
    raise_if_asked()


def ignore_in_worker() -> None:
    """In a worker process: Ctrl-C in a terminal reaches it too, but its parent decides and ends it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
