"""A number in SI with the range it is known to lie in."""

from __future__ import annotations

import math
from dataclasses import dataclass

from modelling.common.errors import InputError


@dataclass(frozen=True)
class Quantity:
    """A value in SI; with ``lower`` and ``upper`` it is uncertain and may be identified, without it is taken as known.

    Attributes
    ----------
    value, lower, upper : float
        In the SI unit of the quantity; ``lower`` and ``upper`` are both given or both None.

    Raises
    ------
    InputError
        If a number is not finite or the bounds do not enclose the value.
    """

    value: float
    lower: float | None = None
    upper: float | None = None

    def __post_init__(self) -> None:
        if (self.lower is None) != (self.upper is None):
            raise InputError("", "a quantity has one bound only", "give lower and upper, or neither")
        numbers = (self.value,) if self.lower is None or self.upper is None else (self.value, self.lower, self.upper)
        if not all(math.isfinite(number) for number in numbers):
            raise InputError("", "a quantity is not finite", "write finite numbers")
        if self.lower is not None and self.upper is not None and not self.lower <= self.value <= self.upper:
            raise InputError(
                "",
                f"bounds {self.lower:g} … {self.upper:g} do not enclose {self.value:g}",
                "lower ≤ value ≤ upper is needed",
            )

    @property
    def uncertain(self) -> bool:
        """Whether it may be identified."""
        return self.lower is not None

    def designed(self, value: float) -> Quantity:
        """The same quantity designed with another value: its bounds stay as far from it as before, relatively."""
        if self.lower is None or self.upper is None or self.value == 0:
            return self.at(value)
        ends = value * self.lower / self.value, value * self.upper / self.value
        return Quantity(value, min(ends), max(ends))

    def at(self, value: float) -> Quantity:
        """The same quantity at another value; bounds widen where they must to enclose it."""
        if self.lower is None or self.upper is None:
            return Quantity(value)
        return Quantity(value, min(self.lower, value), max(self.upper, value))
