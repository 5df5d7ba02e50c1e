"""What readings of a linear bed under its controller are off from what the controller's model expects."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import block_diag, null_space

from matching.frequency.case.case import Case
from matching.frequency.case.uncertainty import of_system
from matching.frequency.loop.parts import shaft_torque
from modelling.bed.delayed_bed import delayed_bed
from modelling.controller.law import ControlLaw
from modelling.linear.state_space import state_space
from modelling.model.components import Input, Sensor
from modelling.model.system import System

NOT_STEADY = 1e-9  # of the largest singular value of the balance of torques: states and inputs below it are steady
NOT_LOADED = 1e-3  # of the largest: a steady motion, or a shaft, that hardly loads the flanges


def on_inertia(inertia: str) -> str:
    """Name of the added input that acts on an inertia."""
    return f"torque_on_{inertia}"


@dataclass(frozen=True)
class BedEvents:
    """What happens on a bed, sample by sample; t samples, x states, w known torques, y readings, e events side by side.

    Attributes
    ----------
    torques : ndarray (t, x, e)
        What torques do to the states: columns of B times torques, held over a sample.
    known : ndarray (t, w, e)
        Torques as the controller knows them, N·m.
    errors : ndarray (t, y, e)
        Errors of the readings, SI.
    """

    torques: np.ndarray
    known: np.ndarray
    errors: np.ndarray


def no_events(bed: LinearBed, samples: int, count: int) -> BedEvents:
    """So many events of which none has begun."""
    law = bed.law
    return BedEvents(*(np.zeros((samples, size, count)) for size in (len(bed.A), len(law.known), len(law.sensors))))


@dataclass(frozen=True)
class LinearBed:
    """A rig with its lags as it may stand there, in deviations from a steady state; x states, k commands, y readings.

    Attributes
    ----------
    rig : System
    law : ControlLaw
    A, commands, readings : ndarray (x, x), (x, k), (y, x)
    inputs : mapping of str to ndarray (x,)
        Columns of B: every input of the rig, and a torque on every inertia as :func:`on_inertia` names it.
    shaft_torques : mapping of str to ndarray (x,)
        Rows: torque of every shaft, N·m, at its second end.
    measured_shafts : tuple of str (k)
        Whose torques the dynamometers' torque sensors read.
    delay : float
        s, from a sample to the moment its command begins to act.
    """

    rig: System
    law: ControlLaw
    A: np.ndarray
    commands: np.ndarray
    readings: np.ndarray
    inputs: Mapping[str, np.ndarray]
    shaft_torques: Mapping[str, np.ndarray]
    measured_shafts: tuple[str, ...]
    delay: float

    def torque_pair(self, shaft: str) -> np.ndarray:
        """What a torque of 1 N·m in a shaft does to the states (x,), at both its ends."""
        part = next(part for part in self.rig.shafts if part.name == shaft)
        first, second = (self.inputs[on_inertia(end)] for end in part.between)
        return second - first / (1.0 if part.ratio is None else part.ratio.value)

    def opening(self, shaft: str, samples: int) -> tuple[np.ndarray, np.ndarray]:
        """Deviations (t, y) from what is expected and readings (t, y) after a shaft that carried 1 N·m opened."""
        pair, events = self.torque_pair(shaft), no_events(self, samples, 1)
        events.torques[:, :, 0] = -pair
        opened = replace(self, A=self.A - np.outer(pair, self.shaft_torques[shaft]))
        off, read = opened.run(events)
        return off[:, :, 0], read[:, :, 0]

    def run(self, events: BedEvents) -> tuple[np.ndarray, np.ndarray]:
        """Deviations from what the controller expects and readings (t, y, e); no limits."""
        law, x = self.law, len(self.A)
        bed = delayed_bed(self.A, self.commands, np.eye(x), self.delay, law.sample_time)
        now, state = np.zeros((x, events.torques.shape[2])), np.zeros((len(law.A), events.torques.shape[2]))
        unlimited = np.array(np.inf)
        sent = [np.zeros((len(law.dynamometers), now.shape[1]))] * (bed.delay + 2)
        off, read = np.empty_like(events.errors), np.empty_like(events.errors)
        for n, (torques, known, errors) in enumerate(
            zip(events.torques, events.known, events.errors, strict=True)
        ):  # fmt: skip
            read[n] = self.readings @ now + errors
            off[n] = read[n] - law.E @ state
            newest, state = law.step(state, read[n], known, unlimited)
            sent = [newest, *sent[:-1]]
            now = bed.whole @ now + bed.new @ sent[bed.delay] + bed.old @ sent[bed.delay + 1] + bed.torques @ torques
        return off, read

    def carried(self, shafts: tuple[str, ...]) -> np.ndarray:
        """Torques (s, k) of shafts by flange torques of 1 N·m in steady motion, least squares over the inputs.

        The dynamometers' torque sensors are the first k readings.
        """
        torques = np.stack([self.shaft_torques[name] for name in shafts]) @ self._steady[: len(self.A)]
        carried: np.ndarray = torques @ self._of_flanges
        return np.where(np.abs(carried) > NOT_LOADED * np.abs(carried).max(initial=0.0), carried, 0.0)

    def balancing(self) -> dict[str, np.ndarray]:
        """Torques (k,) of every input of the rig, N·m, that flange torques of 1 N·m balance in steady motion."""
        rows = self._steady[len(self.A) :] @ self._of_flanges
        return {part.name: row for part, row in zip(self.rig.inputs, rows, strict=True)}

    @cached_property
    def _steady(self) -> np.ndarray:
        """Steady motions: states, then torques of the rig's inputs, of each (x + u, m)."""
        driven = np.stack([self.inputs[part.name] for part in self.rig.inputs], axis=1)
        balance = np.hstack([self.A, driven])  # no state changes
        steady: np.ndarray = null_space(balance / np.linalg.norm(balance, axis=1, keepdims=True), NOT_STEADY)
        return steady

    @cached_property
    def _of_flanges(self) -> np.ndarray:
        """How much of each steady motion (m, k) makes flange torques of 1 N·m."""
        flanges = self.readings[: self.commands.shape[1]] @ self._steady[: len(self.A)]
        inverse: np.ndarray = np.linalg.pinv(flanges, rcond=NOT_LOADED)
        return inverse


def linear_bed(case: Case, law: ControlLaw, values: Mapping[str, float]) -> LinearBed:
    """The bed of a case with some ``values`` other than the case's, named as those that are uncertain.

    Raises
    ------
    InputError
        If the rig cannot be made linear.
    """
    loop, dynamometers = case.loop, case.loop.dynamometers
    k = len(dynamometers)
    rig = case.rig.with_values(of_system(values, case.rig))
    more = replace(
        rig,
        inputs=(*rig.inputs, *(Input(on_inertia(part.name), part.name) for part in rig.inertias)),
        sensors=(*rig.sensors, *(Sensor(shaft_torque(part.name), "torque", part.name) for part in rig.shafts)),
    )
    space = state_space(more)
    lag, sensor_lag = (values.get(f"loop.{name}", loop[name]) for name in ("inverter_lag", "torque_sensor_lag"))
    n = len(space.A)
    A = block_diag(space.A, -np.eye(k) / lag, -np.eye(k) / sensor_lag)
    commands = np.zeros((n + 2 * k, k))
    readings = np.stack([np.pad(space.output(name), (0, 2 * k)) for name in law.sensors])
    for j, dynamometer in enumerate(dynamometers):
        gain = values.get(f"dynamometers.{dynamometer.name}.torque_gain", 1.0)
        A[:n, n + j] = gain * space.input(dynamometer.torque_input)
        A[n + k + j, :n] = space.output(dynamometer.torque_sensor) / sensor_lag
        commands[n + j, j] = 1 / lag
        readings[j] = np.eye(n + 2 * k)[n + k + j]
    readings *= np.array([[values.get(f"sensors.{name}.gain", 1.0)] for name in law.sensors])
    return LinearBed(
        rig, law, A, commands, readings,
        {name: np.pad(space.input(name), (0, 2 * k)) for name in space.inputs},
        {part.name: np.pad(space.output(shaft_torque(part.name)), (0, 2 * k)) for part in rig.shafts},
        tuple(sensor.of for dynamometer in dynamometers for sensor in rig.sensors
              if sensor.name == dynamometer.torque_sensor),
        loop.command_delay(values.get("loop.dead_time")),
    )  # fmt: skip
