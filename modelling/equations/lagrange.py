"""Lagrange's equations of a system, from energies, dissipation and virtual work.

d/dt ∂T/∂q̇ − ∂T/∂q + ∂V/∂q + ∂D/∂q̇ = Q, with D the Rayleigh dissipation function and Q the generalised
forces of virtual work (Dresig and Holzweissig, Dynamics of Machinery, the paper's reference 10).
Each energy is differentiated by the coordinates it contains only, so the work grows with the chain, not its square.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import sympy as sm

from modelling import display, escape
from modelling.effects.effect import (
    EquationBuilder,
    GearLaw,
    InputPath,
    Kind,
    Motion,
    SensorPath,
    ShaftLaw,
    Spring,
    members,
)
from modelling.effects.torques import converted, dog, dry_friction
from modelling.equations import shaft_law
from modelling.equations.shaft_law import CONTACT_TIME, differentiate
from modelling.errors import ExcludedEffects, InputError
from modelling.system import Gear, Gearbox, System
from modelling.topology import DIVIDING, joints, side

# --- Rigid gears and differentials, eliminated: every inertia's angle in terms of independent coordinates.
#
# Every inertia that a constraint eliminates points at those it is expressed in; paths are shortened as they are
# followed, and a long product of ratios gets a symbol of its own. So the work grows with the number of constraints, not
# its square.

LONGEST_COEFFICIENT = 24  # factors or operations; a longer one gets a symbol of its own
MOST_SHARES = 20_000  # of all inertias together: differentials in a row couple every inertia with every other
VANISHES = 1e-9  # a smaller coefficient is no pivot
CANCELS = 1e-12  # of the summands: what remains of a sum that may be zero

Row = dict[str, "_Coefficient"]


@dataclass(frozen=True)
class _Coefficient:
    """A coefficient of a constraint: its expression, value, and number of factors or operations."""

    expression: sm.Expr
    value: float
    length: int = 1

    def __mul__(self, other: _Coefficient) -> _Coefficient:
        product = self.expression * other.expression
        length = self.length + other.length
        if product.has(sm.Add):
            product = sm.cancel(product)
            length = 1 + int(product.count_ops())
        return _Coefficient(product, self.value * other.value, length)

    def inverse(self) -> _Coefficient:
        return _Coefficient(1 / self.expression, 1 / self.value, self.length)


_ONE, _MINUS = _Coefficient(sm.Integer(1), 1.0, 0), _Coefficient(sm.Integer(-1), -1.0, 0)


def eliminate(system: System, assembly: EquationBuilder) -> dict[str, Motion]:
    """A motion for every inertia by name; creates the independent coordinates in ``assembly``.

    Raises
    ------
    InputError
        If gears and differentials lock the system or say the same thing twice, or couple too many inertias.
    """
    imposed = [effect.at.split(".")[1] for effect in system.effects if effect.law.imposes_motion]
    elimination = _Elimination(assembly.abbreviate, imposed)
    for place, row in _constraints(system, assembly):
        elimination.add(place, row)
    eliminated = elimination.by_inertia
    free = {part.name: assembly.add_coordinate(part.name) for part in system.inertias if part.name not in eliminated}
    motions: dict[str, Motion] = {}
    shares = 0
    for inertia in system.inertias:
        row = elimination.resolved(inertia.name)
        shares += len(row) if len(row) > 1 else 0
        if shares > MOST_SHARES:
            much = f"couple more than {MOST_SHARES} pairs of inertias"
            raise InputError("differentials and planetary gears", much, "use fewer in a row")
        motions[inertia.name] = Motion(
            {next(iter(free[name].coefficients)): c.expression for name, c in row.items()}, assembly
        )
    return motions


def _constraints(system: System, assembly: EquationBuilder) -> list[tuple[str, Row]]:
    """Σ coefficient·angle = 0 of every gear, differential and planetary gear, with its place in the file."""
    rows: list[tuple[str, Row]] = []
    values = {
        symbol: system.parameters[name].value
        for name, symbol in assembly.parameters.items()
        if name in system.parameters
    }
    for gear in system.gears:
        first, second = gear.between
        ratio = assembly.symbol(f"gears.{gear.name}.ratio")
        rows.append((f"gears.{gear.name}", {first: _ONE, second: _Coefficient(-ratio, -values[ratio])}))
    for part in system.differentials:
        half = _Coefficient(-sm.Rational(1, 2), -0.5, 0)
        rows.append((f"differentials.{part.name}", {part.cage: _ONE, part.left: half, part.right: half}))
    for planetary in system.planetary_gears:
        teeth = assembly.symbol(f"planetary_gears.{planetary.name}.ratio")
        value = values[teeth]
        shares = {
            planetary.carrier: _ONE,
            planetary.sun: _Coefficient(-1 / (1 + teeth), -1 / (1 + value), 2),
            planetary.ring: _Coefficient(-teeth / (1 + teeth), -value / (1 + value), 3),
        }
        rows.append((f"planetary_gears.{planetary.name}", shares))
    return rows


class _Elimination:
    """Inertias eliminated so far, each by a row of others; those that are ``imposed`` as late as can be."""

    def __init__(self, abbreviate: Callable[[sm.Expr], sm.Expr], imposed: Sequence[str] = ()):
        self.by_inertia: dict[str, Row] = {}
        self._imposed = imposed
        self._abbreviate = abbreviate
        self._meaning: dict[sm.Expr, sm.Expr] = {}

    def add(self, place: str, row: Row) -> None:
        """Eliminate one inertia by a constraint."""
        row = self._combined(row)
        kept = {name for each in self._imposed for name in self.resolved(each)} if self._imposed else set()
        pivots = [name for name, c in row.items() if abs(c.value) > VANISHES]
        pivot = next((name for name in pivots if name not in kept), next(iter(pivots), None))
        if pivot is None:
            raise InputError(
                place, "says again what other gears and differentials already say, or locks them", "remove it"
            )
        factor = _MINUS * row[pivot].inverse()
        rest = {name: self._short(c * factor) for name, c in row.items() if name != pivot}
        if not rest:
            raise InputError(place, "locks the drivetrain: nothing can turn", "check the ratios round the loop")
        self.by_inertia[pivot] = rest

    def resolved(self, name: str) -> Row:
        """An inertia in terms of those not eliminated; shortens the path to them."""
        waiting = [name]
        while waiting:
            row = self.by_inertia.get(waiting[-1])
            todo = [] if row is None else [other for other in row if self._is_eliminated(other)]
            if todo:
                waiting.extend(todo)
                continue
            done = waiting.pop()
            if row is not None and any(other in self.by_inertia for other in row):
                self.by_inertia[done] = self._replaced(row)
        return self.by_inertia.get(name, {name: _ONE})

    def _is_eliminated(self, name: str) -> bool:
        """Whether an inertia is eliminated by others that are eliminated in turn."""
        return name in self.by_inertia and any(other in self.by_inertia for other in self.by_inertia[name])

    def _combined(self, row: Row) -> Row:
        for name in row:
            self.resolved(name)
        return self._replaced(row)

    def _replaced(self, row: Mapping[str, _Coefficient]) -> Row:
        """A row with the eliminated inertias replaced; terms that cancel are dropped."""
        out: Row = {}
        for name, c in row.items():
            for inner, factor in self.by_inertia.get(name, {name: _ONE}).items():
                product = c * factor
                out[inner] = self._sum(out[inner], product) if inner in out else product
        return {name: self._short(c) for name, c in out.items() if c.expression != 0}

    def _sum(self, a: _Coefficient, b: _Coefficient) -> _Coefficient:
        value = a.value + b.value
        if abs(value) <= CANCELS * abs(a.value) and self._opposite(a.expression, b.expression):
            return _Coefficient(sm.Integer(0), 0.0, 0)
        total = sm.cancel(a.expression + b.expression)
        return _Coefficient(total, value, 1 + int(total.count_ops()))

    def _opposite(self, a: sm.Expr, b: sm.Expr) -> bool:
        """Whether two products are each other's negative, abbreviations written out."""
        ratio = a / b
        while ratio != -1 and (known := ratio.free_symbols & self._meaning.keys()):
            ratio = ratio.xreplace({symbol: self._meaning[symbol] for symbol in known})
        return ratio == -1

    def _short(self, c: _Coefficient) -> _Coefficient:
        if c.length <= LONGEST_COEFFICIENT:
            return c
        symbol = self._abbreviate(c.expression)
        self._meaning[symbol] = c.expression
        return _Coefficient(symbol, c.value)


# --- What a rigid gear passes on: the torques and inertias of the rigid train on either side of it.
#
# A rigid gear is eliminated, so that its torque stands in no equation. It follows from both sides: all torques that act
# on the first side and its inertia, reflected to the gear's second end, and the same of the second side.

Torque = tuple[str, sm.Expr]  # an inertia and a torque on it, N·m


def check_loss(system: System, gear: Gear, motions: Mapping[str, Motion], shafts: Mapping[str, ShaftLaw]) -> None:
    """Refuse the loss of a gear whose torque does not follow from its sides.

    Parameters
    ----------
    motions, shafts : dict
        By inertia and by shaft.

    Raises
    ------
    InputError
        With a differential or a second lossy gear in the same rigid train, or a shaft on it with a further inertia.
    """
    place = f"gears.{gear.name}"
    train = _rigid_train(system, gear.between[0])
    for joint in joints(system, *DIVIDING):
        if set(joint.ends) & train:
            raise ExcludedEffects(place, f"is in one rigid train with {joint.place}", "leave its loss out")
    lossy = {effect.at for effect in system.effects}
    for other in system.gears:
        if other is not gear and f"gears.{other.name}" in lossy and other.between[0] in train:
            raise ExcludedEffects(
                place, f"and gears.{other.name}, in one rigid train, both have losses", "state one loss"
            )
    for shaft in system.shafts:
        branches = shafts[shaft.name].second is not motions[shaft.between[1]]
        if branches and train & set(shaft.between):
            raise ExcludedEffects(place, f"has a loss beside a further inertia in {shaft.name}", "make that an inertia")
    if gear.between[1] in _rigid_train(system, gear.between[0], place):
        raise ExcludedEffects(place, "is one of a ring: what it passes on is undetermined", "leave its loss out")


def gear_law(
    system: System, gear: Gear, motions: dict[str, Motion], inertia: dict[str, sm.Expr], torques: list[Torque]
) -> GearLaw:
    """Torques and inertias on both sides of a gear, reflected to its second end.

    Parameters
    ----------
    motions, inertia : dict by inertia
        Inertias in kg·m².
    torques : list of (str, Expr)
        All that act, each on an inertia.
    """
    first_side = _rigid_train(system, gear.between[0], f"gears.{gear.name}")
    second = motions[gear.between[1]]
    ((index, unit),) = second.coefficients.items()
    torque, mass = [sm.S.Zero, sm.S.Zero], [sm.S.Zero, sm.S.Zero]
    coefficients = {name: motion.coefficients.get(index) for name, motion in motions.items()}
    shares = {name: share / unit for name, share in coefficients.items() if share is not None}
    for name, share in shares.items():
        mass[name not in first_side] += inertia[name] * share**2
    for name, value in torques:
        if name in shares:
            torque[name not in first_side] += value * shares[name]
    return GearLaw(f"gears.{gear.name}", second, torque[0], mass[0], torque[1], mass[1])


def torques_of_shaft(law: ShaftLaw, ends: tuple[str, str], ratio: sm.Expr) -> Iterator[Torque]:
    """What a shaft with its losses does to its ends."""
    yield ends[0], -law.torque / ratio
    yield ends[1], law.torque - sm.Add(*(loss(law.torque) for loss in law.losses))


def acted_on(component: str, on: dict[str, str]) -> str:
    """The inertia that a torque named after a component acts on; empty for a shaft's. ``on`` is by input."""
    table, name = members(component)[0].split(".")[:2]
    return {"inertias": name, "inputs": on.get(name, "")}.get(table, "")


def _rigid_train(system: System, inertia: str, without: str = "") -> set[str]:
    """All inertias that rigid gears join to one, one gear left out."""
    return side(inertia, joints(system, "gears", without=(without,)))


# --- A system put together: coordinates, energies, virtual work, states and paths, as SymPy expressions.

STICK_SPEED = "simulation.stick_speed"  # rad/s over which the sign of a speed turns
RECORDING = "simulation.recording"  # its number from 1 in the order of a fit; 0 of any other motion
FOLLOW_TIME = "simulation.follow_time"  # s in which a limited rate follows where it may
CREEP = "simulation.creep"  # rad/s at which a held brake gives way under its full torque
SIMULATION_DEFAULTS = {STICK_SPEED: 1e-3, CONTACT_TIME: 1e-4, RECORDING: 0.0, FOLLOW_TIME: 5e-4, CREEP: 0.0}


class Assembly:
    """Energies, virtual work, states, input and sensor paths of a system; effects write into it.

    ``kinetic``, ``potential`` and ``dissipation`` (Rayleigh) are expressions by component; ``work`` lists
    (component, torque, motion): the torque does work on the motion. ``imposed`` holds by coordinate its place and the
    acceleration that it has whatever torques act. ``abbreviations`` are symbols of long products of
    ratios, in terms of parameters and earlier ones. ``masses`` (inertia, motion) and ``springs``
    are the elements of modal analysis, by component.
    """

    def __init__(self, system: System):
        self.system = system
        self.parameters: dict[str, sm.Symbol] = {name: sm.Symbol(name, real=True) for name in system.parameters}
        self._override: dict[str, sm.Expr] = {
            effect.at: self.parameters[f"{effect.name}.value"]
            for effect in system.effects
            if effect.law.replaces_quantity
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
        self._states_by_symbol: dict[sm.Symbol, list[str]] = {}
        self.abbreviations: dict[sm.Symbol, sm.Expr] = {}
        self.imposed: dict[int, tuple[str, sm.Expr]] = {}
        self.motions: dict[str, Motion] = {}
        self.shafts: dict[str, ShaftLaw] = {}
        self.inputs: dict[str, InputPath] = {}
        self.sensors: dict[str, SensorPath] = {}
        self._assemble()

    def symbol(self, name: str) -> sm.Expr:
        """The symbol of a parameter; what effects make of it, where they replace or change it."""
        return self._override.get(name, self.parameters[name])

    def abbreviate(self, expression: sm.Expr) -> sm.Symbol:
        """A symbol for a constant expression of parameters and earlier abbreviations."""
        symbol = sm.Symbol(f"k({len(self.abbreviations) + 1})", real=True)
        self.abbreviations[symbol] = expression
        return symbol

    def with_abbreviations(self, values: Mapping[str, float]) -> dict[str, float]:
        """Values of parameters by name, and of the abbreviations made of them."""
        known = dict(values)
        for symbol, expression in self.abbreviations.items():
            known[str(symbol)] = float(expression.subs({part: known[str(part)] for part in expression.free_symbols}))
        return known

    def add_coordinate(self, name: str) -> Motion:
        """A new degree of freedom."""
        index = len(self.coordinates)
        self.coordinates.append(name)
        for symbols, mark in ((self.q, "q"), (self.qd, "qd"), (self.qdd, "qdd")):
            symbols.append(sm.Symbol(f"{mark}({name})", real=True))
        return Motion({index: sm.Integer(1)}, self)

    def add_inertia(self, component: str, inertia: sm.Expr, motion: Motion) -> None:
        """Give a component its kinetic energy."""
        self.masses[component] = inertia, motion
        self.kinetic[component] = inertia * motion.speed**2 / 2

    def add_state(self, name: str, derivative: Callable[[sm.Symbol], sm.Expr]) -> sm.Symbol:
        """A new first-order state with its time derivative."""
        symbol = sm.Symbol(f"z({name})", real=True)
        rate = derivative(symbol)
        self.states[name] = (symbol, rate)
        for contained in rate.free_symbols:
            self._states_by_symbol.setdefault(contained, []).append(name)
        return symbol

    def add_torque(self, component: str, torque: sm.Expr, motion: Motion) -> None:
        """Let a torque do virtual work on a motion."""
        self.work.append((component, torque, motion))

    def load(self, place: str) -> sm.Expr:
        """The torque that all inputs together put on the inertia at a place."""
        on = [part.name for part in self.system.inputs if f"inertias.{part.on}" == place]
        other = {*self.system.imposed_by, *self.system.capacities}
        return sm.Add(*(self.inputs[name].value for name in on if name not in other))

    def impose(self, place: str, motion: Motion, acceleration: sm.Expr) -> None:
        """Let a motion have an acceleration whatever torques act on it; a later one replaces an earlier.

        Raises
        ------
        InputError
            If differentials or planetary gears make the motion of several coordinates.
        """
        if len(motion.coefficients) != 1:
            raise InputError(place, "is divided by a differential or planetary gear", "impose that of another inertia")
        ((index, coefficient),) = motion.coefficients.items()
        self.imposed[index] = place, acceleration / coefficient

    def sign(self, speed: sm.Expr) -> sm.Expr:
        """Sign of a speed, turning over a stick speed that the simulation keeps small."""
        return sm.tanh(speed / self.simulation(STICK_SPEED))

    @property
    def follow_time(self) -> sm.Symbol:
        """Time (s) in which a limited rate follows where it may, which the simulation keeps small."""
        return self.simulation(FOLLOW_TIME)

    @property
    def recording(self) -> sm.Symbol:
        """Number of the recording that is simulated, see ``RECORDING``."""
        return self.simulation(RECORDING)

    @property
    def creep(self) -> sm.Symbol:
        """Speed at which a held brake gives way under its full torque, see ``CREEP``."""
        return self.simulation(CREEP)

    def simulation(self, name: str) -> sm.Symbol:
        """A parameter of ``SIMULATION_DEFAULTS``, which the simulation sets."""
        return self.parameters.setdefault(name, sm.Symbol(name, real=True))

    def substitute(self, old: sm.Symbol, new: sm.Expr) -> None:
        """Replace a stand-in in the states' derivatives; one with a maximum unevaluated, which is faster."""
        with sm.evaluate(not new.has(sm.Max)):  # speed only
            for name in self._states_by_symbol.get(old, ()):
                z, rate = self.states[name]
                self.states[name] = (z, rate.xreplace({old: new}))

    def _assemble(self) -> None:
        system = self.system
        by_place: dict[str, list[tuple[Kind, dict[str, sm.Symbol]]]] = {}
        for effect in system.effects:
            p = {key: self.parameters[f"{effect.name}.{key}"] for key, _ in effect.parameters}
            places = (effect.at,) if effect.law.follows else effect.places
            for place in places:
                by_place.setdefault(place, []).append((effect.law, p))
            if effect.law.changes_quantity:
                self._override[effect.at] = effect.law.quantity(self.symbol(effect.at), p, self, effect.name)
        self.motions = eliminate(system, self)
        for shaft in system.shafts:
            law = self.shafts[shaft.name] = shaft_law.begin(shaft, self)
            for kind, p in by_place.get(law.place, ()):
                kind.shaft(law, p, self)
            second = law.second
            shaft_law.close(law, self)
            for loss in law.losses:
                self.add_torque(law.place, -loss(law.torque), second)
        for source in system.inputs:
            place = f"inputs.{source.name}"
            symbol = sm.Symbol(f"u({source.name})", real=True)
            path = self.inputs[source.name] = InputPath(place, source.on, symbol, sm.Integer(0))
            for kind, p in sorted(by_place.get(place, ()), key=lambda each: not each[0].pedal):
                kind.input(path, p, self)
        for part in system.inertias:
            place, motion = f"inertias.{part.name}", self.motions[part.name]
            self.add_inertia(place, self.symbol(f"{place}.J"), motion)
            self.dissipation[place] = self.symbol(f"{place}.drag") * motion.speed**2 / 2
            acting = [name for name in by_place if members(name)[0] == place]
            for name in acting:
                for kind, p in by_place[name]:
                    kind.inertia(motion, p, self, name)
        for source in system.inputs:
            path, motion = self.inputs[source.name], self.motions[source.on]
            imposing = system.imposed_by.get(source.name)
            if source.name in system.capacities:
                continue
            if imposing is None:
                self.add_torque(path.place, path.value, motion)
            else:
                imposing.imposed_input(path, system.input_quantities[source.name], motion, self)
        self._close_gearboxes()
        self._close_gears(by_place)
        for reading in system.sensors:
            place = f"sensors.{reading.name}"
            truth = self._truth(reading.measures, reading.of)
            sensor = self.sensors[reading.name] = SensorPath(
                place, truth, sm.Integer(0), reading.measures, self.motions.get(reading.of)
            )
            for kind, p in by_place.get(place, ()):
                kind.sensor(sensor, p, self)

    def _close_gearboxes(self) -> None:
        """The clutches of gearboxes: dry friction or teeth between both ends, whose torque is an input."""
        for box in self.system.gearboxes:
            place = f"gearboxes.{box.name}"
            first, second = (self.motions[name] for name in box.between)
            deflection = self.symbol(f"{place}.deflection")
            settling = None if box.settling is None else self.symbol(f"{place}.settling")
            below = None if box.engages_below is None else self.symbol(f"{place}.engages_below")
            if box.converter is not None:
                ratio = self.symbol(f"{place}.ratio_1")
                pump, turbine = converted(first.speed, ratio * second.speed, box.converter)
                self.add_torque(f"inertias.{box.between[0]}", -pump, first)
                self.add_torque(f"inertias.{box.between[1]}", ratio * turbine, second)
            for gear, capacity in enumerate(box.capacities, 1):
                ratio = self.symbol(f"{place}.ratio_{gear}")
                slip = first.speed - ratio * second.speed
                carried, state = self.inputs[capacity].value, f"{place}.{capacity}"
                if below is None:
                    share = dry_friction(slip, deflection, settling, self, state)
                else:
                    share = dog(slip, carried, below, deflection, settling, self, state)
                torque = carried * share
                self.add_torque(f"inertias.{box.between[0]}", -torque, first)
                self.add_torque(f"inertias.{box.between[1]}", ratio * torque, second)

    def _close_gears(self, by_place: Mapping[str, Sequence[tuple[Kind, dict[str, sm.Symbol]]]]) -> None:
        """Effects of rigid gears, once all torques are known."""
        for gear in self.system.gears:
            acting = by_place.get(f"gears.{gear.name}", ())
            if acting:
                law = self.gear_law(gear)
                for kind, p in acting:
                    kind.gear(law, p, self)

    def gear_law(self, gear: Gear) -> GearLaw:
        """Torques and inertias on both sides of a rigid gear.

        Raises
        ------
        InputError
            As :func:`modelling.equations.lagrange.check_loss`.
        """
        check_loss(self.system, gear, self.motions, self.shafts)
        on = {source.name: source.on for source in self.system.inputs}
        inertia = {part.name: self.symbol(f"inertias.{part.name}.J") for part in self.system.inertias}
        torques = [(acted_on(component, on), torque) for component, torque, _ in self.work]
        for name, motion in self.motions.items():
            torques.append((name, -self.symbol(f"inertias.{name}.drag") * motion.speed))
        for shaft in self.system.shafts:
            ratio = self.symbol(f"shafts.{shaft.name}.ratio") if shaft.ratio is not None else sm.S.One
            torques += torques_of_shaft(self.shafts[shaft.name], shaft.between, ratio)
        return gear_law(self.system, gear, self.motions, inertia, torques)

    def _truth(self, measures: str, of: str) -> sm.Expr:
        return self.shafts[of].torque if measures == "torque" else getattr(self.motions[of], measures)


# --- Lagrange


@dataclass(frozen=True)
class Equations:
    """M(p)·q̈ = force(q, q̇, z, u, p), ż = rates, y = readings; all SymPy, the mass matrix never inverted.

    Attributes
    ----------
    assembly : Assembly
        Energies by component, virtual work, coordinates, states, input and sensor paths.
    mass : dict of (int, int) to Expr
        Entries of the mass matrix (n, n) that are not zero, both triangles.
    force : list of Expr, length n
        Right-hand side.
    """

    assembly: Assembly
    mass: dict[tuple[int, int], sm.Expr] = field(repr=False)
    force: list[sm.Expr] = field(repr=False)

    @property
    def kinetic_energy(self) -> sm.Expr:
        """T = ½·Σ J·ω², J."""
        return sm.Add(*self.assembly.kinetic.values())

    @property
    def potential_energy(self) -> sm.Expr:
        """V, the elastic energy of the shafts, J."""
        return sm.Add(*self.assembly.potential.values())

    @property
    def dissipation(self) -> sm.Expr:
        """Rayleigh's dissipation function D = ½·Σ d·Δω², W."""
        return sm.Add(*self.assembly.dissipation.values())

    @property
    def motion(self) -> list[sm.Eq]:
        """Equations of motion, one a coordinate."""
        a = self.assembly
        inertial: list[list[sm.Expr]] = [[] for _ in a.q]
        for (i, j), entry in self.mass.items():
            inertial[i].append(entry * a.qdd[j])
        return [sm.Eq(sm.Add(*row), force, evaluate=False) for row, force in zip(inertial, self.force, strict=True)]

    def mass_matrix(self) -> sm.Matrix:
        """M as a SymPy matrix (n, n)."""
        n = len(self.assembly.q)
        return sm.Matrix(n, n, lambda i, j: self.mass.get((i, j), sm.Integer(0)))

    def _repr_html_(self) -> str:
        return display.html(self)


def derive(system: System) -> Equations:
    """Derive the equations of a system; systems that differ in values only share them.

    Raises
    ------
    InputError
        If rigid gears lock the system.
    """
    return _derive(_Structure(system))


def _of_gearbox(part: Gearbox) -> tuple[object, ...]:
    """What of a gearbox shapes the equations."""
    optional = part.settling is None, part.engages_below is None
    return part.name, part.between, part.capacities, *optional, part.converter


class _Structure:
    """The structure of a system, equal for systems of the same equations; values do not count."""

    def __init__(self, system: System):
        self.system = system
        self._key = (
            tuple(part.name for part in system.inertias),
            tuple((part.name, part.between, part.ratio is None) for part in system.shafts),
            tuple((part.name, part.between) for part in system.gears),
            tuple(_of_gearbox(part) for part in system.gearboxes),
            system.differentials,
            tuple((part.name, part.ends) for part in system.planetary_gears),
            system.inputs,
            tuple((part.name, part.measures, part.of) for part in system.sensors),
            tuple((effect.kind, effect.at, tuple(key for key, _ in effect.parameters)) for effect in system.effects),
        )

    def __hash__(self) -> int:
        return hash(self._key)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Structure) and self._key == other._key


@functools.lru_cache(maxsize=256)
def _derive(structure: _Structure) -> Equations:
    a = Assembly(structure.system)
    index = {symbol: i for symbols in (a.q, a.qd) for i, symbol in enumerate(symbols)}
    force: list[list[sm.Expr]] = [[] for _ in a.q]
    mass: dict[tuple[int, int], list[sm.Expr]] = {}
    for energy in a.kinetic.values():
        moving = sorted({index[s] for s in energy.free_symbols if s in index})
        for i in moving:
            momentum = differentiate(energy, a.qd[i])
            for j in moving:
                if entry := differentiate(momentum, a.qd[j]):
                    mass.setdefault((i, j), []).append(entry)
                if drift := differentiate(momentum, a.q[j]):
                    force[i].append(-drift * a.qd[j])
            if gradient := differentiate(energy, a.q[i]):
                force[i].append(gradient)
    for energies, symbols in ((a.potential, set(a.q)), (a.dissipation, set(a.qd))):
        for energy in energies.values():
            for s in energy.free_symbols:
                if s in symbols:
                    force[index[s]].append(-differentiate(energy, s))
    for _, torque, motion in a.work:
        for i, coefficient in motion.coefficients.items():
            force[i].append(torque * coefficient)
    _impose(a, mass, force)
    return Equations(a, {ij: sm.Add(*parts) for ij, parts in mass.items()}, [sm.Add(*parts) for parts in force])


def _impose(a: Assembly, mass: dict[tuple[int, int], list[sm.Expr]], force: list[list[sm.Expr]]) -> None:
    """Replace, in place, the equations of coordinates with an imposed acceleration, which acts on those coupled."""
    for i, (_, acceleration) in a.imposed.items():
        for j in range(len(force)):
            coupling = mass.pop((j, i), None)
            mass.pop((i, j), None)
            if coupling and j != i:
                force[j].append(-sm.Add(*coupling) * acceleration)
        mass[i, i], force[i] = [sm.Integer(1)], [acceleration]


# --- The symbols of an equation as a reader knows them: letter, number of time derivatives, and what it belongs to.

LETTERS = {"J": "J", "drag": "b", "stiffness": "c", "damping": "d", "ratio": "i"}
ANGLE, TORQUE, PEDAL, STATE = "φ", "M", "p", "z"


@dataclass(frozen=True)
class Sign:
    """How a symbol is written.

    Attributes
    ----------
    letter : str
        One letter, or the name of a quantity that has none.
    component : str
        Name in the model file of what it belongs to, written as subscript; may be empty.
    derivatives : int
        Dots above the letter.
    """

    letter: str
    component: str
    derivatives: int = 0


def signs(equations: Equations) -> dict[sm.Symbol, Sign]:
    """The sign of every symbol: J and b of inertias, c and d of shafts, i of ratios, φ of coordinates, M of inputs,
    p of pedals."""
    assembly = equations.assembly
    signs_by_symbol: dict[sm.Symbol, Sign] = {}
    for derivatives, symbols in enumerate((assembly.q, assembly.qd, assembly.qdd)):
        named = zip(symbols, assembly.coordinates, strict=True)
        signs_by_symbol |= {symbol: Sign(ANGLE, name, derivatives) for symbol, name in named}
    for name, symbol in assembly.parameters.items():
        parts = name.split(".")
        quantity, component = parts[-1], parts[1] if len(parts) > 2 else ""
        if parts[0] == "gearboxes" and quantity.startswith("ratio_"):
            quantity, component = "ratio", f"{component}, {quantity.removeprefix('ratio_')}"
        signs_by_symbol[symbol] = Sign(LETTERS.get(quantity, quantity) if len(parts) == 3 else quantity, component)
    signs_by_symbol |= {symbol: Sign("k", str(number)) for number, symbol in enumerate(assembly.abbreviations, 1)}
    signs_by_symbol |= {symbol: Sign(STATE, _state_of(name)) for name, (symbol, _) in assembly.states.items()}
    pedals = assembly.system.pedals
    signs_by_symbol |= {
        sm.Symbol(f"u({name})", real=True): Sign(PEDAL if name in pedals else TORQUE, name) for name in assembly.inputs
    }
    return signs_by_symbol


def _state_of(name: str) -> str:
    """``shafts.tyre.slip`` as a reader reads it: the component, then the effect whose state it is."""
    parts = name.split(".")
    return ", ".join(parts[1:]) if len(parts) > 1 else name


def known_zeros(equations: Equations, system: System) -> dict[sm.Symbol, sm.Expr]:
    """Drags and dampings that are exactly zero in the model, as a substitution that leaves them out."""
    return {
        equations.assembly.parameters[name]: sm.Integer(0)
        for name, quantity in system.parameters.items()
        if quantity.value == 0 and not quantity.uncertain and name.rsplit(".", 1)[1] in ("drag", "damping")
    }


# --- Equations in LaTeX, as notebooks render them.

_DOTS = (r"\varphi", r"\dot{\varphi}", r"\ddot{\varphi}")


def symbol_names(equations: Equations) -> dict[sm.Symbol, str]:
    """LaTeX of every symbol, see :func:`modelling.equations.lagrange.signs`."""
    return {symbol: _written(sign) for symbol, sign in signs(equations).items()}


def latex(equations: Equations, system: System | None = None) -> dict[str, list[str]]:
    """LaTeX of ``T``, ``V``, ``D`` and ``motion``; given a system, its drags and dampings of zero are left out."""
    zeros = known_zeros(equations, system) if system else {}
    names = symbol_names(equations)

    def write(expression: sm.Basic) -> str:
        return sm.latex(expression.xreplace(zeros), symbol_names=names)

    return {
        "T": [write(equations.kinetic_energy)],
        "V": [write(equations.potential_energy)],
        "D": [write(equations.dissipation)],
        "motion": [f"{write(equation.lhs)} = {write(equation.rhs)}" for equation in equations.motion],
    }


def html(equations: Equations, system: System | None = None) -> str:
    """The equations as a block of LaTeX that notebooks render."""
    parts = latex(equations, system)
    rows = [f"{name} &= {parts[name][0]}" for name in ("T", "V", "D")]
    rows += [line.replace(" = ", " &= ", 1) for line in parts["motion"]]
    title = system.title if system else ""
    body = r" \\ ".join(rows)
    return (f"<h4>{escape.html(title)}</h4>" if title else "") + rf"$$\begin{{aligned}}{body}\end{{aligned}}$$"


def _written(sign: Sign) -> str:
    if sign.letter == ANGLE:
        letter = _DOTS[sign.derivatives]
    else:
        letter = sign.letter if len(sign.letter) == 1 else _upright(sign.letter)
    return f"{letter}_{{{_upright(sign.component)}}}" if sign.component else letter


def _upright(name: str) -> str:
    return rf"\mathrm{{{escape.latex(name)}}}"
