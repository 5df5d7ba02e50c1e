"""The nonlinear programme of a match: closed loop, objective and constraints as CasADi functions with derivatives."""

from __future__ import annotations

import functools
import os
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path
from threading import Lock
from typing import Any, ClassVar, NamedTuple

import casadi as ca
import numpy as np

from matching.match.case import Case, Compared, Demands, Goal, Move, is_logarithmic, scaled, unscaled
from modelling.bed.bed import ControlStructure, Dynamometer
from modelling.bed.vehicle import Interface
from modelling.equations.casadi_code import Complex, Model, Row, compiled, exp, joined, solve
from modelling.errors import unknown
from modelling.linear.steady_motion import reference_motion
from modelling.modal.modes import modes
from modelling.simulation.compiled import compiler, generated, loaded, shared
from modelling.system import Gear, Shaft, System

# --- Where the dead time enters the optimiser: exactly, as exp(−s·T) between each command and its inverter.


def actuator(loop: Mapping[str, ca.SX], s: Complex) -> Complex:
    """Air-gap torque over command: dead time, then inverter lag (s)."""
    return exp(-(s * loop["dead_time"])) / (1 + s * loop["inverter_lag"])


# --- A linear system at a complex frequency, as expressions.


class LinearResponse:
    """A linear system at a complex frequency: responses of its sensors to unit inputs.

    It is linear about the reference motion at the model's own values, which stays where ``p`` moves.
    """

    def __init__(self, model: Model, p: ca.SX, s: Complex):
        self.inputs, self.sensors = model.inputs, model.sensors
        n, extra = model.n, len(model.states) - 2 * model.n
        x, u = ca.SX.sym("x", 2 * n + extra), ca.SX.sym("u", len(model.inputs))
        about = reference_motion(model, model.p0)

        def at_reference(expressions: list[ca.SX]) -> list[ca.SX]:
            return ca.substitute(expressions, [x, u], [ca.DM(about.state), ca.DM(about.inputs)])

        force, mass = model.force(x, u, p), model.mass(p)
        rates, readings = model.rates(x, u, p), model.readings(x, u, p, 0)
        fx, fu, zx, zu, yx, yu = at_reference(
            [
                ca.jacobian(force, x), ca.jacobian(force, u),
                ca.jacobian(rates[2 * n :], x), ca.jacobian(rates[2 * n :], u),
                ca.jacobian(readings, x), ca.jacobian(readings, u),
            ]
        )  # fmt: skip
        rows: list[Row] = [{} for _ in range(n + extra)]
        for i in range(n):
            for j in range(n):
                _put(rows[i], j, [-fx[i, j], -fx[i, n + j], mass[i, j]], s)
            for j in range(extra):
                _put(rows[i], n + j, [-fx[i, 2 * n + j]], s)
        for i in range(extra):
            for j in range(n):
                _put(rows[n + i], j, [-zx[i, j], -zx[i, n + j]], s)
            for j in range(extra):
                _put(rows[n + i], n + j, [-zx[i, 2 * n + j], ca.SX(1.0 if i == j else 0.0)], s)
        self.solution = solve(rows, [Complex(row) for row in ca.vertsplit(ca.vertcat(fu, zu))])
        self._yx, self._yu, self._n, self._s = yx, yu, n, s
        self._known: dict[str, Complex] = {}

    def response(self, sensor: str, source: str) -> Complex:
        """Transfer function from an input to a sensor."""
        return self.responses(sensor)[self.inputs.index(source)]

    def responses(self, sensor: str) -> Complex:
        """Transfer functions from all inputs to a sensor, a row."""
        if sensor not in self._known:
            self._known[sensor] = self._responses(self.sensors.index(sensor))
        return self._known[sensor]

    def _responses(self, i: int) -> Complex:
        n, total = self._n, Complex(self._yu[i, :])
        row = self._yx[i, :]
        for k in range(n):
            if row.sparsity().has_nz(0, k) or row.sparsity().has_nz(0, n + k):
                total = total + (Complex(row[k]) + self._s * row[n + k]) * self.solution[k]
        for k in range(n, len(self.solution)):
            if row.sparsity().has_nz(0, n + k):
                total = total + self.solution[k] * row[n + k]
        return total


def _put(row: Row, column: int, coefficients: Sequence[ca.SX], s: Complex) -> None:
    """Add a polynomial in s, lowest power first, where any coefficient is there."""
    if not any(_present(c) for c in coefficients):
        return
    total = Complex(0.0)
    for c in reversed(coefficients):
        total = total * s + Complex(c)
    row[column] = total


def _present(value: ca.SX) -> bool:
    return value.nnz() > 0 and not value.is_zero()


# --- The feedback loop closed round rig and residual vehicle, as expressions at one complex frequency.


@dataclass(frozen=True)
class LoopShape:
    """What the expressions of a loop are made from; ``known`` are the values that are 0 or 1, None for the others."""

    rig: System
    parts: tuple[System, ...]
    interfaces: tuple[Interface, ...]
    dynamometers: tuple[Dynamometer, ...]
    compared: tuple[Compared, ...]
    names: tuple[str, ...]
    known: tuple[float | None, ...]
    control: ControlStructure
    moving: tuple[tuple[str, ...], ...]

    @property
    def still(self) -> list[int]:
        """Entries of ``names`` that neither move nor are known."""
        moved = {name for group in self.moving for name in group}
        entries = enumerate(zip(self.names, self.known, strict=True))
        return [i for i, (name, value) in entries if name not in moved and value is None]

    def cut(self, dyno: Dynamometer) -> Interface:
        """The interface that a dynamometer follows."""
        return next(interface for interface in self.interfaces if interface.shaft == dyno.follows)


class FeedbackLoop:
    """The loop closed round rig and residual vehicle at s.

    Parameters
    ----------
    shape : LoopShape
    rig, parts : LinearResponse
        The rig and the parts of the residual vehicle.
    loop : dict of str to SX
        Values of the loop.
    s : Complex
        rad/s.
    """

    def __init__(
        self, shape: LoopShape, rig: LinearResponse, parts: list[LinearResponse], loop: dict[str, ca.SX], s: Complex
    ):
        self._shape, self._rig, self._parts, self._loop, self._s = shape, rig, parts, loop, s
        self._dynamometers, self._size = shape.dynamometers, len(shape.dynamometers)
        self._sensor_lag = 1 / (1 + s * loop["torque_sensor_lag"])
        self._sign = [sensor_sign(shape.rig, dynamometer) for dynamometer in shape.dynamometers]
        self._zeros = [Complex(0.0)] * self._size
        torques = [rig.responses(d.torque_sensor) * self._sign[k] for k, d in enumerate(shape.dynamometers)]
        speeds = [rig.responses(d.speed_sensor) for d in shape.dynamometers]
        self._reactions = self._air_gap_torques(torques, speeds, self._zeros)

    def difference(self) -> list[list[Complex]]:
        """Return difference I + L at the dynamometers' commands, (u, u)."""
        columns = [self._rig.inputs.index(dynamometer.torque_input) for dynamometer in self._dynamometers]
        return [
            [(1 if row == i else 0) - reaction[column] for i, column in enumerate(columns)]
            for row, reaction in enumerate(self._reactions)
        ]

    def responses(self) -> list[Complex]:
        """The compared transfer functions (h), to sensors of the rig or of the residual vehicle."""
        sources = list(dict.fromkeys(pair.input for pair in self._shape.compared))
        right = [joined([self._driven(j, source) for source in sources]) for j in range(self._size)]
        torques = solve([dict(enumerate(row)) for row in self.difference()], right)
        rows: dict[str, Complex] = {}

        def on_rig(sensor: str) -> Complex:
            """To all sources, a row."""
            if sensor not in rows:
                rows[sensor] = self._on_rig(sensor, sources, torques)
            return rows[sensor]

        return [self._compared(pair, sources.index(pair.input), on_rig) for pair in self._shape.compared]

    def _compared(self, pair: Compared, column: int, on_rig: Callable[[str], Complex]) -> Complex:
        if pair.sensor in self._rig.sensors:
            return on_rig(pair.sensor)[column]
        return self._in_residual(pair.sensor, pair.input, lambda sensor: on_rig(sensor)[column])

    def _air_gap_torques(self, torques: list[Complex], speeds: list[Complex], roads: list[Complex]) -> list[Complex]:
        """For flange torques, rotor speeds and what the roads do to the reference speeds."""
        measured = [torque * self._sensor_lag for torque in torques]
        reference = [
            sum((self._emulated(d, other) * measured[k] for k, other in enumerate(self._dynamometers)), roads[j])
            for j, d in enumerate(self._dynamometers)
        ]
        act = actuator(self._loop, self._s)
        commands = self._shape.control.commands(self._loop, self._s, reference, speeds, measured)
        return [act * command for command in commands]

    def _driven(self, j: int, source: str) -> Complex:
        """Air-gap torque of dynamometer j for a unit of a source, the loop open."""
        if source in self._rig.inputs:
            return self._reactions[j][self._rig.inputs.index(source)]
        roads = [self._road(dynamometer, source) for dynamometer in self._dynamometers]
        return self._air_gap_torques(self._zeros, self._zeros, roads)[j]

    def _on_rig(self, sensor: str, sources: list[str], torques: list[Complex]) -> Complex:
        rig = self._rig
        direct = [rig.response(sensor, source) if source in rig.inputs else Complex(0.0) for source in sources]
        caused = (rig.response(sensor, d.torque_input) * torques[j] for j, d in enumerate(self._dynamometers))
        return sum(caused, joined(direct))

    def _in_residual(self, sensor: str, source: str, on_rig: Callable[[str], Complex]) -> Complex:
        part = next(part for part in self._parts if sensor in part.sensors)
        total = part.response(sensor, source) if source in part.inputs else Complex(0.0)
        for k, dynamometer in enumerate(self._dynamometers):
            if (driven := self._shape.cut(dynamometer).torque) in part.inputs:
                measured = on_rig(dynamometer.torque_sensor) * self._sensor_lag * self._sign[k]
                total = total + part.response(sensor, driven) * measured
        return total

    def _emulated(self, of: Dynamometer, by: Dynamometer) -> Complex:
        """Reference speed of one dynamometer for a torque at another one's interface."""
        return self._road(of, self._shape.cut(by).torque)

    def _road(self, of: Dynamometer, source: str) -> Complex:
        """Reference speed of a dynamometer for an input of the residual vehicle."""
        wanted = self._shape.cut(of)
        for part in self._parts:
            if wanted.speed in part.sensors and source in part.inputs:
                return part.response(wanted.speed, source)
        return Complex(0.0)


def sensor_sign(rig: System, dyno: Dynamometer) -> float:
    """Torque that drives the rotor for a reading of 1 N·m: +1 for a rotor at the flange's second end, else −1/ratio."""
    sensor = next(part for part in rig.sensors if part.name == dyno.torque_sensor)
    flange: Shaft = next(part for part in rig.shafts if part.name == sensor.of)
    rotor = next(part.on for part in rig.inputs if part.name == dyno.torque_input)
    reached, todo = {rotor}, [rotor]
    links: list[Shaft | Gear] = [*rig.shafts, *rig.gears]
    joints = [part.between for part in links if part.name != flange.name]
    while todo:
        here = todo.pop()
        for ends in joints:
            if here in ends:
                for end in set(ends) - reached:
                    reached.add(end)
                    todo.append(end)
    if flange.between[1] in reached:
        return 1.0
    return -1.0 if flange.ratio is None else -1 / flange.ratio.value


# --- The feedback loop in the frequency domain as one CasADi function of (s, p): exact, dead time included.
#
# Rig and residual vehicle are solved as dynamic stiffnesses, (s²·M + s·C + K)·q = torques, the loop is closed round
# them, and the functions give the compared transfer functions, to sensors of the rig or of the residual vehicle, and
# the
# return difference I + L at the dynamometers' commands. Derivatives are CasADi's, exact.


@dataclass(frozen=True, eq=False)
class General:
    """Compared responses and return difference of (s_re, s_im, p, fixed): one object for all cases of one structure."""

    response: ca.Function
    difference: ca.Function


@dataclass(frozen=True)
class ClosedLoopFunctions:
    """The loop of a case as CasADi functions.

    Attributes
    ----------
    parameters : tuple of str
        Names of p: ``residual_vehicle.…``, ``rig.…``, ``loop.…``.
    values : ndarray (p,)
        Values as the case has them.
    fixed : ndarray (c,)
        What does not move, as far as it is neither 0 nor 1, which are part of the structure.
    general : General
        :attr:`response` and :attr:`difference` for every case of the structure.
    """

    parameters: tuple[str, ...]
    values: np.ndarray
    fixed: np.ndarray
    general: General

    @cached_property
    def response(self) -> ca.Function:
        """(s_re, s_im, p) → H re (h,), H im (h,) of the compared functions."""
        return self._here(self.general.response)

    @cached_property
    def difference(self) -> ca.Function:
        """(s_re, s_im, p) → return difference I + L, re (u·u,) and im, row by row."""
        return self._here(self.general.difference)

    def _here(self, general: ca.Function) -> ca.Function:
        inputs = [ca.SX.sym("s_re"), ca.SX.sym("s_im"), ca.SX.sym("p", len(self.values))]
        outputs: Any = general(*inputs, ca.SX(self.fixed))  # in CasADi's stubs a call gives one output
        return ca.Function(general.name(), inputs, ca.cse(list(outputs)), ["s_re", "s_im", "p"], ["re", "im"])


def closed_loop(case: Case, moving: Sequence[tuple[str, ...]] | None = None) -> ClosedLoopFunctions:
    """Build the feedback loop of a case; the model-based feed-forward is left out.

    Parameters
    ----------
    case : Case
    moving : sequence of tuple of str, optional
        Groups of names that share one entry of p (a quantity and its mirror image); every name by itself unless given.
        The rest do not move, which makes derivatives cheaper.
    """
    systems = {"rig": [case.rig], "residual_vehicle": case.residual_vehicle.parts}
    values: list[tuple[str, float]] = []
    for prefix, parts in systems.items():
        models = [compiled(system) for system in parts]
        values += [
            (f"{prefix}.{name}", value)
            for model in models
            for name, value in zip(model.parameters, model.p0, strict=True)
        ]
    values += [(f"loop.{name}", value) for name, value in case.loop.values.items()]
    names = tuple(name for name, _ in values)
    groups = [(name,) for name in names] if moving is None else list(moving)
    for name in (name for group in groups for name in group):
        if name not in names:
            raise unknown(name, list(names), "")
    structure = LoopShape(
        case.rig,
        tuple(case.residual_vehicle.parts),
        tuple(case.residual_vehicle.interfaces),
        tuple(case.loop.dynamometers),
        tuple(case.compared),
        names,
        tuple(float(value) if value in (0.0, 1.0) else None for _, value in values),
        case.loop.structure,
        tuple(groups),
    )
    kept = np.array([values[names.index(group[0])][1] for group in groups])
    fixed_values = np.array([values[i][1] for i in structure.still])
    return ClosedLoopFunctions(tuple(group[0] for group in groups), kept, fixed_values, _expressions(structure))


@lru_cache(maxsize=16)
def _expressions(shape: LoopShape) -> General:
    rig, parts, still = compiled(shape.rig), [compiled(part) for part in shape.parts], shape.still
    symbols, fixed = ca.SX.sym("p", len(shape.moving)), ca.SX.sym("fixed", len(still))
    p = ca.SX([0.0 if value is None else value for value in shape.known])
    for i, entry in enumerate(still):
        p[entry] = fixed[i]
    for i, group in enumerate(shape.moving):
        for name in group:
            p[shape.names.index(name)] = symbols[i]
    s = Complex(ca.SX.sym("s_re"), ca.SX.sym("s_im"))
    loop = {name.removeprefix("loop."): p[i] for i, name in enumerate(shape.names) if name.startswith("loop.")}
    starts = np.cumsum([0, len(rig.parameters), *(len(part.parameters) for part in parts)])
    systems = [
        LinearResponse(model, p[int(a) : int(b)], s)
        for model, a, b in zip([rig, *parts], starts[:-1], starts[1:], strict=True)
    ]
    closed = FeedbackLoop(shape, systems[0], systems[1:], loop, s)
    inputs, names_in = [s.re, s.im, symbols, fixed], ["s_re", "s_im", "p", "fixed"]

    def function(name: str, values: list[Complex]) -> ca.Function:
        parts = [ca.vertcat(*(value.re for value in values)), ca.vertcat(*(value.im for value in values))]
        return ca.Function(name, inputs, parts, names_in, ["re", "im"])

    return General(
        function("response", closed.responses()),
        function("difference", [entry for row in closed.difference() for entry in row]),
    )


# --- Constraints of the programme with their derivatives: margins and tracked eigenpairs.
#
# Each maps the functions of :mod:`matching.match.programme` over its frequencies or goals.


@dataclass(frozen=True)
class CommonParts:
    """What constraints and objective share.

    Functions by name, the decision vector v (v, 1), how many of it move, and fixed numbers (c,).
    """

    functions: Mapping[str, ca.Function]
    v: ca.MX
    size: int
    fixed: np.ndarray

    def over(self, name: str, at: ca.MX, *more: ca.MX) -> list[ca.MX]:
        """Outputs of a function, each (a, f), at every column of ``at`` (n, f)."""
        f = at.shape[1]
        free, fixed = ca.repmat(self.v[: self.size], 1, f), ca.repmat(ca.MX(ca.DM(self.fixed)), 1, f)
        function = self.functions[name]
        outputs: Any = function.map(f)(at, free, fixed, *more)  # in CasADi's stubs a call gives one output
        return [outputs] if function.n_out() == 1 else list(outputs)

    def widened(self, part: ca.MX) -> ca.MX:
        """A Jacobian (r, m) of what moves with columns of zeros for the rest of v."""
        return ca.horzcat(part, ca.MX(part.shape[0], self.v.numel() - self.size))

    def embedded(self, part: ca.MX) -> ca.MX:
        """A Hessian (m, m) of what moves with zeros for the rest of v."""
        rest = self.v.numel() - self.size
        return ca.diagcat(part, ca.MX(rest, rest))


@dataclass(frozen=True)
class MarginConstraints:
    """The scaled stability margin at s and least distance (3, f)."""

    common: CommonParts
    at: ca.MX

    def value(self) -> ca.MX:
        """(f, 1)."""
        return self.common.over("margin", self.at)[0].T

    def jacobian(self) -> tuple[ca.MX, ca.MX]:
        """Value and Jacobian (f, v)."""
        value, each = self.common.over("margin_jacobian", self.at)
        return value.T, self.common.widened(each.T)

    def hessian(self, multipliers: ca.MX) -> ca.MX:
        """Hessian (v, v) of multipliersᵀ·value."""
        return summed(self.common, self.common.over("margin_hessian", self.at, multipliers.T)[0])


@dataclass(frozen=True)
class EigenpairConstraints:
    """Tracked eigenpairs of the loop, after what moves in v: rows that are zero, and squared distances from goals."""

    common: CommonParts
    goals: Sequence[Goal]

    def value(self) -> tuple[ca.MX, ca.MX]:
        """Rows ((2·u + 2)·goals, 1) and the sum of distances."""
        pairs = [self._evaluated(number, "pair")[0] for number in range(len(self.goals))]
        rows = ca.vertcat(ca.MX(0, 1), *(pair[:-1] for pair in pairs))
        return rows, sum((pair[-1] for pair in pairs), ca.MX(0.0))

    def jacobian(self) -> tuple[ca.MX, ca.MX, ca.MX, ca.MX]:
        """Rows, their Jacobian (r, v), the sum of distances, its gradient (v, 1)."""
        count = self.common.v.numel()
        rows, total, J, gradient = ca.MX(0, 1), ca.MX(0.0), ca.MX(0, count), ca.MX(count, 1)
        for number in range(len(self.goals)):
            value, flat = self._evaluated(number, "pair_jacobian")
            part = ca.reshape(flat, value.numel(), -1) @ self._selection(number)
            rows, J = ca.vertcat(rows, value[:-1]), ca.vertcat(J, part[:-1, :])
            total, gradient = total + value[-1], gradient + part[-1, :].T
        return rows, J, total, gradient

    def hessian(self, multipliers: ca.MX, factor: ca.MX) -> ca.MX:
        """Hessian (v, v) of multipliersᵀ·rows + factor·(sum of distances)."""
        count = self.common.v.numel()
        total = ca.MX(count, count)
        for number in range(len(self.goals)):
            rows = self._width(number)
            weight = ca.vertcat(multipliers[number * rows : (number + 1) * rows], factor)
            selection = self._selection(number)
            flat = self._evaluated(number, "pair_hessian", weight)[0]
            total += selection.T @ ca.reshape(flat, selection.shape[0], selection.shape[0]) @ selection
        return total

    def _width(self, number: int) -> int:
        return 2 + 2 * len(self.goals[number].pattern)

    def _entries(self, number: int) -> list[int]:
        width = self._width(number)
        first = self.common.size + number * width
        return [*range(self.common.size), *range(first, first + width)]

    def _selection(self, number: int) -> ca.DM:
        """Sparse selection from v of the released quantities and the goal's eigenpair."""
        entries = self._entries(number)
        return ca.DM(ca.Sparsity.triplet(len(entries), self.common.v.numel(), list(range(len(entries))), entries), 1)

    def _evaluated(self, number: int, name: str, *more: ca.MX) -> list[ca.MX]:
        part = self.common.v[self._entries(number)]
        function = self.common.functions[name]
        outputs: Any = function(ca.DM(self.goals[number].numbers), part, ca.DM(self.common.fixed), *more)
        return [outputs] if function.n_out() == 1 else list(outputs)


def summed(common: CommonParts, each: ca.MX) -> ca.MX:
    """Hessian by the released quantities, c of them, as the sum of its parts at every frequency (c·c, f)."""
    return common.embedded(ca.reshape(ca.sum2(each), common.size, common.size))


# --- The terms of the programme as expressions at one frequency or one eigenpair.

MEET = 1e-3  # of least²: how near both singular values have to be before they count as one
SQUARINGS = 4  # 2⁴ is the order of the norm that stands for the largest singular value of three and more


@dataclass(frozen=True)
class Term:
    """An expression with its symbols: what differs from place to place (n,), what moves (m,) and what is fixed (c,)."""

    at: ca.SX
    free: ca.SX
    fixed: ca.SX
    value: ca.SX

    @cached_property
    def plain(self) -> ca.Function:
        """(at, free, fixed) → value, as it stands."""
        return ca.Function("plain", [self.at, self.free, self.fixed], [self.value])

    @cached_property
    def text(self) -> str:
        """The same as text, equal for equal expressions."""
        return str(self.plain.serialize())


def response(loop: General, free: ca.SX, p: ca.SX, fixed: ca.SX) -> Term:
    """H (2·h,), real parts first, at s (2,)."""
    s = ca.SX.sym("s", 2)
    return Term(s, free, fixed, ca.vertcat(*_at(loop.response, s, p, fixed)))


def logarithm(loop: General, count: int, free: ca.SX, p: ca.SX, fixed: ca.SX) -> tuple[Term, Term]:
    """H/wanted (2·h,), real parts first, and its logarithm (2·h,) for ``count`` responses; at s and wanted (2 + 2·h,).

    ``p`` holds the values of what moves as expressions of ``free``, and of the bounds in ``fixed`` after the loop's.
    """
    s, wanted = ca.SX.sym("s", 2), [ca.SX.sym(f"wanted_{part}", count) for part in ("re", "im")]
    re, im = _at(loop.response, s, p, fixed)
    size = wanted[0] ** 2 + wanted[1] ** 2
    ratio_re, ratio_im = (re * wanted[0] + im * wanted[1]) / size, (im * wanted[0] - re * wanted[1]) / size
    log = ca.vertcat(ca.log(ratio_re**2 + ratio_im**2 + 1e-12) / 2, ca.atan2(ratio_im, ratio_re))
    at = ca.vertcat(s, *wanted)
    return Term(at, free, fixed, ca.vertcat(ratio_re, ratio_im)), Term(at, free, fixed, log)


def margin(loop: General, free: ca.SX, p: ca.SX, fixed: ca.SX) -> Term:
    """How much the smallest singular value of D = I + L exceeds ``least``, (σ² − least²)/(1 + σ²); at s, least (3,).

    Smooth where singular values meet: there it is less than it is, never more (see :func:`_two`, :func:`_several`).
    """
    at = ca.SX.sym("s", 3)
    re, im = _at(loop.difference, at, p, fixed)
    k, least = round(re.numel() ** 0.5), at[2]
    D = [[Complex(re[row * k + i], im[row * k + i]) for i in range(k)] for row in range(k)]
    smallest = re[0] ** 2 + im[0] ** 2 if k == 1 else _two(D, least) if k == 2 else _several(D)
    return Term(at, free, fixed, (smallest - least**2) / (1 + smallest))


def _two(D: list[list[Complex]], least: ca.SX) -> Any:
    """Smaller eigenvalue of DᴴD (2, 2), less by at most the order of :data:`MEET` where both meet."""
    gram = [sum(D[row][i].re ** 2 + D[row][i].im ** 2 for row in range(2)) for i in range(2)]
    a = sum(D[row][0].re * D[row][1].re + D[row][0].im * D[row][1].im for row in range(2))
    b = sum(D[row][0].re * D[row][1].im - D[row][0].im * D[row][1].re for row in range(2))
    apart = ca.sqrt(((gram[0] - gram[1]) / 2) ** 2 + a**2 + b**2 + (MEET * least**2) ** 2)
    return (gram[0] * gram[1] - a**2 - b**2) / ((gram[0] + gram[1]) / 2 + apart)


def _several(D: list[list[Complex]]) -> Any:
    """Smallest eigenvalue of DᴴD (k, k) as 1/‖(DᴴD)⁻¹‖ in the Schatten norm of order 16, any k.

    Less than it is by a factor k^(−1/16) where all are equal (8 % for k = 4, so 4 % of the margin), by nothing where
    one is by itself.
    """
    k = len(D)
    unit = [Complex(ca.densify(ca.SX.eye(k)[row, :])) for row in range(k)]
    inverse = solve([dict(enumerate(row)) for row in D], unit)
    re, im = ca.vertcat(*(row.re for row in inverse)), ca.vertcat(*(row.im for row in inverse))
    real = ca.vertcat(ca.horzcat(re, -im), ca.horzcat(im, re))  # every singular value twice
    M = real @ real.T
    size = ca.trace(M) / 2
    M = M / size
    for _ in range(SQUARINGS):
        M = M @ M
    return 1 / (size * (ca.trace(M) / 2) ** (0.5**SQUARINGS))


def eigenpair(loop: General, free: ca.SX, p: ca.SX, fixed: ca.SX) -> Term:
    """Rows (2·u + 2,) that are zero at an eigenpair of the loop, and last its squared distance from the goal.

    At :attr:`Goal.numbers`; what moves is ``free`` and after it the pair (2 + 2·u,): σ and ω over the goal's |s|, and
    the vector's real and imaginary parts, normalised by patternᵀx = 1.
    """
    k = round(loop.difference.numel_out(0) ** 0.5)
    pair, goal = ca.SX.sym("pair", 2 + 2 * k), ca.SX.sym("goal", 2 + k)
    x_re, x_im, pattern = pair[2 : 2 + k], pair[2 + k :], goal[2:]
    re, im = _at(loop.difference, pair[:2] * goal[0], p, fixed)
    D_re, D_im = ca.reshape(re, k, k).T, ca.reshape(im, k, k).T
    scale = 1 / (1 + ca.sqrt(ca.sumsqr(re) + ca.sumsqr(im)))
    natural = ca.sqrt(pair[0] ** 2 + pair[1] ** 2)
    rows: Any = ca.vertcat(
        (D_re @ x_re - D_im @ x_im) * scale,
        (D_re @ x_im + D_im @ x_re) * scale,
        pattern.T @ x_re - 1,
        pattern.T @ x_im,
        (natural - 1) ** 2 + (-pair[0] / natural - goal[1]) ** 2,
    )
    return Term(goal, ca.vertcat(free, pair), fixed, rows)


def _at(function: ca.Function, s: ca.SX, p: ca.SX, fixed: ca.SX) -> Any:
    """A function of the loop with its own of the fixed numbers, which come first."""
    return function(s[0], s[1], p, fixed[: function.numel_in(3)])


# --- The terms of the programme as functions with first and second derivatives, compiled where there is a compiler.
#
# CasADi's own Jacobian of a mapped function sweeps the whole map once a direction. Here the expression of a single
# frequency is differentiated, simplified and then mapped: the same numbers in a tenth of the time. No number of the
# case
# stands in the expressions, so what is compiled serves every case of the same structure: it is kept in the cache under
# what it is made from, and neither derived nor compiled again. Second derivatives are needed once a match and not
# compiled: the compiler would take longer than it saves.

OPTIMISATION = "-O1"  # beyond it the compiler takes longer than it saves
MOST_OPERATIONS = 10_000  # operations of a term beyond which the compiler would take minutes over its derivatives
FUNCTIONS_REMEMBERED = 64  # functions remembered in a process

Derivation = Callable[[str, Term], ca.Function]
_REMEMBERED: dict[tuple[str, bool], ca.Function] = {}


def value(name: str, term: Term) -> ca.Function:
    """(at, free, fixed) → value (a,)."""
    return _function(name, term, [], [term.value])


def jacobian(name: str, term: Term) -> ca.Function:
    """(at, free, fixed) → value (a,), derivative with respect to what moves (a, m) column by column."""
    return _function(name, term, [], [term.value, ca.vec(_jacobian(term.value, term.free))])


def weighted_gradient(name: str, term: Term) -> ca.Function:
    """(at, free, fixed, weight) → derivative (m,) of weightᵀ·value."""
    weight = ca.SX.sym("weight", term.value.numel())
    return _function(name, term, [weight], [ca.gradient(ca.dot(weight, term.value), term.free)])


def weighted_hessian(name: str, term: Term) -> ca.Function:
    """(at, free, fixed, weight) → second derivative (m·m,) of weightᵀ·value."""
    weight = ca.SX.sym("weight", term.value.numel())
    return _function(name, term, [weight], [ca.vec(ca.hessian(ca.dot(weight, term.value), term.free)[0])])


def together(terms: dict[str, tuple[Derivation, Term]], compiled: bool) -> dict[str, ca.Function]:
    """Functions by name, each a derivation of a term; compiled side by side where that is wanted and possible."""
    compiled = compiled and compiler() is not None
    keys = {name: (_key(name, derive, term), compiled) for name, (derive, term) in terms.items()}
    missing = [name for name, key in keys.items() if key not in _REMEMBERED]
    one_by_one = Lock()  # CasADi's expressions are not thread-safe

    def built(name: str) -> Path | None:
        derive, term = terms[name]
        if term.plain.n_instructions() > MOST_OPERATIONS:
            return None

        def source() -> str:
            with one_by_one:
                return generated(derive(name, term))

        return shared(keys[name][0], source, OPTIMISATION)

    libraries: list[Path | None] = [None] * len(missing)
    if compiled and missing:
        with ThreadPoolExecutor(max(1, min(len(missing), os.cpu_count() or 1))) as pool:
            libraries = list(pool.map(built, missing))
    functions = {name: _REMEMBERED[key] for name, key in keys.items() if name not in missing}
    for name, library in zip(missing, libraries, strict=True):
        derive, term = terms[name]
        functions[name] = _REMEMBERED[keys[name]] = loaded(name, library) or derive(name, term)
    while len(_REMEMBERED) > FUNCTIONS_REMEMBERED:
        _REMEMBERED.pop(next(iter(_REMEMBERED)))
    return functions


def _key(name: str, derive: Derivation, term: Term) -> str:
    """All that a function is made from."""
    return "\0".join((name, derive.__name__, term.text, ca.CasadiMeta.version(), _source_text()))


@functools.cache
def _source_text() -> str:
    return Path(__file__).read_text(encoding="utf-8")


def _function(name: str, term: Term, more: list[ca.SX], outputs: list[ca.SX]) -> ca.Function:
    dense: Any = [ca.densify(output) for output in outputs]
    return ca.Function(name, [term.at, term.free, term.fixed, *more], ca.cse(dense))


def _jacobian(value: ca.SX, free: ca.SX) -> ca.SX:
    if value.numel() < free.numel():
        return ca.vertcat(*(ca.gradient(value[i], free).T for i in range(value.numel())))
    return ca.jtimes(value, free, ca.SX.eye(free.numel()))


# --- How IPOPT is set for searching, for finishing and for a last step with exact second derivatives.

_QUIET = {"print_level": 0, "sb": "yes", "tol": 1e-6}
_TIGHT = {  # stays where it begins
    "acceptable_tol": 1e-4,
    "mu_strategy": "monotone",
    "mu_init": 1e-4,
    "bound_push": 1e-4,
    "bound_frac": 1e-4,
}
_LOOSE = {  # ends where the objective has stood still for three iterations and the constraints are kept
    "mu_strategy": "adaptive",
    "acceptable_tol": 1.0,
    "acceptable_iter": 3,
    "acceptable_obj_change_tol": 1e-4,
    "acceptable_constr_viol_tol": 1e-5,
    "acceptable_dual_inf_tol": 10.0,
    "acceptable_compl_inf_tol": 1e-2,
}
_FAST = {
    "hessian_approximation": "limited-memory",
    "limited_memory_max_history": 12,
    "limited_memory_aug_solver": "extended",
    "min_refinement_steps": 0,
    "fast_step_computation": "yes",
    "max_iter": 250,
}
_EXACT = {"mu_init": 1e-6, "bound_push": 1e-8, "bound_frac": 1e-8, "warm_start_init_point": "yes", "max_iter": 40}


def ipopt_options(tight: bool, exact: bool) -> dict[str, Any]:
    """Options of IPOPT: ``tight`` stays where it begins, ``exact`` is given second derivatives."""
    return _QUIET | (_TIGHT if tight else _LOOSE) | (_EXACT if exact else _FAST)


def solved(solver: ca.Function, **start_and_bounds: Any) -> dict[str, ca.DM]:
    """What a solver finds."""
    solution: dict[str, ca.DM] = solver(**start_and_bounds)
    if solver.stats()["return_status"] == "User_Requested_Stop":
        raise KeyboardInterrupt
    return solution


# --- Where in s the modulus margin and the least damping are held.

MARGIN_RESERVE = 1.04  # on the required modulus margin: the programme takes the loop as continuous
GRID_HZ = np.concatenate(
    [
        np.geomspace(0.02, 5, 18, endpoint=False),
        np.geomspace(5, 150, 64, endpoint=False),
        np.geomspace(150, 500, 12),
    ]
)  # where the modulus margin is held from the start
SLOTS = 30  # frequencies beside that grid, where a solution turns out to miss the margin
UNUSED_HZ = 600.0  # of a slot that is not needed: there the loop has no gain left
SURVEY_HZ = np.geomspace(0.02, 500, 1200)  # where a missed margin is looked for
RAY_HZ = np.geomspace(0.3, 150, 30)  # |s|/2π on the ray of least damping


def margin_points(case: Case, extra: ca.MX) -> ca.MX:
    """Where the margin is held and how far, (3, f): on the grid, at ``extra`` frequencies in Hz, and on the ray."""
    near = np.array([mode.frequency for mode in modes(case.rig) if 0 < mode.frequency < 400])
    omega = 2 * np.pi * np.concatenate([GRID_HZ, *(near * part for part in (0.96, 1.0, 1.04))])
    least, zeta, ray = case.limits["modulus_margin"] * MARGIN_RESERVE, case.limits["damping_ratio"], 2 * np.pi * RAY_HZ
    on_grid = np.vstack([0 * omega, omega, np.full(len(omega), least)])
    on_ray = np.vstack([-zeta * ray, ray * np.sqrt(1 - zeta**2), np.full(len(ray), least / 2)])
    slots = extra.numel()
    added = ca.vertcat(ca.MX(1, slots), 2 * np.pi * extra.T, ca.MX(ca.DM.ones(1, slots) * least))
    return ca.horzcat(ca.MX(ca.DM(on_grid)), ca.densify(added), ca.MX(ca.DM(on_ray)))


def survey_points(case: Case) -> np.ndarray:
    """The dense grid on which a missed margin is looked for: s and least distance (3, f)."""
    least = np.full(len(SURVEY_HZ), case.limits["modulus_margin"] * MARGIN_RESERVE)
    return np.vstack([0 * SURVEY_HZ, 2 * np.pi * SURVEY_HZ, least])


# --- What an objective of the match has to answer: one file each, registered in the package.

Terms = dict[str, tuple[Derivation, Term]]


class ObjectiveBlock(ABC):
    """The objective as expressions of the decision vector (v,)."""

    @abstractmethod
    def value(self) -> ca.MX:
        """Scalar."""

    @abstractmethod
    def gradient(self) -> tuple[ca.MX, ca.MX]:
        """Value and gradient (v, 1)."""

    @abstractmethod
    def hessian(self) -> ca.MX:
        """Hessian (v, v)."""


class Objective(ABC):
    """What the feedback of a case is tuned by, prepared for that case.

    Attributes
    ----------
    name : str
        As case files write it under ``response.objective``.
    tracks_modes : bool
        Whether the target modes are tracked as eigenpairs beside it.
    """

    name: ClassVar[str]
    tracks_modes: ClassVar[bool]

    @classmethod
    @abstractmethod
    def of(cls, case: Case) -> Objective:
        """Prepared for a case."""

    @staticmethod
    def terms(loop: General, free: ca.SX, p: ca.SX, fixed: ca.SX) -> tuple[Terms, Terms]:
        """Functions of the case's own loop that the block takes: always, and for second derivatives."""
        return {}, {}

    @abstractmethod
    def block(self, common: CommonParts, moves: Sequence[Move], compiled: bool) -> ObjectiveBlock:
        """The objective in a programme."""


# --- Numbers that the compiled functions take.


def scale_of(move: Move) -> tuple[float, float]:
    """Lower bound and range, the range of the logarithm where that is scaled."""
    return move.lower, float(np.log(move.upper / move.lower)) if is_logarithmic(move) else move.upper - move.lower


def fixed_numbers(loop: ClosedLoopFunctions, moves: Sequence[Move]) -> np.ndarray:
    """Numbers (c,) that the compiled functions take: the loop's, then those that scale each move."""
    scales = [scale_of(move) for move in moves]
    return np.concatenate([loop.fixed, *scales]) if scales else loop.fixed


class ScaledSymbols(NamedTuple):
    """Released quantities (scaled), numbers of :func:`fixed_numbers`, and p as expressions of both."""

    free: ca.SX
    fixed: ca.SX
    p: ca.SX


def symbols(known: int, logarithmic: tuple[bool, ...]) -> ScaledSymbols:
    """Symbols of a programme; ``known`` of the fixed numbers are the loop's."""
    count = len(logarithmic)
    free, fixed = ca.SX.sym("free", count), ca.SX.sym("fixed", known + 2 * count)
    p = ca.SX(count, 1)
    for i, log in enumerate(logarithmic):
        low, span = fixed[known + 2 * i], fixed[known + 2 * i + 1]
        p[i] = low * ca.exp(span * free[i]) if log else low + span * free[i]
    return ScaledSymbols(free, fixed, p)


# --- The nonlinear programme of a match: decision vector, solver, bounds.

MARGIN_MISSED = 1e-5  # of a scaled margin: what is no longer taken for kept
LEAST_OSCILLATION = 0.05  # imaginary part over a target's |s|, at least, where a root may not become real


@dataclass(frozen=True)
class Problem:
    """The programme: decision vector v = [moves scaled to 0 … 1, (σ, ω, Re x, Im x) of every goal scaled].

    Solver and objective take beside it the frequencies (slots,) in Hz at which the margin is to hold beside the grid;
    :data:`.UNUSED_HZ` where there are fewer.

    Attributes
    ----------
    moves : tuple of Move
        Those that are released.
    solver : Function
        IPOPT.
    lower, upper, g_lower, g_upper : ndarray
    """

    case: Case
    loop: ClosedLoopFunctions
    moves: tuple[Move, ...]
    goals: tuple[Goal, ...]
    tight: bool
    solver: ca.Function
    objective: ca.Function
    survey: ca.Function
    lower: np.ndarray
    upper: np.ndarray
    g_lower: np.ndarray
    g_upper: np.ndarray

    @property
    def slots(self) -> int:
        """How many frequencies can be added to the grid."""
        return int(self.objective.numel_in(1))

    def extra(self, frequencies: Sequence[float] | np.ndarray = ()) -> np.ndarray:
        """Frequencies (slots,) as solver and objective take them, the last ones where there are too many."""
        kept = np.asarray(frequencies, float)[-self.slots :] if self.slots else np.zeros(0)
        return np.concatenate([kept, np.full(self.slots - len(kept), UNUSED_HZ)])

    def oscillating(self) -> Problem:
        """The same where no tracked root may become real.

        With a random start a root that may become real rarely leads to a good optimum; a start by continuation from
        another solution needs that freedom.
        """
        lower = self.lower.copy()
        eigenpairs(lower, len(self.moves), self.case)[:, 1] = LEAST_OSCILLATION
        return replace(self, lower=lower)

    def missed(self, v: np.ndarray) -> np.ndarray:
        """Frequencies (Hz, on a dense grid) of the margin's local minima that lie below the wanted margin."""
        least = self.survey(v).full().ravel()
        padded = np.concatenate([[np.inf], least, [np.inf]])
        return SURVEY_HZ[(least < -MARGIN_MISSED) & (least <= padded[:-2]) & (least <= padded[2:])]

    def violation(self, g: np.ndarray) -> float:
        """Largest violation of a scaled constraint by rows g (g,) of the objective; 0 where all are kept."""
        return float(np.maximum(self.g_lower - g, g - self.g_upper).max(initial=0.0))

    def values(self, v: np.ndarray) -> dict[str, float]:
        """Values in SI of the moved quantities and their mirror images."""
        values = {}
        for part, move in zip(v, self.moves, strict=False):
            for name in move.together:
                values[name] = float(unscaled(part, move))
        return values

    def vector(self, values: dict[str, float]) -> np.ndarray:
        """p (p,) of the loop with some values changed."""
        p = self.loop.values.copy()
        for name, value in values.items():
            p[self.loop.parameters.index(name)] = value
        return p


def eigenpairs(v: np.ndarray, size: int, case: Case) -> np.ndarray:
    """The goals' σ, ω, Re x and Im x, scaled (goals, 2 + 2·u), in a decision vector (v,) of ``size`` moves: a view."""
    return v[size:].reshape(-1, 2 + 2 * len(case.loop.dynamometers))


# --- The match as one nonlinear programme in CasADi, with exact derivatives, for IPOPT.
#
# Minimise   error = objective + EIGENVALUE_WEIGHT · Σ[(Δf/f)² + Δζ²]
# over the scaled quantities that move and, for every target, an explicit eigenpair (s, x) of the closed loop,
# subject to  (I + L(s))·x = 0, x normalised to the target's pattern over the dynamometers      (tracked eigenvalues)
#             σ_min(I + L(jω)) ≥ modulus margin on a grid
#             the same, halved, on the ray of the smallest damping ratio: no root may cross it   (damping and stability)
#             torque and power the vehicle's own manoeuvre asks of adapters and dynamometers within limits.
# Of answers that are as good, the one that changes least: with ``error_limit`` the programme minimises
# change = Σ weight·(change/range)² subject to error ≤ error_limit and to all of the above.
# The objective is one of :mod:`matching.match.objectives`; one that tracks no modes leaves out the second
# term. Everything is exact in s, dead time included (:mod:`matching.match.programme`). A margin alone
# is no
# stability; the starts are stable and what comes out is verified by :mod:`matching.match.verify`.

EIGENVALUE_WEIGHT = 0.3  # on a relative frequency error or a damping-ratio error of 1, against a response error of 1
# Bounds of an eigenpair: σ and ω over the goal's |s| (real part far left to slightly unstable), entries of its vector.
REAL_PART, IMAGINARY_PART, VECTOR_ENTRY = (-8.0, 0.5), (0.0, 12.0), (-5.0, 5.0)


@dataclass(frozen=True)
class _Parts:
    """What the programme is put together from: decision vector, added frequencies, objective, constraints, change.

    ``error_limit`` is None where the error is minimised, else the change is.
    """

    v: ca.MX
    extra: ca.MX
    objective: ObjectiveBlock
    margins: MarginConstraints
    pairs: EigenpairConstraints
    demands: ca.MX
    change: ca.MX
    error_limit: float | None


# more than six parameters: the programme is all of this, and a TuningTask (search) holds it for who searches
def build(
    case: Case, moves: tuple[Move, ...], weights: np.ndarray, goals: tuple[Goal, ...], objective: Objective,
    demands: Demands, *, tight: bool = False, exact: bool = False, slots: int = 0, compiled: bool = True,
    error_limit: float | None = None,
) -> Problem:  # fmt: skip
    """Build the programme.

    Parameters
    ----------
    case : Case
    moves : tuple of Move
        What is released.
    weights : ndarray (moves,)
        Weight on the change of each.
    goals : tuple of Goal
        None where the objective tracks no modes.
    objective : Objective
    demands : Demands
        What the vehicle's manoeuvre asks of adapters and dynamometers.
    tight : bool
        Solve to six digits of the optimality conditions, beginning near a solution; without it the objective is good
        to about three, which is enough to compare starts.
    exact : bool
        Exact Hessian; without it IPOPT builds its own from the exact gradients, which is faster away from the end.
    slots : int
        Frequencies at which the margin may be asked for beside the grid.
    compiled : bool
        Compile where there is a compiler; CasADi does not differentiate what is compiled any further.
    error_limit : float, optional
        Minimise the change from what was planned, with the error at most this, instead of the error.
    """
    loop = closed_loop(case, [move.together for move in moves])
    size, count = len(moves), len(moves) + sum(2 + 2 * len(goal.pattern) for goal in goals)
    v, extra = ca.MX.sym("v", count), ca.MX.sym("extra", slots)
    logarithmic = tuple(is_logarithmic(move) for move in moves)
    functions = _functions(loop.general, logarithmic, len(loop.fixed), bool(goals), type(objective), exact, compiled)
    common = CommonParts(functions, v, size, fixed_numbers(loop, moves))
    limits = demands.constraints(_rig_values(case, moves, v))
    planned = ca.DM([scaled(move.planned, move) for move in moves])
    parts = _Parts(
        v, extra, objective.block(common, moves, compiled),
        MarginConstraints(common, margin_points(case, extra)), EigenpairConstraints(common, goals),
        ca.vertcat(*(rows for rows, _ in limits)) if limits else ca.MX(0, 1),
        ca.dot(ca.DM(weights), (v[:size] - planned) ** 2), error_limit,
    )  # fmt: skip
    solver, both = _solver(parts, tight, exact)
    survey = ca.Function("survey", [v], common.over("margin", ca.MX(ca.DM(survey_points(case)))))
    margins, rows = parts.margins.value().numel(), parts.pairs.value()[0].numel()
    pairs = np.array([pair for goal in goals for pair in _pair_bounds(len(goal.pattern))]).reshape(-1, 2)
    zeros, within = np.zeros(rows), np.zeros(0 if error_limit is None else 1)
    return Problem(
        case, loop, moves, goals, tight, solver, both, survey,
        lower=np.concatenate([np.zeros(size), pairs[:, 0]]),
        upper=np.concatenate([np.ones(size), pairs[:, 1]]),
        g_lower=np.concatenate([np.zeros(margins), zeros, np.full(parts.demands.numel(), -np.inf), within - np.inf]),
        g_upper=np.concatenate(
            [np.full(margins, np.inf), zeros, *(np.full(r.numel(), upper) for r, upper in limits), within + 1.0]
        ),
    )  # fmt: skip


def _pair_bounds(dynamometers: int) -> list[tuple[float, float]]:
    return [REAL_PART, IMAGINARY_PART, *[VECTOR_ENTRY] * (2 * dynamometers)]


def _rig_values(case: Case, moves: tuple[Move, ...], v: ca.MX) -> dict[str, Any]:
    """Values of the rig's quantities by ``rig.…``, SI, those that move as expressions of v."""
    values: dict[str, Any] = {f"rig.{name}": quantity.value for name, quantity in case.rig.parameters.items()}
    for i, move in enumerate(moves):
        if move.name in values:
            values |= dict.fromkeys(move.together, unscaled(v[i], move))
    return values


def _solver(parts: _Parts, tight: bool, exact: bool) -> tuple[ca.Function, ca.Function]:
    """IPOPT with its derivatives, and objective and constraints (v, extra) → (f, g)."""
    v, extra, demands, limit = parts.v, parts.extra, parts.demands, parts.error_limit
    rows, distance = parts.pairs.value()
    margins = parts.margins.value()
    f = parts.objective.value() + EIGENVALUE_WEIGHT * distance
    g = ca.vertcat(margins, rows, demands)
    margins_again, margins_jacobian = parts.margins.jacobian()
    rows_again, rows_jacobian, _, distance_gradient = parts.pairs.jacobian()
    objective_again, objective_gradient = parts.objective.gradient()
    f_again = objective_again + EIGENVALUE_WEIGHT * distance
    gradient = objective_gradient + EIGENVALUE_WEIGHT * distance_gradient
    jacobian_g = ca.vertcat(margins_jacobian, rows_jacobian, ca.jacobian(demands, v))
    g_again = ca.vertcat(margins_again, rows_again, demands)
    if limit is not None:
        g, g_again = ca.vertcat(g, f / limit), ca.vertcat(g_again, f_again / limit)
        jacobian_g = ca.vertcat(jacobian_g, gradient.T / limit)
        f = f_again = parts.change
        gradient = ca.gradient(parts.change, v)
    options: Any = {
        "print_time": False, "error_on_fail": False, "no_nlp_grad": True, "calc_lam_p": False,
        "ipopt": ipopt_options(tight, exact),
        "grad_f": ca.Function("nlp_grad_f", [v, extra], [f_again, gradient], ["x", "p"], ["f", "grad_f_x"]),
        "jac_g": ca.Function("nlp_jac_g", [v, extra], [g_again, jacobian_g], ["x", "p"], ["g", "jac_g_x"]),
    }  # fmt: skip
    if exact:
        options["hess_lag"] = _hessian(parts, margins.numel(), rows.numel())
    programme: Any = {"x": v, "p": extra, "f": f, "g": g}  # CasADi's stubs know no dict of MX
    solver = ca.nlpsol("match", "ipopt", programme, options)
    return solver, ca.Function("objective", [v, extra], [f, g], ["v", "extra"], ["f", "g"])


def _hessian(parts: _Parts, margins: int, rows: int) -> ca.Function:
    """Upper triangle of the Lagrangian's Hessian."""
    v, demands = parts.v, parts.demands
    before_limit, limit = margins + rows + demands.numel(), parts.error_limit
    lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", before_limit + (limit is not None))
    of_margins, of_rows, of_demands = ca.vertsplit(lam_g[:before_limit], [0, margins, margins + rows, before_limit])
    of_error = lam_f if limit is None else lam_g[before_limit] / limit
    hessian = of_error * parts.objective.hessian() + parts.margins.hessian(of_margins)
    hessian += parts.pairs.hessian(of_rows, EIGENVALUE_WEIGHT * of_error)
    hessian += ca.hessian(ca.dot(of_demands, demands), v)[0]
    if limit is not None:
        hessian += lam_f * ca.hessian(parts.change, v)[0]
    return ca.Function(
        "nlp_hess_l", [v, parts.extra, lam_f, lam_g], [ca.triu(hessian)],
        ["x", "p", "lam_f", "lam_g"], ["triu_hess_gamma_x_x"],
    )  # fmt: skip


# more than six parameters: they are what the functions depend on, and the key they are remembered by
@lru_cache(maxsize=16)
def _functions(
    loop: General, logarithmic: tuple[bool, ...], known: int, tracked: bool, objective: type[Objective],
    exact: bool, compiled: bool,
) -> dict[str, ca.Function]:  # fmt: skip
    """The terms and their derivatives; no number of the case stands in them."""
    free, fixed, p = symbols(known, logarithmic)
    of_margin = margin(loop, free, p, fixed)
    first: Terms = {"margin": (value, of_margin), "margin_jacobian": (jacobian, of_margin)}
    second: Terms = {"margin_hessian": (weighted_hessian, of_margin)}
    for terms, more in zip((first, second), objective.terms(loop, free, p, fixed), strict=True):
        terms.update(more)
    if tracked:
        pair = eigenpair(loop, free, p, fixed)
        first |= {"pair": (value, pair), "pair_jacobian": (jacobian, pair)}
        second |= {"pair_hessian": (weighted_hessian, pair)}
    return together(first, compiled) | (together(second, False) if exact else {})
