"""Torque that varies with the angle (cogging, torque ripple, universal joint)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from modelling.effects.kind import Kind, Parameter

if TYPE_CHECKING:
    from modelling.assembly import Assembly, Motion, Symbols


class TorqueRipple(Kind):
    """amplitude·sin(order·angle + phase), driving."""

    kind = "torque_ripple"
    tables = ("inertias",)
    parameters = {"order": Parameter("1", lower=0.0), "amplitude": Parameter("N*m"), "phase": Parameter("rad")}

    def inertia(self, motion: Motion, p: Symbols, assembly: Assembly, name: str) -> None:
        from sympy import sin

        assembly.act(name, p["amplitude"] * sin(p["order"] * motion.angle + p["phase"]), motion)
