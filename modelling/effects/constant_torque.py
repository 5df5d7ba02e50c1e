"""A resisting torque that does not depend on motion (grade, offset load)."""

from modelling.effects.kind import Kind, Parameter


class ConstantTorque(Kind):
    """A constant ``torque`` against positive motion."""

    kind = "constant_torque"
    tables = ("inertias",)
    parameters = {"torque": Parameter("N*m")}

    def inertia(self, motion, p, assembly, name):
        assembly.act(name, -p["torque"], motion)
