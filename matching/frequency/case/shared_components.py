"""Components that vehicle and rig share by name but not by value."""

from __future__ import annotations

from matching.frequency.case.case import Case

SAME_VALUE = 1e-9  # relative: so near two values of a file are one


def differing_components(case: Case) -> list[str]:
    """A sentence for every shared quantity whose values differ, largest ratio first."""
    vehicle, rig = case.vehicle.parameters, case.rig.parameters
    differing = []
    for name in rig:
        if name not in vehicle:
            continue
        here, there = rig[name].value, vehicle[name].value
        off = abs(here - there) / max(abs(here), abs(there), 1e-300)
        if off > SAME_VALUE:
            unit = case.rig.units[name]
            words = (
                f"{name} is {there:g} {unit} in the vehicle and {here:g} {unit} on the rig: "
                "a component that both have under one name is the same hardware, so the two should agree"
            )
            differing.append((-off, words))
    return [words for _, words in sorted(differing)]
