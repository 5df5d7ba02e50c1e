"""Fits by output error: free simulation against measurement, weighted by the sensors' uncertainty, within bounds.

Gauss–Newton with a trust region on the scaled variables. The Jacobian comes from finite differences and is kept while
the steps it gives do what they promise and converge fast (a chord method; Kelley, Iterative Methods for Linear and
Nonlinear Equations, 1995, section 5.4).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from matching.diagnosis.fitting.finite_differences import jacobian
from matching.diagnosis.fitting.problem import FitProblem
from matching.diagnosis.fitting.quadratic import Quadratic
from modelling.common.time_limit import time_is_over

ENOUGH, ENOUGH_SHARE = 0.02, 2e-6  # decrease of χ² not worth a step: absolute (0.14 σ of a parameter), share of χ²
REJECTED, REJECTED_SHARE = 0.5, 1e-5  # the same after a step from a Jacobian of the point failed
ACCEPTED_GAIN = 1e-4  # decrease over promised decrease from which a step is taken
KEEP_GAIN = (0.7, 1.5)  # in between, an old Jacobian serves on
SLOW_CHORD = 0.8  # of the decrease before: at this ratio 20 steps of an old Jacobian leave 0.8²⁰ = 1 % of what they can
# gain, above it too much; below it, e.g. where stick-slip lets χ² fall by a quarter a step, a new one saves no step
GROW_GAIN, SHRINK_GAIN, RENEW_GAIN = 0.7, 0.25, 0.5  # of the trust region; of the Jacobian
SMALLEST_DIFFERENCE = 1.0  # of the residual, in times the noise: less is lost in what the integration leaves
SHORTEST_STEP = 1e-10  # in times the noise
HOPELESS_RATIO, HOPELESS_PROGRESS = 3.0, 0.2  # given up: χ² beyond so many times the rival's, gaining less than this
PATIENCE = 2  # iterations before a fit is compared with its rival
NOISE_REACHED, NOISE_HOPED = 1.05, 1.02  # of the χ² of a fit at the noise


@dataclass(frozen=True)
class Fit:
    """A fitted problem.

    Attributes
    ----------
    problem : FitProblem
    v : ndarray (v,)
        Variables.
    residual : ndarray (r,)
        (measured − simulated)/noise, weighted, of all segments, sample by sample, sensor by sensor.
    jacobian : ndarray (r, v)
        Derivatives of the residual.
    cost : float
        Sum of squares of the residual (χ²).
    """

    problem: FitProblem
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
        """Weighted residual (t, y) of every segment."""
        return self.problem.by_sensor(self.residual)

    @cached_property
    def errors(self) -> list[np.ndarray]:
        """(measured − simulated)/noise (t, y) of every segment, not weighted."""
        return self.by_sensor() if self.problem.weighting is None else self.problem.errors(self.v)


@dataclass(frozen=True)
class FitOptions:
    """When a fit ends.

    Attributes
    ----------
    iterations : int
    exact : bool
        Whether to end only on a Jacobian of the last point.
    rival_cost : float
        χ² of another fit: one that stays far above it and hardly gains any more is given up; 0 without one.
    noise_cost : float
        χ² of another fit that is at the noise: one that would stay above it at twice its pace is given up; 0 without.
    held : sequence of int
        Variables that stay where they are; their columns of the Jacobian are 0.
    timed : bool
        Whether it ends where it is when the time of the caller's limit is over.
    """

    iterations: int = 20
    exact: bool = True
    rival_cost: float = 0.0
    noise_cost: float = 0.0
    held: Sequence[int] = ()
    timed: bool = True


def solve(
    problem: FitProblem, v: np.ndarray, known_jacobian: np.ndarray | None = None, options: FitOptions | None = None
) -> Fit:
    """Least squares from the variables v (v,).

    Parameters
    ----------
    known_jacobian : ndarray (r, v), optional
        A Jacobian to begin with, e.g. of a similar problem.
    options : FitOptions, optional

    Raises
    ------
    FloatingPointError
        If the start does not simulate.
    """
    return _Descent(problem, v, known_jacobian, options or FitOptions()).run()


class _Descent:
    """The state of a descent: variables, residual, χ², Jacobian and whether it is of this very point."""

    def __init__(self, problem: FitProblem, v: np.ndarray, known_jacobian: np.ndarray | None, options: FitOptions):
        self.problem, self.options = problem, options
        self.v = np.clip(v, problem.lower, problem.upper)
        self.residual = problem.residuals(self.v[None])[0]
        self.cost = chi_square(self.residual)
        if not np.isfinite(self.cost):
            raise FloatingPointError("the simulation diverges at the start of the fit")
        self.radius = np.inf
        self._kinked = any(effect.law.abrupt for effect in problem.system.effects)
        self._finer_steps: np.ndarray | None = None  # (v,) of the differences, once wider ones failed
        self._use(jacobian(problem, self.v, self.residual) if known_jacobian is None else known_jacobian)
        self.fresh = known_jacobian is None
        self._decrease = np.inf  # of χ² by the last step
        self._paced = (0, self.cost)  # iteration and χ² when last judged with a Jacobian of the point itself

    def _use(self, matrix: np.ndarray) -> None:
        if self.options.held:  # copied only then: recordings may be long
            matrix = matrix.copy()
            matrix[:, list(self.options.held)] = 0.0
        self.jacobian, self.quadratic = matrix, Quadratic(matrix)

    def run(self) -> Fit:
        """Iterate to the end."""
        for iteration in range(self.options.iterations):
            if (self.options.timed and time_is_over()) or not self._iterate(iteration):
                break
        return Fit(self.problem, self.v, self.residual, self.jacobian, self.cost)

    def _iterate(self, iteration: int) -> bool:
        """One step; whether to go on."""
        problem, gradient = self.problem, self.jacobian.T @ self.residual
        step, promised = self.quadratic.step(gradient, problem.lower - self.v, problem.upper - self.v, self.radius)
        trial, residual, cost, gain = self.v, self.residual, np.inf, -1.0
        if promised < max(ENOUGH, ENOUGH_SHARE * self.cost):
            if self.fresh or not self.options.exact:
                return False
        else:
            trial = np.clip(self.v + step, problem.lower, problem.upper)
            residual = problem.residuals(trial[None])[0]
            cost = chi_square(residual)
            gain = (self.cost - cost) / promised
        if self._hopeless(iteration, min(cost, self.cost)):
            return False
        length, moved, before = self.quadratic.length(step), gain > ACCEPTED_GAIN, self.cost
        if moved:
            self.v, self.residual, self.cost = trial, residual, cost
            if gain > GROW_GAIN and np.isfinite(self.radius):
                self.radius = max(self.radius, 2 * length)
            elif gain < SHRINK_GAIN:
                self.radius = length / 2
        elif self.fresh:
            self.radius = length / 4
            if promised < max(REJECTED, REJECTED_SHARE * self.cost) or length < SHORTEST_STEP:
                return False
        renew = moved and gain < RENEW_GAIN
        if not self.fresh:
            renew = not KEEP_GAIN[0] < gain < KEEP_GAIN[1] or before - self.cost > SLOW_CHORD * self._decrease
        self._decrease = before - self.cost
        if renew:
            self._use(jacobian(problem, self.v, self.residual, largest_central=self._finer_steps))
        elif self.fresh and not moved and self._kinked:
            self._refine_differences()
        self.fresh = renew or (self.fresh and not moved)
        return True

    def _refine_differences(self) -> None:
        """A Jacobian of the same point by central differences no wider than the trust region.

        Where torques jump, χ² has kinks: differences over wide steps describe it far away, and no step along them
        lowers it here (implicit filtering; Kelley, Iterative Methods for Optimization, 1999, chapter 7).
        """
        if self.radius < SMALLEST_DIFFERENCE:
            return
        length = np.linalg.norm(self.jacobian, axis=0)
        self._finer_steps = np.where(length > 0, self.radius / np.where(length > 0, length, 1.0), np.inf)
        self._use(jacobian(self.problem, self.v, self.residual, largest_central=self._finer_steps))

    def _hopeless(self, iteration: int, reached: float) -> bool:
        """Whether the fit will not come near those it is compared with."""
        rival, noise = self.options.rival_cost, self.options.noise_cost
        slow = self.cost - reached < HOPELESS_PROGRESS * self.cost
        if iteration > PATIENCE and rival and self.cost > HOPELESS_RATIO * rival and slow:
            return True
        if self.fresh and noise:
            before, cost = self._paced
            pace = (cost - reached) / max(iteration - before, 1)
            hoped = reached - 2 * (self.options.iterations - iteration) * pace
            if reached > NOISE_REACHED * noise and hoped > NOISE_HOPED * noise:
                return True
            self._paced = (iteration, reached)
        return False


def chi_square(residual: np.ndarray) -> float:
    """χ² of a residual (r,); infinite where the simulation diverged, even if only the square overflows."""
    with np.errstate(over="ignore", invalid="ignore"):
        square = float(residual @ residual)
    return square if np.isfinite(square) else np.inf
