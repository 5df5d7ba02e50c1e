"""How much the response error of the controlled bed depends on each quantity that is not known exactly."""

from __future__ import annotations

import numpy as np

from matching.fmu.controller import exported_controller
from matching.frequency.beds.closed_loop import Action, bed_set, responses
from matching.frequency.case.case import Case
from modelling.controller.law import ControlLaw

STEP = 0.1  # of a half-width, for central differences
POINTS = 60  # frequencies over the band


def law_action(law: ControlLaw, frequencies: np.ndarray, readings: tuple[str, ...]) -> Action:
    """Commands of a control law for ``readings`` and for known torques at frequencies (f,), Hz."""
    z = np.exp(2j * np.pi * frequencies * law.sample_time)
    n, own = len(law.A), law.A + law.Bs @ law.K
    keep = np.eye(n) - law.L @ law.E
    of_readings = own @ law.L + law.By + law.Bs @ law.Dy
    of_known = law.Bw + law.Bs @ law.Dw
    drive = np.hstack([of_readings, of_known])
    states = np.linalg.solve(z[:, None, None] * np.eye(n) - own @ keep, np.broadcast_to(drive, (len(z), *drive.shape)))
    y = len(law.sensors)
    commands = law.K @ keep @ states
    acting = np.zeros((len(z), len(law.dynamometers), len(readings)), complex)
    acting[:, :, [readings.index(name) for name in law.sensors]] = commands[:, :, :y] + law.K @ law.L + law.Dy
    return Action(acting, commands[:, :, y:] + law.Dw, law.known)


def error_weights(case: Case) -> np.ndarray:
    """Matrix W (p, p) with mean square response error = θᵀ·W·θ for small offsets θ, in half-widths of the case's box.

    The controller stays as it is, the bed is off, and the vehicle has the bed's specimen.

    Raises
    ------
    InputError
        If a model cannot be made linear or the controller's design has no solution.
    """
    box, loop = case.uncertainty, case.loop
    p = len(box.uncertain)
    low, high = np.log(case.band)
    frequencies = np.exp(low + (high - low) * (np.arange(POINTS) + 0.5) / POINTS)
    positions = STEP * np.vstack([np.eye(p), -np.eye(p)])
    beds = bed_set(case, [box.at(position) for position in positions], frequencies)
    acting = law_action(exported_controller(case).law, frequencies, loop.controller_sensors)
    ratio = responses(beds, acting, acting.known) / beds.vehicle
    slopes = np.log(ratio[:p] / ratio[p:]) / (2 * STEP)
    flat = slopes.reshape(p, -1)
    return np.real(flat.conj() @ flat.T) / flat.shape[1]
