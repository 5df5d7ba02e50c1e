"""The delay of a sensor as a linear model holds it: an all-pass of second order."""

from __future__ import annotations

from collections.abc import Iterator

from modelling.effects.first_guess import FittedMotion, Guess
from modelling.effects.interface import Drivetrain, EquationBuilder, SensorPath, Symbols
from modelling.effects.kind import SECOND_STATE, Kind, Parameter, State


class AllPass(Kind):
    """Two equal all-passes in a row, ((1 − s·delay/4)/(1 + s·delay/4))², in place of exp(−s·delay).

    Its gain is 1 at all frequencies and its phase −4·arctan(ω·delay/4), which is off by (ω·delay)³/48 rad: 0.002 rad at
    30 Hz for 2.5 ms. A case turns ``sensor_delay`` into it, for control design and simulation need states.
    """

    kind = "all_pass"
    words = "reads {delay} late (all-pass of second order)"
    in_recording = "this channel alone is late by the same time at all frequencies; no other channel is off."
    tables = ("sensors",)
    parameters = {"delay": Parameter("s", lower=1e-7)}
    shareable = True
    state = State("signal", "{place} behind the first half of its delay", settles=True)
    second_state = "{place} behind both halves of its delay"
    linear = True

    def sensor(self, path: SensorPath, p: Symbols, assembly: EquationBuilder) -> None:
        for name in (f"{path.place}.{self.kind}", f"{path.place}.{self.kind}{SECOND_STATE}"):
            value = path.value
            lagged = assembly.add_state(name, lambda z, value=value: 4 * (value - z) / p["delay"])  # type: ignore[misc]
            path.value = 2 * lagged - value

    def candidate_places(self, system: Drivetrain) -> list[str]:
        """None: a diagnosis looks for ``sensor_delay``."""
        return []

    def guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        yield from ()
