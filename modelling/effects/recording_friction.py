"""Dry friction that differs between recordings: warm and cold, with and without a seal, before and after a repair."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from sympy import Abs, Add, Expr

from modelling.effects.first_guess import FittedMotion, Guess, smooth_sign
from modelling.effects.interface import Drivetrain, EquationBuilder, Motion, Symbols
from modelling.effects.kind import Kind, Parameter, SimplerEffect
from modelling.effects.recorded_range import RecordedRange

MOST_RECORDINGS = 24


class RecordingFriction(Kind):
    """torque[i]·sgn(speed) in the i-th recording that was fitted; their mean in any other motion."""

    kind = "recording_friction"
    words = "has dry friction that differs between the recordings"
    in_recording = "speeds stop dead, and the torque that is missing is another constant in every recording."
    tables = ("inertias",)
    arrays = ("torque",)
    parameters = {f"torque_{i}": Parameter("N*m", lower=0.0, optional=True) for i in range(1, MOST_RECORDINGS + 1)}
    state_dependent = True
    sticks = True
    by_recording = "torque"

    def inertia(self, motion: Motion, p: Symbols, assembly: EquationBuilder, name: str) -> None:
        torques = [p[f"torque_{i}"] for i in range(1, len(p) + 1)]
        mean = _share(assembly.recording) / len(torques)
        torque = Add(*((_share(assembly.recording - i) + mean) * t for i, t in enumerate(torques, 1)))
        assembly.add_torque(name, -torque * assembly.sign(motion.speed), motion)

    def fault(self, at: str, values: Mapping[str, float]) -> str:
        return "" if values else "needs a list torque, one for every recording"

    def guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        count = int(motion.recording.max(initial=0))
        if not 1 < count <= MOST_RECORDINGS:
            return
        sign = smooth_sign(motion.speed[at.split(".")[1]])
        additions = tuple({at: np.where(motion.recording == i, -sign, 0.0)} for i in range(1, count + 1))
        yield Guess(additions, _torques)

    def simpler(
        self, at: str, parameters: Mapping[str, float], value: Mapping[str, float], system: Drivetrain
    ) -> Iterator[SimplerEffect]:
        yield SimplerEffect("coulomb_friction", at, {"torque": sum(parameters.values()) / len(parameters)})

    def recorded_bounds(self, key: str, at: str, recorded: RecordedRange) -> tuple[float, float]:
        largest = recorded.torque[at.split(".")[1]]
        return -largest, largest


def _share(difference: Expr) -> Expr:
    """1 where the difference is 0, and 0 where it is 1 or more."""
    return (1 - Abs(difference) + Abs(1 - Abs(difference))) / 2


def _torques(a: np.ndarray) -> dict[str, float] | None:
    """No friction where the guess drives; no such effect where it does so in every recording."""
    return {f"torque_{i}": max(float(x), 0.0) for i, x in enumerate(a, 1)} if a.max() > 0 else None
