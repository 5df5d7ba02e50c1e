"""Dry friction of an inertia against ground."""

from __future__ import annotations

from collections.abc import Iterator

from modelling.effects.first_guess import FittedMotion, Guess, if_positive, smooth_sign
from modelling.effects.interface import EquationBuilder, Motion, Symbols
from modelling.effects.kind import Kind, Parameter
from modelling.effects.recorded_range import RecordedRange


class CoulombFriction(Kind):
    """torque·sgn(speed); with ``torque_reverse`` unequal by direction."""

    kind = "coulomb_friction"
    words = "has dry friction of {torque}"
    in_recording = (
        "speeds stop dead instead of fading out, and the difference to the model has the sign of the speed "
        "whatever its size."
    )
    tables = ("inertias",)
    parameters = {"torque": Parameter("N*m", lower=0.0), "torque_reverse": Parameter("N*m", lower=0.0, optional=True)}
    state_dependent = True
    sticks = True

    def inertia(self, motion: Motion, p: Symbols, assembly: EquationBuilder, name: str) -> None:
        sign = assembly.sign(motion.speed)
        forward, reverse = p["torque"], p.get("torque_reverse", p["torque"])
        friction = (forward * (1 + sign) - reverse * (1 - sign)) / 2 if reverse != forward else forward * sign
        assembly.add_torque(name, -friction, motion)

    def guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        speed = motion.speed[at.split(".")[1]]
        sign = smooth_sign(speed)
        yield Guess(({at: -sign},), if_positive("torque"))
        if speed.min() < 0 < speed.max():
            forward, reverse = (1 + sign) / 2, (1 - sign) / 2
            yield Guess(
                ({at: -forward}, {at: reverse}),
                lambda a: {"torque": float(a[0]), "torque_reverse": float(a[1])} if min(a) > 0 else None,
            )

    def recorded_bounds(self, key: str, at: str, recorded: RecordedRange) -> tuple[float, float]:
        largest = recorded.torque[at.split(".")[1]]
        return -largest, largest
