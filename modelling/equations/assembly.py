"""A system put together: coordinates, energies, virtual work, states and paths, as SymPy expressions."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import sympy as sm

from modelling.equations.constraints import eliminate
from modelling.equations.derivative import differentiate
from modelling.model.system import Shaft, System

if TYPE_CHECKING:
    from modelling.effects import Kind

Symbols = Mapping[str, sm.Symbol]
_TWIST = sm.Dummy("twist", real=True)
_NOTHING = sm.Float(1e-13)  # rad, keeps a quotient finite
STICK_SPEED = "simulation.stick_speed"  # rad/s over which the sign of a speed turns
CONTACT_TIME = "simulation.contact_time"  # s over which the damping of a closing lash sets in
SIMULATION_DEFAULTS = {STICK_SPEED: 1e-3, CONTACT_TIME: 1e-4}


@dataclass(frozen=True)
class Motion:
    """A rotation as a linear combination of coordinates: ``share[i]`` is the coefficient of coordinate i."""

    share: dict[int, sm.Expr]
    assembly: Assembly = field(repr=False)

    def _sum(self, symbols: list[sm.Symbol]) -> sm.Expr:
        return sm.Add(*(coefficient * symbols[i] for i, coefficient in self.share.items()))

    @property
    def angle(self) -> sm.Expr:
        """Angle, rad."""
        return self._sum(self.assembly.q)

    @property
    def speed(self) -> sm.Expr:
        """Speed, rad/s."""
        return self._sum(self.assembly.qd)

    @property
    def acceleration(self) -> sm.Expr:
        """Acceleration, rad/s²."""
        return self._sum(self.assembly.qdd)

    def __sub__(self, other: Motion) -> Motion:
        share = dict(self.share)
        for i, coefficient in other.share.items():
            share[i] = share.get(i, sm.Integer(0)) - coefficient
        return Motion({i: c for i, c in share.items() if c != 0}, self.assembly)

    def over(self, ratio: sm.Expr) -> Motion:
        """The motion divided by a ratio."""
        return Motion({i: c / ratio for i, c in self.share.items()}, self.assembly)


@dataclass(frozen=True)
class Spring:
    """What a spring is to small oscillations: its tangent ``stiffness``, the twist it resists, its own deflection.

    Deflection and twist differ where a damper sits in series.
    """

    stiffness: sm.Expr
    twist: Motion
    deflection: sm.Expr


class ShaftLaw:
    """The torque law of a shaft while effects shape it; ``torque`` once closed."""

    def __init__(self, shaft: Shaft, assembly: Assembly):
        self.place = f"shafts.{shaft.name}"
        first, self.second = (assembly.motions[end] for end in shaft.between)
        self.first = first.over(assembly.symbol(f"{self.place}.ratio")) if shaft.ratio is not None else first
        self.stiffness = assembly.symbol(f"{self.place}.stiffness")
        self.damping = assembly.symbol(f"{self.place}.damping")
        self.potentials: list[Callable[[sm.Expr], sm.Expr]] = [lambda twist: self.stiffness * twist**2 / 2]
        self.gap: sm.Expr | None = None
        self.series: sm.Expr | None = None
        self.parallel: list[sm.Expr] = []
        self.parallel_stiffness: list[sm.Expr] = []  # of the parallel elements, for small oscillations about rest
        self.rate: sm.Expr = sm.Symbol(f"{self.place}.rate", real=True)  # stands in until the law is closed
        self.torque: sm.Expr = sm.Integer(0)

    def close(self, assembly: Assembly) -> None:
        """Write the law into energies where it is elastic and viscous, into virtual work where it is not."""
        twist = self.first - self.second
        stand_in, rate = self.rate, twist.speed
        x = _TWIST
        potential = sm.Add(*(part(x) for part in self.potentials))
        elastic = differentiate(potential, x)
        spring = twist.angle
        parallel = sm.Add(*self.parallel)
        if self.gap is None and self.series is None:
            assembly.potential[self.place] = potential.xreplace({x: twist.angle})
            assembly.dissipation[self.place] = self.damping * rate**2 / 2
            torque = elastic.xreplace({x: twist.angle}) + self.damping * rate
            if parallel != 0:
                assembly.act(self.place, -parallel.xreplace({stand_in: rate}), twist)
        else:
            if self.series is not None:
                spring = assembly.state(f"{self.place}.slip", lambda _: stand_in)
                # the damper in series gives way to the parallel elements first, then to spring and damper:
                # series·(twist rate − spring rate) = elastic + damping·spring rate + parallel
                rate = rate - parallel / self.series
            torque = self._gapped(elastic, x, spring, rate, assembly)
            if self.series is not None:
                rate = rate - torque / self.series
            torque = torque + parallel
            assembly.act(self.place, -torque.xreplace({stand_in: rate}), twist)
            torque = torque.xreplace({stand_in: rate})
            parallel = sm.Integer(0)
        self.torque = torque + parallel.xreplace({stand_in: rate})
        tangent = self._tangent(differentiate(elastic, x), x, spring) + sm.Add(*self.parallel_stiffness)
        assembly.springs[self.place] = Spring(tangent, twist, spring)
        assembly.substitute(stand_in, rate)

    def _tangent(self, stiffness: sm.Expr, x: sm.Symbol, spring: sm.Expr) -> sm.Expr:
        if self.gap is None:
            return stiffness.xreplace({x: spring})
        half = self.gap / 2
        pushed, pulled = (stiffness.xreplace({x: spring - side}) for side in (half, -half))
        return sm.Piecewise((pushed, spring > half), (pulled, spring < -half), (sm.Integer(0), True))

    def _gapped(self, elastic: sm.Expr, x: sm.Symbol, spring: sm.Expr, rate: sm.Expr, assembly: Assembly) -> sm.Expr:
        """Elastic and viscous torque; no pull across the lash. ``rate`` is that of spring and series damper together.

        The damping sets in at contact. It does so over the step of the integration, about the instant of contact: then
        a fixed step integrates the jump exactly, and the motion depends smoothly on the gap.
        """
        if self.gap is None:
            return self._shared(elastic.xreplace({x: spring}), self.damping, rate)
        depth = sm.Abs(rate) * assembly.simulation(CONTACT_TIME) + _NOTHING
        zero, one, half = sm.Integer(0), sm.Integer(1), sm.Rational(1, 2)
        torque: list[sm.Expr] = []
        for side, within in ((one, sm.Max), (-one, sm.Min)):
            over = spring - side * self.gap / 2
            damping = self.damping * sm.Max(zero, sm.Min(one, half + side * over / depth))
            torque.append(within(zero, self._shared(elastic.xreplace({x: within(zero, over)}), damping, rate)))
        return sm.Add(*torque)

    def _shared(self, elastic: sm.Expr, damping: sm.Expr, rate: sm.Expr) -> sm.Expr:
        """elastic + damping·spring rate, where a damper in series takes its part of the rate."""
        total = elastic + damping * rate
        return total if self.series is None else total / (1 + damping / self.series)


@dataclass
class InputPath:
    """What a recorded input becomes before it acts."""

    place: str
    value: sm.Expr
    delay: sm.Expr


@dataclass
class SensorPath:
    """What the truth becomes before it is read."""

    place: str
    value: sm.Expr
    delay: sm.Expr


class Assembly:
    """Energies, virtual work, states, input and sensor paths of a system; effects write into it.

    ``kinetic``, ``potential`` and ``dissipation`` (Rayleigh) are expressions by component; ``work`` lists
    (component, torque, motion): the torque does work on the motion. ``masses`` (inertia, motion) and ``springs``
    are the elements of modal analysis, by component.
    """

    def __init__(self, system: System):
        self.system = system
        self.parameters: dict[str, sm.Symbol] = {name: sm.Symbol(name, real=True) for name in system.parameters}
        self._override = {
            effect.at: self.parameters[f"{effect.name}.value"]
            for effect in system.effects
            if effect.kind == "wrong_parameter"
        }
        self.time = sm.Symbol("t", real=True)
        self.coordinates: list[str] = []
        self.q: list[sm.Symbol] = []
        self.qd: list[sm.Symbol] = []
        self.qdd: list[sm.Symbol] = []
        self.kinetic: dict[str, sm.Expr] = {}
        self.potential: dict[str, sm.Expr] = {}
        self.dissipation: dict[str, sm.Expr] = {}
        self.masses: dict[str, tuple[sm.Expr, Motion]] = {}
        self.springs: dict[str, Spring] = {}
        self.work: list[tuple[str, sm.Expr, Motion]] = []
        self.states: dict[str, tuple[sm.Symbol, sm.Expr]] = {}
        self.motions: dict[str, Motion] = {}
        self.shafts: dict[str, ShaftLaw] = {}
        self.inputs: dict[str, InputPath] = {}
        self.sensors: dict[str, SensorPath] = {}
        self._assemble()

    def symbol(self, name: str) -> sm.Symbol:
        """The symbol of a parameter; what a ``wrong_parameter`` says instead, where there is one."""
        return self._override.get(name, self.parameters[name])

    def coordinate(self, name: str) -> Motion:
        """A new degree of freedom."""
        index = len(self.coordinates)
        self.coordinates.append(name)
        for symbols, mark in ((self.q, "q"), (self.qd, "qd"), (self.qdd, "qdd")):
            symbols.append(sm.Symbol(f"{mark}({name})", real=True))
        return Motion({index: sm.Integer(1)}, self)

    def rotate(self, component: str, inertia: sm.Expr, motion: Motion) -> None:
        """Give a component its kinetic energy."""
        self.masses[component] = inertia, motion
        self.kinetic[component] = inertia * motion.speed**2 / 2

    def state(self, name: str, derivative: Callable[[sm.Symbol], sm.Expr]) -> sm.Symbol:
        """A new first-order state with its time derivative."""
        symbol = sm.Symbol(f"z({name})", real=True)
        self.states[name] = (symbol, derivative(symbol))
        return symbol

    def act(self, component: str, torque: sm.Expr, motion: Motion) -> None:
        """Let a torque do virtual work on a motion."""
        self.work.append((component, torque, motion))

    def sign(self, speed: sm.Expr) -> sm.Expr:
        """Sign of a speed, turning over a stick speed that the simulation keeps small."""
        return sm.tanh(speed / self.simulation(STICK_SPEED))

    def simulation(self, name: str) -> sm.Symbol:
        """A parameter of ``SIMULATION_DEFAULTS``, which the simulation sets."""
        return self.parameters.setdefault(name, sm.Symbol(name, real=True))

    def substitute(self, old: sm.Symbol, new: sm.Expr) -> None:
        """Replace a stand-in in the states' derivatives; as it stands, for SymPy takes seconds over |max(…)|."""
        with sm.evaluate(not new.has(sm.Max)):
            self.states = {
                name: (z, rate.xreplace({old: new}) if rate.has(old) else rate)
                for name, (z, rate) in self.states.items()
            }

    def _assemble(self) -> None:
        from modelling.effects import EFFECTS

        system = self.system
        by_place: dict[str, list[tuple[Kind, dict[str, sm.Symbol]]]] = {}
        for effect in system.effects:
            p = {key: self.parameters[f"{effect.name}.{key}"] for key, _ in effect.parameters}
            by_place.setdefault(effect.at, []).append((EFFECTS[effect.kind], p))
        eliminate(self)
        for shaft in system.shafts:
            law = self.shafts[shaft.name] = ShaftLaw(shaft, self)
            for kind, p in by_place.get(law.place, ()):
                kind.shaft(law, p, self)
            law.close(self)
        for part in system.inertias:
            place, motion = f"inertias.{part.name}", self.motions[part.name]
            self.rotate(place, self.symbol(f"{place}.J"), motion)
            self.dissipation[place] = self.symbol(f"{place}.drag") * motion.speed**2 / 2
            for kind, p in by_place.get(place, ()):
                kind.inertia(motion, p, self, place)
        for source in system.inputs:
            place = f"inputs.{source.name}"
            path = self.inputs[source.name] = InputPath(place, sm.Symbol(f"u({source.name})", real=True), sm.Integer(0))
            for kind, p in by_place.get(place, ()):
                kind.input(path, p, self)
            self.act(place, path.value, self.motions[source.on])
        for reading in system.sensors:
            place = f"sensors.{reading.name}"
            truth = self._truth(reading.measures, reading.of)
            sensor = self.sensors[reading.name] = SensorPath(place, truth, sm.Integer(0))
            for kind, p in by_place.get(place, ()):
                kind.sensor(sensor, p, self)

    def _truth(self, measures: str, of: str) -> sm.Expr:
        return self.shafts[of].torque if measures == "torque" else getattr(self.motions[of], measures)
