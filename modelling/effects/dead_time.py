"""An input that acts with a delay."""

from __future__ import annotations

from collections.abc import Iterator

from modelling.effects.delay_guesses import delays_near, first_delays, late
from modelling.effects.first_guess import FittedMotion, Guess
from modelling.effects.interface import EquationBuilder, InputPath, Symbols
from modelling.effects.kind import Kind, Parameter
from modelling.effects.recorded_range import RecordedRange


class DeadTime(Kind):
    """Acts ``delay`` (s) later than recorded."""

    kind = "dead_time"
    words = "acts {delay} later than recorded"
    in_recording = "every response begins later by the same time; the phase falls in proportion to frequency."
    tables = ("inputs",)
    parameters = {"delay": Parameter("s", lower=0.0)}
    only_delays = True
    shareable = True

    def input(self, path: InputPath, p: Symbols, assembly: EquationBuilder) -> None:
        path.delay += p["delay"]

    def guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        yield from first_delays(motion, late(motion, at), "delay")

    def nearby(self, motion: FittedMotion, at: str, best: dict[str, float]) -> Iterator[Guess]:
        return delays_near(motion, late(motion, at), "delay", best["delay"])

    def recorded_bounds(self, key: str, at: str, recorded: RecordedRange) -> tuple[float, float]:
        return 0.0, recorded.longest_memory
