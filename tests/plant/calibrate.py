"""How much an effect is worth: what remains of it after the base model has done its best, in times the noise."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import lsq_linear

from plant.bench import Take, replay
from plant.systems import Drive

SPARSE = 4  # every fourth sample is enough for regressions over thousands of them


class OutOfReach(Exception):
    """No size of this effect at this place is worth what is asked for."""


@dataclass
class Point:
    """Where the base model stands: values (SI) and what is added to the recorded start state (2n)."""

    values: dict[str, float]
    offset: np.ndarray


@dataclass
class Freedom:
    """What a fit may move round a point: columns (t·y, p) in times the noise, limits (p,) and the p steps' meaning."""

    columns: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    names: list[str]
    point: Point

    def moved(self, x: np.ndarray) -> Point:
        """The point after steps x (p,): relative ones of the values, then those of the start state."""
        count = len(self.names)
        values = {name: self.point.values[name] * (1 + step) for name, step in zip(self.names, x[:count], strict=True)}
        return Point(self.point.values | values, self.point.offset + x[count:] * _state_steps(self.point))


def _state_steps(point: Point) -> np.ndarray:
    return np.repeat([1e-3, 0.1], len(point.offset) // 2)


def stacked(readings: dict[str, np.ndarray], noise: dict[str, float]) -> np.ndarray:
    """(y, t) readings in times the noise."""
    return np.stack([readings[name][::SPARSE] / noise[name] for name in noise])


def heard(drive: Drive, take: Take, point: Point, noise: dict[str, float], dt: float) -> np.ndarray:
    """(y, t) what the base model reads at a point on the recorded inputs, in times the noise."""
    return stacked(replay(drive, take.inputs, take.start + point.offset, dt, point.values), noise)


def freedom(
    drive: Drive,
    take: Take,
    noise: dict[str, float],
    dt: float,
    written: dict[str, float],
    known: set[str] | frozenset[str] = frozenset(),
    point: Point | None = None,
) -> Freedom:
    """Finite differences round a point (default: the truth) over values that are uncertain and the start state."""
    here = point or Point(drive.values, np.zeros_like(take.start))
    base = heard(drive, take, here, noise, dt).ravel()
    columns, lower, upper = [], [], []
    names = [name for name in drive.tolerance if name not in known]
    for name in names:
        value, tolerance = here.values[name], drive.tolerance[name]
        there = Point(here.values | {name: 1.01 * value}, here.offset)
        columns.append((heard(drive, take, there, noise, dt).ravel() - base) / 0.01)
        lower.append(min(0.0, written[name] * (1 - tolerance) / value - 1))
        upper.append(max(0.0, written[name] * (1 + tolerance) / value - 1))
    for i, size in enumerate(_state_steps(here)):
        offset = here.offset.copy()
        offset[i] += size
        columns.append(heard(drive, take, Point(here.values, offset), noise, dt).ravel() - base)
    free = np.full(len(here.offset), np.inf)
    return Freedom(np.stack(columns, axis=1), np.append(lower, -free), np.append(upper, free), names, here)


def remainder(difference: np.ndarray, free: Freedom, more: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """What of a difference (y, t) the free columns (and `more`, unlimited) cannot explain, and their coefficients.

    Unlimited least squares first; only if it leaves the limits the limited problem is solved.
    """
    columns, lower, upper = free.columns, free.lower, free.upper
    if more is not None:
        columns = np.column_stack([columns, more.ravel()])
        lower, upper = np.append(lower, -np.inf), np.append(upper, np.inf)
    scale = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    unit = columns / scale
    q, r = np.linalg.qr(unit)
    target = q.T @ difference.ravel()
    x = np.linalg.lstsq(r, target, rcond=1e-12)[0]
    if np.any(x < lower * scale) or np.any(x > upper * scale):
        x = lsq_linear(r, target, (lower * scale, upper * scale), method="bvls").x
    return difference - (unit @ x).reshape(difference.shape), x / scale


def worst(left: np.ndarray) -> float:
    """Root mean square of what remains (y, t) in the worst sensor, in times the noise."""
    return float(np.sqrt(np.mean(left**2, axis=1)).max())


def find_size(
    value_of: Callable[[float], float], target: float, largest: float, first: float = 0.05, tolerance: float = 0.02
) -> float:
    """The size s at which value_of(s) is the target: secant in logarithms inside a growing bracket."""
    s, low, high = min(first, largest), None, None
    for _ in range(24):
        value = value_of(s)
        if not np.isfinite(value):
            raise OutOfReach("no finite value")
        value = max(value, 1e-9)
        if abs(value / target - 1) < tolerance:
            return s
        if value < target:
            if s >= largest:
                raise OutOfReach(f"at most {value:.3g} of {target:g} times the noise")
            low = (s, value)
        else:
            high = (s, value)
        if low and high:
            slope = np.log(high[1] / low[1]) / np.log(high[0] / low[0])
            wanted = low[0] * (target / low[1]) ** (1 / slope) if slope > 0 else 0.0
            margin = (high[0] / low[0]) ** 0.05
            s = float(np.clip(wanted, low[0] * margin, high[0] / margin)) if slope > 0 else np.sqrt(low[0] * high[0])
        else:
            s *= float(np.clip(target / value, 0.03, 30.0))
        s = min(s, largest)
        if s < 1e-9:
            raise OutOfReach("no small size")
    raise OutOfReach(f"no size found for {target:g} times the noise")
