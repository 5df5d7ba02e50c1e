"""A sensor whose zero drifts."""

from __future__ import annotations

from collections.abc import Iterator

from modelling.effects.first_guess import FittedMotion, Guess
from modelling.effects.interface import EquationBuilder, SensorPath, Symbols
from modelling.effects.kind import Kind, Parameter
from modelling.effects.recorded_range import RecordedRange


class SensorDrift(Kind):
    """Offset that grows with ``rate`` per second from the start of the recording."""

    kind = "sensor_drift"
    words = "drifts by {rate}"
    in_recording = "the difference to the model grows in a straight line with time, at standstill as well."
    tables = ("sensors",)
    parameters = {"rate": Parameter("sensor/s")}

    def sensor(self, path: SensorPath, p: Symbols, assembly: EquationBuilder) -> None:
        path.value += p["rate"] * assembly.time

    def guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        yield Guess(({at: motion.time},), lambda a: {"rate": float(a[0])})

    def recorded_bounds(self, key: str, at: str, recorded: RecordedRange) -> tuple[float, float]:
        fastest = recorded.width[at.split(".")[1]] / recorded.duration
        return -fastest, fastest
