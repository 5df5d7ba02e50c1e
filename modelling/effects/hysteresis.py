"""Rate-independent friction in parallel with a shaft (Dahl 1968)."""

from modelling.effects.kind import Kind, Parameter


class Hysteresis(Kind):
    """Dahl element: ż = twist_rate·(1 − sgn(twist_rate)·z/torque)·torque/angle, written with |twist_rate|, which is continuous."""

    kind = "hysteresis"
    tables = ("shafts",)
    parameters = {"torque": Parameter("N*m", lower=0.0), "angle": Parameter("rad", lower=1e-9)}

    def shaft(self, law, p, assembly):
        from sympy import Abs

        # z/torque is the state: it stays within ±1 and has a limit at torque = 0
        z = assembly.state(f"{law.place}.hysteresis", lambda z: (law.rate - Abs(law.rate) * z) / p["angle"])
        law.parallel.append(p["torque"] * z)
