"""An input that acts with a delay."""

from __future__ import annotations

from collections.abc import Iterator

from modelling.effects.first_guess import FittedMotion, Guess, if_positive
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
        signal = motion.input[at.split(".")[1]]
        for delay in (1e-3, 4e-3, 1.6e-2, 6.4e-2):
            yield Guess(({at: motion.delayed(signal, delay) - signal},), if_positive("delay", delay))

    def recorded_bounds(self, key: str, at: str, recorded: RecordedRange) -> tuple[float, float]:
        return 0.0, recorded.longest_memory
