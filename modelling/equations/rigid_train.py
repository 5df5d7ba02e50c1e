"""What a rigid gear passes on: the torques and inertias of the rigid train on either side of it.

A rigid gear is eliminated, so that its torque stands in no equation. It follows from both sides: all torques that act
on the first side and its inertia, reflected to the gear's second end, and the same of the second side.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import sympy as sm

from modelling.common.errors import InputError
from modelling.effects.interface import GearLaw, Motion, ShaftLaw
from modelling.effects.place import members
from modelling.model.components import Gear
from modelling.model.system import System

Torque = tuple[str, sm.Expr]  # an inertia and a torque on it, N·m


def check_loss(system: System, gear: Gear, motions: Mapping[str, Motion], shafts: Mapping[str, ShaftLaw]) -> None:
    """Refuse the loss of a gear whose torque does not follow from its sides.

    Parameters
    ----------
    motions, shafts : dict
        By inertia and by shaft.

    Raises
    ------
    InputError
        With a differential or a second lossy gear in the same rigid train, or a shaft on it with a further inertia.
    """
    place = f"gears.{gear.name}"
    train = _side(system, gear.between[0], "")
    for part in system.differentials:
        if {part.cage, part.left, part.right} & train:
            raise InputError(place, f"is in one rigid train with {part.name}", "leave its loss out")
    lossy = {effect.at for effect in system.effects}
    for other in system.gears:
        if other is not gear and f"gears.{other.name}" in lossy and other.between[0] in train:
            raise InputError(place, f"and gears.{other.name}, in one rigid train, both have losses", "state one loss")
    for shaft in system.shafts:
        branches = shafts[shaft.name].second is not motions[shaft.between[1]]
        if branches and train & set(shaft.between):
            raise InputError(place, f"has a loss beside a further inertia in {shaft.name}", "make that an inertia")
    if gear.between[1] in _side(system, gear.between[0], gear.name):
        raise InputError(place, "is one of a ring: what it passes on is undetermined", "leave its loss out")


def gear_law(
    system: System, gear: Gear, motions: dict[str, Motion], inertia: dict[str, sm.Expr], torques: list[Torque]
) -> GearLaw:
    """Torques and inertias on both sides of a gear, reflected to its second end.

    Parameters
    ----------
    motions, inertia : dict by inertia
        Inertias in kg·m².
    torques : list of (str, Expr)
        All that act, each on an inertia.
    """
    first_side = _side(system, gear.between[0], gear.name)
    second = motions[gear.between[1]]
    ((index, unit),) = second.coefficients.items()
    torque, mass = [sm.S.Zero, sm.S.Zero], [sm.S.Zero, sm.S.Zero]
    coefficients = {name: motion.coefficients.get(index) for name, motion in motions.items()}
    shares = {name: share / unit for name, share in coefficients.items() if share is not None}
    for name, share in shares.items():
        mass[name not in first_side] += inertia[name] * share**2
    for name, value in torques:
        if name in shares:
            torque[name not in first_side] += value * shares[name]
    return GearLaw(f"gears.{gear.name}", second, torque[0], mass[0], torque[1], mass[1])


def torques_of_shaft(law: ShaftLaw, ends: tuple[str, str], ratio: sm.Expr) -> Iterator[Torque]:
    """What a shaft with its losses does to its ends."""
    yield ends[0], -law.torque / ratio
    yield ends[1], law.torque - sm.Add(*(loss(law.torque) for loss in law.losses))


def acted_on(component: str, on: dict[str, str]) -> str:
    """The inertia that a torque named after a component acts on; empty for a shaft's. ``on`` is by input."""
    table, name = members(component)[0].split(".")[:2]
    return {"inertias": name, "inputs": on.get(name, "")}.get(table, "")


def _side(system: System, inertia: str, without: str) -> set[str]:
    """All inertias that rigid gears join to one, one gear left out."""
    joined = {inertia}
    while True:
        neighbours = {
            end for gear in system.gears if gear.name != without and joined & set(gear.between) for end in gear.between
        }
        if neighbours <= joined:
            return joined
        joined |= neighbours
