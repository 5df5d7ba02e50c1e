"""An actuator or a sensor whose gain changes while it warms up."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from modelling.effects.first_guess import FittedMotion, Guess
from modelling.effects.interface import EquationBuilder, InputPath, SensorPath, Symbols
from modelling.effects.kind import Kind
from modelling.effects.warming import PARAMETERS, STATE, done_after, drift_bounds, factor, first_guesses


class GainDrift(Kind):
    """The input acts, or the sensor reads, 1 + change·(1 − exp(−t/time_constant)) times the value.

    t counts from the start of the recording. In steady motion the change has happened; linear models at rest are
    without it.
    """

    kind = "gain_drift"
    words = "has a gain that changes by a factor of 1 + {change} with a time constant of {time_constant}"
    in_recording = "amplitudes of one channel beside those of the others grow or fall from beginning to end."
    tables = ("inputs", "sensors")
    parameters = PARAMETERS
    state = STATE

    def input(self, path: InputPath | SensorPath, p: Symbols, assembly: EquationBuilder) -> None:
        path.value *= factor(p, assembly, f"{path.place}.{self.kind}")

    def sensor(self, path: SensorPath, p: Symbols, assembly: EquationBuilder) -> None:
        self.input(path, p, assembly)

    def state_after(self, seconds: float, parameters: Mapping[str, float]) -> float:
        return done_after(seconds, parameters["time_constant"])

    def guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        yield from first_guesses(motion, at, motion.signal(at))

    def fit_bounds(self, key: str, guess: float, step: float) -> tuple[float, float]:
        return drift_bounds(guess) if key == "time_constant" else super().fit_bounds(key, guess, step)

    def nearby(self, motion: FittedMotion, at: str, best: dict[str, float]) -> Iterator[Guess]:
        yield from first_guesses(motion, at, motion.signal(at), bent=True)
