"""What commands share: whole numbers as arguments, and a progress bar where a terminal watches."""

import argparse
import math
import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from matching.expected_end import time_left

PROGRESS_ALWAYS = "RIGMATCH_PROGRESS"  # in the environment: progress is told although no terminal watches


def count(least: int) -> Callable[[str], int]:
    """An argument that is a whole number, ``least`` or more; else the parser raises with one line."""

    def whole(text: str) -> int:
        try:
            number = int(text)
        except ValueError:
            raise argparse.ArgumentTypeError(f"{text!r} is no whole number") from None
        if number < least:
            raise argparse.ArgumentTypeError(f"{number} is less than {least}")
        return number

    return whole


def seconds(text: str) -> float:
    """Type of an argument that is a positive time in s.

    Raises
    ------
    argparse.ArgumentTypeError
        If the text is no positive, finite number.
    """
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"{text!r} is not a positive number of seconds")
    return value


def scale_out(parser: argparse.ArgumentParser) -> None:
    """Where a study runs: processes here, or a cluster."""
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--workers", metavar="N", type=count(1), help="processes (default: one a core)")
    where.add_argument("--scheduler", metavar="ADDRESS", help="Dask scheduler to run on, e.g. tcp://host:8786")


def completed(argument: argparse.Action, names: Callable[[argparse.Namespace], Iterable[str]]) -> None:
    """Have the shell complete an argument with names, found from the arguments that stand before it."""

    def completer(prefix: str, parsed_args: argparse.Namespace, **_: Any) -> list[str]:
        try:
            return [name for name in names(parsed_args) if name.startswith(prefix)]
        except Exception:  # a file that is not there yet or not right: nothing to offer, and the prompt stays clean
            return []

    argument.completer = completer  # type: ignore[attr-defined]


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

    ``shares``: what is known of the time that is over by then, see :mod:`matching.expected_end`.
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
