"""Lateral force and bending moment at the torque flange: a beam on three bearings, by Castigliano's method.

The load side of the test bed is a shaft on three bearings: the support C of the hub adapter, and the dynamometer's B
and A. That is one bearing more than equilibrium can settle. Castigliano's theorem settles it: the bearing under the
redundant reaction X does not move, so the strain energy of bending does not change with X, ∂/∂X ∫ M²/(2EI) dx = 0.
"""

from itertools import pairwise

import sympy

SUPPORT = None  # in place of a force


def reactions(beam):
    """Upward reactions of a beam of uniform bending stiffness at its three supports, symbolic.

    Parameters
    ----------
    beam : list of (place, downward force or SUPPORT)
        In order along the beam, which begins and ends at a support and has one more between.
    """
    x, redundant = sympy.symbols("x X")
    first, middle, last = (place for place, force in beam if force is SUPPORT)
    loads = [(place, force) for place, force in beam if force is not SUPPORT]
    about_last = sum(force * (last - place) for place, force in loads)
    second = (about_last - redundant * (last - first)) / (last - middle)
    upward = {first: redundant, middle: second}
    condition, moment = sympy.Integer(0), sympy.Integer(0)
    for (place, force), (following, _) in pairwise(beam):
        moment += (upward[place] if force is SUPPORT else -force) * (x - place)
        condition += sympy.integrate(sympy.expand(moment * sympy.diff(moment, redundant)), (x, place, following))
    found = sympy.solve(condition, redundant)[0]
    second = second.subs(redundant, found)
    total = sum(force for _, force in loads)
    return tuple(sympy.factor(value) for value in (found, second, total - found - second))


def section_loads(beam, number, at):
    """Shear force and bending moment at a section between the beam's point of that number and the next."""
    left = dict(zip((place for place, force in beam if force is SUPPORT), reactions(beam), strict=True))
    upward = [(place, left[place] if force is SUPPORT else -force) for place, force in beam[: number + 1]]
    return sum(force for _, force in upward), sum(force * (at - place) for place, force in upward)


# The stated geometry is ours, in round figures for a load side of this size; the authors published none.
adapter, flange, bearing, rotor, end = sympy.symbols("x_adapter x_flange x_B x_rotor x_A", positive=True)
G_adapter, G_rotor = sympy.symbols("G_adapter G_rotor", positive=True)
LOAD_SIDE = [(sympy.Integer(0), SUPPORT), (adapter, G_adapter), (bearing, SUPPORT), (rotor, G_rotor), (end, SUPPORT)]
GEOMETRY = {adapter: 0.15, flange: 0.35, bearing: 0.50, rotor: 0.85, end: 1.20}  # m from the support C
MASSES = {"M2": {G_adapter: 25.0, G_rotor: 77.0}, "M3": {G_adapter: 32.0, G_rotor: 70.0}}  # kg
GRAVITY = 9.81  # m/s²


def flange_loads(side):
    """F_y in N and M_b in N·m at the torque flange of a load side, for the stated geometry."""
    values = GEOMETRY | {symbol: mass * GRAVITY for symbol, mass in MASSES[side].items()}
    return tuple(abs(float(load.subs(values))) for load in section_loads(LOAD_SIDE, 1, flange))
