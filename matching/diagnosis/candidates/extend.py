"""The model file's system with the causes as effects, at fitted values."""

from __future__ import annotations

from collections.abc import Mapping

from matching.diagnosis.candidates.cause import Cause
from modelling.effects import EFFECTS
from modelling.model.components import Effect
from modelling.model.quantity import Quantity
from modelling.model.system import System


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
