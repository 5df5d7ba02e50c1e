"""Steps as small as a stated tolerance needs.

A run gives its local errors, sample by sample. The steps are divided where these are largest, until they add up to no
more than the tolerance, or until two runs show that: the readings' differences say how much error the steps that were
divided had caused, and the local errors how much of it is left. A model is stepped implicitly where its fastest decay,
which nothing shows, would need far smaller explicit steps than what vibrates. Vibrations are always resolved: an
implicit method would damp them.
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
from modelling.simulation.stepping import (
    KINKED_ORDER,
    SMOOTH_ORDER,
    Stepping,
    difference,
    divisions,
    local_errors,
)

TOLERANCE = 1e-4  # of each reading's range
VIBRATION_STEP, CONTACT_STEP = 1.6, 0.5  # |λ|·h, ω·h to begin with
IMPLICIT_COST = 8.0  # explicit steps that take as long as an implicit one: 6 to 10 measured
FINEST = 64  # times the first steps; what does not converge by then is chaotic, or jumps too often
FASTEST = 8 * MAX_STEPS_PER_SECOND  # mean steps a second of a refined run: some seconds of processor time a second
CALMER = 4  # refinement where a state is not finite
SAME_MOMENT, SAME_MOMENT_RELATIVE = 2, 0.02  # samples, of the time: so near, two runs end at the same moment
CALIBRATED_SHARE = 1 / 16  # of the local errors that are left before two runs show what they do: halved steps
AIM = 0.5  # of the tolerance
ROUNDS = 12
NOTHING_GAINED = 1e6  # times the difference of two runs: the error where divided steps have no smaller local errors
MOST_AT_ONCE = 16  # division of an interval's steps from one run to the next
MANY_MORE = 4  # times the steps: worth looking whether implicit ones are better


@dataclass(frozen=True)
class InitialValueProblem:
    """What is simulated: a model on inputs (t, u) for parameters (b, p) from start states (b, x)."""

    model: Model
    time: np.ndarray
    inputs: np.ndarray
    p: np.ndarray
    start: np.ndarray

    def run(
        self,
        stepping: Stepping,
        compiled: bool | None = None,
        states: bool = True,
        readings: bool = True,
        errors: bool = False,
    ) -> Trajectories:  # what is integrated is fixed; how, and what is wanted of it, are different things
        """Integrate with given steps; without a compiler, or if ``compiled`` is False, in the virtual machine."""
        task = make_task(
            self.model, self.time, self.inputs, self.p, self.start, stepping.steps_per_second,
            implicit=stepping.implicit, refinement=stepping.refinement,
        )  # fmt: skip
        return run(task, compiled, states, readings, errors)


@dataclass(frozen=True)
class Controlled:
    """A run within tolerance: its steps, and the estimated error (y,) of each reading over its range."""

    trajectories: Trajectories
    stepping: Stepping
    error: np.ndarray


def run(
    task: IntegrationTask,
    compiled: bool | None = None,
    states: bool = True,
    readings: bool = True,
    errors: bool = False,
) -> Trajectories:
    """A task by the compiled integrator, or by the virtual machine where there is no compiler or it is not wanted."""
    done = native.run(task, states, readings, errors=errors) if compiled is not False else None
    return done if done is not None else virtual.run(task, states, readings, errors)


@dataclass(frozen=True)
class FirstRun:
    """A finite run with steps that follow from the eigenvalues, and those."""

    trajectories: Trajectories
    stepping: Stepping
    rates: Rates


def first_run(problem: InitialValueProblem, compiled: bool | None) -> FirstRun:
    """Choose steps from the eigenvalues at rest, and along the motion where those do not do; run with them.

    Raises
    ------
    SimulationError
        If a state is not finite however small the steps, or an eigenvalue is too fast for any.
    """
    rates = rates_at_rest(problem.model, problem.p)
    stepping = suited(rates, problem.time)
    if not stepping.implicit and explicit_steps(rates) > MAX_STEPS_PER_SECOND:
        raise too_fast(rates.any, explicit_steps(rates))
    used, done = _finite_run(problem, stepping, compiled)
    first = FirstRun(done, used, rates)
    return first if used is stepping and not used.implicit else along_the_motion(problem, first, compiled)


def along_the_motion(problem: InitialValueProblem, first: FirstRun, compiled: bool | None) -> FirstRun:
    """A first run with the steps that the eigenvalues along its motion ask for."""
    model, time, rates = problem.model, problem.time, first.rates
    if not any(effect.law.state_dependent for effect in model.system.effects):
        return first
    for p, motion in zip(problem.p, first.trajectories.states, strict=True):
        rates |= rates_along(model, p, motion, problem.inputs)
    better = suited(rates, time)
    if better.implicit != first.stepping.implicit or better.count(time) > first.stepping.count(time):
        stepping, done = _finite_run(problem, better, compiled)
        return FirstRun(done, stepping, rates)
    return replace(first, rates=rates)


def explicit_steps(rates: Rates) -> float:
    """Explicit steps a second that are stable and follow every vibration."""
    return max(rates.any / STABLE_STEP, rates.vibration / VIBRATION_STEP, rates.contact / CONTACT_STEP, 1.0)


def suited(rates: Rates, time: np.ndarray) -> Stepping:
    """Implicit steps where far fewer follow every vibration than explicit ones need to be stable; else explicit.

    Explicit ones are even in number from sample to sample; ``time`` (t,) in s.
    """
    explicit = explicit_steps(rates)
    accurate = max(rates.vibration / VIBRATION_STEP, rates.contact / CONTACT_STEP, 1.0)
    if explicit > IMPLICIT_COST * max(accurate, 1 / float(np.median(np.diff(time)))):
        return Stepping(min(accurate, MAX_STEPS_PER_SECOND), implicit=True)
    return Stepping(min(explicit, MAX_STEPS_PER_SECOND) / 2, refinement=2)


def _finite_run(
    problem: InitialValueProblem, stepping: Stepping, compiled: bool | None
) -> tuple[Stepping, Trajectories]:
    """A run that stays finite, with finer steps or implicit ones where it does not at first.

    A motion that stops being finite at the same moment with finer steps runs away by itself: no step helps.
    """
    before = None
    while True:
        for each in (stepping, replace(stepping, implicit=True))[: 1 if stepping.implicit else 2]:
            done = problem.run(each, compiled, errors=True)
            if (done.failed[:, 0] < 0).all():
                return each, done
        moment = int(done.failed[done.failed[:, 0] >= 0, 0].min())
        stepping = stepping.finer(CALMER)
        runs_away = before is not None and abs(moment - before) <= max(SAME_MOMENT, SAME_MOMENT_RELATIVE * moment)
        if runs_away or stepping.mean_rate(problem.time) > MAX_STEPS_PER_SECOND:
            raise_if_failed(done.failed, problem.time, problem.model.states)
        before = moment


def run_to_tolerance(
    problem: InitialValueProblem, tolerance: float = TOLERANCE, compiled: bool | None = None
) -> Controlled:
    """Simulate with steps divided until every reading's estimated error is at most ``tolerance`` of its range.

    Where that takes more than :data:`FINEST` times the first steps, or more than :data:`FASTEST` steps a second, the
    finest run is returned, with its error. Where a torque may jump, two runs have to agree; else the sum of the local
    errors may do.

    Raises
    ------
    SimulationError
        See :func:`first_run`.
    """
    model, time = problem.model, problem.time
    rough = any(effect.law.abrupt or effect.law.sticks for effect in model.system.effects)
    order = KINKED_ORDER if rough else SMOOTH_ORDER
    first, local = _fitting_first_run(problem, tolerance, order, rough, compiled)
    stepping, done = first.stepping, first.trajectories
    most = min(FINEST * stepping.count(time), max(FASTEST * float(np.ptp(time)), stepping.count(time)))
    error = np.full(max(1, len(model.sensors)), np.inf if rough and local.any() else local.sum())
    allowed = _first_allowed(local, tolerance)
    for _ in range(ROUNDS):
        if error.max() <= tolerance:
            break
        finer = stepping.finer(np.minimum(divisions(local, allowed, order), MOST_AT_ONCE))
        if finer.count(time) > most and np.isfinite(error).all():
            break
        fine = problem.run(finer, compiled, errors=True)
        raise_if_failed(fine.failed, time, model.states)
        left = local_errors(fine, model.n, rough)
        before, after = float(local.sum()), float(left.sum())
        share = max(after / (before - after), CALIBRATED_SHARE) if after < before else NOTHING_GAINED
        error = difference(done, fine, rough) * share
        if not rough:
            error = np.minimum(error, after)
        stepping, done, local = finer, fine, left
        allowed = after * float(np.clip(AIM * tolerance / max(error.max(), 1e-300), CALIBRATED_SHARE, 0.5))
    return Controlled(done, stepping, error)


def _first_allowed(local: np.ndarray, tolerance: float) -> float:
    """What the local errors (t-1,) of a first run may add up to in the second one."""
    return max(AIM * tolerance, CALIBRATED_SHARE * float(local.sum()))


def _fitting_first_run(
    problem: InitialValueProblem, tolerance: float, order: int, rough: bool, compiled: bool | None
) -> tuple[FirstRun, np.ndarray]:
    """The first run, explicit or implicit as takes less time with the steps of the second one; its local errors."""
    time, first = problem.time, first_run(problem, compiled)

    def errors_and_steps(done: FirstRun) -> tuple[np.ndarray, float]:
        errors = local_errors(done.trajectories, problem.model.n, rough)
        finer = done.stepping.finer(divisions(errors, _first_allowed(errors, tolerance), order))
        return errors, finer.count(time)

    local, steps = errors_and_steps(first)
    if not first.stepping.implicit and steps > MANY_MORE * first.stepping.count(time):
        first = along_the_motion(problem, first, compiled)
        local, steps = errors_and_steps(first)
    explicit = explicit_steps(first.rates)
    fewer = first.stepping.implicit and explicit * float(np.ptp(time)) < IMPLICIT_COST * steps
    if fewer and explicit < MAX_STEPS_PER_SECOND:
        stepping, done = _finite_run(problem, Stepping(explicit / 2, refinement=2), compiled)
        first = FirstRun(done, stepping, first.rates)
        local, _ = errors_and_steps(first)
    return first, local


def explicit_stepping(problem: InitialValueProblem, compiled: bool | None = None) -> Stepping:
    """Explicit steps that keep the default tolerance and are stable, for what has no implicit form."""
    stepping = run_to_tolerance(problem, compiled=compiled).stepping
    if not stepping.implicit:
        return stepping
    stable = explicit_steps(rates_at_rest(problem.model, problem.p))
    if stable > MAX_STEPS_PER_SECOND:
        raise too_fast(stable * STABLE_STEP, stable)
    return Stepping(max(stable, stepping.mean_rate(problem.time)))
