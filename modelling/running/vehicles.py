"""A foreign vehicle in time: with steps and lateness beside a controller, or behind the specimen's model."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from modelling.bed.foreign_vehicle import VehicleTiming
from modelling.bed.stepped import SteppedVehicle
from modelling.bed.vehicle import TURNING_INERTIA, turning_input
from modelling.running.beds import BedRows
from modelling.running.plant import Vehicle
from modelling.running.rows import vehicles_given


class TimedVehicle:
    """A vehicle with its steps and its lateness as a controller meets them, sample by sample; k cuts, b rows.

    Parameters
    ----------
    vehicle : Vehicle
    timing : VehicleTiming
    sample_time : float
        s.
    """

    def __init__(self, vehicle: Vehicle, timing: VehicleTiming, sample_time: float):
        self.vehicle, self.timing, self.sample_time = vehicle, timing, sample_time
        self._waiting: list[tuple[int, np.ndarray]] = []
        self._sample = 0
        self.speeds = np.zeros((len(vehicle.cuts), vehicle.count))

    def begin(self, speed: np.ndarray) -> None:
        """Back to the vehicle's start, and to speeds (k, b), rad/s."""
        self.speeds = self.vehicle.begin(speed, np.zeros_like(speed))
        self._waiting, self._sample = [], 0

    def read(self) -> np.ndarray:
        """Speeds (k, b), rad/s, that the controller reads now."""
        while self._waiting and self._waiting[0][0] <= self._sample:
            self.speeds = self._waiting.pop(0)[1]
        return self.speeds

    def go_on(self, torque: np.ndarray, own: np.ndarray) -> None:
        """One sample more; torques (k, b), N·m, as the controller gives them, own inputs (r, b)."""
        if self._sample % self.timing.steps == 0:
            after = self.vehicle.step(torque, own, self.timing.steps * self.sample_time)
            self._waiting.append((self._sample + 1 + self.timing.late, after))
        self._sample += 1


class ModelVehicle:
    """A residual vehicle of the product's own as a :class:`modelling.running.plant.Vehicle`, one row.

    Parameters
    ----------
    vehicle : SteppedVehicle
    cuts : sequence of str (k)
    """

    count = 1

    def __init__(self, vehicle: SteppedVehicle, cuts: Sequence[str]):
        self._vehicle, self.cuts, self.own = vehicle, tuple(cuts), vehicle.inputs
        self._x = vehicle.steady[0]

    def begin(self, speed: np.ndarray, torque: np.ndarray) -> np.ndarray:
        """Steady motion at the mean of the wheels' speeds (k, 1)."""
        wheels = self._vehicle.steady @ self._vehicle.wheel.T @ np.full(len(self.cuts), 1 / len(self.cuts))
        self._x = np.array([np.interp(float(speed.mean()), wheels, each) for each in self._vehicle.steady.T])
        return (self._vehicle.wheel @ self._x)[:, None]

    def step(self, torque: np.ndarray, own: np.ndarray, span: float) -> np.ndarray:
        """See :class:`modelling.running.plant.Vehicle`; ``span`` is a whole number of samples."""
        for _ in range(max(round(span / self._vehicle.sample_time), 1)):
            self._x = self._vehicle.drive(self._x, torque.T[:1], own.T[:1], self._vehicle.as_planned)[-1]
        return (self._vehicle.wheel @ self._x)[:, None]


class SpecimenAndVehicle:
    """The vehicle that a bed has to be like: the specimen's model, and a foreign vehicle behind its cuts.

    A :class:`modelling.running.plant.Plant`. The ends of the cut shafts turn as the vehicle says, straight over a step;
    what the vehicle says after the step corrects their angles, so no twist piles up. The torque that the vehicle gets
    is the exact mean of the shafts' torques over its step.

    Parameters
    ----------
    specimen : BedRows
        Of :func:`modelling.bed.vehicle.specimen_of`.
    vehicle : Vehicle
    ends : sequence of str (k)
        By cut the specimen's inertia that stands for the vehicle's wheel.
    steps : int
        Samples in one step of the vehicle.
    pushes : sequence of str (k)
        Inputs whose torques act on the vehicle at its cuts beside those of the shafts; none unless given.
    """

    commands: tuple[str, ...] = ()

    def __init__(
        self, specimen: BedRows, vehicle: Vehicle, ends: Sequence[str], steps: int, pushes: Sequence[str] = ()
    ):
        self.specimen, self.vehicle, self._steps = specimen, vehicle, steps
        self.sample_time, self.count, self.sensors = specimen.sample_time, specimen.count, specimen.sensors
        self._driven = [specimen.inputs.index(turning_input(name)) for name in ends]
        self._other = [at for at in range(len(specimen.inputs)) if at not in self._driven]
        self.inputs = (*(specimen.inputs[at] for at in self._other), *vehicle.own, *pushes)
        self.beds, self._r = specimen.beds, len(vehicle.own)
        states = list(specimen.beds.model.states)
        self._speed = [states.index(f"speed({name})") for name in ends]
        self._angle = [states.index(f"angle({name})") for name in ends]
        self._trim = specimen.beds.drive_trim[self._driven]

    def begin(self, torques: np.ndarray) -> None:
        """See :class:`modelling.running.plant.Plant`; the vehicle begins at the specimen's speeds."""
        given = np.zeros((len(self.specimen.inputs), self.count))
        given[self._other] = torques[: len(self._other)]
        self.specimen.begin(given)
        wanted = self.specimen.x[self._speed]
        speeds = self.vehicle.begin(wanted, np.zeros_like(wanted))
        self._before = self._now = speeds
        self._momentum, self._at = np.zeros_like(speeds), 0
        self.specimen.x[self._speed] = speeds

    def given(self) -> dict[str, Any]:
        """What C needs to step it, as it has begun."""
        others, r = len(self._other), len(self.vehicle.own)
        drives, pushes = len(self.specimen.inputs), len(self.inputs) - others - r
        pushed = [drives + r + j if pushes else -1 for j in range(len(self._driven))]
        return vehicles_given(
            self._now.T, self._steps, 0, [drives + i for i in range(r)],
            {
                "driven": np.array(self._driven), "speed_state": np.array(self._speed),
                "angle_state": np.array(self._angle), "pushed": np.array(pushed), "driven_trim": self._trim.T,
            }, TURNING_INERTIA,
        )  # fmt: skip

    def drives(self, torques: np.ndarray) -> np.ndarray:
        """Torques (t, n, b) of its inputs as C has them: those of the specimen's inputs, then the vehicle's."""
        others, drives = len(self._other), len(self.specimen.inputs)
        made = np.zeros((len(torques), drives + torques.shape[1] - others, torques.shape[2]))
        made[:, self._other], made[:, drives:] = torques[:, :others], torques[:, others:]
        return made

    def readings(self) -> np.ndarray:
        """See :class:`modelling.running.plant.Plant`."""
        return self.specimen.readings()

    def step(self, commands: np.ndarray, torques: np.ndarray, after: np.ndarray, span: float) -> None:
        """See :class:`modelling.running.plant.Plant`."""
        x, others = self.specimen.x, len(self._other)
        whole = self._steps * span
        rate = (self._now - self._before) / whole
        asked = TURNING_INERTIA * rate
        given = np.empty((2, len(self.specimen.inputs), self.count))
        given[0][self._other], given[1][self._other] = torques[:others], after[:others]
        given[:, self._driven] = asked - self._trim
        begun = x[self._speed].copy()
        self.specimen.step(np.zeros((0, self.count)), given[0], given[1], span)
        self._momentum += TURNING_INERTIA * (self.specimen.x[self._speed] - begun) - asked * span
        self._at += 1
        if self._at % self._steps:
            return
        expected = self._now + rate * whole
        own, pushed = after[others : others + self._r], after[others + self._r :]
        speeds = self.vehicle.step(self._momentum / whole + (pushed if len(pushed) else 0.0), own, whole)
        self.specimen.x[self._angle] += whole / 2 * (speeds - expected)
        self.specimen.x[self._speed] = speeds
        self._before, self._now, self._momentum = self._now, speeds, np.zeros_like(speeds)
