"""A shaft that stiffens or softens with its twist."""

from modelling.effects.kind import Kind, Parameter


class Hardening(Kind):
    """Adds cubic·twist³ to the elastic torque; a negative value softens."""

    kind = "hardening"
    tables = ("shafts",)
    parameters = {"cubic": Parameter("N*m/rad^3")}

    def shaft(self, law, p, assembly):
        law.potentials.append(lambda deflection: p["cubic"] * deflection**4 / 4)
