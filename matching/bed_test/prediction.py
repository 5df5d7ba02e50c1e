"""How far the prediction of a match holds: response errors of beds drawn from what is not known exactly."""

from __future__ import annotations

import numpy as np

from matching.frequency.beds.bed import vehicle_response
from matching.frequency.beds.closed_loop import bed_set, responses
from matching.frequency.case.case import Case
from matching.frequency.case.uncertainty import Box
from matching.frequency.loop.control_law import control_law
from matching.frequency.loop.law_action import law_action
from matching.frequency.loop.parts import parts_of

BEDS = 64  # drawn evenly
VEHICLES = 32  # the same
POINTS = 60  # frequencies over the band
SHARE = 0.95  # of the beds that have no larger error


def drawn_squares(case: Case) -> np.ndarray:
    """Mean squares (b, h) of |log(H_bed/H_vehicle)| of drawn beds against the vehicle as the case has it.

    Raises
    ------
    InputError
        If a model cannot be made linear or the controller's design has no solution.
    """
    box, law = case.uncertainty, control_law(parts_of(case))
    frequencies = np.geomspace(*case.band, POINTS)
    beds = bed_set(case, [box.at(position) for position in box.spread(BEDS)], frequencies)
    acting = law_action(law, frequencies, case.loop.controller_sensors)
    ratio = responses(beds, acting, acting.known) / vehicle_response(case, {}, frequencies)
    with np.errstate(divide="ignore", invalid="ignore"):
        squares = np.abs(np.log(ratio)) ** 2
    return np.asarray(squares.mean(axis=1))


def drawn_vehicles(case: Case, frequencies: np.ndarray) -> np.ndarray:
    """Compared functions (b, f, h) of vehicles drawn from what the case does not know of them; ``frequencies`` in Hz.

    There are none where it knows all that the rig lacks.
    """
    box = case.uncertainty.of_kind("vehicle.")
    vehicles = [vehicle_response(case, values, frequencies) for values in box_values(box, VEHICLES)]
    return np.array(vehicles).reshape(-1, len(frequencies), len(case.compared))


def box_values(box: Box, count: int) -> list[dict[str, float]]:
    """Values by name at positions that fill a box evenly; none where nothing is uncertain."""
    return [box.at(position) for position in box.spread(count)] if box.uncertain else []


def largest_expected(squares: np.ndarray) -> float:
    """Response error that 95 % of drawn beds keep below; ``squares`` (b, h) of the functions that count."""
    return float(np.sqrt(np.quantile(squares.mean(axis=1), SHARE)))
