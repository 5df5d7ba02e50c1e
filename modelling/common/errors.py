"""The one error that bad input raises."""

from difflib import get_close_matches


class InputError(ValueError):
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


def _plain(text: str, longest: int = 400) -> str:
    """Text in one line without control characters, its middle left out where it is longer than ``longest``."""
    line = "".join(letter if letter.isprintable() else "�" for letter in " ".join(text.split()))
    return line if len(line) <= longest else f"{line[: longest // 2]} … {line[-longest // 2 :]}"


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
