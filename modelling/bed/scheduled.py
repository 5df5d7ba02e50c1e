"""One observer over a range of speeds: designs on a grid, interpolated in the speed, the vehicle nonlinear."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import casadi as ca
import numpy as np
from scipy.linalg import block_diag

from modelling.bed.bed import Begin, ControlLaw, Loop
from modelling.bed.observer import ObserverModel, design, emulated_modes, observer_model
from modelling.bed.vehicle import ResidualVehicle
from modelling.equations.casadi_code import compiled
from modelling.equations.lagrange import CREEP, STICK_SPEED
from modelling.linear.elements import elements
from modelling.linear.linearise import deflated, linearise
from modelling.linear.steady_motion import operating_motion, speeds_of
from modelling.system import System

# --- The residual vehicle as it is, in the states of the linear models.
#
# At every speed of the grid the residual vehicle is linearised about steady motion there, and the observer is designed
# with that. What the vehicle does beyond the linear model of the speed at which it is (the remainder: a tyre near its
# largest force, drag and rolling resistance as they are) acts as torques that the controller computes itself at every
# sample, from its own estimate, and treats like torques that it knows. All designs have the same physical states, so
# nothing jumps where the speed passes from one to the next. A torque of its own whose effect depends on the motion (a
# brake) is in the remainder as a whole, and in no linear model.

STICKS_BELOW = 0.1  # rad/s: dry friction of the residual vehicle rises to its torque up to here, as a creeping tyre
# rad/s at which a held brake gives way under its full torque. Nothing on the bed measures angles: without it noise of
# the speeds would pile up as a twist between held wheels, and at less of it more of that noise is left.
GIVES_WAY = 0.5


@dataclass(frozen=True)
class NonlinearVehicle:
    """All parts of a residual vehicle; v states without free angles, k cuts, r inputs of its own, g speeds.

    Attributes
    ----------
    rates : casadi.Function
        (states (v,), torques at the cuts (k,), own inputs (r,)) → rates (v,).
    A : ndarray (g, v, v)
        Linear model about steady motion at each speed.
    steady : ndarray (g, v)
        States of that motion.
    speed : ndarray (v,)
        The vehicle's speed by state, rad/s.
    inputs : tuple of str (r)
    nonlinear : ndarray (r,)
        1 of an input whose effect depends on the motion, or on the input itself; 0 of a plain torque.
    """

    rates: ca.Function
    A: np.ndarray
    steady: np.ndarray
    speed: np.ndarray
    inputs: tuple[str, ...]
    nonlinear: np.ndarray

    def slope(self, states: np.ndarray) -> np.ndarray:
        """Derivatives (v, v) of the rates by the states at one state (v,)."""
        return self._slope(states).full()

    @cached_property
    def _slope(self) -> ca.Function:
        x, T, w = (ca.SX.sym(f"in{number}", self.rates.size1_in(number)) for number in range(3))
        slope = ca.jacobian(self.rates(x, T, w), x)
        return ca.Function("slope", [x], [ca.substitute(slope, ca.vertcat(T, w), ca.SX.zeros(T.numel() + w.numel()))])


def nonlinear_vehicle(residuals: Sequence[ResidualVehicle], loop: Loop, bodies: Sequence[str]) -> NonlinearVehicle:
    """The residual vehicle of a range.

    Parameters
    ----------
    residuals : sequence of ResidualVehicle (g)
        The same at every speed of the grid, but for its operating point.
    loop : Loop
        Its dynamometers give the order of the cuts.
    bodies : sequence of str
        Inertias whose mean speed is the vehicle's.
    """
    first = residuals[0]
    cuts = [next(cut for cut in first.interfaces if cut.shaft == one.follows).torque for one in loop.dynamometers]
    own = tuple(part.name for system in first.parts for part in system.inputs if part.name not in cuts)
    states: list[ca.SX] = []
    at_cuts, at_own = ca.SX.sym("T", len(cuts)), ca.SX.sym("w", len(own))
    rates, speeds = [], []
    lifts = [_lift(system) for system in first.parts]  # which angles nothing depends on is the same at every speed
    for system, lift in zip(first.parts, lifts, strict=True):
        model = compiled(system)
        x = ca.SX.sym(f"x{len(states)}", lift.shape[1])
        u = ca.vertcat(*(
            at_cuts[cuts.index(name)] if name in cuts else at_own[own.index(name)] for name in model.inputs
        ))  # fmt: skip
        p = model.p0.copy()
        for name, value in ((STICK_SPEED, STICKS_BELOW), (CREEP, GIVES_WAY)):
            if name in model.parameters:
                p[model.parameters.index(name)] = value
        rates.append(lift.T @ model.rates(lift @ x, u, p))
        states.append(x)
        parts = elements(model, model.p0[None])
        rows = parts.mass_transformation.reshape(-1, model.n) @ lift[model.n : 2 * model.n]
        named = dict(zip(parts.masses, rows, strict=True))
        speeds.append(
            sum((named[f"inertias.{name}"] for name in bodies if f"inertias.{name}" in named), np.zeros(lift.shape[1]))
        )
    A, steady = [], []
    for residual in residuals:
        pairs = list(zip(residual.parts, lifts, strict=True))
        A.append(block_diag(*(lift.T @ linearise(system).A @ lift for system, lift in pairs)))
        steady.append(np.concatenate([lift.T @ operating_motion(system).state for system, lift in pairs]))
    every, motion = ca.vertcat(*rates), ca.vertcat(*states)
    slopes = ca.horzsplit(ca.jacobian(every, at_own))
    nonlinear = np.array([ca.depends_on(slope, ca.vertcat(motion, at_own)) for slope in slopes], dtype=float)
    function = ca.Function("vehicle", [motion, at_cuts, at_own], [ca.cse(every)])
    mean = np.concatenate(speeds) / len(bodies)
    return NonlinearVehicle(function, np.stack(A), np.stack(steady), mean, own, nonlinear)


def _lift(system: System) -> np.ndarray:
    linear = linearise(system)
    return deflated(linear, elements(linear.model, linear.p[None], linear.x0)).lift


# --- The law


@dataclass(frozen=True)
class ScheduledLaw:
    """Designs over speed as one law; x states, y readings, w known torques, k dynamometers, g speeds, b beds.

    xc = x + L·(y − E·x), u = K·xc + Dw·[w; r], x⁺ = A·xc + Bw·[w; r] + Bs·sent in deviations from where it was
    switched on, with the remainders r = rates(vehicle, …) − A_vehicle·(vehicle's deviation) of the vehicle of the
    observer and of that which runs ahead. All matrices lie straight between those of the two nearest speeds.

    Attributes
    ----------
    laws : tuple of ControlLaw (g)
        At each speed; columns of remainders follow those of the known torques.
    speeds : ndarray (g,)
        rad/s of the vehicle's inertia, rising.
    rotor_speeds : ndarray (g,)
        rad/s, rising: mean of the rotors' speeds in steady motion there, each counted in the direction in which it
        turns as the vehicle drives forwards. From it the speed at the begin follows.
    vehicle : NonlinearVehicle
    observed, ahead : slice
        Where the vehicles stand among the states.
    cut_by_reading, cut_by_command : ndarray (k, y), (k, k)
        Torque into the vehicle at each cut, N·m, by what was read and commanded in steady motion.
    known_inputs : tuple of int (r)
        Which of the known torques act on the residual vehicle.
    speed_readings : tuple of int (k)
        Which readings are the rotors' speeds.
    rotor_shares : ndarray (k,)
        Of each rotor's speed in that mean.
    operating_speed : float
        rad/s of the vehicle's inertia, about which a case reports its match.
    """

    laws: tuple[ControlLaw, ...]
    speeds: np.ndarray
    rotor_speeds: np.ndarray
    vehicle: NonlinearVehicle
    observed: slice
    ahead: slice
    cut_by_reading: np.ndarray
    cut_by_command: np.ndarray
    known_inputs: tuple[int, ...]
    speed_readings: tuple[int, ...]
    rotor_shares: np.ndarray
    operating_speed: float

    @property
    def linear(self) -> ControlLaw:
        """The law about the operating point of its case."""
        return self.frozen(self.operating_speed)

    @property
    def first(self) -> ControlLaw:
        """The law at the lowest speed: names, sizes and expectation are the same at all."""
        return self.laws[0]

    @property
    def sensors(self) -> tuple[str, ...]:
        """Names of the readings (y)."""
        return self.first.sensors

    @property
    def known(self) -> tuple[str, ...]:
        """Names of the known torques (w)."""
        return self.first.known

    @property
    def dynamometers(self) -> tuple[str, ...]:
        """Names of the dynamometers (k)."""
        return self.first.dynamometers

    @property
    def sample_time(self) -> float:
        """In s."""
        return self.first.sample_time

    @property
    def vehicle_states(self) -> int:
        """Number v of states of the residual vehicle that runs in it as it is."""
        return len(self.vehicle.speed)

    @property
    def states(self) -> int:
        """Number x of states."""
        return self.first.states

    @property
    def E(self) -> np.ndarray:
        """Expectation (y, x) of the readings: sensors do not change with the speed."""
        return self.first.E

    @cached_property
    def stacked(self) -> dict[str, np.ndarray]:
        """Matrices (g, …) by name."""
        return {name: np.stack([getattr(law, name) for law in self.laws]) for name in ("A", "Bw", "Bs", "K", "Dw", "L")}

    def between(self, speed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Number of the lower neighbour (b,) of speeds (b,), rad/s, and the share (b,) of the upper one."""
        at = np.clip(np.searchsorted(self.speeds, speed, side="right") - 1, 0, len(self.speeds) - 2)
        share = (speed - self.speeds[at]) / (self.speeds[at + 1] - self.speeds[at])
        return at, np.clip(share, 0.0, 1.0)

    def begin(self, readings: np.ndarray, known: np.ndarray, sent: np.ndarray) -> Begin:
        """Where an emulation begins, of one bed or of a batch: absolute readings (y, …), torques (w, …), (k, …).

        The vehicle begins as it runs steadily at the rotors' speed; below the lowest speed of a grid that is above 0 in
        proportion.
        """
        rotor = self.rotor_shares @ readings[list(self.speed_readings)]
        at, share = self.between(np.interp(rotor, self.rotor_speeds, self.speeds))
        low, high = self.vehicle.steady[at].T, self.vehicle.steady[at + 1].T
        part = np.clip(rotor / self.rotor_speeds[0], -1.0, 1.0) if self.rotor_speeds[0] > 0 else 1.0
        return Begin(
            part * (low + share * (high - low)), self.cut_by_reading @ readings + self.cut_by_command @ sent,
            known[list(self.known_inputs)],
        )  # fmt: skip

    def step(
        self, state: np.ndarray, readings: np.ndarray, known: np.ndarray,
        limits: np.ndarray | tuple[np.ndarray, np.ndarray], begin: Begin | None = None,
        added: np.ndarray | float = 0.0,
    ) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
        """As :meth:`ControlLaw.step`; without ``begin`` the emulation began at rest, with nothing acting."""
        if state.ndim == 1:
            single = None if begin is None else Begin(*(part[:, None] for part in begin))
            bounds = limits if isinstance(limits, tuple) else (-limits, limits)
            low, high, more = (np.broadcast_to(side, len(self.dynamometers))[:, None] for side in (*bounds, added))
            sent, after = self.step(state[:, None], readings[:, None], known[:, None], (low, high), single, more)
            return sent[:, 0], after[:, 0]
        parts, vehicle, count = self.stacked, self.vehicle, state.shape[1]
        if begin is None:
            sizes = len(self.sensors), len(self.known), len(self.dynamometers)
            begin = self.begin(*(np.zeros((size, count)) for size in sizes))
        at, share = self.between(vehicle.speed @ (begin.steady + state[self.observed]))

        def taken(matrices: np.ndarray, vector: np.ndarray) -> np.ndarray:
            low, high = (np.einsum("bij,jb->ib", matrices[number], vector) for number in (at, at + 1))
            return low + share * (high - low)

        corrected = state + taken(parts["L"], readings - self.E @ state)
        own, acting = begin.own + vehicle.nonlinear[:, None] * known[list(self.known_inputs)], [known]
        for where in (self.observed, self.ahead):
            off = corrected[where]
            rates = vehicle.rates(begin.steady + off, begin.at_cuts, own).full()
            acting.append(rates - taken(vehicle.A, off))
        together = np.vstack(acting)
        least, most = limits if isinstance(limits, tuple) else (-limits, limits)
        sent = np.clip(taken(parts["K"], corrected) + taken(parts["Dw"], together) + added, least, most)
        return sent, taken(parts["A"], corrected) + taken(parts["Bw"], together) + taken(parts["Bs"], sent)

    def frozen(self, speed: float) -> ControlLaw:
        """The law about steady motion at one speed (rad/s), linear: as plain feedback sees it."""
        at, share = self.between(np.array([speed]))
        low, high = int(at[0]), int(at[0]) + 1

        def taken(matrices: np.ndarray) -> np.ndarray:
            between: np.ndarray = matrices[low] + share[0] * (matrices[high] - matrices[low])
            return between

        made = {name: taken(matrices) for name, matrices in self.stacked.items()}
        off = self.vehicle.slope(taken(self.vehicle.steady)) - taken(self.vehicle.A)
        w, v = len(self.known), len(off)
        A, K = made["A"].copy(), made["K"].copy()
        for number, where in enumerate((self.observed, self.ahead)):
            columns = slice(w + number * v, w + (number + 1) * v)
            A[:, where] += made["Bw"][:, columns] @ off
            K[:, where] += made["Dw"][:, columns] @ off
        return replace(self.first, A=A, K=K, Bw=made["Bw"][:, :w], Dw=made["Dw"][:, :w], Bs=made["Bs"], L=made["L"])


Law = ControlLaw | ScheduledLaw


def scheduled_law(
    rigs: Sequence[System], residuals: Sequence[ResidualVehicle], loop: Loop, weights: Mapping[str, float],
    bodies: Sequence[str], torque_signs: np.ndarray, operating_speed: float,
) -> ScheduledLaw:  # fmt: skip
    """Design at every speed of a grid.

    Parameters
    ----------
    rigs, residuals : sequence of System, sequence of ResidualVehicle (g)
        At operating points of rising speed.
    weights : mapping of str to float
        The same at every speed.
    bodies : sequence of str
        Inertias whose mean speed is the vehicle's.
    torque_signs : ndarray (k,)
        Torque that drives the rotor for a flange reading of 1 N·m, see ``LinearBed.torque_signs``.
    operating_speed : float
        rad/s, see :class:`ScheduledLaw`.
    """
    models = observer_models(rigs, residuals, loop)
    first, vehicle = models[0], nonlinear_vehicle(residuals, loop, bodies)
    in_remainder = [name for name, nonlinear in zip(vehicle.inputs, vehicle.nonlinear, strict=True) if nonlinear]
    laws = tuple(_without(design(model, weights), in_remainder) for model in models)
    v = len(vehicle.speed)
    size = len(first.bed.whole) + len(first.dynamometers) * (first.bed.delay + 1) + first.estimated
    turning = [speeds_of(residual.vehicle) for residual in residuals]
    speeds = np.array([np.mean([each[name] for name in bodies]) for each in turning])
    rotors = [next(part.on for part in rigs[0].inputs if part.name == one.torque_input) for one in loop.dynamometers]
    by_rig = [speeds_of(rig) for rig in rigs]
    ends = [next(cut for cut in residuals[0].interfaces if cut.shaft == one.follows) for one in loop.dynamometers]
    # what turns the rotor turns the vehicle's end of the cut, by the ratio of their speeds
    over = [by_rig[-1][rotor] / turning[-1][end.vehicle_end] for rotor, end in zip(rotors, ends, strict=True)]
    turned = np.array([[each[name] for name in rotors] for each in by_rig])  # (g, k)
    k, sensors = len(loop.dynamometers), laws[0].sensors
    shares = np.sign(turned[-1]) / k
    by_reading, by_command = np.zeros((k, len(sensors))), np.zeros((k, k))
    for j, one in enumerate(loop.dynamometers):
        if one.torque_sensor is None:
            by_command[j, j] = -over[j]
        else:
            by_reading[j, sensors.index(one.torque_sensor)] = torque_signs[j] * over[j]
    known = laws[0].known
    return ScheduledLaw(
        laws, speeds, turned @ shares, vehicle,
        slice(first.states, first.states + v), slice(size + first.states, size + first.states + v),
        by_reading, by_command, tuple(known.index(name) for name in vehicle.inputs),
        tuple(sensors.index(one.speed_sensor) for one in loop.dynamometers), shares, operating_speed,
    )  # fmt: skip


def _without(law: ControlLaw, known: Sequence[str]) -> ControlLaw:
    """The law that takes nothing of these known torques."""
    columns = [law.known.index(name) for name in known]
    Bw, Dw = law.Bw.copy(), law.Dw.copy()
    Bw[:, columns], Dw[:, columns] = 0.0, 0.0
    return replace(law, Bw=Bw, Dw=Dw)


def observer_models(rigs: Sequence[System], residuals: Sequence[ResidualVehicle], loop: Loop) -> list[ObserverModel]:
    """Models for the design at every speed: with remainders, and with the same number of swinging torques."""
    modes = [emulated_modes(residual, loop["sample_time"]) for residual in residuals]
    most = max(map(len, modes))
    full = [number for number, each in enumerate(modes) if len(each) == most]
    modes = [modes[min(full, key=lambda other: abs(other - number))] for number in range(len(modes))]
    return [
        observer_model(rig, residual, loop, each, remainders=True)
        for rig, residual, each in zip(rigs, residuals, modes, strict=True)
    ]
