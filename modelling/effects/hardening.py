"""A shaft whose stiffness grows or falls with its twist."""

from __future__ import annotations

from collections.abc import Iterator

from modelling.effects.first_guess import FittedMotion, Guess
from modelling.effects.interface import EquationBuilder, ShaftLaw, Symbols
from modelling.effects.kind import Kind, Parameter


class Hardening(Kind):
    """Adds cubic·twist³ to the elastic torque; a negative value softens."""

    kind = "hardening"
    words = "has a torque that grows by {cubic} with the cube of its twist"
    in_recording = "the resonance frequency changes with amplitude, and torque over twist is a curve."
    tables = ("shafts",)
    parameters = {"cubic": Parameter("N*m/rad^3")}
    state_dependent = True

    def shaft(self, law: ShaftLaw, p: Symbols, assembly: EquationBuilder) -> None:
        law.potentials.append(lambda deflection: p["cubic"] * deflection**4 / 4)

    def guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        yield Guess(({at: motion.twist[at.split(".")[1]] ** 3},), lambda a: {"cubic": float(a[0])})
