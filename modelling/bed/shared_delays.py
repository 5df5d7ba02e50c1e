"""Delays of inputs and sensors in the models of a case: those of inputs are taken out, those of sensors get states."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

from modelling.common.errors import InputError
from modelling.effects.all_pass import AllPass
from modelling.model.components import Effect
from modelling.model.system import System


class WithoutDelays(NamedTuple):
    """Vehicle and rig that a linear model holds, and a sentence for each delay."""

    vehicle: System
    rig: System
    sentences: tuple[str, ...]


def without_exact_delays(vehicle: System, rig: System) -> WithoutDelays:
    """Vehicle and rig that a linear model holds, and what was delayed.

    Torques count from where they act: an input that vehicle and rig have late alike is late in neither. A sensor that
    is late gets an all-pass: the controller reads it late, and vehicle and bed are compared as they read.

    Raises
    ------
    InputError
        If the two have another delay at one place, or an input of the rig alone has one: that of a dynamometer.
    """
    delays = [_delays(system) for system in (vehicle, rig)]
    places = [set(system.places()) for system in (vehicle, rig)]
    sentences = []
    for place in sorted({*delays[0], *delays[1]}):
        here, there = (by_place.get(place, 0.0) for by_place in delays)
        of_sensor = place.startswith("sensors.")
        if place not in places[0] and not of_sensor:
            raise InputError(
                f"rig: {place}", "is delayed inside the control loop", "state it in loop.dead_time instead"
            )
        if place in places[0] and place in places[1] and here != there:
            raise InputError(
                f"rig: {place}",
                f"is delayed by {1e3 * there:g} ms, in the vehicle by {1e3 * here:g} ms",
                "what both have under one name is the same hardware: give both the same delay",
            )
        late = f"{place} is delayed by {1e3 * max(here, there):g} ms"
        sentences.append(
            f"{late}: the controller reads it so, and responses are compared as it reads" if of_sensor else
            f"{late}, in vehicle and rig alike: manoeuvre and feed-forward count from the torque that acts"
        )  # fmt: skip
    return WithoutDelays(_with_states(vehicle), _with_states(rig), tuple(sentences))


def _delays(system: System) -> dict[str, float]:
    delays: dict[str, float] = {}
    for effect in system.effects:
        if effect.law.only_delays:
            for place in effect.places:
                delays[place] = delays.get(place, 0.0) + sum(quantity.value for _, quantity in effect.parameters)
    return delays


def _with_states(system: System) -> System:
    def kept() -> Iterator[Effect]:
        for effect in system.effects:
            if not effect.law.only_delays:
                yield effect
            elif effect.at.startswith("sensors.") and effect.parameters[0][1].value > 0:
                yield Effect(AllPass.kind, effect.at, effect.parameters)

    return replace(system, effects=tuple(kept()))
