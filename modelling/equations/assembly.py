"""A system put together: coordinates, energies, virtual work, states and paths, as SymPy expressions."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import sympy as sm

from modelling.common.errors import InputError
from modelling.effects import Kind
from modelling.effects.interface import GearLaw, InputPath, Motion, SensorPath, ShaftLaw, Spring
from modelling.effects.place import members
from modelling.equations import rigid_train, shaft_law
from modelling.equations.constraints import eliminate
from modelling.equations.shaft_law import CONTACT_TIME
from modelling.model.components import Gear
from modelling.model.system import System

STICK_SPEED = "simulation.stick_speed"  # rad/s over which the sign of a speed turns
RECORDING = "simulation.recording"  # its number from 1 in the order of a fit; 0 of any other motion
SIMULATION_DEFAULTS = {STICK_SPEED: 1e-3, CONTACT_TIME: 1e-4, RECORDING: 0.0}


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

    def impose(self, place: str, motion: Motion, acceleration: sm.Expr) -> None:
        """Let a motion have an acceleration whatever torques act on it; a later one replaces an earlier.

        Raises
        ------
        InputError
            If differentials make the motion of several coordinates.
        """
        if len(motion.coefficients) != 1:
            raise InputError(place, "a differential divides this motion", "impose that of an inertia beside it")
        ((index, coefficient),) = motion.coefficients.items()
        self.imposed[index] = place, acceleration / coefficient

    def sign(self, speed: sm.Expr) -> sm.Expr:
        """Sign of a speed, turning over a stick speed that the simulation keeps small."""
        return sm.tanh(speed / self.simulation(STICK_SPEED))

    @property
    def recording(self) -> sm.Symbol:
        """Number of the recording that is simulated, see ``RECORDING``."""
        return self.simulation(RECORDING)

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
        for part in system.inertias:
            place, motion = f"inertias.{part.name}", self.motions[part.name]
            self.add_inertia(place, self.symbol(f"{place}.J"), motion)
            self.dissipation[place] = self.symbol(f"{place}.drag") * motion.speed**2 / 2
            acting = [name for name in by_place if members(name)[0] == place]
            for name in acting:
                for kind, p in by_place[name]:
                    kind.inertia(motion, p, self, name)
        for source in system.inputs:
            place = f"inputs.{source.name}"
            path = self.inputs[source.name] = InputPath(place, sm.Symbol(f"u({source.name})", real=True), sm.Integer(0))
            for kind, p in by_place.get(place, ()):
                kind.input(path, p, self)
            motion, imposing = self.motions[source.on], system.imposed_by.get(source.name)
            if imposing is None:
                self.add_torque(place, path.value, motion)
            else:
                imposing.imposed_input(path, system.input_quantities[source.name], motion, self)
        self._close_gears(by_place)
        for reading in system.sensors:
            place = f"sensors.{reading.name}"
            truth = self._truth(reading.measures, reading.of)
            sensor = self.sensors[reading.name] = SensorPath(place, truth, sm.Integer(0))
            for kind, p in by_place.get(place, ()):
                kind.sensor(sensor, p, self)

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
            As :func:`modelling.equations.rigid_train.check_loss`.
        """
        rigid_train.check_loss(self.system, gear, self.motions, self.shafts)
        on = {source.name: source.on for source in self.system.inputs}
        inertia = {part.name: self.symbol(f"inertias.{part.name}.J") for part in self.system.inertias}
        torques = [(rigid_train.acted_on(component, on), torque) for component, torque, _ in self.work]
        for name, motion in self.motions.items():
            torques.append((name, -self.symbol(f"inertias.{name}.drag") * motion.speed))
        for shaft in self.system.shafts:
            ratio = self.symbol(f"shafts.{shaft.name}.ratio") if shaft.ratio is not None else sm.S.One
            torques += rigid_train.torques_of_shaft(self.shafts[shaft.name], shaft.between, ratio)
        return rigid_train.gear_law(self.system, gear, self.motions, inertia, torques)

    def _truth(self, measures: str, of: str) -> sm.Expr:
        return self.shafts[of].torque if measures == "torque" else getattr(self.motions[of], measures)
