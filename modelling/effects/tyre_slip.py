"""Slip of a rolling tyre: its slope falls with the speed and with the torque, which is limited by friction."""

from __future__ import annotations

from collections.abc import Iterator

from sympy import Abs, Expr, Integer, Rational, atan, cos, sin

from modelling.effects.first_guess import FittedMotion, Guess
from modelling.effects.interface import Drivetrain, EquationBuilder, ShaftLaw, Symbols
from modelling.effects.kind import Kind, Parameter, State

SHAPE = Rational(165, 100)  # of a tyre along the road, where the file states none


class TyreSlip(Kind):
    """A contact patch in series with the shaft, after the Magic Formula with a constant relaxation length.

    The shaft is the carcass; its second end turns as the tyre would without slip (body, road). In the patch

        T = peak·sin(shape·atan(slip_stiffness·κ/(shape·peak))),  κ = (twist rate − deflection rate)/|speed|,

    and the carcass deflects in proportion to κ: slip_stiffness·κ = stiffness·deflection + damping·deflection rate.
    ``slip_stiffness`` is the torque over slip at slip 0 and ``peak`` the largest torque; both are on the second end's
    side and go with the wheel load. Small slips at one speed are :class:`~modelling.effects.slip.Slip` with the
    coefficient slip_stiffness/|speed|; at standstill nothing slips until the torque nears the peak.

    Source: Pacejka, Tire and Vehicle Dynamics, 3rd ed. 2012, sections 4.3 and 7.2 (single contact point, longitudinal).
    """

    kind = "tyre_slip"
    words = "slips on the road with {slip_stiffness} over slip, up to {peak}"
    in_recording = "the ends differ in speed in proportion to speed and torque; the torque has a largest value."
    tables = ("shafts",)
    parameters = {
        "slip_stiffness": Parameter("N*m", lower=1e-9),
        "peak": Parameter("N*m", lower=1e-9),
        "shape": Parameter("1", lower=1.0, upper=1.99, optional=True),
    }
    state = State("rad", "deflection of the spring of {place}")
    state_dependent = True

    def shaft(self, law: ShaftLaw, p: Symbols, assembly: EquationBuilder) -> None:
        peak, shape = p["peak"], p.get("shape", SHAPE)
        law.put_in_series(p["slip_stiffness"] / Abs(law.second.speed), f"{law.place}.{self.kind}")

        def saturated(torque: Expr) -> Expr:
            return peak * sin(shape * atan(torque / (shape * peak)))

        def slope(torque: Expr) -> Expr:
            share = torque / (shape * peak)
            return cos(shape * atan(share)) / (Integer(1) + share**2)

        law.contact = saturated, slope

    def candidate_places(self, system: Drivetrain) -> list[str]:
        """None: a diagnosis looks for ``slip``, which is the same at one speed and small torque."""
        return []

    def guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        return iter(())
