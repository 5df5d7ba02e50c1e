"""Delays that vehicle and rig have alike, of inputs and sensors: taken out of both, no response changes by them."""

from __future__ import annotations

from dataclasses import replace

from modelling.common.errors import InputError
from modelling.model.system import System


def without_shared_delays(vehicle: System, rig: System) -> tuple[System, System, tuple[str, ...]]:
    """Vehicle and rig from the torques that act to the signals before their delay; and a sentence for each delay.

    Raises
    ------
    InputError
        If the two have another delay at one place, or the rig has one where the vehicle has nothing: at a dynamometer.
    """
    delays = [_delays(system) for system in (vehicle, rig)]
    places = [set(system.places()) for system in (vehicle, rig)]
    sentences = []
    for place in sorted({*delays[0], *delays[1]}):
        here, there = (by_place.get(place, 0.0) for by_place in delays)
        if place not in places[0]:
            raise InputError(
                f"rig: {place}", "is delayed inside the control loop", "state it in loop.dead_time instead"
            )
        if place in places[1] and here != there:
            raise InputError(
                f"rig: {place}",
                f"is delayed by {1e3 * there:g} ms, in the vehicle by {1e3 * here:g} ms",
                "what both have under one name is the same hardware: give both the same delay",
            )
        what = "torque that acts" if place.startswith("inputs.") else "signal before its delay"
        sentences.append(
            f"{place} is delayed by {1e3 * here:g} ms, in vehicle and rig alike: responses, manoeuvre and feed-forward "
            f"count from the {what}"
        )
    return _without_delays(vehicle), _without_delays(rig), tuple(sentences)


def _delays(system: System) -> dict[str, float]:
    delays: dict[str, float] = {}
    for effect in system.effects:
        if effect.law.only_delays:
            delays[effect.at] = delays.get(effect.at, 0.0) + sum(quantity.value for _, quantity in effect.parameters)
    return delays


def _without_delays(system: System) -> System:
    return replace(system, effects=tuple(effect for effect in system.effects if not effect.law.only_delays))
