"""The feedback loop in the frequency domain as one CasADi function of (s, p): exact, dead time included.

Rig and residual vehicle are solved as dynamic stiffnesses, (s²·M + s·C + K)·q = torques, the loop is closed round
them, and the functions give the compared transfer functions, to sensors of the rig or of the residual vehicle, and the
return difference I + L at the dynamometers' commands. Derivatives are CasADi's, exact.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, cached_property, lru_cache
from typing import Any

import casadi as ca
import numpy as np

from matching.frequency.case.case import Case, Compared
from matching.frequency.programme.dead_time import actuator
from modelling.bed.loop import ControlStructure, Dynamometer
from modelling.bed.residual_vehicle import Interface
from modelling.common.errors import unknown
from modelling.equations.compiled import Model, compiled
from modelling.equations.complex_sx import Complex, Row, joined, solve
from modelling.model.components import Gear, Shaft
from modelling.model.system import System


@dataclass(frozen=True, eq=False)
class General:
    """Compared responses and return difference of (s_re, s_im, p, fixed): one object for all cases of one structure."""

    response: ca.Function
    difference: ca.Function


@dataclass(frozen=True)
class ClosedLoop:
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


@dataclass(frozen=True)
class _Structure:
    """What the expressions are made from; ``known`` are the values that are 0 or 1, None for the others."""

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
        own = enumerate(zip(self.names, self.known, strict=True))
        return [i for i, (name, value) in own if name not in moved and value is None]

    def cut(self, dyno: Dynamometer) -> Interface:
        """The interface that a dynamometer follows."""
        return next(own for own in self.interfaces if own.shaft == dyno.follows)


def closed_loop(case: Case, moving: Sequence[tuple[str, ...]] | None = None) -> ClosedLoop:
    """Build the loop of a case; The model-based feed-forward is left out: this is what feedback alone does.

    Parameters
    ----------
    case : Case
    moving : sequence of tuple of str, optional
        Groups of names that share one entry of p (a quantity and its mirror image); every name by itself unless given.
        The rest do not move, which makes derivatives cheaper.

    Raises
    ------
    InputError
        If a name is unknown.
    """
    systems = {"rig": [case.rig], "residual_vehicle": case.residual_vehicle.parts}
    values: list[tuple[str, float]] = []
    for prefix, own in systems.items():
        models = [compiled(system) for system in own]
        values += [
            (f"{prefix}.{name}", value) for one in models for name, value in zip(one.parameters, one.p0, strict=True)
        ]
    values += [(f"loop.{name}", value) for name, value in case.loop.values.items()]
    names = tuple(name for name, _ in values)
    groups = [(name,) for name in names] if moving is None else list(moving)
    for name in (name for group in groups for name in group):
        if name not in names:
            raise unknown(name, list(names), "")
    structure = _Structure(
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
    given = np.array([values[i][1] for i in structure.still])
    return ClosedLoop(tuple(group[0] for group in groups), kept, given, _expressions(structure))


@lru_cache(maxsize=16)
def _expressions(own: _Structure) -> General:
    rig, parts, still = compiled(own.rig), [compiled(part) for part in own.parts], own.still
    symbols, fixed = ca.SX.sym("p", len(own.moving)), ca.SX.sym("fixed", len(still))
    p = ca.SX([0.0 if value is None else value for value in own.known])
    for i, entry in enumerate(still):
        p[entry] = fixed[i]
    for i, group in enumerate(own.moving):
        for name in group:
            p[own.names.index(name)] = symbols[i]
    s = Complex(ca.SX.sym("s_re"), ca.SX.sym("s_im"))
    loop = {name.removeprefix("loop."): p[i] for i, name in enumerate(own.names) if name.startswith("loop.")}
    starts = np.cumsum([0, len(rig.parameters), *(len(part.parameters) for part in parts)])
    bodies = [
        _Body(model, p[int(a) : int(b)], s) for model, a, b in zip([rig, *parts], starts[:-1], starts[1:], strict=True)
    ]
    H, difference = _close(own, bodies[0], bodies[1:], loop, s)
    inputs, names_in = [s.re, s.im, symbols, fixed], ["s_re", "s_im", "p", "fixed"]

    def function(name: str, values: list[Complex]) -> ca.Function:
        parts = [ca.vertcat(*(value.re for value in values)), ca.vertcat(*(value.im for value in values))]
        return ca.Function(name, inputs, parts, names_in, ["re", "im"])

    return General(function("response", H), function("difference", [entry for row in difference for entry in row]))


class _Body:
    """A linear system at a complex frequency: responses of its sensors to unit inputs."""

    def __init__(self, model: Model, p: ca.SX, s: Complex):
        self.inputs, self.sensors = model.inputs, model.sensors
        n, extra = model.n, len(model.states) - 2 * model.n
        x, u = ca.SX.sym("x", 2 * n + extra), ca.SX.sym("u", len(model.inputs))
        rest = [ca.DM.zeros(2 * n + extra), ca.DM.zeros(len(model.inputs))]

        def at_rest(expressions: list[ca.SX]) -> list[ca.SX]:
            return ca.substitute(expressions, [x, u], rest)

        force, mass = model.force(x, u, p), model.mass(p)
        rates, readings = model.rates(x, u, p), model.readings(x, u, p, 0)
        fx, fu, zx, zu, yx, yu = at_rest(
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
        self._found: dict[str, Complex] = {}

    def response(self, sensor: str, source: str) -> Complex:
        """Transfer function from an input to a sensor."""
        return self.responses(sensor)[self.inputs.index(source)]

    def responses(self, sensor: str) -> Complex:
        """Transfer functions from all inputs to a sensor, a row."""
        if sensor not in self._found:
            self._found[sensor] = self._responses(self.sensors.index(sensor))
        return self._found[sensor]

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
    if not any(_given(c) for c in coefficients):
        return
    total = Complex(0.0)
    for c in reversed(coefficients):
        total = total * s + Complex(c)
    row[column] = total


def _given(value: ca.SX) -> bool:
    return value.nnz() > 0 and not value.is_zero()


def _close(
    own: _Structure, rig: _Body, parts: list[_Body], loop: dict[str, ca.SX], s: Complex
) -> tuple[list[Complex], list[list[Complex]]]:
    dynos = own.dynamometers
    lag = 1 / (1 + s * loop["torque_sensor_lag"])
    act = actuator(loop, s)

    def commands(torques: list[Complex], speeds: list[Complex], roads: list[Complex]) -> list[Complex]:
        """Air-gap torques for flange torques, rotor speeds and what the roads do to the reference speeds."""
        measured = [torque * lag for torque in torques]
        wanted = [
            sum((_residual(own, parts, dyno, other) * measured[k] for k, other in enumerate(dynos)), roads[j])
            for j, dyno in enumerate(dynos)
        ]
        return [act * command for command in own.control.commands(loop, s, wanted, speeds, measured)]

    toward = [sensor_sign(own.rig, dyno) for dyno in dynos]
    size = len(dynos)
    torques = [rig.responses(dyno.torque_sensor) * toward[k] for k, dyno in enumerate(dynos)]
    still = [Complex(0.0)] * size
    answers = commands(torques, [rig.responses(dyno.speed_sensor) for dyno in dynos], still)
    drives = [rig.inputs.index(dyno.torque_input) for dyno in dynos]
    difference = [[(1 if j == c else 0) - answers[j][drives[c]] for c in range(size)] for j in range(size)]

    def commanded(j: int, source: str) -> Complex:
        if source in rig.inputs:
            return answers[j][rig.inputs.index(source)]
        return commands(still, still, [_road(own, parts, dyno, source) for dyno in dynos])[j]

    sources = list(dict.fromkeys(pair.input for pair in own.compared))
    right = [joined([commanded(j, source) for source in sources]) for j in range(size)]
    torque = solve([dict(enumerate(row)) for row in difference], right)

    @cache
    def on_rig(sensor: str) -> Complex:
        """To all sources, a row."""
        direct = [rig.response(sensor, source) if source in rig.inputs else Complex(0.0) for source in sources]
        return sum((rig.response(sensor, d.torque_input) * torque[j] for j, d in enumerate(dynos)), joined(direct))

    def emulated(sensor: str, source: str) -> Complex:
        part = next(part for part in parts if sensor in part.sensors)
        total = part.response(sensor, source) if source in part.inputs else Complex(0.0)
        for k, dyno in enumerate(dynos):
            if (driven := own.cut(dyno).torque) in part.inputs:
                felt = on_rig(dyno.torque_sensor)[sources.index(source)] * lag * toward[k]
                total = total + part.response(sensor, driven) * felt
        return total

    H = [
        on_rig(pair.sensor)[sources.index(pair.input)]
        if pair.sensor in rig.sensors
        else emulated(pair.sensor, pair.input)
        for pair in own.compared
    ]
    return H, difference


def _residual(own: _Structure, parts: list[_Body], of: Dynamometer, by: Dynamometer) -> Complex:
    """Reference speed of one dynamometer for a torque at another one's interface."""
    wanted, driven = own.cut(of), own.cut(by)
    for part in parts:
        if wanted.speed in part.sensors and driven.torque in part.inputs:
            return part.response(wanted.speed, driven.torque)
    return Complex(0.0)


def _road(own: _Structure, parts: list[_Body], of: Dynamometer, source: str) -> Complex:
    wanted = own.cut(of)
    for part in parts:
        if wanted.speed in part.sensors and source in part.inputs:
            return part.response(wanted.speed, source)
    return Complex(0.0)


def sensor_sign(rig: System, dyno: Dynamometer) -> float:
    """Torque that drives the rotor for a reading of 1 N·m: +1 for a rotor at the flange's second end, else −1/ratio."""
    sensor = next(own for own in rig.sensors if own.name == dyno.torque_sensor)
    flange: Shaft = next(own for own in rig.shafts if own.name == sensor.of)
    rotor = next(own.on for own in rig.inputs if own.name == dyno.torque_input)
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
