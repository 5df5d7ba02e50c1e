"""Drag that grows with the square of speed (air, churning)."""

from modelling.effects.kind import Kind, Parameter


class QuadraticDrag(Kind):
    """coefficient·speed·|speed|, resisting."""

    kind = "quadratic_drag"
    tables = ("inertias",)
    parameters = {"coefficient": Parameter("N*m*s^2/rad^2", lower=0.0)}

    def inertia(self, motion, p, assembly, name):
        from sympy import Abs

        assembly.act(name, -p["coefficient"] * motion.speed * Abs(motion.speed), motion)
