"""The controller of a tuned case as it leaves the computer: law, limits, speed hold, the opened shafts it notices."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import numpy as np
import scipy
from scipy.linalg import null_space

from matching.match.beds import noise_of_sensors
from matching.match.box import of_system
from matching.match.case import Case, once_per_case
from matching.match.coupled import controller_rows, run_in_of
from matching.match.imperfections import DEMAND_FACTOR, DEMAND_LATE_S, count_angles
from matching.match.loop import (
    LinearBed,
    SampledController,
    assembled_bed,
    control_law,
    controller_of,
    disturbing,
    linear_bed,
    shaft_torque,
    torque_sign,
    without_limits,
)  # fmt: skip
from matching.match.operating_range import law_over_speed
from matching.match.requirements import requirements
from modelling.bed.bed import ControlLaw, delayed_bed, held, predicted_part
from modelling.bed.foreign_vehicle import ForeignVehicleLaw, VehicleTiming, foreign_vehicle_law
from modelling.bed.observer import sensor_noise
from modelling.bed.specimen import UNKNOWN
from modelling.bed.stepped import SteppedLaw
from modelling.controller.law import (
    CHECK_SPEED_SHARE,
    CHECK_TORQUE_SHARE,
    KEPT_SAMPLES,
    LIFE_S,
    MEAN_OF_OFF,
    MEAN_SHARE,
    NO_LIMIT,
    OPENED_SHARE,
    RIDE_THROUGH_S,
    UNDELIVERED_SHARE,
    WATCHED_SAMPLES,
    ExportedController,
    OpenedShaft,
    Settings,
    WatchedShafts,
    has_gone,
    hold_gains,
    nothing_watched,
)
from modelling.controller.tracking import DRAG, Rotors, Tracking
from modelling.equations.casadi_code import compiled
from modelling.errors import InputError
from modelling.linear.elements import elements
from modelling.linear.state_space import StateSpace, state_space
from modelling.linear.steady_motion import operating_motion, torques_of
from modelling.running.controllers import ControllerRows, Schedule
from modelling.running.plant import Vehicle
from modelling.running.vehicles import TimedVehicle
from modelling.system import Input, Sensor, System

# --- What readings of a linear bed under its controller are off from what the controller's model expects.

NOT_STEADY = 1e-9  # of the largest singular value of the balance of torques: states and inputs below it are steady
NOT_LOADED = 1e-3  # of the largest: a steady motion, or a shaft, that hardly loads the flanges


def on_inertia(inertia: str) -> str:
    """Name of the added input that acts on an inertia."""
    return f"torque_on_{inertia}"


@dataclass(frozen=True)
class BedEvents:
    """What happens on a bed, sample by sample; t samples, x states, w known torques, y readings, e events side by side.

    Attributes
    ----------
    torques : ndarray (t, x, e)
        What torques do to the states: columns of B times torques, held over a sample.
    known : ndarray (t, w, e)
        Torques as the controller knows them, N·m.
    errors : ndarray (t, y, e)
        Errors of the readings, SI.
    """

    torques: np.ndarray
    known: np.ndarray
    errors: np.ndarray


def no_events(bed: WatchedBed, samples: int, count: int) -> BedEvents:
    """So many events of which none has begun."""
    law = bed.law
    return BedEvents(*(np.zeros((samples, size, count)) for size in (len(bed.A), len(law.known), len(law.sensors))))


@dataclass(frozen=True)
class WatchedBed:
    """A rig with its lags as it may stand there, in deviations from a steady state; x states, k commands, y readings.

    Attributes
    ----------
    rig : System
    law : ControlLaw
    A, commands, readings : ndarray (x, x), (x, k), (y, x)
    inputs : mapping of str to ndarray (x,)
        Columns of B: every input of the rig, and a torque on every inertia as :func:`on_inertia` names it.
    shaft_torques : mapping of str to ndarray (x,)
        Rows: torque of every shaft, N·m, at its second end.
    measured_shafts : tuple of str (k)
        Whose torques the dynamometers' torque sensors read.
    delay : ndarray (k,)
        s, from a sample to the moment its command begins to act.
    """

    rig: System
    law: ControlLaw
    A: np.ndarray
    commands: np.ndarray
    readings: np.ndarray
    inputs: Mapping[str, np.ndarray]
    shaft_torques: Mapping[str, np.ndarray]
    measured_shafts: tuple[str, ...]
    delay: np.ndarray

    def torque_pair(self, shaft: str) -> np.ndarray:
        """What a torque of 1 N·m in a shaft does to the states (x,), at both its ends."""
        part = next(part for part in self.rig.shafts if part.name == shaft)
        first, second = (self.inputs[on_inertia(end)] for end in part.between)
        return second - first / (1.0 if part.ratio is None else part.ratio.value)

    def opening(self, shaft: str, samples: int) -> tuple[np.ndarray, np.ndarray]:
        """Deviations (t, y) from what is expected and readings (t, y) after a shaft that carried 1 N·m opened."""
        pair, events = self.torque_pair(shaft), no_events(self, samples, 1)
        events.torques[:, :, 0] = -pair
        opened = replace(self, A=self.A - np.outer(pair, self.shaft_torques[shaft]))
        off, read = opened.run(events)
        return off[:, :, 0], read[:, :, 0]

    def run(self, events: BedEvents) -> tuple[np.ndarray, np.ndarray]:
        """Deviations from what the controller expects and readings (t, y, e); no limits."""
        law, x = self.law, len(self.A)
        bed = delayed_bed(self.A, self.commands, np.eye(x), self.delay, law.sample_time)
        now, state = (
            np.zeros((len(bed.whole), events.torques.shape[2])),
            np.zeros((len(law.A), events.torques.shape[2])),
        )
        unlimited = np.array(np.inf)
        sent = [np.zeros((len(law.dynamometers), now.shape[1]))] * (bed.delay + 2)
        off, read = np.empty_like(events.errors), np.empty_like(events.errors)
        for n, (torques, known, errors) in enumerate(
            zip(events.torques, events.known, events.errors, strict=True)
        ):  # fmt: skip
            read[n] = self.readings @ now[:x] + errors
            off[n] = read[n] - law.E @ state
            newest, state = law.step(state, read[n], known, unlimited)
            sent = [newest, *sent[:-1]]
            now = bed.whole @ now + bed.new @ sent[bed.delay] + bed.old @ sent[bed.delay + 1] + bed.torques @ torques
        return off, read

    def carried(self, shafts: tuple[str, ...]) -> np.ndarray:
        """Torques (s, k) of shafts by flange torques of 1 N·m in steady motion, least squares over the inputs.

        The dynamometers' torque sensors are the first k readings.
        """
        torques = np.stack([self.shaft_torques[name] for name in shafts]) @ self._steady[: len(self.A)]
        carried: np.ndarray = torques @ self._of_flanges
        return np.where(np.abs(carried) > NOT_LOADED * np.abs(carried).max(initial=0.0), carried, 0.0)

    def balancing(self) -> dict[str, np.ndarray]:
        """Torques (k,) of every input of the rig, N·m, that flange torques of 1 N·m balance in steady motion."""
        rows = self._steady[len(self.A) :] @ self._of_flanges
        return {part.name: row for part, row in zip(self.rig.inputs, rows, strict=True)}

    @cached_property
    def _steady(self) -> np.ndarray:
        """Steady motions: states, then torques of the rig's inputs, of each (x + u, m)."""
        driven = np.stack([self.inputs[part.name] for part in self.rig.inputs], axis=1)
        balance = np.hstack([self.A, driven])  # no state changes
        steady: np.ndarray = null_space(balance / np.linalg.norm(balance, axis=1, keepdims=True), NOT_STEADY)
        return steady

    @cached_property
    def _of_flanges(self) -> np.ndarray:
        """How much of each steady motion (m, k) makes flange torques of 1 N·m."""
        flanges = self.readings[: self.commands.shape[1]] @ self._steady[: len(self.A)]
        inverse: np.ndarray = np.linalg.pinv(flanges, rcond=NOT_LOADED)
        return inverse


def watched_bed(case: Case, law: ControlLaw, values: Mapping[str, float]) -> WatchedBed:
    """The bed of a case with some ``values`` other than the case's, named as those that are uncertain."""
    dynamometers = case.loop.dynamometers
    rig = case.rig.with_values(of_system(values, case.rig))
    more = replace(
        rig,
        inputs=(*rig.inputs, *(Input(on_inertia(part.name), part.name) for part in rig.inertias)),
        sensors=(*rig.sensors, *(Sensor(shaft_torque(part.name), "torque", part.name) for part in rig.shafts)),
    )
    space = state_space(more)
    bed = assembled_bed(case, space, values)
    return WatchedBed(
        rig, law, bed.A, bed.commands, bed.readings[: len(law.sensors)],
        {name: np.pad(space.input(name), (0, case.loop.lag_states)) for name in space.inputs},
        {part.name: np.pad(space.output(shaft_torque(part.name)), (0, case.loop.lag_states)) for part in rig.shafts},
        tuple(sensor.of for dynamometer in dynamometers for sensor in rig.sensors
              if sensor.name == dynamometer.torque_sensor),
        bed.delay,
    )  # fmt: skip


# --- What moves a bed's readings where no shaft opens: noise, encoders, torques that step unmeasured or late, the road.

FOLLOWED_SAMPLES = 120  # of what a step or a wrong reading does: the observer has followed it then


@dataclass(frozen=True)
class Disturbances:
    """What moves the readings where no shaft opens: windows (i, WATCHED_SAMPLES · y) of deviations, newest first.

    ``noise``: independent parts with a standard deviation of 1; ``steps``: the largest torques at once, at each of
    ``count`` times and beds.
    """

    noise: np.ndarray
    steps: np.ndarray
    count: int


def disturbances(case: Case, beds: Sequence[WatchedBed], scale: float) -> Disturbances:
    """Noise of the bed as planned, and steps of torque on all of them."""
    noise = windows(beds[0].run(_wrong_readings(case, beds[0]))[0])
    steps = [windows(bed.run(_torque_steps(case, bed, scale))[0]) for bed in beds]
    size = noise.shape[-1]
    count = sum(len(of_bed) for of_bed in steps)
    return Disturbances(noise.reshape(-1, size), np.concatenate(steps).reshape(-1, size), count)


def windows(off: np.ndarray) -> np.ndarray:
    """Deviations (t, y, e) as (t − WATCHED_SAMPLES + 1, e, WATCHED_SAMPLES · y), the newest sample first."""
    count = len(off) - WATCHED_SAMPLES + 1
    shifted = [off[WATCHED_SAMPLES - 1 - i : WATCHED_SAMPLES - 1 - i + count] for i in range(WATCHED_SAMPLES)]
    return np.concatenate(shifted, axis=1).transpose(0, 2, 1)


def _wrong_readings(case: Case, bed: WatchedBed) -> BedEvents:
    """One wrong reading of every sensor: its noise, and what a count of an encoder does to two samples."""
    law, sensors = bed.law, {sensor.name: sensor for sensor in case.rig.sensors}
    of_law = [sensors[name] for name in law.sensors]
    events = no_events(bed, FOLLOWED_SAMPLES, 2 * len(of_law))
    # an angle that is even over a count
    counts = count_angles(case, law.sensors) / law.sample_time / np.sqrt(12.0)
    at = WATCHED_SAMPLES - 1
    for i, sensor in enumerate(of_law):
        events.errors[at, i, 2 * i] = sensor_noise(sensor, law.sample_time)
        if sensor.measures == "speed":
            events.errors[at : at + 2, i, 2 * i + 1] = counts[i], -counts[i]
    return events


def _torque_steps(case: Case, bed: WatchedBed, scale: float) -> BedEvents:
    """Every torque at once: those of the rig not measured, and measured but late and large; those of the road."""
    law = bed.law
    on_rig = disturbing(case)
    sizes = torque_sizes(case, bed, scale)
    steps = [(name, False) for name in on_rig] + [(name, True) for name in law.known]
    events, at = no_events(bed, FOLLOWED_SAMPLES, len(steps)), WATCHED_SAMPLES - 1
    for e, (name, known) in enumerate(steps):
        size, late = sizes[name], round(DEMAND_LATE_S / law.sample_time) if known else 0
        if name in on_rig:
            factor = DEMAND_FACTOR if known else 1.0
            events.torques[at + late :, :, e] = factor * size * bed.inputs[name]
        if known:
            events.known[at:, law.known.index(name), e] = size
    return events


def torque_sizes(case: Case, bed: WatchedBed, scale: float) -> dict[str, float]:
    """N·m by which each torque steps: over the manoeuvre, or what balances flange torques of ``scale``, if larger.

    A pedal steps over its whole way, 1.
    """
    balance = bed.balancing()
    sizes, pedals = {}, pedals_of(case)
    for name in (*balance, *bed.law.known):
        manoeuvre = case.manoeuvre.get(name)
        planned = 0.0 if manoeuvre is None else abs(manoeuvre.amplitude)
        sizes[name] = (
            1.0
            if name in pedals
            else max(planned, scale * float(np.abs(balance[name]).sum()) if name in balance else scale)
        )
    return sizes


def pedals_of(case: Case) -> set[str]:
    """Inputs of the rig and of the vehicle that are pedals."""
    return {*case.rig.pedals, *case.vehicle.pedals}


# --- Which shafts' opening the exported controller notices within five samples, by what, and from which torque on.
#
# The weights that estimate a lost torque are those of the least variance (a linearly constrained filter, Frost, 1972)
# over what else moves the readings: noise and encoders, torques at the rig's inputs that step unmeasured or late,
# torques of the road, on beds drawn from the box of the case. What these reach at most sets the torque from which on a
# shaft is judged.

DRAWN_BEDS = 8
NOISE_DEVIATIONS = 6.0  # standard deviations of the estimate that noise may reach
SHARES = 0.75, 1.33  # of the carried torque that an opened shaft has to seem to lose, on every drawn bed
SHARE_BEFORE = 0.62  # at least, a sample earlier: both samples have to pass the share that counts as opened
SHARE_WANTED = 0.75  # of it, where the filter of the least variance does not reach it
SMALLEST_JUDGED = 1.0  # of the torque that `lost_torque` at every flange is in a shaft: lash of 5° reached 0.7
CARRIED_S = 0.03  # for which a shaft has to have carried its torque: a lash is crossed and has struck within it
ROUNDING = 1e-9  # of a variance, added to it
LARGEST_LEAST = 0.5  # of the torque that a shaft carries at most: a rule that begins beyond it is of no use


@dataclass(frozen=True)
class OpenedShaftRule:
    """Watched shafts, the least torque (s,) in N·m from which on each is judged, and a row for every shaft."""

    watched: WatchedShafts
    least: np.ndarray
    rows: tuple[OpenedShaft, ...]


def opened_shaft_rule(case: Case, law: ControlLaw, lost_torque: np.ndarray) -> OpenedShaftRule:
    """Design the rule of a controller.

    Parameters
    ----------
    case : Case
    law : ControlLaw
    lost_torque : ndarray (k,)
        N·m: from this flange torque on the controller judges whether it is gone at once.
    """
    shafts = tuple(part.name for part in case.rig.shafts)
    if len(case.loop.flanges) < len(case.loop.dynamometers):
        without = tuple(OpenedShaft(shaft, "", None, "not every dynamometer has a torque flange") for shaft in shafts)
        return OpenedShaftRule(nothing_watched(len(law.sensors), len(law.dynamometers)), np.zeros(0), without)
    beds = [watched_bed(case, law, case.uncertainty.at(at)) for at in case.uncertainty.spread(DRAWN_BEDS)]
    carried = watched_bed(case, law, {}).carried(shafts)
    limit = case.limits_of("torque")
    limited = bool(np.isfinite(limit).all())
    scale = float(lost_torque.max()) if limited else 0.0
    what, unwatched = None, _why_nothing_is_watched(case, law)
    known = {part.name for part in predicted_part(case.rig, case.residual_vehicle, case.loop).system.shafts}
    rows, weights, least = [], [], []
    for shaft, of_flanges in zip(shafts, carried, strict=True):
        if limited and gone_at_once(beds, shaft, of_flanges):
            rows.append(OpenedShaft(shaft, "lost_torque", float(np.abs(of_flanges) @ lost_torque)))
            continue
        if unwatched or shaft not in known:
            why = unwatched or "it lies in the unknown specimen, where a clutch may open"
            rows.append(OpenedShaft(shaft, "", None, why))
            continue
        if what is None:
            what = disturbances(case, beds, scale)
        row, weights_of_shaft = _judged(beds, shaft, of_flanges, what, scale, np.minimum(limit, NO_LIMIT))
        rows.append(row)
        if weights_of_shaft is not None:
            weights.append((shaft, weights_of_shaft, of_flanges))
            least.append(row.from_torque)
    if not weights:
        return OpenedShaftRule(nothing_watched(len(law.sensors), len(law.dynamometers)), np.zeros(0), tuple(rows))
    names, lost, ratios = zip(*weights, strict=True)
    carried_samples = max(round(CARRIED_S / law.sample_time), 1)
    watched = WatchedShafts(names, np.array(lost), np.array(ratios), carried_samples)
    return OpenedShaftRule(watched, np.array(least), tuple(rows))


def _why_nothing_is_watched(case: Case, law: ControlLaw) -> str:
    """In words; empty where the controller can watch shafts."""
    if not law.L.any():
        return "the controller has no observer"
    kinds = {sensor.name: sensor.measures for sensor in case.rig.sensors}
    if not any(kinds[name] == "speed" for name in case.loop.further_sensors):
        return "the observer reads no speed but the dynamometers'"  # an unmeasured torque looks the same to it
    return ""


def _judged(
    beds: Sequence[WatchedBed], shaft: str, of_flanges: np.ndarray, what: Disturbances, scale: float, limit: np.ndarray
) -> tuple[OpenedShaft, np.ndarray | None]:
    """A shaft's row, and its weights where an opening can be told from everything else."""
    if not of_flanges.any():
        return OpenedShaft(shaft, "", None, "it carries no torque of the flanges in steady motion"), None
    signatures = np.stack([_openings(bed, shaft) for bed in beds])
    smallest = SMALLEST_JUDGED * float(np.abs(of_flanges).sum()) * scale
    weights = estimating(signatures, what, smallest)
    before, at_last = (signatures @ weights).T
    if before.min() < SHARE_BEFORE or at_last.min() < SHARES[0] or max(before.max(), at_last.max()) > SHARES[1]:
        words = "what its opening does to the readings differs too much over drawn beds"
        return OpenedShaft(shaft, "", None, words), None
    noise = float(np.sqrt(np.sum((what.noise @ weights) ** 2)))
    reached = float(np.abs(what.steps @ weights).max(initial=0.0)) + NOISE_DEVIATIONS * noise
    least, largest = max(reached / OPENED_SHARE, smallest), float(np.abs(of_flanges) @ limit)
    if least > LARGEST_LEAST * largest:
        words = (
            f"noise and torques that are not as measured look like {reached:.3g} N·m lost, and it carries "
            f"{largest:.3g} N·m at most"
        )
        return OpenedShaft(shaft, "", None, words), None
    return OpenedShaft(shaft, "opened_torque", float(f"{least:.3g}")), weights


def estimating(signatures: np.ndarray, what: Disturbances, carried: float) -> np.ndarray:
    """Weights (WATCHED_SAMPLES · y,) on deviations that estimate the torque that was lost, N·m.

    Parameters
    ----------
    signatures : ndarray (b, 2, WATCHED_SAMPLES · y)
        Deviations after 1 N·m was lost, one sample before the last watched one and at it, on every bed.
    what : Disturbances
    carried : float
        N·m for which the signatures' differences from bed to bed count.
    """
    mean = signatures.mean(axis=0)
    apart = carried * (signatures - mean).reshape(-1, mean.shape[1]) / np.sqrt(len(signatures))
    parts = np.vstack([what.noise, what.steps / np.sqrt(what.count), apart])
    covariance = parts.T @ parts
    covariance += ROUNDING * np.diag(np.diag(covariance))
    toward = np.linalg.solve(covariance, mean.T)
    gained = mean @ toward  # what each filter makes of each signature
    weights: np.ndarray = toward[:, 1] / gained[1, 1]
    if (signatures[:, 0] @ weights).min() < SHARE_BEFORE:
        weights = toward @ np.linalg.solve(gained, [SHARE_WANTED, 1.0])
    return weights


def _openings(bed: WatchedBed, shaft: str) -> np.ndarray:
    """Windows (2, WATCHED_SAMPLES · y) one sample before the last watched one, and at it."""
    off, _ = bed.opening(shaft, WATCHED_SAMPLES + 1)
    return windows(off[:, :, None])[-2:, 0]


def gone_at_once(beds: Sequence[WatchedBed], shaft: str, of_flanges: np.ndarray) -> bool:
    """Whether a flange torque is gone within WATCHED_SAMPLES after a shaft opened, on every bed.

    ``of_flanges`` (k,): torque in the shaft by flange torques.
    """
    return all(_gone_at_once(bed, shaft, of_flanges) for bed in beds)


def _gone_at_once(bed: WatchedBed, shaft: str, of_flanges: np.ndarray) -> bool:
    if not of_flanges.any():
        return False
    if shaft in bed.measured_shafts:
        return True
    before = of_flanges / (of_flanges @ of_flanges)  # of 1 N·m in the shaft
    _, read = bed.opening(shaft, WATCHED_SAMPLES + 1)
    torques = np.vstack([np.tile(before, (KEPT_SAMPLES, 1)), before + read[:, : len(of_flanges)]])
    least = 0.5 * np.abs(before)
    gone = False
    for n in range(KEPT_SAMPLES, len(torques)):
        gone |= bool(has_gone(torques[n - KEPT_SAMPLES : n + 1][::-1], least).any())
    return gone


# --- The controller of a match as it leaves the computer: law, limits, speed hold and watchdogs from the tuned case.

DETERMINED = 1e-6  # of a speed: what is left of it when other speeds are taken off
LOST_TORQUE = 0.2  # of the torque limit: what has to be on the flange before its loss counts
SURPRISE_HEADROOM = 2.0  # over that answer, for free play, friction and other beds: drives at 3 ms reached 1.1
UNDELIVERED_GAINS = 3.0  # times what a torque gain may be off: further off the delivered torque is a fault
# What is known of a dynamometer before it is tracked; wide, so that a minute of a drive decides.
PRIOR_GAIN, PRIOR_DELAY_S = 0.1, 0.005  # more trips as not delivered, or makes the loop swing
PRIOR_ZERO = 0.03  # of the rated torque: dry friction that a check of the channels allows
PRIOR_DRAG = 0.01  # of the rated torque at the largest speed: windage and bearings
PRIOR_TORQUE, PRIOR_SPEED = 1500.0, 125.0  # N·m and rad/s where the case limits none: a wheel dynamometer
# of the torque limit: temperature moves the zero of a usual torque flange by 0.05 % in 10 K, here 50 K
ZERO_DRIFT = 0.0025
LEAST_GAIN, LEAST_DELAY_S = 0.005, 1e-4  # a case that states less than can be calibrated or timed
# by kind of a sensor's effect: the parameter that multiplies its reading, and those that make it late
GAINS = {"sensor_gain": "factor"}
LATENESS = {"sensor_delay": "delay", "all_pass": "delay", "lag": "time_constant"}
UNEXPECTED_TORQUE = 0.4  # of the torque limit: how far a flange torque may be from what the controller expects


class HasTuned(Protocol):
    """A match's result, as far as it is needed here."""

    @property
    def tuned(self) -> Case:
        """The case with the tuned values."""


@once_per_case
def controller_on_the_bed(case: Case) -> SampledController:
    """The controller of a case as the bed runs it, of any structure, linear about the operating point.

    Over a range of speeds it is the exported one, whose vehicle drives beside its observer. Beside a vehicle of others,
    which linear models do not hold, it is that of one speed.
    """
    if case.operating_range is None or case.vehicle_in_the_loop is not None:
        return controller_of(case)
    return without_limits(exported_controller(case).law.linear)


def exported_controller(case: Case) -> ExportedController:
    """The controller of a tuned case: over its range of speeds where it has one."""
    parts = linear_bed(case)
    law = control_law(parts)
    dynamometers = case.loop.dynamometers
    torques = tuple(-1 if one.torque_sensor is None else law.sensors.index(one.torque_sensor) for one in dynamometers)
    speeds = tuple(law.sensors.index(dynamometer.speed_sensor) for dynamometer in dynamometers)
    units = {sensor.name: sensor.unit for sensor in case.rig.sensors}
    settings = _settings(parts, law, torques)
    rule = opened_shaft_rule(case, law, settings.lost_torque)
    return ExportedController(
        f"Controller: {case.title or case.path}",
        law if case.operating_range is None else law_over_speed(case),
        replace(settings, opened_torque=rule.least),
        tuple(units[name] for name in law.sensors),
        torques,
        speeds,
        rule.watched,
        rule.rows,
        speeds_by_others(case.rig, law.sensors, speeds),
        delivery=_rotors(case),
        tracking=_tracking(case),
        may_shift=case.loop.specimen == UNKNOWN,
        pedals=tuple(name for name in law.known if name in pedals_of(case)),
    )


def _rotors(case: Case) -> Rotors:
    """What tells the air-gap torques of a case's dynamometers by what is measured."""
    rig, loop = case.rig, case.loop
    inertia, drag, sign = (np.array([float(value)] * len(loop.dynamometers)) for value in (0, 0, 1))
    others = [name for one in rig.differentials for name in one.ends]
    others += [name for gear in rig.planetary_gears for name in gear.ends]
    others += [name for gear in rig.gears for name in gear.between]
    for j, one in enumerate(loop.dynamometers):
        rotor = next(part.on for part in rig.inputs if part.name == one.torque_input)
        shafts = [shaft.name for shaft in rig.shafts if rotor in shaft.between]
        measured = [sensor.of for sensor in rig.sensors if sensor.name == one.torque_sensor]
        speed = next(sensor.of for sensor in rig.sensors if sensor.name == one.speed_sensor)
        if one.torque_sensor is not None and shafts == measured and speed == rotor and rotor not in others:
            inertia[j] = rig.parameters[f"inertias.{rotor}.J"].value
            found = rig.parameters.get(f"inertias.{rotor}.drag")
            drag[j], sign[j] = 0.0 if found is None else found.value, torque_sign(rig, one)
        sign[j] /= _of_sensor(rig, one.torque_sensor, GAINS, 1.0)
    step = loop["sample_time"]
    of_flange, of_speed = (
        np.array([_of_sensor(rig, name, LATENESS, 0.0) for name in names])
        for names in ([one.torque_sensor for one in loop.dynamometers], [one.speed_sensor for one in loop.dynamometers])
    )
    read = loop.lags("torque_sensor_lag") + of_flange
    acts = loop.command_delays() + loop.lags("inverter_lag") + step / 2 + read
    # an encoder's speed is the mean of a sample, so its change is a sample old
    return Rotors(inertia, drag, sign, tuple((acts / step).tolist()), tuple(((step + of_speed - read) / step).tolist()))


def _of_sensor(rig: System, sensor: str | None, kinds: Mapping[str, str], without: float) -> float:
    """What the effects of some kinds at a sensor make together: factors multiplied, seconds added."""
    found = without
    for effect in rig.effects:
        if f"sensors.{sensor}" in effect.places and effect.kind in kinds:
            value = dict(effect.parameters)[kinds[effect.kind]].value
            found = found * value if kinds is GAINS else found + value
    return found


def _tracking(case: Case) -> Tracking:
    """From where on drifts are a warning: beyond the beds for which the match was proved."""
    loop, k = case.loop, len(case.loop.dynamometers)
    widths = {one.name: one.half_width / (abs(one.value) or 1.0) for one in case.uncertainty.uncertain}
    dead = next((one.half_width for one in case.uncertainty.uncertain if one.name == "loop.dead_time"), 0.0)
    lags = sum(widths.get(f"loop.{name}", 0.0) * loop.lags(name) for name in ("inverter_lag", "torque_sensor_lag"))
    gain = np.array([widths.get(f"dynamometers.{one.name}.torque_gain", 0.0) for one in loop.dynamometers])
    flange = np.array([widths.get(f"sensors.{one.torque_sensor}.gain", 0.0) for one in loop.dynamometers])
    torque = np.minimum(case.limits_of("torque"), NO_LIMIT)
    fastest = case.limits.get("dynamometer_speed", NO_LIMIT)
    rated = np.where(torque < NO_LIMIT, torque, PRIOR_TORQUE)
    prior = np.column_stack([
        np.full(k, PRIOR_GAIN), np.full(k, PRIOR_DELAY_S), PRIOR_ZERO * rated,
        PRIOR_DRAG * rated / (fastest if fastest < NO_LIMIT else PRIOR_SPEED),
    ])  # fmt: skip
    assert prior.shape[1] == DRAG + 1
    drift = np.column_stack([np.maximum(gain, LEAST_GAIN), np.full(k, max(dead, LEAST_DELAY_S)), ZERO_DRIFT * torque])
    most = np.column_stack([drift[:, 0] + flange, drift[:, 1] + lags])
    rotors = [part.on for one in loop.dynamometers for part in case.rig.inputs if part.name == one.torque_input]
    return Tracking(prior, most, drift, max(widths.get(f"rig.inertias.{rotor}.J", 0.0) for rotor in rotors))


def speeds_by_others(rig: System, sensors: Sequence[str], speeds: Sequence[int]) -> np.ndarray:
    """Speeds (k, y) of rotors by other readings of speeds where nothing twists; 0 where these do not determine them.

    Parameters
    ----------
    rig : System
    sensors : sequence of str (y)
    speeds : sequence of int (k)
        Which of them are the rotors' speeds.
    """
    model = compiled(rig)
    parts = elements(model, model.p0[None])
    twists = parts.spring_transformation.reshape(-1, model.n)
    together = null_space(twists) if len(twists) else np.eye(model.n)  # (n, m)
    masses = parts.mass_transformation.reshape(-1, model.n)
    of = {sensor.name: f"inertias.{sensor.of}" for sensor in rig.sensors if sensor.measures == "speed"}
    rows = {at: masses[parts.masses.index(of[name])] @ together for at, name in enumerate(sensors) if name in of}
    size = {at: float(np.linalg.norm(row)) for at, row in rows.items()}  # a fast shaft counts no more than a slow one
    found = np.zeros((len(speeds), len(sensors)))
    for j, at in enumerate(speeds):
        others = [number for number in rows if number != at]
        if not others:
            continue
        basis = np.stack([rows[number] / size[number] for number in others])
        weights = rows[at] @ np.linalg.pinv(basis)
        if np.allclose(weights @ basis, rows[at], atol=DETERMINED * np.abs(rows[at]).max()):
            weights = np.where(np.abs(weights) > DETERMINED * np.abs(weights).max(), weights, 0.0)
            found[j, others] = weights / [size[number] for number in others]
    return found


def _unexpected_speeds(case: Case, bed: WatchedBed, scale: float) -> np.ndarray:
    """How far each reading of a speed may be from what is expected (y,); other readings infinite.

    Two counts of an encoder, six standard deviations of its noise, and what a torque does in a sample that steps
    unmeasured: over the manoeuvre, or by what balances flange torques of ``scale`` (N·m), if larger.
    """
    law, step = bed.law, bed.law.sample_time
    sizes, sensors = torque_sizes(case, bed, scale), {sensor.name: sensor for sensor in case.rig.sensors}
    columns = np.stack([bed.inputs[part.name] * sizes[part.name] for part in case.rig.inputs], axis=1)
    _, moved = held(bed.A, columns, step)
    counts, found = count_angles(case, law.sensors), np.full(len(law.sensors), NO_LIMIT)
    for at, name in enumerate(law.sensors):
        if sensors[name].measures == "speed" and law.E[at].any():
            noise = sensor_noise(sensors[name], step)
            torque = float(np.abs(bed.readings[at] @ moved).max(initial=0.0))
            found[at] = 2 * counts[at] / step + NOISE_DEVIATIONS * noise + torque
    return found


def _surprised_by_torques(case: Case, bed: WatchedBed, scale: float) -> np.ndarray:
    """How far each reading has to be let off (y,), so that no torque that steps unmeasured, or late, ends an emulation.

    A law with a long dead time follows such a torque slowly, and what it expects stays off: this is its own answer on
    the bed as planned, at once and as a mean.
    """
    off, _ = bed.run(_torque_steps(case, bed, scale))
    means = scipy.signal.lfilter([1 / MEAN_OF_OFF], [1, 1 / MEAN_OF_OFF - 1], off, axis=0)
    needed: np.ndarray = np.maximum(np.abs(off), np.abs(means) / MEAN_SHARE).max(axis=(0, 2), initial=0.0)
    return SURPRISE_HEADROOM * needed


def _settings(parts: LinearBed, law: ControlLaw, torques: tuple[int, ...]) -> Settings:
    case, loop, k = parts.case, parts.case.loop, len(parts.case.loop.dynamometers)
    torque = np.minimum(case.limits_of("torque"), NO_LIMIT)
    speed = case.limits.get("dynamometer_speed", NO_LIMIT)
    bed, names, first = parts.bed, tuple(dynamometer.name for dynamometer in loop.dynamometers), len(loop.flanges)
    speeds = StateSpace(bed.A, bed.commands, bed.readings[first : first + k], np.zeros((k, k)), names, names)
    rotors = [
        next(part.on for part in case.rig.inputs if part.name == dynamometer.torque_input)
        for dynamometer in loop.dynamometers
    ]
    inertias = np.array([case.rig.parameters[f"inertias.{rotor}.J"].value for rotor in rotors])
    noise = noise_of_sensors(case, [one.speed_sensor for one in loop.dynamometers])
    allowed = np.array(requirements(case).command_noise)
    proportional, integral = hold_gains(
        speeds, inertias, float(loop.command_delays().max()) + loop["sample_time"] / 2,
        float(loop.lags("inverter_lag").max()), loop["sample_time"], allowed / noise,
    )  # fmt: skip
    unexpected = np.full(len(law.sensors), NO_LIMIT)
    for at, largest in zip(torques, torque, strict=True):
        if largest < NO_LIMIT and at >= 0 and law.E[at].any():  # without a model of the rig nothing is expected
            unexpected[at] = UNEXPECTED_TORQUE * largest
    limited = torque < NO_LIMIT
    if limited.all() and law.L.any():
        planned, scale = watched_bed(case, law, {}), UNEXPECTED_TORQUE * float(torque.max())
        unexpected = np.minimum(unexpected, _unexpected_speeds(case, planned, scale))
        unexpected = np.maximum(unexpected, _surprised_by_torques(case, planned, scale))
    watches = bool((unexpected < NO_LIMIT).any())
    step = law.sample_time
    off = [one.half_width / one.value for one in case.uncertainty.uncertain if one.name.endswith(".torque_gain")]
    return Settings(
        torque, np.full(k, speed), proportional, integral, np.where(limited, LOST_TORQUE * torque, NO_LIMIT),
        np.array([dynamometer.torque_gain for dynamometer in loop.dynamometers]), unexpected,
        np.full(k, case.limits.get("dynamometer_power", NO_LIMIT)), *_curve(case),
        np.where(limited, CHECK_TORQUE_SHARE * torque, NO_LIMIT),
        np.full(k, CHECK_SPEED_SHARE * speed if speed < NO_LIMIT else NO_LIMIT),
        undelivered_share=min(max(UNDELIVERED_SHARE, UNDELIVERED_GAINS * max(off, default=0.0)), 1.0),
        life_samples=max(round(LIFE_S / step), 2),
        ride_samples=max(round(RIDE_THROUGH_S / step), 1) if watches else 0,
    )  # fmt: skip


def _curve(case: Case) -> tuple[np.ndarray, np.ndarray]:
    """Speeds (p,), rad/s, and largest torques (p,), N·m, of the case's curve; one point without any limit else."""
    curve = case.torque_curve
    if curve is None:
        return np.zeros(1), np.full(1, NO_LIMIT)
    return np.array(curve.speeds), np.array(curve.torques)


def controller(
    case: Case | HasTuned, hold: float = 3.0, rows: int = 1, vehicle: Vehicle | None = None
) -> ControllerRows:  # fmt: skip
    """The controller of a tuned case or a match's result as rows for :func:`modelling.running.run.run`.

    Parameters
    ----------
    case : Case or MatchResult
    hold : float
        s of speed hold at the operating point, or at rest, before the emulation begins.
    rows : int
        On how many beds.
    vehicle : Vehicle, optional
        A simulator of your own behind the cuts, of so many rows, one step a sample; the case then needs
        ``[operating_range]``, and its vehicle is the design vehicle. One with ``[vehicle_in_the_loop]`` brings its own.

    Raises
    ------
    InputError
        If a vehicle is given and the case has no range, or the vehicle has other cuts or another number of rows.
    """
    tuned = case if isinstance(case, Case) else case.tuned
    made, loop = exported_controller(tuned), tuned.loop
    law = made.law
    if vehicle is not None:
        cuts = tuple(one.name for one in loop.dynamometers)
        if not isinstance(law, SteppedLaw):
            raise InputError("vehicle", "is for a case with [operating_range]", "a vehicle that drives has a range")
        if tuple(vehicle.cuts) != cuts or vehicle.count != rows:
            raise InputError(
                "vehicle", f"has cuts {list(vehicle.cuts)} and {vehicle.count} rows",
                f"the case has {list(cuts)}, and rows = {rows}",
            )  # fmt: skip
        if not isinstance(law, ForeignVehicleLaw):
            law = foreign_vehicle_law(law, VehicleTiming(), run_in_of(tuned, VehicleTiming()))
            made = replace(made, law=law)
    before, trim, turning = max(round(hold / made.law.sample_time), 1), torques_of(tuned.rig), compiled(tuned.rig)
    about = operating_motion(tuned.rig)
    steady = turning.readings(about.state, about.inputs, turning.p0, 0.0).full()
    speeds = np.array([steady[turning.sensors.index(one.speed_sensor)] for one in loop.dynamometers])
    added = np.array([[trim[one.torque_input]] for one in loop.dynamometers])
    schedule = Schedule.held_first(before, before + 1, speeds, added)
    if vehicle is None or not isinstance(law, ForeignVehicleLaw):
        return controller_rows(tuned, made, schedule, rows)
    return ControllerRows(made, schedule, rows, TimedVehicle(vehicle, law.timing, law.sample_time))
