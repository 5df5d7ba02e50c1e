"""The bed without emulation, as a recording shows it: torques that are commanded or demanded in, readings out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from matching.frequency.beds.bed import Bed, bed_of, compared_sensors, disturbing
from matching.frequency.case.case import Case, Compared
from matching.frequency.loop.parts import shaft_torque
from modelling.model.components import Sensor

UNKNOWN_NOISE = 1.0  # standard deviation of a sensor without a stated uncertainty, in its SI unit

LARGEST_CONDITION = 1e9  # of eigenvectors: responses by them then hold to 1e-7 or better


@dataclass(frozen=True)
class RecordedBed:
    """A case's bed with every sensor of the rig, and further torques of shafts that have limits.

    Attributes
    ----------
    case : Case
        Compares all that is no sensor of the controller: :func:`matching.frequency.beds.bed.bed_of` gives it then.
    inputs : tuple of str (u)
        Inputs of the rig: the dynamometers', then the others.
    sensors : tuple of str (y)
        Those of the rig.
    noise : ndarray (y,)
        Standard deviation of a sample, SI.
    shafts : tuple of str (s)
        Shafts whose torques, then twists, stand behind the sensors.
    """

    case: Case
    inputs: tuple[str, ...]
    sensors: tuple[str, ...]
    noise: np.ndarray
    shafts: tuple[str, ...]

    def at(self, values: Mapping[str, float]) -> Bed:
        """The bed at values of what is uncertain (:class:`matching.frequency.case.uncertainty.Uncertain`), SI."""
        return bed_of(self.case, values)

    def rows(self, bed: Bed, values: Mapping[str, float]) -> tuple[np.ndarray, np.ndarray]:
        """C (y + 2s, x) and D (y + 2s, u) of sensors, shafts' torques (N·m) and twists (rad)."""
        controller = list(self.case.loop.controller_sensors)
        others = compared_sensors(self.case)
        k, n = bed.commands.shape[1], len(bed.A)
        C, D = np.zeros((len(self.sensors), n)), np.zeros((len(self.sensors), k + bed.torques.shape[1]))
        for i, name in enumerate(self.sensors):
            if name in controller:
                C[i] = bed.readings[controller.index(name)]
            else:
                at = others.index(name)
                C[i], D[i, k:] = bed.compared[at], bed.compared_torques[at]
        torques, twists = self._of_shafts(bed, values, others)
        nothing = np.zeros((2 * len(self.shafts), D.shape[1]))
        return np.vstack([C, torques, twists]), np.vstack([D, nothing])

    def _of_shafts(self, bed: Bed, values: Mapping[str, float], others: list[str]) -> tuple[np.ndarray, np.ndarray]:
        """Rows (s, x), (s, x) of the shafts' torques and twists: a twist is what stiffness leaves of the torque."""
        torques, twists = [], []
        for shaft in self.case.rig.shafts:
            torque = bed.compared[others.index(shaft_torque(shaft.name))]
            first, second = (bed.compared[others.index(_speed_of(end))] for end in shaft.between)
            rate = first / (1.0 if shaft.ratio is None else shaft.ratio.value) - second
            stiffness, damping = (
                values.get(f"rig.shafts.{shaft.name}.{key}", getattr(shaft, key).value)
                for key in ("stiffness", "damping")
            )
            torques.append(torque)
            twists.append((torque - damping * rate) / stiffness)
        return np.array(torques), np.array(twists)

    def response(self, values: Mapping[str, float], frequencies: np.ndarray) -> np.ndarray:
        """Responses (f, y, u) of the sensors to the inputs, dead time of the commands included.

        A command varies linearly between samples in a recording, so the half sample of hold that the dead time of the
        loop counts is none of it.
        """
        bed = self.at(values)
        C, D = self.rows(bed, values)
        s = 2j * np.pi * frequencies
        y, k = len(self.sensors), bed.commands.shape[1]
        H = transfer(bed.A, np.hstack([bed.commands, bed.torques]), C[:y], s) + D[:y]
        H[:, :, :k] *= np.exp(-s * bed.delay)[:, None, None]
        return H


def transfer(A: np.ndarray, B: np.ndarray, C: np.ndarray, s: np.ndarray) -> np.ndarray:
    """C·(s·I − A)⁻¹·B (f, y, u) at s (f,) in rad/s, by eigenvectors where they are far enough from parallel."""
    poles, vectors = np.linalg.eig(A)
    if np.linalg.cond(vectors / np.linalg.norm(vectors, axis=0)) < LARGEST_CONDITION:
        residues = np.einsum("yx,xu->xyu", C @ vectors, np.linalg.solve(vectors, B))
        return np.tensordot(1 / (s[:, None] - poles), residues, 1)
    return C @ np.linalg.solve(s[:, None, None] * np.eye(len(A)) - A, np.broadcast_to(B, (len(s), *B.shape)))


def _speed_of(inertia: str) -> str:
    """Name of the added sensor of an inertia's speed."""
    return f"excited_speed_{inertia}"


def recorded_bed(case: Case) -> RecordedBed:
    """The bed of a case as a recording shows it."""
    rig, loop = case.rig, case.loop
    shafts = tuple(shaft.name for shaft in rig.shafts)
    ends = dict.fromkeys(end for shaft in rig.shafts for end in shaft.between)
    further = (
        *(Sensor(shaft_torque(name), "torque", name) for name in shafts),
        *(Sensor(_speed_of(end), "speed", end) for end in ends),
    )
    watched = replace(rig, sensors=(*rig.sensors, *further))
    known = set(loop.controller_sensors)
    # the inputs of these pairs are not looked at: the sensors are
    source = loop.dynamometers[0].torque_input
    compared = tuple(Compared(source, sensor.name) for sensor in watched.sensors if sensor.name not in known)
    noise = [UNKNOWN_NOISE if sensor.uncertainty is None else sensor.uncertainty for sensor in rig.sensors]
    return RecordedBed(
        replace(case, rig=watched, compared=compared),
        (*(dynamometer.torque_input for dynamometer in loop.dynamometers), *disturbing(case)),
        tuple(sensor.name for sensor in rig.sensors), np.array(noise), shafts,
    )  # fmt: skip
