"""An input with a wrong scale factor."""

from __future__ import annotations

from collections.abc import Iterator

from modelling.effects.first_guess import FittedMotion, Guess
from modelling.effects.interface import EquationBuilder, InputPath, Symbols
from modelling.effects.kind import Kind, Parameter


class InputGain(Kind):
    """Acts with ``factor`` times the recorded value."""

    kind = "input_gain"
    words = "acts with {factor} times the recorded value"
    in_recording = "all responses to this input are too large or too small by one factor, whatever the frequency."
    tables = ("inputs",)
    parameters = {"factor": Parameter("1")}
    shareable = True
    linear = True

    def input(self, path: InputPath, p: Symbols, assembly: EquationBuilder) -> None:
        path.value *= p["factor"]

    def guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        yield Guess(({at: motion.input[at.split(".")[1]]},), lambda a: {"factor": 1 + float(a[0])})
