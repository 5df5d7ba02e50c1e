"""A resisting torque that does not depend on motion (grade, offset load)."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from modelling.effects.first_guess import FittedMotion, Guess
from modelling.effects.input_offset import InputOffset
from modelling.effects.interface import Drivetrain, EquationBuilder, Motion, Symbols
from modelling.effects.kind import Kind, Parameter
from modelling.effects.recorded_range import RecordedRange


class ConstantTorque(Kind):
    """A constant ``torque`` against positive motion."""

    kind = "constant_torque"
    words = "bears a resisting torque of {torque} that does not depend on motion"
    in_recording = (
        "the speed that a constant motor torque holds is lower than the model's by the same torque in both "
        "directions of load, and at standstill the drive does not stay at rest."
    )
    tables = ("inertias",)
    zero_of_recording = True
    parameters = {"torque": Parameter("N*m")}
    speed_exponent = 0

    def inertia(self, motion: Motion, p: Symbols, assembly: EquationBuilder, name: str) -> None:
        assembly.add_torque(name, -p["torque"], motion)

    def guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        yield Guess(({at: -np.ones_like(motion.time)},), lambda a: {"torque": float(a[0])})

    def same_as(self, at: str, system: Drivetrain) -> list[tuple[str, str]]:
        """An offset of each input on the inertia, with the opposite sign."""
        return [(InputOffset.kind, f"inputs.{part.name}") for part in system.inputs if f"inertias.{part.on}" == at]

    def recorded_bounds(self, key: str, at: str, recorded: RecordedRange) -> tuple[float, float]:
        largest = recorded.torque[at.split(".")[1]]
        return -largest, largest
