"""A sensor with a constant error."""

from __future__ import annotations

from collections.abc import Iterator

from modelling.effects.first_guess import FittedMotion, Guess
from modelling.effects.interface import EquationBuilder, SensorPath, Symbols
from modelling.effects.kind import Kind, Parameter
from modelling.effects.recorded_range import RecordedRange


class SensorOffset(Kind):
    """Reads ``offset`` more than the true value."""

    kind = "sensor_offset"
    words = "reads {offset} too much"
    in_recording = "this channel alone differs by a constant, at standstill as well."
    tables = ("sensors",)
    parameters = {"offset": Parameter("sensor")}

    def sensor(self, path: SensorPath, p: Symbols, assembly: EquationBuilder) -> None:
        path.value += p["offset"]

    def guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        yield Guess(({at: motion.time * 0 + 1.0},), lambda a: {"offset": float(a[0])})

    def recorded_bounds(self, key: str, at: str, recorded: RecordedRange) -> tuple[float, float]:
        largest = recorded.largest_reading[at.split(".")[1]]
        return -largest, largest
