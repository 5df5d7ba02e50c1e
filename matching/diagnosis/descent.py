"""Fits by output error: free simulation against measurement, weighted by the sensors' uncertainty, within bounds.

Gauss–Newton with a trust region on the scaled variables. The Jacobian comes from finite differences and is kept while
the steps it gives do what they promise and converge fast (a chord method; Kelley, Iterative Methods for Linear and
Nonlinear Equations, 1995, section 5.4). SciPy's ``least_squares`` (trf, scaled by the Jacobian) with the same Jacobian
and the same rule to keep it finds the same values with up to twice the simulations and five times the time.
"""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import scipy
from scipy.linalg import solve_triangular

from matching.diagnosis.data import SMALLEST_SCALE, Weighting, weighting_of
from matching.diagnosis.problem import FitProblem, jacobian
from modelling.effects import EFFECTS
from modelling.errors import FitError
from modelling.resources import time_is_over

# --- The local quadratic model of χ² and its minimum within bounds: the linear problem of one Gauss–Newton step.

RIDGE, RIDGE_OF_FACTOR = 1e-10, 1e-9  # added to the scaled normal equations, whose diagonal is 1: rounding only
BOUND_MARGIN = 1e-12  # scaled; SciPy's solver asks for a start strictly inside the bounds


class Quadratic:
    """Normal equations of a Jacobian (r, v), its columns scaled to length 1.

    The step minimises |r + J·step|² within bounds; SciPy's bounded-variable least squares (Stark and Parker 1995)
    solves it where the unbounded minimum is outside.
    """

    def __init__(self, jacobian: np.ndarray):
        products = jacobian.T @ jacobian
        lengths = np.sqrt(np.diag(products))
        self.moves = lengths > 0  # variables without influence stay where they are
        self.scale = np.where(self.moves, lengths, 1.0)
        scaled = np.where(np.outer(self.moves, self.moves), products / np.outer(self.scale, self.scale), 0.0)
        self.hessian = scaled + RIDGE * np.eye(len(scaled))
        with contextlib.suppress(np.linalg.LinAlgError):
            self.factor = np.linalg.cholesky(self.hessian + RIDGE_OF_FACTOR * np.eye(len(scaled)))
            if np.isfinite(self.factor).all():
                return
        raise FitError("its normal equations are not positive definite")

    def length(self, step: np.ndarray) -> float:
        """How far a step (v,) moves the residual, in times the noise."""
        return float(np.linalg.norm(self.factor.T @ np.where(self.moves, step * self.scale, 0.0)))

    def step(self, gradient: np.ndarray, low: np.ndarray, high: np.ndarray, radius: float) -> tuple[np.ndarray, float]:
        """Step (v,) within bounds (v,) and radius, and the decrease of χ² that it promises.

        Parameters
        ----------
        gradient : ndarray (v,)
            Jᵀr.
        low, high : ndarray (v,)
            Bounds of the step.
        radius : float
            Largest length of the step, see :meth:`length`.
        """
        g = np.where(self.moves, gradient / self.scale, 0.0)
        target = solve_triangular(self.factor, -g, lower=True)
        z = solve_triangular(self.factor.T, target)
        z_low, z_high = low * self.scale, high * self.scale
        if np.any(z < z_low) or np.any(z > z_high):
            bounds = (np.minimum(z_low, -BOUND_MARGIN), np.maximum(z_high, BOUND_MARGIN))
            z = scipy.optimize.lsq_linear(self.factor.T, target, bounds, method="bvls").x
        z = np.where(self.moves, z, 0.0)
        length = float(np.linalg.norm(self.factor.T @ z))
        if length > radius:
            z *= radius / length
        return z / self.scale, float(-2 * g @ z - z @ self.hessian @ z)


# --- Fit

ENOUGH, ENOUGH_SHARE = 0.02, 2e-6  # decrease of χ² not worth a step: absolute (0.14 σ of a parameter), share of χ²
REJECTED, REJECTED_SHARE = 0.5, 1e-5  # the same after a step from a Jacobian of the point failed
ACCEPTED_GAIN = 1e-4  # decrease over promised decrease from which a step is taken
KEEP_GAIN = (0.7, 1.5)  # in between, an old Jacobian serves on
SLOW_CHORD = 0.8  # of the decrease before: at this ratio 20 steps of an old Jacobian leave 0.8²⁰ = 1 % of what they can
# gain, above it too much; below it, e.g. where stick-slip lets χ² fall by a quarter a step, a new one saves no step
GROW_GAIN, SHRINK_GAIN, RENEW_GAIN = 0.7, 0.25, 0.5  # of the trust region; of the Jacobian
FEW_STATES = 8  # start states of a segment, whose columns are renewed with those of the parameters: one batch
SMALLEST_DIFFERENCE = 1.0  # of the residual, in times the noise: less is lost in what the integration leaves
SHORTEST_STEP = 1e-10  # in times the noise
HOPELESS_RATIO, HOPELESS_PROGRESS = 3.0, 0.2  # given up: χ² beyond so many times the rival's, gaining less than this
PATIENCE = 5  # iterations in which a fit has to gain that, some of them lost on a Jacobian of another point
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
    unfinished : bool
        Whether it ended with its last iteration, still falling.
    """

    problem: FitProblem
    v: np.ndarray
    residual: np.ndarray = field(repr=False)
    jacobian: np.ndarray = field(repr=False)
    cost: float
    unfinished: bool = False

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
    enough_cost : float
        χ² that is as good as the minimum for what follows: the fit ends below it; 0 without.
    held : sequence of int
        Variables that stay where they are; their columns of the Jacobian are 0.
    timed : bool
        Whether it ends where it is when the time of the caller's limit is over.
    worth : float
        Share of the misfit beyond noise that ``PATIENCE`` iterations have to gain for another one; 0: any gain. What a
        wrong model gains along a valley takes most of the time of a search, and decides nothing in it.
    """

    iterations: int = 20
    exact: bool = True
    rival_cost: float = 0.0
    noise_cost: float = 0.0
    enough_cost: float = 0.0
    held: Sequence[int] = ()
    timed: bool = True
    worth: float = 0.0


WORTH = 0.01  # of the misfit beyond noise, for five further iterations of a fit that is only compared (trial)
SEARCH = FitOptions(exact=False, worth=WORTH)


def solve(
    problem: FitProblem, v: np.ndarray, known_jacobian: np.ndarray | None = None, options: FitOptions | None = None
) -> Fit:
    """Least squares from the variables v (v,).

    Parameters
    ----------
    known_jacobian : ndarray (r, v), optional
        A Jacobian to begin with, e.g. of a similar problem.
    options : FitOptions, optional
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
            raise FitError("the simulation diverges where the fit begins")
        self.radius = np.inf
        self._kinked = any(effect.law.abrupt for effect in problem.system.effects)
        self._many_states = len(problem.free_states) > FEW_STATES and not self._kinked
        self._partly = False  # whether the columns of the start states are of another point
        self._finer_steps: np.ndarray | None = None  # (v,) of the differences, once wider ones failed
        self._use(jacobian(problem, self.v, self.residual) if known_jacobian is None else known_jacobian)
        self.fresh = known_jacobian is None
        self._decrease = np.inf  # of χ² by the last step
        self._paced = (0, self.cost)  # iteration and χ² when last judged with a Jacobian of the point itself
        self._costs = [self.cost]  # after each iteration

    def _use(self, matrix: np.ndarray) -> None:
        if self.options.held:  # copied only then: recordings may be long
            matrix = matrix.copy()
            matrix[:, list(self.options.held)] = 0.0
        self.jacobian, self.quadratic = matrix, Quadratic(matrix)

    def run(self) -> Fit:
        """Iterate to the end."""
        for iteration in range(self.options.iterations):
            ended = self.cost < self.options.enough_cost or (self.options.timed and time_is_over())
            if ended or not self._iterate(iteration):
                return Fit(self.problem, self.v, self.residual, self.jacobian, self.cost)
        return Fit(self.problem, self.v, self.residual, self.jacobian, self.cost, unfinished=True)

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
        renew, good = moved and gain < RENEW_GAIN, KEEP_GAIN[0] < gain < KEEP_GAIN[1]
        if not self.fresh:
            renew = not good or before - self.cost > SLOW_CHORD * self._decrease
        self._decrease = before - self.cost
        partly = renew and (good or not self._partly) and self._many_states
        self._partly = partly or (self._partly and not renew)
        if partly:
            self._renew_parameters()
        elif renew:
            self._use(jacobian(problem, self.v, self.residual, largest_central=self._finer_steps))
        elif self.fresh and not moved and self._kinked:
            self._refine_differences()
        self.fresh = (renew and not partly) or (self.fresh and not moved)
        return True

    def _renew_parameters(self) -> None:
        """The parameters' columns of the Jacobian at this point. Those of the start states stay: the effect of a start
        state fades, or turns the whole drivetrain, and hardly depends on the parameters."""
        self._use(with_new_parameters(self.problem, self.v, self.residual, self.jacobian))

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
        self._costs.append(reached)
        before = self._costs[max(len(self._costs) - 1 - PATIENCE, 0)]
        slow = before - reached < HOPELESS_PROGRESS * before
        if iteration >= PATIENCE and rival and reached > HOPELESS_RATIO * rival and slow:
            return True
        worth = self.options.worth
        if iteration >= PATIENCE and worth and before - reached < worth * self.problem.beyond_noise(reached):
            return True
        if self.fresh and noise:
            before, cost = self._paced
            pace = (cost - reached) / max(iteration - before, 1)
            hoped = reached - 2 * (self.options.iterations - iteration) * pace
            if reached > NOISE_REACHED * noise and hoped > NOISE_HOPED * noise:
                return True
            self._paced = (iteration, reached)
        return False


def with_new_parameters(problem: FitProblem, v: np.ndarray, residual: np.ndarray, other: np.ndarray) -> np.ndarray:
    """A Jacobian (r, v) of variables v (v,): of the parameters new columns, of the start states those of another."""
    of_parameters = np.arange(len(problem.free))
    out = other.copy(order="F")
    out[:, of_parameters] = jacobian(problem, v, residual, of_parameters)
    return out


def solve_near(problem: FitProblem, v: np.ndarray, other: Fit, options: FitOptions) -> Fit:
    """:func:`solve` with the start states' columns of another fit of the problem to begin with."""
    residual = problem.residuals(v[None])[0]
    if not np.isfinite(chi_square(residual)):
        raise FitError("the simulation diverges where the fit begins")
    return solve(problem, v, with_new_parameters(problem, v, residual, other.jacobian), options)


def chi_square(residual: np.ndarray) -> float:
    """χ² of a residual (r,); infinite where the simulation diverged, even if only the square overflows."""
    with np.errstate(over="ignore", invalid="ignore"):
        square = float(residual @ residual)
    return square if np.isfinite(square) else np.inf


# --- Dry friction as sharp as the data ask for: the speed over which its sign changes is halved while χ² falls.
#
# A search begins with a stick speed that few integration steps a sample resolve. What is then missing of the friction
# near rest stays in the residual, where a kind that is higher near rest (Stribeck), or a second cause, would explain
# it.

SEARCH_STEPS, FINAL_STEPS, MOST_STEPS_A_SAMPLE = 8, 16, 256  # integration steps a sample at most
ALMOST = 0.75  # of the most steps: halving once more would exceed them
DECREASE, DECREASE_SHARE = 3.0, 1e-4  # of χ² that is worth another halving: absolute, and of χ² itself
EXCESS_SHARE = 0.05  # the same of the misfit beyond noise: less decides nothing between two wrong models
ITERATIONS = 12


def with_sharper_friction(fit: Fit, most_steps: int = SEARCH_STEPS) -> Fit:
    """The fit with its friction as sharp as pays, at ``most_steps`` a sample; itself without dry friction."""
    data = fit.problem.data
    sampling = 1 / float(np.median(np.concatenate([np.diff(segment.time) for segment in data.segments])))
    while np.isfinite(fit.problem.stick_speed) and fit.problem.steps_per_second < ALMOST * most_steps * sampling:
        if time_is_over():
            break
        worthwhile = max(DECREASE, DECREASE_SHARE * fit.cost, EXCESS_SHARE * fit.problem.beyond_noise(fit.cost))
        sharper = replace(
            fit.problem, steps_per_second=2 * fit.problem.steps_per_second, stick_speed=fit.problem.stick_speed / 2
        )
        if fit.cost - expected_cost(fit, sharper.residuals(fit.v[None])[0]) < worthwhile:
            break
        try:
            again = solve(sharper, fit.v, fit.jacobian, replace(SEARCH, iterations=ITERATIONS))
        except FitError:
            break
        if again.cost > fit.cost - worthwhile:
            break
        fit = again
    return fit


def expected_cost(fit: Fit, residual: np.ndarray) -> float:
    """χ² to first order when the variables of a fit adapt to another residual (r,)."""
    if not np.isfinite(chi_square(residual)):
        return np.inf
    problem, gradient = fit.problem, fit.jacobian.T @ residual
    _, decrease = Quadratic(fit.jacobian).step(gradient, problem.lower - fit.v, problem.upper - fit.v, np.inf)
    return chi_square(residual) - decrease


# --- The end of a fit: Gauss–Newton steps with central differences over steps of about one standard uncertainty.
#
# A forward difference over a wide step is wrong by its curvature: a stiffness a thousandth off is a phase out of step
# after some seconds. Where two columns differ by less than that error, e.g. those of two springs in series, it looks
# like information, and uncertainties come out too small. The steps are therefore as wide as χ² changes by about 1; with
# backlash or dry friction, where χ² is rough on that scale, they stay wide.

MOST_GAUSS_NEWTON_STEPS = 6  # Gauss–Newton steps
ENOUGH_TO_POLISH = 0.02  # decrease of χ² not worth a step
SHARES = (1.0, 0.3, 0.1)  # of a step that are tried
SMALLEST_DECREASE = 0.1 * ENOUGH_TO_POLISH  # of χ² for a step to be taken


def polished(fit: Fit) -> Fit:
    """The fit moved to where central differences promise no decrease, with the Jacobian of that point."""
    problem, v, r, cost = fit.problem, fit.v, fit.residual, fit.cost
    widest = difference_steps(fit)
    derivatives = jacobian(problem, v, r, largest_central=widest)
    for _ in range(MOST_GAUSS_NEWTON_STEPS if not time_is_over() else 0):
        step, promised = Quadratic(derivatives).step(derivatives.T @ r, problem.lower - v, problem.upper - v, np.inf)
        for share in SHARES:
            if promised * share < ENOUGH_TO_POLISH:
                return replace(fit, v=v, residual=r, jacobian=derivatives, cost=cost)
            trial = np.clip(v + share * step, problem.lower, problem.upper)
            residual = problem.residuals(trial[None])[0]
            if chi_square(residual) < cost - SMALLEST_DECREASE:
                v, r, cost = trial, residual, chi_square(residual)
                break
        else:
            break
        derivatives = jacobian(problem, v, r, largest_central=widest)
    return replace(fit, v=v, residual=r, jacobian=derivatives, cost=cost)


def difference_steps(fit: Fit) -> np.ndarray:
    """(v,) steps over which χ² changes by about 1; infinite where χ² is rough on that scale."""
    length = np.linalg.norm(fit.jacobian, axis=0)
    steps = np.full(fit.problem.size, np.inf)
    if not any(EFFECTS[effect.kind].abrupt for effect in fit.problem.system.effects):
        steps[length > 0] = 1 / length[length > 0]
    return steps


# --- Fits of a model that is not perfect: weights and parameters are estimated together.
#
# Weighted by noise alone, the most precise sensor decides everything: an encoder known to a microradian outvotes a
# speed channel whose filter is plain to see. The likelihood is therefore concentrated over the unknown covariance of
# what the model leaves (Goodwin and Payne, Dynamic System Identification, 1977, section 3.5), by iteratively reweighted
# least squares.

ROUNDS = 6
SETTLED_RATIO = 1.1  # of the scales between two rounds


def iteratively_reweighted(fit: Fit) -> Fit:
    """The fit with each sensor weighted by what the model leaves of it, see :class:`Weighting`."""
    plain, of_noise = replace(fit.problem, weighting=None), fit.jacobian
    if fit.problem.weighting is not None:
        of_noise = jacobian(plain, fit.v, plain.residuals(fit.v[None])[0])
    for _ in range(ROUNDS):
        if time_is_over():
            break
        weighting, before = discrepancy(fit), fit.problem.weighting
        if before is not None and _settled(before, weighting):
            break
        problem = replace(plain, weighting=weighting)
        fit = solve(problem, fit.v, _weighted_jacobian(problem, of_noise), SEARCH)
    return fit


def _weighted_jacobian(problem: FitProblem, of_noise: np.ndarray) -> np.ndarray:
    """A Jacobian (r, v) weighted by noise in the weights of a problem."""
    out, begin = np.empty_like(of_noise), 0
    for i, segment in enumerate(problem.data.segments):
        rows = slice(begin, begin + segment.readings.size)
        for column, weighted in zip(of_noise[rows].T, out[rows].T, strict=True):
            weighted[:] = problem.counted(column.reshape(1, *segment.readings.shape).copy(), i).ravel()
        begin = rows.stop
    return out


def balanced_fit(fit: Fit, v: np.ndarray) -> Fit:
    """The fit with each sensor weighted by what the model leaves of it, from several starts.

    Estimated weights have several fixed points: where one sensor has led, what it asked for keeps its error small, and
    with that its weight. They are estimated from where weights by noise led, and from the values the model states; the
    likelier end stands, whatever uncertainties are stated.

    Parameters
    ----------
    v : ndarray (v,)
        Variables at the stated values.
    """
    ends = [iteratively_reweighted(fit)]
    with contextlib.suppress(FitError):  # nothing simulates from there
        problem = replace(fit.problem, weighting=discrepancy_at(fit.problem, v))
        ends.append(iteratively_reweighted(solve(problem, v, None, SEARCH)))
    return min(ends, key=innovation_power)


def innovation_power(fit: Fit) -> float:
    """Mean over the readings of ln of the squared innovation of their sensor: −2 ln of the likelihood for each."""
    count = fit.problem.data.readings_by_sensor
    return float(np.log(discrepancy(fit).scale ** 2) @ count / count.sum())


def power_left(errors: Sequence[np.ndarray], measured: Sequence[np.ndarray]) -> np.ndarray:
    """What a model leaves of the sensors (y,), as a power in times the noise: the geometric mean of the power of the
    innovation and that of the error itself.

    The likelihood with a memory hardly asks for the slow part of an error, however large, and that without one asks for
    little else. Their composite (Varin, Reid and Firth, Statistica Sinica 21, 2011) asks for both.

    Parameters
    ----------
    errors, measured : sequence of ndarray (t, y)
        Of each segment, in times the noise, and where there is a reading.
    """
    return weighting_of(errors, measured).scale * np.sqrt(_power(errors, measured))


def power_left_by(fit: Fit) -> np.ndarray:
    """:func:`power_left` of a fit (y,)."""
    return power_left(fit.errors, [segment.measured for segment in fit.problem.data.segments])


def _power(errors: Sequence[np.ndarray], measured: Sequence[np.ndarray]) -> np.ndarray:
    """Mean squares (y,) of errors."""
    square = np.sum([np.sum(np.where(m, e, 0.0) ** 2, axis=0) for e, m in zip(errors, measured, strict=True)], axis=0)
    return np.maximum(square / np.maximum(np.sum([m.sum(axis=0) for m in measured], axis=0), 1), SMALLEST_SCALE**2)


def discrepancy_at(problem: FitProblem, v: np.ndarray) -> Weighting:
    """What a model leaves of the sensors at variables (v,), as weights of a fit."""
    return weighting_of(problem.errors(v), [segment.measured for segment in problem.data.segments])


def discrepancy(fit: Fit) -> Weighting:
    """What a fit leaves of the sensors, as weights of a further fit."""
    return weighting_of(fit.errors, [segment.measured for segment in fit.problem.data.segments])


def reweighted(fit: Fit, weighting: Weighting | None) -> Fit:
    """The same fit in other weights."""
    problem = replace(fit.problem, weighting=weighting)
    residual = problem.residuals(fit.v[None])[0]
    return replace(
        fit, problem=problem, residual=residual, jacobian=jacobian(problem, fit.v, residual), cost=chi_square(residual)
    )


def _settled(before: Weighting, after: Weighting) -> bool:
    """Whether two weightings differ little: standard deviation of the innovation, and of the process."""
    innovation = after.scale / before.scale
    process = innovation * np.sqrt((1 - before.memory**2) / (1 - after.memory**2))
    ratio = np.concatenate([innovation, np.sqrt(process)])
    return bool(max(ratio.max(), 1 / ratio.min()) < SETTLED_RATIO)
