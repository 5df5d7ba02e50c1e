"""Vehicles and beds in time: rows of one batch on the nonlinear models, sample by sample, whatever runs them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from modelling.bed.bed import ControlLaw
from modelling.bed.nonlinear import NonlinearBeds
from modelling.simulation.stepping import SimulationError

TOO_LARGE = 1e9  # a state beyond this has left every bed
SAMPLES_BETWEEN_CHECKS = 20


class Running(Protocol):
    """What gives the commands of a batch of beds, with a state of its own."""

    def commands(self, sample: int, readings: np.ndarray, flanges: np.ndarray) -> np.ndarray:
        """Commands (k, b), N·m from the operating point, at a sample.

        Parameters
        ----------
        readings : ndarray (y, b)
            All the model's sensors, exact.
        flanges : ndarray (f, b)
            Torques of the flanges behind their lag.
        """

    def restart(self, which: np.ndarray) -> None:
        """Back to rest on some beds (b,), bool: what ran away is out of the batch."""


@dataclass
class RunningLaw:
    """A control law on every bed of a batch, in deviations from where it was switched on.

    Attributes
    ----------
    law : ControlLaw
    rows : sequence of int
        The law's sensors among the model's.
    flanges : sequence of int (f)
        Which of the law's readings are torques of flanges.
    known : ndarray (t, w, b)
        Torques as the controller knows them, N·m.
    limits : ndarray (k, 1), ndarray (k, 1)
        Least and largest commands, N·m.
    sensing : callable, optional
        What the sensors make of the exact readings (y, b); nothing is wrong without it.
    """

    law: ControlLaw
    rows: Sequence[int]
    flanges: Sequence[int]
    known: np.ndarray
    limits: tuple[np.ndarray, np.ndarray]
    sensing: Callable[[np.ndarray], np.ndarray] | None = None
    state: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        self.state = np.zeros((self.law.states, self.known.shape[2]))

    def commands(self, sample: int, readings: np.ndarray, flanges: np.ndarray) -> np.ndarray:
        """See :class:`Running`."""
        own = readings[list(self.rows)]
        own[list(self.flanges)] = flanges
        own = own if self.sensing is None else self.sensing(own)
        sent, self.state = self.law.step(self.state, own, self.known[sample], self.limits)
        return sent

    def restart(self, which: np.ndarray) -> None:
        """See :class:`Running`."""
        self.state = np.where(which, 0.0, self.state)


@dataclass(frozen=True)
class Motion:
    """What a batch did; t samples, y readings, k dynamometers, x states, b rows.

    Attributes
    ----------
    readings, commands : ndarray (t, y, b), (t, k, b)
        Less their values at the operating point; no command of what runs without a controller.
    states : ndarray (t, x) or None
        Of the first row, absolute, where they were asked for.
    lost : ndarray (b,)
        Which rows grew out of bounds.
    """

    readings: np.ndarray
    commands: np.ndarray
    states: np.ndarray | None
    lost: np.ndarray


def run(
    beds: NonlinearBeds, drives: np.ndarray, rows: Sequence[int], controller: Running | None = None, *,
    keep_states: bool = False,
) -> Motion:  # fmt: skip
    """Step a batch over torques (t, d, b) in N·m that vary evenly between samples; ``rows`` of its sensors are kept."""
    count, size, k = len(drives), drives.shape[2], beds.dynamometers
    x, none = beds.start, np.zeros((k, size))
    read, sent = np.empty((count, len(rows), size)), np.empty((count, k, size))
    states = np.empty((count, len(x))) if keep_states else None
    gone, chosen = np.zeros(size, bool), list(rows)
    for n, now in enumerate(drives):
        readings = beds.read(x, now)
        read[n] = readings[chosen]
        if states is not None:
            states[n] = x[:, 0]
        u = none if controller is None else controller.commands(n, readings, beds.lagged(x))
        sent[n] = u
        x = beds.advance(x, u, now, drives[min(n + 1, count - 1)])
        if n % SAMPLES_BETWEEN_CHECKS == 0 and (lost := ~(np.abs(x).max(axis=0) < TOO_LARGE)).any():
            gone |= lost
            if gone.all():
                break
            x = np.where(gone, beds.start, x)
            if controller is not None:
                controller.restart(gone)
    gone |= ~(np.abs(x).max(axis=0) < TOO_LARGE)
    return Motion(read, sent, states, gone)


def stacked(torques: Sequence[Mapping[str, np.ndarray]], names: Sequence[str]) -> np.ndarray:
    """Torques (t, d, b) by name of every row; 0 where one is not given."""
    count = max(len(torque) for row in torques for torque in row.values())
    stack = np.zeros((count, len(names), len(torques)))
    for i, name in enumerate(names):
        for j, by_name in enumerate(torques):
            stack[:, i, j] = by_name.get(name, 0.0)
    return stack


def grown(seconds: float) -> SimulationError:
    """The error of a motion that left all bounds within so many seconds."""
    return SimulationError("simulation", f"the motion grows out of bounds within {seconds:g} s", "the loop is unstable")
