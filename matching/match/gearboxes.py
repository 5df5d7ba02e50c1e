"""Gearboxes of vehicle and rig: a case holds them in one gear, its drives may shift."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

import numpy as np

from modelling.bed.clutches import CLOSED
from modelling.bed.manoeuvres import Manoeuvre
from modelling.bed.vehicle import without_exact_delays
from modelling.errors import InputError
from modelling.system import System

AT_ONCE = 1e-6  # s: a torque that jumps as the drive begins has jumped


def carried(torque: Manoeuvre, time: np.ndarray) -> np.ndarray:
    """What a clutch carries (t,), N·m, at times (t,) in s: as the drive begins it carries it already."""
    return torque.torque(np.maximum(time, AT_ONCE))


@dataclass(frozen=True)
class Gearboxes:
    """Vehicle and rig as their files have them, and in which gear the case holds their gearboxes.

    Attributes
    ----------
    vehicle, rig : System
        With live clutches.
    gears : mapping of str to int
        Gear of the case by gearbox, 1 the first.
    closed : mapping of str to float
        N·m by input: the clutches that the case's operating point names.
    emulated : tuple of str
        Gearboxes of the vehicle that the controller emulates with live clutches: all else in the case has them locked.
    """

    vehicle: System
    rig: System
    gears: Mapping[str, int]
    closed: Mapping[str, float]
    emulated: tuple[str, ...] = ()

    @property
    def emulated_clutches(self) -> tuple[str, ...]:
        """Inputs of clutches that the controller emulates live."""
        return tuple(name for box in self.vehicle.gearboxes if box.name in self.emulated for name in box.capacities)

    @property
    def driven(self) -> tuple[str, ...]:
        """Inputs of clutches that a drive may name."""
        return (*self.shared, *self.emulated_clutches)

    def emulating(self, beyond: Collection[str]) -> Gearboxes:
        """With live clutches among inertias beyond the cut: of one ratio, dry friction, no effect at the capacity."""
        late = {place for effect in self.vehicle.effects for place in effect.places}
        live = tuple(
            box.name for box in self.vehicle.gearboxes
            if {*box.between} <= {*beyond} and len(box.ratios) == 1 and box.engages_below is None
            and box.converter is None and f"inputs.{box.capacities[0]}" not in late
        )  # fmt: skip
        return replace(self, emulated=live)

    def emulated_vehicle(self, vehicle: System) -> System:
        """The vehicle of the case with the clutches live that the controller emulates."""
        return replace(vehicle, operating_point=None).shifting(
            self.vehicle, dict.fromkeys(self.emulated_clutches, CLOSED)
        )

    def note(self, box: str, role: str) -> str:
        """What linear models make of a gearbox of the ``vehicle`` or ``rig``."""
        if role == "vehicle" and box in self.emulated:
            return f"vehicle: gearboxes.{box} slips and opens in the emulated vehicle; linear models have it locked"
        return f"{role}: gearboxes.{box} is in gear {self.gears[box]}, its clutch locked"

    @property
    def shared(self) -> tuple[str, ...]:
        """Inputs of clutches that vehicle and rig both have: the vehicle does the same shift."""
        return tuple(name for name in self.rig.capacities if name in self.vehicle.capacities)

    def alone(self, name: str) -> str:
        """``rig`` or ``vehicle`` where only one of them has this clutch; empty otherwise."""
        of_rig, of_vehicle = (name in system.capacities for system in (self.rig, self.vehicle))
        return "rig" if of_rig and not of_vehicle else "vehicle" if of_vehicle and not of_rig else ""

    def as_in_files(self, vehicle: System, rig: System) -> tuple[System, System]:
        """Vehicle and rig of the case, in a gear, with their gearboxes again."""
        return (
            vehicle.shifting(self.vehicle, dict.fromkeys(self.vehicle.capacities, 0.0)),
            rig.shifting(self.rig, dict.fromkeys(self.rig.capacities, 0.0)),
        )

    def without_exact_delays(self) -> Gearboxes:
        """With approximations of exact delays, as the case has them."""
        vehicle, rig, _ = without_exact_delays(self.vehicle, self.rig)
        return replace(self, vehicle=vehicle, rig=rig)

    def begun_in(self, torques: Mapping[str, Manoeuvre], place: str, *, at_rest: bool = False) -> dict[str, int]:
        """The gear by gearbox in which a drive begins, 0 on a converter; of gearboxes whose clutches it names.

        Raises
        ------
        InputError
            If not just one clutch of a gearbox is closed where a drive begins at speed, or one carries less than 0.
        """
        gears = {}
        emulated = (box for box in self.vehicle.gearboxes if box.name in self.emulated)
        for box in (*self.rig.gearboxes, *emulated):
            named = [name for name in box.capacities if name in torques]
            if not named:
                continue
            for name in named:
                if (least := torques[name].smallest) < 0:
                    raise InputError(f"{place}.{name}", f"reaches {least:g} N·m", "what a clutch carries is 0 or more")
            closed = [
                gear
                for gear, name in enumerate(box.capacities, 1)
                if name in named and carried(torques[name], np.zeros(1))[0] > 0
            ]
            if box.converter is not None and not closed:
                gears[box.name] = 0  # on the converter
                continue
            if at_rest:  # nothing turns: any clutch may be open or closed
                gears[box.name] = closed[0] if closed else self.gears[box.name]
                continue
            if len(closed) != 1:
                wrong = f"closes {len(closed)} clutches of gearboxes.{box.name} at its begin ({', '.join(named)})"
                right = (
                    f"one carries a torque there, as {named[0]} = [{{ to = 400, hold = 1 }}] does, or it begins at rest"
                )
                raise InputError(place, wrong, right)
            gears[box.name] = closed[0]
        return gears
