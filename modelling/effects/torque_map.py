"""The torque map of an engine: what its input, a pedal, makes at the speed of its inertia."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, TypeVar

import numpy as np
from sympy import Function, Integer

from modelling.effects.effect import EquationBuilder, InputPath, Kind, Parameter, Symbols

MOST_SPEEDS, MOST_PEDALS = 24, 12
AXES = {"speed": ("rad/s", MOST_SPEEDS), "pedal": ("1", MOST_PEDALS)}
TORQUE = "torque"
Value = TypeVar("Value")


class TorqueMap(Kind):
    """The input is a pedal, 0 to 1; the torque on its inertia is a table over the speed of the inertia and the pedal.

    ``speed`` and ``pedal`` are lists that rise, ``torque`` has a row for each speed, with a value for each pedal. The
    torque is bilinear between the points and constant beyond them. Other effects at the input act on the torque that
    the map gives; a dead time makes the pedal late.
    """

    kind = "torque_map"
    words = "makes a torque by a map over speed and pedal"
    tables = ("inputs",)
    arrays = tuple(AXES)
    matrices = (TORQUE,)
    parameters = {
        **{f"speed_{i}": Parameter("rad/s", optional=True) for i in range(1, MOST_SPEEDS + 1)},
        **{f"pedal_{j}": Parameter("1", 0.0, 1.0, optional=True) for j in range(1, MOST_PEDALS + 1)},
        **{
            f"{TORQUE}_{i}_{j}": Parameter("N*m", optional=True)
            for i in range(1, MOST_SPEEDS + 1)
            for j in range(1, MOST_PEDALS + 1)
        },
    }
    state_dependent = True
    pedal = True
    sought = False  # whether an input is a pedal is known

    def input(self, path: InputPath, p: Symbols, assembly: EquationBuilder) -> None:
        speeds, pedals = axis_values(p, "speed"), axis_values(p, "pedal")
        rows, columns = range(1, len(speeds) + 1), range(1, len(pedals) + 1)
        torques = (p[f"{TORQUE}_{i}_{j}"] for i in rows for j in columns)
        speed = assembly.motions[path.on].speed
        path.value = MapTorque(speed, path.value, Integer(len(speeds)), *speeds, *pedals, *torques)

    def fault(self, at: str, values: Mapping[str, float]) -> str:
        axes = {axis: axis_values(values, axis) for axis in AXES}
        for axis, points in axes.items():
            if len(points) < 2:
                return f"needs a list {axis} of two values at least"
            if not all(low < high for low, high in pairwise(points)):
                return f"the values of {axis} do not increase"
        rows, wide = len(axes["speed"]), len(axes["pedal"])
        if sum(key.startswith(f"{TORQUE}_") for key in values) != rows * wide or any(
            f"{TORQUE}_{i}_{j}" not in values for i in range(1, rows + 1) for j in range(1, wide + 1)
        ):
            return f"torque needs {rows} rows, one a speed, of {wide} values, one a pedal"
        return ""


def axis_values(values: Mapping[str, Value], axis: str) -> list[Value]:
    """The points of ``speed`` or ``pedal`` among the parameters of a map, in their order."""
    count = sum(re.fullmatch(rf"{axis}_\d+", key) is not None for key in values)
    return [values[f"{axis}_{i}"] for i in range(1, count + 1)]


class MapTorque(Function):  # type: ignore[misc]
    """The torque of a map, N·m: arguments are speed, pedal, the number of speeds, speeds, pedals, torques row by row.

    It stays one symbol in equations; :func:`modelling.equations.casadi_code.to_casadi` knows what it is.
    """

    is_real = True

    def _latex(self, printer: Any) -> str:
        speed, pedal = (printer.doprint(part) for part in self.args[:2])
        return rf"M\left({speed}, {pedal}\right)"


# --- The same in numbers: what a driver who knows the map needs.


@dataclass(frozen=True)
class PedalMap:
    """A torque map in numbers; n speeds, m pedals.

    Attributes
    ----------
    speeds, pedals : ndarray (n,), (m,)
        rad/s and 1, rising.
    torques : ndarray (n, m)
        N·m.
    """

    speeds: np.ndarray
    pedals: np.ndarray
    torques: np.ndarray

    @classmethod
    def of(cls, values: Mapping[str, float]) -> PedalMap:
        """From the parameters of an effect, SI by key."""
        speeds, pedals = (np.array(axis_values(values, axis), dtype=float) for axis in AXES)
        rows = [[values[f"{TORQUE}_{i + 1}_{j + 1}"] for j in range(len(pedals))] for i in range(len(speeds))]
        return cls(speeds, pedals, np.array(rows, dtype=float))

    def over_pedal(self, speed: float) -> np.ndarray:
        """Torque (m,) of each of the ``pedals`` at a speed, N·m."""
        return np.array([np.interp(speed, self.speeds, column) for column in self.torques.T])

    def torque(self, speed: float, pedal: float) -> float:
        """N·m."""
        return float(np.interp(pedal, self.pedals, self.over_pedal(speed)))

    def torques_at(self, speed: np.ndarray, pedal: np.ndarray) -> np.ndarray:
        """Torque (t,), N·m, at speeds (t,) in rad/s and pedals (t,)."""
        columns = [np.interp(speed, self.speeds, column) for column in self.torques.T]
        total = columns[0].copy()
        for low, high, first, last in zip(self.pedals, self.pedals[1:], columns, columns[1:], strict=False):
            total += (last - first) * np.clip((pedal - low) / (high - low), 0.0, 1.0)
        return total

    def pedal(self, speed: float, torque: float) -> float:
        """The least pedal that gives a torque (N·m) at a speed; where none does, the one that comes nearest to it."""
        over = self.over_pedal(speed)
        for low, high, first, last in zip(self.pedals, self.pedals[1:], over, over[1:], strict=False):
            if min(first, last) <= torque <= max(first, last):
                return float(low if first == last else low + (high - low) * (torque - first) / (last - first))
        return float(self.pedals[int(np.abs(over - torque).argmin())])

    def slope(self, speed: float, pedal: float) -> float:
        """Derivative of the torque by the pedal, N·m; at a point of the map the mean of both sides."""
        over, ends = self.over_pedal(speed), np.clip([pedal - 1e-6, pedal + 1e-6], self.pedals[0], self.pedals[-1])
        return float(np.diff(np.interp(ends, self.pedals, over))[0] / max(np.diff(ends)[0], 1e-12))
