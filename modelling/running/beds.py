"""Nonlinear beds or vehicles with their sensors, as rows of a plant."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from modelling.bed.nonlinear import NonlinearBeds
from modelling.running.sensors import Sensing, SensorErrors


class BedRows:
    """A :class:`modelling.running.plant.Plant` of nonlinear beds, or of vehicles, which have no dynamometers.

    Parameters
    ----------
    beds : NonlinearBeds
    sensors : sequence of str, optional
        Which of the model's sensors are read; all unless given.
    errors : SensorErrors, optional
        What is wrong of these; nothing unless given.
    held : sequence of str
        Inputs of a vehicle that are commands: held over a sample, without lag or delay.
    """

    def __init__(
        self, beds: NonlinearBeds, sensors: Sequence[str] | None = None, errors: SensorErrors | None = None,
        held: Sequence[str] = (),
    ):  # fmt: skip
        self.beds, self.count, self.sample_time = beds, beds.start.shape[1], beds.step
        self.sensors = tuple(beds.model.sensors if sensors is None else sensors)
        self.errors = SensorErrors.none(self.sensors, self.count) if errors is None else errors
        if self.errors.sensors != self.sensors:
            raise ValueError("errors are of other sensors")
        self.inputs, self.held = tuple(name for name in beds.drives if name not in held), tuple(held)
        self.commands = (*beds.commanded, *self.held)
        self._inputs, self._held = ([beds.drives.index(name) for name in names] for names in (self.inputs, self.held))
        self.at = [beds.model.sensors.index(name) for name in self.sensors]
        lags = dict(zip(beds.flange_sensors, beds.flange_states, strict=True))
        self.lagged = np.array([lags.get(name, -1) for name in self.sensors], dtype=np.int64)
        self._behind = np.flatnonzero(self.lagged >= 0)
        self.sensing = Sensing(self.errors, self.sample_time)
        self.begin(np.zeros((len(self.inputs), self.count)))

    def begin(self, torques: np.ndarray) -> None:
        """See :class:`modelling.running.plant.Plant`."""
        self.x, self._torques = self.beds.start.copy(), np.zeros((len(self.beds.drives), self.count))
        self._torques[self._inputs] = torques
        self.sensing.begin()

    def exact(self) -> np.ndarray:
        """What all the model's sensors (y, b) would read now without error and lag, absolute."""
        return self.beds.absolute(self.x, self._torques)

    def readings(self) -> np.ndarray:
        """See :class:`modelling.running.plant.Plant`."""
        return self.sensed(self.exact())

    def sensed(self, exact: np.ndarray) -> np.ndarray:
        """Readings (s, b) of exact ones (y, b)."""
        true = exact[self.at]
        true[self._behind] = self.x[self.lagged[self._behind]]
        return self.sensing.read(true)

    def step(self, commands: np.ndarray, torques: np.ndarray, after: np.ndarray, span: float) -> None:
        """See :class:`modelling.running.plant.Plant`; ``span`` is the sample time that the beds were made for."""
        if abs(span - self.sample_time) > 1e-9 * self.sample_time:
            raise ValueError(f"these rows step {self.sample_time:g} s, not {span:g} s")
        k, later = len(self.beds.commanded), self._torques.copy()
        self._torques[self._inputs], later[self._inputs] = torques, after
        self._torques[self._held] = later[self._held] = commands[k:] - self.beds.drive_trim[self._held]
        self.x = self.beds.advance(self.x, commands[:k] - self.beds.trim, self._torques, later)
        self._torques = later

    def idle(self) -> np.ndarray:
        """Commands (k, b) of the operating point, N·m."""
        return np.vstack([self.beds.trim, self.beds.drive_trim[self._held]])

    def stop(self, rows: np.ndarray) -> None:
        """Back to the start with rows (b,), bool: what ran away is out of the batch."""
        self.x = np.where(rows, self.beds.start, self.x)
