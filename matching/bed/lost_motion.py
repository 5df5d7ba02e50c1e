"""Free play as the check of the channels shows it: small torques from rest run through it again and again.

The recording under torques from rest is compared with the model, with free play in one shaft after another and with dry
friction. What is found enters the case at once. The bed is matched with its play closed, and a mean torque keeps it
so: the bed is linear then, and nothing need be searched for among all effects.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from matching.bed.excite import bed_inputs
from matching.bed.simulated_bed import bed_system
from matching.match.case import Case
from modelling.bed.vehicle import cut
from modelling.effects.friction_and_compliance import Backlash, CoulombFriction
from modelling.equations.casadi_code import compiled
from modelling.recordings.recording import Recording
from modelling.simulation.simulate import simulate
from modelling.simulation.stepping import SimulationError
from modelling.system import Effect, Quantity, System
from modelling.topology import joints, speed_ratios


@dataclass(frozen=True)
class LostMotionSettings:
    """How free play is looked for; the reason of a number stands next to it."""

    gaps: tuple[float, ...] = tuple(5e-4 * 2 ** (n / 2) for n in range(13))  # rad at the dynamometers' rotors, to 0.032
    alike: float = 0.05  # of the least misfit, that tells no two shafts apart: then the one with a ratio has the play
    friction: tuple[float, ...] = (
        0.0,
        0.1,
        0.2,
        0.4,
        0.7,
    )  # of the torque of a drive: it hides play, and looks like it
    steps_per_second: float = 1e4  # explicit steps: a hundred simulations of 9 s in two seconds
    stick_speed: float = 0.03  # rad/s, over which the sign of friction changes: below what an encoder shows
    better: float = 0.75  # of the misfit without play: inertias off by 10 % leave 0.9 and more of it, play 0.55 to 0.67
    over_twist: float = 1.0  # of a shaft's largest twist, that play is larger than: a softer shaft looks like less play
    at_first: float = 1e-2  # s at rest before the first torque, at least, whose mean is a reading's zero


LOST_MOTION = LostMotionSettings()


@dataclass(frozen=True)
class LostMotion:
    """Free play as the check of the channels shows it.

    Attributes
    ----------
    at : str
        ``shafts.NAME``.
    gap : float
        rad, total, as coarsely as it was tried: by factors of √2.
    misfit : float
        Of the readings, of that without play.
    """

    at: str
    gap: float
    misfit: float

    def to_dict(self) -> dict[str, Any]:
        """As ``channels.json`` holds it."""
        return {"at": self.at, "gap": self.gap, "misfit": self.misfit}


def with_free_play(case: Case, seen: LostMotion) -> Case:
    """A case whose rig has the free play that was seen, and whose vehicle has it where the shaft is the same."""
    effect = Effect(Backlash.kind, seen.at, (("gap", Quantity(seen.gap)),))
    rig = case.rig.with_effects(effect)
    vehicle = case.vehicle.with_effects(*([effect] if seen.at in case.vehicle.places() else []))
    return replace(case, rig=rig, vehicle=vehicle, residual_vehicle=cut(vehicle, rig))


def lost_motion(
    case: Case, recording: Recording, settings: LostMotionSettings = LOST_MOTION
) -> LostMotion | None:  # fmt: skip
    """Free play that a recording of the check of the channels shows; None where it shows none.

    Parameters
    ----------
    recording : Recording
        Torque commands of all inputs and sensors of the rig whose channels are right, from rest.
    """
    system, inputs = bed_system(case), bed_inputs(case)
    names = [sensor.name for sensor in system.sensors if sensor.name in recording.channels]
    sent = {name: recording[name] for name in inputs}
    moving = np.flatnonzero(np.any([np.abs(torque) > 0.05 * np.abs(torque).max() for torque in sent.values()], axis=0))
    if not len(moving) or recording.time[moving[0]] - recording.time[0] < settings.at_first:
        return None
    read = np.stack([recording[name] for name in names], axis=1)
    read = read - np.nanmean(read[: moving[0]], axis=0)
    scale = np.maximum(np.sqrt(np.nanmean(read**2, axis=0)), 1e-12)

    def misfit(*effects: Effect) -> float:
        of_bed = system.with_effects(*effects) if effects else system
        rubs = any(effect.kind == CoulombFriction.kind for effect in of_bed.effects)
        values = {"simulation.stick_speed": settings.stick_speed} if rubs else None
        with contextlib.suppress(SimulationError):
            done = simulate(
                compiled(of_bed), recording.time, sent, values, sensors=names,
                steps_per_second=settings.steps_per_second,
            )  # fmt: skip
            model = np.stack([done[name] for name in names], axis=1)
            return float(np.sqrt(np.nanmean(((read - model) / scale) ** 2)))
        return np.inf

    frictions = list(_frictions(system, case, sent, settings))
    without = [misfit(*effects) for effects in frictions]
    held = frictions[int(np.argmin(without))]
    tried = {
        (place, gap): min(misfit(*effects, Effect(Backlash.kind, place, (("gap", Quantity(gap)),)))
                          for effects in {(), held})
        for place, gap in _places(system, case, sent, settings)
    }  # fmt: skip
    if not tried or not np.isfinite(min(without)) or min(without) <= 0:
        return None
    least = min(tried.values())
    geared = {f"shafts.{shaft.name}" for shaft in system.shafts if shaft.ratio is not None}
    near = {one: value for one, value in tried.items() if value <= (1 + settings.alike) * least}
    place, gap = min(near, key=lambda one: (one[0] not in geared, near[one]))
    share = least / min(without)
    return LostMotion(place, gap, share) if share < settings.better else None


def _frictions(
    system: System, case: Case, sent: dict[str, np.ndarray], settings: LostMotionSettings
) -> Iterator[tuple[Effect, ...]]:
    """Nothing, then friction where torques act that no dynamometer gives, as shares of the largest of a manoeuvre."""
    driven = {one.torque_input for one in case.loop.dynamometers}
    known = {effect.at for effect in system.effects if effect.kind == CoulombFriction.kind}
    sizes = {
        part.on: max(float(np.abs(drive.torque(np.linspace(0, drive.duration, 2001))).max())
                     for drive in case.manoeuvre.values())
        for part in system.inputs
        if part.name not in driven and part.name in sent and case.manoeuvre and f"inertias.{part.on}" not in known
    }  # fmt: skip
    for share in settings.friction if sizes else (0.0,):
        yield tuple(
            Effect(CoulombFriction.kind, f"inertias.{place}", (("torque", Quantity(share * size)),))
            for place, size in sizes.items() if share
        )  # fmt: skip


def _places(
    system: System, case: Case, sent: dict[str, np.ndarray], settings: LostMotionSettings
) -> Iterator[tuple[str, float]]:
    """Shafts without free play of their own and gaps (rad) that are larger than what the torques twist them by."""
    rotor = {part.name: part.on for part in system.inputs}[case.loop.dynamometers[0].torque_input]
    ratios = speed_ratios(rotor, joints(system))
    flanges = {sensor.of for sensor in system.sensors
               if sensor.name in {one.torque_sensor for one in case.loop.dynamometers}}  # fmt: skip
    loaded = max(float(np.abs(torque).max()) * abs(ratios.get(part.on, 0.0))
                 for part in system.inputs for name, torque in sent.items() if name == part.name)  # fmt: skip
    playing = {place for effect in system.effects if effect.law.free_play for place in effect.places}
    for shaft in system.shafts:
        place, turned = f"shafts.{shaft.name}", abs(ratios.get(shaft.between[1], 1.0))
        if shaft.name in flanges or place in playing:
            continue
        twist = loaded / turned / shaft.stiffness.value
        for gap in settings.gaps:
            if gap * turned > settings.over_twist * twist:
                yield place, gap * turned
