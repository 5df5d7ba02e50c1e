"""The one error that bad input raises."""


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
    """Text in one line without control characters, cut in the middle where it is endless."""
    line = "".join(letter if letter.isprintable() else "�" for letter in " ".join(text.split()))
    return line if len(line) <= longest else f"{line[: longest // 2]} … {line[-longest // 2 :]}"
