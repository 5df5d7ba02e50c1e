"""The start state that a recording's first stretch tells of."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from modelling.equations.compiled import Model
from modelling.linear.elements import elements, rest_state
from modelling.measurement.recording import Recording
from modelling.simulation.simulate import SimulationError, sensitivities, simulate_batch

WINDOWS = (0.06, 0.25)  # s; the short one first: over it even a lash hardly leads astray
ROUNDS = 6


def recorded_start(model: Model, recording: Recording, p: np.ndarray) -> dict[str, float]:
    """Angles and speeds (rad, rad/s, by state name) from which the model meets the first quarter second best.

    Gauss-Newton on all recorded sensors, each in times its uncertainty (a thousandth of its range where none is given);
    what the sensors do not tell stays near rest. Lash is tried open and on either flank. A model that is wrong there
    shifts the start.

    Parameters
    ----------
    p : ndarray (p,)
        See :func:`modelling.simulation.simulate.prepare`.
    """
    names = model.states[: 2 * model.n]
    closed = np.atleast_2d(rest_state(model, p))[0][: len(names)]
    if not recording.sensors(model.system):
        return dict.fromkeys(names, 0.0)
    turning = _turning(model, recording, p)
    found: list[tuple[float, np.ndarray]] = []
    for side in (0.0, 1.0, -1.0) if closed.any() else (0.0,):
        start, misfit = side * closed + turning, np.inf
        for window in WINDOWS:
            start, misfit = _fitted(*_problem(model, recording, p, window, names), start)
        found.append((misfit, start))
    best = min(found, key=lambda one: one[0])[1]
    return dict(zip(names, best.tolist(), strict=True))


def _turning(model: Model, recording: Recording, p: np.ndarray) -> np.ndarray:
    """Angles 0 and the speeds (2n,) that were measured first, what was not measured turning with them."""
    parts = elements(model, p[None])
    turns, twists = (
        rows.reshape(-1, *rows.shape[-2:])[0] for rows in (parts.mass_transformation, parts.spring_transformation)
    )
    rows, speeds = [], []
    for part in model.system.sensors:
        if part.measures == "speed" and part.name in recording.channels:
            measured = recording[part.name]
            rows.append(turns[parts.masses.index(f"inertias.{part.of}")])
            speeds.append(np.median(measured[np.isfinite(measured)][:9]))
    if not rows:
        return np.zeros(2 * model.n)
    together = np.vstack([twists, 1e3 * np.array(rows)])
    wanted = np.concatenate([np.zeros(len(twists)), 1e3 * np.array(speeds)])
    return np.concatenate([np.zeros(model.n), np.linalg.lstsq(together, wanted)[0]])


def _problem(
    model: Model, recording: Recording, p: np.ndarray, window: float, names: list[str]
) -> tuple[Callable[[np.ndarray], float], Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]]:
    """Misfit of a start, and residuals (r,) with their derivatives (r, s)."""
    known = [part for part in model.system.sensors if part.name in recording.channels]
    columns = [model.sensors.index(part.name) for part in known]
    begin = recording.time[0]
    early = recording.cut(begin, max(begin + window, recording.time[min(8, len(recording.time) - 1)]))
    inputs, measured = early.inputs(model.system), np.stack([early[part.name] for part in known], axis=1)
    scale = np.array([part.uncertainty or _thousandth(recording[part.name]) for part in known])
    there = np.isfinite(measured).ravel()

    def named(start: np.ndarray) -> dict[str, float]:
        return dict(zip(names, start.tolist(), strict=True))

    def residual(readings: np.ndarray) -> np.ndarray:
        return ((readings[:, columns] - measured) / scale).ravel()[there]

    def misfit(start: np.ndarray) -> float:
        try:
            return float(np.sum(residual(simulate_batch(model, early.time, inputs, p[None], named(start))[0]) ** 2))
        except SimulationError:
            return np.inf

    def slopes(start: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        found = sensitivities(model, early.time, inputs, p, names, named(start))
        return residual(found.readings), (found.jacobian[:, columns] / scale[:, None]).reshape(-1, len(names))[there]

    return misfit, slopes


def _fitted(
    misfit: Callable[[np.ndarray], float],
    slopes: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]],
    start: np.ndarray,
) -> tuple[np.ndarray, float]:
    best = misfit(start)
    for _ in range(ROUNDS if np.isfinite(best) else 0):
        residual, slope = slopes(start)
        size = np.maximum(np.linalg.norm(slope, axis=0), 1e-300)
        step = -np.linalg.lstsq(slope / size, residual, rcond=1e-6)[0] / size
        trials = ((start + shorter * step) for shorter in (1.0, 0.3, 0.1))
        better = next(((trial, now) for trial in trials if (now := misfit(trial)) < best), None)
        if better is None:
            break
        gain, (start, best) = best - better[1], better
        if gain < 1e-6 * best:
            break
    return start, best


def _thousandth(values: np.ndarray) -> float:
    spread = np.nanmax(values) - np.nanmin(values)
    return float(spread) / 1000 or 1.0
