"""Steps as small as a stated tolerance needs: the error is estimated by halving them.

The same recording is run with steps h and h/r. Where the readings differ by no more than the tolerance allows, the
finer run is the result; else the steps are refined. A model is stepped implicitly where its fastest decay, which
nothing shows, would need far smaller explicit steps than what vibrates. Vibrations are always resolved: an implicit
method would damp them in both runs alike, and the difference would not tell.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from modelling.equations.compiled import Model
from modelling.simulation.integrator import native, virtual
from modelling.simulation.integrator.task import IntegrationTask, Trajectories, make_task
from modelling.simulation.plan import (
    MAX_STEPS_PER_SECOND,
    STABLE_STEP,
    Rates,
    rates_along,
    rates_at_rest,
    too_fast,
)
from modelling.simulation.result import raise_if_failed

TOLERANCE = 1e-4  # of each reading's range
VIBRATION_STEP, CONTACT_STEP = 1.2, 0.5  # |λ|·h, ω·h to begin with
IMPLICIT_COST = 8.0  # explicit steps that take as long as an implicit one: 6 to 10 measured
ORDER = 2  # with which the error falls at least: that of kinked laws, and of a torque that jumps within a step
FINEST = 64  # times the first steps; what does not converge by then is chaotic, or jumps too often
CALMER = 4  # refinement where a state is not finite
SAME_MOMENT, SAME_MOMENT_RELATIVE = 2, 0.02  # samples, of the time: so near, two runs end at the same moment
OUTLIERS_IN = 32  # samples, of which one may miss a jump of torque: it lies on either side of it
NO_RANGE = 1e-6  # of a reading's size: a range below that is rounding


@dataclass(frozen=True)
class Stepping:
    """How a recording is stepped through: each interval between samples in ``refinement`` times the steps that
    ``steps_per_second`` asks for, at least one; implicit or explicit."""

    steps_per_second: float
    refinement: int = 1
    implicit: bool = False

    def finer(self, factor: int) -> Stepping:
        """The same with every step divided."""
        return replace(self, refinement=self.refinement * factor)

    def least(self, time: np.ndarray) -> float:
        """Steps a second in the longest intervals of ``time`` (t,)."""
        span = float(np.median(np.diff(time)))
        return self.refinement * max(1.0, np.ceil(span * self.steps_per_second - 1e-9)) / span


@dataclass(frozen=True)
class InitialValueProblem:
    """What is simulated: a model on inputs (t, u) for parameters (b, p) from start states (b, x)."""

    model: Model
    time: np.ndarray
    inputs: np.ndarray
    p: np.ndarray
    start: np.ndarray

    def run(
        self, stepping: Stepping, compiled: bool | None = None, states: bool = True, readings: bool = True
    ) -> Trajectories:
        """Integrate with given steps; without a compiler, or if ``compiled`` is False, in the virtual machine."""
        task = make_task(
            self.model, self.time, self.inputs, self.p, self.start, stepping.steps_per_second,
            implicit=stepping.implicit, refinement=stepping.refinement,
        )  # fmt: skip
        return run(task, compiled, states, readings)


@dataclass(frozen=True)
class Controlled:
    """A run within tolerance: its steps, and the estimated error (y,) of each reading over its range."""

    trajectories: Trajectories
    stepping: Stepping
    error: np.ndarray


def run(
    task: IntegrationTask, compiled: bool | None = None, states: bool = True, readings: bool = True
) -> Trajectories:
    """A task by the compiled integrator, or by the virtual machine where there is no compiler or it is not wanted."""
    done = native.run(task, states, readings) if compiled is not False else None
    return done if done is not None else virtual.run(task, states, readings)


@dataclass(frozen=True)
class FirstRun:
    """A finite run with steps that follow from the eigenvalues, and those."""

    trajectories: Trajectories
    stepping: Stepping
    rates: Rates


def first_run(problem: InitialValueProblem, compiled: bool | None = None) -> FirstRun:
    """Choose steps from the eigenvalues at rest and along the motion, and run with them.

    Raises
    ------
    SimulationError
        If a state is not finite however small the steps, or an eigenvalue is too fast for any.
    """
    model, time = problem.model, problem.time
    rates = rates_at_rest(model, problem.p)
    stepping = suited(rates, time)
    if not stepping.implicit and explicit_steps(rates) > MAX_STEPS_PER_SECOND:
        raise too_fast(rates.any, explicit_steps(rates))
    stepping, done = _finite_run(problem, stepping, compiled)
    if any(effect.law.state_dependent for effect in model.system.effects):
        for p, motion in zip(problem.p, done.states, strict=True):
            rates |= rates_along(model, p, motion, problem.inputs)
        better = suited(rates, time)
        if better.implicit != stepping.implicit or better.least(time) > stepping.least(time):
            stepping, done = _finite_run(problem, better, compiled)
    return FirstRun(done, stepping, rates)


def explicit_steps(rates: Rates) -> float:
    """Explicit steps a second that are stable and follow every vibration."""
    return max(rates.any / STABLE_STEP, rates.vibration / VIBRATION_STEP, rates.contact / CONTACT_STEP, 1.0)


def suited(rates: Rates, time: np.ndarray) -> Stepping:
    """Implicit steps where far fewer follow every vibration than explicit ones need to be stable; else explicit.

    ``time`` (t,) in s.
    """
    explicit = explicit_steps(rates)
    accurate = max(rates.vibration / VIBRATION_STEP, rates.contact / CONTACT_STEP, 1.0)
    if explicit > IMPLICIT_COST * max(accurate, 1 / float(np.median(np.diff(time)))):
        return Stepping(min(accurate, MAX_STEPS_PER_SECOND), implicit=True)
    return Stepping(min(explicit, MAX_STEPS_PER_SECOND))


def _finite_run(
    problem: InitialValueProblem, stepping: Stepping, compiled: bool | None
) -> tuple[Stepping, Trajectories]:
    """A run that stays finite, with finer steps or implicit ones where it does not at first.

    A motion that stops being finite at the same moment with finer steps runs away by itself: no step helps.
    """
    before = None
    while True:
        for each in dict.fromkeys((stepping, replace(stepping, implicit=True))):
            done = problem.run(each, compiled)
            if (done.failed[:, 0] < 0).all():
                return each, done
        moment = int(done.failed[done.failed[:, 0] >= 0, 0].min())
        stepping = stepping.finer(CALMER)
        runs_away = before is not None and abs(moment - before) <= max(SAME_MOMENT, SAME_MOMENT_RELATIVE * moment)
        if runs_away or stepping.least(problem.time) > MAX_STEPS_PER_SECOND:
            raise_if_failed(done.failed, problem.time, problem.model.states)
        before = moment


def run_to_tolerance(
    problem: InitialValueProblem, tolerance: float = TOLERANCE, compiled: bool | None = None, states: bool = True
) -> Controlled:
    """Simulate with steps refined until every reading's estimated error is at most ``tolerance`` of its range.

    Where that takes more than :data:`FINEST` times the first steps the finest run is returned, with its error.

    Raises
    ------
    SimulationError
        See :func:`first_run`.
    """
    model = problem.model
    rough = any(effect.law.abrupt or effect.law.sticks for effect in model.system.effects)
    first = first_run(problem, compiled)
    stepping, coarse, explicit = first.stepping, first.trajectories, explicit_steps(first.rates)
    limit, factor = FINEST * stepping.refinement, 2
    while True:
        finer = stepping.finer(factor)
        if finer.implicit and IMPLICIT_COST * finer.least(problem.time) > explicit and explicit < MAX_STEPS_PER_SECOND:
            stepping, factor = Stepping(explicit), 2
            limit, finer = FINEST, stepping.finer(factor)
            coarse = problem.run(stepping, compiled, states)
        fine = problem.run(finer, compiled, states)
        raise_if_failed(fine.failed, problem.time, model.states)
        error = difference(coarse, fine, rough) / (factor**ORDER - 1)
        stepping, coarse = finer, fine
        if error.max(initial=0.0) <= tolerance or stepping.refinement >= limit:
            return Controlled(fine, stepping, error)
        factor = int(np.clip(2 ** np.ceil(0.5 * np.log2(error.max() / tolerance)), 2, 8))


def difference(coarse: Trajectories, fine: Trajectories, rough: bool) -> np.ndarray:
    """Largest differences (y,) of the readings over their ranges; of the states where there are no readings.

    ``rough``: the worst of :data:`OUTLIERS_IN` samples does not count.
    """
    first, second = (own.readings if own.readings.shape[-1] else own.states for own in (coarse, fine))
    ranges = np.maximum(np.ptp(second, axis=1), NO_RANGE * np.abs(second).max(axis=1, initial=0.0))
    apart = np.abs(first - second) / np.where(ranges > 0, ranges, 1.0)[:, None]
    if rough and apart.shape[1] >= OUTLIERS_IN:
        whole = apart.shape[1] // OUTLIERS_IN * OUTLIERS_IN
        windows = apart[:, :whole].reshape(len(apart), -1, OUTLIERS_IN, apart.shape[2])
        counted = np.partition(windows, -2, axis=2)[:, :, -2]
        apart = np.concatenate([counted, apart[:, whole:]], axis=1)
    return apart.max(axis=(0, 1), initial=0.0)


def explicit_stepping(problem: InitialValueProblem, compiled: bool | None = None) -> Stepping:
    """Explicit steps that keep the default tolerance and are stable, for what has no implicit form."""
    stepping = run_to_tolerance(problem, compiled=compiled, states=False).stepping
    if not stepping.implicit:
        return stepping
    stable = explicit_steps(rates_at_rest(problem.model, problem.p))
    if stable > MAX_STEPS_PER_SECOND:
        raise too_fast(stable * STABLE_STEP, stable)
    return Stepping(max(stable, stepping.least(problem.time)))
