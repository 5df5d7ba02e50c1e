"""Rate-independent friction in parallel with a shaft (Dahl 1968)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from modelling.effects.kind import Kind, Parameter

if TYPE_CHECKING:
    from modelling.assembly import Assembly, ShaftLaw, Symbols


class Hysteresis(Kind):
    """Dahl element: ż = twist_rate·(1 − sgn(twist_rate)·z/torque)·torque/angle.

    It is written with |twist_rate|, which is continuous.
    """

    kind = "hysteresis"
    tables = ("shafts",)
    parameters = {"torque": Parameter("N*m", lower=0.0), "angle": Parameter("rad", lower=1e-9)}

    def shaft(self, law: ShaftLaw, p: Symbols, assembly: Assembly) -> None:
        from sympy import Abs

        # z/torque is the state: it stays within ±1 and has a limit at torque = 0
        z = assembly.state(f"{law.place}.hysteresis", lambda z: (law.rate - Abs(law.rate) * z) / p["angle"])
        law.parallel.append(p["torque"] * z)
        law.parallel_stiffness.append(p["torque"] / p["angle"])
