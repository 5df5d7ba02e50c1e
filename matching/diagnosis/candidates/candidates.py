"""Candidates: a system with one more effect, made ready for a fit from a fit without it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from matching.diagnosis.fitting import batch_simulation as runs
from matching.diagnosis.fitting.fit import Fit, Problem, solve
from modelling.common.errors import InputError
from modelling.effects import EFFECTS
from modelling.equations.compiled import compiled
from modelling.model.components import Effect
from modelling.model.quantity import Quantity
from modelling.model.system import System

WINDOW, WINDOWS = 0.5, 24  # s of a short window at least, and how many at most
ABRUPT = 8  # integration steps a sample where a torque jumps: with fewer the misfit is too rough to descend


@dataclass(frozen=True)
class Cause:
    """One named effect: kind, place and which parameters it has."""

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


@dataclass(frozen=True)
class Trial:
    """A system as given, the causes added to it, and what to begin with: values by name and, if known, start states."""

    system: System
    causes: tuple[Cause, ...]
    bounds: dict[str, tuple[float, float]]
    values: dict[str, float]
    starts: tuple[np.ndarray, ...] = ()

    def extended(self) -> System:
        """The system that is simulated: every cause but wrong parameters is an effect of it."""
        made = []
        for cause in self.causes:
            if not cause.replaces_quantity:
                made.append(
                    Effect(
                        cause.kind,
                        cause.at,
                        tuple((key, Quantity(self.values[name])) for key, name in cause.names().items()),
                    )
                )
        wrong = {cause.at: self.values[cause.at] for cause in self.causes if cause.replaces_quantity}
        return self.system.with_values(wrong).with_effects(*made)


def with_cause(
    system: System, fit: Fit, before: tuple[Cause, ...], kind: str, at: str, parameters: dict[str, float]
) -> Trial:
    """A trial of one more cause, from a fit with the causes before it."""
    return added(Trial(system, before, fit.problem.bounds, fit.values), fit, kind, at, parameters)


def added(trial: Trial, fit: Fit, kind: str, at: str, parameters: dict[str, float]) -> Trial:
    """A trial with one more cause."""
    cause = Cause(kind, at, tuple(parameters))
    step = float(np.median(np.diff(fit.problem.data.segments[0].time)))
    bounds, values = dict(trial.bounds), dict(trial.values)
    for key, name in cause.names().items():
        low, high = EFFECTS[kind].fit_bounds(key, parameters[key], step)
        values[name] = float(np.clip(parameters[key], low, high))
        bounds[name] = (low, high)
    return Trial(trial.system, (*trial.causes, cause), bounds, values)


def without_cause(trial: Trial, index: int, fit: Fit) -> Trial:
    """The trial of a fit without one of its causes."""
    gone = set(trial.causes[index].names().values())
    kept = tuple(cause for i, cause in enumerate(trial.causes) if i != index)
    bounds = {name: bound for name, bound in fit.problem.bounds.items() if name not in gone}
    values = {name: value for name, value in fit.values.items() if name in bounds}
    return Trial(trial.system, kept, bounds, values)


def fitted(
    trial: Trial,
    parent: Fit,
    iterations: int = 20,
    exact: bool = False,
    fine: float = 3.0,
    rival: float = 0.0,
    noise: float = 0.0,
) -> Fit:
    """Fit a trial, beginning at values, starts and Jacobian of the fit it came from.

    Raises
    ------
    FloatingPointError
        If it does not simulate from there.
    """
    problem, p = _problem(trial, parent, fine)
    v = problem.pack(trial.values, list(trial.starts) or _starts(problem, parent, p))
    v = np.clip(v, problem.lower, problem.upper)
    return solve(problem, v, _known_jacobian(problem, parent, v), iterations, exact, rival, noise)


def nearer(trial: Trial, parent: Fit, motion: np.ndarray, iterations: int = 30) -> Fit:
    """Fit a trial over short windows, each with a start of its own.

    This is multiple shooting (Bock and Plitt 1984) without its matching conditions.

    Over a short horizon the misfit is nearly convex in the parameters, where over a long one phases slip past each
    other and rattling forgets where it came from.

    Parameters
    ----------
    motion : ndarray (t, x)
        States of the parent's model as the measurement has them, segments one after another.

    Raises
    ------
    FloatingPointError
        If it does not simulate from there.
    """
    cuts, starts, at = [], [], 0
    total = sum(float(np.ptp(segment.time)) for segment in parent.problem.data.segments)
    for segment in parent.problem.data.segments:
        pieces = max(1, round(float(np.ptp(segment.time)) / max(WINDOW, total / WINDOWS)))
        edges = np.linspace(0, len(segment.time), pieces + 1).astype(int)
        for first, last in pairwise(edges):
            cuts.append(segment.part(int(first), int(last) + 1))  # the last sample is the next one's first
            starts.append(motion[at + first])
        at += len(segment.time)
    data = replace(parent.problem.data, segments=tuple(cuts))
    short = replace(parent.problem, data=data, anchors=starts)
    windows = replace(parent, problem=short, v=short.pack(parent.values, starts))
    problem, p = _problem(trial, windows, 3.0)
    problem.anchors = _starts(problem, windows, p)
    fit = solve(problem, problem.pack(trial.values, problem.anchors), None, iterations)
    for _ in range(3):
        if fit.cost < 1.2 * data.samples.sum():
            break
        again = solve(problem, _joined(fit), None, iterations // 2)
        if again.cost > 0.98 * fit.cost:
            break
        fit = again
    return fit


def _joined(fit: Fit) -> np.ndarray:
    """Variables of a fit over windows; one begins as the one before it ends where that is better."""
    problem, starts = fit.problem, fit.starts
    ends = [states[-1] for states in problem.states(fit.v)]
    other = problem.pack(fit.values, [starts[0], *ends[:-1]])
    moved = replace(fit, v=other, residual=problem.residuals(other[None])[0])
    costs = [[float(np.sum(own**2)) for own in one.by_sensor()] for one in (fit, moved)]
    chosen = [moved.starts[i] if costs[1][i] < costs[0][i] else starts[i] for i in range(len(starts))]
    return problem.pack(fit.values, chosen)


def _problem(trial: Trial, parent: Fit, fine: float) -> tuple[Problem, np.ndarray]:
    system = trial.extended()
    model, data = compiled(system), parent.problem.data
    some = parent.problem.unpack(parent.v)[1]
    points = np.zeros((min(len(some), 4) + 1, len(model.states)))
    own = _own(model.states, parent)
    for row, start in zip(points, some, strict=False):
        row[[j for j in own if j >= 0]] = start[[i for i, j in enumerate(own) if j >= 0]]
    sampling = 1 / float(np.median(np.diff(data.segments[0].time)))
    p = model.vector({name: value for name, value in trial.values.items() if name in model.parameters})
    least = fine / 1.5 * sampling  # 2 a sample in a search, 4 in a final fit
    if any(EFFECTS[effect.kind].abrupt for effect in system.effects):
        least = ABRUPT * sampling
    if np.isfinite(parent.problem.stick):  # friction that had to be sharper stays so
        least = max(least, min(parent.problem.steps, ABRUPT * sampling))
    steps, stick = runs.steps_and_stick(model, p, points, sampling, fine, least)
    anchors = None
    if parent.problem.anchors is not None:
        anchors = []
        for was in parent.problem.anchors:
            row = np.zeros(len(model.states))
            row[[j for j in own if j >= 0]] = was[[i for i, j in enumerate(own) if j >= 0]]
            anchors.append(row)
    return Problem(system, data, trial.bounds, steps, stick, anchors), p


def _own(states: list[str], parent: Fit) -> list[int]:
    """Where the parent's states are among others; -1 where they are not."""
    return [states.index(name) if name in states else -1 for name in parent.problem.model.states]


def _starts(problem: Problem, parent: Fit, p: np.ndarray) -> list[np.ndarray]:
    """Start states: the parent's; what is new begins so that accelerations and readings begin as they did."""
    model, before = problem.model, parent.problem.model
    p_before, starts_before = parent.problem.unpack(parent.v)
    own = _own(model.states, parent)
    new = [i for i in range(len(model.states)) if i not in own]
    kept = [model.coordinates.index(name) for name in before.coordinates if name in model.coordinates]
    rows_before = [before.n + before.coordinates.index(model.coordinates[i]) for i in kept]
    out = []
    for segment, was in zip(problem.data.segments, starts_before, strict=True):
        x = np.zeros(len(model.states))
        for i, j in enumerate(own):
            if j >= 0:
                x[j] = was[i]
        if new:
            u = segment.inputs[0]
            rows = [model.n + i for i in kept]
            wanted = np.concatenate(
                [np.array(before.rates(was, u, p_before)).ravel()[rows_before],
                 np.array(before.readings(was, u, p_before, 0.0)).ravel()]
            )  # fmt: skip
            for _ in range(2):
                A, _, C, _ = (np.array(m) for m in model.jacobians(x, u, p, 0.0))
                now = np.concatenate(
                    [np.array(model.rates(x, u, p)).ravel()[rows], np.array(model.readings(x, u, p, 0.0)).ravel()]
                )
                slope = np.vstack([A[rows], C])[:, new]
                if not np.isfinite(slope).all() or not np.isfinite(now).all():
                    break
                weight = 1 / (np.abs(slope).max(axis=1) + 1e-9)
                x[new] += np.linalg.lstsq(slope * weight[:, None], (wanted - now) * weight, rcond=1e-9)[0]
        out.append(x)
    return out


def _known_jacobian(problem: Problem, parent: Fit, v: np.ndarray) -> np.ndarray:
    """The parent's columns where it has them, fresh ones for what is new."""
    names, names_before = _variables(problem), _variables(parent.problem)
    at = {name: i for i, name in enumerate(names_before)}
    fresh = [i for i, name in enumerate(names) if name not in at]
    out = np.empty((len(parent.residual), len(names)), order="F")
    for i, name in enumerate(names):
        if name in at:
            out[:, i] = parent.jacobian[:, at[name]]
    if fresh:
        r = problem.residuals(v[None])[0]
        if not np.isfinite(r).all():
            raise FloatingPointError("the simulation diverges at the start of the fit")
        out[:, fresh] = problem.jacobian(v, r, np.array(fresh))
    return out


def _variables(problem: Problem) -> list[str]:
    states = [problem.model.states[i] for i in range(len(problem.model.states)) if i not in problem.held]
    return problem.free + [f"{segment}:{name}" for segment in range(len(problem.data.segments)) for name in states]


def compile_all(trials: Sequence[Trial]) -> list[Trial]:
    """Compile what several trials need, side by side; trials whose effects exclude each other are left out."""
    possible = []
    for trial in trials:
        try:
            compiled(trial.extended())
        except (RuntimeError, InputError):  # e.g. a lag behind a drift of the same sensor
            continue
        possible.append(trial)
    runs.prepare(trial.extended() for trial in possible)
    return possible
