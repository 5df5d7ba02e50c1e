"""Torque that varies with the angle (cogging, torque ripple, universal joint)."""

from modelling.effects.kind import Kind, Parameter


class TorqueRipple(Kind):
    """amplitude·sin(order·angle + phase), driving."""

    kind = "torque_ripple"
    tables = ("inertias",)
    parameters = {"order": Parameter("1", lower=0.0), "amplitude": Parameter("N*m"), "phase": Parameter("rad")}

    def inertia(self, motion, p, assembly, name):
        from sympy import sin

        assembly.act(name, p["amplitude"] * sin(p["order"] * motion.angle + p["phase"]), motion)
