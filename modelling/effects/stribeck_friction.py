"""Dry friction that falls from breakaway to sliding (Stribeck)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from modelling.effects.kind import Kind, Parameter

if TYPE_CHECKING:
    from modelling.assembly import Assembly, Motion, Symbols


class StribeckFriction(Kind):
    """sgn(speed)·(torque + (breakaway − torque)·exp(−(speed/``speed``)²))."""

    kind = "stribeck_friction"
    tables = ("inertias",)
    parameters = {
        "torque": Parameter("N*m", lower=0.0),
        "breakaway": Parameter("N*m", lower=0.0),
        "speed": Parameter("rad/s", lower=1e-6),
    }

    def inertia(self, motion: Motion, p: Symbols, assembly: Assembly, name: str) -> None:
        from sympy import exp

        sliding = p["torque"] + (p["breakaway"] - p["torque"]) * exp(-((motion.speed / p["speed"]) ** 2))
        assembly.act(name, -assembly.sign(motion.speed) * sliding, motion)
