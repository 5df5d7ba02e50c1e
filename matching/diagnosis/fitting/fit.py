"""Fits by output error: free simulation against measurement, weighted by the sensors' uncertainty, within bounds.

Gauss–Newton with a trust region on the scaled variables; the bounded linear problem of each step is SciPy's.
The Jacobian comes from finite differences run as one batch, and is kept while it serves (a chord method).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import solve_triangular
from scipy.optimize import lsq_linear

from matching.diagnosis.data.segments import Data
from matching.diagnosis.fitting import batch_simulation as runs
from modelling.equations.assembly import STICK_SPEED
from modelling.equations.compiled import Model, compiled
from modelling.model.system import System

DIVERGED = 1e100  # of a slope, in times the noise: no parameter's influence, a simulation that ran away


@dataclass
class Problem:
    """One system, the data, and which of its parameters are free within which bounds.

    Attributes
    ----------
    system : System
    data : Data
    bounds : dict of str to (float, float)
        Free parameters, in order; states at the start of every segment are free beside them.
    steps : float
        Integration steps per second.
    stick : float
        Stick speed of dry friction, rad/s.
    anchors : list of ndarray (x,), optional
        States at the start of the segments, of which the angles that no reading tells are taken; 0 if not given.
    """

    system: System
    data: Data
    bounds: dict[str, tuple[float, float]]
    steps: float
    stick: float = 1e-3
    anchors: list[np.ndarray] | None = None
    model: Model = field(init=False)

    def __post_init__(self) -> None:
        self.model = compiled(self.system)
        self.free = list(self.bounds)
        self._where = np.array([self.model.parameters.index(name) for name in self.free], dtype=int)
        self.held = held_angles(self.system, self.model)
        nx, k = len(self.model.states), len(self.free)
        self._open = [i for i in range(nx) if i not in self.held]
        self.size = k + len(self._open) * len(self.data.segments)
        low = [bound[0] for bound in self.bounds.values()]
        high = [bound[1] for bound in self.bounds.values()]
        rest = [np.inf] * (self.size - k)
        self.lower, self.upper = np.array(low + [-v for v in rest]), np.array(high + rest)

    def pack(self, values: Mapping[str, float], starts: list[np.ndarray]) -> np.ndarray:
        """Parameter values by name and start states (x,) of the segments → variables (v,)."""
        return np.concatenate([[values[name] for name in self.free], *(start[self._open] for start in starts)])

    def unpack(self, v: np.ndarray) -> tuple[np.ndarray, list[np.ndarray]]:
        """Variables (v,) → parameter vector (p,) and start states of the segments."""
        p = self.model.p0.copy()
        p[self._where] = v[: len(self.free)]
        if STICK_SPEED in self.model.parameters:
            p[self.model.parameters.index(STICK_SPEED)] = self.stick
        starts = []
        for i, part in enumerate(np.split(v[len(self.free) :], len(self.data.segments))):
            start = np.zeros(len(self.model.states)) if self.anchors is None else self.anchors[i].copy()
            start[self._open] = part
            starts.append(start)
        return p, starts

    def residuals(self, batch: np.ndarray) -> np.ndarray:
        """Variables (b, v) → (measured − simulated)/noise (b, r); 0 where nothing was measured."""
        pairs = [self.unpack(v) for v in batch]
        p = np.array([pair[0] for pair in pairs])
        starts = [np.array(own) for own in zip(*(pair[1] for pair in pairs), strict=True)]
        out = []
        found = runs.all_readings(self.model, self.data.segments, p, starts, self.steps)
        for segment, y in zip(self.data.segments, found, strict=True):
            r = np.subtract(segment.readings, y, out=y)  # long recordings: no copy more than is needed
            r /= self.data.noise
            if not segment.counts.all():
                r[:, ~segment.counts] = 0.0
            out.append(r.reshape(len(batch), -1))
        return out[0] if len(out) == 1 else np.concatenate(out, axis=1)

    def by_sensor(self, residual: np.ndarray) -> list[np.ndarray]:
        """A residual (r,) as (t, y) of every segment."""
        out, at = [], 0
        for segment in self.data.segments:
            size = segment.readings.size
            out.append(residual[at : at + size].reshape(segment.readings.shape))
            at += size
        return out

    def simulated(self, v: np.ndarray) -> list[np.ndarray]:
        """Readings (t, y) of every segment."""
        p, starts = self.unpack(v)
        found = runs.all_readings(
            self.model, self.data.segments, p[None], [start[None] for start in starts], self.steps
        )
        return [own[0] for own in found]

    def states(self, v: np.ndarray) -> list[np.ndarray]:
        """States (t, x) of every segment."""
        p, starts = self.unpack(v)
        return runs.all_states(self.model, self.data.segments, p, starts, self.steps)

    @property
    def differences(self) -> np.ndarray:
        """(v,) steps of the finite differences."""
        k, n = len(self.free), self.model.n
        own = []
        for name in self.free:
            low, high = self.bounds[name]
            value = abs(self._value(name))
            own.append(1e-3 * (min(high - low, value) if value else min(high - low, 1.0)) or 1e-6)
        start = np.array([1e-6 if i < n else 1e-4 for i in self._open])
        return np.concatenate([own, *[start] * len(self.data.segments)])[: k + len(start) * len(self.data.segments)]

    def _value(self, name: str) -> float:
        return float(self.model.p0[self.model.parameters.index(name)])

    def jacobian(
        self,
        v: np.ndarray,
        r: np.ndarray,
        columns: np.ndarray | None = None,
        chunk: int = 8,
        central: np.ndarray | None = None,
    ) -> np.ndarray:
        """Derivatives (r, c) of the residuals by the variables in ``columns`` (default all), by forward differences or
        by central ones with steps of at most ``central`` (v,)."""
        columns = np.arange(self.size) if columns is None else columns
        h = self.differences.copy()
        k = len(self.free)
        h[:k] = np.where(v[:k] != 0, 1e-3 * np.minimum(np.abs(v[:k]), self.upper[:k] - self.lower[:k]), h[:k])
        if central is not None:
            h = np.minimum(np.abs(h), central)
        h = np.where(v + h > self.upper, -h, h)
        out = np.zeros((len(r), len(columns)), order="F")
        # a start state moves its own segment only: the same state of all segments is moved in one run
        groups: dict[int, list[int]] = {}
        for c, j in enumerate(columns):
            groups.setdefault(int(j) if j < k else k + (int(j) - k) % max(len(self._open), 1), []).append(c)
        ends = np.cumsum([0, *(segment.readings.size for segment in self.data.segments)])
        together = list(groups.values())
        for first in range(0, len(together), chunk):
            own = together[first : first + chunk]
            batch = np.repeat(v[None], len(own), axis=0)
            for row, members in zip(batch, own, strict=True):
                row[columns[members]] += h[columns[members]]
            after = self.residuals(batch)
            before = (
                self.residuals(np.clip(2 * v - batch, self.lower, self.upper))
                if central is not None
                else [r] * len(own)
            )
            for moved, back, members in zip(after, before, own, strict=True):
                for c in members:
                    j = columns[c]
                    segment = (j - k) // len(self._open) if j >= k else None
                    part = slice(None) if segment is None else slice(ends[segment], ends[segment + 1])
                    width = h[j]
                    if central is not None:
                        width = v[j] + h[j] - np.clip(v[j] - h[j], self.lower[j], self.upper[j])
                    np.subtract(moved[part], back[part], out=out[part, c])
                    out[part, c] /= width
                    if not np.isfinite(chi_square(out[part, c])):
                        out[part, c] = np.where(np.abs(out[part, c]) < DIVERGED, out[part, c], 0.0)
        return out


@dataclass(frozen=True)
class Fit:
    """A fitted problem.

    Attributes
    ----------
    problem : Problem
    v : ndarray (v,)
    residual : ndarray (r,)
        (measured − simulated)/noise of all segments, time by time, sensor by sensor.
    jacobian : ndarray (r, v)
    cost : float
        Sum of squares of the residual (χ²).
    """

    problem: Problem
    v: np.ndarray
    residual: np.ndarray = field(repr=False)
    jacobian: np.ndarray = field(repr=False)
    cost: float

    @property
    def values(self) -> dict[str, float]:
        """Fitted parameters by name, SI."""
        return dict(zip(self.problem.free, (float(x) for x in self.v), strict=False))

    @property
    def starts(self) -> list[np.ndarray]:
        """Start states (x,) of the segments."""
        return self.problem.unpack(self.v)[1]

    def by_sensor(self) -> list[np.ndarray]:
        """Residual (t, y) of every segment."""
        return self.problem.by_sensor(self.residual)


def solve(
    problem: Problem,
    v: np.ndarray,
    jacobian: np.ndarray | None = None,
    iterations: int = 20,
    exact: bool = True,
    rival: float = 0.0,
    noise: float = 0.0,
    held: Sequence[int] = (),
) -> Fit:
    """Least squares from the variables v (v,).

    Parameters
    ----------
    jacobian : ndarray (r, v), optional
        A Jacobian to begin with, e.g. of a similar problem.
    exact : bool
        Whether to end only on a Jacobian of the point itself.
    rival : float
        χ² that another fit reached: one that stays far above it and no longer gains much is given up.
    noise : float
        χ² of another fit that is at the noise: one that stays above it, even if it went on at twice its pace, is
        given up.
    held : sequence of int
        Variables that stay where they are; their columns of the Jacobian are 0.

    Raises
    ------
    FloatingPointError
        If the start does not simulate.
    """
    v = np.clip(v, problem.lower, problem.upper)
    r = problem.residuals(v[None])[0]
    cost, fresh, radius = chi_square(r), jacobian is None, np.inf
    if not np.isfinite(cost):
        raise FloatingPointError("the simulation diverges at the start of the fit")

    def without_held(J: np.ndarray) -> np.ndarray:
        if held:  # a Jacobian of long recordings is not copied for nothing
            J = J.copy()
            J[:, list(held)] = 0.0
        return J

    J = without_held(problem.jacobian(v, r) if jacobian is None else jacobian)
    quadratic = Quadratic(J)
    last = (0, cost)  # iteration and cost when a step with a Jacobian of its own point was last taken
    for iteration in range(iterations):
        step, predicted = quadratic.step(J.T @ r, problem.lower - v, problem.upper - v, radius)
        enough = predicted < max(0.02, 2e-6 * cost)
        if enough and (fresh or not exact):
            break
        if not enough:
            tried = problem.residuals(np.clip(v + step, problem.lower, problem.upper)[None])[0]
            new = chi_square(tried)
            gain = (cost - new) / predicted
        else:
            gain, new = -1.0, np.inf
        length = quadratic.length(step)
        if iteration > 2 and rival and cost > 3 * rival and cost - min(new, cost) < 0.2 * cost:
            break
        if fresh and noise:  # the pace is what was gained since the last Jacobian
            reached = min(cost, new)
            pace = (last[1] - reached) / max(iteration - last[0], 1)
            if reached > 1.05 * noise and reached - 2 * (iterations - iteration) * pace > 1.02 * noise:
                break
            last = (iteration, reached)
        if gain > 1e-4:
            v, r, cost, moved = np.clip(v + step, problem.lower, problem.upper), tried, new, True
            radius = max(radius, 2 * length) if gain > 0.7 and np.isfinite(radius) else radius
            if gain < 0.25:
                radius = length / 2
        else:
            moved = False
            if fresh:
                radius = length / 4
                if predicted < max(0.5, 1e-5 * cost) or length < 1e-10:
                    break
        if (not fresh and not 0.7 < gain < 1.5) or (moved and fresh and gain < 0.5):
            J, fresh = without_held(problem.jacobian(v, r)), True
            quadratic = Quadratic(J)
        elif moved:
            fresh = False
    return Fit(problem, v, r, J, cost)


def chi_square(r: np.ndarray) -> float:
    """χ² of a residual (r,); infinite where the simulation diverged, be it that only the square is too large."""
    with np.errstate(over="ignore", invalid="ignore"):
        square = float(r @ r)
    return square if np.isfinite(square) else np.inf


class Quadratic:
    """The normal equations of a Jacobian, columns scaled to length 1."""

    def __init__(self, J: np.ndarray):
        products = J.T @ J
        self.scale = np.sqrt(np.diag(products))
        self.scale[self.scale == 0] = np.inf  # no influence: not moved; small is a matter of the unit
        H = products / np.outer(self.scale, self.scale)
        self.H = H + 1e-10 * np.eye(len(H))
        self.chol = np.linalg.cholesky(self.H + 1e-9 * np.eye(len(H)))

    def length(self, step: np.ndarray) -> float:
        """How far a step moves the residual."""
        moved = np.where(np.isfinite(self.scale), step * np.where(np.isfinite(self.scale), self.scale, 0.0), 0.0)
        return float(np.linalg.norm(self.chol.T @ moved))

    def step(self, gradient: np.ndarray, low: np.ndarray, high: np.ndarray, radius: float) -> tuple[np.ndarray, float]:
        """Step (v,) within bounds and radius, and the decrease of the cost that it promises."""
        used = np.isfinite(self.scale)
        scale = np.where(used, self.scale, 1.0)
        g = np.where(used, gradient / scale, 0.0)
        target = solve_triangular(self.chol, -g, lower=True)
        z = solve_triangular(self.chol.T, target)
        a, b = low * scale, high * scale
        if np.any(z < a) or np.any(z > b):
            a, b = np.minimum(a, -1e-12), np.maximum(b, 1e-12)
            z = lsq_linear(self.chol.T, target, (a, b), method="bvls").x
        z = np.where(used, z, 0.0)
        length = float(np.linalg.norm(self.chol.T @ z))
        if length > radius:
            z *= radius / length
        predicted = float(-2 * g @ z - z @ self.H @ z)
        return z / scale, predicted


def held_angles(system: System, model: Model) -> set[int]:
    """Angles that no reading tells: one coordinate of every part of the drivetrain without an angle sensor."""
    group = {part.name: {part.name} for part in system.inertias}

    def join(names: tuple[str, ...]) -> None:
        merged = set().union(*(group[name] for name in names))
        for name in merged:
            group[name] = merged

    for ends in (*(shaft.between for shaft in system.shafts), *(gear.between for gear in system.gears)):
        join(ends)
    for part in system.differentials:
        join((part.cage, part.left, part.right))
    seen = {name for sensor in system.sensors if sensor.measures == "angle" for name in group[sensor.of]}
    held, done = set(), set(seen)
    for i, coordinate in enumerate(model.coordinates):
        if coordinate in group and coordinate not in done:
            held.add(i)
            done |= group[coordinate]
    return held


def base_problem(system: System, data: Data, fine: float = 3.0) -> tuple[Problem, np.ndarray]:
    """The problem of a system as given, its uncertain quantities free, and where to begin (v,)."""
    model = compiled(system)
    bounds = {}
    for name, q in system.uncertain.items():
        if q.lower is not None and q.upper is not None and q.upper > q.lower:
            bounds[name] = (q.lower, q.upper)
    start = [first_state(system, model, data, i) for i in range(len(data.segments))]
    sampling = 1 / float(np.median(np.diff(data.segments[0].time)))
    steps, stick = runs.steps_and_stick(model, model.p0, np.array(start), sampling, fine)
    problem = Problem(system, data, bounds, steps, stick)
    return problem, problem.pack({name: q.value for name, q in system.uncertain.items()}, start)


def first_state(system: System, model: Model, data: Data, index: int) -> np.ndarray:
    """A state (x,) to begin with: measured speeds and angles where there are some, the others in step with them."""
    segment = data.segments[index]
    x, n = np.zeros(len(model.states)), model.n
    speeds: dict[int, float] = {}
    for j, sensor in enumerate(system.sensors):
        own = segment.readings[:20, j]
        own = own[np.isfinite(own)]
        if sensor.of in model.coordinates and len(own):
            i = model.coordinates.index(sensor.of)
            if sensor.measures == "speed":
                speeds[i] = float(own.mean())
            elif sensor.measures == "angle":
                x[i] = float(own[0])
    for i in range(n):
        x[n + i] = speeds.get(i, float(np.mean(list(speeds.values()))) if speeds and not system.gears else 0.0)
    return x
