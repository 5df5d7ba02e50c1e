"""Free play as the check of the channels shows it: small torques from rest run through it again and again.

The recording under torques from rest is compared with the model, with free play in one shaft after another and with dry
friction. The case takes the free play over. It is matched with the play closed, and a mean torque keeps the play closed
on the bed. The bed is linear then, and the diagnosis need not search among all effects.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from matching.bed.channels import ChannelCheck
from matching.bed.excite import bed_inputs
from matching.bed.identify import measured_case
from matching.bed.simulated_bed import bed_system, names_in_system
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
    alike: float = 0.1  # of the least misfit, that tells no two shafts apart: then the one with a ratio has the play
    friction: tuple[float, ...] = (0.0, 0.1, 0.2, 0.4, 0.7)  # of the torque of a drive: it hides play, looks like it
    steps_per_second: float = 1e4  # explicit steps: a hundred simulations of 9 s in two seconds
    stick_speed: float = 0.03  # rad/s, over which the sign of friction changes: below what an encoder shows
    better: float = (
        0.9  # of the misfit without play, where that is too large for a linear bed: friction changes it less
    )
    over_twist: float = 1.0  # of a shaft's largest twist, that play is larger than: a softer shaft looks like less play
    at_first: float = 1e-2  # s at rest before the first torque, at least, whose mean is a reading's zero
    linear: float = 0.2  # of the readings: misfit of a linear bed, fitted, is 0.05 to 0.07, of one with play over 0.5
    places: int = 2  # shafts that are fitted: those with the least misfit before a fit
    begins: int = 3  # gaps of each that a fit begins at
    near: float = 1.5  # factor on such a gap that a fit stays within: the next is tried as well
    horizons: tuple[float, ...] = (0.3, 1.0)  # parts of the recording that are fitted one after another
    tries: int = 9  # steps that are tried in each: the misfit hardly falls after them
    hardly: float = 0.02  # of a cost, by which a step is not worth another
    change: float = 1e-2  # of a half-width, by which a value is changed for a derivative: above the steps of contact
    weight: float = 30.0  # of the relative misfit over a deviation of one half-width: data decide where they tell


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


def play_beside(case: Case, checked: ChannelCheck) -> LostMotion | None:
    """Free play that a check of the channels shows beside what it measures, with its wrong channels mended.

    None where the check explains its recording, or a trip ended it.
    """
    if checked.explained or checked.mended is None:
        return None
    return lost_motion(measured_case(case, checked.measured)[0], checked.mended)


def lost_motion(
    case: Case, recording: Recording, settings: LostMotionSettings = LOST_MOTION
) -> LostMotion | None:  # fmt: skip
    """Free play that a recording of the check of the channels shows; None where it shows none.

    Inertias, stiffnesses, dampings and torque gains are off as well: they are fitted with and without play, each about
    its stated value by its half-width, and the two fits are compared.

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
    known = names_in_system(case)
    box = [(known[one.name], system.parameters[known[one.name]].value, one.half_width)
           for one in case.uncertainty.uncertain if one.name in known and one.name.startswith(FITTED)]  # fmt: skip
    box = [(name, value, width) for name, value, width in box if width > 0]
    rubbing, most = _rubbing(system, case, sent)

    def of_bed(place: str = "") -> Errors:
        """Relative errors (t·y,) of a bed by deviations (p,) in half-widths, friction (shares), and gap (rad)."""
        play = (Effect(Backlash.kind, place, (("gap", Quantity(1e-3)),)),) if place else ()
        model, last = compiled(system.with_effects(*rubbing, *play)), f"{place}.{Backlash.kind}.gap"

        def errors(x: np.ndarray, share: float = 1.0) -> np.ndarray:
            until = int(share * len(recording.time))
            part = {name: torque[:until] for name, torque in sent.items()}
            values = {name: value + width * own for (name, value, width), own in zip(box, x[: len(box)], strict=True)}
            for effect, size, share in zip(rubbing, most, x[len(box) : len(box) + len(rubbing)], strict=True):
                values[f"{effect.name}.torque"] = max(share, 0.0) * size
            values |= {last: max(x[-1], 1e-6)} if place else {}
            values |= {"simulation.stick_speed": settings.stick_speed} if rubs else {}
            with contextlib.suppress(SimulationError):
                done = simulate(
                    model, recording.time[:until], part, values, sensors=names,
                    steps_per_second=settings.steps_per_second,
                )  # fmt: skip
                return np.nan_to_num((read[:until] - np.stack([done[name] for name in names], axis=1)) / scale).ravel()
            return np.full(read[:until].size, FAR)

        return errors

    rubs = bool(rubbing) or any(effect.kind == CoulombFriction.kind for effect in system.effects)
    count, shares = len(box), settings.friction if rubbing else (0.0,)
    without = of_bed()
    stated = [np.concatenate([np.zeros(count), np.full(len(rubbing), share)]) for share in shares]
    begun = min(stated, key=lambda x: _size(without(x)))
    base = begun
    for share in settings.horizons:
        base = _fitted(without, base, count, len(rubbing), settings, share)
    least = _size(without(base))
    if not settings.linear < least < FAR:
        return None
    first = settings.horizons[0]
    places = {place: (of_bed(place), gaps) for place, gaps in _places(system, case, sent, settings).items()}
    tried = [
        (_size(playing(begin, first)), number, place, begin)
        for place, (playing, gaps) in places.items()
        for number, begin in enumerate(np.append(x, gap) for gap in gaps for x in (base, *stated[:2]))
    ]  # fmt: skip
    tried.sort(key=lambda one: one[:2])

    def nearest(place: str, begins: Sequence[np.ndarray], share: float) -> tuple[float, np.ndarray]:
        """The least misfit of a part of the recording that fits reach, and its values."""
        playing = places[place][0]
        found = [_fitted(playing, begin, count, len(rubbing), settings, share) for begin in begins]
        return min(((_size(playing(x, share)), x) for x in found), key=lambda one: one[0])

    best = dict[str, tuple[float, np.ndarray]]()
    for place in list(dict.fromkeys(place for _, _, place, _ in tried))[: settings.places]:
        begins = [begin for _, _, at, begin in tried if at == place][: settings.begins]
        best[place] = nearest(place, begins, first)
    for place in [place for place in best if place != min(best, key=lambda one: best[one][0])]:
        # play on either side of a small inertia looks alike: the same play is tried there
        of_least, begin = min(best, key=lambda one: best[one][0]), min(best.values(), key=lambda one: one[0])[1].copy()
        begin[-1] *= (
            places[place][1][-1] / places[of_least][1][-1]
        )  # the largest gaps, which are the same at the rotors
        best[place] = min(best[place], nearest(place, [begin], first), key=lambda one: one[0])
    for share in settings.horizons[1:]:
        best = {place: nearest(place, [x], share) for place, (_, x) in best.items()}
    if not best:
        return None
    geared = {f"shafts.{shaft.name}" for shaft in system.shafts if shaft.ratio is not None}
    smallest = min(misfit for misfit, _ in best.values())
    near = {place: one for place, one in best.items() if one[0] <= (1 + settings.alike) * smallest}
    place = min(near, key=lambda one: (one not in geared, near[one][0]))
    misfit, found = best[place]
    return LostMotion(place, float(found[-1]), misfit / least) if misfit < settings.better * least else None


Errors = Callable[..., np.ndarray]
FITTED = ("rig.inertias.", "rig.shafts.", "dynamometers.")
FAR = 1e3  # relative error of what does not simulate


def _size(errors: np.ndarray) -> float:
    return float(np.sqrt(np.mean(errors**2)))


def _fitted(
    errors: Errors, begin: np.ndarray, count: int, rubbing: int, settings: LostMotionSettings, share: float
) -> np.ndarray:
    """Deviations (p,), friction and gap of the least misfit near ``begin``; the first ``count`` are held by the box.

    Of a share of the recording, its begin: a vibration that is followed too long has a minimum at every beat.
    """
    scale = np.ones(len(begin))
    scale[count:] = 0.1
    scale[count + rubbing :] = 0.3 * begin[count + rubbing :]
    low, high = np.zeros(len(begin)), np.full(len(begin), np.inf)
    low[:count], high[:count] = -LARGEST, LARGEST
    for i in range(count + rubbing, len(begin)):  # every size of play has a minimum of its own
        low[i], high[i] = begin[i] / settings.near, begin[i] * settings.near

    def weighed(x: np.ndarray) -> np.ndarray:
        left = errors(x, share)
        return np.append(settings.weight * left / np.sqrt(len(left)), x[:count])

    def slopes(x: np.ndarray) -> np.ndarray:
        # contact and friction have steps: differences over a step above them, which SciPy's own are not at 0
        step, now = settings.change * scale, weighed(x)
        return np.stack([(weighed(x + own) - now) / own.sum() for own in np.diag(step)], axis=1)

    return least_squares(
        weighed, np.clip(begin, low, high), slopes, (low, high), "dogbox", settings.hardly, None, None, x_scale=scale,
        max_nfev=settings.tries,
    ).x  # fmt: skip


LARGEST = 3.0  # half-widths that a quantity is off at most


def _rubbing(system: System, case: Case, sent: dict[str, np.ndarray]) -> tuple[tuple[Effect, ...], tuple[float, ...]]:
    """Dry friction where torques act that no dynamometer gives, and the largest torque of a manoeuvre there, N·m."""
    driven = {one.torque_input for one in case.loop.dynamometers}
    known = {effect.at for effect in system.effects if effect.kind == CoulombFriction.kind}
    places = [part.on for part in system.inputs if part.name not in driven and part.name in sent and case.manoeuvre
              and f"inertias.{part.on}" not in known]  # fmt: skip
    size = case.largest_torque
    effects = tuple(Effect(CoulombFriction.kind, f"inertias.{at}", (("torque", Quantity(0.0)),)) for at in places)
    return (effects, (size,) * len(effects)) if size else ((), ())


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
