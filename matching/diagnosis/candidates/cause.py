"""A cause and a system extended by causes, before it is fitted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from matching.diagnosis.fitting.batch_simulation import compile_models
from matching.diagnosis.fitting.fit import Fit
from modelling.common.errors import InputError
from modelling.effects import EFFECTS
from modelling.equations.compiled import compiled
from modelling.model.components import Effect
from modelling.model.quantity import Quantity
from modelling.model.system import System


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
    """

    base: System
    causes: tuple[Cause, ...]
    bounds: dict[str, tuple[float, float]]
    values: dict[str, float]
    starts: tuple[np.ndarray, ...] = ()

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
            values[name] = float(np.clip(parameters[key], low, high))
            bounds[name] = (low, high)
        return ExtendedModel(self.base, (*self.causes, cause), bounds, values)

    def without_cause(self, index: int, fit: Fit) -> ExtendedModel:
        """The same without one of its causes, to begin where a fit of it ended."""
        removed = set(self.causes[index].names().values())
        kept = tuple(cause for i, cause in enumerate(self.causes) if i != index)
        bounds = {name: bound for name, bound in fit.problem.bounds.items() if name not in removed}
        return ExtendedModel(self.base, kept, bounds, {name: fit.values[name] for name in bounds})


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
