"""Damping of a shaft that grows with the square of its twist rate (hydraulic damper, oil between plates)."""

from __future__ import annotations

from collections.abc import Iterator

from modelling.effects.first_guess import FittedMotion, Guess, if_positive
from modelling.effects.interface import EquationBuilder, ShaftLaw, Symbols
from modelling.effects.kind import Kind, Parameter


class QuadraticDamping(Kind):
    """Adds coefficient·rate·|rate| to a shaft's torque, rate that of the twist."""

    kind = "quadratic_damping"
    words = "has damping that grows with the square of the twist rate by {coefficient}"
    in_recording = "large oscillations die out faster than small ones."
    tables = ("shafts",)
    parameters = {"coefficient": Parameter("N*m*s^2/rad^2", lower=0.0)}
    state_dependent = True

    def shaft(self, law: ShaftLaw, p: Symbols, assembly: EquationBuilder) -> None:
        law.quadratic += p["coefficient"]

    def guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        rate = motion.twist_rate[at.split(".")[1]]
        yield Guess(({at: rate * abs(rate)},), if_positive("coefficient"))
