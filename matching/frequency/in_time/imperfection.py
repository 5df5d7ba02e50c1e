"""In what a bed differs from the model that its controller was designed with."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from matching.frequency.case.case import Case
from matching.frequency.case.uncertainty import of_system
from modelling.effects import EFFECTS, Kind
from modelling.model.components import Effect
from modelling.model.mirror import mirror_image
from modelling.model.quantity import Quantity
from modelling.model.system import System

SOFTER, HEAVIER = 0.95, 1.05  # of a stiffness and of an inertia: what is known of one that was not identified
LATER_S = 5e-4  # of the dead time: half a sample time of 1 ms
DEMAND_FACTOR, DEMAND_LATE_S = 1.05, 5e-3  # an inverter's or engine's torque over what was demanded of it
LASH_RAD = 0.02  # of a drive's whole lash at the wheel, a degree
FRICTION_SHARE = 0.02  # of the largest torque at a cut: seals and bearings of an axle
DRAWN_BEDS = 4  # that have everything wrong at once
EVERYTHING_STATED = "everything at once, values 5 % off"
EVERYTHING_DRAWN = f"everything at once, worst of {DRAWN_BEDS} drawn beds"


def required_parameters(law: Kind) -> list[str]:
    """Names of the parameters that an effect cannot do without."""
    return [name for name, parameter in law.parameters.items() if not parameter.optional]


LASH = next(law for law in EFFECTS.values() if law.free_play)
FRICTION = next(law for law in EFFECTS.values() if law.sticks and len(required_parameters(law)) == 1)


@dataclass(frozen=True)
class Imperfection:
    """One bed that is not the model.

    Attributes
    ----------
    words : str
        What is wrong, as a table writes it.
    values : mapping
        Quantities that are not as planned, SI, named as :class:`matching.frequency.case.uncertainty.Uncertain`.
    gap, friction : float
        Lash (rad) of every shaft that the cut runs through, dry friction (N·m) of the inertias on the bed's side of
        these. Shafts with lash of their own, and inertias with friction, keep it.
    demand_factor, demand_late : float
        Measured or demanded torques act with this factor, and so much later (s), than the controller assumes.
    poor_sensors : bool
        Noise and an offset of the sensors' uncertainty, encoders for speeds.
    """

    words: str
    values: Mapping[str, float] = field(default_factory=dict)
    gap: float = 0.0
    friction: float = 0.0
    demand_factor: float = 1.0
    demand_late: float = 0.0
    poor_sensors: bool = False


def imperfections(case: Case, largest_torque: float, seed: int) -> list[Imperfection]:
    """One thing wrong at a time; all of that at once; then everything at once on beds drawn from the case's box.

    Parameters
    ----------
    largest_torque : float
        N·m, of the vehicle at any cut over the manoeuvre.
    seed : int
        Of the drawn beds.
    """
    friction = FRICTION_SHARE * largest_torque
    known, late = case.rig.parameters, case.loop["dead_time"] + LATER_S
    soft = {f"rig.{name}": known[name].value * SOFTER for name in _cut_stiffnesses(case)}
    alone = [
        Imperfection("nothing"),
        Imperfection("shafts at the cut 5 % softer", soft),
        *_heavier(case),
        Imperfection("dead time 0.5 ms longer", {"loop.dead_time": late}),
        Imperfection(
            "driving torque 5 % high and 5 ms late", demand_factor=DEMAND_FACTOR, demand_late=DEMAND_LATE_S
        ),
        Imperfection("lash of 0.02 rad", gap=LASH_RAD),
        Imperfection(f"dry friction of {friction:.0f} N·m", friction=friction),
        Imperfection("noise, offset, encoders", poor_sensors=True),
    ]  # fmt: skip
    every = [
        Imperfection(
            EVERYTHING_DRAWN, case.uncertainty.at(position), LASH_RAD, friction, DEMAND_FACTOR, DEMAND_LATE_S, True
        )
        for position in case.uncertainty.draw(DRAWN_BEDS, seed)
    ]  # fmt: skip
    return [*alone, _at_once(alone), *every]


def _at_once(alone: list[Imperfection]) -> Imperfection:
    """All that is wrong of beds with one thing wrong each."""
    return Imperfection(
        EVERYTHING_STATED,
        {name: value for row in alone for name, value in row.values.items()},
        max(row.gap for row in alone),
        max(row.friction for row in alone),
        max(row.demand_factor for row in alone),
        max(row.demand_late for row in alone),
        any(row.poor_sensors for row in alone),
    )


def _cut_stiffnesses(case: Case) -> list[str]:
    return [f"shafts.{interface.shaft}.stiffness" for interface in case.residual_vehicle.interfaces]


def _heavier(case: Case) -> list[Imperfection]:
    """The inertia that the first input other than a dynamometer's acts on, 5 % heavier."""
    driven = {dynamometer.torque_input for dynamometer in case.loop.dynamometers}
    on = [part.on for part in case.rig.inputs if part.name not in driven][:1]
    heavier = []
    for name in on:
        quantity = f"inertias.{name}.J"
        both = {quantity, mirror_image(quantity, case.rig)}
        values = {f"rig.{inertia}": case.rig.parameters[inertia].value * HEAVIER for inertia in both}
        heavier.append(Imperfection(f"inertia of {name.replace('_', ' ')} 5 % higher", values))
    return heavier


def flawed(system: System, imperfection: Imperfection, case: Case) -> System:
    """Rig or vehicle with what is wrong of the parts that it has: shared components are wrong in both alike."""
    values = of_system(imperfection.values, system)
    effects = []
    laden = {effect.at for effect in system.effects}
    for interface in case.residual_vehicle.interfaces:
        place = f"shafts.{interface.shaft}"
        if imperfection.gap and place not in laden:
            effects.append(_effect(LASH, place, imperfection.gap))
        shaft = next(part for part in case.vehicle.shafts if part.name == interface.shaft)
        near = next(end for end in shaft.between if end != interface.vehicle_end)
        place = f"inertias.{near}"
        if place not in laden:  # of no torque too, so that beds with and without it have the same equations
            laden.add(place)
            effects.append(_effect(FRICTION, place, imperfection.friction))
    return system.with_values(values).with_effects(*effects)


def _effect(law: Kind, place: str, size: float) -> Effect:
    return Effect(law.kind, place, tuple((name, Quantity(size)) for name in required_parameters(law)))
