"""Ctrl-C and SIGTERM: asked for once, never lost, and not in the middle of moving results to their places."""

from __future__ import annotations

import contextlib
import ctypes
import functools
import os
import signal
import sys
import threading
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass, field
from pathlib import Path
from time import monotonic
from types import FrameType

from modelling.errors import BAD_INPUT, InputError, of_the_machine

# --- How many cores of this machine there are to work on.


def cores() -> int:
    """Cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@functools.cache
def threads() -> int:
    """How many threads share a batch: ``OMP_NUM_THREADS`` where that is set, as for any library, else all cores."""
    limit = os.environ.get("OMP_NUM_THREADS", "")
    return int(limit) if limit.isdecimal() and int(limit) > 0 else cores()


# --- The processor's floating-point state, which some compiled libraries change for the whole process.


def restore() -> None:
    """Go back to IEEE 754 as a process starts with it: numbers below 2.2e-308 are no longer flushed to zero.

    Libraries built with -ffast-math switch that on for the thread that loads or calls them. Where the C library does
    not offer ``fesetenv`` with its default environment, nothing happens.
    """
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).fesetenv(ctypes.c_void_p(-1))


# --- Interruption

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


# --- Too little memory: limits are read before libraries are loaded, and a thread that gets none ends the program.
#
# Below what its libraries need OpenBLAS asks for memory for ever, workers wait for threads that are gone, and modules
# fail in odd ways; so a limit that leaves no room is an error at once.

LEAST_BYTES = 1_000_000_000  # of addresses; a match with its libraries and their threads' stacks takes 0.8e9 to 0.9e9


def check_memory() -> None:
    """Refuse a limit on memory that leaves no room for the libraries.

    Raises
    ------
    InputError
        Naming the limit, which is smaller than :data:`LEAST_BYTES`.
    """
    with suppress(ImportError):  # Windows has none
        import resource

        for name, limit in (("ulimit -v", resource.RLIMIT_AS), ("ulimit -d", resource.RLIMIT_DATA)):
            allowed = resource.getrlimit(limit)[0]
            if allowed != resource.RLIM_INFINITY and allowed < LEAST_BYTES:
                raise InputError(
                    f"this machine: {name}",
                    f"{allowed / 1e6:.0f} MB are allowed, too few for the libraries",
                    f"allow at least {LEAST_BYTES / 1e6:.0f} MB ({name} {-(-LEAST_BYTES // 1024)})",
                )


def end_where_a_thread_has_none() -> None:
    """From now on a thread that ends without memory ends the program with one line: others would wait for it."""
    as_before = threading.excepthook

    def ended(end: threading.ExceptHookArgs) -> None:
        line = of_the_machine(end.exc_value) if end.exc_value else None
        if line is None:
            as_before(end)
            return
        print(f"rigmatch: {line}", file=sys.stderr, flush=True)
        os._exit(BAD_INPUT)

    threading.excepthook = ended


# --- What a command reads is not replaced by what it writes, where both lie in one folder.

_inputs: set[tuple[int, int]] | None = None  # device and number of the files of a running command; None: not asked for


@contextlib.contextmanager
def protected(files: Iterable[str]) -> Iterator[None]:
    """Until the end of the block results replace none of these files, nor any that is read in it by :func:`note`."""
    global _inputs
    _inputs = set()
    try:
        for file in files:
            note(file)
        yield
    finally:
        _inputs = None


def note(file: str | os.PathLike[str]) -> None:
    """Protect a file, and the link that it may be, where the running command asked for it."""
    if _inputs is None:
        return
    for status in (os.stat, os.lstat):
        with contextlib.suppress(OSError, ValueError):
            at = status(file)
            _inputs.add((at.st_dev, at.st_ino))


def check_protected(directory: str | os.PathLike[str], names: Iterable[str]) -> None:
    """Refuse files of these names in a folder if one of them is an input of this command.

    Raises
    ------
    InputError
        Naming the first that is.
    """
    for name in names if _inputs else ():
        place = Path(directory) / name
        try:
            at = os.lstat(place)
        except (OSError, ValueError):
            continue
        if (at.st_dev, at.st_ino) in (_inputs or ()):
            raise InputError(str(place), "is read by this command and would be replaced", "name another --out")


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
