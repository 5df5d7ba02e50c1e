"""Sensors of a bed that read late, filtered or with a factor: what a diagnosis names of them enters the next match.

The controller reads the sensor as it is, and vehicle and bed are compared by what the same sensor would read of both.
So the sensor of the vehicle gets the same fault, whatever stands there on the road.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from modelling.effects.all_pass import AllPass
from modelling.effects.lag import Lag
from modelling.effects.place import shared_place
from modelling.effects.sensor_delay import SensorDelay
from modelling.effects.sensor_drift import SensorDrift
from modelling.effects.sensor_gain import SensorGain
from modelling.effects.sensor_offset import SensorOffset
from modelling.model.components import Effect
from modelling.model.quantity import Quantity
from modelling.model.system import System

CONSTANT = (SensorOffset.kind, SensorDrift.kind)  # deviations from the state at the switch do not hold them
_TAKEN = (SensorDelay.kind, AllPass.kind, Lag.kind, SensorGain.kind)


def is_taken(effect: Effect) -> bool:
    """Whether a match can take an effect of a sensor."""
    return effect.at.startswith("sensors.") and effect.kind in _TAKEN


def with_faults(system: System, faults: Iterable[Effect]) -> System:
    """A system with faults of those sensors that it has; a fault that is there already is joined with the new one."""
    there = set(system.places())
    for fault in faults:
        at = shared_place(place for place in fault.places if place in there)
        if at:
            system = _joined(system, replace(as_states(fault), at=at))
    return system


def as_states(effect: Effect) -> Effect:
    """An effect that a linear model holds: a delay of a sensor as an all-pass."""
    return replace(effect, kind=AllPass.kind) if effect.kind == SensorDelay.kind else effect


def as_recorded(effect: Effect) -> Effect:
    """An effect as a recording is fitted: the delay itself in place of its all-pass."""
    return replace(effect, kind=SensorDelay.kind) if effect.kind == AllPass.kind else effect


def _joined(system: System, fault: Effect) -> System:
    known = {effect.name: effect for effect in system.effects}
    if fault.name not in known:
        return system.with_effects(fault)
    ((key, before),), ((_, new),) = known[fault.name].parameters, fault.parameters
    value = before.value * new.value if fault.kind == SensorGain.kind else before.value + new.value
    return replace(
        system,
        effects=tuple(
            replace(effect, parameters=((key, Quantity(value)),)) if effect.name == fault.name else effect
            for effect in system.effects
        ),
    )
