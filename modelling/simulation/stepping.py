"""How the intervals of a recording are divided into steps, and which of them need finer ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import ceil, log2
from typing import Any

import numpy as np

from modelling.display import Displayed, labelled, series_frame
from modelling.equations.casadi_code import Model
from modelling.equations.lagrange import FOLLOW_TIME, STICK_SPEED
from modelling.equations.shaft_law import CONTACT_TIME
from modelling.errors import InputError
from modelling.simulation import interpreted
from modelling.simulation.compiled import compiler, run_compiled
from modelling.simulation.task import IntegrationTask, Trajectories, fewest_steps, make_task

# --- What a simulation returns, and the error it raises.


class SimulationError(InputError):
    """A state that is not finite, or steps too many to take: one line that says when and which."""


@dataclass(frozen=True)
class Simulation(Displayed):
    """Readings and states over time, all SI.

    Attributes
    ----------
    time : ndarray (t,)
        s, as given.
    readings : dict of str to ndarray (t,)
        By sensor, with all that the sensors' effects do to them.
    states : ndarray (t, x)
        Angles, speeds and further states, without the sensors' delays.
    state_names : list of str, length x
    units : dict of str to str
        SI unit of every reading.
    steps_per_second, stick_speed : float
        What the integration used; ``stick_speed`` (rad/s) is NaN where nothing sticks.
    implicit : bool
        Whether the steps were implicit ones, for a stiff model.
    integration_error : dict of str to float
        Estimated largest error of every reading that comes from the steps, as a share of its range; NaN where the steps
        were prescribed.
    notes : list of str
        What the start leaves open.
    """

    time: np.ndarray
    readings: dict[str, np.ndarray]
    states: np.ndarray = field(repr=False)
    state_names: list[str]
    units: dict[str, str]
    steps_per_second: float
    stick_speed: float
    implicit: bool
    integration_error: dict[str, float]
    notes: list[str] = field(default_factory=list)

    def __getitem__(self, name: str) -> np.ndarray:
        """A reading or a state by name, (t,)."""
        return self.readings[name] if name in self.readings else self.states[:, self.state_names.index(name)]

    def to_dict(self) -> dict[str, list[float]]:
        """Time and readings as plain lists."""
        return {"time": self.time.tolist()} | {name: value.tolist() for name, value in self.readings.items()}

    def to_dataframe(self, table: str | None = None) -> Any:  # there is one table
        """The readings over time (pandas DataFrame), a column ``name [unit]`` each, SI."""
        return series_frame(self.time, "time [s]", self.readings, self.units)

    def to_xarray(self) -> Any:
        """The readings over time (xarray Dataset).

        Raises
        ------
        InputError
            If xarray is not installed.
        """
        readings = {name: (["time"], value, self.units[name]) for name, value in self.readings.items()}
        return labelled(readings, {"time": (self.time, "s")})


@dataclass(frozen=True)
class Sensitivity:
    """Readings and their derivatives.

    Attributes
    ----------
    time : ndarray (t,)
    readings : ndarray (t, y)
    jacobian : ndarray (t, y, s)
        ∂reading/∂(parameter or start state ``names[s]``), SI.
    sensors, names : list of str
    """

    time: np.ndarray
    readings: np.ndarray
    jacobian: np.ndarray = field(repr=False)
    sensors: list[str]
    names: list[str]


def raise_if_failed(failed: np.ndarray, time: np.ndarray, states: Sequence[str]) -> None:
    """Raise ``SimulationError`` for the first row of ``failed`` (b, 2) that tells of a failure.

    A row holds sample and state, −1 where all went well; ``time`` (t,) in s.
    """
    rows = np.flatnonzero(failed[:, 0] >= 0)
    if rows.size:
        sample, state = failed[rows[0]]
        which = f" (parameter set {rows[0]})" if len(failed) > 1 else ""
        raise SimulationError(
            "simulation",
            f"{states[state]} is not finite at {time[sample]:g} s{which}",
            "check parameters, start and inputs, or take more steps_per_second",
        )


# --- How fast a model can move, from the eigenvalues of its linearisation, and the steps that follow from it.

STABLE_STEP = 2.0  # |λ|·h of a fast decay; explicit Runge-Kutta of order four is stable up to 2.78
ACCURATE_STEP = 0.6  # |λ|·h of the fastest vibration: 0.1 % of phase error a radian
FREE_CONTACT_STEP = 0.2  # ω·h of the vibration of two inertias on the spring of a lash alone
WELL_DAMPED = 0.7  # −Re λ/|λ| from which on an eigenvalue decays before it vibrates
MAX_STEPS_PER_SECOND = 2e6
LARGEST_PHASE = 0.2  # rad
PROBED_STATES = 48  # along a motion


@dataclass(frozen=True)
class Rates:
    """Fastest rates of a model, 1/s.

    Attributes
    ----------
    any : float
        Largest magnitude of all eigenvalues.
    vibration : float
        The same of those that vibrate before they decay.
    contact : float
        Angular frequency of two inertias on the spring of a lash alone, 0 without lash.
    """

    any: float
    vibration: float
    contact: float

    def __or__(self, other: Rates) -> Rates:
        return Rates(max(self.any, other.any), max(self.vibration, other.vibration), max(self.contact, other.contact))


def steps_per_second(model: Model, p: np.ndarray) -> float:
    """Explicit steps a second that are stable and accurate about rest, over parameter sets (b, p).

    For what steps at a rate fixed in advance (FMU, controlled rig); :mod:`modelling.simulation.stepping` measures
    the error instead.

    Raises
    ------
    SimulationError
        If more than :data:`MAX_STEPS_PER_SECOND` would be needed, or an eigenvalue is not finite.
    """
    rates = rates_at_rest(model, p)
    needed = max(rates.any / STABLE_STEP, rates.vibration / ACCURATE_STEP, rates.contact / FREE_CONTACT_STEP, 1.0)
    if not needed <= MAX_STEPS_PER_SECOND:
        raise too_fast(rates.any, needed)
    return float(needed)


def too_fast(rate: float, needed: float) -> SimulationError:
    """The error for a model with an eigenvalue too fast to step through."""
    return SimulationError(
        "simulation", f"the fastest eigenvalue, {rate:.3g} 1/s, needs {needed:.3g} steps a second",
        f"at most {MAX_STEPS_PER_SECOND:g} are taken: look for a very small inertia, time constant or coefficient",
    )  # fmt: skip


def rates_at_rest(model: Model, p: np.ndarray) -> Rates:
    """Rates about rest over parameter sets (b, p), with every lash closed and dry friction at its steepest.

    Raises
    ------
    SimulationError
        If an eigenvalue is not finite.
    """
    gaps = [model.parameters.index(name) for name in model.system.free_plays.values()]
    closed = p.copy()
    closed[:, gaps] = 0.0
    by_gap = np.stack([closed] * (1 + len(gaps)))  # all closed, then one after the other wide open
    by_gap[1 + np.arange(len(gaps)), :, gaps] = 1e9
    rows = np.concatenate(np.repeat(by_gap, 2, axis=0))  # each for a twist in both directions
    probe = 1e-9 * np.cos(np.arange(model.n) * 1.7)  # no two coordinates alike: every lash is closed
    x = np.zeros((len(model.states), len(rows)))
    x[: model.n] = np.concatenate([np.tile(probe, (len(p), 1)), np.tile(-probe, (len(p), 1))] * len(by_gap)).T
    A, *opened = np.split(_state_matrices(model, x, np.zeros((len(model.inputs), len(rows))), rows.T), len(by_gap))
    contact = 0.0
    for other in opened:
        change = A - other
        square = -np.trace(change[:, model.n : 2 * model.n, : model.n], axis1=1, axis2=2)  # stiffness over inertia
        contact = max(contact, float(np.sqrt(square.max(initial=0.0))))
    alike = (A[: len(p)] == A[len(p) :]).all()  # most laws are the same in both directions
    return _rates(A[: len(p)] if alike else A, contact)


def rates_along(model: Model, p: np.ndarray, states: np.ndarray, inputs: np.ndarray) -> Rates:
    """Rates at some points of a motion, states (t, x) and inputs (t, u), for one parameter set (p,).

    Raises
    ------
    SimulationError
        If an eigenvalue is not finite.
    """
    finite = np.flatnonzero(np.isfinite(states).all(axis=1))
    # evenly spread, and where the motion is fastest
    spread = finite[np.linspace(0, len(finite) - 1, min(len(finite), PROBED_STATES)).astype(int)]
    speeds = states[finite][:, model.n : 2 * model.n]
    chosen = np.unique(np.concatenate([spread, finite[_extremes(speeds - speeds.mean(axis=1, keepdims=True))]]))
    p_columns = np.repeat(p[None], len(chosen), axis=0).T
    return _rates(_state_matrices(model, states[chosen].T, inputs[chosen].T, p_columns), 0.0)


def _extremes(values: np.ndarray) -> np.ndarray:
    """Rows (≤ 2k,) at which the columns (t, k) are largest and smallest."""
    return np.concatenate([values.argmax(axis=0), values.argmin(axis=0)]) if values.size else np.empty(0, int)


def _rates(A: np.ndarray, contact: float) -> Rates:
    values = np.linalg.eigvals(A).ravel()
    size = np.abs(values)
    vibrating = size[-values.real < WELL_DAMPED * size]
    return Rates(float(size.max(initial=0.0)), float(vibrating.max(initial=0.0)), contact)


def resolving_rate(model: Model, p: np.ndarray, seconds: float) -> float:
    """Steps a second with which no vibration's phase is wrong by more than :data:`LARGEST_PHASE` before it decays.

    Classical Runge-Kutta turns a vibration of ω·h = z by z⁵/120 too far in a step. With steps twice as coarse that is
    a turn, so the readings of two runs differ by as much as the vibration is large. About rest; p (b, p).
    """
    if not model.n:
        return 0.0
    values = np.linalg.eigvals(_state_matrices(model, np.zeros((len(model.states), len(p))),
                               np.zeros((len(model.inputs), len(p))), p.T)).ravel()  # fmt: skip
    size = np.abs(values)
    lasting = size * np.minimum(seconds, 1 / np.maximum(-values.real, 1e-300))
    rates = size * (lasting / (120 * LARGEST_PHASE)) ** 0.25
    return float(rates[-values.real < WELL_DAMPED * size].max(initial=0.0))


def _state_matrices(model: Model, x: np.ndarray, u: np.ndarray, p: np.ndarray) -> np.ndarray:
    """A (k, x, x) at several points, given by columns."""
    n, k = x.shape
    A = np.array(model.jacobians.map(k)(x, u, p, np.zeros((1, k)))[0].full()) if n else np.empty((0, 0))
    if not np.isfinite(A).all():
        raise SimulationError(
            "simulation", "the linearised model is not finite", "check parameter values and start state"
        )
    return A.reshape(n, k, n).transpose(1, 0, 2)


# --- Stepping

OUTLIERS_IN = 32  # samples, of which one may miss a jump of torque: it lies on either side of it
NO_RANGE = 1e-6  # of a reading's size: a range below that is rounding
KINKED_ORDER, SMOOTH_ORDER = 2, 4  # with which the local errors of an interval fall at least


@dataclass(frozen=True)
class Stepping:
    """How a recording is stepped through: each interval between samples in ``refinement`` times the steps that
    ``steps_per_second`` asks for, at least one; implicit or explicit. ``refinement`` may be (t-1,)."""

    steps_per_second: float
    refinement: int | np.ndarray = 1
    implicit: bool = False

    def finer(self, factor: int | np.ndarray) -> Stepping:
        """The same with every step divided, by one factor or one an interval (t-1,)."""
        return replace(self, refinement=self.refinement * factor)

    def count(self, time: np.ndarray) -> float:
        """Steps in all for samples at ``time`` (t,)."""
        return float(np.sum(self.refinement * fewest_steps(np.diff(time), self.steps_per_second)))

    def mean_rate(self, time: np.ndarray) -> float:
        """Steps a second, on average over ``time`` (t,)."""
        return self.count(time) / float(np.ptp(time))


def is_rough(model: Model) -> bool:
    """Whether a torque of the model, or its derivative, may jump."""
    dogs = any(box.engages_below is not None for box in model.system.gearboxes)
    return dogs or any(effect.law.abrupt or effect.law.sticks for effect in model.system.effects)


def difference(coarse: Trajectories, fine: Trajectories, rough: bool) -> np.ndarray:
    """Largest differences (y,) of the readings over their ranges; of the states where there are no readings.

    ``rough``: the worst of :data:`OUTLIERS_IN` samples does not count.
    """
    first, second = (_by_column(done.readings if done.readings.shape[-1] else done.states) for done in (coarse, fine))
    apart = np.abs(first - second)
    return ((_outliers_lowered(apart) if rough else apart).max(axis=2) / _ranges(second)).max(axis=0, initial=0.0)


def local_errors(done: Trajectories, coordinates: int, rough: bool) -> np.ndarray:
    """Local errors (t-1,) of the intervals: of whichever reading or state behind the angles has the largest share of
    its range, over all rows of a batch. ``rough`` as for :func:`difference`, for the readings."""
    sensors = done.readings.shape[-1]
    errors = np.abs(_by_column(done.errors))
    if rough:
        errors[:, :sensors] = _outliers_lowered(errors[:, :sensors])
    of_readings, of_states = _ranges(_by_column(done.readings)), _ranges(_by_column(done.states[:, :, coordinates:]))
    return (errors / np.concatenate([of_readings, of_states], axis=1)[:, :, None]).max(axis=(0, 1), initial=0.0)


def divisions(errors: np.ndarray, allowed: float, order: int) -> np.ndarray:
    """Factors (t-1,), powers of two, by which steps are divided so that the ``errors`` (t-1,) add up to ``allowed``.

    The largest errors are lowered to one level; those below it stay.
    """
    falling = np.sort(errors)[::-1]
    count = np.arange(len(errors))
    rest = np.append(np.cumsum(falling[::-1])[::-1], 0.0)[: len(errors)]
    level = float(np.max((allowed - rest) / np.maximum(count, 1), initial=0.0, where=(count > 0) & (rest < allowed)))
    level = max(level, allowed / len(errors))
    wanted = np.log2(np.maximum(errors / level, 1.0)) / order
    return (2 ** np.ceil(wanted)).astype(np.int64)


def _by_column(values: np.ndarray) -> np.ndarray:
    """(b, k, t) of (b, t, k), contiguous: NumPy reduces the last axis ten times faster."""
    return np.ascontiguousarray(np.swapaxes(values, 1, 2))


def _ranges(values: np.ndarray) -> np.ndarray:
    """Ranges (b, k) of (b, k, t); 1 where there is none."""
    largest, smallest = values.max(axis=2, initial=-np.inf), values.min(axis=2, initial=np.inf)
    ranges = np.maximum(largest - smallest, NO_RANGE * np.maximum(np.abs(largest), np.abs(smallest)))
    return np.where(ranges > 0, ranges, 1.0)


def _outliers_lowered(values: np.ndarray) -> np.ndarray:
    """(b, k, t) with the worst of every :data:`OUTLIERS_IN` samples as large as the second."""
    whole = values.shape[2] // OUTLIERS_IN * OUTLIERS_IN
    if not values.size:
        return values
    windows = values[:, :, :whole].reshape(*values.shape[:2], -1, OUTLIERS_IN)
    lowered = np.minimum(windows, np.partition(windows, -2, axis=3)[..., -2:-1])
    return np.concatenate([lowered.reshape(*values.shape[:2], whole), values[:, :, whole:]], axis=2)


# --- Steps as small as a stated tolerance needs.
#
# A run gives its local errors, sample by sample. The steps are divided where these are largest, until they add up to no
# more than the tolerance, or until two runs show that: the readings' differences say how much error the steps that were
# divided had caused, and the local errors how much of it is left. A model is stepped implicitly where its fastest
# decay, which nothing shows, would need far smaller explicit steps than what vibrates. Vibrations are always resolved:
# an implicit method would damp them.

TOLERANCE = 1e-4  # of each reading's range
VIBRATION_STEP, CONTACT_STEP = 1.6, 0.5  # |λ|·h, ω·h to begin with
IMPLICIT_COST = 8.0  # explicit steps that take as long as an implicit one: 6 to 10 measured
FINEST = 256  # times the first steps; what does not converge by then is chaotic, or jumps too often
FASTEST = 8 * MAX_STEPS_PER_SECOND  # mean steps a second of a refined run: some seconds of processor time a second
MOST_INTERPRETED = 2e7  # states at the ends of steps without a compiler: some 10 s and 0.5 GB
INTERPRETED_IMPLICIT_COST = 3.0  # the same without a compiler: 2.4 to 3.4 measured
CALMER = 4  # refinement where a state is not finite
SAME_MOMENT, SAME_MOMENT_RELATIVE = 2, 0.02  # samples, of the time: so near, two runs end at the same moment
CALIBRATED_SHARE = 1 / 16  # of the local errors that are left before two runs show what they do: halved steps
HALVED, HALVED_IMPLICIT = 3 / (2**4 - 1), 3 / (2**3 - 1)  # of what halved steps change, thrice what theory says is left
ROUNDING = 1e-9  # of the range: what sums of many steps lose
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
    """A task by the compiled integrator, or by the virtual machine where there is no compiler or it is not wanted.

    Raises
    ------
    SimulationError
        If the steps are too many for the virtual machine.
    """
    done = run_compiled(task, states, readings, errors=errors) if compiled is not False else None
    if done is not None:
        return done
    if task.steps.sum() > _most_interpreted(len(task.model.states) * (1 + task.columns), task.implicit):
        raise SimulationError(
            "simulation", f"{task.steps.sum():.3g} steps take too long without a C compiler",
            "install one (such as gcc), or look for a very small inertia or time constant",
        )  # fmt: skip
    return interpreted.run(task, states, readings, errors)


def _most_interpreted(states: int, implicit: bool) -> float:
    """Steps of so many states that are taken without a compiler."""
    return MOST_INTERPRETED / max(1, states) / (INTERPRETED_IMPLICIT_COST if implicit else 1.0)


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
    stepping = suited(rates, problem.time, problem.model)
    if not stepping.implicit and explicit_steps(rates) > MAX_STEPS_PER_SECOND:
        raise too_fast(rates.any, explicit_steps(rates))
    used, done = _finite_run(problem, stepping, compiled)
    first = FirstRun(done, used, rates)
    return first if used is stepping and not used.implicit else along_the_motion(problem, first, compiled)


def along_the_motion(problem: InitialValueProblem, first: FirstRun, compiled: bool | None) -> FirstRun:
    """A first run with the steps that the eigenvalues along its motion ask for."""
    model, time, rates = problem.model, problem.time, first.rates
    if not model.system.gearboxes and not any(effect.law.state_dependent for effect in model.system.effects):
        return first
    for p, motion in zip(problem.p, first.trajectories.states, strict=True):
        rates |= rates_along(model, p, motion, problem.inputs)
    better = suited(rates, time, model)
    if better.implicit != first.stepping.implicit or better.count(time) > first.stepping.count(time):
        stepping, done = _finite_run(problem, better, compiled)
        return FirstRun(done, stepping, rates)
    return replace(first, rates=rates)


def explicit_steps(rates: Rates) -> float:
    """Explicit steps a second that are stable and follow every vibration."""
    return max(rates.any / STABLE_STEP, rates.vibration / VIBRATION_STEP, rates.contact / CONTACT_STEP, 1.0)


def suited(rates: Rates, time: np.ndarray, model: Model) -> Stepping:
    """Implicit steps where far fewer follow every vibration than explicit ones need to be stable; else explicit.

    Explicit ones are even in number from sample to sample; ``time`` (t,) in s. A limited rate is stepped explicitly
    where that is possible: it is fast where it follows and jumps to its limit within a step, which the error estimate
    of an implicit step does not see.
    """
    explicit = explicit_steps(rates)
    if FOLLOW_TIME in model.parameters and explicit <= MAX_STEPS_PER_SECOND:
        return Stepping(explicit / 2, refinement=2)
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
    rough = is_rough(model)
    order = KINKED_ORDER if rough else SMOOTH_ORDER
    first, local = _fitting_first_run(problem, tolerance, order, rough, compiled)
    stepping, done = first.stepping, first.trajectories
    most = min(FINEST * stepping.count(time), max(FASTEST * float(np.ptp(time)), stepping.count(time)))
    if compiled is False or compiler() is None:
        most = min(most, max(_most_interpreted(len(model.states), stepping.implicit), stepping.count(time)))
    error = np.full(max(1, len(model.sensors)), np.inf if local.any() else 0.0)
    allowed = _first_allowed(local, tolerance)
    least = 1 if rough else 2 ** max(1, ceil(log2(_resolving(problem) / stepping.mean_rate(time))))
    unresolved = stepping.count(time) * least > most
    least = min(least, 2) if unresolved else least
    for _ in range(ROUNDS):
        if error.max() <= tolerance:
            break
        divided = np.minimum(divisions(local, allowed, order), MOST_AT_ONCE)
        finer = stepping.finer(np.maximum(divided, least))
        if finer.count(time) > most and np.isfinite(error).all():
            break
        fine = problem.run(finer, compiled, errors=True)
        while (fine.failed[:, 0] >= 0).any() and CALMER * finer.count(time) <= most:
            finer = finer.finer(CALMER)  # only some samples were divided, and one of the others is too coarse now
            fine = problem.run(finer, compiled, errors=True)
        raise_if_failed(fine.failed, time, model.states)
        left = local_errors(fine, model.n, rough)
        before, after = float(local.sum()), float(left.sum())
        if rough:
            share = max(after / (before - after), CALIBRATED_SHARE) if after < before else NOTHING_GAINED
        else:
            share = HALVED_IMPLICIT if stepping.implicit else HALVED
        error = difference(done, fine, rough) * share
        error = np.maximum(error, before if unresolved else ROUNDING)
        least = 1 if rough else 2
        stepping, done, local = finer, fine, left
        allowed = after * float(np.clip(AIM * tolerance / max(error.max(), 1e-300), CALIBRATED_SHARE, 0.5))
    if len(model.sensors):
        error = np.maximum(error, _rounding(problem, done, stepping.count(time)))
    return Controlled(done, stepping, error)


def _rounding(problem: InitialValueProblem, done: Trajectories, steps: float) -> np.ndarray:
    """Errors (y,) over the ranges that come from the rounding of the states, which adds up like a random walk.

    It counts where a stiff shaft turns the small difference of two large angles into a torque.
    """
    largest = np.abs(done.states).max(axis=1)
    slopes = [
        problem.model.jacobians(x, problem.inputs[0], p, 0.0)[2].full()
        for x, p in zip(problem.start, problem.p, strict=True)
    ]
    lost = np.einsum("byx,bx->by", np.abs(np.nan_to_num(slopes)), largest) * np.finfo(float).eps * np.sqrt(steps)
    of_readings = _ranges(_by_column(done.readings)) if lost.size else np.ones_like(lost)
    return (lost / of_readings).max(axis=0, initial=0.0)


def _resolving(problem: InitialValueProblem) -> float:
    """See :func:`resolving_rate`; at least 1."""
    return max(1.0, resolving_rate(problem.model, problem.p, float(np.ptp(problem.time))))


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


# --- Dry friction and limited rates sharp enough: what their regularisation changes is part of the error that a
# simulation controls.

SHARPER = 5.0  # times sharper from run to run; what still changes then is this less one times the error that is left
MOST_RUNS = 5
STEPS_SHARE = 0.1  # of the tolerance, for the steps: a transition that a whole step skips hides in their error estimate


@dataclass(frozen=True)
class Sharpened:
    """A run with friction and limited rates as sharp as the tolerance asks.

    ``stick_speed`` is in rad/s, NaN without dry friction. ``before`` holds the states (b, t, x) of the last blunter
    run, if there is one, ``change`` (y,) what sharpening has changed since then, as a share of each reading's range.
    """

    controlled: Controlled
    problem: InitialValueProblem
    stick_speed: float
    before: np.ndarray | None
    change: np.ndarray


def sharp_enough(
    problem: InitialValueProblem,
    blunt: Controlled,
    tolerance: float,
    compiled: bool | None,
    most_runs: int,
) -> Sharpened:
    """The run with a stick speed and a follow time so small that they change no reading by more than the tolerance.

    The error of a regularised law is proportional to them, so it is read off two runs. Where a sharper
    law comes no nearer (a torque that jumps between two samples; a motion that depends on it without end), the last run
    that did is taken, and its error says so.

    Parameters
    ----------
    problem : InitialValueProblem
        Of one parameter set.
    blunt : Controlled
        Its run.
    tolerance : float
        Share of each reading's range.
    most_runs : int
        0: the law stays as it is. Without dry friction and limited rates it does anyway.
    """
    names = problem.model.parameters
    at = [names.index(name) for name in (STICK_SPEED, FOLLOW_TIME) if name in names]
    if not at:
        return Sharpened(blunt, problem, float("nan"), None, np.zeros(1))
    best, smallest, before, last = blunt, np.inf, None, np.zeros(1)
    for _ in range(most_runs):
        p = problem.p.copy()
        p[0, at] /= SHARPER
        try:
            sharper = run_to_tolerance(replace(problem, p=p), STEPS_SHARE * tolerance, compiled)
        except SimulationError:
            break
        change = difference(best.trajectories, sharper.trajectories, rough=True)
        if change.max(initial=0.0) >= smallest:
            break
        smallest = float(change.max(initial=0.0))
        before, last = best.trajectories.states, change
        best, problem = replace(sharper, error=np.maximum(sharper.error, change)), replace(problem, p=p)
        if smallest <= tolerance:
            break
    speed = float(problem.p[0, names.index(STICK_SPEED)]) if STICK_SPEED in names else float("nan")
    return Sharpened(best, problem, speed, before, last)


# --- The error that a simulation states where a torque jumps or has a kink.
#
# Where a step meets a kink its error is of no order: two runs tell what the finer one has left only to a factor. Stated
# is therefore more than theory says is left: three times what halving all steps changed, and all that the last
# sharpening of dry friction changed, of which theory leaves a quarter. A reading that jumps where a flank is met may be
# on the wrong side of the jump: the readings of all states within the error are looked at.

SAFETY = 3.0  # for two runs of unknown order (Roache, Perspective: a method for uniform reporting of grid refinement
# studies, Journal of Fluids Engineering 116, 1994)
SHARP_CONTACT = 1e-12  # of the time over which damping sets in at contact: a jump


def with_stated_error(sharpened: Sharpened, compiled: bool | None) -> Controlled:
    """The run with every step halved, and the error of its readings over their ranges, for a model that is not smooth.

    See :data:`SAFETY`.
    """
    problem, coarse = sharpened.problem, sharpened.controlled
    stepping = coarse.stepping.finer(2)
    fine = problem.run(stepping, compiled, errors=True)
    raise_if_failed(fine.failed, problem.time, problem.model.states)
    changes = [SAFETY * (fine.states - coarse.trajectories.states)]
    if sharpened.before is not None:
        changes.append(coarse.trajectories.states - sharpened.before)
    error = SAFETY * difference(coarse.trajectories, fine, rough=True) + sharpened.change
    if problem.model.sensors:
        error = np.maximum(error, _beside_jumps(problem, fine, changes))
        error = np.maximum(error, _rounding(problem, fine, stepping.count(problem.time)))
    return Controlled(fine, stepping, error)


def _beside_jumps(problem: InitialValueProblem, done: Trajectories, changes: Sequence[np.ndarray]) -> np.ndarray:
    """How far readings (y,) are from those of states that differ by ``changes`` (b, t, x), over their ranges."""
    model = problem.model
    if CONTACT_TIME not in model.parameters:
        return np.zeros(len(model.sensors))
    delays = model.delays(problem.p[0]) if any(p.delay != 0 for p in model.equations.assembly.inputs.values()) else None
    late = np.zeros(len(model.inputs)) if delays is None else np.array(delays[0]).ravel()
    u = np.array([np.interp(problem.time - by, problem.time, values) for by, values in zip(late, problem.inputs.T)])
    p = problem.p[0].copy()
    p[model.parameters.index(CONTACT_TIME)] = SHARP_CONTACT
    count = len(problem.time)
    read = model.readings.map(count)
    prompt = np.array([path.delay == 0 for path in model.equations.assembly.sensors.values()])
    taken, largest = done.readings[0], np.zeros(len(model.sensors))
    for change in [np.zeros_like(done.states), *changes, *(-each for each in changes)]:
        x = (done.states + change)[0]
        there = read(x.T, u, np.tile(p[:, None], count), problem.time[None]).full().T
        largest = np.maximum(largest, np.abs(there - taken).max(axis=0))
    return np.where(prompt, largest / _ranges(_by_column(done.readings))[0], 0.0)
