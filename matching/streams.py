"""Standard input, output and error of a command that was begun without them, as by ``>&-`` or a service manager."""

import os
import sys


def open_closed() -> None:
    """Open the null device in place of each standard stream that is closed.

    Otherwise the next file that is opened takes its number, and what is meant for the terminal goes into that file.
    """
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest number that is free: this one
        if getattr(sys, name) is None:
            stream = open(number, "r" if number == 0 else "w", encoding="utf-8", closefd=False)  # noqa: SIM115
            setattr(sys, name, stream)
            setattr(sys, f"__{name}__", stream)
