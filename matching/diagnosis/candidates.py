"""Candidates: a system with one more effect, made ready for a fit from a fit without it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from matching.diagnosis import runs
from matching.diagnosis.fit import Fit, Problem, solve
from modelling.compiled import compiled
from modelling.effects import EFFECTS
from modelling.quantity import Quantity
from modelling.system import Effect, System

WRONG = "wrong_parameter"


@dataclass(frozen=True)
class Cause:
    """One named effect: kind, place and which parameters it has."""

    kind: str
    at: str
    keys: tuple[str, ...]

    def names(self) -> dict[str, str]:
        """Parameter of the effect → its name in the fit; a wrong parameter is freed where it stands."""
        return {key: self.at if self.kind == WRONG else f"{self.at}.{self.kind}.{key}" for key in self.keys}


@dataclass(frozen=True)
class Trial:
    """A system as given, the causes added to it, and values to begin with by name."""

    system: System
    causes: tuple[Cause, ...]
    bounds: dict[str, tuple[float, float]]
    values: dict[str, float]

    def extended(self) -> System:
        """The system that is simulated: every cause but wrong parameters is an effect of it."""
        made = []
        for cause in self.causes:
            if cause.kind != WRONG:
                made.append(Effect(cause.kind, cause.at, tuple((key, Quantity(self.values[name])) for key, name in cause.names().items())))
        wrong = {cause.at: self.values[cause.at] for cause in self.causes if cause.kind == WRONG}
        return self.system.with_values(wrong).with_effects(*made)


def with_cause(system: System, fit: Fit, before: tuple[Cause, ...], kind: str, at: str, parameters: dict[str, float]) -> Trial:
    """A trial of one more cause, from a fit with the causes before it."""
    cause = Cause(kind, at, tuple(parameters))
    step = float(np.median(np.diff(fit.problem.data.segments[0].time)))
    bounds, values = dict(fit.problem.bounds), dict(fit.values)
    for key, name in cause.names().items():
        low, high = EFFECTS[kind].fit_bounds(key, parameters[key], step)
        values[name] = float(np.clip(parameters[key], low, high))
        bounds[name] = (low, high)
    return Trial(system, (*before, cause), bounds, values)


def without_cause(trial: Trial, index: int, fit: Fit) -> Trial:
    """The trial of a fit without one of its causes."""
    gone = set(trial.causes[index].names().values())
    kept = tuple(cause for i, cause in enumerate(trial.causes) if i != index)
    bounds = {name: bound for name, bound in fit.problem.bounds.items() if name not in gone}
    values = {name: value for name, value in fit.values.items() if name in bounds}
    return Trial(trial.system, kept, bounds, values)


def fitted(trial: Trial, parent: Fit, iterations: int = 20, exact: bool = False, fine: float = 3.0) -> Fit:
    """Fit a trial, beginning at values, starts and Jacobian of the fit it came from.

    Raises
    ------
    FloatingPointError
        If it does not simulate from there.
    """
    system = trial.extended()
    model, data = compiled(system), parent.problem.data
    states = np.concatenate(parent.problem.states(parent.v))[:: max(1, len(parent.residual) // 40)][:40]
    padded = np.zeros((len(states), len(model.states)))
    own = [model.states.index(name) if name in model.states else -1 for name in parent.problem.model.states]
    for i, j in enumerate(own):
        if j >= 0:
            padded[:, j] = states[:, i]
    sampling = 1 / float(np.median(np.diff(data.segments[0].time)))
    p = model.vector({name: value for name, value in trial.values.items() if name in model.parameters})
    steps, stick = runs.steps_and_stick(model, p, padded[::8], sampling, fine)
    problem = Problem(system, data, trial.bounds, min(steps, 20 * sampling), stick)
    starts = _starts(problem, parent, p, own)
    v = np.clip(problem.pack(trial.values, starts), problem.lower, problem.upper)
    return solve(problem, v, _known_jacobian(problem, parent, v), iterations, exact)


def _starts(problem: Problem, parent: Fit, p: np.ndarray, own: list[int]) -> list[np.ndarray]:
    """Start states: the parent's; what is new begins so that accelerations and readings begin as they did."""
    model, before = problem.model, parent.problem.model
    p_before, starts_before = parent.problem.unpack(parent.v)
    new = [i for i in range(len(model.states)) if i not in own]
    kept = [model.coordinates.index(name) for name in before.coordinates if name in model.coordinates]
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
                [np.array(before.rates(was, u, p_before)).ravel()[[before.n + before.coordinates.index(model.coordinates[i]) for i in kept]],
                 np.array(before.readings(was, u, p_before, 0.0)).ravel()]
            )  # fmt: skip
            for _ in range(2):
                A, _, C, _ = (np.array(m) for m in model.jacobians(x, u, p, 0.0))
                now = np.concatenate([np.array(model.rates(x, u, p)).ravel()[rows], np.array(model.readings(x, u, p, 0.0)).ravel()])
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
    out = np.empty((len(parent.residual), len(names)))
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


def compile_all(trials: Sequence[Trial]) -> None:
    """Compile what several trials need, side by side."""
    runs.prepare(trial.extended() for trial in trials)
