"""A sensor with a wrong scale factor."""

from __future__ import annotations

from collections.abc import Iterator

from modelling.effects.first_guess import FittedMotion, Guess
from modelling.effects.interface import EquationBuilder, SensorPath, Symbols
from modelling.effects.kind import Kind, Parameter


class SensorGain(Kind):
    """Reads ``factor`` times the true value."""

    kind = "sensor_gain"
    words = "reads {factor} times the true value"
    in_recording = "this channel alone is off by one factor, also where the motion is slow."
    tables = ("sensors",)
    parameters = {"factor": Parameter("1")}
    shareable = True
    linear = True

    def sensor(self, path: SensorPath, p: Symbols, assembly: EquationBuilder) -> None:
        path.value *= p["factor"]

    def guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        yield Guess(({at: motion.reading[at.split(".")[1]]},), lambda a: {"factor": 1 + float(a[0])})
