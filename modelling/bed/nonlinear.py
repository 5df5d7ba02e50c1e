"""Nonlinear rigs with their lags and dead time, or vehicles, stepped side by side from sample to sample."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from modelling.bed.bed import Dynamometer, Loop
from modelling.equations.casadi_code import Model, compiled
from modelling.equations.lagrange import STICK_SPEED
from modelling.equations.shaft_law import CONTACT_TIME
from modelling.linear.elements import elements
from modelling.linear.steady_motion import operating_motion
from modelling.simulation.compiled import external
from modelling.simulation.stepping import STABLE_STEP, rates_at_rest, steps_per_second
from modelling.system import System

# --- A true delay line: commands issued at every sample, held, acting a dead time later.


def arrivals(delay: float, step: float, pieces: int) -> np.ndarray:
    """Which commands act when: weights (m, i) of the command issued i samples ago in the m-th piece of a sample.

    A sample of length ``step`` (s) is cut into equal ``pieces``; where a new command arrives inside a piece, both
    count by their share of it, so any ``delay`` (s) is met.
    """
    edges = (np.arange(pieces + 1) / pieces) - delay / step
    weights = np.zeros((pieces, int(np.ceil(delay / step - 1e-12)) + 1))
    for i in range(weights.shape[1]):
        # the command of i samples ago is held over [−i, 1 − i) of its own time
        inside = np.clip(edges, -i, 1 - i)
        weights[:, i] = np.diff(inside) * pieces
    return weights


# --- Many nonlinear systems of one structure, stepped side by side from sample to sample; b beds.

FINE_STEP_S = 1.25e-4  # longest
PROBED_STICK_SPEED = 1e-4  # rad/s, where dry friction is steeper than anything else: its steepness is read off there
FEW_SWEEPS = 10  # over clutches that slip against each other, in one of its short steps
FLAT = 1e12  # rad/s, a stick speed at which friction is too flat to matter


@dataclass(frozen=True)
class BedHardware:
    """What of a bed is no part of the rig's model: lags and delay (s), torque over command of each dynamometer (k,)."""

    inverter_lags: tuple[float, ...]
    torque_sensor_lags: tuple[float, ...]
    delays: tuple[float, ...]
    torque_gains: tuple[float, ...]


class NonlinearBeds:
    """Rigs with lags, or vehicles where there are no dynamometers.

    States [model, air-gap torques as commanded (k), lagged flange torques (k), commands on their way (i·k), newest
    first]; the first three absolute. Commands and torques count from the operating point.

    Parameters
    ----------
    systems : sequence of System (b)
        Of one structure.
    loop : Loop
    dynamometers : sequence of Dynamometer (k)
    hardware : sequence of BedHardware (b)
        None of vehicles.
    steps : float
        1/s, at least: what depends on the motion, as of clutches that slip.
    sticking : sequence of str
        Gearboxes whose clutches stick without giving way, as a controller steps them: see
        :mod:`modelling.bed.clutches`. They need no further steps.

    Attributes
    ----------
    drives, commanded : list of str (d), tuple of str (k)
        Inputs that act from outside, and those of the dynamometers.
    steady, trim, drive_trim : ndarray (y, b), (k, b), (d, b)
        Readings, commands and torques from outside at the operating point, absolute.
    start : ndarray (x, b)
        States there.
    step : float
        s, of a sample.
    """

    def __init__(
        self, systems: Sequence[System], loop: Loop, dynamometers: Sequence[Dynamometer] = (),
        hardware: Sequence[BedHardware] = (), steps: float = 0.0, sticking: Sequence[str] = (),
    ):  # fmt: skip
        self.model, step, k = compiled(systems[0]), loop["sample_time"], len(dynamometers)
        self.step = step
        p, points = _parameters(self.model, systems), [operating_motion(system) for system in systems]
        rate = max(steps, *(steps_per_second(self.model, _flat(self.model, row)[None]) for row in p))
        if hardware:
            rate = max(rate, *(0.5 / min(*bed.inverter_lags, *bed.torque_sensor_lags) for bed in hardware))
        self.pieces = max(int(np.ceil(step * rate - 1e-9)), int(np.ceil(step / FINE_STEP_S - 1e-9)))
        for row in p:
            _refine_friction(self.model, row, self.pieces / step)
        held = np.stack([point.inputs for point in points])
        names = list(self.model.inputs)
        driven = [dynamometer.torque_input for dynamometer in dynamometers]
        self.drives, self.commanded = [name for name in names if name not in driven], tuple(driven)
        self.trim, self.drive_trim = (held[:, [names.index(name) for name in some]].T for some in (driven, self.drives))
        weights = [[arrivals(delay, step, self.pieces) for delay in bed.delays] for bed in hardware]
        # dynamometers with a flange, by number, and its torque sensor
        self._flanges = {j: one.torque_sensor for j, one in enumerate(dynamometers) if one.torque_sensor is not None}
        of_bed = [[*bed.inverter_lags, *bed.torque_sensor_lags, *bed.torque_gains] for bed in hardware]
        parameters = np.hstack([p, held, *([np.array(of_bed)] if k else [])])
        count = len(systems)
        self._sticking = tuple(box for box in systems[0].gearboxes if box.name in sticking)
        self.functions, self.parameters = self._functions(k, driven, step), np.ascontiguousarray(parameters)
        self._readings = _RepeatedCall(external(self.functions[1]).map(count), parameters)
        still = np.zeros((len(self.model.states) + 2 * k, count))
        still[: len(self.model.states)] = np.stack([point.state for point in points], axis=1)
        still[len(self.model.states) : len(self.model.states) + k] = self.trim
        self.flange_sensors = tuple(self._flanges.values())
        self.flange_states = [len(self.model.states) + k + j for j in self._flanges]
        flanges = [self.model.sensors.index(name) for name in self.flange_sensors]
        self.steady = self._readings(still, np.zeros((len(self.drives), count)))
        still[self.flange_states] = self.steady[flanges]
        self.dynamometers, self.longest = k, max((each.shape[1] for row in weights for each in row), default=0)
        self.start = np.vstack([still, np.zeros((self.longest * k, count))])
        self.physical, self.middles = len(still), (np.arange(self.pieces) + 0.5) / self.pieces
        self.arriving = np.zeros((count, k, self.pieces, self.longest))  # of a bed, dynamometer, piece, sample ago
        for i, row in enumerate(weights):
            for j, each in enumerate(row):
                self.arriving[i, j, :, : each.shape[1]] = each

    @cached_property
    def _sample(self) -> _RepeatedCall:
        return _RepeatedCall(external(self.functions[0]).map(len(self.parameters)), self.parameters)

    def _functions(self, k: int, driven: Sequence[str], step: float) -> tuple[ca.Function, ca.Function]:
        """(x, what acts in each fine step [commands (k); torques (d)], p) → x; (x, torques, p) → readings (y,)."""
        model, n, d = self.model, len(self.model.states), len(self.drives)
        x, act = ca.SX.sym("x", n + 2 * k), ca.SX.sym("act", k + d)
        p, held = ca.SX.sym("p", len(model.parameters)), ca.SX.sym("held", len(model.inputs))
        bed = ca.SX.sym("bed", 3 * k)
        u = ca.SX(held)
        for i, name in enumerate(self.drives):
            u[model.inputs.index(name)] += act[k + i]
        commanded = ca.vertcat(*(held[model.inputs.index(name)] for name in driven)) if k else ca.SX(0, 1)
        for j, name in enumerate(driven):
            u[model.inputs.index(name)] += bed[2 * k + j] * (x[n + j] - commanded[j])
        capacities = [box.capacities[0] for box in self._sticking]
        most = u[[model.inputs.index(name) for name in capacities]]
        for name in capacities:  # what a clutch carries is found at the end of each step
            u[model.inputs.index(name)] = 0.0
        own = model.rates(x[:n], u, p)
        for box in self._sticking:
            own[model.states.index(f"gearboxes.{box.name}.{box.capacities[0]}")] = 0.0
        rates = [own]
        read = model.readings(x[:n], u, p, 0)
        if k:
            flange = ca.vertcat(
                *(read[model.sensors.index(self._flanges[j])] if j in self._flanges else 0.0 for j in range(k))
            )
            rates += [(commanded + act[:k] - x[n : n + k]) / bed[:k], (flange - x[n + k :]) / bed[k : 2 * k]]
        every, h = ca.vertcat(p, held, bed), step / self.pieces
        slope = ca.Function("slope", [x, act, every], [ca.cse(ca.vertcat(*rates))])
        k1 = slope(x, act, every)
        k2 = slope(x + h / 2 * k1, act, every)
        k3 = slope(x + h / 2 * k2, act, every)
        k4 = slope(x + h * k3, act, every)
        end_of_step = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        if capacities:
            end_of_step += self._ending_slips(end_of_step, most, p, h)
        fine = ca.Function("fine", [x, act, every], [end_of_step])
        now, acts, values = ca.MX.sym("x", x.shape), ca.MX.sym("act", k + d, self.pieces), ca.MX.sym("p", every.shape)
        end = now
        for piece in range(self.pieces):
            end = fine(end, acts[:, piece], values)
        torques = act[k:]
        return (
            ca.Function("sample", [now, acts, values], [end]),
            ca.Function("readings", [x, torques, every], [read]),
        )

    def _ending_slips(self, x: ca.SX, most: ca.SX, p: ca.SX, h: float) -> ca.SX:
        """What clutches that stick add to states (x,) at the end of a step of h (s), carrying at most torques (c,)."""
        model, n = self.model, self.model.n
        states, u = ca.SX.sym("states", len(model.states)), ca.SX.sym("u", len(model.inputs))
        parts = elements(model, model.p0[None])
        rows = dict(zip(parts.masses, parts.mass_transformation.reshape(-1, n), strict=True))
        by, slips = [], []
        for box in self._sticking:
            at = np.zeros(len(model.states))  # at rest, and as far twisted as under its whole torque
            at[model.states.index(f"gearboxes.{box.name}.{box.capacities[0]}")] = box.deflection.value
            column = ca.jacobian(model.rates(states, u, p), u[model.inputs.index(box.capacities[0])])
            speeds = ca.substitute(column, states, ca.DM(at))[n : 2 * n]
            by.append(ca.vertcat(h**2 / 2 * speeds, h * speeds, ca.SX(x.numel() - 2 * n, 1)))
            first, second = (rows[f"inertias.{name}"] for name in box.between)
            slips.append(ca.DM((first - box.ratios[0].value * second)[None]))
        added, row, columns = ca.SX(x.numel(), 1), ca.vertcat(*slips), ca.horzcat(*by)
        slip, gain = row @ x[n : 2 * n], row @ columns[n : 2 * n, :]
        torque = [ca.SX(0)] * len(by)
        for _ in range(1 if len(by) == 1 else FEW_SWEEPS):
            for i in range(len(by)):
                off = slip[i] + sum(gain[i, j] * one for j, one in enumerate(torque))
                largest = ca.fmax(most[i], 0.0)
                torque[i] = ca.fmin(ca.fmax(torque[i] - off / gain[i, i], -largest), largest)
        return added + columns @ ca.vertcat(*torque)

    def advance(self, x: np.ndarray, commands: np.ndarray, before: np.ndarray, after: np.ndarray) -> np.ndarray:
        """States (x, b) a sample later, for commands (k, b) issued now and torques (d, b) that vary evenly.

        ``before`` are the torques now, ``after`` those at the next sample.
        """
        k, n, later = self.dynamometers, self.physical, np.empty_like(x)
        # of what acts, as the compiled function has it: one column a bed and fine step
        act = self._sample.acting.T.reshape(x.shape[1], self.pieces, -1)
        torques = before.T[:, None]
        act[:, :, k:] = (
            torques if after is before else torques + (after - before).T[:, None] * self.middles[None, :, None]
        )
        if k:
            later[n : n + k], later[n + k :] = commands, x[n:-k]
            by_bed = later[n:].reshape(self.longest, k, -1).transpose(2, 1, 0)[..., None]  # (b, k, i, 1)
            act[:, :, :k] = (self.arriving @ by_bed)[..., 0].transpose(0, 2, 1)
        later[:n] = self._sample.found(x[:n])
        return later

    def absolute(self, x: np.ndarray, torques: np.ndarray) -> np.ndarray:
        """Readings of all the model's sensors (y, b); no sensor's lag."""
        return self._readings(x[: self.physical], torques)

    def twists(self, states: np.ndarray) -> tuple[np.ndarray, tuple[str, ...]]:
        """Twists (t, s) of the springs of the first bed for its states (t, x), less those at the start, and names."""
        parts, n = elements(self.model, self.model.p0[None]), len(self.model.states)
        return (states[:, :n] - self.start[:n, 0]) @ parts.deflection_jacobian.T, parts.springs

    def air_gap(self, states: np.ndarray) -> np.ndarray:
        """Air-gap torques (t, k) as commanded, of the first bed, less those at the operating point."""
        at, k = len(self.model.states), self.dynamometers
        return states[:, at : at + k] - self.start[at : at + k, 0]


class _RepeatedCall:
    """A function (x, acting, p) → one matrix, called over and over with the same parameters (b, p), without copies."""

    def __init__(self, function: ca.Function, parameters: np.ndarray):
        shapes = [function.size_in(0), function.size_in(1), function.size_out(0)]
        self._x, self.acting, self._found = (np.zeros(shape, order="F") for shape in shapes)
        self._parameters = np.asfortranarray(parameters.T)
        self._buffer, self._run = function.buffer()
        for i, array in enumerate((self._x, self.acting, self._parameters)):
            self._buffer.set_arg(i, memoryview(array.T))  # type: ignore[call-arg, arg-type]
        self._buffer.set_res(0, memoryview(self._found.T))  # type: ignore[call-arg, arg-type]

    def __call__(self, x: np.ndarray, acting: np.ndarray) -> np.ndarray:
        """The function at matrices as CasADi has them: one column a bed, or a bed and fine step."""
        self.acting[...] = acting
        return self.found(x).copy()

    def found(self, x: np.ndarray) -> np.ndarray:
        """The function at a state and at what stands in ``acting``, until the next call."""
        self._x[...] = x
        self._run()
        return self._found


def _parameters(model: Model, systems: Sequence[System]) -> np.ndarray:
    """Parameter sets (b, p)."""
    rows = []
    for system in systems:
        values = {name: quantity.value for name, quantity in system.parameters.items() if name in model.parameters}
        rows.append(model.vector(values))
    return np.stack(rows)


def _flat(model: Model, p: np.ndarray) -> np.ndarray:
    flat = p.copy()
    if STICK_SPEED in model.parameters:
        flat[model.parameters.index(STICK_SPEED)] = FLAT
    return flat


def _refine_friction(model: Model, p: np.ndarray, steps: float) -> None:
    """Dry friction as sharp as so many steps a second allow, and contact over one step; in place."""
    if CONTACT_TIME in model.parameters:
        p[model.parameters.index(CONTACT_TIME)] = 1 / steps
    if STICK_SPEED in model.parameters:
        at = model.parameters.index(STICK_SPEED)
        p[at] = PROBED_STICK_SPEED
        p[at] = rates_at_rest(model, p[None]).any * PROBED_STICK_SPEED / (STABLE_STEP * steps)
