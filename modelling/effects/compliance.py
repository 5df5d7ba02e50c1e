"""A further spring and inertia in series with a shaft: one more degree of freedom."""

from __future__ import annotations

from typing import TYPE_CHECKING

from modelling.effects.kind import Kind, Parameter

if TYPE_CHECKING:
    from modelling.assembly import Assembly, ShaftLaw, Symbols


class Compliance(Kind):
    """Spring ``stiffness`` (N·m/rad) and inertia ``J`` (kg·m²) in series at the second end of the shaft."""

    kind = "compliance"
    tables = ("shafts",)
    parameters = {"stiffness": Parameter("N*m/rad", lower=0.0), "J": Parameter("kg*m^2", lower=1e-12)}

    def shaft(self, law: ShaftLaw, p: Symbols, assembly: Assembly) -> None:
        from modelling.assembly import Spring

        label = f"{law.place}.compliance"
        middle = assembly.coordinate(label)
        further = middle - law.second
        assembly.rotate(label, p["J"], middle)
        assembly.potential[label] = p["stiffness"] * further.angle**2 / 2
        assembly.springs[label] = Spring(p["stiffness"], further, further.angle)
        law.second = middle
