"""Motion of rig or vehicle from sample to sample, linear exactly, nonlinear by fine steps."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
import scipy
from scipy.linalg import block_diag

from matching.match.beds import Action
from matching.match.case import Case
from modelling.bed.bed import Dynamometer
from modelling.bed.vehicle import Interface, cut
from modelling.controller.law import ControlLaw, law_of_feed_forward, law_of_feedback, law_of_observer
from modelling.equations.casadi_code import compiled
from modelling.equations.shaft_law import CONTACT_TIME
from modelling.errors import InputError
from modelling.linear.elements import elements
from modelling.linear.linearise import deflated, linearise
from modelling.linear.state_space import StateSpace, discretise, propagated
from modelling.linear.steady_motion import operating_motion
from modelling.modal.modes import images
from modelling.simulation.stepping import steps_per_second
from modelling.system import Sensor, System

# --- A linear system with what its states mean in inertias and shafts.


@dataclass(frozen=True)
class Body:
    """A system made linear about its operating point, or at rest; rigid-body angles left out.

    Attributes
    ----------
    system : System
    space : StateSpace
        ẋ = A·x + B·u, y = C·x + D·u.
    turns, twists : ndarray (k, x), (s, x)
        Speed of every inertia (rad/s) and deflection of every spring (rad) by state.
    J, stiffness : ndarray (k,), (s,)
        kg·m², N·m/rad.
    masses, springs : tuple of str
        ``inertias.NAME``, ``shafts.NAME``.
    image : ndarray (k,) or None
        Index of every inertia's mirror image.
    """

    system: System
    space: StateSpace
    turns: np.ndarray
    twists: np.ndarray
    J: np.ndarray
    stiffness: np.ndarray
    masses: tuple[str, ...]
    springs: tuple[str, ...]
    image: np.ndarray | None

    def response(self, s: np.ndarray) -> np.ndarray:
        """C·(sI − A)⁻¹·B + D, (f, y, u), at complex s (f,)."""
        return transfer(self.space.A, self.space.B, self.space.C, self.space.D, s)


def body(system: System) -> Body:
    """Linearise a system about its operating point, without one at rest with lash just closed."""
    linear = linearise(compiled(system))
    if linear.input_delays.any() or linear.sensor_delays.any():
        raise InputError(
            "effects", "a dead time inside the model is not expected here", "state it in the loop of the case"
        )
    parts = elements(linear.model, linear.p[None], linear.x0)
    rest = deflated(linear, parts)
    lift = rest.lift
    model, n = linear.model, linear.model.n
    space = StateSpace(rest.A, lift.T @ linear.B, linear.C @ lift, linear.D, tuple(model.inputs), tuple(model.sensors))
    return Body(
        system,
        space,
        parts.mass_transformation @ lift[n : 2 * n],
        parts.deflection_jacobian @ lift,
        parts.J[0],
        parts.stiffness[0],
        parts.masses,
        parts.springs,
        images(system, parts.masses),
    )


def transfer(A: np.ndarray, B: np.ndarray, C: np.ndarray, D: np.ndarray, s: np.ndarray) -> np.ndarray:
    """C·(sI − A)⁻¹·B + D at complex s (f,): (f, y, u)."""
    s = np.asarray(s)
    states = np.linalg.solve(
        s[:, None, None] * np.eye(len(A)) - A, np.broadcast_to(B, (len(s), *B.shape)).astype(complex)
    )
    return C @ states + D


# --- The pieces of a tuned case as matrices: rig with its lags, residual vehicle, feedback controller.
#
# Built from the linear models alone; nothing here is shared with the loop that the optimiser works on.


@dataclass(frozen=True)
class Parts:
    """Rig and residual vehicle of a case as bodies, with who measures and drives what.

    Attributes
    ----------
    case : Case
    rig : Body
        With further sensors: every shaft's torque and the interfaces' speeds, see :func:`shaft_torque` and
        :func:`interface_speed`.
    residual : tuple of Body
        The tuned residual vehicle, part by part.
    cuts : tuple of Interface
        The cut each dynamometer follows.
    toward : ndarray (k,)
        Torque that drives the rotor for a flange reading of 1 N·m.
    simulated : tuple of str
        Inputs that act inside the residual vehicle.
    free : Body
        The rig before anything was tuned, sensors as ``rig``: what the matched one is compared with.
    """

    case: Case
    rig: Body
    residual: tuple[Body, ...]
    cuts: tuple[Interface, ...]
    toward: np.ndarray
    simulated: tuple[str, ...]
    free: Body

    @property
    def dynamometers(self) -> tuple[Dynamometer, ...]:
        """The dynamometers of the case, k of them."""
        return self.case.loop.dynamometers

    @property
    def drives(self) -> tuple[str, ...]:
        """Inputs of the rig that are no dynamometer's."""
        driven = {dyno.torque_input for dyno in self.dynamometers}
        return tuple(name for name in self.rig.space.inputs if name not in driven)

    @property
    def measured(self) -> tuple[str, ...]:
        """Inputs whose torque the feed-forward takes as measured: none in the structure ``pi``."""
        loop = self.case.loop
        on_rig = [name for name in self.drives if name in loop.measured]
        return loop.structure.measured_inputs(on_rig, self.simulated)

    @cached_property
    def bed(self) -> StateSpace:
        """Rig with inverter and torque-sensor lags.

        States [rig, air-gap torques (k), lagged flange torques (k)], inputs [torque commands after the dead time (k),
        :attr:`drives`], outputs [signed flange torques (k), rotor speeds (k), air-gap torques (k)].
        """
        rig, loop, k = self.rig.space, self.case.loop, len(self.dynamometers)
        n = len(rig.A)
        A = block_diag(rig.A, -np.eye(k) / loop["inverter_lag"], -np.eye(k) / loop["torque_sensor_lag"])
        B = np.zeros((n + 2 * k, k + len(self.drives)))
        C = np.zeros((3 * k, n + 2 * k))
        for j, dyno in enumerate(self.dynamometers):
            A[:n, n + j] = rig.input(dyno.torque_input)
            A[n + k + j, :n] = self.toward[j] * rig.output(dyno.torque_sensor) / loop["torque_sensor_lag"]
            B[n + j, j] = 1 / loop["inverter_lag"]
            C[j, n + k + j] = C[2 * k + j, n + j] = 1
            C[k + j, :n] = rig.output(dyno.speed_sensor)
        for i, name in enumerate(self.drives, k):
            B[:n, i] = rig.input(name)
        names = [dyno.name for dyno in self.dynamometers]
        outputs = tuple(f"{name} {what}" for what in ("torque", "speed", "air gap") for name in names)
        return StateSpace(A, B, C, np.zeros((3 * k, B.shape[1])), (*names, *self.drives), outputs)

    @property
    def further_readings(self) -> np.ndarray:
        """Readings (y, x) of :attr:`Loop.further_sensors` by state of :attr:`bed`."""
        further, n = self.case.loop.further_sensors, len(self.bed.A)
        rows = [self.rig.space.output(name) for name in further]
        return np.array([np.pad(row, (0, n - len(row))) for row in rows]).reshape(len(further), n)

    @cached_property
    def residual_space(self) -> StateSpace:
        """All of the residual vehicle: inputs [interface torques (k), :attr:`simulated`], outputs reference speeds."""
        A = block_diag(*(part.space.A for part in self.residual))
        sources = [*(cut.torque for cut in self.cuts), *self.simulated]
        B, C = np.zeros((len(A), len(sources))), np.zeros((len(self.cuts), len(A)))
        starts = np.cumsum([0, *(len(part.space.A) for part in self.residual)])
        for part, a, b in zip(self.residual, starts[:-1], starts[1:], strict=True):
            for i, name in enumerate(sources):
                if name in part.space.inputs:
                    B[a:b, i] = part.space.input(name)
            for j, cut in enumerate(self.cuts):
                if cut.speed in part.space.outputs:
                    C[j, a:b] = part.space.output(cut.speed)
        speeds = tuple(cut.speed for cut in self.cuts)
        return StateSpace(A, B, C, np.zeros((len(C), len(sources))), tuple(sources), speeds)

    @cached_property
    def controller(self) -> StateSpace:
        """The control structure's feedback law in continuous time, see :meth:`ControlStructure.controller`."""
        return self.case.loop.structure.controller(self.case.loop, self.residual_space, self.case.rig)

    @cached_property
    def sampled_controller(self) -> StateSpace:
        """The feedback law as it runs, from sample to sample, see :meth:`ControlStructure.sampled`."""
        return self.case.loop.structure.sampled(self.case.loop, self.residual_space, self.case.rig)


def parts_of(case: Case, rig: System | None = None, untuned: System | None = None) -> Parts:
    """Take a case apart.

    ``rig`` stands in for the case's where the true rig is another; ``untuned`` is the rig before it was tuned, ``rig``
    unless given.
    """
    residual = case.residual_vehicle
    cuts = tuple(
        next(cut for cut in residual.interfaces if cut.shaft == dyno.follows) for dyno in case.loop.dynamometers
    )
    rig = case.rig if rig is None else rig
    bodies = tuple(body(part) for part in residual.parts)
    taken = {cut.torque for cut in residual.interfaces}
    simulated = tuple(name for part in bodies for name in part.space.inputs if name not in taken)
    toward = np.array([_toward(rig, dyno) for dyno in case.loop.dynamometers])
    rig_body = body(watched(rig, cuts, rig_side=True))
    free = rig_body if untuned is None else body(watched(untuned, cuts, rig_side=True))
    return Parts(case, rig_body, bodies, cuts, toward, simulated, free)


def watched(system: System, cuts: tuple[Interface, ...], *, rig_side: bool) -> System:
    """The system with sensors of every shaft's torque and of the speeds at the cuts, on the rig's side or beyond."""
    more = [Sensor(shaft_torque(shaft.name), "torque", shaft.name) for shaft in system.shafts]
    more += [Sensor(interface_speed(cut.shaft), "speed", cut.rig_end if rig_side else cut.vehicle_end) for cut in cuts]
    return replace(system, sensors=(*system.sensors, *more))


def shaft_torque(shaft: str) -> str:
    """Name of the added sensor of a shaft's torque."""
    return f"verified_torque_{shaft}"


def interface_speed(shaft: str) -> str:
    """Name of the added sensor of the speed at a cut."""
    return f"verified_speed_{shaft}"


def _toward(rig: System, dyno: Dynamometer) -> float:
    """+1 where the rotor hangs on the second end of the measured flange, −1/ratio where on the first."""
    flange = next(
        shaft
        for shaft in rig.shafts
        for sensor in rig.sensors
        if sensor.name == dyno.torque_sensor and sensor.of == shaft.name
    )
    rotor = next(torque.on for torque in rig.inputs if torque.name == dyno.torque_input)
    joints = [set(part.between) for part in rig.shafts if part.name != flange.name]
    joints += [set(part.between) for part in rig.gears]
    joints += [{part.cage, part.left, part.right} for part in rig.differentials]
    beyond = {flange.between[1]}
    while grown := {end for joint in joints if joint & beyond for end in joint} - beyond:
        beyond |= grown
    if rotor in beyond:
        return 1.0
    return -1.0 if flange.ratio is None else -1 / flange.ratio.value


# --- The sampled control law of a tuned case, of any structure, as it leaves the computer.


def control_law(parts: Parts) -> ControlLaw:
    """The law of a tuned case; its readings are those of the rig's sensors, signs as the rig has them."""
    case, loop = parts.case, parts.case.loop
    reference = cut(case.emulated_vehicle, case.rig)
    k = len(loop.dynamometers)
    sensors = (
        *(dynamometer.torque_sensor for dynamometer in loop.dynamometers),
        *(dynamometer.speed_sensor for dynamometer in loop.dynamometers),
    )
    signs = np.concatenate([parts.toward, np.ones(k)])
    observer = loop.structure.observer(case.rig, reference, loop)
    if observer is not None:
        return law_of_observer(observer)
    feed_forward = loop.structure.feed_forward(case.rig, reference, loop)
    if feed_forward is not None:
        return law_of_feed_forward(feed_forward, parts.sampled_controller, signs, sensors)
    return law_of_feedback(parts.sampled_controller, signs, sensors, parts.simulated, loop["sample_time"])


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


# --- What a sampled control law does at frequencies.


def law_action(law: ControlLaw, frequencies: np.ndarray, readings: tuple[str, ...]) -> Action:
    """Commands of a control law for ``readings`` and for known torques at frequencies (f,), Hz."""
    z = np.exp(2j * np.pi * frequencies * law.sample_time)
    n, unlimited = len(law.A), law.A + law.Bs @ law.K
    keep = np.eye(n) - law.L @ law.E
    of_readings = unlimited @ law.L + law.By + law.Bs @ law.Dy
    of_known = law.Bw + law.Bs @ law.Dw
    drive = np.hstack([of_readings, of_known])
    states = np.linalg.solve(
        z[:, None, None] * np.eye(n) - unlimited @ keep, np.broadcast_to(drive, (len(z), *drive.shape))
    )
    y = len(law.sensors)
    commands = law.K @ keep @ states
    acting = np.zeros((len(z), len(law.dynamometers), len(readings)), complex)
    acting[:, :, [readings.index(name) for name in law.sensors]] = commands[:, :, :y] + law.K @ law.L + law.Dy
    return Action(acting, commands[:, :, y:] + law.Dw, law.known)


# --- Motion

FINEST = 50e-6  # s: longest fine step


class LinearMotion:
    """Exact propagation from sample to sample: k held commands through a delay line, d torques that vary linearly.

    Parameters
    ----------
    A, B : ndarray (x, x), (x, k + d)
    count : int
        k, the first columns of B.
    step : float
        s, one sample.
    delay : float
        s, of the line that carries commands.

    Attributes
    ----------
    start, drift : ndarray (x,)
        State at time 0, and its rate where nothing acts: zero.
    whole : ndarray (x, x)
        What a sample makes of the state.
    drives : ndarray (2, x, d)
        What the torques at its beginning and at its end do within a sample.
    commands : list of (int, ndarray (x, k))
        How many samples ago a command was issued and what it does within one sample.
    """

    def __init__(self, A: np.ndarray, B: np.ndarray, count: int, step: float, delay: float = 0.0):
        pieces = int(np.ceil(step / FINEST - 1e-9))
        fine, push = scipy.signal.cont2discrete((A, B, np.eye(len(A)), np.zeros(B.shape)), step / pieces)[:2]
        self.start = self.drift = np.zeros(len(A))
        self.whole = np.eye(len(A))
        pushes = []
        for _ in range(pieces):
            pushes.append(self.whole @ push[:, :count])
            self.whole = fine @ self.whole
        torques = discretise(A, B[:, count:], step)
        self.drives = np.stack([torques.held - torques.ramp, torques.ramp])
        weights = arrivals(delay, step, pieces)
        over = [sum(w * p for w, p in zip(column, reversed(pushes), strict=True)) for column in weights.T]
        self.commands = [(i, part) for i, part in enumerate(over) if count and np.any(weights[:, i])]

    def advance(self, x: np.ndarray, drives: np.ndarray, issued: np.ndarray, k: int) -> np.ndarray:
        """The state (x,) a sample later, from the state x (x,) at sample ``k``.

        Parameters
        ----------
        drives : ndarray (2, d)
            Torques at this sample and at the next, N·m.
        issued : ndarray (t, k)
            Commands in N·m, of which those up to sample ``k`` inclusive count.
        """
        new = self.whole @ x + self.drives[0] @ drives[0] + self.drives[1] @ drives[1]
        for i, push in self.commands:
            if k >= i:
                new += push @ issued[k - i]
        return new

    def free(self, drives: np.ndarray) -> np.ndarray:
        """States (t, x) from the start under torques (t, d) in N·m alone, no command; the last torque stays."""
        following = np.concatenate([drives[1:], drives[-1:]])
        return propagated(self.whole, drives @ self.drives[0].T + following @ self.drives[1].T, self.start)


class NonlinearMotion:
    """Runge-Kutta of order four over fine steps, inverter and torque-sensor lags included.

    States [x of the model, air-gap torques (k), lagged flange torques (k)], absolute: they begin at the operating
    point. Commands and drives are what is added to its torques. Arguments as :class:`LinearMotion`.

    Attributes
    ----------
    start, drift : ndarray (x,)
        States at the operating point at time 0, and their rates: angles turn on.
    deviation_readings : ca.Function
        x → signed lagged flange torques and rotor speeds (2·k,), less those at the operating point.
    readings : ca.Function
        (x of the model, added inputs (u,)) → y, absolute.
    """

    def __init__(self, parts: Parts | None, system: System, step: float, delay: float = 0.0):
        model = compiled(system)
        p = model.p0
        needed = max(steps_per_second(model, p[None]) * step, step / FINEST)
        if parts is not None:
            needed = max(needed, *(step / (2 * parts.case.loop[lag]) for lag in ("inverter_lag", "torque_sensor_lag")))
        self._pieces = int(np.ceil(needed - 1e-9))
        if CONTACT_TIME in model.parameters:
            p = p.copy()
            p[model.parameters.index(CONTACT_TIME)] = step / self._pieces
        self._weights = arrivals(delay, step, self._pieces)
        dynos = () if parts is None else parts.dynamometers
        k, n = len(dynos), len(model.states)
        x, v, w = ca.SX.sym("x", n + 2 * k), ca.SX.sym("v", k), ca.SX.sym("w", len(model.inputs) - k)
        about = operating_motion(system)
        u = ca.SX(ca.DM(about.inputs))
        driven = [dyno.torque_input for dyno in dynos]
        for i, name in enumerate(name for name in model.inputs if name not in driven):
            u[model.inputs.index(name)] += w[i]
        for j, name in enumerate(driven):
            u[model.inputs.index(name)] = x[n + j]
        held = np.array([about.inputs[model.inputs.index(name)] for name in driven])  # by the dynamometers
        rates: list[Any] = [model.rates(x[:n], u, p)]
        self.start = np.concatenate([about.state, held, np.zeros(k)])
        if parts is not None:
            loop = parts.case.loop
            readings = model.readings(x[:n], u, p, 0)
            flange = ca.vertcat(
                *(parts.toward[j] * readings[model.sensors.index(d.torque_sensor)] for j, d in enumerate(dynos))
            )
            commands = held + v
            rates += [
                (commands - x[n : n + k]) / loop["inverter_lag"],
                (flange - x[n + k :]) / loop["torque_sensor_lag"],
            ]
            still = ca.Function("flange", [x, w], [flange])
            self.start[n + k :] = still(self.start, np.zeros(w.shape[0])).full().ravel()
            names = [*(d.speed_sensor for d in dynos), *loop.further_sensors]
            deviations = ca.vertcat(x[n + k :], *(readings[model.sensors.index(name)] for name in names))
            deviations = ca.substitute(deviations, w, ca.DM.zeros(w.shape))
            deviations = deviations - ca.Function("seen", [x], [deviations])(self.start)
            self.deviation_readings = ca.Function("deviation_readings", [x], [deviations])
        slope = ca.Function("slope", [x, v, w], [ca.vertcat(*rates)])
        h = step / self._pieces
        k1 = slope(x, v, w)
        k2 = slope(x + h / 2 * k1, v, w)
        k3 = slope(x + h / 2 * k2, v, w)
        k4 = slope(x + h * k3, v, w)
        single_step = ca.Function("one", [x, v, w], [x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)])
        self._run = single_step.mapaccum("sample", self._pieces)
        self.drift = np.concatenate([about.state[model.n : 2 * model.n], np.zeros(n + 2 * k - model.n)])
        self._count = k
        self.twists = elements(model, p[None]).deflection_jacobian
        self.readings = ca.Function("readings", [x, w], [model.readings(x[:n], u, p, 0)])

    def advance(self, x: np.ndarray, drives: np.ndarray, issued: np.ndarray, k: int) -> np.ndarray:
        """As :meth:`LinearMotion.advance`; over a fine step, torques have the value of its middle."""
        commands = np.zeros((self._pieces, self._count))
        for i in range(min(self._weights.shape[1], k + 1) if self._count else 0):
            commands += np.outer(self._weights[:, i], issued[k - i])
        middles = (np.arange(self._pieces) + 0.5) / self._pieces
        path = self._run(x, commands.T, np.outer(drives[0], 1 - middles) + np.outer(drives[1], middles))
        return path[:, -1].full().ravel()

    def free(self, drives: np.ndarray) -> np.ndarray:
        """As :meth:`LinearMotion.free`."""
        states, no_commands = np.empty((len(drives), len(self.start))), np.zeros((len(drives), 0))
        x = self.start
        for k in range(len(drives)):
            states[k] = x
            x = self.advance(x, drives[k : k + 2] if k + 1 < len(drives) else drives[[k, k]], no_commands, k)
        return states


def body_motion(linear_body: Body, step: float) -> LinearMotion:
    """Motion of a vehicle, or of a rig without control, in steps of s."""
    return LinearMotion(linear_body.space.A, linear_body.space.B, 0, step)
