"""State-space models by name, without the angles that nothing depends on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from modelling.common.errors import InputError, unknown
from modelling.linear.elements import elements
from modelling.linear.linearise import deflated, linearise
from modelling.model.system import System

ROUNDING = 1e-9  # of a sensor's largest coefficient: what it reads of a free angle by rounding alone


@dataclass(frozen=True)
class StateSpace:
    """ẋ = A·x + B·u, y = C·x + D·u with named inputs and outputs; A (x, x), B (x, u), C (y, x), D (y, u), SI."""

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]

    def input(self, name: str) -> np.ndarray:
        """Column of B, (x,)."""
        return self.B[:, _index(name, self.inputs)]

    def output(self, name: str) -> np.ndarray:
        """Row of C, (x,)."""
        return self.C[_index(name, self.outputs)]


def state_space(system: System) -> StateSpace:
    """Linearise a system about its operating point, or at rest, and leave out the rigid-body angles.

    Raises
    ------
    InputError
        If rigid gears lock the system, a sensor reads an angle that is left out, or an input or sensor is delayed.
    """
    linear = linearise(system)
    if linear.input_delays.any() or linear.sensor_delays.any():
        raise InputError(
            "effects", "a dead time inside the model is not expected here", "state it in the loop of the case"
        )
    rest = deflated(linear, elements(linear.model, linear.p[None], linear.x0))
    lift = rest.lift
    model = linear.model
    angles = linear.C[:, : model.n]
    free_part = np.abs(angles @ rest.free_angles).max(axis=1, initial=0.0)
    blind = free_part > ROUNDING * np.abs(angles).max(axis=1, initial=0.0)  # relative: a stiff shaft has large entries
    if blind.any():
        name = model.sensors[int(np.argmax(blind))]
        raise InputError(f"sensors.{name}", "reads an angle that turns freely", "use a speed or a torque here")
    return StateSpace(rest.A, lift.T @ linear.B, linear.C @ lift, linear.D, tuple(model.inputs), tuple(model.sensors))


def _index(name: str, names: tuple[str, ...]) -> int:
    if name not in names:
        raise unknown(name, list(names), "")
    return names.index(name)
