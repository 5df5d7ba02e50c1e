"""Dry friction of an inertia against ground."""

from __future__ import annotations

from typing import TYPE_CHECKING

from modelling.effects.kind import Kind, Parameter

if TYPE_CHECKING:
    from modelling.assembly import Assembly, Motion, Symbols


class CoulombFriction(Kind):
    """torque·sgn(speed); with ``torque_reverse`` unequal by direction."""

    kind = "coulomb_friction"
    tables = ("inertias",)
    parameters = {"torque": Parameter("N*m", lower=0.0), "torque_reverse": Parameter("N*m", lower=0.0, optional=True)}

    def inertia(self, motion: Motion, p: Symbols, assembly: Assembly, name: str) -> None:
        sign = assembly.sign(motion.speed)
        forward, reverse = p["torque"], p.get("torque_reverse", p["torque"])
        friction = (forward * (1 + sign) - reverse * (1 - sign)) / 2 if reverse != forward else forward * sign
        assembly.act(name, -friction, motion)
