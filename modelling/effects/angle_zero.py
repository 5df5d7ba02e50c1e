"""The zero of an angle sensor."""

from __future__ import annotations

from collections.abc import Iterator

from modelling.effects.first_guess import FittedMotion, Guess
from modelling.effects.interface import Drivetrain, EquationBuilder, SensorPath, Symbols
from modelling.effects.kind import Kind, Parameter


class AngleZero(Kind):
    """Reads ``zero`` (rad) where the angle is 0; an encoder starts anywhere, in every recording anew.

    A fit estimates the zeros of angle sensors anyway, one for every recording; no diagnosis names them as a cause.
    """

    kind = "angle_zero"
    words = "reads {zero} where the angle is zero"
    in_recording = "a constant difference between two angles, another one in every recording; nothing is wrong."
    tables = ("sensors",)
    parameters = {"zero": Parameter("rad")}

    def sensor(self, path: SensorPath, p: Symbols, assembly: EquationBuilder) -> None:
        path.value += p["zero"]

    def guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        yield from ()

    def places(self, system: Drivetrain) -> list[str]:
        return [f"sensors.{sensor.name}" for sensor in system.sensors if sensor.measures == "angle"]
