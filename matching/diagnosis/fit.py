"""Fits by output error: free simulation against measurement, weighted by the sensors' uncertainty, within bounds.

Gauss–Newton with a trust region on the scaled variables. The Jacobian comes from finite differences and is kept while
the steps it gives do what they promise and converge fast (a chord method; Kelley, Iterative Methods for Linear and
Nonlinear Equations, 1995, section 5.4). SciPy's ``least_squares`` (trf, scaled by the Jacobian) with the same Jacobian
and the same rule to keep it finds the same values with up to twice the simulations and five times the time.
"""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import scipy
from scipy.linalg import solve_triangular

from matching.diagnosis.data import SMALLEST_SCALE, FitData, Segment, Weighting, weighting_of
from modelling.effects import EFFECTS
from modelling.equations.casadi_code import Model, compiled
from modelling.equations.lagrange import RECORDING, STICK_SPEED
from modelling.resources import threads, time_is_over
from modelling.simulation import interpreted
from modelling.simulation.compiled import compile_ahead, run_all_compiled
from modelling.simulation.stepping import rates_at_rest
from modelling.simulation.task import IntegrationTask, Trajectories, functions, make_task
from modelling.system import Effect, Gear, Shaft, System

# --- Simulations of one model over recorded inputs for many sets of parameters and start states.

FEWEST_SAMPLES_FOR_THREADS = 4000  # of all rows; below, threads cost more than they save (measured on two cores)
LEAST_STEPS_PER_SAMPLE, MOST_STEPS_PER_SAMPLE = 2.0, 8.0  # of the plan for a model without abrupt torques
UNSTABLE_RATE = 2.7  # rate times step; the same limit, just reached
STABLE_RATE = 2.2  # rate times step; classical Runge–Kutta of order 4 is stable up to 2.78 on the negative real axis
LOWEST_STICK_SPEED, HIGHEST_STICK_SPEED, STICK_SPEED_FACTOR = 1e-5, 1e3, 1.5  # rad/s, rad/s, between two trials


def compile_models(systems: Iterable[System]) -> None:
    """Compile the models of several systems side by side; what the cache holds is not compiled again."""
    compile_ahead([functions(compiled(system)) for system in systems])


def simulate_readings(
    model: Model,
    segments: Sequence[Segment],
    p: np.ndarray,
    starts: Sequence[np.ndarray],
    steps_per_second: float,
) -> list[np.ndarray]:
    """Readings (b, t, y), SI, of each segment; rows that diverge are NaN.

    Parameters
    ----------
    p : ndarray (b, p)
    starts : sequence of ndarray (b, x)
        Start states of each segment.
    """
    tasks = _tasks(model, segments, p, starts, steps_per_second)
    return [done.readings for done in _run(tasks, states=False)]


def simulate_states(
    model: Model,
    segments: Sequence[Segment],
    p: np.ndarray,
    starts: Sequence[np.ndarray],
    steps_per_second: float,
) -> list[np.ndarray]:
    """States (t, x) of each segment for parameters (p,) and a start state (x,) of each."""
    tasks = _tasks(model, segments, p[None], [start[None] for start in starts], steps_per_second)
    return [done.states[0] for done in _run(tasks, readings=False)]


def _tasks(
    model: Model, segments: Sequence[Segment], p: np.ndarray, starts: Sequence[np.ndarray], steps_per_second: float
) -> list[IntegrationTask]:
    stiff = _stiff(model, steps_per_second)
    return [
        make_task(
            model, segment.time, segment.inputs, _of_recording(model, p, segment.recording), start, steps_per_second,
            implicit=stiff,
        )
        for segment, start in zip(segments, starts, strict=True)
    ]  # fmt: skip


def _of_recording(model: Model, p: np.ndarray, number: int) -> np.ndarray:
    """Parameters (b, p) as they hold in a recording."""
    if RECORDING not in model.parameters:
        return p
    return np.where(np.arange(len(model.parameters)) == model.parameters.index(RECORDING), float(number), p)


@functools.lru_cache(maxsize=512)
def _stiff(model: Model, steps_per_second: float) -> bool:
    """Whether explicit steps at this rate are unstable for the model as it stands, dry friction aside.

    Decided by the model's nominal values, so that all simulations of a fit take the same kind of step.
    """
    p = model.p0.copy()
    if STICK_SPEED in model.parameters:
        p[model.parameters.index(STICK_SPEED)] = 1e9  # friction that hardly depends on speed
    return rates_at_rest(model, p[None]).any > UNSTABLE_RATE * steps_per_second


def _run(tasks: Sequence[IntegrationTask], states: bool = True, readings: bool = True) -> list[Trajectories]:
    samples = sum(len(task.p) * len(task.time) for task in tasks)
    count = threads() if samples > FEWEST_SAMPLES_FOR_THREADS else 1
    results = run_all_compiled(tasks, states, readings, count) if tasks else []
    return results if results is not None else [interpreted.run(task, states, readings) for task in tasks]


def fastest_rate(model: Model, p: np.ndarray, states: np.ndarray, inputs: np.ndarray) -> float:
    """Largest magnitude (1/s) of the eigenvalues of the linearised model at several states (b, x)."""
    fastest = 0.0
    for x in states:
        a = np.array(model.jacobians(x, inputs, p, 0.0)[0])
        if np.isfinite(a).all():
            fastest = max(fastest, float(np.abs(np.linalg.eigvals(a)).max(initial=0.0)))
    return fastest


def steps_and_stick_speed(
    model: Model, p: np.ndarray, states: np.ndarray, sampling: float, fine: float, least: float = 0.0
) -> tuple[float, float]:
    """Integration steps per second, and the stick speed (rad/s) that they resolve; NaN without dry friction.

    The fastest mode, dry friction aside, gets ``fine`` steps a radian. The stick speed is then raised until friction at
    rest is no faster than the steps can follow.

    Parameters
    ----------
    states : ndarray (b, x)
        At which the rates are looked at.
    sampling : float
        Of the recording, Hz.
    fine : float
        Steps a radian of the fastest mode.
    least : float
        Steps per second at least.
    """
    inputs = np.zeros(len(model.inputs))
    index = model.parameters.index(STICK_SPEED) if STICK_SPEED in model.parameters else None
    p = p.copy()
    if index is not None:
        p[index] = 1e9  # friction that hardly depends on speed
    wanted = min(fine * fastest_rate(model, p, states, inputs), MOST_STEPS_PER_SAMPLE * sampling)
    steps = max(LEAST_STEPS_PER_SAMPLE * sampling, least, wanted)
    steps = float(np.ceil(steps / sampling - 1e-6)) * sampling
    if index is None:
        return steps, np.nan
    rest = np.zeros((1, states.shape[1]))
    stick_speed = LOWEST_STICK_SPEED
    while stick_speed < HIGHEST_STICK_SPEED:
        p[index] = stick_speed
        if fastest_rate(model, p, rest, inputs) < STABLE_RATE * steps:
            break
        stick_speed *= STICK_SPEED_FACTOR
    return steps, stick_speed


# --- States at the start of a segment: which angles are held, and where a fit begins.

FIRST_SAMPLES = 20  # that are averaged for the speed at the start


def sensors_with_zero(system: System) -> list[int]:
    """Angle sensors whose zero is fitted, by index: all but the first of every connected part of the drivetrain.

    Encoders start anywhere. The zero of the first is the angle at the start, which is fitted anyway; the difference
    between two says nothing about the twist of what is between them.
    """
    connected, reached, with_zero = _connected_inertias(system), set[str](), []
    for j, sensor in enumerate(system.sensors):
        if sensor.measures == "angle":
            if sensor.of in reached:
                with_zero.append(j)
            reached |= connected[sensor.of]
    return with_zero


def angles_without_reading(system: System, model: Model) -> set[int]:
    """Coordinates that are held at the start: one of every connected part of the drivetrain without an angle sensor.

    Speeds, torques and accelerations do not depend on the common angle of such a part, unless one of it is imposed.
    """
    connected, quantities = _connected_inertias(system), system.input_quantities
    measured = [sensor.of for sensor in system.sensors if sensor.measures == "angle"]
    measured += [part.on for part in system.inputs if quantities[part.name] == "angle"]
    known = {name for angle_of in measured for name in connected[angle_of]}
    held = set()
    for i, coordinate in enumerate(model.coordinates):
        if coordinate in connected and coordinate not in known:
            held.add(i)
            known |= connected[coordinate]
    return held


def states_of_time(system: System, model: Model) -> list[tuple[int, Effect]]:
    """States, by index, that follow from the time since a recording began alone, with the effect they are of."""
    return [
        (model.states.index(effect.name), effect)
        for effect in system.effects
        if effect.law.state is not None and effect.law.state.from_zero
    ]


def _connected_inertias(system: System) -> dict[str, set[str]]:
    """By inertia: those that shafts, gears and differentials connect it with, itself included."""
    connected = {part.name: {part.name} for part in system.inertias}
    joints = [shaft.between for shaft in system.shafts] + [gear.between for gear in system.gears]
    for ends in [*joints, *((part.cage, part.left, part.right) for part in system.differentials)]:
        merged = set().union(*(connected[name] for name in ends))
        for name in merged:
            connected[name] = merged
    return connected


def flank_shifts(system: System, model: Model) -> list[np.ndarray]:
    """Changes (x,) of a start state: none, and with backlash to either flank of each gap.

    A start state is fitted from each of them: within a gap no torque tells in which direction the flanks are.
    """
    shifts = [np.zeros(len(model.states))]
    for effect in system.effects:
        if not effect.law.free_play:
            continue
        gap = system.parameters[f"{effect.name}.{effect.law.free_play}"].value
        shaft = next(shaft for shaft in system.shafts if f"shafts.{shaft.name}" == effect.at)
        moved = _turns_with(system, shaft.between[1], shaft.name)
        shift = np.array([moved.get(name, 0.0) for name in model.coordinates])
        for flank in (-gap / 2, gap / 2):
            shifts.append(np.concatenate([flank * shift, np.zeros(len(model.states) - model.n)]))
    return shifts


def _turns_with(system: System, inertia: str, without_shaft: str = "") -> dict[str, float]:
    """By inertia: its angle when one turns by 1 rad and all that shafts and gears connect follows without twist, a
    shaft left out."""
    angles, reached = {inertia: 1.0}, [inertia]
    joints: dict[str, Shaft | Gear] = {
        f"shafts.{shaft.name}": shaft for shaft in system.shafts if shaft.name != without_shaft
    }
    joints |= {f"gears.{gear.name}": gear for gear in system.gears}
    while reached:
        name = reached.pop()
        for place, joint in joints.items():
            if name not in joint.between:
                continue
            first, second = joint.between
            ratio = system.parameters.get(f"{place}.ratio")
            factor = ratio.value if ratio is not None else 1.0
            other, angle = (second, angles[name] / factor) if name == first else (first, angles[name] * factor)
            if other not in angles:
                angles[other] = angle
                reached.append(other)
    return angles


def first_state(system: System, model: Model, segment: Segment) -> np.ndarray:
    """A state (x,) from which a fit of the start state begins.

    Speeds as measured; other inertias turn with the mean of the measured speeds, where there is no gear. The first
    angle sensor of a connected part gives its angle; the rest of the part stands without twist. An imposed motion
    begins as recorded.
    """
    x, n = np.zeros(len(model.states)), model.n
    with_zero = sensors_with_zero(system)
    speeds: dict[int, float] = {}
    for j, sensor in enumerate(system.sensors):
        values = segment.readings[:FIRST_SAMPLES, j]
        values = values[np.isfinite(values)]
        if not len(values):
            continue
        if sensor.measures == "speed" and sensor.of in model.coordinates:
            speeds[model.coordinates.index(sensor.of)] = float(values.mean())
        elif sensor.measures == "angle" and j not in with_zero:
            for name, share in _turns_with(system, sensor.of).items():
                if name in model.coordinates:
                    x[model.coordinates.index(name)] = share * float(values[0])
    common = float(np.mean(list(speeds.values()))) if speeds and not system.gears else 0.0
    for i in range(n):
        x[n + i] = speeds.get(i, common)
    _start_as_imposed(system, model, segment, x)
    return x


def _start_as_imposed(system: System, model: Model, segment: Segment, x: np.ndarray) -> None:
    """Let, in place, inertias whose motion is imposed begin as recorded."""
    for j, part in enumerate(system.inputs):
        if part.name not in system.imposed_by or part.on not in model.coordinates:
            continue
        i, recorded = model.coordinates.index(part.on), segment.inputs[:FIRST_SAMPLES, j]
        if system.input_quantities[part.name] == "angle":
            for name, share in _turns_with(system, part.on).items():
                if name in model.coordinates:
                    x[model.coordinates.index(name)] = share * recorded[0]
            recorded = np.gradient(recorded, segment.time[:FIRST_SAMPLES])
        x[model.n + i] = recorded[0]


# --- The least-squares problem of a fit: free parameters and start states → residuals in times the noise.

STEPS_PER_RADIAN = 3.0  # of the fastest mode in a search; the final fit takes twice as many


@dataclass
class FitProblem:
    """One system, the data, and which of its parameters are free within which bounds.

    The variables (v,) are the free parameters, in the order of ``bounds``, then the free start states of each segment.

    Attributes
    ----------
    system : System
    data : FitData
    bounds : dict of str to (float, float)
        Lower and upper bound of the free parameters, SI.
    steps_per_second : float
        Of the integration.
    stick_speed : float
        Speed over which dry friction changes its sign, rad/s; NaN without dry friction.
    held_states : list of ndarray (x,), optional
        States at the start of the segments from which held angles are taken; 0 without them.
    weighting : Weighting, optional
        Of the residuals, where the model is not perfect; without it they are weighted by the noise alone.
    zero_samples : tuple of int, optional
        From how many first samples of each segment the zeros of angle sensors are estimated; all without it.
    """

    system: System
    data: FitData
    bounds: dict[str, tuple[float, float]]
    steps_per_second: float
    stick_speed: float
    held_states: list[np.ndarray] | None = None
    weighting: Weighting | None = None
    zero_samples: tuple[int, ...] | None = None
    model: Model = field(init=False)

    def __post_init__(self) -> None:
        self.model = compiled(self.system)
        self.free = list(self.bounds)
        self._parameter_index = np.array([self.model.parameters.index(name) for name in self.free], dtype=int)
        self._with_zero = sensors_with_zero(self.system)
        self._of_time = states_of_time(self.system, self.model)
        held = angles_without_reading(self.system, self.model) | {i for i, _ in self._of_time}
        self.free_states = [i for i in range(len(self.model.states)) if i not in held]
        self.size = len(self.free) + len(self.free_states) * len(self.data.segments)
        unbounded = np.full(self.size - len(self.free), np.inf)
        self.lower = np.concatenate([[low for low, _ in self.bounds.values()], -unbounded])
        self.upper = np.concatenate([[high for _, high in self.bounds.values()], unbounded])

    def pack(self, values: Mapping[str, float], starts: list[np.ndarray]) -> np.ndarray:
        """Parameter values by name and start states (x,) of the segments → variables (v,)."""
        return np.concatenate([[values[name] for name in self.free], *(start[self.free_states] for start in starts)])

    def unpack(self, v: np.ndarray) -> tuple[np.ndarray, list[np.ndarray]]:
        """Variables (v,) → parameters (p,) of the model and start states (x,) of the segments."""
        p = self.model.p0.copy()
        p[self._parameter_index] = v[: len(self.free)]
        if STICK_SPEED in self.model.parameters:
            p[self.model.parameters.index(STICK_SPEED)] = self.stick_speed
        starts = []
        for i, states in enumerate(np.split(v[len(self.free) :], len(self.data.segments))):
            start = np.zeros(len(self.model.states)) if self.held_states is None else self.held_states[i].copy()
            start[self.free_states] = states
            self._set_states_of_time(start, p, float(self.data.segments[i].time[0]))
            starts.append(start)
        return p, starts

    def _set_states_of_time(self, start: np.ndarray, p: np.ndarray, seconds: float) -> None:
        """Set, in place, the states that follow from the time since the recording began."""
        for i, effect in self._of_time:
            values = {
                key: float(p[self.model.parameters.index(f"{effect.name}.{key}")]) for key, _ in effect.parameters
            }
            start[i] = effect.law.state_after(seconds, values)

    def residuals(self, batch: np.ndarray) -> np.ndarray:
        """Variables (b, v) → (measured − simulated)/noise (b, r), weighted, segment by segment, sample by sample,
        sensor by sensor; 0 where nothing was measured.

        The zeros of angle sensors are eliminated: on every segment the best zero is taken off.
        """
        parts = []
        for i, errors in enumerate(self._deviations(batch)):
            parts.append(self.counted(errors, i).reshape(len(batch), -1))
        return parts[0] if len(parts) == 1 else np.concatenate(parts, axis=1)

    def errors(self, v: np.ndarray) -> list[np.ndarray]:
        """Variables (v,) → (measured − simulated)/noise (t, y) of every segment, not weighted; 0 where nothing was
        measured."""
        plain = replace(self, weighting=None)
        return [plain.counted(errors, i)[0] for i, errors in enumerate(self._deviations(v[None]))]

    def counted(self, errors: np.ndarray, i: int) -> np.ndarray:
        """Errors (b, t, y) of a segment, in times the noise, as they count: weighted, and without the zeros of angle
        sensors."""
        weighted = self._weighted(errors, i)
        for j in self._with_zero:
            zero, signature = self._zero(weighted[:, :, j], i, j)
            weighted[:, :, j] -= zero[:, None] * signature
        return weighted

    def _weighted(self, errors: np.ndarray, i: int) -> np.ndarray:
        return errors if self.weighting is None else self.weighting.weigh(errors, self.data.segments[i].measured)

    def _deviations(self, batch: np.ndarray) -> Iterator[np.ndarray]:
        """(measured − simulated)/noise (b, t, y) of every segment for variables (b, v); 0 where nothing was
        measured."""
        unpacked = [self.unpack(v) for v in batch]
        p = np.array([parameters for parameters, _ in unpacked])
        starts = [np.array(states) for states in zip(*(states for _, states in unpacked), strict=True)]
        simulated = simulate_readings(self.model, self.data.segments, p, starts, self.steps_per_second)
        for segment, y in zip(self.data.segments, simulated, strict=True):
            r = np.subtract(segment.readings, y, out=y)  # in place: recordings may be long
            r /= self.data.noise
            if not segment.measured.all():
                r[:, ~segment.measured] = 0.0
            yield r

    def _zero(self, weighted: np.ndarray, i: int, j: int) -> tuple[np.ndarray, np.ndarray]:
        """Zero (b,) of an angle sensor, in times its noise, from its weighted errors (b, t) on a segment, and what one
        of 1 adds to these (t,)."""
        measured = self.data.segments[i].measured
        signature = self._weighted(np.where(measured, 1.0, 0.0)[None], i)[0, :, j]
        part = slice(None if self.zero_samples is None else self.zero_samples[i])
        return weighted[:, part] @ signature[part] / max(float(signature[part] @ signature[part]), 1e-300), signature

    def by_sensor(self, residual: np.ndarray) -> list[np.ndarray]:
        """A weighted residual (r,) as (t, y) of every segment."""
        ends = np.cumsum([segment.readings.size for segment in self.data.segments])
        parts = np.split(residual, ends[:-1])
        return [part.reshape(segment.readings.shape) for part, segment in zip(parts, self.data.segments, strict=True)]

    def simulated(self, v: np.ndarray) -> list[np.ndarray]:
        """Readings (t, y) of every segment, SI."""
        p, starts = self.unpack(v)
        batch = [start[None] for start in starts]
        simulated = simulate_readings(self.model, self.data.segments, p[None], batch, self.steps_per_second)
        return [y[0] for y in simulated]

    def states(self, v: np.ndarray) -> list[np.ndarray]:
        """States (t, x) of every segment."""
        p, starts = self.unpack(v)
        return simulate_states(self.model, self.data.segments, p, starts, self.steps_per_second)


def base_problem(system: System, data: FitData) -> tuple[FitProblem, np.ndarray]:
    """The problem of a system as given, its uncertain quantities free, and the variables (v,) to begin with."""
    model = compiled(system)
    bounds = {
        name: (q.lower, q.upper)
        for name, q in system.uncertain.items()
        if q.lower is not None and q.upper is not None and q.upper > q.lower
    }
    starts = [first_state(system, model, segment) for segment in data.segments]
    sampling = 1 / data.sampling_interval
    steps, stick_speed = steps_and_stick_speed(model, model.p0, np.array(starts), sampling, STEPS_PER_RADIAN)
    problem = FitProblem(system, data, bounds, steps, stick_speed)
    return problem, problem.pack({name: q.value for name, q in system.uncertain.items()}, starts)


# --- The Jacobian of the residuals by finite differences, many variables in one batch of simulations.

PARAMETER_STEP = 1e-3  # of the value, or of the width of its range where that is less
ZERO_STEP = 1e-6  # SI, of a parameter that is 0 and has no width
ANGLE_STEP, STATE_STEP = 1e-6, 1e-4  # rad; rad/s or the SI unit of an effect's state
BATCH = 8  # simulations that are held at once
DIVERGED = 1e100  # of a derivative, in times the noise: no parameter's influence but a simulation that diverged


def jacobian(
    problem: FitProblem,
    v: np.ndarray,
    residual: np.ndarray,
    columns: np.ndarray | None = None,
    largest_central: np.ndarray | None = None,
) -> np.ndarray:
    """Derivatives (r, c) of the residuals by the variables.

    Parameters
    ----------
    v : ndarray (v,)
    residual : ndarray (r,)
        At ``v``.
    columns : ndarray (c,), optional
        Indices of the variables; all if not given.
    largest_central : ndarray (v,), optional
        Take central differences with steps of at most these; forward differences if not given.
    """
    columns = np.arange(problem.size) if columns is None else columns
    central = largest_central is not None
    steps = _steps(problem, v)
    if largest_central is not None:
        steps = np.minimum(steps, largest_central)
    steps = np.where(v + steps > problem.upper, -steps, steps)
    out = np.zeros((len(residual), len(columns)), order="F")
    ends = np.cumsum([0, *(segment.readings.size for segment in problem.data.segments)])
    groups = _moved_together(problem, columns)
    for first in range(0, len(groups), BATCH):
        members = groups[first : first + BATCH]
        batch = np.repeat(v[None], len(members), axis=0)
        for row, group in zip(batch, members, strict=True):
            row[columns[group]] += steps[columns[group]]
        forward = problem.residuals(batch)
        mirrored = np.clip(2 * v - batch, problem.lower, problem.upper)
        backward = problem.residuals(mirrored) if central else [residual] * len(members)
        for moved, back, group in zip(forward, backward, members, strict=True):
            for c in group:
                j = columns[c]
                low = np.clip(v[j] - steps[j], problem.lower[j], problem.upper[j]) if central else v[j]
                segment = _segment_of(problem, j)
                rows = slice(None) if segment is None else slice(ends[segment], ends[segment + 1])
                np.subtract(moved[rows], back[rows], out=out[rows, c])
                out[rows, c] /= v[j] + steps[j] - low if central else steps[j]
                _remove_diverged(out[rows, c])
    return out


def _steps(problem: FitProblem, v: np.ndarray) -> np.ndarray:
    """(v,) steps of the differences, before any limit."""
    k = len(problem.free)
    width = problem.upper[:k] - problem.lower[:k]
    magnitudes = np.abs([problem.model.p0[problem.model.parameters.index(name)] for name in problem.free])
    at_zero = PARAMETER_STEP * np.minimum(width, np.where(magnitudes > 0, magnitudes, 1.0))
    at_zero[at_zero == 0] = ZERO_STEP
    parameters = np.where(v[:k] != 0, PARAMETER_STEP * np.minimum(np.abs(v[:k]), width), at_zero)
    states = [ANGLE_STEP if i < problem.model.n else STATE_STEP for i in problem.free_states]
    return np.concatenate([parameters, np.tile(states, len(problem.data.segments))])


def _segment_of(problem: FitProblem, j: int) -> int | None:
    """The segment whose start state a variable is; None of a parameter."""
    k = len(problem.free)
    return None if j < k else (j - k) // len(problem.free_states)


def _moved_together(problem: FitProblem, columns: np.ndarray) -> list[list[int]]:
    """Positions in ``columns`` that one simulation serves: a start state moves its own segment only, so the same state
    of all segments is moved at once."""
    k = len(problem.free)
    groups: dict[int, list[int]] = {}
    for position, j in enumerate(columns):
        key = int(j) if j < k else k + (int(j) - k) % len(problem.free_states)
        groups.setdefault(key, []).append(position)
    return list(groups.values())


def _remove_diverged(column: np.ndarray) -> None:
    """Set to 0, in place, what a diverged simulation left in a column whose square is not finite."""
    with np.errstate(over="ignore", invalid="ignore"):
        square = float(column @ column)
    if not np.isfinite(square):
        column[~(np.abs(column) < DIVERGED)] = 0.0


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
        self.factor = np.linalg.cholesky(self.hessian + RIDGE_OF_FACTOR * np.eye(len(scaled)))

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
        self._costs = [self.cost]  # after each iteration

    def _use(self, matrix: np.ndarray) -> None:
        if self.options.held:  # copied only then: recordings may be long
            matrix = matrix.copy()
            matrix[:, list(self.options.held)] = 0.0
        self.jacobian, self.quadratic = matrix, Quadratic(matrix)

    def run(self) -> Fit:
        """Iterate to the end."""
        for iteration in range(self.options.iterations):
            if (self.options.timed and time_is_over()) or not self._iterate(iteration):
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
        self._costs.append(reached)
        before = self._costs[max(len(self._costs) - 1 - PATIENCE, 0)]
        slow = before - reached < HOPELESS_PROGRESS * before
        if iteration >= PATIENCE and rival and reached > HOPELESS_RATIO * rival and slow:
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


# --- Dry friction as sharp as the data ask for: the speed over which its sign changes is halved while χ² falls.
#
# A search begins with a stick speed that few integration steps a sample resolve. What is then missing of the friction
# near rest stays in the residual, where a kind that is higher near rest (Stribeck), or a second cause, would explain
# it.

SEARCH_STEPS, FINAL_STEPS, MOST_STEPS_A_SAMPLE = 8, 16, 256  # integration steps a sample at most
ALMOST = 0.75  # of the most steps: halving once more would exceed them
DECREASE, DECREASE_SHARE = 3.0, 1e-4  # of χ² that is worth another halving: absolute, and of χ² itself
EXCESS_SHARE = 0.05  # the same beyond ``FINAL_STEPS``, of the misfit beyond noise
ITERATIONS = 12


def with_sharper_friction(fit: Fit, most_steps: int = SEARCH_STEPS) -> Fit:
    """The fit with its friction as sharp as pays, at ``most_steps`` a sample; itself without dry friction."""
    data = fit.problem.data
    sampling = 1 / float(np.median(np.concatenate([np.diff(segment.time) for segment in data.segments])))
    while np.isfinite(fit.problem.stick_speed) and fit.problem.steps_per_second < ALMOST * most_steps * sampling:
        if time_is_over():
            break
        worthwhile = max(DECREASE, DECREASE_SHARE * fit.cost)
        if fit.problem.steps_per_second > ALMOST * FINAL_STEPS * sampling:
            worthwhile = max(worthwhile, EXCESS_SHARE * (fit.cost - data.readings_count))
        sharper = replace(
            fit.problem, steps_per_second=2 * fit.problem.steps_per_second, stick_speed=fit.problem.stick_speed / 2
        )
        if fit.cost - _expected_cost(fit, sharper.residuals(fit.v[None])[0]) < worthwhile:
            break
        try:
            again = solve(sharper, fit.v, fit.jacobian, FitOptions(ITERATIONS, exact=False))
        except (FloatingPointError, np.linalg.LinAlgError):
            break
        if again.cost > fit.cost - worthwhile:
            break
        fit = again
    return fit


def _expected_cost(fit: Fit, residual: np.ndarray) -> float:
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
    for _ in range(MOST_GAUSS_NEWTON_STEPS):
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
OPTIONS = FitOptions(exact=False)


def iteratively_reweighted(fit: Fit) -> Fit:
    """The fit with each sensor weighted by what the model leaves of it, see :class:`Weighting`."""
    for _ in range(ROUNDS):
        if time_is_over():
            break
        weighting, before = discrepancy(fit), fit.problem.weighting
        if before is not None and _settled(before, weighting):
            break
        fit = solve(replace(fit.problem, weighting=weighting), fit.v, None, OPTIONS)
    return fit


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
    with contextlib.suppress(FloatingPointError):  # nothing simulates from there
        problem = replace(fit.problem, weighting=discrepancy_at(fit.problem, v))
        ends.append(iteratively_reweighted(solve(problem, v, None, OPTIONS)))
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
