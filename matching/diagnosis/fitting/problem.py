"""The least-squares problem of a fit: free parameters and start states → residuals in times the noise."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from matching.diagnosis.data.segments import FitData
from matching.diagnosis.data.weighting import Weighting
from matching.diagnosis.fitting.batch_simulation import simulate_readings, simulate_states, steps_and_stick_speed
from matching.diagnosis.fitting.start_states import (
    angles_without_reading,
    first_state,
    sensors_with_zero,
    states_of_time,
)
from modelling.equations.assembly import STICK_SPEED
from modelling.equations.compiled import Model, compiled
from modelling.model.system import System

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
