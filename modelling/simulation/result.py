"""What a simulation returns, and the error it raises."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from modelling.common.display import Displayed, labelled
from modelling.common.errors import InputError


class SimulationError(InputError):
    """A state that is not finite, or steps too many to take: one line that says when and which."""


@dataclass(frozen=True)
class Simulation(Displayed):
    """Readings and states over time, all SI.

    Attributes
    ----------
    time : ndarray (t,)
        s, as given.
    readings : dict of str to ndarray (t,)
        By sensor, with all that the sensors' effects do to them.
    states : ndarray (t, x)
        Angles, speeds and further states, without the sensors' delays.
    state_names : list of str, length x
    units : dict of str to str
        SI unit of every reading.
    steps_per_second, stick_speed : float
        What the integration used; ``stick_speed`` (rad/s) is NaN where nothing sticks.
    implicit : bool
        Whether the steps were implicit ones, for a stiff model.
    integration_error : dict of str to float
        Estimated largest error of every reading that comes from the steps, as a share of its range; NaN where the steps
        were prescribed.
    """

    time: np.ndarray
    readings: dict[str, np.ndarray]
    states: np.ndarray = field(repr=False)
    state_names: list[str]
    units: dict[str, str]
    steps_per_second: float
    stick_speed: float
    implicit: bool
    integration_error: dict[str, float]

    def __getitem__(self, name: str) -> np.ndarray:
        """A reading or a state by name, (t,)."""
        return self.readings[name] if name in self.readings else self.states[:, self.state_names.index(name)]

    def to_dict(self) -> dict[str, list[float]]:
        """Time and readings as plain lists."""
        return {"time": self.time.tolist()} | {name: value.tolist() for name, value in self.readings.items()}

    def to_xarray(self) -> Any:
        """The readings over time (xarray Dataset).

        Raises
        ------
        InputError
            If xarray is not installed.
        """
        readings = {name: (["time"], value, self.units[name]) for name, value in self.readings.items()}
        return labelled(readings, {"time": (self.time, "s")})


@dataclass(frozen=True)
class Sensitivity:
    """Readings and their derivatives.

    Attributes
    ----------
    time : ndarray (t,)
    readings : ndarray (t, y)
    jacobian : ndarray (t, y, s)
        ∂reading/∂(parameter or start state ``names[s]``), SI.
    sensors, names : list of str
    """

    time: np.ndarray
    readings: np.ndarray
    jacobian: np.ndarray = field(repr=False)
    sensors: list[str]
    names: list[str]


def raise_if_failed(failed: np.ndarray, time: np.ndarray, states: Sequence[str]) -> None:
    """Raise ``SimulationError`` for the first row of ``failed`` (b, 2) that tells of a failure.

    A row holds sample and state, −1 where all went well; ``time`` (t,) in s.
    """
    rows = np.flatnonzero(failed[:, 0] >= 0)
    if rows.size:
        sample, state = failed[rows[0]]
        which = f" (parameter set {rows[0]})" if len(failed) > 1 else ""
        raise SimulationError(
            "simulation",
            f"{states[state]} is not finite at {time[sample]:g} s{which}",
            "check parameters, start and inputs, or take more steps_per_second",
        )
