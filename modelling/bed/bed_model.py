"""Rig, lags and residual vehicle as one continuous model: what a controller predicts with."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag

from modelling.bed.loop import Loop
from modelling.bed.residual_vehicle import Interface, ResidualVehicle
from modelling.linear.state_space import StateSpace, state_space
from modelling.model.components import Sensor
from modelling.model.system import System


@dataclass(frozen=True)
class BedModel:
    """Rig with inverter and torque-sensor lags, driving the residual vehicle through the torque of the cut shafts.

    Attributes
    ----------
    space : StateSpace
        Inputs [commands as they act (k), measured torques (w)], outputs [sensors of the rig, and of each dynamometer
        its lagged torque ``NAME torque`` and its speed ``NAME speed``].
    speed_error : ndarray (k, x)
        Speed of the rig less that of the residual vehicle at each cut, rad/s by state.
    measured : tuple of str (w)
        Every torque that is no dynamometer's: of the rig, then of the residual vehicle.
    rig_states : int
        The first states, of the rig; the air-gap torques (k), the lagged flange torques (k) and the residual vehicle
        follow.
    """

    space: StateSpace
    speed_error: np.ndarray
    measured: tuple[str, ...]
    rig_states: int

    @property
    def rotor_torques(self) -> np.ndarray:
        """What a torque right at each dynamometer's rotor does (x, k), like columns of B."""
        k, n = len(self.speed_error), self.rig_states
        return np.vstack([self.space.A[:n, n : n + k], np.zeros((len(self.space.A) - n, k))])


def bed_model(rig: System, residual: ResidualVehicle, loop: Loop) -> BedModel:
    """Put rig, lags and residual vehicle together, without dead time.

    Raises
    ------
    InputError
        If a model cannot be made linear.
    """
    rig_space = state_space(_with_interfaces(rig, residual))
    parts = [state_space(part) for part in residual.parts]
    interface_torques = {cut.torque for cut in residual.interfaces}
    dynamometer_inputs = [dynamometer.torque_input for dynamometer in loop.dynamometers]
    on_rig = tuple(name for name in rig_space.inputs if name not in dynamometer_inputs)
    in_vehicle = [(i, name) for i, part in enumerate(parts) for name in part.inputs if name not in interface_torques]
    k, n = len(loop.dynamometers), len(rig_space.A)
    A = block_diag(
        rig_space.A,
        -np.eye(k) / loop["inverter_lag"],
        -np.eye(k) / loop["torque_sensor_lag"],
        *(part.A for part in parts),
    )
    starts = np.cumsum([n + 2 * k, *(len(part.A) for part in parts)])
    B = np.zeros((len(A), k + len(on_rig) + len(in_vehicle)))
    error = np.zeros((k, len(A)))
    for j, dynamometer in enumerate(loop.dynamometers):
        cut = next(cut for cut in residual.interfaces if cut.shaft == dynamometer.follows)
        A[:n, n + j] = rig_space.input(dynamometer.torque_input)
        B[n + j, j] = 1 / loop["inverter_lag"]
        A[n + k + j, :n] = rig_space.output(dynamometer.torque_sensor) / loop["torque_sensor_lag"]
        at = next(i for i, part in enumerate(parts) if cut.torque in part.inputs)
        rows = slice(starts[at], starts[at + 1])
        A[rows, :n] += np.outer(parts[at].input(cut.torque), cut.factor * rig_space.output(_torque(cut)))
        error[j, :n] = rig_space.output(_speed(cut))
        error[j, rows] = -parts[at].output(cut.speed)
    for j, name in enumerate(on_rig, k):
        B[:n, j] = rig_space.input(name)
    for j, (at, name) in enumerate(in_vehicle, k + len(on_rig)):
        B[starts[at] : starts[at + 1], j] = parts[at].input(name)
    C, D, outputs = _readings(rig_space, loop, len(A), B.shape[1], on_rig)
    measured = (*on_rig, *(name for _, name in in_vehicle))
    return BedModel(StateSpace(A, B, C, D, (*dynamometer_inputs, *measured), outputs), error, measured, n)


def _readings(
    rig: StateSpace, loop: Loop, states: int, inputs: int, on_rig: tuple[str, ...]
) -> tuple[np.ndarray, np.ndarray, tuple[str, ...]]:
    """C (y, x), D (y, u) and names (y) of the outputs."""
    k, n, sensors = len(loop.dynamometers), len(rig.A), len(rig.C)
    C, D = np.zeros((sensors + 2 * k, states)), np.zeros((sensors + 2 * k, inputs))
    C[:sensors, :n] = rig.C
    names = list(rig.outputs)
    for j, dynamometer in enumerate(loop.dynamometers):
        C[sensors + 2 * j, n + k + j] = 1
        C[sensors + 2 * j + 1, :n] = rig.output(dynamometer.speed_sensor)
        names += [f"{dynamometer.name} torque", f"{dynamometer.name} speed"]
    for j, name in enumerate(on_rig, k):
        D[:sensors, j] = rig.D[:, rig.inputs.index(name)]
    return C, D, tuple(names)


def _torque(cut: Interface) -> str:
    return f"interface_torque_{cut.shaft}"


def _speed(cut: Interface) -> str:
    return f"interface_speed_{cut.shaft}"


def _with_interfaces(rig: System, residual: ResidualVehicle) -> System:
    """The rig with sensors of torque and speed at its interfaces."""
    sensors = tuple(
        sensor
        for cut in residual.interfaces
        for sensor in (Sensor(_torque(cut), "torque", cut.shaft), Sensor(_speed(cut), "speed", cut.rig_end))
    )
    return replace(rig, sensors=rig.sensors + sensors)
