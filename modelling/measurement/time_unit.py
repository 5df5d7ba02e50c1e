"""Whether a time column without a unit can be in seconds."""

from __future__ import annotations

import math

import numpy as np

from modelling.common.errors import InputError
from modelling.model.system import System

SHORTER_UNITS = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}  # s


def check_seconds(time: np.ndarray, system: System, source: str) -> None:
    """Check that times (t,), read as seconds, can show the model's slowest shaft at all (two samples a period).

    The frequency of a shaft is that of its two inertias alone, √(k·(1/J₁ + 1/J₂))/2π, which is never below the lowest
    mode of the drivetrain and near enough to it to tell milliseconds from seconds.

    Raises
    ------
    InputError
        If the steps are too long in seconds and would fit in a shorter unit; names that unit.
    """
    inertias = {part.name: part.J.value for part in system.inertias}
    frequencies = []
    for shaft in system.shafts:
        first, second = (inertias.get(name, 0.0) for name in shaft.between)
        if first > 0 and second > 0 and shaft.stiffness.value > 0:
            first *= shaft.ratio.value**2 if shaft.ratio else 1.0  # reflected to the second's side
            frequencies.append(math.sqrt(shaft.stiffness.value * (1 / first + 1 / second)) / (2 * math.pi))
    if not frequencies:
        return
    step, longest = float(np.median(np.diff(time))), 0.5 / min(frequencies)
    if step <= longest:
        return
    for unit, seconds in SHORTER_UNITS.items():
        if step * seconds <= longest:
            raise InputError(
                f"{source}: column 'time'",
                f"has no unit, and steps of {step:g} s cannot show the model's {min(frequencies):.3g} Hz",
                f"it is probably in {unit}: write 'time [{unit}]' (or 'time [s]' if it is in seconds)",
            )
