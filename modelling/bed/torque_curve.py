"""The largest torque of a dynamometer over its speed: constant up to the base speed, falling in field weakening."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from modelling.common.errors import InputError
from modelling.units import to_si

EXAMPLE = 'write [["0 1/min", 1500], ["1000 1/min", 1500], ["3000 1/min", 500]]: speed and torque, speeds rising'


@dataclass(frozen=True)
class TorqueCurve:
    """Largest torque (N·m) over speed (rad/s), straight between the points, alike for both directions.

    Below the first speed its torque holds; the last speed is the largest that is allowed.
    """

    speeds: tuple[float, ...]
    torques: tuple[float, ...]

    def at(self, speed: np.ndarray) -> np.ndarray:
        """Largest torque (b,), N·m, at speeds (b,) of any sign, rad/s; beyond the last speed that of the last."""
        return np.interp(np.abs(speed), self.speeds, self.torques)

    def used(self, torque: np.ndarray, speed: np.ndarray) -> float:
        """Largest share of it that torques (t,) at speeds (t,) take."""
        return float((np.abs(torque) / self.at(speed)).max())


def read_torque_curve(value: Any, where: str) -> TorqueCurve:
    """A curve from a list of pairs of speed and torque.

    Raises
    ------
    InputError
        Naming what is wrong.
    """
    if not isinstance(value, Sequence) or isinstance(value, str) or not value:
        raise InputError(where, "is no list of pairs", EXAMPLE)
    if not all(isinstance(pair, list) and len(pair) == 2 for pair in value):
        raise InputError(where, "is no list of pairs", EXAMPLE)
    speeds = tuple(to_si(pair[0], "rad/s", where) for pair in value)
    torques = tuple(to_si(pair[1], "N*m", where) for pair in value)
    if min(speeds) < 0 or any(b <= a for a, b in pairwise(speeds)) or not speeds[-1] > 0:
        raise InputError(where, "its speeds do not rise from 0 or more", EXAMPLE)
    if not min(torques) > 0:
        raise InputError(where, f"a torque of {min(torques):g} N·m is not possible", "greater than 0 is needed")
    return TorqueCurve(speeds, torques)
