"""Causes as extensions of a model, and what a fit tells before the next: torque balance, motion, recorded range."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.linalg import expm

from matching.diagnosis.data import FitData, Segment, stationary_smoother
from matching.diagnosis.descent import Fit
from matching.diagnosis.problem import FitProblem, angles_without_reading, jacobian
from matching.diagnosis.simulation import compile_models
from modelling.effects import EFFECTS
from modelling.effects.effect import FittedMotion, RecordedRange, members
from modelling.equations.casadi_code import Model, compiled
from modelling.equations.lagrange import derive
from modelling.errors import ExcludedEffects, FitError, InputError
from modelling.system import Effect, Input, Quantity, Shaft, System
from modelling.topology import joints, speed_ratios

# --- The torque balance of a fit: which further torque on which inertia, or in which shaft, the measurement asks for.
#
# The deviation of measurement from simulation is smoothed by the linear model with an unknown, slowly changing torque
# on every inertia and in every shaft. Nothing is differentiated; noise is weighted by the sensors' uncertainty. It
# tells where a cause may be, not which.

CORRELATION_TIME = 0.01  # s over which an unknown torque may change; faster than the modes of drivability (30 Hz)
TORQUE_SHARE = 0.2  # standard deviation of an unknown torque, of the largest torque in the drivetrain (rms)
FORGOTTEN = (0.0, 1e-6, 1e-4)  # share of a state in a sample: without damping the smoother may be ill-conditioned
ANGLE_SIGMA = 1.0  # rad within which angles are held: no reading tells where a drivetrain as a whole stands


@dataclass(frozen=True)
class TorqueBalance:
    """Deviations of the states and unknown torques, segments one after another.

    Attributes
    ----------
    names : list of str
        Of the states.
    states : ndarray (t, x)
        Measurement − simulation.
    inertias : ndarray (t, i)
        Torque that each inertia lacks, N·m.
    shafts : ndarray (t, s)
        Torque that each shaft lacks, N·m, on the second end's side.
    """

    names: list[str]
    states: np.ndarray
    inertias: np.ndarray
    shafts: np.ndarray

    def added_to(self, names: list[str], states: np.ndarray) -> np.ndarray:
        """Simulated states (t, x) of these names, where the measurement has them."""
        out = states.copy()
        for i, name in enumerate(names):
            if name in self.names:
                out[:, i] += self.states[:, self.names.index(name)]
        return out


@dataclass(frozen=True)
class LinearModel:
    """ẋ = A·x + B·T, y = C·x + D·T with a torque T (u,) on every inertia, then in every shaft.

    A (x, x), B (x, u), C (y, x), D (y, u).
    """

    model: Model
    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray


def linear_model(system: System, value: dict[str, float]) -> LinearModel:
    """The linear part of a system at parameter values, SI by name.

    A further torque T in a shaft turns its second end by T and its first end by −T over the ratio.
    """
    known = {name: v for name, v in value.items() if name in system.parameters}
    inputs = tuple(Input(f"probe{i}", part.name, "torque") for i, part in enumerate(system.inertias))
    model = compiled(replace(system.with_values(known), inputs=inputs))
    A, B, C, D = (np.array(m) for m in model.jacobians(np.zeros(len(model.states)), np.zeros(len(inputs)), model.p0, 0))
    names = [part.name for part in system.inertias]
    mixes, direct = [], []
    for shaft in system.shafts:
        mix = np.zeros(len(inputs))
        mix[names.index(shaft.between[0])] = -1 / value.get(f"shafts.{shaft.name}.ratio", 1.0)
        mix[names.index(shaft.between[1])] = 1.0
        mixes.append(mix)
        direct.append([float(sensor.measures == "torque" and sensor.of == shaft.name) for sensor in system.sensors])
    if mixes:
        mix = np.array(mixes).T
        B, D = np.hstack([B, B @ mix]), np.hstack([D, D @ mix + np.array(direct).T])
    return LinearModel(model, A, B, C, D)


def torque_balance(fit: Fit, system: System, value: dict[str, float], scale: float) -> TorqueBalance:
    """Smooth the residual of a fit by its linear model.

    Parameters
    ----------
    system : System
        The fitted system without the effects that have states or are not smooth.
    value : dict of str to float
        Parameters by name, SI.
    scale : float
        A torque typical of the drivetrain, N·m.
    """
    linear, data = linear_model(system, value), fit.problem.data
    n, x, torques = linear.model.n, len(linear.A), linear.B.shape[1]
    step = data.sampling_interval
    decay = -np.eye(torques) / CORRELATION_TIME
    F = expm(np.block([[linear.A, linear.B], [np.zeros((torques, x)), decay]]) * step)
    variance = (TORQUE_SHARE * scale) ** 2 * (1 - np.exp(-2 * step / CORRELATION_TIME))
    Q = np.diag([0.0] * x + [variance] * torques)
    angles = np.hstack([np.eye(n), np.zeros((n, x + torques - n))])
    H = np.vstack([np.hstack([linear.C, linear.D]), angles])
    with np.errstate(over="ignore", invalid="ignore"):  # of absurd data, which are refused
        R = np.concatenate([data.noise**2, np.full(n, ANGLE_SIGMA**2)])
        smoother = None
        for forgotten in FORGOTTEN if all(np.isfinite(matrix).all() for matrix in (F, H, Q, R)) else ():
            with contextlib.suppress(np.linalg.LinAlgError, ValueError):  # ill-conditioned for SciPy's Riccati solver
                smoother = stationary_smoother((1 - forgotten) * F, H, Q, R)
                break
    if smoother is None:
        raise InputError(
            data.segments[0].name or "recording",
            "no motion of the model's inertias follows from its readings",
            "check units and sampling of the channels, and the sensors' uncertainties",
        )
    parts = []
    for residual, segment in zip(fit.errors, data.segments, strict=True):
        deviation = np.where(segment.measured, residual * data.noise, 0.0)
        parts.append(smoother.smooth(np.hstack([deviation, np.zeros((len(deviation), n))])))
    states, unknown = np.split(np.concatenate(parts), [x], axis=1)
    inertias, shafts = np.split(unknown, [len(system.inertias)], axis=1)
    return TorqueBalance(linear.model.states, states, inertias, shafts)


# --- What the fit of an extended model takes over from its parent fit: start states and columns of the Jacobian.

NEWTON_STEPS = 2  # towards start states of new effects; their equations are nearly linear


def common_states(states: list[str], parent: Fit) -> tuple[list[int], list[int]]:
    """Indices of the states that the parent's model has too: in ``states``, and in the parent's own."""
    pairs = [(states.index(name), i) for i, name in enumerate(parent.problem.model.states) if name in states]
    return [there for there, _ in pairs], [here for _, here in pairs]


def states_from(parent_states: list[np.ndarray], states: list[str], parent: Fit) -> list[np.ndarray]:
    """States (x,) of another model with the values that the parent's states have; 0 for what is new."""
    there, here = common_states(states, parent)
    out = []
    for known in parent_states:
        x = np.zeros(len(states))
        x[there] = known[here]
        out.append(x)
    return out


def start_states(problem: FitProblem, parent: Fit, p: np.ndarray) -> list[np.ndarray]:
    """Start states (x,) of the segments: the parent's; new states begin so that accelerations and readings stay.

    Parameters
    ----------
    p : ndarray (p,)
        Parameters of the problem's model.
    """
    model = problem.model
    p_parent, parent_starts = parent.problem.unpack(parent.v)
    starts = states_from(parent_starts, model.states, parent)
    there, _ = common_states(model.states, parent)
    new = [i for i in range(len(model.states)) if i not in there]
    if new:
        for segment, known, x in zip(problem.data.segments, parent_starts, starts, strict=True):
            _begin_as(x, new, segment.inputs[0], (model, p), (parent.problem.model, known, p_parent))
    return starts


def _begin_as(
    x: np.ndarray,
    new: list[int],
    u: np.ndarray,
    extended: tuple[Model, np.ndarray],
    parent: tuple[Model, np.ndarray, np.ndarray],
) -> None:
    """Set the new states in x (x,), in place, so that accelerations and readings are those of the parent."""
    model, p = extended
    before, known, p_parent = parent
    shared = [model.coordinates.index(name) for name in before.coordinates if name in model.coordinates]
    rows = [model.n + i for i in shared]
    rows_before = [before.n + before.coordinates.index(model.coordinates[i]) for i in shared]
    wanted = _accelerations_and_readings(before, known, u, p_parent, rows_before)
    for _ in range(NEWTON_STEPS):
        A, _, C, _ = (np.array(m) for m in model.jacobians(x, u, p, 0.0))
        now = _accelerations_and_readings(model, x, u, p, rows)
        derivative = np.vstack([A[rows], C])[:, new]
        if not np.isfinite(derivative).all() or not np.isfinite(now).all():
            break
        weight = 1 / (np.abs(derivative).max(axis=1) + 1e-9)
        x[new] += np.linalg.lstsq(derivative * weight[:, None], (wanted - now) * weight, rcond=1e-9)[0]


def _accelerations_and_readings(
    model: Model, x: np.ndarray, u: np.ndarray, p: np.ndarray, rows: list[int]
) -> np.ndarray:
    rates = np.array(model.rates(x, u, p)).ravel()[rows]
    return np.concatenate([rates, np.array(model.readings(x, u, p, 0.0)).ravel()])


def known_jacobian(problem: FitProblem, parent: Fit, v: np.ndarray) -> np.ndarray:
    """A Jacobian (r, v) to begin with: the parent's columns where it has them, differences for what is new."""
    names = _variables(problem)
    column = {name: i for i, name in enumerate(_variables(parent.problem))}
    out = np.empty((len(parent.residual), len(names)), order="F")
    new = np.array([i for i, name in enumerate(names) if name not in column], dtype=int)
    for i, name in enumerate(names):
        if name in column:
            out[:, i] = parent.jacobian[:, column[name]]
    if len(new):
        residual = problem.residuals(v[None])[0]
        if not np.isfinite(residual).all():
            raise FitError("the simulation diverges where the fit begins")
        out[:, new] = jacobian(problem, v, residual, new)
    return out


def _variables(problem: FitProblem) -> list[str]:
    """Names of the variables (v,)."""
    states = [problem.model.states[i] for i in problem.free_states]
    return problem.free + [f"{segment}:{name}" for segment in range(len(problem.data.segments)) for name in states]


# --- A cause and a system extended by causes, before it is fitted.

AT_BOUND_SHARE = 1e-6  # of the width of the recorded range
NEGLIGIBLE = 1e-3  # of the largest recorded torque: less is not told from its error


@dataclass(frozen=True)
class Cause:
    """One effect as a cause: kind, place and which parameters it has."""

    kind: str
    at: str
    keys: tuple[str, ...]

    @property
    def replaces_quantity(self) -> bool:
        """Whether it replaces a quantity of the model, which is then freed where it stands."""
        return EFFECTS[self.kind].replaces_quantity

    def names(self) -> dict[str, str]:
        """Parameter of the effect → its name in the fit; a wrong parameter is freed where it stands."""
        return {key: self.at if self.replaces_quantity else f"{self.at}.{self.kind}.{key}" for key in self.keys}


@dataclass(frozen=True, eq=False)
class ExtendedModel:
    """A system as given, the causes added to it, and where a fit begins.

    Attributes
    ----------
    base : System
    causes : tuple of Cause
    bounds : dict of str to (float, float)
        Of all parameters that are fitted, SI.
    values : dict of str to float
        First values of these, SI.
    starts : tuple of ndarray (x,)
        First start states of the segments; empty where those of the parent fit are taken.
    recorded : RecordedRange, optional
        What the recording has shown; further causes lie within it.
    """

    base: System
    causes: tuple[Cause, ...]
    bounds: dict[str, tuple[float, float]]
    values: dict[str, float]
    starts: tuple[np.ndarray, ...] = ()
    recorded: RecordedRange | None = None

    @property
    def stands_twice(self) -> bool:
        """Whether two effects of one kind share a place, in whatever order their places are written."""
        every = [(effect.kind, place) for effect in self.base.effects for place in effect.places]
        every += [(cause.kind, place) for cause in self.causes for place in members(cause.at)]
        return len(set(every)) < len(every)

    def system(self) -> System:
        """The system that is simulated: every cause but wrong parameters is an effect of it."""
        effects = [
            Effect(cause.kind, cause.at, tuple((key, Quantity(self.values[n])) for key, n in cause.names().items()))
            for cause in self.causes
            if not cause.replaces_quantity
        ]
        wrong = {cause.at: self.values[cause.at] for cause in self.causes if cause.replaces_quantity}
        return self.base.with_values(wrong).with_effects(*effects)

    def with_cause(self, kind: str, at: str, parameters: dict[str, float], sampling_interval: float) -> ExtendedModel:
        """The same with one more cause that begins with these parameters (SI)."""
        cause = Cause(kind, at, tuple(parameters))
        bounds, values = dict(self.bounds), dict(self.values)
        for key, name in cause.names().items():
            low, high = EFFECTS[kind].fit_bounds(key, parameters[key], sampling_interval)
            recorded_low, recorded_high = self._recorded_bounds(cause, key)
            if max(low, recorded_low) < min(high, recorded_high):
                low, high = max(low, recorded_low), min(high, recorded_high)
            values[name] = float(np.clip(parameters[key], low, high))
            bounds[name] = (low, high)
        return replace(self, causes=(*self.causes, cause), bounds=bounds, values=values, starts=())

    def without_cause(self, index: int, fit: Fit) -> ExtendedModel:
        """The same without one of its causes, to begin where a fit of it ended."""
        removed = set(self.causes[index].names().values())
        kept = tuple(cause for i, cause in enumerate(self.causes) if i != index)
        bounds = {name: bound for name, bound in fit.problem.bounds.items() if name not in removed}
        return replace(self, causes=kept, bounds=bounds, values={n: fit.values[n] for n in bounds}, starts=())

    def not_taken(self, fit: Fit) -> str:
        """Why the fit of a cause cannot be meant: ``not_physical``, ``beyond_recording``, ``at_bound``; else empty."""
        for cause in self.causes:
            values = {key: fit.values[name] for key, name in cause.names().items()}
            if not EFFECTS[cause.kind].possible(values):
                return "not_physical"
            for key, value in values.items():
                low, high = self._recorded_bounds(cause, key)
                near = AT_BOUND_SHARE * (high - low) if np.isfinite(high - low) else AT_BOUND_SHARE * abs(value)
                if (value > high - near) or (np.isfinite(low) and low != 0 and value < low + near):
                    return "beyond_recording"
            if self.ends_at_bound(fit, cause):
                return "at_bound"
        return ""

    def ends_at_bound(self, fit: Fit, cause: Cause) -> bool:
        """Whether a parameter of a cause ends where its fit was not let go on, though physics would.

        Such a bound says how far from a first guess the search goes, nothing of the drivetrain.
        """
        for key, name in cause.names().items():
            parameter, value = EFFECTS[cause.kind].parameters[key], fit.values[name]
            low, high = fit.problem.bounds[name]
            near = AT_BOUND_SHARE * min(high - low, abs(value))
            if (value > high - near and high < parameter.upper) or (value < low + near and low > parameter.lower):
                return True
        return False

    def negligible(self, fit: Fit, index: int = -1) -> bool:
        """Whether a cause (the last) is a torque on an inertia that is too small to matter beside the recorded ones."""
        cause = self.causes[index]
        if self.recorded is None or not cause.at.startswith("inertias.") or cause.replaces_quantity:
            return False
        parameters = EFFECTS[cause.kind].parameters
        torques = [abs(fit.values[cause.names()[key]]) for key in cause.keys if parameters[key].unit == "N*m"]
        return bool(torques) and max(torques) < NEGLIGIBLE * self.recorded.input_torque

    def _recorded_bounds(self, cause: Cause, key: str) -> tuple[float, float]:
        """Bounds of a parameter by what the recording has shown; of a shared effect, those of its first place."""
        if self.recorded is None or cause.replaces_quantity:
            return -np.inf, np.inf
        return EFFECTS[cause.kind].bounds_in_recording(key, cause.at, self.recorded)


def compilable(models: Sequence[ExtendedModel]) -> list[ExtendedModel]:
    """The models whose effects do not exclude each other, compiled side by side."""
    possible = []
    for model in models:
        if model.stands_twice:
            continue
        try:
            compiled(model.system())
        except ExcludedEffects:  # e.g. a further slip of a tyre that slips
            continue
        possible.append(model)
    compile_models(model.system() for model in possible)
    return possible


# --- The model file's system with the causes as effects, at fitted values.


def extended_system(system: System, causes: tuple[Cause, ...], values: Mapping[str, float]) -> System:
    """A system with the causes as effects, its own quantities at fitted values; ranges stay as given.

    Parameters
    ----------
    values : dict of str to float
        Fitted parameters by name, SI.
    """
    replaced = {cause.at for cause in causes if cause.replaces_quantity}
    known = {name: value for name, value in values.items() if name in system.parameters and name not in replaced}
    effects = []
    for cause in causes:
        parameters = EFFECTS[cause.kind].canonical({key: values[name] for key, name in cause.names().items()})
        effects.append(Effect(cause.kind, cause.at, tuple((key, Quantity(p)) for key, p in parameters.items())))
    return system.with_values(known).with_effects(*effects)


# --- The motion of a fitted model over the recorded inputs, from which effects make their first guesses.


def simulated_motion(fit: Fit, balance: TorqueBalance | None = None) -> FittedMotion:
    """The motion of a fit, segments one after another; with a torque balance, as the measurement has it."""
    problem, system = fit.problem, fit.problem.system
    model, segments = problem.model, problem.data.segments
    x = np.concatenate(problem.states(fit.v))
    if balance is not None:
        x = _begun_as_held(system, model, segments, x, balance.added_to(model.states, x))
    p, _ = problem.unpack(fit.v)
    value = dict(zip(model.parameters, (float(v) for v in p), strict=True))
    shares = inertia_shares(system, model.coordinates, value)
    n, inputs = model.n, np.concatenate([segment.inputs for segment in segments])
    angles, speeds = (x[:, first : first + n] @ shares.T for first in (0, n))
    torques = np.array(model.shaft_torques.map(len(x))(x.T, inputs.T, p)).reshape(-1, len(x))
    gear_torques = _gear_torques(fit, x, inputs, p)
    ends = np.cumsum([0, *(len(segment.time) for segment in segments)])
    parts = tuple(slice(int(a), int(b)) for a, b in pairwise(ends))
    time = np.concatenate([segment.time for segment in segments])
    inputs = acting_torques(system, speeds, inputs)
    accelerations = np.concatenate([np.gradient(speeds[part], time[part], axis=0) for part in parts])
    names = [part.name for part in system.inertias]
    angle, speed, acceleration = (dict(zip(names, motion.T, strict=True)) for motion in (angles, speeds, accelerations))
    y = np.concatenate(problem.simulated(fit.v))
    return FittedMotion(
        time, parts, angle, speed, acceleration,
        {shaft.name: _twist(angle, shaft, value) for shaft in system.shafts},
        {shaft.name: _twist(speed, shaft, value) for shaft in system.shafts},
        {shaft.name: torques[j] for j, shaft in enumerate(system.shafts)},
        {part.name: inputs[:, j] for j, part in enumerate(system.inputs)},
        {sensor.name: y[:, j] for j, sensor in enumerate(system.sensors)},
        {sensor.name: float(problem.data.noise[j]) for j, sensor in enumerate(system.sensors)},
        value, {shaft.name: shaft.between for shaft in system.shafts},
        gear_torque=gear_torques, gear_ends={gear.name: gear.between for gear in system.gears},
        recording=np.concatenate([np.full(len(segment.time), segment.recording) for segment in segments]),
        load={
            on: np.sum([inputs[:, j] for j, part in enumerate(system.inputs) if part.on == on], axis=0)
            for on in {part.on for part in system.inputs if part.name not in system.imposed_by}
        },
        reads={sensor.name: sensor.measures for sensor in system.sensors},
        sensor_of={sensor.name: sensor.of for sensor in system.sensors},
    )  # fmt: skip


def acting_torques(system: System, speeds: np.ndarray, inputs: np.ndarray) -> np.ndarray:
    """Inputs (t, u) with the torque, N·m, of every pedal in its place; ``speeds`` (t, i) of all inertias in rad/s."""
    pedals, out = system.pedals, inputs
    for j, part in enumerate(system.inputs):
        if part.name in pedals:
            i = next(i for i, inertia in enumerate(system.inertias) if inertia.name == part.on)
            out = out.copy() if out is inputs else out
            out[:, j] = pedals[part.name].torques_at(speeds[:, i], inputs[:, j])
    return out


def _begun_as_held(
    system: System, model: Model, segments: Sequence[Segment], simulated: np.ndarray, measured: np.ndarray
) -> np.ndarray:
    """Measured states (t, x) in which parts of the drivetrain without an angle sensor stand, where a segment begins, as
    a simulation has them: else the phase of what repeats over the angle would be another."""
    out, begin = measured.copy(), 0
    for segment in segments:
        part = slice(begin, begin + len(segment.time))
        for held in angles_without_reading(system, model):
            turned = measured[begin, held] - simulated[begin, held]
            for name, ratio in speed_ratios(model.coordinates[held], joints(system)).items():
                if name in model.coordinates:
                    out[part, model.coordinates.index(name)] -= ratio * turned
        begin = part.stop
    return out


def _gear_torques(fit: Fit, x: np.ndarray, inputs: np.ndarray, p: np.ndarray) -> dict[str, np.ndarray]:
    """By rigid gear, what it passes on (t,), where it follows from both sides."""
    gears, model = fit.problem.system.gears, fit.problem.model
    if not gears:
        return {}
    torques = np.array(model.gear_torques.map(len(x))(x.T, inputs.T, p)).reshape(-1, len(x))
    return {gear.name: torque for gear, torque in zip(gears, torques, strict=True) if np.isfinite(torque).all()}


def inertia_shares(system: System, coordinates: list[str], value: dict[str, float]) -> np.ndarray:
    """(i, n) motion of every inertia per motion of each coordinate: ratios of gears, shares of differentials."""
    assembly = derive(system).assembly
    motions, value = assembly.motions, assembly.with_abbreviations(value)
    out = np.zeros((len(system.inertias), len(coordinates)))
    for i, part in enumerate(system.inertias):
        for j, share in motions[part.name].coefficients.items():
            out[i, j] = float(share.subs({s: value[str(s)] for s in share.free_symbols}))
    return out


def _twist(motion: dict[str, np.ndarray], shaft: Shaft, value: dict[str, float]) -> np.ndarray:
    """Twist of a shaft from angles, or its rate from speeds, (t,)."""
    first, second = (motion[end] for end in shaft.between)
    return first / value.get(f"shafts.{shaft.name}.ratio", 1.0) - second


# --- Recorded

TORQUE_MARGIN = 1.5  # times the largest torque on an inertia, as the base model has it


def recorded_range(system: System, data: FitData, motion: FittedMotion) -> RecordedRange:
    """What a recording has shown.

    The largest torque on an inertia is that of its shafts and of all inputs, which gears may have raised, or what
    accelerates it, whichever is larger.
    """
    readings = np.concatenate([segment.readings for segment in data.segments])
    measured = {
        sensor.name: values[np.isfinite(values)] for sensor, values in zip(system.sensors, readings.T, strict=True)
    }
    ratio = float(np.prod([max(gear.ratio.value, 1 / gear.ratio.value) for gear in system.gears], initial=1.0))
    inputs = ratio * sum(float(np.abs(torque).max()) for torque in motion.input.values())
    torque = {}
    for part in system.inertias:
        shafts = sum(float(np.abs(motion.torque[s.name]).max()) for s in system.shafts if part.name in s.between)
        J = motion.value[f"inertias.{part.name}.J"]
        accelerating = J * float(np.abs(motion.acceleration[part.name]).max())
        torque[part.name] = TORQUE_MARGIN * max(inputs + shafts, accelerating)
    return RecordedRange(
        max(float(np.ptp(segment.time)) for segment in data.segments),
        torque,
        {name: float(np.abs(values).max(initial=0.0)) for name, values in measured.items()},
        {name: float(np.ptp(values)) if len(values) else 0.0 for name, values in measured.items()},
        {
            name: sum(float(np.abs(np.diff(angle[p])).sum()) for p in motion.segments) / (2 * np.pi)
            for name, angle in motion.angle.items()
        },
        {
            name: max(float(np.ptp(angle[p])) for p in motion.segments) / (2 * np.pi)
            for name, angle in motion.angle.items()
        },
        sum(
            float(np.abs(motion.input[part.name]).max()) for part in system.inputs if part.name not in system.imposed_by
        ),
        {sensor.name: sensor.of for sensor in system.sensors},
    )
