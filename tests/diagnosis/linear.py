"""A least-squares problem whose answer is known: residual = (target − function of the variables)/noise."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np

from matching.diagnosis.data import FitData, Segment
from matching.diagnosis.descent import Fit


@dataclass
class KnownProblem:
    """What the fitting room asks of a problem, with a function in the place of a simulation."""

    bounds: dict[str, tuple[float, float]]
    function: Callable[[np.ndarray], np.ndarray]  # (v,) → residual (r,)
    steps_per_second: float = 1.0
    stick_speed: float = np.nan
    sensors: int = 1
    weighting: None = None
    data: FitData = field(init=False)

    def __post_init__(self) -> None:
        self.free = list(self.bounds)
        self.free_states: list[int] = []
        self.size = len(self.free)
        self.lower, self.upper = (np.array([own[i] for own in self.bounds.values()]) for i in (0, 1))
        self.system = SimpleNamespace(effects=())
        self.model = SimpleNamespace(parameters=self.free, p0=np.ones(self.size), n=0)
        count = len(self.function(np.ones(self.size))) // self.sensors
        zeros = np.zeros((count, self.sensors))
        self.data = FitData((Segment(np.arange(count) * 1.0, np.zeros((count, 0)), zeros),), np.ones(self.sensors))

    def residuals(self, batch: np.ndarray) -> np.ndarray:
        return np.array([self.function(v) for v in batch])

    def by_sensor(self, residual: np.ndarray) -> list[np.ndarray]:
        return [residual.reshape(-1, self.sensors)]


def fit_at(problem: KnownProblem, v: np.ndarray, jacobian: np.ndarray) -> Fit:
    residual = problem.function(v)
    return Fit(problem, v, residual, jacobian, float(residual @ residual))
