"""First-order lag of an input or a sensor."""

from __future__ import annotations

from collections.abc import Iterator

from modelling.effects.first_guess import FittedMotion, Guess, if_positive
from modelling.effects.interface import EquationBuilder, InputPath, SensorPath, Symbols
from modelling.effects.kind import Kind, Parameter, State
from modelling.effects.recorded_range import RecordedRange


class Lag(Kind):
    """First-order lag with ``time_constant`` (s)."""

    kind = "lag"
    words = "follows with a first-order lag of {time_constant}"
    in_recording = "edges are rounded; amplitude falls and phase lags above 1/(2π·time constant)."
    tables = ("inputs", "sensors")
    parameters = {"time_constant": Parameter("s", lower=1e-7)}
    shareable = True
    state = State("signal", "{place} behind its lag", settles=True)
    linear = True

    def input(self, path: InputPath | SensorPath, p: Symbols, assembly: EquationBuilder) -> None:
        value = path.value
        path.value = assembly.add_state(
            f"{path.place}.{self.kind}", lambda lagged: (value - lagged) / p["time_constant"]
        )

    def sensor(self, path: SensorPath, p: Symbols, assembly: EquationBuilder) -> None:
        at_once = path.value.subs(assembly.time, 0)
        ramp = path.value - at_once
        path.value = at_once
        self.input(path, p, assembly)
        path.value += ramp.subs(assembly.time, assembly.time - p["time_constant"])  # a drift, after the lag has settled

    def guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        signal = motion.signal(at)
        for time_constant in (1e-3, 4e-3, 1.6e-2, 6.4e-2):
            yield Guess(
                ({at: motion.lagged(signal, time_constant) - signal},), if_positive("time_constant", time_constant)
            )

    def fit_bounds(self, key: str, guess: float, step: float) -> tuple[float, float]:
        return (0.25 * step, max(20 * guess, step))

    def recorded_bounds(self, key: str, at: str, recorded: RecordedRange) -> tuple[float, float]:
        return 0.0, recorded.longest_memory
