"""Whether a time column without a unit can be in seconds: by the model's frequencies, and by the recorded motion."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from modelling.common.errors import InputError
from modelling.measurement.rigid_body import as_one_rigid_body
from modelling.model.system import System

SHORTER_UNITS = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}  # s
LONGEST_STEP = 1.0  # s: sampled more slowly, no drivetrain shows how it moves
CERTAIN = 5.0  # standard errors at least of the inertia that the recording shows
BLOCKS = (20, 60, 200)  # parts of a recording over which the momentum is balanced
BETWEEN_UNITS = math.sqrt(1e3)  # a factor nearer to another unit's than to one


def check_seconds(time: np.ndarray, channels: Mapping[str, np.ndarray], system: System, source: str) -> None:
    """Check that times (t,), read as seconds, fit the model and what was recorded with them, channels (t,) in SI.

    Raises
    ------
    InputError
        If the steps are too long to show the model's slowest shaft, if the recorded torques accelerate the inertias a
        thousand times faster or more than the recorded motion says, or if neither tells and a step is a second or
        more. Names the unit that fits.
    """
    step = float(np.median(np.diff(time)))
    where = f"{source}: column 'time'"
    frequencies = _shaft_frequencies(system)
    if frequencies and step > 0.5 / min(frequencies):
        for unit, seconds in SHORTER_UNITS.items():
            if step * seconds <= 0.5 / min(frequencies):
                reason = f"steps of {step:g} s cannot show the model's {min(frequencies):.3g} Hz"
                raise InputError(where, f"has no unit, and {reason}", _remedy(unit))
    factor = _time_factor(time, channels, system)
    if factor is not None:
        for unit, seconds in SHORTER_UNITS.items():
            if 1 / BETWEEN_UNITS < factor * seconds < BETWEEN_UNITS:
                reason = f"read as seconds, the inertias follow their torques some {1 / seconds:g} times too slowly"
                raise InputError(where, f"has no unit, and {reason}", _remedy(unit))
    elif step >= LONGEST_STEP:
        right = "write its unit: 'time [s]', 'time [ms]' or 'time [us]'"
        raise InputError(where, f"has no unit, and steps of {step:g} s are long for a drivetrain", right)


def _remedy(unit: str) -> str:
    return f"it is probably in {unit}: write 'time [{unit}]' (or 'time [s]' if it is in seconds)"


def _shaft_frequencies(system: System) -> list[float]:
    """Frequency in Hz of each shaft with its two inertias alone, √(k·(1/J₁ + 1/J₂))/2π.

    It is never below the lowest mode of the drivetrain, and near enough to it to tell milliseconds from seconds.
    """
    inertias = {part.name: part.J.value for part in system.inertias}
    frequencies = []
    for shaft in system.shafts:
        first, second = (inertias.get(name, 0.0) for name in shaft.between)
        if first > 0 and second > 0 and shaft.stiffness.value > 0:
            first *= shaft.ratio.value**2 if shaft.ratio else 1.0  # reflected to the second's side
            frequencies.append(math.sqrt(shaft.stiffness.value * (1 / first + 1 / second)) / (2 * math.pi))
    return frequencies


def _time_factor(time: np.ndarray, channels: Mapping[str, np.ndarray], system: System) -> float | None:
    """How many times too long the recorded times are for the motion; None where nothing tells.

    The balance of momentum of the whole drivetrain as one rigid body, over parts of the recording: the integral of the
    torques is inertia times change of speed plus viscous, dry and constant torque. Where time is too long by a factor,
    so are the integral and with it the fitted inertia; with speeds from angles, by the factor's square.
    """
    best, factor = CERTAIN, None
    for body in as_one_rigid_body(time, channels, system):
        for count in BLOCKS:
            inertia, certainty = _fitted_inertia(time, body.torque, body.speed, count)
            if certainty > best and inertia > 0:
                best, factor = certainty, (inertia / body.inertia) ** (1 / body.order)
    return factor


def _fitted_inertia(time: np.ndarray, torque: np.ndarray, speed: np.ndarray, count: int) -> tuple[float, float]:
    """Inertia (kg·m²) that speeds and torques (t,) show over ``count`` parts, and over its standard error."""
    width = len(time) // (count + 1)
    if width < 3:
        return 0.0, 0.0
    steps = np.diff(time)

    def integral(values: np.ndarray) -> np.ndarray:
        return np.append(0.0, np.cumsum(0.5 * (values[1:] + values[:-1]) * steps))

    ends = np.arange(0, width * (count + 1), width)
    columns = [np.diff(speed[ends]), np.diff(integral(speed)[ends]), np.diff(integral(np.sign(speed))[ends])]
    columns.append(np.diff(time[ends]))
    matrix = np.stack([column / (np.linalg.norm(column) or 1.0) for column in columns], axis=1)
    impulse = np.diff(integral(torque)[ends])
    solution, _, rank, _ = np.linalg.lstsq(matrix, impulse, rcond=1e-9)
    free = len(impulse) - rank
    norm = float(np.linalg.norm(columns[0]))
    if free < 5 or norm == 0:
        return 0.0, 0.0
    residual = impulse - matrix @ solution
    error = math.sqrt(float(residual @ residual) / free * float(np.linalg.pinv(matrix.T @ matrix)[0, 0]))
    return float(solution[0]) / norm, float(solution[0]) / error if error > 0 else math.inf
