"""How much the response error of the controlled bed depends on each quantity that is not known exactly."""

from __future__ import annotations

import numpy as np

from matching.fmu.controller import exported_controller
from matching.frequency.beds.closed_loop import bed_set, responses
from matching.frequency.case.case import Case
from matching.frequency.loop.law_action import law_action

STEP = 0.1  # of a half-width, for central differences
POINTS = 60  # frequencies over the band


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
