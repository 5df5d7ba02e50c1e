"""What is stepped in time: plant, controller and vehicle, as small protocols. A user's own simulator is a row, too."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np


@runtime_checkable
class Plant(Protocol):
    """One bed or vehicle, or ``count`` of them side by side, with a state of its own, as FMI's ``doStep`` has it.

    d inputs, y sensors, k commands, b rows; everything in SI.

    Attributes
    ----------
    inputs : tuple of str (d)
        Torques that act from outside, N·m, counted from those of its operating point; a plant without one from 0.
    sensors : tuple of str (y)
        What is read, absolute, in rad/s, N·m, rad/s² or rad.
    commands : tuple of str (k)
        Torque commands, N·m, absolute.
    count : int
        Number b of rows.
    """

    inputs: tuple[str, ...]
    sensors: tuple[str, ...]
    commands: tuple[str, ...]
    count: int

    def begin(self, torques: np.ndarray) -> None:
        """Back to the start: the operating point, or rest; ``torques`` (d, b), N·m, act now."""

    def readings(self) -> np.ndarray:
        """What the sensors read now (y, b), SI; called once a sample, before :meth:`step`."""

    def step(self, commands: np.ndarray, torques: np.ndarray, after: np.ndarray, span: float) -> None:
        """Go on by ``span``, s.

        Parameters
        ----------
        commands : ndarray (k, b)
            N·m, held over the span.
        torques, after : ndarray (d, b)
            N·m at its begin and end; straight in between.
        """


@runtime_checkable
class Controller(Protocol):
    """What gives the commands of all rows, with a state of its own.

    Attributes
    ----------
    sensors : tuple of str (y)
        Which of the plant's sensors it reads.
    known : tuple of str (w)
        Torques that it is told, N·m, absolute.
    """

    sensors: tuple[str, ...]
    known: tuple[str, ...]

    def step(self, sample: int, readings: np.ndarray, known: np.ndarray) -> np.ndarray | None:
        """Commands (k, b), N·m, for readings (y, b) and known torques (w, b) of a sample; None ends the run."""


@runtime_checkable
class Vehicle(Protocol):
    """A vehicle that others simulate, beyond the cuts; ``count`` of them side by side, each with a state of its own.

    k cuts, r inputs of its own, b rows; everything in SI.

    Attributes
    ----------
    cuts : tuple of str (k)
        Names of the dynamometers that stand for it.
    own : tuple of str (r)
        Inputs of its own, as brakes.
    count : int
    """

    cuts: tuple[str, ...]
    own: tuple[str, ...]
    count: int

    def begin(self, speed: np.ndarray, torque: np.ndarray) -> np.ndarray:
        """Back to the start: speeds (k, b) at the cuts, rad/s.

        A vehicle whose states can be set begins at ``speed`` (k, b), rad/s, under ``torque`` (k, b), N·m. Another one
        begins where it does: torques at its cuts then bring it to the rotors' speeds while these are held.
        """

    def step(self, torque: np.ndarray, own: np.ndarray, span: float) -> np.ndarray:
        """Speeds (k, b), rad/s, after ``span`` (s) under torques (k, b), N·m, and own inputs (r, b), held."""
