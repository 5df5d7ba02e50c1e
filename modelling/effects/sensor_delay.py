"""A sensor that reads with a delay."""

from __future__ import annotations

from collections.abc import Iterator

from modelling.effects.delay_guesses import delays_near, first_delays, late
from modelling.effects.first_guess import FittedMotion, Guess
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
        yield from first_delays(motion, late(motion, at), "delay")

    def nearby(self, motion: FittedMotion, at: str, best: dict[str, float]) -> Iterator[Guess]:
        return delays_near(motion, late(motion, at), "delay", best["delay"])

    def recorded_bounds(self, key: str, at: str, recorded: RecordedRange) -> tuple[float, float]:
        return 0.0, recorded.longest_memory
