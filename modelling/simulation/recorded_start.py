"""The start state that the beginning of a recording shows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from modelling.equations.compiled import Model
from modelling.linear.elements import elements, rest_state
from modelling.measurement.recording import Recording
from modelling.simulation import step_control
from modelling.simulation.result import SimulationError
from modelling.simulation.simulate import sensitivities, simulate_batch
from modelling.simulation.start import start_state

WINDOWS = (0.06, 0.25)  # s; over the short one, which comes first, even a lash hardly misleads
LEAST_SAMPLES = 8  # of a window, however seldom they are taken
MEDIAN_OF = 9  # samples, from which a speed to begin with is taken
ROUNDS = 6  # of Gauss-Newton
SHARE_OF_RANGE = 1e-3  # taken for the uncertainty of a sensor that states none
WORTHWHILE = 1e-6  # relative decrease of the misfit


def recorded_start(model: Model, recording: Recording, p: np.ndarray) -> dict[str, float]:
    """Angles and speeds (rad, rad/s, by state name) from which the model fits the first quarter second best.

    Gauss-Newton on all recorded sensors, each weighted by its uncertainty; what the sensors do not determine stays near
    rest. Lash is tried open and on either flank. A model that is wrong there shifts the start.

    Parameters
    ----------
    p : ndarray (p,)
        See :func:`modelling.simulation.simulate.with_stick_speed`.
    """
    names = model.states[: 2 * model.n]
    closed = np.atleast_2d(rest_state(model, p))[0][: len(names)]
    if not recording.sensors(model.system):
        return dict.fromkeys(names, 0.0)
    turning = _measured_speeds(model, recording, p)
    candidates: list[tuple[float, np.ndarray]] = []
    for side in (0.0, 1.0, -1.0) if closed.any() else (0.0,):
        start, misfit = side * closed + turning, np.inf
        for seconds in WINDOWS:
            start, misfit = _fitted(_window(model, recording, p, seconds, start), start)
        candidates.append((misfit, start))
    best = min(candidates, key=lambda candidate: candidate[0])[1]
    return dict(zip(names, best.tolist(), strict=True))


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
    problem = step_control.InitialValueProblem(model, early.time, inputs, p[None], state[None])
    return _StartWindow(
        model,
        p,
        early.time,
        inputs,
        [model.sensors.index(part.name) for part in sensors],
        np.stack([early[part.name] for part in sensors], axis=1),
        np.array([part.uncertainty or _share_of_range(recording[part.name]) for part in sensors]),
        step_control.explicit_stepping(problem).mean_rate(early.time),
    )


def _fitted(window: _StartWindow, start: np.ndarray) -> tuple[np.ndarray, float]:
    """Start (2n,) with the least misfit found from a start, and that misfit."""
    best = window.misfit(start)
    for _ in range(ROUNDS if np.isfinite(best) else 0):
        residual, by_start = window.linearised(start)
        size = np.maximum(np.linalg.norm(by_start, axis=0), 1e-300)
        step = -np.linalg.lstsq(by_start / size, residual, rcond=1e-6)[0] / size
        trials = ((start + share * step) for share in (1.0, 0.3, 0.1))
        better = next(((trial, now) for trial in trials if (now := window.misfit(trial)) < best), None)
        if better is None:
            break
        gain, (start, best) = best - better[1], better
        if gain < WORTHWHILE * best:
            break
    return start, best


def _share_of_range(values: np.ndarray) -> float:
    return float(np.nanmax(values) - np.nanmin(values)) * SHARE_OF_RANGE or 1.0
