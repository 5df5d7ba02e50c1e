"""The least-squares problem of a fit: free parameters and start states, residuals by free simulation, derivatives."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from matching.diagnosis.data import FitData, Segment, Weighting
from matching.diagnosis.simulation import simulate_readings, simulate_states, steps_and_stick_speed
from modelling.equations.casadi_code import Model, compiled
from modelling.equations.lagrange import STICK_SPEED
from modelling.system import Effect, System
from modelling.topology import connected_parts, joints, speed_ratios

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
            reached.update(connected[sensor.of])
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
            known.update(connected[coordinate])
    return held


def states_of_time(system: System, model: Model) -> list[tuple[int, Effect]]:
    """States, by index, that follow from the time since a recording began alone, with the effect they are of."""
    return [
        (model.states.index(effect.name), effect)
        for effect in system.effects
        if effect.law.state is not None and effect.law.state.from_zero
    ]


def _connected_inertias(system: System) -> dict[str, list[str]]:
    """By inertia: those that shafts, gears and differentials connect it with, itself included."""
    parts = connected_parts((part.name for part in system.inertias), joints(system))
    return {name: part for part in parts for name in part}


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
        moved = speed_ratios(shaft.between[1], joints(system, without=(effect.at,)))
        shift = np.array([moved.get(name, 0.0) for name in model.coordinates])
        for flank in (-gap / 2, gap / 2):
            shifts.append(np.concatenate([flank * shift, np.zeros(len(model.states) - model.n)]))
    return shifts


def first_state(system: System, model: Model, segment: Segment) -> np.ndarray:
    """A state (x,) from which a fit of the start state begins.

    Speeds as measured; other inertias turn with the measured ones without twist, on average. The first angle sensor of
    a connected part gives its angle; the rest of the part stands without twist. An imposed motion begins as recorded.
    """
    x, n = np.zeros(len(model.states)), model.n
    with_zero, every = sensors_with_zero(system), joints(system)
    speeds: dict[str, float] = {}
    for j, sensor in enumerate(system.sensors):
        values = segment.readings[:FIRST_SAMPLES, j]
        values = values[np.isfinite(values)]
        if not len(values):
            continue
        if sensor.measures == "speed":
            train = speed_ratios(sensor.of, joints(system, "gears"))
            speeds |= {name: ratio * float(values.mean()) for name, ratio in train.items()}
        elif sensor.measures == "angle" and j not in with_zero:
            for name, share in speed_ratios(sensor.of, every).items():
                if name in model.coordinates:
                    x[model.coordinates.index(name)] = share * float(values[0])
    for part in connected_parts((inertia.name for inertia in system.inertias), every):
        ratios = speed_ratios(part[0], every)
        common = np.mean([speeds[name] / ratios[name] for name in part if name in speeds] or [0.0])
        for name in set(part) & set(model.coordinates):
            x[n + model.coordinates.index(name)] = speeds.get(name, common * ratios[name])
    _start_as_imposed(system, model, segment, x)
    return x


def _start_as_imposed(system: System, model: Model, segment: Segment, x: np.ndarray) -> None:
    """Let, in place, inertias whose motion is imposed begin as recorded."""
    for j, part in enumerate(system.inputs):
        if part.name not in system.imposed_by or part.on not in model.coordinates:
            continue
        i, recorded = model.coordinates.index(part.on), segment.inputs[:FIRST_SAMPLES, j]
        if system.input_quantities[part.name] == "angle":
            for name, share in speed_ratios(part.on, joints(system)).items():
                if name in model.coordinates:
                    x[model.coordinates.index(name)] = share * recorded[0]
            recorded = np.gradient(recorded, segment.time[:FIRST_SAMPLES])
        x[model.n + i] = recorded[0]


# --- The least-squares problem of a fit: free parameters and start states → residuals in times the noise.

STEPS_PER_RADIAN = 0.7  # of the fastest mode at least: stable, also where a fit makes it three times stiffer
ENOUGH_STEPS = 25.0  # change of χ² by steps half as long: five standard deviations of one parameter show nothing else
MOST_STEPS = 16.0  # a sample, in which steps are halved for that


RUNS_AWAY = 1e90  # SI: of an error so large no square overflows


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
    """

    system: System
    data: FitData
    bounds: dict[str, tuple[float, float]]
    steps_per_second: float
    stick_speed: float
    held_states: list[np.ndarray] | None = None
    weighting: Weighting | None = None
    model: Model = field(init=False)

    def __post_init__(self) -> None:
        self.model = compiled(self.system)
        self.free = list(self.bounds)
        self._parameter_index = np.array([self.model.parameters.index(name) for name in self.free], dtype=int)
        self.with_zero = sensors_with_zero(self.system)
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
        for i, errors in enumerate(self.deviations(batch)):
            parts.append(self.counted(errors, i).reshape(len(batch), -1))
        return parts[0] if len(parts) == 1 else np.concatenate(parts, axis=1)

    def errors(self, v: np.ndarray) -> list[np.ndarray]:
        """Variables (v,) → (measured − simulated)/noise (t, y) of every segment, not weighted; 0 where nothing was
        measured."""
        plain = replace(self, weighting=None)
        return [plain.counted(errors, i)[0] for i, errors in enumerate(self.deviations(v[None]))]

    def counted(self, errors: np.ndarray, i: int) -> np.ndarray:
        """Errors (b, t, y) of a segment, in times the noise, as they count: weighted, and without the zeros of angle
        sensors."""
        weighted = self._weighted(errors, i)
        for j in self.with_zero:
            zero, signature = self._zero(weighted[:, :, j], i, j)
            weighted[:, :, j] -= zero[:, None] * signature
        return weighted

    def _weighted(self, errors: np.ndarray, i: int) -> np.ndarray:
        return errors if self.weighting is None else self.weighting.weigh(errors, self.data.segments[i].measured)

    def deviations(self, batch: np.ndarray) -> Iterator[np.ndarray]:
        """(measured − simulated)/noise (b, t, y) of every segment for variables (b, v); 0 where nothing was
        measured."""
        unpacked = [self.unpack(v) for v in batch]
        p = np.array([parameters for parameters, _ in unpacked])
        starts = [np.array(states) for states in zip(*(states for _, states in unpacked), strict=True)]
        simulated = simulate_readings(self.model, self.data.segments, p, starts, self.steps_per_second)
        for segment, y in zip(self.data.segments, simulated, strict=True):
            r = np.subtract(segment.readings, y, out=y)  # in place: recordings may be long
            np.clip(r, -RUNS_AWAY, RUNS_AWAY, out=r)
            r /= self.data.noise
            if not segment.measured.all():
                r[:, ~segment.measured] = 0.0
            yield r

    def _zero(self, weighted: np.ndarray, i: int, j: int) -> tuple[np.ndarray, np.ndarray]:
        """Zero (b,) of an angle sensor, in times its noise, from its weighted errors (b, t) on a segment, and what one
        of 1 adds to these (t,)."""
        measured = self.data.segments[i].measured
        signature = self._weighted(np.where(measured, 1.0, 0.0)[None], i)[0, :, j]
        return weighted @ signature / max(float(signature @ signature), 1e-300), signature

    def beyond_noise(self, chi_square: float) -> float:
        """How much of a χ² is more than noise: all of it where sensors are weighted by what the model leaves."""
        return chi_square - (self.data.readings_count if self.weighting is None else 0)

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
    v = problem.pack({name: q.value for name, q in system.uncertain.items()}, starts)
    return with_enough_steps(problem, v), v


def with_enough_steps(problem: FitProblem, v: np.ndarray) -> FitProblem:
    """The problem with steps so short that χ² of the variables v (v,) hardly changes with steps half as long.

    How exact a simulation has to be, the noise of the readings says: with a noise of a ten-thousandth of their range
    the steps that are stable leave an error that looks like a cause. Where a torque jumps that is no measure: rattling
    magnifies the smallest change, and dry friction gets the steps that its sharpness asks for.
    """
    if any(effect.law.abrupt or effect.law.sticks for effect in problem.system.effects):
        return problem
    most, coarse = MOST_STEPS / problem.data.sampling_interval, problem
    residual = coarse.residuals(v[None])[0]
    while 2 * coarse.steps_per_second <= most:
        finer = replace(coarse, steps_per_second=2 * coarse.steps_per_second)
        after = finer.residuals(v[None])[0]
        with np.errstate(over="ignore", invalid="ignore"):
            change = float(np.sum((after - residual) ** 2))
        if change < ENOUGH_STEPS:
            return coarse
        coarse, residual = finer, after
    return coarse if np.isfinite(residual).all() else problem


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
