"""Dry friction that falls from breakaway to sliding (Stribeck)."""

from modelling.effects.kind import Kind, Parameter


class StribeckFriction(Kind):
    """sgn(speed)·(torque + (breakaway − torque)·exp(−(speed/``speed``)²))."""

    kind = "stribeck_friction"
    tables = ("inertias",)
    parameters = {
        "torque": Parameter("N*m", lower=0.0),
        "breakaway": Parameter("N*m", lower=0.0),
        "speed": Parameter("rad/s", lower=1e-6),
    }

    def inertia(self, motion, p, assembly, name):
        from sympy import exp

        sliding = p["torque"] + (p["breakaway"] - p["torque"]) * exp(-((motion.speed / p["speed"]) ** 2))
        assembly.act(name, -assembly.sign(motion.speed) * sliding, motion)
