"""How near a simple residual vehicle comes to the vehicle's own, its quantities fitted, and what it lacks most."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from matching.frequency.case.case import Case
from modelling.bed.residual_vehicle import cut
from modelling.bed.simple_vehicle import parts_left_out, without_part
from modelling.linear.state_space import state_space
from modelling.model.mirror import mirror_image
from modelling.model.system import System

POINTS = 120  # of the band, midpoints of equal parts of its logarithm
SMALLEST, LARGEST = 1e-12, 1e12  # SI, of a quantity whose range is open on that side
STEP = 1e-3  # of a logarithm, of finite differences: the response has to change by more than rounding


@dataclass(frozen=True)
class SimpleVehicle:
    """The user's residual vehicle against the vehicle's own; errors are response errors of vehicle to vehicle.

    Attributes
    ----------
    as_written, fitted : float
        With the values of its file, and with those that were fitted within their ranges.
    values : dict of str to (float, float)
        What was fitted: as written and as fitted, SI.
    left_out : tuple of (str, float)
        Parts of the vehicle that it lacks, and how near it would come to a vehicle without that part: what costs most
        first.
    """

    as_written: float
    fitted: float
    values: dict[str, tuple[float, float]]
    left_out: tuple[tuple[str, float], ...]

    def to_dict(self) -> dict[str, Any]:
        """As ``result.json`` holds it."""
        return {
            "error_as_written": self.as_written, "error_fitted": self.fitted,
            "values": {name: list(pair) for name, pair in self.values.items()}, "left_out": dict(self.left_out),
        }  # fmt: skip

    def sentence(self) -> str:
        """What it says, for the notes of a result."""
        near = f"the residual vehicle of the case comes within a response error of {self.fitted:.3g} of the vehicle"
        if self.values:
            near += f" ({self.as_written:.3g} as written; what was fitted is a compensation, not the car)"
        if not self.left_out:
            return near
        place, error = self.left_out[0]
        part = place.removeprefix("effects.")
        return f"{near}; of what it leaves out {part} costs most: a vehicle without it would be met within {error:.3g}"


def fitted_simple_vehicle(case: Case) -> tuple[Case, SimpleVehicle | None]:
    """The case with the ranges of its residual vehicle fitted to the vehicle's responses; as it is without one."""
    simple = case.simple_vehicle
    if simple is None:
        return case, None
    low, high = np.log(case.band)
    frequencies = np.exp(low + (high - low) * (np.arange(POINTS) + 0.5) / POINTS)
    wanted = responses(case.vehicle, case, frequencies)
    fitted, names = _fitted(simple, case, frequencies, wanted)
    lacking = []
    for place in parts_left_out(simple, cut(case.vehicle, case.rig)):
        other = responses(without_part(case.vehicle, place), case, frequencies)
        nearest, _ = _fitted(fitted, case, frequencies, other)
        lacking.append((place, error_of(nearest, case, frequencies, other)))
    nearness = SimpleVehicle(
        error_of(simple, case, frequencies, wanted),
        error_of(fitted, case, frequencies, wanted),
        {name: (simple.parameters[name].value, fitted.parameters[name].value) for name in names},
        tuple(sorted(lacking, key=lambda row: row[1])),
    )
    return replace(case, simple_vehicle=fitted, residual_vehicle=cut(fitted, case.rig)), nearness


def _fitted(
    simple: System, case: Case, frequencies: np.ndarray, wanted: np.ndarray
) -> tuple[System, list[str]]:  # fmt: skip
    """The vehicle with its ranges beyond the cut fitted to responses (f, h), and their names; mirror images alike."""
    beyond = {name for system in cut(simple, case.rig).parts for name in system.parameters}
    ranged = {name: quantity for name, quantity in simple.uncertain.items() if name in beyond and quantity.value > 0}
    order = list(ranged)
    names = [name for i, name in enumerate(order) if mirror_image(name, simple) not in order[:i]]
    if not names:
        return simple, names
    lower = np.log([max(ranged[name].lower or 0.0, SMALLEST) for name in names])
    upper = np.log([ranged[name].upper or LARGEST for name in names])

    def at(logarithms: np.ndarray) -> System:
        values = dict(zip(names, np.exp(logarithms).tolist(), strict=True))
        return simple.with_values(values | {mirror_image(name, simple): value for name, value in values.items()})

    def differences(logarithms: np.ndarray) -> np.ndarray:
        ratio = np.log(responses(at(logarithms), case, frequencies) / wanted).ravel()
        return np.concatenate([ratio.real, ratio.imag])

    start = np.clip(np.log([ranged[name].value for name in names]), lower, upper)
    return at(least_squares(differences, start, bounds=(lower, upper), diff_step=STEP).x), names


def responses(system: System, case: Case, frequencies: np.ndarray) -> np.ndarray:
    """Compared functions (f, h) of a vehicle at frequencies (f,), Hz."""
    space = state_space(system)
    s = 2j * np.pi * frequencies
    shape = (len(s), *space.B.shape)
    states = np.linalg.solve(s[:, None, None] * np.eye(len(space.A)) - space.A, np.broadcast_to(space.B, shape))
    rows = [space.outputs.index(pair.sensor) for pair in case.compared]
    return (space.C @ states + space.D)[:, rows, [space.inputs.index(pair.input) for pair in case.compared]]


def error_of(system: System, case: Case, frequencies: np.ndarray, wanted: np.ndarray) -> float:
    """Response error of a vehicle against responses (f, h) at frequencies (f,), Hz."""
    return float(np.sqrt(np.mean(np.abs(np.log(responses(system, case, frequencies) / wanted)) ** 2)))
