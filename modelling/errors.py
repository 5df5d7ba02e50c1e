"""Errors, one class for each thing: bad input, a fit that does not exist, a design that does not exist."""

import errno
from difflib import get_close_matches

ANSWERED, FAULT, BAD_INPUT, DEFECT = 0, 1, 2, 3  # exit codes of the command line; DEFECT: one was found on the bed

_NO_SPACE = ("no space is left on the disk", "free some, or write to another one")
_TOO_MANY_FILES = ("too many files are open", "raise the limit (ulimit -n), or use fewer --workers")
_NO_MEMORY = ("there is not enough memory", "close other programs, or use fewer --workers")
_MACHINE = {
    errno.ENOSPC: _NO_SPACE,
    errno.EDQUOT: _NO_SPACE,
    errno.EROFS: ("the disk is read-only", "write to another one"),
    errno.EFBIG: ("the file is larger than this machine allows", "raise the limit (ulimit -f)"),
    errno.EIO: ("the disk fails (input/output error)", "check it, or write to another one"),
    errno.EMFILE: _TOO_MANY_FILES,
    errno.ENFILE: _TOO_MANY_FILES,
    errno.ENOMEM: _NO_MEMORY,
    errno.EAGAIN: ("no further process or thread can be begun", "close other programs, or use fewer --workers"),
    errno.ENAMETOOLONG: ("the name is too long", "name a shorter one"),
    errno.ELOOP: ("links lead round in a circle", "name another path"),
}
_NO_MEMORY_SAYS = ("bad_alloc", "failed to map segment", "cannot allocate memory", "can't start new thread")


class InputError(Exception):
    """Bad input from a user's file or call: one line that names where, what is wrong and what would be right.

    The command line prints it on standard error and exits with 2.

    Parameters
    ----------
    where : str
        File, key or line the fault sits in, e.g. ``vehicle.toml: inertias.motor.J``.
    wrong : str
        What is wrong.
    right : str, optional
        What would be right.
    """

    def __init__(self, where: str, wrong: str, right: str = ""):
        self.where, self.wrong, self.right = (_plain(str(part)) for part in (where, wrong, right))
        line = f"{self.where}: {self.wrong}" if self.where else self.wrong
        super().__init__(f"{line}; {self.right}" if self.right else line)

    def __reduce__(self) -> tuple[type["InputError"], tuple[str, str, str]]:
        return type(self), (self.where, self.wrong, self.right)


class ExcludedEffects(InputError):
    """Effects of a model that exclude each other, or one that has no law where it sits: no such system exists."""


class FitError(Exception):
    """A fit to measured data does not exist: the model does not simulate, or no value of its parameters is found."""


class NoDesign(Exception):
    """A controller, a bed or a match with the values asked for does not exist."""


def _plain(text: str, longest: int = 400) -> str:
    """Text in one line without control characters, its middle left out where it is longer than ``longest``."""
    line = "".join(letter if letter.isprintable() else "�" for letter in " ".join(text.split()))
    return line if len(line) <= longest else f"{line[: longest // 2]} … {line[-longest // 2 :]}"


def of_the_machine(error: BaseException) -> InputError | None:
    """One line where the machine is what fails (disk, memory, open files), not the program; else None."""
    step: BaseException | None = error
    while step is not None:
        where = "this machine"
        if isinstance(step, OSError) and step.errno in _MACHINE:
            if isinstance(step.filename, str | bytes):
                where = str(step.filename)
            return InputError(where, *_MACHINE[step.errno])
        if isinstance(step, MemoryError) or any(words in str(step).lower() for words in _NO_MEMORY_SAYS):
            return InputError(where, *_NO_MEMORY)
        step = step.__cause__ or step.__context__
    return None


def unknown(name: str, known: list[str], where: str) -> InputError:
    """The error for a name that does not exist, with the nearest one that does."""
    near = get_close_matches(str(name), known, 1, 0.6)
    return InputError(
        where, f"{name!r} does not exist", f"did you mean {near[0]!r}?" if near else f"known are {listed(known)}"
    )


def listed(names: list[str], most: int = 12) -> str:
    """Names in a sentence, not more than ``most``."""
    sentence = ", ".join(names[:most]) or "none"
    return sentence + (f" and {len(names) - most} more" if len(names) > most else "")


# --- The version of rigmatch, in this one place.

VERSION = "0.2.0"
