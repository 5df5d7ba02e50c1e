"""Equations → CasADi functions of (state, input, parameters), translated once per structure."""

from __future__ import annotations

import functools
from collections.abc import Mapping

import casadi as ca
import numpy as np
import sympy as sm

from modelling.common.errors import InputError, unknown
from modelling.equations.assembly import SIMULATION_DEFAULTS
from modelling.equations.lagrange import Equations, derive
from modelling.equations.modal_elements import modal_elements
from modelling.equations.sparse import abbreviations, sparse
from modelling.equations.sympy_to_casadi import to_casadi
from modelling.model.system import System


class Model:
    """A system compiled: x = [q (n), q̇ (n), z], u inputs, p parameters.

    Attributes
    ----------
    coordinates, states, inputs, sensors, parameters : list of str
        Names, in the order of the vectors; ``states`` names all x.
    p0 : ndarray (p,)
        Parameter values of the system, SI.
    """

    def __init__(self, system: System):
        self.system = system
        self.equations: Equations = derive(system)
        self._functions = _compile(self.equations)
        a = self.equations.assembly
        self.coordinates = list(a.coordinates)
        self.states = [f"angle({c})" for c in a.coordinates] + [f"speed({c})" for c in a.coordinates] + list(a.states)
        self.inputs = [part.name for part in system.inputs]
        self.sensors = [part.name for part in system.sensors]
        self.parameters = list(a.parameters)
        values = SIMULATION_DEFAULTS | {name: quantity.value for name, quantity in system.parameters.items()}
        self.p0 = np.array([values[name] for name in self.parameters])

    @property
    def n(self) -> int:
        """Degrees of freedom."""
        return len(self.coordinates)

    @property
    def rates(self) -> ca.Function:
        """(x, u, p) → ẋ."""
        return self._functions["rates"]

    @property
    def readings(self) -> ca.Function:
        """(x, u, p, t) → y, without the sensors' delays."""
        return self._functions["readings"]

    @property
    def mass(self) -> ca.Function:
        """p → M (n, n), sparse."""
        return self._functions["mass"]

    @property
    def force(self) -> ca.Function:
        """(x, u, p) → M·q̈ (n,)."""
        return self._functions["force"]

    @property
    def delays(self) -> ca.Function:
        """p → (delay of each input, delay of each sensor), s."""
        return self._functions["delays"]

    @property
    def shaft_torques(self) -> ca.Function:
        """(x, u, p) → torque that each shaft transmits, N·m, on the second end's side."""
        return self._functions["shaft_torques"]

    @property
    def gear_torques(self) -> ca.Function:
        """(x, u, p) → torque that each rigid gear passes on, N·m, on the second end's side; NaN if undetermined."""
        return self._functions["gear_torques"]

    @property
    def jacobians(self) -> ca.Function:
        """(x, u, p, t) → A (x, x), B (x, u), C (y, x), D (y, u) of rates and readings."""
        return self._functions["jacobians"]

    @property
    def elements(self) -> ca.Function:
        """(x, p) → elements of modal analysis, see :func:`modelling.equations.modal_elements.modal_elements`."""
        return self._functions["elements"]

    @property
    def element_weights(self) -> ca.Function:
        """(x, p) → J (k,), stiffness (s,) of the elements alone."""
        if "element_weights" not in self._functions:
            x, p = ca.SX.sym("x", len(self.states)), ca.SX.sym("p", len(self.parameters))
            J, _, stiffness, *_ = self.elements(x, p)
            self._functions["element_weights"] = ca.Function("element_weights", [x, p], [J, stiffness])
        return self._functions["element_weights"]

    def vector(self, values: Mapping[str, float] | None = None) -> np.ndarray:
        """Parameter vector (p,) with some values changed by name.

        Raises
        ------
        InputError
            If a name is unknown.
        """
        p = self.p0.copy()
        for name, value in (values or {}).items():
            if name not in self._index:
                raise unknown(name, self.parameters, "")
            p[self._index[name]] = value
        return p

    @functools.cached_property
    def _index(self) -> dict[str, int]:
        return {name: i for i, name in enumerate(self.parameters)}


@functools.lru_cache(maxsize=256)
def compiled(system: System) -> Model:
    """The compiled model of a system; equations and functions are shared by systems of one structure.

    Raises
    ------
    InputError
        If rigid gears lock the system.
    NotImplementedError
        If a law uses a function that has no translation to CasADi.
    """
    return Model(system)


class _Functions(dict[str, ca.Function]):
    """Functions of one structure by name, built when they are first asked for: modes need no rates."""

    def __init__(self, equations: Equations):
        super().__init__()
        self.equations = equations

    def __missing__(self, name: str) -> ca.Function:
        if name == "elements":
            self[name] = modal_elements(self.equations)
        elif name == "gear_torques":
            self[name] = _gear_torques(self.equations)
        else:
            self.update(_functions(self.equations))
        return self[name]


_BY_EQUATIONS: dict[int, _Functions] = {}  # their equations are kept with them, so that an id is not used again


def _compile(equations: Equations) -> _Functions:
    kept = _BY_EQUATIONS.get(id(equations))
    if kept is None:
        kept = _BY_EQUATIONS[id(equations)] = _Functions(equations)
    return kept


def _functions(equations: Equations) -> dict[str, ca.Function]:
    a, n = equations.assembly, len(equations.assembly.q)
    x, u, p, t, known = _symbols(equations)
    mass = sparse(list(equations.mass), to_casadi(list(equations.mass.values()), known), n, n)
    force = _column(to_casadi(equations.force, known))
    acceleration = _solve(mass, force)
    torques = _column(to_casadi([law.torque for law in a.shafts.values()], known))
    for i, symbol in enumerate(a.qdd):
        known[symbol] = acceleration[i]
    rates = _column(to_casadi([rate for _, rate in a.states.values()], known))
    readings = _column(to_casadi([path.value for path in a.sensors.values()], known))
    input_delays = _column(to_casadi([path.delay for path in a.inputs.values()], known))
    sensor_delays = _column(to_casadi([path.delay for path in a.sensors.values()], known))
    xdot, readings = ca.cse([ca.vertcat(x[n : 2 * n], acceleration, rates), readings])
    jacobians = [ca.jacobian(xdot, x), ca.jacobian(xdot, u), ca.jacobian(readings, x), ca.jacobian(readings, u)]
    return {
        "rates": ca.Function("rates", [x, u, p], [xdot], ["x", "u", "p"], ["xdot"]),
        "readings": ca.Function("readings", [x, u, p, t], [readings], ["x", "u", "p", "t"], ["y"]),
        "mass": ca.Function("mass", [p], [mass], ["p"], ["M"]),
        "force": ca.Function("force", [x, u, p], [force], ["x", "u", "p"], ["f"]),
        "shaft_torques": ca.Function("shaft_torques", [x, u, p], [torques], ["x", "u", "p"], ["torque"]),
        "delays": ca.Function("delays", [p], [input_delays, sensor_delays], ["p"], ["input", "sensor"]),
        "jacobians": ca.Function("jacobians", [x, u, p, t], jacobians, ["x", "u", "p", "t"], ["A", "B", "C", "D"]),
    }


def _symbols(equations: Equations) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX, dict[sm.Symbol, ca.SX]]:
    """Vectors x, u, p, the time t, and what each symbol of the equations is of them."""
    a = equations.assembly
    x, u = ca.SX.sym("x", 2 * len(a.q) + len(a.states)), ca.SX.sym("u", len(a.inputs))
    p, t = ca.SX.sym("p", len(a.parameters)), ca.SX.sym("t")
    known = {symbol: x[i] for i, symbol in enumerate([*a.q, *a.qd, *(z for z, _ in a.states.values())])}
    # an input path may end in a state; its recorded value is always u(name)
    known |= {sm.Symbol(f"u({name})", real=True): u[i] for i, name in enumerate(a.inputs)}
    known |= {symbol: p[i] for i, symbol in enumerate(a.parameters.values())}
    known[a.time] = t
    return x, u, p, t, known | abbreviations(equations, known)


def _gear_torques(equations: Equations) -> ca.Function:
    x, u, p, _, known = _symbols(equations)
    torques = []
    for gear in equations.assembly.system.gears:
        try:
            torques += to_casadi([equations.assembly.gear_law(gear).torque], known)
        except InputError:
            torques.append(ca.SX(np.nan))
    return ca.Function("gear_torques", [x, u, p], [_column(torques)], ["x", "u", "p"], ["torque"])


def _column(parts: list) -> ca.SX:
    return ca.vertcat(*parts) if parts else ca.SX(0, 1)


def _solve(mass: ca.SX, force: ca.SX) -> ca.SX:
    """M⁻¹·f as operations on the sparse factors of M: no fill where gears do not couple coordinates."""
    diagonal, lower, order = ca.ldl(mass)
    return ca.ldl_solve(force, diagonal, lower, order)
