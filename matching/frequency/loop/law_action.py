"""What a sampled control law does at frequencies."""

from __future__ import annotations

import numpy as np

from matching.frequency.beds.closed_loop import Action
from modelling.controller.law import ControlLaw


def law_action(law: ControlLaw, frequencies: np.ndarray, readings: tuple[str, ...]) -> Action:
    """Commands of a control law for ``readings`` and for known torques at frequencies (f,), Hz."""
    z = np.exp(2j * np.pi * frequencies * law.sample_time)
    n, unlimited = len(law.A), law.A + law.Bs @ law.K
    keep = np.eye(n) - law.L @ law.E
    of_readings = unlimited @ law.L + law.By + law.Bs @ law.Dy
    of_known = law.Bw + law.Bs @ law.Dw
    drive = np.hstack([of_readings, of_known])
    states = np.linalg.solve(
        z[:, None, None] * np.eye(n) - unlimited @ keep, np.broadcast_to(drive, (len(z), *drive.shape))
    )
    y = len(law.sensors)
    commands = law.K @ keep @ states
    acting = np.zeros((len(z), len(law.dynamometers), len(readings)), complex)
    acting[:, :, [readings.index(name) for name in law.sensors]] = commands[:, :, :y] + law.K @ law.L + law.Dy
    return Action(acting, commands[:, :, y:] + law.Dw, law.known)
