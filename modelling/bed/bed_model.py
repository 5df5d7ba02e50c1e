"""Rig, lags and residual vehicle as one continuous model: what a controller predicts with."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag

from modelling.bed.loop import Loop
from modelling.bed.residual_vehicle import Interface, ResidualVehicle
from modelling.linear.state_space import StateSpace, state_space
from modelling.model.components import Input, Sensor, Shaft
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
    shaft_torques : ndarray (x, k)
        What a torque beside that of each cut shaft's spring and damper does, like columns of B.
    """

    space: StateSpace
    speed_error: np.ndarray
    measured: tuple[str, ...]
    rig_states: int
    shaft_torques: np.ndarray

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
    on_rig = tuple(part.name for part in rig.inputs if part.name not in dynamometer_inputs)
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
    error, shaft_torques = np.zeros((k, len(A))), np.zeros((len(A), k))
    for j, dynamometer in enumerate(loop.dynamometers):
        cut = next(cut for cut in residual.interfaces if cut.shaft == dynamometer.follows)
        A[:n, n + j] = rig_space.input(dynamometer.torque_input)
        B[n + j, j] = 1 / loop["inverter_lag"]
        A[n + k + j, :n] = rig_space.output(dynamometer.torque_sensor) / loop["torque_sensor_lag"]
        at = next(i for i, part in enumerate(parts) if cut.torque in part.inputs)
        rows = slice(starts[at], starts[at + 1])
        A[rows, :n] += np.outer(parts[at].input(cut.torque), cut.factor * rig_space.output(_torque(cut)))
        first, second = (rig_space.input(name) for name in _ends(cut))
        shaft_torques[:n, j] = second - first / _ratio(rig, cut)
        shaft_torques[rows, j] = cut.factor * parts[at].input(cut.torque)
        error[j, :n] = rig_space.output(_speed(cut))
        error[j, rows] = -parts[at].output(cut.speed)
    for j, name in enumerate(on_rig, k):
        B[:n, j] = rig_space.input(name)
    for j, (at, name) in enumerate(in_vehicle, k + len(on_rig)):
        B[starts[at] : starts[at + 1], j] = parts[at].input(name)
    C, D, outputs = _readings(rig_space, loop, len(A), B.shape[1], on_rig)
    measured = (*on_rig, *(name for _, name in in_vehicle))
    space = StateSpace(A, B, C, D, (*dynamometer_inputs, *measured), outputs)
    return BedModel(space, error, measured, n, shaft_torques)


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


def _ends(cut: Interface) -> tuple[str, str]:
    """Names of torques on the first and the second end of a cut shaft."""
    return f"first_end_torque_{cut.shaft}", f"second_end_torque_{cut.shaft}"


def _shaft(rig: System, cut: Interface) -> Shaft:
    return next(shaft for shaft in rig.shafts if shaft.name == cut.shaft)


def _ratio(rig: System, cut: Interface) -> float:
    ratio = _shaft(rig, cut).ratio
    return 1.0 if ratio is None else ratio.value


def _with_interfaces(rig: System, residual: ResidualVehicle) -> System:
    """The rig with sensors of torque and speed at its interfaces, and with torques on both ends of the cut shafts."""
    sensors = tuple(
        sensor
        for cut in residual.interfaces
        for sensor in (Sensor(_torque(cut), "torque", cut.shaft), Sensor(_speed(cut), "speed", cut.rig_end))
    )
    torques = tuple(
        Input(name, end, "torque")
        for cut in residual.interfaces
        for name, end in zip(_ends(cut), _shaft(rig, cut).between, strict=True)
    )
    return replace(rig, sensors=rig.sensors + sensors, inputs=rig.inputs + torques)
