"""What commands share: whole numbers as arguments, and a progress bar where a terminal watches."""

import argparse
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager


def count(least: int) -> Callable[[str], int]:
    """An argument that is a whole number, ``least`` or more."""

    def whole(text: str) -> int:
        try:
            number = int(text)
        except ValueError:
            raise argparse.ArgumentTypeError(f"{text!r} is no whole number") from None
        if number < least:
            raise argparse.ArgumentTypeError(f"{number} is less than {least}")
        return number

    return whole


@contextmanager
def progress(what: str) -> Iterator[Callable[[int, int], None]]:
    """A progress bar on standard error while a terminal watches; yields a function of (done, of how many)."""
    from tqdm import tqdm

    with tqdm(desc=what, file=sys.stderr, disable=not sys.stderr.isatty(), leave=False) as bar:

        def advance(done: int, total: int) -> None:
            bar.total = total
            bar.update(done - bar.n)

        yield advance
