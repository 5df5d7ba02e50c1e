"""A cause and a system extended by causes, before it is fitted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from matching.diagnosis.fitting.batch_simulation import compile_models
from matching.diagnosis.fitting.fit import Fit
from modelling.common.errors import InputError
from modelling.effects import EFFECTS
from modelling.effects.recorded_range import RecordedRange
from modelling.equations.compiled import compiled
from modelling.model.components import Effect
from modelling.model.quantity import Quantity
from modelling.model.system import System

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
        try:
            compiled(model.system())
        except (RuntimeError, InputError):  # e.g. a lag behind a drift of the same sensor
            continue
        possible.append(model)
    compile_models(model.system() for model in possible)
    return possible
