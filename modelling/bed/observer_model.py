"""What the design of the observer needs of rig, residual vehicle and loop, whatever its weights are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from modelling.bed.bed_model import BedModel, bed_model
from modelling.bed.delayed_bed import DelayedBed, delayed_bed
from modelling.bed.loop import Loop
from modelling.bed.residual_vehicle import ResidualVehicle
from modelling.common.errors import InputError
from modelling.model.system import System

NOISE = {"torque": 0.3, "speed": 0.08}  # N·m, rad/s of a sensor without uncertainty, as flanges and encoders have


@dataclass(frozen=True)
class Readings:
    """What the controller measures: y torque sensors of the dynamometers, then their speeds, then further sensors.

    Attributes
    ----------
    rows : ndarray (y, x)
        By state of rig and lags.
    noise : ndarray (y,)
        Standard deviation, SI.
    kinds : tuple of str
        ``torque``, ``speed`` (of the dynamometers) or ``further``.
    sensors : tuple of str
    """

    rows: np.ndarray
    noise: np.ndarray
    kinds: tuple[str, ...]
    sensors: tuple[str, ...]


@dataclass(frozen=True)
class ObserverModel:
    """The model from sample to sample; x states, of which the first ``states`` are of rig and lags.

    Attributes
    ----------
    bed : DelayedBed
        Its torques are [estimated ones (e): at every input of the rig, at every rotor; known ones (w)].
    states : int
    inputs : int
        Of the estimated torques, those at inputs of the rig; the others act on the rotors.
    speed_error : ndarray (k, x)
        Speed of the rig less that of the residual vehicle at each cut, rad/s.
    readings : Readings
    known : tuple of str (w)
    dynamometers : tuple of str (k)
    sample_time : float
        s.
    """

    bed: DelayedBed
    states: int
    inputs: int
    speed_error: np.ndarray
    readings: Readings
    known: tuple[str, ...]
    dynamometers: tuple[str, ...]
    sample_time: float

    @property
    def estimated(self) -> int:
        """Number e of estimated torques."""
        return self.inputs + len(self.dynamometers)


def observer_model(rig: System, residual: ResidualVehicle, loop: Loop) -> ObserverModel:
    """Put model, dead time and sensors together.

    Raises
    ------
    InputError
        If a model cannot be made linear or a further sensor reads an angle or an acceleration.
    """
    model, k, step = bed_model(rig, residual, loop), len(loop.dynamometers), loop["sample_time"]
    driven = {dynamometer.torque_input for dynamometer in loop.dynamometers}
    on_rig = [part.name for part in rig.inputs if part.name not in driven]
    known = tuple(name for name in model.measured if name in loop.measured or name not in on_rig)
    columns = [model.space.input(name) for name in on_rig] + list(model.rotor_torques.T)
    columns += [model.space.input(name) for name in known]
    bed = delayed_bed(model.space.A, model.space.B[:, :k], np.stack(columns, axis=1), loop.command_delay(), step)
    return ObserverModel(
        bed, model.rig_states + 2 * k, len(on_rig), model.speed_error, _readings(model, rig, loop), known,
        tuple(dynamometer.name for dynamometer in loop.dynamometers), step,
    )  # fmt: skip


def _readings(model: BedModel, rig: System, loop: Loop) -> Readings:
    states = model.rig_states + 2 * len(loop.dynamometers)
    sensors = {part.name: part for part in rig.sensors}
    names = [f"{dynamometer.name} torque" for dynamometer in loop.dynamometers]
    names += [f"{dynamometer.name} speed" for dynamometer in loop.dynamometers] + list(loop.further_sensors)
    kinds = ["torque"] * len(loop.dynamometers) + ["speed"] * len(loop.dynamometers)
    kinds += ["further"] * len(loop.further_sensors)
    noise = []
    for name in loop.controller_sensors:
        if sensors[name].measures not in NOISE:
            raise InputError(
                "loop.measures", f"{name!r} measures an {sensors[name].measures}", "a speed or torque is needed"
            )
        noise.append(sensors[name].uncertainty or NOISE[sensors[name].measures])
    rows = np.stack([model.space.output(name) for name in names])[:, :states]
    return Readings(rows, np.array(noise), tuple(kinds), loop.controller_sensors)
