"""The twin: rig and residual vehicle in one model, which commands the dynamometers ahead of the dead time.

The residual vehicle is driven by the torque of the cut shaft; the dynamometers have to make the rig's end of that
shaft turn as the residual vehicle does. Minimising the squared speed difference e over all frequencies, with a price
on the commands, is an H2 problem; for torques that step at unforeseeable moments its optimum across a dead time is
state feedback on the state predicted with the announced torques held (Kwakernaak and Sivan, Linear Optimal Control
Systems, 1972; Mirkin and Raskin, Automatica 39 (2003) 1747, for the dead time). It is solved in discrete time at the
sample time of the controller, with dead times that are no multiple of it taken exactly.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag, expm, solve_discrete_are

from modelling.bed.loop import Loop
from modelling.bed.residual_vehicle import Interface, ResidualVehicle
from modelling.common.errors import InputError
from modelling.linear.state_space import StateSpace, state_space
from modelling.model.components import Sensor
from modelling.model.system import System

EFFORT_PRICE = 1e-12  # (rad/s per N·m)²: at this price the commands are practically free


@dataclass(frozen=True)
class Twin:
    """Rig, actuators and residual vehicle in discrete time, with the optimal feedback on the predicted state.

    State ξ = [x; commands of the last step]: ξ⁺ = A·ξ + B·u(k − delay) + W·w, y = C·ξ + D·w.

    Attributes
    ----------
    A, B, W, C, D : ndarray
        (x, x), (x, u), (x, w), (y, x), (y, w).
    F : ndarray (u, x)
        u(k) = −F·ξ(k + delay), predicted.
    delay : int
        Whole samples of dead time; the rest of it is in A and B.
    sample_time : float
        s.
    announced, outputs : tuple of str
        Names of w and y: the rig's sensors, each dynamometer's lagged torque ``NAME torque`` and speed ``NAME speed``.
    """

    A: np.ndarray
    B: np.ndarray
    W: np.ndarray
    C: np.ndarray
    D: np.ndarray
    F: np.ndarray
    delay: int
    sample_time: float
    announced: tuple[str, ...]
    outputs: tuple[str, ...]

    @property
    def poles(self) -> np.ndarray:
        """Poles of the twin's own loop, taken back to s, rad/s."""
        z = np.linalg.eigvals(self.A - self.B @ self.F)
        return np.log(z[np.abs(z) > 1e-6]) / self.sample_time

    def predict(self, state: np.ndarray, commands: Sequence[np.ndarray], announced: np.ndarray) -> np.ndarray:
        """The state ``delay`` samples ahead, announced torques held; ``commands`` still on their way, oldest first."""
        for command in commands:
            state = self.A @ state + self.B @ command + self.W @ announced
        return state

    def response(self, frequencies: np.ndarray) -> np.ndarray:
        """Response (f, y, w) of the rig to the announced torques at frequencies (f,), Hz, sampled and held."""
        closed = self.A - self.B @ self.F
        out = np.empty((len(frequencies), len(self.C), self.W.shape[1]), complex)
        powers = [self.W]
        for _ in range(self.delay - 1):
            powers.append(self.A @ powers[-1])
        for k, f in enumerate(frequencies):
            z = np.exp(2j * np.pi * f * self.sample_time)
            missed = sum(
                (power * (z**j - 1) for j, power in enumerate(reversed(powers[: self.delay]))), np.zeros_like(self.W)
            )
            drive = self.W + self.B @ (self.F @ missed) * z**-self.delay
            out[k] = self.C @ np.linalg.solve(z * np.eye(len(closed)) - closed, drive) + self.D
        return out


def twin(
    rig: System,
    residual: ResidualVehicle,
    loop: Loop,
    sample_time: float | None = None,
    effort_price: float = EFFORT_PRICE,
) -> Twin:
    """Synthesise the twin of a rig and a residual vehicle for a loop.

    Parameters
    ----------
    rig : System
    residual : ResidualVehicle
        As cut out of the vehicle: the reference, not what was tuned for the feedback.
    loop : Loop
        Dead time, inverter lag, torque-sensor lag and sample time are used.
    sample_time : float, optional
        s; that of the loop unless given.
    effort_price : float
        (rad/s per N·m)².

    Raises
    ------
    InputError
        If the H2 problem has no stabilising solution.
    """
    step = loop["sample_time"] if sample_time is None else sample_time
    plant, error, announced, outputs = combined(rig, residual, loop)
    size, commands = len(plant.A), len(loop.dynamometers)
    delay = int(np.floor(loop["dead_time"] / step + 1e-9))
    late = max(loop["dead_time"] - delay * step, 0.0)
    b, w = plant.B[:, :commands], plant.B[:, commands:]
    whole, both = _held(plant.A, plant.B, step)
    after, new = _held(plant.A, b, step - late)
    old = after @ _held(plant.A, b, late)[1]
    zero = np.zeros((commands, size + commands))
    A = np.vstack([np.hstack([whole, old]), zero])
    B = np.vstack([new, np.eye(commands)])
    W = np.vstack([both[:, commands:], np.zeros((commands, w.shape[1]))])
    E = np.hstack([error, np.zeros((len(error), commands))])
    price = effort_price * np.eye(commands)
    try:
        X = solve_discrete_are(A, B, E.T @ E + 1e-14 * np.eye(len(A)), price)
    except (np.linalg.LinAlgError, ValueError) as fault:
        raise InputError(
            "loop",
            f"no stabilising command exists for this rig and vehicle ({fault})",
            "check that each dynamometer reaches its cut",
        ) from None
    F = np.linalg.solve(B.T @ X @ B + price, B.T @ X @ A)
    C = np.hstack([plant.C, np.zeros((len(plant.C), commands))])
    return Twin(A, B, W, C, plant.D[:, commands:], F, delay, step, announced, outputs)


def combined(
    rig: System, residual: ResidualVehicle, loop: Loop
) -> tuple[StateSpace, np.ndarray, tuple[str, ...], tuple[str, ...]]:
    """Rig, lags and residual vehicle as one continuous model with inputs [commands, announced torques].

    Returns
    -------
    StateSpace, error rows (u, x), announced names, output names
    """
    own = state_space(_with_interfaces(rig, residual))
    parts = [state_space(part) for part in residual.parts]
    k, n = len(loop.dynamometers), len(own.A)
    sizes = [n, k, k, *(len(part.A) for part in parts)]
    A = block_diag(
        own.A, -np.eye(k) / loop["inverter_lag"], -np.eye(k) / loop["torque_sensor_lag"], *(part.A for part in parts)
    )
    starts = np.cumsum([0, *sizes])
    simulated = [
        (i, name)
        for i, part in enumerate(parts)
        for name in part.inputs
        if name not in {cut.torque for cut in residual.interfaces}
    ]
    announced = (
        *(name for name in own.inputs if name not in {d.torque_input for d in loop.dynamometers}),
        *(name for _, name in simulated),
    )
    B = np.zeros((len(A), k + len(announced)))
    error = np.zeros((k, len(A)))
    for j, dyno in enumerate(loop.dynamometers):
        cut = next(cut for cut in residual.interfaces if cut.shaft == dyno.follows)
        A[:n, n + j] = own.input(dyno.torque_input)
        B[n + j, j] = 1 / loop["inverter_lag"]
        A[n + k + j, :n] = own.output(dyno.torque_sensor) / loop["torque_sensor_lag"]
        at = next(i for i, part in enumerate(parts) if cut.torque in part.inputs)
        rows = slice(starts[3 + at], starts[4 + at])
        A[rows, :n] += np.outer(parts[at].input(cut.torque), cut.factor * own.output(_torque(cut)))
        error[j, :n] = own.output(_speed(cut))
        error[j, rows] = -parts[at].output(cut.speed)
    for j, name in enumerate(announced, k):
        if name in own.inputs:
            B[:n, j] = own.input(name)
    for (at, name), j in zip(simulated, range(k + len(announced) - len(simulated), k + len(announced)), strict=True):
        B[starts[3 + at] : starts[4 + at], j] = parts[at].input(name)
    C = np.zeros((len(own.C) + 2 * k, len(A)))
    C[: len(own.C), :n] = own.C
    names = list(own.outputs)
    for j, dyno in enumerate(loop.dynamometers):
        C[len(own.C) + 2 * j, n + k + j] = 1
        C[len(own.C) + 2 * j + 1, :n] = own.output(dyno.speed_sensor)
        names += [f"{dyno.name} torque", f"{dyno.name} speed"]
    D = np.zeros((len(C), B.shape[1]))
    for j, name in enumerate(announced, k):
        if name in own.inputs:
            D[: len(own.C), j] = own.D[:, own.inputs.index(name)]
    return (
        StateSpace(A, B, C, D, (*(d.torque_input for d in loop.dynamometers), *announced), tuple(names)),
        error,
        announced,
        tuple(names),
    )


def dead_time_bound(rig: System, residual: ResidualVehicle, loop: Loop, refinement: int = 8) -> Twin:
    """The best that dead time leaves: the same H2 problem with free commands, sampled finely.

    Every torque is announced and every state known, so whatever a controller does with less, it answers later or
    worse. It is the optimum for torques that step at unforeseeable moments, over all frequencies; over a finite band
    alone no bound exists: a causal filter can be as good as one likes there, at the price of what lies outside.
    """
    step = loop["sample_time"] / refinement
    return twin(rig, residual, loop, step, EFFORT_PRICE)


def _torque(cut: Interface) -> str:
    return f"interface_torque_{cut.shaft}"


def _speed(cut: Interface) -> str:
    return f"interface_speed_{cut.shaft}"


def _with_interfaces(rig: System, residual: ResidualVehicle) -> System:
    """The rig with sensors at its interfaces."""
    own = tuple(
        sensor
        for cut in residual.interfaces
        for sensor in (Sensor(_torque(cut), "torque", cut.shaft), Sensor(_speed(cut), "speed", cut.rig_end))
    )
    return replace(rig, sensors=rig.sensors + own)


def _held(A: np.ndarray, B: np.ndarray, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Exact discretisation over a step with inputs held."""
    n, m = len(A), B.shape[1]
    block = expm(np.block([[A, B], [np.zeros((m, n + m))]]) * step)
    return block[:n, :n], block[:n, n:]
