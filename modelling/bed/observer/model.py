"""What the design of the observer needs of rig, residual vehicle and loop, whatever its weights are."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag

from modelling.bed.bed_model import BedModel, bed_model
from modelling.bed.delayed_bed import DelayedBed, delayed_bed
from modelling.bed.loop import Loop
from modelling.bed.residual_vehicle import ResidualVehicle
from modelling.common.errors import InputError
from modelling.modal.damped_modes import damped_modes
from modelling.model.system import System

NOISE = {"torque": 0.3, "speed": 0.08}  # N·m, rad/s of a sensor without uncertainty, as flanges and encoders have

FORGETTING_PER_SAMPLE = 1e-5  # of an estimated or known torque: a random walk without it has no bounded variance
MODES = 2  # that a swinging torque is estimated for; each adds two states a dynamometer
SWING_DAMPING = 0.02  # ratio, of such a torque, at least: how far from the mode's frequency it may swing
OF_MODES_DAMPING = 0.4  # the same over the modes' damping: a third of it is what a loop is asked for, and this is in it
FASTEST_SWING_RAD = 0.5  # of such a torque, from sample to sample
SMALLEST_SHARE = 1e-3  # of a mode's energy in the cut shafts


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
        Its torques are [by state of the estimated ones (e); known ones (w)].
    states : int
    wandering : ndarray (e, e)
        The estimated torques' states from sample to sample: a torque that wanders at every input of the rig and at
        every rotor, and one that swings with an emulated mode at every rotor, two states each.
    drifts : tuple of str (e)
        The weight that states how fast each of these states wanders.
    noises : dict of str to ndarray (x, k)
        What torques without memory do, by the weight that states their size: at the rotors, in the cut shafts.
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
    wandering: np.ndarray
    drifts: tuple[str, ...]
    noises: dict[str, np.ndarray]
    speed_error: np.ndarray
    readings: Readings
    known: tuple[str, ...]
    dynamometers: tuple[str, ...]
    sample_time: float

    @property
    def estimated(self) -> int:
        """Number e of the estimated torques' states."""
        return len(self.wandering)

    @property
    def on_their_way(self) -> slice:
        """Where the commands on their way stand among the states of the controller, newest first."""
        x = len(self.bed.whole)
        return slice(x, x + len(self.dynamometers) * (self.bed.delay + 1))


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
    columns = [model.space.input(name) for name in on_rig] + [*model.rotor_torques.T, *model.shaft_torques.T]
    columns += [model.space.input(name) for name in known]
    bed = delayed_bed(model.space.A, model.space.B[:, :k], np.stack(columns, axis=1), loop.command_delay(), step)
    at_inputs, at_rotors, in_shafts, of_known = np.split(bed.torques, np.cumsum([len(on_rig), k, k]), axis=1)
    modes = emulated_modes(residual, step)
    damping = max([SWING_DAMPING, *(-OF_MODES_DAMPING * mode.real / abs(mode) for mode in modes)])
    turns = [_turn(mode, step, damping) for mode in modes for _ in range(k)]
    swinging = np.zeros((len(at_rotors), 2 * len(turns)))
    swinging[:, ::2] = np.tile(at_rotors, len(turns) // k)
    stay = (1 - FORGETTING_PER_SAMPLE) * np.eye(len(on_rig) + k)
    drifts = ("torque_drift",) * len(on_rig) + ("dynamometer_drift",) * k + ("dynamometer_swing",) * 2 * len(turns)
    return ObserverModel(
        replace(bed, torques=np.hstack([at_inputs, at_rotors, swinging, of_known])), model.rig_states + 2 * k,
        block_diag(stay, *turns), drifts, {"dynamometer_noise": at_rotors, "shaft_noise": in_shafts},
        model.speed_error, _readings(model, rig, loop), known,
        tuple(dynamometer.name for dynamometer in loop.dynamometers), step,
    )  # fmt: skip


def emulated_modes(residual: ResidualVehicle, step: float) -> tuple[complex, ...]:
    """Eigenvalues (1/s) of the vehicle's modes that a wrong torque of a dynamometer damps or excites most.

    A relative error of the torque at a cut changes a mode's damping ratio by up to the share of the mode's energy in
    the cut shaft, so what counts is this share over the damping ratio. At most :data:`MODES`, slow enough for the
    ``step`` (s) of the controller.
    """
    modes, cuts = damped_modes(residual.vehicle), {f"shafts.{interface.shaft}" for interface in residual.interfaces}
    at = [i for i, name in enumerate(modes.springs) if name in cuts]
    share, value = modes.potential[:, at].sum(axis=1), modes.eigenvalues
    swings = (value.imag > 0) & (value.real < 0) & (value.imag * step < FASTEST_SWING_RAD) & (share > SMALLEST_SHARE)
    weight = np.where(swings, share / np.maximum(modes.damping_ratios, SMALLEST_SHARE), 0.0)
    ranked = np.argsort(-weight, kind="stable")[:MODES]
    return tuple(complex(value[i]) for i in sorted(ranked) if weight[i] > 0)


def _turn(mode: complex, step: float, damping: float) -> np.ndarray:
    """A torque that swings with a mode, from sample to sample: (2, 2), the first state is the torque."""
    angle = mode.imag * step
    c, s = np.cos(angle), np.sin(angle)
    return np.exp(-damping * angle) * np.array([[c, s], [-s, c]])


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
