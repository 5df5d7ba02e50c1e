"""Drag that grows with the square of speed (air, churning)."""

from __future__ import annotations

from collections.abc import Iterator

from sympy import Abs

from modelling.effects.first_guess import FittedMotion, Guess, if_positive
from modelling.effects.interface import EquationBuilder, Motion, Symbols
from modelling.effects.kind import Kind, Parameter


class QuadraticDrag(Kind):
    """coefficient·speed·|speed|, resisting."""

    kind = "quadratic_drag"
    words = "has drag that grows with the square of speed by {coefficient}"
    in_recording = "the torque that holds a speed grows with the square of it; nothing is off at low speed."
    tables = ("inertias",)
    parameters = {"coefficient": Parameter("N*m*s^2/rad^2", lower=0.0)}
    state_dependent = True
    speed_exponent = 2

    def inertia(self, motion: Motion, p: Symbols, assembly: EquationBuilder, name: str) -> None:
        assembly.add_torque(name, -p["coefficient"] * motion.speed * Abs(motion.speed), motion)

    def guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        speed = motion.speed[at.split(".")[1]]
        yield Guess(({at: -speed * abs(speed)},), if_positive("coefficient"))
