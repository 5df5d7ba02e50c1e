"""A recording as a plant: a controller runs in its shadow, and nothing that it commands has an effect."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from modelling.errors import InputError


class RecordedPlant:
    """A bed's log as a :class:`modelling.running.plant.Plant` of one row: its readings come whatever is commanded.

    What a controller would have sent is in :attr:`modelling.running.run.Motion.commands`, next to what the log holds.

    Parameters
    ----------
    readings : mapping of str to ndarray (t,)
        By sensor, one value a sample, SI.
    commands : tuple of str
        Names of the dynamometers' torque inputs.
    sample_time : float
        s.

    Raises
    ------
    InputError
        If there are no readings, or they differ in length.
    """

    inputs: tuple[str, ...] = ()
    count = 1

    def __init__(self, readings: Mapping[str, np.ndarray], commands: tuple[str, ...], sample_time: float):
        lengths = {len(each) for each in readings.values()}
        if len(lengths) != 1 or lengths == {0}:
            raise InputError("log", f"its readings have {sorted(lengths)} values", "give one value a sample of each")
        self.sensors, self.commands, self.sample_time = tuple(readings), commands, sample_time
        self._values = np.stack([np.asarray(each, float) for each in readings.values()])
        self._at = 0

    @property
    def samples(self) -> int:
        """How many there are."""
        return self._values.shape[1]

    def begin(self, torques: np.ndarray) -> None:
        """Back to the first sample."""
        self._at = 0

    def readings(self) -> np.ndarray:
        """See :class:`modelling.running.plant.Plant`; after the end the last ones stay."""
        return self._values[:, [min(self._at, self.samples - 1)]]

    def step(self, commands: np.ndarray, torques: np.ndarray, after: np.ndarray, span: float) -> None:
        """The next sample, whatever is commanded."""
        self._at += 1
