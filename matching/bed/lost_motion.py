"""Free play as the check of the channels shows it: small torques from rest run through it again and again.

The recording under torques from rest is compared with the model, with free play in one shaft after another and with
what else may be off. The case takes the free play over. It is matched with the play closed, and a mean torque keeps the
play closed on the bed. The bed is linear then, and the diagnosis need not search among all effects.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from matching.bed.deviations import DEVIATIONS, Fit, Found, misfit_of, recorded_check, solved
from matching.bed.excite import bed_inputs
from matching.bed.simulated_bed import bed_system
from matching.match.case import Case
from modelling.bed.vehicle import cut
from modelling.effects.friction_and_compliance import Backlash
from modelling.recordings.recording import Recording
from modelling.simulation.stepping import SimulationError
from modelling.system import Effect, Quantity, System
from modelling.topology import joints, speed_ratios


@dataclass(frozen=True)
class LostMotionSettings:
    """How free play is looked for; the reason of a number stands next to it."""

    gaps: tuple[float, ...] = tuple(5e-4 * 2 ** (n / 3) for n in range(19))  # rad at the dynamometers' rotors, to 0.032
    over_twist: float = 0.1  # of a shaft's largest twist, that play is larger than: less is within the noise
    at_first: float = 1e-2  # s at rest before the first torque, at least, whose mean is a reading's zero
    linear: float = 0.03  # misfit of the best fit without play, relative, up to which none is looked for
    begins: int = 3  # gaps of a shaft that a fit begins at
    better: float = 0.5  # of what χ² has beyond noise without play: no other defect leaves so little
    alike: float = 40.0  # of χ², that tells no two shafts apart: then the one with a ratio has the play


LOST_MOTION = LostMotionSettings()


@dataclass(frozen=True)
class LostMotion:
    """Free play as the check of the channels shows it.

    Attributes
    ----------
    at : str
        ``shafts.NAME``.
    gap : float
        rad, total.
    misfit : float
        Of the readings beyond their noise, of that without play.
    values : mapping of str to float
        Where its fit ended, as :attr:`matching.bed.deviations.Deviations.coordinates`.
    """

    at: str
    gap: float
    misfit: float
    values: Mapping[str, float] = field(default_factory=dict, repr=False)

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
    case: Case, recording: Recording, settings: LostMotionSettings = LOST_MOTION, share: float = DEVIATIONS.part,
    begin: Mapping[str, float] | None = None,
) -> LostMotion | None:  # fmt: skip
    """Free play that a recording of the check of the channels shows; None where it shows none.

    All that is not known of the bed is fitted to the first part of the recording, without free play and with it in
    one shaft after another (:mod:`matching.bed.deviations`). The fits are compared.

    Parameters
    ----------
    recording : Recording
        Torque commands of all inputs and sensors of the rig whose channels are right, from rest, at even steps.
    share : float
        Part of the recording that is fitted: what moves freely is followed too long otherwise.
    begin : mapping of str to float, optional
        Where the fits begin, as :attr:`matching.bed.deviations.Deviations.coordinates`.
    """
    system, inputs = bed_system(case), bed_inputs(case)
    sent = {name: recording[name] for name in inputs}
    moving = np.flatnonzero(np.any([np.abs(torque) > 0.05 * np.abs(torque).max() for torque in sent.values()], axis=0))
    if not len(moving) or recording.time[moving[0]] - recording.time[0] < settings.at_first:
        return None
    read = {sensor.name: recording[sensor.name] for sensor in system.sensors if sensor.name in recording.channels}
    time, lead = recording.time - recording.time[0], int(moving[0])

    def part(of: System) -> Fit:
        return Fit(recorded_check(case, of, time, sent, read, lead, DEVIATIONS).until(share))

    def start(fit: Fit) -> np.ndarray:
        return np.array([one.coordinate(begin[one.name]) if begin and one.name in begin else 0.0 for one in fit.free])

    try:
        plain = part(system)
        without = solved(plain, start(plain), ())
    except SimulationError:
        return None
    if misfit_of(without) <= settings.linear:
        return None
    found = dict[str, Found]()
    for place, gaps in _places(system, case, sent, settings).items():
        fit = part(system.with_effects(Effect(Backlash.kind, place, (("gap", Quantity(gaps[0])),))))
        n = [one.name for one in fit.free].index(f"{place}.gap")
        begins = list[tuple[float, np.ndarray]]()
        for gap in gaps:
            x = start(fit)
            x[n] = np.log(gap / gaps[0])
            begins.append((fit.size(x), x))
        begins.sort(key=lambda one: one[0])
        for size, x in begins[: settings.begins]:
            with contextlib.suppress(SimulationError):
                ended = solved(fit, x, ()) if np.isfinite(size) else None
                if ended is not None and (place not in found or ended.cost < found[place].cost):
                    found[place] = ended
    if not found:
        return None
    geared = {f"shafts.{shaft.name}" for shaft in system.shafts if shaft.ratio is not None}
    least = min(one.cost for one in found.values())
    near = {place: one for place, one in found.items() if one.cost <= least + settings.alike}
    place = min(near, key=lambda one: (one not in geared, near[one].cost))
    best, of_noise = near[place], without.fit.run.of_noise
    left = max(best.cost - of_noise, 0.0) / (without.cost - of_noise)
    n = [one.name for one in best.fit.free].index(f"{place}.gap")
    gap = best.fit.free[n].at(float(best.x[n]))
    return LostMotion(place, gap, float(np.sqrt(left)), best.values) if left < settings.better**2 else None


def _places(
    system: System, case: Case, sent: dict[str, np.ndarray], settings: LostMotionSettings
) -> dict[str, list[float]]:
    """Shafts without free play of their own, and gaps (rad) that are larger than what the torques twist them by."""
    rotor = {part.name: part.on for part in system.inputs}[case.loop.dynamometers[0].torque_input]
    ratios = speed_ratios(rotor, joints(system))
    flanges = {sensor.of for sensor in system.sensors
               if sensor.name in {one.torque_sensor for one in case.loop.dynamometers}}  # fmt: skip
    loaded = max(float(np.abs(torque).max()) * abs(ratios.get(part.on, 0.0))
                 for part in system.inputs for name, torque in sent.items() if name == part.name)  # fmt: skip
    playing = {place for effect in system.effects if effect.law.free_play for place in effect.places}
    found: dict[str, list[float]] = {}
    for shaft in system.shafts:
        place, turned = f"shafts.{shaft.name}", abs(ratios.get(shaft.between[1], 1.0))
        if shaft.name in flanges or place in playing:
            continue
        twist = loaded / turned / shaft.stiffness.value
        gaps = [gap * turned for gap in settings.gaps if gap * turned > settings.over_twist * twist]
        if gaps:
            found[place] = gaps
    return found
