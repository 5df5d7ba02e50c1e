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
        self.where, self.wrong, self.right = (" ".join(str(part).split()) for part in (where, wrong, right))
        line = f"{self.where}: {self.wrong}" if self.where else self.wrong
        super().__init__(f"{line}; {self.right}" if self.right else line)

    def __reduce__(self) -> tuple[type["InputError"], tuple[str, str, str]]:
        return type(self), (self.where, self.wrong, self.right)
