"""The control law on imperfect beds, sample by sample, and the vehicle under the same torques; b beds, t samples."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from matching.frequency.case.case import Case
from matching.frequency.in_time.imperfection import Imperfection, flawed
from matching.frequency.in_time.nonlinear_beds import BedHardware, NonlinearBeds
from matching.frequency.in_time.sensing import PoorSensors
from modelling.controller.law import ControlLaw
from modelling.linear.reference_motion import torques_of
from modelling.simulation.result import SimulationError

TOO_LARGE = 1e9  # a state beyond this has left every bed
SAMPLES_BETWEEN_CHECKS = 20


@dataclass(frozen=True)
class BedRun:
    """What is simulated.

    Attributes
    ----------
    imperfection : Imperfection
    torques : mapping of str to ndarray (t,)
        N·m by input, as demanded, one value a sample.
    known : tuple of str
        Inputs of the rig whose torque the controller knows; it always knows those of the residual vehicle.
    """

    imperfection: Imperfection
    torques: Mapping[str, np.ndarray] = field(repr=False)
    known: tuple[str, ...] = ()


@dataclass(frozen=True)
class BedMotion:
    """Readings (t, y) of the chosen sensors and commands (t, k), less their values at the operating point."""

    readings: np.ndarray = field(repr=False)
    commands: np.ndarray = field(repr=False)


def acting(case: Case, run: BedRun) -> dict[str, np.ndarray]:
    """Torques (t,) that act, N·m by input: those of the rig are not what was demanded."""
    on_rig, wrong = {part.name for part in case.rig.inputs}, run.imperfection
    time = np.arange(len(next(iter(run.torques.values())))) * case.loop["sample_time"]
    return {
        name: wrong.demand_factor * np.interp(time - wrong.demand_late, time, torque) if name in on_rig else torque
        for name, torque in run.torques.items()
    }


def vehicle_motions(case: Case, runs: Sequence[BedRun], sensors: Sequence[str]) -> list[np.ndarray]:
    """Readings (t, y) of the nonlinear vehicle with the specimen of every bed.

    Raises
    ------
    SimulationError
        If a motion grows out of bounds.
    """
    systems = [flawed(case.vehicle, run.imperfection, case) for run in runs]
    beds = NonlinearBeds(systems, case.loop)
    drives = _stacked([acting(case, run) for run in runs], beds.drives)
    rows = [beds.model.sensors.index(name) for name in sensors]
    x, none = beds.start, np.zeros((0, len(systems)))
    read = np.empty((len(drives), len(rows), len(systems)))
    for k, now in enumerate(drives):
        read[k] = beds.read(x, now)[rows]
        x = beds.advance(x, none, now, drives[min(k + 1, len(drives) - 1)])
    if not np.abs(x).max() < TOO_LARGE:
        raise SimulationError("simulation", "the motion of the vehicle grows out of bounds", "check its parameters")
    return [read[:, :, i] for i in range(len(systems))]


def bed_motions(
    case: Case, law: ControlLaw, runs: Sequence[BedRun], sensors: Sequence[str], seed: int = 0
) -> list[BedMotion | None]:
    """The beds under the law; None for those whose motion grows out of bounds.

    All runs have imperfections of one structure: lash or none. ``seed`` is that of the sensors' noise.
    """
    loop = case.loop
    systems = [flawed(case.rig, run.imperfection, case) for run in runs]
    beds = NonlinearBeds(systems, loop, loop.dynamometers, [hardware(case, run.imperfection) for run in runs])
    drives = _stacked([acting(case, run) for run in runs], beds.drives)
    measured = _stacked([_known_torques(case, run) for run in runs], law.known)
    poor, of_law = _sensing(case, law, runs, seed), [beds.model.sensors.index(name) for name in law.sensors]
    flanges = [law.sensors.index(dynamometer.torque_sensor) for dynamometer in loop.dynamometers]
    chosen = [beds.model.sensors.index(name) for name in sensors]
    limit, held = case.limits.get("dynamometer_torque", np.inf), torques_of(case.rig)
    trim = np.array([held[dynamometer.torque_input] for dynamometer in loop.dynamometers])[:, None]
    x, state = beds.start, np.zeros((len(law.A), len(runs)))
    read = np.empty((len(drives), len(chosen), len(runs)))
    sent = np.empty((len(drives), len(trim), len(runs)))
    gone = np.zeros(len(runs), bool)
    for k, now in enumerate(drives):
        readings = beds.read(x, now)
        read[k] = readings[chosen]
        true = readings[of_law]
        true[flanges] = beds.lagged(x)
        y, w = poor.read(true), measured[k]
        corrected = state + law.L @ (y - law.E @ state)
        u = np.clip(law.K @ corrected + law.Dy @ y + law.Dw @ w, -limit - trim, limit - trim)
        state = law.A @ corrected + law.By @ y + law.Bw @ w + law.Bs @ u
        sent[k] = u
        x = beds.advance(x, u, now, drives[min(k + 1, len(drives) - 1)])
        if k % SAMPLES_BETWEEN_CHECKS == 0 and (lost := ~(np.abs(x).max(axis=0) < TOO_LARGE)).any():
            gone |= lost
            x, state = np.where(gone, beds.start, x), np.where(gone, 0.0, state)
    return [None if lost else BedMotion(read[:, :, i], sent[:, :, i]) for i, lost in enumerate(gone)]


def hardware(case: Case, imperfection: Imperfection) -> BedHardware:
    """Lags, delay and torque gains of an imperfect bed."""
    values, loop = imperfection.values, case.loop
    return BedHardware(
        values.get("loop.inverter_lag", loop["inverter_lag"]),
        values.get("loop.torque_sensor_lag", loop["torque_sensor_lag"]),
        loop.command_delay(values.get("loop.dead_time")),
        tuple(values.get(f"dynamometers.{dynamometer.name}.torque_gain", 1.0) for dynamometer in loop.dynamometers),
    )


def _known_torques(case: Case, run: BedRun) -> dict[str, np.ndarray]:
    """Torques as the controller knows them; unknown ones are 0."""
    on_rig = {part.name for part in case.rig.inputs}
    return {name: torque * (name not in on_rig or name in run.known) for name, torque in run.torques.items()}


def _sensing(case: Case, law: ControlLaw, runs: Sequence[BedRun], seed: int) -> PoorSensors:
    by_name = {sensor.name: sensor for sensor in case.rig.sensors}
    gains = [[run.imperfection.values.get(f"sensors.{name}.gain", 1.0) for run in runs] for name in law.sensors]
    poor = np.array([run.imperfection.poor_sensors for run in runs])
    return PoorSensors([by_name[name] for name in law.sensors], poor, np.array(gains), law.sample_time, seed)


def _stacked(torques: Sequence[Mapping[str, np.ndarray]], names: Sequence[str]) -> np.ndarray:
    """(t, d, b)."""
    count = len(next(iter(torques[0].values())))
    stack = np.zeros((count, len(names), len(torques)))
    for i, name in enumerate(names):
        for j, by_name in enumerate(torques):
            stack[:, i, j] = by_name.get(name, 0.0)
    return stack
