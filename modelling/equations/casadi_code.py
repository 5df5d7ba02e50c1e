"""Equations as CasADi functions of state, inputs and parameters, translated from SymPy once for each structure."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np
import sympy as sm

from modelling.effects.torque_map import MapTorque
from modelling.equations.lagrange import SIMULATION_DEFAULTS, Equations, derive
from modelling.errors import InputError, unknown
from modelling.system import System

# --- SymPy → CasADi: an iterative, memoised translation that raises on functions it does not know.

_UNARY = {
    sm.sin: ca.sin, sm.cos: ca.cos, sm.tan: ca.tan, sm.asin: ca.asin, sm.acos: ca.acos, sm.atan: ca.atan,
    sm.sinh: ca.sinh, sm.cosh: ca.cosh, sm.tanh: ca.tanh, sm.asinh: ca.asinh, sm.acosh: ca.acosh, sm.atanh: ca.atanh,
    sm.exp: ca.exp, sm.log: ca.log, sm.Abs: ca.fabs,
    sm.sign: ca.sign, sm.floor: ca.floor, sm.ceiling: ca.ceil,
}  # fmt: skip
_PAIRWISE = {sm.Max: ca.fmax, sm.Min: ca.fmin, sm.And: ca.logic_and, sm.Or: ca.logic_or}
_RELATION = {sm.StrictGreaterThan: ca.gt, sm.GreaterThan: ca.ge, sm.StrictLessThan: ca.lt, sm.LessThan: ca.le}


def to_casadi(expressions: Sequence[sm.Expr], known: Mapping[sm.Symbol, ca.SX]) -> list[ca.SX]:
    """Translate SymPy expressions, shared parts once.

    Parameters
    ----------
    expressions : sequence of Expr
    known : mapping
        The CasADi scalar of every symbol.

    Raises
    ------
    NotImplementedError
        If a function, relation or symbol is not known.
    """
    done: dict[sm.Basic, ca.SX] = dict(known)
    for expression in expressions:
        stack = [sm.sympify(expression)]
        while stack:
            node = stack[-1]
            if node in done:
                stack.pop()
                continue
            todo = [part for part in _parts(node) if part not in done]
            if todo:
                stack.extend(todo)
            else:
                done[stack.pop()] = _translated(node, done)
    return [done[sm.sympify(expression)] for expression in expressions]


def _parts(node: sm.Basic) -> Sequence[sm.Basic]:
    if isinstance(node, sm.Piecewise):
        return [part for value, condition in node.args for part in (value, condition)]
    return node.args


def _translated(node: sm.Basic, done: Mapping[sm.Basic, ca.SX]) -> ca.SX:
    if (node.is_Number and node.is_finite) or isinstance(node, sm.NumberSymbol):
        return ca.SX(float(node))
    if node is sm.true or node is sm.false:
        return ca.SX(float(node is sm.true))
    parts = [done[part] for part in _parts(node)]
    if node.is_Add:
        return sum(parts[1:], parts[0])
    if node.is_Mul:
        product = parts[0]
        for part in parts[1:]:
            product = product * part
        return product
    if node.is_Pow:
        return _power(node, parts)
    if isinstance(node, sm.Piecewise):
        return _piecewise(parts)
    if node.func in _PAIRWISE:
        pick = _PAIRWISE[node.func]
        out = parts[0]
        for part in parts[1:]:
            out = pick(out, part)
        return out
    if node.func in _UNARY:
        return _UNARY[node.func](*parts)
    if node.func in _RELATION:
        return _RELATION[node.func](*parts)
    if node.func is sm.Not:
        return ca.logic_not(*parts)
    if node.func is sm.atan2:
        return ca.atan2(*parts)
    if node.func is MapTorque:
        return _map_torque(parts[0], parts[1], int(node.args[2]), parts[3:])
    raise NotImplementedError(f"no translation to CasADi for {node.func.__name__}: {node}")


def _power(node: sm.Pow, parts: list[ca.SX]) -> ca.SX:
    return 1 / parts[0] if node.exp == -1 else parts[0] ** parts[1]


def _piecewise(parts: list[ca.SX]) -> ca.SX:
    """Nested choices from the last piece inwards; without a piece that always holds it is NaN there, as in SymPy."""
    out = ca.SX(float("nan"))
    for value, condition in reversed(list(zip(parts[::2], parts[1::2], strict=True))):
        out = value if condition.is_constant() and float(condition) == 1 else ca.if_else(condition, value, out)
    return out


BEYOND = 1e-9  # of an axis, beyond whose ends a map is held: at a pedal of 0 it has the slope of one that is pressed


def _map_torque(speed: ca.SX, pedal: ca.SX, rows: int, points: Sequence[ca.SX]) -> ca.SX:
    """A torque over speed and pedal, bilinear between points [speeds; pedals; torques row by row], held beyond them."""
    columns = (len(points) - rows) // (rows + 1)
    speeds, pedals, torques = points[:rows], points[rows : rows + columns], points[rows + columns :]
    at_speed = _shares(speed, speeds)
    over_pedal = [_between(torques[j::columns], at_speed) for j in range(columns)]
    return _between(over_pedal, _shares(pedal, pedals))


def _shares(x: ca.SX, points: Sequence[ca.SX]) -> list[ca.SX]:
    """By interval of the points, the share of it that lies below x: 0 to 1."""
    first, last = points[0], points[-1]
    over = BEYOND * (last - first)
    held = ca.fmax(ca.fmin(x, last + over), first - over)
    shares = []
    for number, (low, high) in enumerate(itertools.pairwise(points), 1):
        from_low = ca.fabs(held - low) if number > 1 else held - low
        to_high = ca.fabs(held - high) if number < len(points) - 1 else high - held
        shares.append((from_low - to_high + high - low) / (2 * (high - low)))
    return shares


def _between(values: Sequence[ca.SX], shares: Sequence[ca.SX]) -> ca.SX:
    """Linear between values at the points whose intervals have these shares."""
    total = values[0]
    for (first, last), share in zip(itertools.pairwise(values), shares, strict=True):
        total = total + (last - first) * share
    return total


# --- Sparse symbolic matrices, and long products of ratios translated once.


def sparse(places: Sequence[tuple[int, int]], entries: Sequence[ca.SX], rows: int, columns: int) -> ca.SX:
    """A matrix (rows, columns) of its entries that are not zero."""
    if not entries:
        return ca.SX(rows, columns)
    i, j = zip(*places, strict=True)
    pattern = ca.Sparsity.triplet(rows, columns, i, j)
    order = {place: number for number, place in enumerate(zip(pattern.row(), pattern.get_col(), strict=True))}
    by_column: list[ca.SX] = [ca.SX(0)] * len(entries)
    for place, entry in zip(places, entries, strict=True):
        by_column[order[place]] = entry
    return ca.SX(pattern, ca.vertcat(*by_column))


def abbreviations(equations: Equations, known: Mapping[sm.Symbol, ca.SX]) -> dict[sm.Symbol, ca.SX]:
    """The CasADi scalar of every abbreviation; ``known`` has those of the parameters."""
    translated: dict[sm.Symbol, ca.SX] = {}
    for symbol, expression in equations.assembly.abbreviations.items():
        within = {part: translated[part] if part in translated else known[part] for part in expression.free_symbols}
        (translated[symbol],) = to_casadi([expression], within)
    return translated


# --- Masses and springs of small oscillations as a CasADi function: each element a coefficient and a row.


def modal_elements(equations: Equations) -> ca.Function:
    """(x, p) → J (k,), turns (k, n), stiffness (s,), twists (s, n), deflections (s, x), whether each p is in a row."""
    a = equations.assembly
    n = len(a.q)
    x, p = ca.SX.sym("x", 2 * n + len(a.states)), ca.SX.sym("p", len(a.parameters))
    known = {symbol: x[i] for i, symbol in enumerate([*a.q, *a.qd, *(z for z, _ in a.states.values())])}
    known |= {symbol: p[i] for i, symbol in enumerate(a.parameters.values())}
    known |= abbreviations(equations, known)
    turns = _rows([_free(motion.coefficients, a.imposed) for _, motion in a.masses.values()], n, known)
    twists = _rows([_held(spring.twist.coefficients, a.imposed) for spring in a.springs.values()], n, known)
    masses = ca.vertcat(*to_casadi([J for J, _ in a.masses.values()], known))
    springs = list(a.springs.values())
    stiffness = ca.vertcat(*to_casadi([spring.stiffness for spring in springs], known)) if springs else ca.SX(0, 1)
    deflection = ca.vertcat(*to_casadi([spring.deflection for spring in springs], known)) if springs else ca.SX(0, 1)
    nonzeros: list[Any] = [*turns.nonzeros(), *twists.nonzeros()]
    coefficients = ca.vertcat(*nonzeros)
    in_rows = ca.DM(ca.which_depends(coefficients, p, 1, False)) if p.numel() else ca.DM()
    outputs: list[Any] = [masses, turns, stiffness, twists, ca.jacobian(deflection, x), in_rows]
    return ca.Function("elements", [x, p], outputs)


def _held(coefficients: dict[int, Any], imposed: Collection[int]) -> dict[int, Any]:
    """A motion while imposed ones stand still."""
    return {i: coefficient for i, coefficient in coefficients.items() if i not in imposed}


def _free(coefficients: dict[int, Any], imposed: Collection[int]) -> dict[int, Any]:
    """The same; what only an imposed motion moves is a mode of its own, at 0 Hz."""
    return _held(coefficients, imposed) or coefficients


def _rows(motions: list[dict[int, Any]], n: int, known: dict) -> ca.SX:
    """Coefficients of motions as a sparse matrix (r, n)."""
    places = [(i, j) for i, motion in enumerate(motions) for j in motion]
    entries = to_casadi([entry for motion in motions for entry in motion.values()], known)
    return sparse(places, entries, len(motions), n)


# --- Equations → CasADi functions of (state, input, parameters), translated once per structure.


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
        """(x, p) → elements of modal analysis, see :func:`modelling.equations.casadi_code.modal_elements`."""
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
