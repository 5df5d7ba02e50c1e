"""An input with a constant error."""

from __future__ import annotations

from collections.abc import Iterator

from modelling.effects.first_guess import FittedMotion, Guess
from modelling.effects.interface import Drivetrain, EquationBuilder, InputPath, Symbols
from modelling.effects.kind import Kind, Parameter


class InputOffset(Kind):
    """Acts with ``offset`` (N·m) more than recorded.

    No recording tells it from a constant torque on the inertia of the input, with the opposite sign: a diagnosis looks
    for that, and names both.
    """

    kind = "input_offset"
    words = "acts with {offset} more than recorded"
    in_recording = "the motion drifts to one side though the recorded torque has none, as under a constant torque."
    tables = ("inputs",)
    zero_of_recording = True
    parameters = {"offset": Parameter("N*m")}

    def input(self, path: InputPath, p: Symbols, assembly: EquationBuilder) -> None:
        path.value += p["offset"]

    def candidate_places(self, system: Drivetrain) -> list[str]:
        return []

    def guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        yield Guess(({at: motion.time * 0 + 1.0},), lambda a: {"offset": float(a[0])})
