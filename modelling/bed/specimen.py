"""What a controller knows of the specimen: all of it, or what stands before its first gear or clutch.

A specimen that shifts, or that nobody knows, has no model that a controller could predict with. What stands between the
dynamometers and the first gear, clutch or converter stays the same: rotors, adapters, flanges, shafts. Beyond it, the
controller's model has one unmeasured torque on each shaft, which the observer estimates like any other.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from modelling.effects.friction_and_compliance import Hysteresis
from modelling.linear.steady_motion import speeds_of, torques_of
from modelling.system import Input, OperatingPoint, System
from modelling.topology import Joint, joints, side, speed_ratios

KNOWN, UNKNOWN = "known", "unknown"
SPECIMENS = (KNOWN, UNKNOWN)  # as case files write it under ``loop.specimen``


@dataclass(frozen=True)
class KnownPart:
    """The part of a rig that a controller predicts with.

    Attributes
    ----------
    system : System
        With an input for the torque at each place where the rest was cut off.
    torques : mapping of str to str
        Inertias at which the rest was cut off, by the input that stands for it.
    places : tuple of str
        Gears and clutches where it was cut, ``table.name``.
    ratios : mapping of str to float
        By input of the cut: how many times the torque of the fastest input beyond it this torque is, 1 or more. An
        unmeasured torque of the motor wanders so many times faster behind a reduction.
    """

    system: System
    torques: Mapping[str, str]
    places: tuple[str, ...]
    ratios: Mapping[str, float]

    @property
    def names(self) -> set[str]:
        """Its inertias."""
        return {part.name for part in self.system.inertias}


def known_part(rig: System, rotors: Sequence[str], follows: Sequence[str], outer: Sequence[str]) -> KnownPart:
    """Cut a rig at the first gear, clutch or converter that lies behind the shafts of the cut.

    A gear between a rotor and its shaft is of the bed and stays, and so does an open differential: it is the same in
    every gear.

    Parameters
    ----------
    rig : System
    rotors, follows, outer : sequence of str (k)
        The dynamometers' inertias, the shafts through which the residual vehicle is cut, and the ends of these shafts
        on the dynamometers' side.
    """
    without = [f"shafts.{name}" for name in follows]
    bed = set[str]().union(*(side(end, joints(rig, without=without)) for end in outer))
    inner = {end for shaft in rig.shafts if shaft.name in follows for end in shaft.between} - {*outer}
    of_bed = set() if inner & bed else bed  # with another way around the shafts nothing tells bed and specimen apart
    changing = [
        joint for joint in joints(rig, without=without) if _changes(joint, rig) and not set(joint.ends) <= of_bed
    ]
    places = [joint.place for joint in changing]
    kept = set[str]().union(*(side(rotor, joints(rig, without=places)) for rotor in rotors))
    cut = [joint for joint in changing if set(joint.ends) & kept]
    torques = torques_of_rest(rig, kept)
    ratios = {name: max(_ratio(rig, end, joint, kept) for joint in cut if end in joint.ends)
              for name, end in torques.items()}  # fmt: skip
    return KnownPart(part_of(rig, kept, torques), torques, tuple(joint.place for joint in cut), ratios)


def torques_of_rest(system: System, kept: set[str]) -> dict[str, str]:
    """Inertias of a part, ``kept``, at which the rest is cut off, by a name for the torque that stands for it."""
    cut = [joint for joint in joints(system) if 0 < len({*joint.ends} & kept) < len({*joint.ends})]
    torques = dict[str, str]()
    for end in dict.fromkeys(end for joint in cut for end in joint.ends if end in kept):
        name = f"{next(joint for joint in cut if end in joint.ends).place.partition('.')[2]}_torque"
        while name in torques or any(part.name == name for part in system.inputs):
            name += "_"
        torques[name] = end
    return torques


def _changes(joint: Joint, rig: System) -> bool:
    """Whether a joint is a gear, a clutch or a converter: what lies beyond may change its ratio, or slip."""
    table, _, name = joint.place.partition(".")
    if table in ("gears", "planetary_gears"):
        return True
    if table != "shafts":
        return False
    shaft = next(part for part in rig.shafts if part.name == name)
    slips = any(effect.at == joint.place and effect.kind == Hysteresis.kind for effect in rig.effects)
    return shaft.ratio is not None or (slips and shaft.stiffness.value == 0)


def _ratio(rig: System, end: str, joint: Joint, kept: set[str]) -> float:
    """Speed of the fastest input beyond a cut joint over that of the end that stays, at least 1."""
    beyond = speed_ratios(end, [joint, *(other for other in joints(rig) if not set(other.ends) & kept)])
    driven = {part.on for part in rig.inputs} - kept
    others = [name for name in beyond if name in driven] or [name for name in joint.ends if name not in kept]
    return max([1.0, *(abs(beyond[name]) for name in others)])


def part_of(system: System, names: set[str], torques: Mapping[str, str]) -> System:
    """The part of a system whose inertias are named, with further ``torques`` on inertias, by the name of the input.

    What is not whole in it is left out. It moves as in the whole system: the further torques follow.
    """
    kept = names & {part.name for part in system.inertias}
    shafts = tuple(part for part in system.shafts if set(part.between) <= kept)
    measured = kept | {part.name for part in shafts}
    inputs = tuple(part for part in system.inputs if part.on in kept)
    point = None
    if system.operating_point is not None:
        speeds, held = speeds_of(system), torques_of(system)
        point = OperatingPoint(
            tuple((name, speed) for name, speed in speeds.items() if name in kept),
            tuple((part.name, held[part.name]) for part in inputs),
        )
    part = replace(
        system,
        inertias=tuple(part for part in system.inertias if part.name in kept), shafts=shafts,
        gears=tuple(part for part in system.gears if set(part.between) <= kept),
        differentials=tuple(part for part in system.differentials if set(part.ends) <= kept),
        planetary_gears=tuple(part for part in system.planetary_gears if set(part.ends) <= kept),
        inputs=(*inputs, *(Input(name, end, "torque") for name, end in torques.items() if end in kept)),
        sensors=tuple(part for part in system.sensors if part.of in measured),
        mirror=tuple(pair for pair in system.mirror if set(pair) <= kept),
        effects=(), reference="", operating_point=point,
    )  # fmt: skip
    places = set(part.places())
    effects = (each for each in system.effects if all(".".join(at.split(".")[:2]) in places for at in each.places))
    return replace(part, effects=tuple(effects))
