"""Time simulation of the full nonlinear model: steps as fine as a tolerance asks, compiled where there is a compiler.

Classical Runge-Kutta of order four, for stiff models a Rosenbrock method. Inputs are samples of a continuous signal
and vary linearly between them; a dead time shifts them exactly, a delayed sensor reads between the steps. Before the
first sample the inputs held their first value.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from modelling.equations.casadi_code import Model, compiled
from modelling.equations.lagrange import STICK_SPEED
from modelling.errors import InputError, listed, unknown
from modelling.linear.elements import elements, rest_state
from modelling.recordings.channel_faults import hold_each_other, units_of
from modelling.recordings.recording import Recording, long_gaps
from modelling.simulation.start import Inputs, Start, checked, start_state, stick_speed
from modelling.simulation.stepping import (
    MOST_RUNS,
    TOLERANCE,
    Controlled,
    InitialValueProblem,
    Sensitivity,
    Simulation,
    SimulationError,
    Stepping,
    explicit_stepping,
    first_run,
    is_rough,
    raise_if_failed,
    run,
    run_to_tolerance,
    sharp_enough,
    with_stated_error,
)
from modelling.simulation.task import Trajectories, make_task
from modelling.system import System
from modelling.units import SENSOR_UNITS
from modelling.writing import LARGEST_RESULT

# --- Simulate


def simulate(
    model: System | Model,
    time: np.ndarray,
    inputs: Inputs,
    values: Mapping[str, float] | None = None,
    start: Start = None,
    sensors: Sequence[str] | None = None,
    *,
    tolerance: float = TOLERANCE,
    steps_per_second: float | None = None,
    compile: bool | None = None,  # noqa: A002
) -> Simulation:  # what is simulated and how are different things, all optional
    """Simulate a system on recorded inputs.

    Parameters
    ----------
    model : System or Model
    time : ndarray (t,)
        s, rising; need not be even.
    inputs : mapping of str to ndarray (t,), or ndarray (t, u)
        N·m.
    values : mapping, optional
        Parameters by name that differ from the model's, SI. ``simulation.stick_speed`` (rad/s) among them fixes over
        which speed the sign of dry friction changes; otherwise it is as small as the tolerance asks.
    start : see :func:`modelling.simulation.start.start_state`
    sensors : sequence of str, optional
        Which readings to return; all if not given.
    tolerance : float
        Largest error of the integration and of dry friction's regularisation, as a share of each reading's range.
    steps_per_second : float, optional
        Explicit steps at this rate instead; the error is then not estimated.
    compile : bool, optional
        False: CasADi's virtual machine even if there is a compiler.

    Raises
    ------
    InputError
        If time, inputs, names, tolerance or start do not fit.
    SimulationError
        If a state is not finite, or an eigenvalue is too fast.
    """
    model = compiled(model) if isinstance(model, System) else model
    time, u = checked(model, time, inputs)
    columns = _columns(model, sensors)
    p = with_stick_speed(model, time, u, model.vector(values), start, values or (), compile=compile)
    problem = InitialValueProblem(model, time, u, p[None], start_state(model, p, u[0], start)[None])
    fixed = steps_per_second is not None or STICK_SPEED in (values or ())
    blunt = _controlled(problem, tolerance, steps_per_second, compile)
    sharpened = sharp_enough(problem, blunt, tolerance, compile, most_runs=0 if fixed else MOST_RUNS)
    done = sharpened.controlled
    if is_rough(model) and steps_per_second is None:
        done = with_stated_error(sharpened, compile)
    _check_size(model, time, done.trajectories.states[0])
    return Simulation(
        time,
        {name: done.trajectories.readings[0, :, j].copy() for name, j in columns.items()},
        done.trajectories.states[0],
        list(model.states),
        {part.name: part.unit for part in model.system.sensors if part.name in columns},
        done.stepping.mean_rate(time),
        sharpened.stick_speed,
        done.stepping.implicit,
        {name: float(done.error[j]) for name, j in columns.items()},
    )


def _check_size(model: Model, time: np.ndarray, states: np.ndarray) -> None:
    """Raise for states (t, x) that ran away although they are finite."""
    beyond = np.argwhere(np.abs(states) > LARGEST_RESULT)
    if len(beyond):
        sample, state = beyond[0]
        raise SimulationError(
            "simulation",
            f"{model.states[state]} is {states[sample, state]:.3g} at {time[sample]:g} s",
            "check parameters, start and inputs: the motion grows without end",
        )


def _columns(model: Model, sensors: Sequence[str] | None) -> dict[str, int]:
    """Places of the chosen sensors among those of the model, of all by default."""
    for name in sensors or ():
        if name not in model.sensors:
            raise unknown(name, model.sensors, "sensors")
    return {name: model.sensors.index(name) for name in (model.sensors if sensors is None else sensors)}


def simulate_batch(
    model: System | Model,
    time: np.ndarray,
    inputs: Inputs,
    parameters: np.ndarray,
    start: Start = None,
    *,
    tolerance: float = TOLERANCE,
    steps_per_second: float | None = None,
    compile: bool | None = None,  # noqa: A002
) -> np.ndarray:  # what is simulated and how are different things
    """Readings (b, t, y) for parameter sets (b, p), SI, all with the same steps.

    ``parameters`` are used as they are, the stick speed included; :func:`with_stick_speed` chooses one. ``start`` may
    be (b, x). The others are as for :func:`simulate`.

    Raises
    ------
    InputError, SimulationError
        As :func:`simulate`.
    """
    model = compiled(model) if isinstance(model, System) else model
    time, u = checked(model, time, inputs)
    p = np.atleast_2d(np.ascontiguousarray(parameters, dtype=float))
    if p.ndim != 2 or p.shape[1] != len(model.parameters) or not np.isfinite(p).all():
        raise InputError(
            "parameters",
            f"shape {np.shape(parameters)}, or not finite",
            f"(b, {len(model.parameters)}) finite values are needed",
        )
    starts: list[Start] = list(start) if isinstance(start, np.ndarray) and start.ndim == 2 else [start] * len(p)
    if len(starts) != len(p):
        raise InputError("start", f"{len(starts)} rows", f"one a parameter set is needed: {len(p)}")
    states = np.stack([start_state(model, row, u[0], begin) for row, begin in zip(p, starts, strict=True)])
    problem = InitialValueProblem(model, time, u, p, states)
    return _controlled(problem, tolerance, steps_per_second, compile, states=False).trajectories.readings


def sensitivities(
    model: System | Model,
    time: np.ndarray,
    inputs: Inputs,
    parameters: np.ndarray,
    names: Sequence[str],
    start: Start = None,
    *,
    steps_per_second: float | None = None,
    compile: bool | None = None,  # noqa: A002
) -> Sensitivity:  # what is simulated and how are different things
    """Readings and their derivatives by parameters and start states, integrated along (forward sensitivities).

    They are the exact derivatives of the explicit fixed-step scheme, delays included; the start is held while
    parameters move. Time grows linearly with ``names``; the compiled code is the same for all of them.

    Parameters
    ----------
    time : ndarray (t,)
        s.
    parameters : ndarray (p,)
        Used as they are, see :func:`simulate_batch`.
    names : sequence of str
        Parameters (``shafts.link.stiffness``) and start states (``speed(motor)``).
    steps_per_second : float, optional
        Otherwise those of a simulation within the default tolerance, and enough for explicit steps to be stable.

    Raises
    ------
    InputError, SimulationError
        As :func:`simulate`.
    """
    model = compiled(model) if isinstance(model, System) else model
    time, u = checked(model, time, inputs)
    p = np.ascontiguousarray(parameters, dtype=float)
    if p.shape != (len(model.parameters),):
        raise InputError("parameters", f"shape {p.shape}", f"({len(model.parameters)},) is needed")
    problem = InitialValueProblem(model, time, u, p[None], start_state(model, p, u[0], start)[None])
    stepping = Stepping(steps_per_second) if steps_per_second else explicit_stepping(problem, compile)
    task = make_task(
        model, time, u, p[None], problem.start, stepping.steps_per_second, list(names), refinement=stepping.refinement
    )
    done = run(task, compile, states=False)
    raise_if_failed(done.failed, time, model.states)
    return Sensitivity(time, done.readings[0], done.derivatives[0], list(model.sensors), list(names))


def with_stick_speed(
    model: Model,
    time: np.ndarray,
    inputs: Inputs,
    parameters: np.ndarray,
    start: Start = None,
    fixed: Mapping[str, float] | Sequence[str] = (),
    *,
    compile: bool | None = None,  # noqa: A002
) -> np.ndarray:  # a simulation and what of it is fixed
    """Parameters (p,) with a stick speed that fits the motion, unless ``fixed`` names it or nothing sticks.

    Simulates once where there is dry friction; ``time`` (t,) in s. A fit calls this once.

    Raises
    ------
    InputError, SimulationError
        As :func:`simulate`.
    """
    p = np.array(parameters, dtype=float)
    if STICK_SPEED not in model.parameters or STICK_SPEED in fixed:
        return p
    time, u = checked(model, time, inputs)
    problem = InitialValueProblem(model, time, u, p[None], start_state(model, p, u[0], start)[None])
    states = first_run(problem, compile).trajectories.states[0]
    p[model.parameters.index(STICK_SPEED)] = stick_speed(model, p, states, 1 / float(np.median(np.diff(time))))
    return p


def _controlled(
    problem: InitialValueProblem,
    tolerance: float,
    steps_per_second: float | None,
    compile: bool | None,  # noqa: A002
    states: bool = True,
) -> Controlled:
    if steps_per_second is None:
        if not 0 < tolerance < 1:
            raise InputError("tolerance", f"{tolerance:g} is not possible", "give a share of the range, e.g. 1e-4")
        return run_to_tolerance(problem, tolerance, compile)
    stepping = Stepping(steps_per_second)
    done: Trajectories = problem.run(stepping, compile, states)
    raise_if_failed(done.failed, problem.time, problem.model.states)
    return Controlled(done, stepping, np.full(len(problem.model.sensors), np.nan))


# --- The start state that the beginning of a recording shows.

WINDOWS = (0.06, 0.25)  # s; over the short one, which comes first, even a lash hardly misleads
LEAST_SAMPLES = 8  # of a window, however seldom they are taken
MEDIAN_OF = 9  # samples, from which a speed to begin with is taken
ROUNDS = 6  # of Gauss-Newton
AT_REST = 1e-12  # SI, or of the largest reading: a sensor whose range is smaller does not move
SHARE_OF_RANGE = 1e-3  # taken for the uncertainty of a sensor that states none
WORTHWHILE = 1e-6  # relative decrease of the misfit
INSENSITIVE = 1e-9  # of the largest derivative by an angle or by a speed: below, it is what rounding leaves of none
UNSEEN = 1e-6  # of the largest singular value of the scaled derivatives: below, a direction is not determined
MOSTLY = 0.5  # share of a state in the directions that are not determined, from which on it is said


class RecordedStart(dict[str, float]):
    """Angles and speeds (rad, rad/s, by state name) of a start.

    Attributes
    ----------
    undetermined : list of str
        States that the recorded sensors do not determine although the motion depends on them.
    """

    undetermined: list[str]


def recorded_start(model: Model, recording: Recording, p: np.ndarray) -> RecordedStart:
    """The start from which the model fits the first quarter second best.

    Gauss-Newton on all recorded sensors, each weighted by its uncertainty. What the sensors do not determine stays near
    rest, and what nothing depends on is 0. Lash is tried open and on either flank. A model that is wrong there shifts
    the start.

    Parameters
    ----------
    p : ndarray (p,)
        See :func:`modelling.simulation.simulate.with_stick_speed`.
    """
    names = model.states[: 2 * model.n]
    closed = np.atleast_2d(rest_state(model, p))[0][: len(names)]
    out = RecordedStart((name, 0.0) for name in names)
    out.undetermined = []
    if not recording.sensors(model.system):
        return out
    turning = _measured_speeds(model, recording, p)
    candidates: list[tuple[float, np.ndarray, _StartWindow]] = []
    for side in (0.0, 1.0, -1.0) if closed.any() else (0.0,):
        start, misfit = side * closed + turning, np.inf
        for seconds in WINDOWS:
            window = _window(model, recording, p, seconds, start)
            start, misfit = _fitted(window, start)
        candidates.append((misfit, start, window))
    _, best, window = min(candidates, key=lambda candidate: candidate[0])
    out.update(zip(names, best.tolist(), strict=True))
    out.undetermined = [name for name, unseen in zip(names, _undetermined(window, best), strict=True) if unseen]
    return out


def _measured_speeds(model: Model, recording: Recording, p: np.ndarray) -> np.ndarray:
    """Angles 0 and the speeds (2n,) that were measured first, what was not measured moving with them."""
    parts = elements(model, p[None])
    turns, twists = (
        rows[0] if rows.ndim == 3 else rows for rows in (parts.mass_transformation, parts.spring_transformation)
    )
    rows, speeds = [], []
    for sensor in model.system.sensors:
        if sensor.measures == "speed" and sensor.name in recording.channels:
            measured = recording[sensor.name]
            rows.append(turns[parts.masses.index(f"inertias.{sensor.of}")])
            speeds.append(np.median(measured[np.isfinite(measured)][:MEDIAN_OF]))
    if not rows:
        return np.zeros(2 * model.n)
    weight = 1e3  # the measured speeds before the untwisted motion
    together = np.vstack([twists.reshape(-1, model.n), weight * np.array(rows)])
    values = np.concatenate([np.zeros(len(together) - len(rows)), weight * np.array(speeds)])
    return np.concatenate([np.zeros(model.n), np.linalg.lstsq(together, values)[0]])


def undetermined_note(names: list[str]) -> str:
    """The sentence that says which states of a start the recording leaves open."""
    return (
        f"start: the recorded sensors do not determine {listed(names)}; the simulation starts there near rest "
        "(a sensor on that part, or another --start, would say more)"
    )


@dataclass(frozen=True)
class _StartWindow:
    """The beginning of a recording: its samples, which of the model's sensors (k) were measured, and how exactly.

    ``measured`` (t, k), ``uncertainty`` (k,); explicit steps at ``steps_per_second``.
    """

    model: Model
    p: np.ndarray
    time: np.ndarray
    inputs: np.ndarray
    columns: list[int]
    measured: np.ndarray
    uncertainty: np.ndarray
    steps_per_second: float

    def residual(self, readings: np.ndarray) -> np.ndarray:
        """(simulated − measured)/uncertainty (r,) where something was measured."""
        scaled = (readings[:, self.columns] - self.measured) / self.uncertainty
        return scaled.ravel()[np.isfinite(self.measured).ravel()]

    def misfit(self, start: np.ndarray) -> float:
        """Sum of squares for a start (2n,); infinite where the motion diverges."""
        try:
            readings = simulate_batch(
                self.model, self.time, self.inputs, self.p[None], self._named(start),
                steps_per_second=self.steps_per_second,
            )[0]  # fmt: skip
        except SimulationError:
            return np.inf
        return float(np.sum(self.residual(readings) ** 2))

    def linearised(self, start: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Residual (r,) and its derivatives (r, 2n) by the start."""
        named = self._named(start)
        done = sensitivities(
            self.model, self.time, self.inputs, self.p, list(named), named, steps_per_second=self.steps_per_second
        )
        there = np.isfinite(self.measured).ravel()
        by_start = done.jacobian[:, self.columns] / self.uncertainty[:, None]
        return self.residual(done.readings), by_start.reshape(-1, len(named))[there]

    def _named(self, start: np.ndarray) -> dict[str, float]:
        return dict(zip(self.model.states[: len(start)], start.tolist(), strict=True))


def _window(model: Model, recording: Recording, p: np.ndarray, seconds: float, start: np.ndarray) -> _StartWindow:
    sensors = [part for part in model.system.sensors if part.name in recording.channels]
    # Sensors may begin later than the inputs do: counted from the first reading, simulated from the first row.
    first = min(int(np.argmax(np.isfinite(recording[part.name]))) for part in sensors)
    last = recording.time[min(first + LEAST_SAMPLES, len(recording.time) - 1)]
    early = recording.cut(recording.time[0], max(recording.time[first] + seconds, last))  # without its end
    inputs = early.inputs(model.system)
    named = dict(zip(model.states[: len(start)], start.tolist(), strict=True))
    state = start_state(model, p, inputs[0], named)
    problem = InitialValueProblem(model, early.time, inputs, p[None], state[None])
    return _StartWindow(
        model,
        p,
        early.time,
        inputs,
        [model.sensors.index(part.name) for part in sensors],
        np.stack([early[part.name] for part in sensors], axis=1),
        np.array([part.uncertainty or _share_of_range(recording[part.name]) for part in sensors]),
        explicit_stepping(problem).mean_rate(early.time),
    )


def _fitted(window: _StartWindow, start: np.ndarray) -> tuple[np.ndarray, float]:
    """Start (2n,) with the least misfit found from a start, and that misfit."""
    best = window.misfit(start)
    for _ in range(ROUNDS if np.isfinite(best) else 0):
        residual, by_start = window.linearised(start)
        scaled, size = _scaled(by_start)
        step = -np.linalg.lstsq(scaled, residual, rcond=UNSEEN)[0] / size
        trials = ((start + share * step) for share in (1.0, 0.3, 0.1))
        better = next(((trial, now) for trial in trials if (now := window.misfit(trial)) < best), None)
        if better is None:
            break
        gain, (start, best) = best - better[1], better
        if gain < WORTHWHILE * best:
            break
    return start, best


def _scaled(by_start: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives (r, 2n) with columns of size one, or 0 where the readings do not depend on a state; those sizes."""
    size = np.linalg.norm(by_start, axis=0)
    kinds = size.reshape(2, -1)  # angles and speeds, which have units of their own
    size = np.where(kinds > INSENSITIVE * kinds.max(axis=1, keepdims=True), kinds, np.inf).ravel()
    return by_start / size, size


def _undetermined(window: _StartWindow, start: np.ndarray) -> np.ndarray:
    """Which states (2n,) of a start the readings do not determine although the motion depends on them."""
    scaled, size = _scaled(window.linearised(start)[1])
    _, singular, rows = np.linalg.svd(scaled)
    singular = np.pad(singular, (0, len(start) - len(singular)))
    unseen = rows[singular <= UNSEEN * singular.max(initial=0.0)].T / np.where(np.isfinite(size), size, 1.0)[:, None]
    unseen = np.linalg.qr(unseen)[0]
    # of these directions, those that change a rate: about this start, and with every lash closed
    model, n = window.model, len(start)
    closed = start + np.atleast_2d(rest_state(model, window.p))[0][:n]
    u, by_state = window.inputs[0], []
    for at in (start, closed):
        x = start_state(model, window.p, u, dict(zip(model.states[:n], at.tolist(), strict=True)))
        by_state.append(model.jacobians(x, u, window.p, 0.0)[0].full()[n // 2 :, :n])
    A = np.vstack(by_state)
    _, effects, directions = np.linalg.svd(A @ unseen, full_matrices=False)
    acting = unseen @ directions[effects > INSENSITIVE * np.abs(A).max(initial=0.0)].T
    return np.asarray(np.sum(acting**2, axis=1) > MOSTLY)


def _share_of_range(values: np.ndarray) -> float:
    spread = float(np.nanmax(values) - np.nanmin(values))
    return spread * SHARE_OF_RANGE if spread > AT_REST * max(1.0, float(np.nanmax(np.abs(values)))) else 1.0


# --- Speeds and angles without a unit that fit the model in 1/min or degrees and not in SI.

MISTAKEN = ("speed", "angle")  # quantities whose unit is often left out: taken for the first of units_of
FITS, FAR_OFF = 0.25, 0.5  # misfit over the standard deviation: of a model about right; where the unit may be wrong
CLEARLY = 3.0  # times better in 1/min
SPEED_UNIT_TOLERANCE = 1e-2  # of the simulations here


def check_speed_units(model: System | Model, recording: Recording) -> None:
    """Check that the speeds and angles for which the file states no unit can be in rad/s and rad.

    The model is simulated on the recorded inputs of the longest part without a long gap, begun as recorded: once with
    the values as they stand, and if they are far off, once more with them as 1/min or degrees.

    Raises
    ------
    InputError
        If they fit the model in 1/min or degrees only; says what to write.
    """
    system = model if isinstance(model, System) else model.system
    for measures in MISTAKEN:
        unit, in_si = next(units_of(measures))
        names = [
            sensor.name
            for sensor in system.sensors
            if sensor.measures == measures
            and recording.units.get(sensor.name) == ""
            and sensor.name in recording.channels
        ]
        if names:
            model = compiled(model) if isinstance(model, System) else model
            _check_unit(model, _longest_part(recording), names, unit, in_si, SENSOR_UNITS[measures])


def check_exchanged(model: System | Model, recording: Recording) -> None:
    """Check that no input and sensor of a recording hold each other's values: called where the model is far off.

    Raises
    ------
    InputError
        If the model fits with two columns exchanged only; names them.
    """
    model = compiled(model) if isinstance(model, System) else model
    recording = _longest_part(recording)
    sensors = recording.sensors(model.system)
    as_read = max(_misfits(model, recording, sensors), default=0.0)
    if as_read <= FAR_OFF:
        return
    for name in (each for each in model.inputs if each not in model.system.pedals):  # 0 to 1, else it was refused
        for sensor in sensors:
            if not np.isfinite(recording[sensor]).all():
                continue
            turned = recording.channels | {name: recording[sensor], sensor: recording[name]}
            if max(_misfits(model, replace(recording, channels=turned), sensors)) < min(FITS, as_read / CLEARLY):
                raise hold_each_other(recording.source, name, sensor, "fit the model")


def _check_unit(model: Model, recording: Recording, names: list[str], unit: str, in_si: float, si: str) -> None:
    as_read = min(_misfits(model, recording, names))
    if as_read <= FAR_OFF:
        return
    scaled = {name: values * (in_si if name in names else 1.0) for name, values in recording.channels.items()}
    if max(_misfits(model, replace(recording, channels=scaled), names)) < min(FITS, as_read / CLEARLY):
        raise InputError(
            f"{recording.source}: {', '.join(names)}",
            f"no unit is stated, and the values fit the model in {unit} only, not in {si}",
            f'state the unit, for example {names[0]} = {{ channel = "{names[0]}", unit = "{unit}" }} in a channel file',
        )


def _longest_part(recording: Recording) -> Recording:
    """The longest part between gaps too long to bridge: over a gap, which may last for years, inputs are unknown."""
    gaps = long_gaps(recording.time)
    if not gaps:
        return recording
    begins = [float(recording.time[0]), *(end for _, end in gaps)]
    ends = [*(begin for begin, _ in gaps), float(recording.time[-1])]
    begin, end = max(zip(begins, ends, strict=True), key=lambda part: part[1] - part[0])
    return recording.cut(begin, np.nextafter(end, np.inf)) if end > begin else recording


def _misfits(model: Model, recording: Recording, names: list[str]) -> list[float]:
    """Root mean squares of simulated minus recorded speeds over the standard deviations; infinite if nothing moves."""
    inputs = recording.inputs(model.system)
    try:
        p = with_stick_speed(model, recording.time, inputs, model.p0)
        start = recorded_start(model, recording, p)
        done = simulate(model, recording.time, inputs, start=start, sensors=names, tolerance=SPEED_UNIT_TOLERANCE)
    except SimulationError:
        return [np.inf] * len(names)
    misfits = []
    for name in names:
        there = np.isfinite(recording[name])
        recorded, apart = recording[name][there], (done[name] - recording[name])[there]
        if done.units[name] == "rad" and there.sum() > 2:  # even rotation is in every unit what the start makes it
            at = recording.time[there]
            recorded, apart = (each - np.polyval(np.polyfit(at, each, 1), at) for each in (recorded, apart))
        spread = float(np.std(recorded)) if there.any() else 0.0
        error = float(np.sqrt(np.mean(apart**2))) if there.any() else 0.0
        misfits.append(error / spread if spread else np.inf)
    return misfits
