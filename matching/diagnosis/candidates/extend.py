"""The model plus what was found."""

from __future__ import annotations

from collections.abc import Mapping

from matching.diagnosis.candidates.candidates import Cause
from modelling.effects import EFFECTS
from modelling.model.components import Effect
from modelling.model.quantity import Quantity
from modelling.model.system import System


def extended(system: System, causes: tuple[Cause, ...], values: Mapping[str, float]) -> System:
    """A system with the causes as effects, at fitted values; ranges stay as they were given."""
    wrong = {cause.at for cause in causes if cause.replaces_quantity}
    known = {name: value for name, value in values.items() if name in system.parameters and name not in wrong}
    effects = []
    for cause in causes:
        own = EFFECTS[cause.kind].canonical({key: values[name] for key, name in cause.names().items()})
        effects.append(Effect(cause.kind, cause.at, tuple((key, Quantity(value)) for key, value in own.items())))
    return system.with_values(known).with_effects(*effects)
