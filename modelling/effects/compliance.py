"""A further spring and inertia in series with a shaft: one more degree of freedom."""

from modelling.effects.kind import Kind, Parameter


class Compliance(Kind):
    """Spring ``stiffness`` (N·m/rad) and inertia ``J`` (kg·m²) in series at the second end of the shaft."""

    kind = "compliance"
    tables = ("shafts",)
    parameters = {"stiffness": Parameter("N*m/rad", lower=0.0), "J": Parameter("kg*m^2", lower=1e-12)}

    def shaft(self, law, p, assembly):
        label = f"{law.place}.compliance"
        middle = assembly.coordinate(label)
        further = middle - law.second
        assembly.kinetic[label] = p["J"] * middle.speed**2 / 2
        assembly.potential[label] = p["stiffness"] * further.angle**2 / 2
        law.second = middle
