"""A quantity that differs from what the model states."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Protocol

from modelling.effects.first_guess import FittedMotion, Guess
from modelling.effects.interface import Drivetrain
from modelling.effects.kind import Kind, Parameter


class Quantified(Protocol):
    """What has a value, SI."""

    value: float


class WrongParameter(Kind):
    """The quantity at the place (e.g. ``inertias.body.J``) is ``value`` instead."""

    kind = "wrong_parameter"
    words = "is {value}, not what the model gives"
    in_recording = "the frequencies of modes are off, in every recording and at every amplitude alike."
    tables = ("inertias", "shafts", "gears")
    parameters = {"value": Parameter("quantity")}
    linear = True
    replaces_quantity = True

    def places(self, system: Drivetrain) -> list[str]:
        return [name for name in system.parameters if name.count(".") == 2]

    def candidate_places(self, system: Drivetrain) -> list[str]:
        """A whole-number ratio is counted in teeth: it is known, and what looks like another one is a loss."""
        counted = {name for name in system.parameters if name.endswith(".ratio") and _whole(system.parameters[name])}
        return [name for name in self.places(system) if name not in counted]

    def guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        known = motion.value[at]
        scale = abs(known) or 1.0
        yield Guess(
            ({at: scale},),
            lambda a: {"value": known + scale * float(a[0])} if known + scale * float(a[0]) >= 0 else None,
        )

    def fit_bounds(self, key: str, guess: float, step: float) -> tuple[float, float]:
        return (0.0, float("inf")) if guess > 0 else super().fit_bounds(key, guess, step)


def _whole(quantity: Quantified) -> bool:
    return float(quantity.value).is_integer()
