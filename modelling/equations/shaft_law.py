"""The torque law of a shaft: begun from its spring and damper, shaped by effects, closed into energies and work."""

from __future__ import annotations

import functools
from typing import Protocol

import sympy as sm

from modelling.effects.effect import EquationBuilder, Motion, ShaftLaw, Spring
from modelling.errors import ExcludedEffects
from modelling.system import Shaft

# --- Derivatives of many alike expressions, each shape differentiated once.


def differentiate(expression: sm.Expr, symbol: sm.Symbol) -> sm.Expr:
    """∂expression/∂symbol, found once for all expressions that differ in their symbols' names only."""
    if symbol not in expression.free_symbols:
        return sm.Integer(0)
    names = sorted(expression.free_symbols, key=str)
    plain = {name: _placeholder(i) for i, name in enumerate(names)}
    back = {stand_in: name for name, stand_in in plain.items()}
    return _plain_diff(expression.xreplace(plain), plain[symbol]).xreplace(back)


@functools.cache
def _placeholder(number: int) -> sm.Symbol:
    return sm.Symbol(f"_{number:04d}", real=True)


@functools.lru_cache(maxsize=4096)
def _plain_diff(expression: sm.Expr, symbol: sm.Symbol) -> sm.Expr:
    # A kink of a law has no slope; beside it the impulse that SymPy writes there is 0.
    slope = sm.diff(expression, symbol)
    return slope.replace(sm.DiracDelta, lambda *_: sm.Integer(0)) if slope.has(sm.DiracDelta) else slope


# --- Shaft law

CONTACT_TIME = "simulation.contact_time"  # s over which the damping of a closing lash sets in
_TWIST = sm.Dummy("twist", real=True)
_SMALLEST_DEPTH = sm.Float(1e-13)  # rad, keeps a quotient finite at rest


class LawAssembly(EquationBuilder, Protocol):
    """What closing a law needs of the equations beyond what effects do."""

    dissipation: dict[str, sm.Expr]
    motions: dict[str, Motion]

    def simulation(self, name: str) -> sm.Symbol:
        """A parameter that the simulation sets."""

    def substitute(self, old: sm.Symbol, new: sm.Expr) -> None:
        """Replace a stand-in in the derivatives of the states."""


def begin(shaft: Shaft, assembly: LawAssembly) -> ShaftLaw:
    """The law of a shaft without effects."""
    place = f"shafts.{shaft.name}"
    first, second = (assembly.motions[end] for end in shaft.between)
    stiffness = assembly.symbol(f"{place}.stiffness")
    return ShaftLaw(
        place,
        first=first.divided_by(assembly.symbol(f"{place}.ratio")) if shaft.ratio is not None else first,
        second=second,
        stiffness=stiffness,
        damping=assembly.symbol(f"{place}.damping"),
        rate=sm.Symbol(f"{place}.rate", real=True),
        potentials=[lambda twist: stiffness * twist**2 / 2],
    )


def close(law: ShaftLaw, assembly: LawAssembly) -> None:
    """Write the law into energies where it is elastic and viscous, into virtual work where it is not.

    Raises
    ------
    InputError
        If two effects on one shaft cannot be combined.
    """
    twist = law.first - law.second
    stand_in, rate = law.rate, twist.speed
    x = _TWIST
    potential = sm.Add(*(part(x) for part in law.potentials))
    elastic = differentiate(potential, x)
    spring = twist.angle
    parallel = sm.Add(*law.parallel)
    if law.quadratic != 0 and law.contact is not None:
        raise ExcludedEffects(
            law.place,
            "has quadratic damping and slip of a tyre at once",
            "leave one of them out, or put it on a shaft of its own",
        )
    if law.quadratic != 0 and law.series is not None:
        _close_with_quadratic_damping(law, assembly, elastic)
        return
    parallel = parallel + law.quadratic * stand_in * sm.Abs(stand_in)
    if law.gap is None and law.series is None:
        assembly.potential[law.place] = potential.xreplace({x: twist.angle})
        assembly.dissipation[law.place] = law.damping * rate**2 / 2
        torque = elastic.xreplace({x: twist.angle}) + law.damping * rate
        if parallel != 0:
            assembly.add_torque(law.place, -parallel.xreplace({stand_in: rate}), twist)
    else:
        if law.series is not None:
            spring = assembly.add_state(law.series_state, lambda _: stand_in)
            # the damper in series carries the parallel elements and the spring with its damper:
            # series·(twist rate − spring rate) = elastic + damping·spring rate + parallel
            rate = rate - parallel / law.series
        torque = _gapped(law, elastic, x, spring, rate, assembly)
        if law.series is not None:
            rate = rate - torque / law.series
        torque = torque + parallel
        if law.contact is not None:
            torque = law.contact[0](torque)
        assembly.add_torque(law.place, -torque.xreplace({stand_in: rate}), twist)
        torque = torque.xreplace({stand_in: rate})
        parallel = sm.Integer(0)
    law.torque = torque + parallel.xreplace({stand_in: rate})
    tangent = _tangent(law, differentiate(elastic, x), x, spring) + sm.Add(*law.parallel_stiffness)
    if law.contact is not None:
        tangent = tangent * law.contact[1](_without_rate(law, elastic, x, spring) + sm.Add(*law.parallel))
    assembly.springs[law.place] = Spring(tangent, twist, spring)
    assembly.substitute(stand_in, rate)


def _close_with_quadratic_damping(law: ShaftLaw, assembly: LawAssembly, elastic: sm.Expr) -> None:
    """Close a law whose spring, with quadratic damping beside it, stands in series with a damper.

    series·(twist rate − r) = elastic + damping·r + quadratic·r·|r| + parallel, solved for the spring's rate r.

    Raises
    ------
    InputError
        With free play as well, where the equation has no closed solution.
    """
    if law.gap is not None:
        raise ExcludedEffects(
            law.place,
            "has free play, a damper in series and quadratic damping at once",
            "leave one of them out, or put it on a shaft of its own",
        )
    twist = law.first - law.second
    spring = assembly.add_state(law.series_state, lambda _: law.rate)
    held = elastic.xreplace({_TWIST: spring}) + sm.Add(*law.parallel)
    left, linear = law.series * twist.speed - held, law.series + law.damping
    rate = 2 * left / (linear + sm.sqrt(linear**2 + 4 * law.quadratic * sm.Abs(left)))
    law.torque = held + law.damping * rate + law.quadratic * rate * sm.Abs(rate)
    assembly.add_torque(law.place, -law.torque, twist)
    tangent = _tangent(law, differentiate(elastic, _TWIST), _TWIST, spring) + sm.Add(*law.parallel_stiffness)
    assembly.springs[law.place] = Spring(tangent, twist, spring)
    assembly.substitute(law.rate, rate)


def _tangent(law: ShaftLaw, stiffness: sm.Expr, x: sm.Symbol, spring: sm.Expr) -> sm.Expr:
    if law.gap is None:
        return stiffness.xreplace({x: spring})
    half = law.gap / 2
    pushed, pulled = (stiffness.xreplace({x: spring - side}) for side in (half, -half))
    return sm.Piecewise((pushed, spring > half), (pulled, spring < -half), (sm.Integer(0), True))


def _without_rate(law: ShaftLaw, elastic: sm.Expr, x: sm.Symbol, spring: sm.Expr) -> sm.Expr:
    """Torque of the spring alone, none within the lash."""
    if law.gap is None:
        return elastic.xreplace({x: spring})
    zero, half = sm.Integer(0), law.gap / 2
    pushed, pulled = sm.Max(zero, spring - half), sm.Min(zero, spring + half)
    return elastic.xreplace({x: pushed}) + elastic.xreplace({x: pulled})


def _gapped(
    law: ShaftLaw, elastic: sm.Expr, x: sm.Symbol, spring: sm.Expr, rate: sm.Expr, assembly: LawAssembly
) -> sm.Expr:
    """Elastic and viscous torque; no torque across the lash. ``rate`` is that of spring and series damper together.

    The damping sets in at contact. It does so over the step of the integration, about the instant of contact: then
    a fixed step integrates the jump exactly, and the motion depends smoothly on the gap.
    """
    if law.gap is None:
        return _shared(law, elastic.xreplace({x: spring}), law.damping, rate)
    depth = sm.Abs(rate) * assembly.simulation(CONTACT_TIME) + _SMALLEST_DEPTH
    zero, unity, half = sm.Integer(0), sm.Integer(1), sm.Rational(1, 2)
    torque: list[sm.Expr] = []
    for side, within in ((unity, sm.Max), (-unity, sm.Min)):
        over = spring - side * law.gap / 2
        # not evaluated: SymPy would compare the arguments' assumptions, at length and for nothing
        rising = sm.Min(unity, half + side * over / depth, evaluate=False)
        damping = law.damping * sm.Max(zero, rising, evaluate=False)
        pressed = elastic.xreplace({x: within(zero, over, evaluate=False)})
        torque.append(within(zero, _shared(law, pressed, damping, rate), evaluate=False))
    return sm.Add(*torque)


def _shared(law: ShaftLaw, elastic: sm.Expr, damping: sm.Expr, rate: sm.Expr) -> sm.Expr:
    """elastic + damping·spring rate, where a damper in series takes its part of the rate."""
    total = elastic + damping * rate
    return total if law.series is None else total / (1 + damping / law.series)
