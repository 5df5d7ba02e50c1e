"""A sensor that reads with a delay."""

from __future__ import annotations

from collections.abc import Iterator

from modelling.effects.first_guess import FittedMotion, Guess, if_positive
from modelling.effects.interface import EquationBuilder, SensorPath, Symbols
from modelling.effects.kind import Kind, Parameter
from modelling.effects.recorded_range import RecordedRange


class SensorDelay(Kind):
    """Reads the value of ``delay`` (s) ago."""

    kind = "sensor_delay"
    words = "reads {delay} late"
    in_recording = "this channel alone is late by the same time at all frequencies; no other channel is off."
    tables = ("sensors",)
    parameters = {"delay": Parameter("s", lower=0.0)}
    only_delays = True
    shareable = True

    def sensor(self, path: SensorPath, p: Symbols, assembly: EquationBuilder) -> None:
        path.delay += p["delay"]

    def guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        signal = motion.reading[at.split(".")[1]]
        for delay in (1e-3, 4e-3, 1.6e-2, 6.4e-2):
            yield Guess(({at: motion.delayed(signal, delay) - signal},), if_positive("delay", delay))

    def recorded_bounds(self, key: str, at: str, recorded: RecordedRange) -> tuple[float, float]:
        return 0.0, recorded.longest_memory
