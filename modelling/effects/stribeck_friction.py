"""Dry friction that falls from breakaway to sliding (Stribeck)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial

import numpy as np
from sympy import exp

from modelling.effects.first_guess import FittedMotion, Guess, smooth_sign
from modelling.effects.interface import Drivetrain, EquationBuilder, Motion, Symbols
from modelling.effects.kind import Kind, Parameter, SimplerEffect
from modelling.effects.recorded_range import RecordedRange


class StribeckFriction(Kind):
    """sgn(speed)·(torque + (breakaway − torque)·exp(−(speed/``speed``)²))."""

    kind = "stribeck_friction"
    words = "has dry friction of {torque} that is {breakaway} from rest and falls off over {speed}"
    in_recording = "the drive breaks away with a jerk and may creep by stick and slip at low speed."
    tables = ("inertias",)
    parameters = {
        "torque": Parameter("N*m", lower=0.0),
        "breakaway": Parameter("N*m", lower=0.0),
        "speed": Parameter("rad/s", lower=1e-6),
    }
    state_dependent = True
    sticks = True

    def inertia(self, motion: Motion, p: Symbols, assembly: EquationBuilder, name: str) -> None:
        sliding = p["torque"] + (p["breakaway"] - p["torque"]) * exp(-((motion.speed / p["speed"]) ** 2))
        assembly.add_torque(name, -assembly.sign(motion.speed) * sliding, motion)

    def simpler(
        self, at: str, parameters: Mapping[str, float], value: Mapping[str, float], system: Drivetrain
    ) -> Iterator[SimplerEffect]:
        """Coulomb friction, where the torque hardly falls or the speed is seldom in the range over which it does."""
        yield SimplerEffect("coulomb_friction", at, {"torque": parameters["torque"]})

    def guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        speed = motion.speed[at.split(".")[1]]
        sign = smooth_sign(speed)
        for share in (0.05, 0.15, 0.4):  # of the standard deviation of the speed
            scale = share * float(speed.std()) + 1e-9
            yield Guess(
                ({at: -sign}, {at: -sign * np.exp(-((speed / scale) ** 2))}),
                partial(_friction, scale),
            )

    def recorded_bounds(self, key: str, at: str, recorded: RecordedRange) -> tuple[float, float]:
        largest = recorded.torque[at.split(".")[1]]
        return (-largest, largest) if key != "speed" else super().recorded_bounds(key, at, recorded)

    def possible(self, parameters: Mapping[str, float]) -> bool:
        return parameters["breakaway"] >= parameters["torque"]


def _friction(speed: float, a: np.ndarray) -> dict[str, float] | None:
    """Sliding and breakaway torque from the amplitudes of the constant and of the decaying part."""
    sliding, breakaway = float(a[0]), float(a[0] + a[1])
    return {"torque": max(sliding, 0.0), "breakaway": breakaway, "speed": speed} if breakaway > 0 else None
