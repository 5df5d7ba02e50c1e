"""A bed as it may stand there, with its dead time: what a sampled controller acts on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag

from matching.frequency.beds.requirements import rolled_off_from
from matching.frequency.case.case import Case
from matching.frequency.case.uncertainty import of_system
from modelling.bed.delayed_bed import DelayedBed, delayed_bed
from modelling.linear.state_space import state_space


@dataclass(frozen=True)
class Bed:
    """Rig with lags; x states, k commands, y readings of the controller, d torques at the rig, c compared sensors.

    Attributes
    ----------
    A, commands, torques : ndarray (x, x), (x, k), (x, d)
        Continuous, commands as they arrive.
    readings, compared : ndarray (y, x), (c, x)
    compared_torques : ndarray (c, d)
        What a torque does to a compared sensor at once.
    delay : float
        s, from a sample to the moment its command begins to act.
    sampled : DelayedBed
        Without torques.
    own_damping : float
        Least damping ratio of its own modes, without control, where the loop has to have rolled off.
    """

    A: np.ndarray
    commands: np.ndarray
    torques: np.ndarray
    readings: np.ndarray
    compared: np.ndarray
    compared_torques: np.ndarray
    delay: float
    sampled: DelayedBed
    own_damping: float


def disturbing(case: Case) -> list[str]:
    """Inputs of the rig that are no dynamometer's."""
    driven = {dynamometer.torque_input for dynamometer in case.loop.dynamometers}
    return [part.name for part in case.rig.inputs if part.name not in driven]


def compared_sensors(case: Case) -> list[str]:
    """Sensors of the compared functions, each once."""
    return list(dict.fromkeys(pair.sensor for pair in case.compared))


def bed_of(case: Case, values: Mapping[str, float]) -> Bed:
    """The bed with some values (:class:`matching.frequency.case.uncertainty.Uncertain`) other than the case's, SI.

    Raises
    ------
    InputError
        If the rig cannot be made linear.
    """
    loop, k = case.loop, len(case.loop.dynamometers)
    of_rig = {name.removeprefix("rig."): value for name, value in values.items() if name.startswith("rig.")}
    rig = state_space(case.rig.with_values(of_rig) if of_rig else case.rig)
    lag, sensor_lag = (values.get(f"loop.{name}", loop[name]) for name in ("inverter_lag", "torque_sensor_lag"))
    delay = loop.command_delay(values.get("loop.dead_time"))
    n = len(rig.A)
    A = block_diag(rig.A, -np.eye(k) / lag, -np.eye(k) / sensor_lag)
    commands, readings = np.zeros((n + 2 * k, k)), np.zeros((len(loop.controller_sensors), n + 2 * k))
    for j, dynamometer in enumerate(loop.dynamometers):
        A[:n, n + j] = values.get(f"dynamometers.{dynamometer.name}.torque_gain", 1.0) * rig.input(
            dynamometer.torque_input
        )
        A[n + k + j, :n] = rig.output(dynamometer.torque_sensor) / sensor_lag
        commands[n + j, j] = 1 / lag
    for i, name in enumerate(loop.controller_sensors):
        readings[i, :n] = rig.output(name)
    readings[:k] = np.eye(k, n + 2 * k, n + k)
    readings *= np.array([[values.get(f"sensors.{name}.gain", 1.0)] for name in loop.controller_sensors])
    torques = np.zeros((n + 2 * k, len(disturbing(case))))
    rows = [rig.outputs.index(name) for name in compared_sensors(case)]
    columns = [rig.inputs.index(name) for name in disturbing(case)]
    torques[:n] = rig.B[:, columns]
    compared = np.hstack([rig.C[rows], np.zeros((len(rows), 2 * k))])
    of_its_own = least_damping(rig.A, 2 * np.pi * rolled_off_from(case))
    sampled = delayed_bed(A, commands, np.zeros((n + 2 * k, 0)), delay, loop["sample_time"])
    return Bed(A, commands, torques, readings, compared, rig.D[np.ix_(rows, columns)], delay, sampled, of_its_own)


def least_damping(A: np.ndarray, from_rad_s: float) -> float:
    """Least damping ratio of the modes of A (x, x) from so many rad/s on; 1 without any."""
    s = np.linalg.eigvals(A)
    fast = s[(np.abs(s) >= from_rad_s) & (s.imag > 0)]
    return float(np.min(-fast.real / np.abs(fast), initial=1.0))


def vehicle_response(case: Case, values: Mapping[str, float], frequencies: np.ndarray) -> np.ndarray:
    """Compared functions (f, h) of the vehicle whose shared components have the bed's values."""
    drawn = of_system(values, case.vehicle)
    space = state_space(case.vehicle.with_values(drawn) if drawn else case.vehicle)
    s = 2j * np.pi * frequencies
    states = np.linalg.solve(
        s[:, None, None] * np.eye(len(space.A)) - space.A, np.broadcast_to(space.B, (len(s), *space.B.shape))
    )
    H = space.C @ states + space.D
    rows = [space.outputs.index(pair.sensor) for pair in case.compared]
    return H[:, rows, [space.inputs.index(pair.input) for pair in case.compared]]
