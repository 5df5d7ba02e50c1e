"""Firing pulses of an engine beyond a cut: up to which frequency the torque at the cut has the vehicle's amplitude."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from matching.match.box import of_system
from matching.match.case import Case
from matching.match.loop import beds_of
from matching.match.operating_range import at_speed, grid, law_over_speed
from modelling.bed.firing import KIND
from modelling.bed.pulse_following import SampledRig, cut_responses, pulsed, vehicle_responses
from modelling.linear.state_space import state_spaces
from modelling.linear.steady_motion import speeds_of
from modelling.system import Effect, Sensor, System


@dataclass(frozen=True)
class FollowedSettings:
    """When pulses count as followed.

    Attributes
    ----------
    tolerance : float
        Relative: how far the amplitude of the torque at the cut may be from that in the vehicle. A tenth is what a
        driver just notices of a vibration.
    share : float
        Of the drawn beds that have to keep it: nine of ten, which forty drawn beds tell from draw to draw alike.
    drawn : int
    least : float
        Of the pulse: an amplitude below counts as this large. At an antiresonance, where hardly anything of the pulse
        passes, no driver notices a tenth of it.
    converges : float
        Cosine of the angle by which a bed may answer otherwise than planned: the correction then comes to its end.
    """

    tolerance: float = 0.1
    share: float = 0.9
    drawn: int = 40
    least: float = 0.1
    converges: float = 0.5


FOLLOWED = FollowedSettings()


@dataclass(frozen=True)
class FollowedPulse:
    """One pulse of an engine; frequencies in Hz, of the pulse.

    Attributes
    ----------
    place, dynamometer : str
        Inertia, and the machine that acts it.
    order, amplitude : float
        Over a turn; N·m.
    lowest, highest : float
        Over the range of speeds.
    planned : float or None
        Up to where the amplitude is within the tolerance on the bed as planned, and the machine's torque within its
        limit; None where it is not at the lowest.
    drawn_off : float
        Relative deviation that the share of drawn beds keeps at every frequency up to there; infinite where one of the
        rest is not followed at all.
    torque : float
        N·m: largest amplitude that the machine gives for it up to ``planned``.
    frequencies, off, off_drawn, torques : tuple of float
        Over frequency: relative deviation of the amplitude as planned, that which the share of drawn beds keeps, and
        amplitude of the machine, N·m.
    settings : FollowedSettings
    """

    place: str
    dynamometer: str
    order: float
    amplitude: float
    lowest: float
    highest: float
    planned: float | None
    drawn_off: float
    torque: float
    frequencies: tuple[float, ...]
    off: tuple[float, ...]
    off_drawn: tuple[float, ...]
    torques: tuple[float, ...]
    settings: FollowedSettings = FOLLOWED

    def speed(self, frequency: float) -> float:
        """rad/s of the engine at which the pulse has a frequency."""
        return 2 * np.pi * frequency / self.order

    def to_dict(self) -> dict[str, Any]:
        """As ``result.json`` holds it."""
        lists = ("frequencies", "off", "off_drawn", "torques")
        return {
            **{name: value for name, value in vars(self).items() if name not in (*lists, "settings")},
            **{name: list(getattr(self, name)) for name in lists}, "tolerance": self.settings.tolerance,
            "share": self.settings.share,
        }  # fmt: skip


def without_pulses(case: Case) -> Case:
    """The case over a range without the pulses beyond its cuts: what is judged over time has no phase of a crank."""
    if case.operating_range is None:
        return case
    beyond = {f"inertias.{part.name}" for system in case.residual_vehicle.parts for part in system.inertias}

    def still(system: System) -> System:
        kept = tuple(effect for effect in system.effects if effect.kind != KIND or effect.at not in beyond)
        return system if len(kept) == len(system.effects) else replace(system, effects=kept)

    parts = tuple(still(part) for part in case.residual_vehicle.parts)
    emulated = replace(case.residual_vehicle, parts=parts, vehicle=still(case.residual_vehicle.vehicle))
    simple = None if case.simple_vehicle is None else still(case.simple_vehicle)
    return replace(case, vehicle=still(case.vehicle), residual_vehicle=emulated, simple_vehicle=simple)


def with_pulses_of(case: Case, given: Case) -> Case:
    """A case that was tuned without its pulses, with those of the case that was given."""
    if given.vehicle.effects == case.vehicle.effects:
        return case

    def pulsing(system: System, of: System) -> System:
        more: tuple[Effect, ...] = tuple(effect for effect in of.effects if effect.kind == KIND)
        return replace(system, effects=tuple(effect for effect in system.effects if effect not in more) + more)

    residual, of = case.residual_vehicle, given.residual_vehicle
    parts = tuple(pulsing(part, other) for part, other in zip(residual.parts, of.parts, strict=True))
    emulated = replace(residual, parts=parts, vehicle=pulsing(residual.vehicle, of.vehicle))
    simple = None
    if case.simple_vehicle is not None and given.simple_vehicle is not None:
        simple = pulsing(case.simple_vehicle, given.simple_vehicle)
    return replace(
        case, vehicle=pulsing(case.vehicle, given.vehicle), residual_vehicle=emulated, simple_vehicle=simple
    )  # fmt: skip


def followed_pulses(case: Case, seed: int = 0, settings: FollowedSettings = FOLLOWED) -> tuple[FollowedPulse, ...]:
    """How far the controller of a tuned case over its range follows each pulse."""
    law, about = law_over_speed(case), case.operating_range
    pulses = law.vehicle.pulses
    if about is None or not law.steps_vehicle or not pulses.count:
        return ()
    cases = [at_speed(case, float(speed)) for speed in grid(about)]
    turning = [speeds_of(one.vehicle) for one in cases]
    most, machines = case.limits_of("torque"), case.loop.dynamometers
    made = []
    for number, place in enumerate(pulses.places):
        engine = law.following.speeds[number]
        there = np.abs([each[place] for each in turning])
        engine = engine[engine <= there[-1] * (1 + 1e-9)]
        nearest = np.abs(np.log(engine[:, None] / there)).argmin(axis=1)
        at_cut = law.following.machines[number]
        gains = np.array([law.following.at(number, float(one)) for one in engine])
        off = np.zeros((settings.drawn + 1, len(engine)))
        torques = np.zeros(len(engine))
        for at in np.unique(nearest):
            rows, own = np.flatnonzero(nearest == at), cases[at]
            values = [{}, *(own.uncertainty.at(one) for one in own.uncertainty.draw(settings.drawn, seed))]
            z = np.exp(1j * pulses.order[number] * engine[rows] * law.sample_time)
            f, cuts = pulses.order[number] * engine[rows] / (2 * np.pi), [machines[at_cut].follows]
            spaces = state_spaces(pulsed(own.vehicle, cuts, [place]), [of_system(one, own.vehicle) for one in values])
            for bed, (rig, space) in enumerate(zip(_rigs(own, values), spaces, strict=True)):
                torque = vehicle_responses(space, own.residual_vehicle, cuts, [place], f)[:, 0, 0]
                m, held = pulses.count, np.sqrt(z)  # the law holds the pulse of the middle of a sample
                found = cut_responses(law, float(law.speeds[at]), rig, z)

                given = _Added(number, at_cut, m, held, gains[rows])
                answer = found.errors[:, at_cut, m + at_cut]
                if not bed:
                    planned_answer = answer
                converges = (answer / planned_answer).real > settings.converges * np.abs(answer / planned_answer)
                more = -given.makes(found.errors, 0.0) / answer
                off[bed, rows] = np.where(converges, _off(given.makes(found.torques, more), torque, settings), np.inf)
                if not bed:
                    torques[rows] = pulses.amplitude[number] * np.abs(given.makes(found.commands, more))
        f = pulses.order[number] * engine / (2 * np.pi)
        high = np.quantile(np.abs(off[1:]), settings.share, axis=0)
        possible = torques <= most[at_cut]
        planned = _up_to(f, (np.abs(off[0]) <= settings.tolerance) & possible)
        within = f <= (planned or 0.0) * (1 + 1e-9)
        made.append(
            FollowedPulse(
                place, machines[at_cut].name, float(pulses.order[number]), float(pulses.amplitude[number]),
                float(f[0]), float(pulses.order[number] * there[-1] / (2 * np.pi)), planned,
                float(high[within].max(initial=0.0)), float(torques[within].max(initial=0.0)),
                tuple(f.tolist()), tuple(off[0].tolist()), tuple(high.tolist()), tuple(torques.tolist()), settings,
            )
        )  # fmt: skip
    return tuple(made)


@dataclass(frozen=True)
class _Added:
    """A pulse, by its number among m of them, with what is added for it: f frequencies, k dynamometers.

    ``held`` (f,) turns the pulse to the middle of a sample, ``gains`` (f, k) are added by plan.
    """

    number: int
    at_cut: int
    m: int
    held: np.ndarray
    gains: np.ndarray

    def makes(self, of: np.ndarray, more: np.ndarray | float) -> np.ndarray:
        """Response (f,) at the cut, of responses (f, k, m + k), with ``more`` (f,) added to the machine there."""
        planned = of[:, self.at_cut, self.number] * self.held + (of[:, self.at_cut, self.m :] * self.gains).sum(axis=1)
        made: np.ndarray = planned + of[:, self.at_cut, self.m + self.at_cut] * more
        return made


def _off(made: np.ndarray, wanted: np.ndarray, settings: FollowedSettings) -> np.ndarray:
    """Relative deviation of amplitudes (f,), both for a pulse of 1 N·m."""
    off: np.ndarray = (np.abs(made) - np.abs(wanted)) / np.maximum(np.abs(wanted), settings.least)
    return off


def _up_to(f: np.ndarray, kept: np.ndarray) -> float | None:
    """The last frequency (f,) up to which all are kept; None without any."""
    count = len(kept) if kept.all() else int(np.argmin(kept))
    return float(f[count - 1]) if count else None


def _rigs(own: Case, values: Sequence[Mapping[str, float]]) -> list[SampledRig]:
    """Rigs with these values, from sample to sample, and their torques into the residual vehicle."""
    named = [f"torque_at_cut_{one.follows}" for one in own.loop.dynamometers]
    sensors = tuple(Sensor(name, "torque", one.follows) for name, one in zip(named, own.loop.dynamometers, strict=True))
    rig = replace(own.rig, sensors=(*own.rig.sensors, *sensors))
    into = np.array([own.residual_vehicle.cut_at(one.follows).factor for one in own.loop.dynamometers])
    of_rig = [
        {name.removeprefix("rig."): value for name, value in one.items() if name.startswith("rig.")} for one in values
    ]
    spaces = state_spaces(rig, of_rig)
    found = []
    for bed, space in zip(beds_of(own, values), spaces, strict=True):
        size, n = len(bed.sampled.whole), len(space.A)
        cuts = into[:, None] * np.stack([space.output(name) for name in named])
        wide = ((0, 0), (0, size - bed.readings.shape[1]))
        found.append(SampledRig(bed.sampled, np.pad(bed.readings, wide), np.pad(cuts, ((0, 0), (0, size - n)))))
    return found
