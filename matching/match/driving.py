"""One controller over its range of speeds, judged: about steady speeds, and in manoeuvres that cross the range."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from matching.match.beds import Judge, loop_figures, noise_of_sensors, planned, quantile
from matching.match.case import Case, Drive
from matching.match.coupled import controller_rows
from matching.match.demands import stresses
from matching.match.exported import exported_controller
from matching.match.findings import limited_quantity, with_unit
from matching.match.firing import FollowedPulse
from matching.match.imperfections import (
    Imperfection,
    bed_rows,
    count_angles,
    known_at_operating_point,
    sensor_gains,
    vehicle_rows,
    white_noise,
)
from matching.match.loop import compared_sensors, linear_bed, without_limits
from matching.match.loop_modes import neutral_motions
from matching.match.operating_range import RANGE, at_speed, at_vehicle_speed, body_speed, grid, law_over_speed
from matching.match.requirements import requirements
from matching.match.shifts import in_gears, with_live_clutches
from modelling.bed.profile import DrivenTorques, SpeedProfile
from modelling.bed.specimen import KNOWN
from modelling.controller.law import FAULTS, ExportedController
from modelling.errors import InputError, listed
from modelling.fidelity.over_range import parts_of, worst_part
from modelling.running.controllers import Schedule
from modelling.running.run import run
from modelling.running.sensors import SensorErrors
from modelling.simulation.stepping import SimulationError
from modelling.system import Sensor


@dataclass(frozen=True)
class DrivingSettings:
    """How a controller over speeds is judged.

    Attributes
    ----------
    drawn : int
        Beds drawn from the case's box, at every speed and in every drive.
    share : float
        Of the drawn beds that have to keep the tolerances; of twenty, one may miss them.
    planned, tolerance : float
        Error of a drive that is allowed of the bed as planned and of drawn ones: root mean square over the range of
        the vehicle's signal, of the worst compared sensor in the worst part of the drive.
    quiet : float
        Of the torque limit: rms of a command that noise may make at rest.
    hold : float
        s of speed hold before a drive.
    at_rest : float
        rad/s: an end at which the vehicle's sensors of speed move no more than this is at rest.
    judged_at_rest : float
        s at the end of a drive.
    steadily : float
        s for which a drawn drive keeps each of its speeds: what rings of the change before it dies out.
    gentlest : float
        Of the steepest change of speed of the case's own profiles: the least that a drawn drive has.
    followed : float
        m/s: a driver further from his profile is told; ±2 km/h is the tolerance of the WLTP's drivers.
    """

    drawn: int = 20
    share: float = 0.95
    planned: float = 0.03
    tolerance: float = 0.05
    quiet: float = 0.02
    hold: float = 3.0
    at_rest: float = 0.2
    judged_at_rest: float = 1.0
    steadily: float = 1.5
    gentlest: float = 0.6
    followed: float = 2 / 3.6


DRIVING = DrivingSettings()


# --- About steady speeds: between those of the grid, too.


@dataclass(frozen=True)
class AtSpeed:
    """The controller about one steady speed, m/s, linear; errors as in a match.

    ``stable`` and ``damped`` count the drawn beds, ``measured`` and ``unmeasured`` are errors of the bed as planned,
    their ``…_95`` of the drawn ones; margin, roll-off and noise (N·m rms, the largest) of the bed as planned.
    """

    vehicle_speed: float
    drawn: int
    stable: int
    damped: int
    least_damping_ratio: float
    measured: float
    unmeasured: float
    measured_95: float | None
    unmeasured_95: float | None
    modulus_margin: float
    largest_rolled_off: float
    command_noise: float
    missed: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """As ``result.json`` holds it."""
        return {**vars(self), "missed": list(self.missed)}


def at_speeds(case: Case, seed: int = 0, settings: DrivingSettings = DRIVING) -> tuple[AtSpeed, ...]:
    """The controller of a tuned case at the speeds of its grid and between them."""
    law, about = law_over_speed(case), case.operating_range
    assert about is not None
    rows = []
    for speed in grid(about, RANGE.further).tolist():
        own, radius = at_speed(case, speed), about.rolling_radius
        controller, required = without_limits(law.frozen(speed / radius)), requirements(own)
        judge = Judge(own, controller, neutral_motions(linear_bed(own)), required)
        values = [own.uncertainty.at(position) for position in own.uncertainty.draw(settings.drawn, seed)]
        found = judge.verdicts([{}, *values])
        figures = loop_figures(planned(own, noise_of_sensors(own, controller.sensors)), controller, required)
        noise = max(figures.command_noise.values())
        noisy = any(
            value > most for value, most in zip(figures.command_noise.values(), required.command_noise, strict=True)
        )
        stable, slips = found.stable[1:], np.array(True)
        if law.slipping is not None:
            slipping = without_limits(law.frozen(speed / radius, slipping=True))
            slips = Judge(own, slipping, neutral_motions(linear_bed(own)), required).verdicts([{}, *values]).stable
        missed = [
            words for words, wrong in (
                ("beds that are not stable", not found.stable.all()),
                ("beds that are not stable while the emulated clutch slips", not slips.all()),
                ("beds damped too little", not found.damped.all()),
                ("the modulus margin", figures.modulus_margin < required.modulus_margin),
                ("the roll-off", figures.largest_rolled_off > required.rolled_off),
                ("the command noise", noisy),
                ("the error to measured torques", found.measured[0] > case.tolerance),
                ("the error to unmeasured torques", found.unmeasured[0] > case.unmeasured_tolerance),
            ) if wrong
        ]  # fmt: skip
        rows.append(
            AtSpeed(
                speed, len(values), int(stable.sum()), int((stable & found.damped[1:]).sum()),
                float(found.damping_ratio.min()), float(found.measured[0]), float(found.unmeasured[0]),
                quantile(found.measured[1:][stable].tolist(), 0.95),
                quantile(found.unmeasured[1:][stable].tolist(), 0.95), figures.modulus_margin,
                figures.largest_rolled_off, noise, tuple(missed),
            )
        )  # fmt: skip
    return tuple(rows)


# --- In time: drives on nonlinear beds with poor sensors, beside the nonlinear vehicle with the same specimen.


@dataclass(frozen=True)
class DriveErrors:
    """One controller in one drive, errors over the range of the vehicle's signals.

    Attributes
    ----------
    planned : float or None
        Of the bed as planned, the worst sensor; None where emulation ended by itself or the bed ran away.
    median, high : float or None
        Of the drawn beds that stayed in emulation: median, and what 95 % of all drawn beds keep; None where fewer stay.
    drawn, stayed : int
    fault : str
        What ended the emulation first, in words.
    quiet : float or None
        N·m rms of a command at the end, where the vehicle is at rest there.
    largest_deviation : float or None
        N·m, largest deviation of a compared torque on the bed as planned; None without one, or where emulation ended.
    """

    planned: float | None
    median: float | None
    high: float | None
    drawn: int
    stayed: int
    fault: str = ""
    quiet: float | None = None
    largest_deviation: float | None = None


@dataclass(frozen=True)
class DriveResult:
    """A drive under the controller of the range, and, on the bed as planned alone, under that of one speed.

    ``traces``: time (t,), then by sensor (t,) of vehicle, bed, and bed under the controller of one speed. ``torques``:
    of the bed as planned, torque (t,) of every shaft by its drawing, N·m, that of the steady motion included.
    ``held``: gearboxes that shift in it and that the controller's model holds in one gear.
    """

    title: str
    vehicle_speed: float
    seconds: float
    worst_sensor: str
    errors: DriveErrors
    one_speed: DriveErrors
    traces: tuple[np.ndarray, dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]]] = field(repr=False)
    torques: dict[str, np.ndarray] = field(repr=False, default_factory=dict)
    held: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """As ``result.json`` holds it."""
        return {
            "title": self.title, "vehicle_speed": self.vehicle_speed, "seconds": self.seconds,
            "worst_sensor": self.worst_sensor, "errors": vars(self.errors), "one_speed": vars(self.one_speed),
        }  # fmt: skip


@dataclass(frozen=True)
class _Played:
    """What one controller did: readings (t, y, b), commands (t, k, b), and what ended emulation (b,), 0 if nothing.

    ``torques``: of every shaft by its drawing (t,), of the bed as planned.
    """

    readings: np.ndarray
    commands: np.ndarray
    faults: np.ndarray
    torques: dict[str, np.ndarray] = field(default_factory=dict)


def _play(
    case: Case, controller: ExportedController, torques: dict[str, np.ndarray], rows: Sequence[Imperfection],
    sensors: Sequence[str], seed: int, settings: DrivingSettings, steps: float = 0.0,
) -> _Played:  # fmt: skip
    """A drive on imperfect beds of a case at its operating point: torques (t,) in N·m by input, less those there, and
    the ``sensors`` (y) of the rig that are kept; ``steps`` a second at least."""
    case, watched = _with_torques(case)
    loop, size, names = case.loop, len(rows), controller.law.sensors
    before = round(settings.hold / controller.law.sample_time)
    shape = size, len(names)
    errors = replace(
        SensorErrors.none(names, size), gain=sensor_gains(names, rows),
        noise=np.broadcast_to(white_noise(case, names), shape).copy(),
        count=np.broadcast_to(count_angles(case, names), shape).copy(), seed=seed,
    )  # fmt: skip
    plant = bed_rows(case, names, rows, errors, steps)
    waiting = {name: np.concatenate([np.full(before, torque[0]), torque]) for name, torque in torques.items()}
    count, trim = max(len(torque) for torque in waiting.values()), known_at_operating_point(case)
    known = {
        name: waiting.get(name, np.zeros(count)) + trim.get(name, 0.0)
        for name in controller.law.known if name not in plant.inputs or name in loop.measured
    }  # fmt: skip
    about = plant.beds.steady[[plant.beds.model.sensors.index(one.speed_sensor) for one in loop.dynamometers]]
    rows_of = controller_rows(
        case, controller, Schedule.held_first(before, count, about, plant.beds.trim), size
    )  # fmt: skip
    acting = {name: torque for name, torque in waiting.items() if name in plant.inputs}
    found = run(plant, rows_of, acting, known, samples=count, keep=[*sensors, *watched.values()])
    faults = np.where(found.lost & (found.fault == 0), FAULTS.index("not finite"), found.fault)
    steady = plant.beds.steady[[plant.beds.model.sensors.index(name) for name in sensors]]
    readings, within = np.split(found.readings[before:], [len(sensors)], axis=1)
    return _Played(
        readings - steady, found.commands[before:] - plant.beds.trim, faults,
        {shaft: within[:, i, 0] for i, shaft in enumerate(watched)},
    )  # fmt: skip


def _with_torques(case: Case) -> tuple[Case, dict[str, str]]:
    """The case with an exact sensor on every shaft by its drawing, and the names of these sensors by shaft."""
    watched = {shaft.name: f"torque_within_{shaft.name}" for shaft in case.rig.shafts if shaft.drawing is not None}
    sensors = (Sensor(name, "torque", shaft) for shaft, name in watched.items())
    return replace(case, rig=replace(case.rig, sensors=(*case.rig.sensors, *sensors))), watched


def vehicles_in(
    case: Case, torques: dict[str, np.ndarray], rows: Sequence[Imperfection], sensors: Sequence[str],
    steps: float = 0.0,
) -> np.ndarray:  # fmt: skip
    """Readings (t, y, b) of the nonlinear vehicles with the specimens of these beds; ``steps`` a second at least.

    Raises
    ------
    SimulationError
        If one grows out of bounds.
    """
    plant = vehicle_rows(case, rows, steps=steps)
    acting = {name: torque for name, torque in torques.items() if name in plant.inputs}
    found = run(plant, None, acting, samples=max(len(torque) for torque in torques.values()), keep=sensors)
    if found.lost.any():
        raise SimulationError("drives", "the vehicle's motion grows out of bounds", "check its parameters")
    return found.readings - plant.beds.steady[[plant.beds.model.sensors.index(name) for name in sensors]]


@dataclass(frozen=True)
class Driving:
    """What a controller over a range of speeds reaches.

    Attributes
    ----------
    lowest, highest : float
        m/s.
    designed_at : tuple of float
        m/s, the grid.
    speeds : tuple of AtSpeed
    drives : tuple of DriveResult
    one_speed : float
        m/s, of the controller beside it.
    not_run : str
        Why there are no drives; empty otherwise.
    pulses : tuple of FollowedPulse
        Of an engine beyond a cut.
    """

    lowest: float
    highest: float
    designed_at: tuple[float, ...]
    speeds: tuple[AtSpeed, ...]
    drives: tuple[DriveResult, ...]
    one_speed: float
    not_run: str = ""
    settings: DrivingSettings = DRIVING
    pulses: tuple[FollowedPulse, ...] = ()

    def sentences(self, torque_limit: float) -> list[str]:
        """What stands in the way, in sentences; the limit is the least of the dynamometers', N·m, or infinite."""
        said = []
        missing: dict[str, list[float]] = {}
        for one in self.speeds:
            for what in one.missed:
                missing.setdefault(what, []).append(3.6 * one.vehicle_speed)
        for what, where in missing.items():
            at = f"at {where[0]:.3g} km/h" if len(where) == 1 else f"between {min(where):.3g} and {max(where):.3g} km/h"
            said.append(
                f"over the range of speeds, {what} {'stand' if what.startswith('beds') else 'stands'} in the way {at}"
            )
        for drive in self.drives:
            said += _missed(drive, self.settings, torque_limit)
        if self.not_run:
            said.append(f"the drives were not run: {self.not_run}")
        return said

    def to_dict(self) -> dict[str, Any]:
        """As ``result.json`` holds it."""
        return {
            "vehicle_speed": [self.lowest, self.highest], "designed_at": list(self.designed_at),
            "speeds": [one.to_dict() for one in self.speeds], "drives": [one.to_dict() for one in self.drives],
            "one_speed": self.one_speed, "not_run": self.not_run,
            **({"pulses": [one.to_dict() for one in self.pulses]} if self.pulses else {}),
        }  # fmt: skip


def _missed(drive: DriveResult, settings: DrivingSettings, torque_limit: float) -> list[str]:
    errors, said = drive.errors, []
    if errors.fault:
        on = (
            "on the bed as planned"
            if errors.planned is None
            else f"on {errors.drawn - errors.stayed} of {errors.drawn} drawn beds"
        )
        why = f"; its model holds {listed(list(drive.held))} in one gear" if drive.held else ""
        said.append(f"{drive.title}: the controller leaves emulation {on} ({errors.fault}){why}")
    if errors.planned is not None and errors.planned > settings.planned:
        said.append(
            f"{drive.title}: {drive.worst_sensor.replace('_', ' ')} is off by {100 * errors.planned:.2g} % of its "
            f"range, {100 * settings.planned:g} % is allowed of the bed as planned"
        )
    if errors.high is not None and errors.high > settings.tolerance:
        said.append(
            f"{drive.title}: 95 % of the drawn beds are off by up to {100 * errors.high:.2g} % of the range, "
            f"{100 * settings.tolerance:g} % is allowed"
        )
    if errors.quiet is not None and errors.quiet > settings.quiet * torque_limit:
        said.append(
            f"{drive.title}: at rest the command keeps moving by {errors.quiet:.2g} N·m rms, "
            f"{settings.quiet * torque_limit:.3g} N·m ({100 * settings.quiet:g} % of the torque limit) is allowed"
        )
    return said


def not_followed(case: Case, settings: DrivingSettings = DRIVING) -> list[str]:
    """Sentences on drivers who cannot follow their profile: what is played is another drive then."""
    said = []
    for drive in case.operating_range.drives if case.operating_range is not None else ():
        torques = drive.torques
        if isinstance(torques, DrivenTorques) and torques.behind[0] > settings.followed:
            behind, at = torques.behind
            said.append(
                f"{drive.title}: the driver is up to {3.6 * behind:.3g} km/h off his profile, at {at:.3g} s; with more "
                f"than {torques.driver.largest:g} N·m (largest) or a gentler profile he follows it"
            )
    return said


def driving(case: Case, seed: int = 0, settings: DrivingSettings = DRIVING) -> Driving:
    """Judge the controller of a tuned case over its range."""
    about = case.operating_range
    assert about is not None
    one_speed = replace(case, operating_range=None)
    drives, not_run = [], ""
    try:
        controllers = exported_controller(case), exported_controller(one_speed)
        own = (*about.drives, *drawn_drives(case, seed, settings))
        drives = [_driven(case, drive, controllers, seed, settings) for drive in own]
    except (SimulationError, InputError) as fault:
        not_run = str(fault)
    return Driving(
        about.lowest, about.highest, tuple(grid(about).tolist()), at_speeds(case, seed, settings), tuple(drives),
        body_speed(case) * about.rolling_radius, not_run, settings,
    )  # fmt: skip


def drawn_drives(case: Case, seed: int = 0, settings: DrivingSettings = DRIVING) -> list[Drive]:
    """Drives that nobody chose: one begins at rest, or as slow as the range is, one ends braked; all pass every speed.

    They are driven by the driver of the case's first profile and change their speed as steeply as the case's profiles
    do; a case without a driver has none.
    """
    about = case.operating_range
    assert about is not None
    driven = [drive.torques for drive in about.drives if isinstance(drive.torques, DrivenTorques)]
    if not driven:
        return []
    slopes = np.concatenate([np.diff(one.profile.speed) / np.diff(one.profile.time) for one in driven])
    rise, fall = float(slopes.max()), float(-slopes.min())
    random, least, most = np.random.default_rng(seed), max(about.lowest, 0.0), about.highest

    def some(low: float, high: float) -> float:
        return least + random.uniform(low, high) * (most - least)

    drives = []
    for title, speeds in (
        ("drawn: away, and through the range", (least, some(0.9, 1.0), some(0.5, 0.7))),
        ("drawn: on the way, faster and slower", (some(0.2, 0.4), some(0.5, 0.8), some(0.3, 0.5))),
        ("drawn: braked", (some(0.5, 0.9), least, some(0.1, 0.2))),
    ):
        time, speed = [0.0, settings.steadily / 3], [speeds[0], speeds[0]]
        for wanted in speeds[1:]:
            steepest = (rise if wanted > speed[-1] else fall) * random.uniform(settings.gentlest, 1.0)
            if steepest > 0 and wanted != speed[-1]:
                time.append(time[-1] + abs(wanted - speed[-1]) / steepest)
                speed.append(wanted)
            time.append(time[-1] + settings.steadily)
            speed.append(speed[-1])
        profile = SpeedProfile(np.array(time), np.array(speed), np.zeros(len(time)))
        begin = at_vehicle_speed(driven[0].vehicle, case.rig, about, speeds[0])
        drives.append(Drive(title, speeds[0], replace(driven[0], profile=profile, vehicle=begin, given={})))
    return drives


def _driven(
    case: Case, drive: Drive, controllers: tuple[ExportedController, ExportedController], seed: int,
    settings: DrivingSettings,
) -> DriveResult:  # fmt: skip
    own, step = at_speed(in_gears(case, drive.gears), drive.vehicle_speed, held=False), case.loop["sample_time"]
    seconds = max(torque.duration for torque in drive.torques.values())
    time = np.arange(round(seconds / step) + 1) * step
    own, torques, steps = with_live_clutches(own, drive, time)
    box = own.uncertainty
    rows = [Imperfection(""), *(Imperfection("", box.at(position)) for position in box.draw(settings.drawn, seed))]
    sensors = compared_sensors(case)
    vehicle = vehicles_in(own, torques, rows, sensors, steps)
    played = [
        _play(own, controller, torques, on, sensors, seed, settings, steps)
        for controller, on in zip(controllers, (rows, rows[:1]), strict=True)  # beside it, only on the bed as planned
    ]
    driven, vehicles = list(torques.values()), (vehicle, vehicle[:, :, :1])
    compared = [_compared(own, driven, sensors, on, each, step) for on, each in zip(vehicles, played, strict=True)]
    errors, one_speed = (
        _errors(own, one, on, each, sensors, settings) for one, on, each in zip(compared, vehicles, played, strict=True)
    )
    worst = sensors[int(compared[0].by_sensor[:, 0].argmax())]
    traces = {
        name: (vehicle[:, i, 0], played[0].readings[:, i, 0], played[1].readings[:, i, 0])
        for i, name in enumerate(sensors)
    }
    return DriveResult(
        drive.title, drive.vehicle_speed, seconds, worst, errors, one_speed, (time, traces), played[0].torques,
        _held(case, drive),
    )  # fmt: skip


def _held(case: Case, drive: Drive) -> tuple[str, ...]:
    """Gearboxes that shift in a drive and that the controller's model holds in one gear."""
    emulated = () if case.gearboxes is None else case.gearboxes.emulated
    return tuple(name for name in drive.gears if name not in emulated) if case.loop.specimen == KNOWN else ()


def stresses_beyond(case: Case, drives: Sequence[DriveResult]) -> list[str]:
    """Sentences on shear stresses above the case's limits, of a drive of the case; the largest of each limit."""
    about = case.operating_range
    own = {drive.title for drive in about.drives} if about is not None else set[str]()
    worst: dict[str, tuple[float, str]] = {}
    for drive in (one for one in drives if one.title in own):
        for shaft in case.rig.shafts:
            if shaft.drawing is None or shaft.name not in drive.torques:
                continue
            for what, stress in stresses(shaft.drawing, drive.torques[shaft.name]).items():
                limit = f"shafts.{shaft.name}.{what}"
                worst[limit] = max(worst.get(limit, (0.0, "")), (stress, drive.title))
    return [
        f"{title}: the drive takes {limited_quantity(limit, '')} of {with_unit(limit, stress)}, "
        f"{with_unit(limit, case.limits[limit])} is the limit"
        for limit, (stress, title) in worst.items()
        if limit in case.limits and stress > case.limits[limit]
    ]


@dataclass(frozen=True)
class _Compared:
    """Errors over range of the worst part of a drive: of every sensor (y, b) and of the worst one (b,)."""

    by_sensor: np.ndarray
    worst: np.ndarray


def _compared(
    case: Case, torques: Sequence[np.ndarray], sensors: Sequence[str], vehicle: np.ndarray, played: _Played, step: float
) -> _Compared:  # fmt: skip
    measures = {sensor.name: sensor.measures for sensor in case.rig.sensors}
    found = worst_part(
        vehicle, played.readings, parts_of(torques, step), kinds=[measures[name] for name in sensors],
        uncertainty=noise_of_sensors(case, sensors).tolist(),
    )  # fmt: skip
    return _Compared(np.nan_to_num(found.error, nan=0.0, posinf=np.inf), found.largest)


def _errors(
    case: Case, compared: _Compared, vehicle: np.ndarray, played: _Played, sensors: Sequence[str],
    settings: DrivingSettings,
) -> DriveErrors:  # fmt: skip
    stayed = (played.faults == 0) & np.isfinite(compared.worst)
    worst = compared.worst
    drawn = worst[1:][stayed[1:]]
    allowed = len(worst[1:]) - int(np.floor(settings.share * (len(worst) - 1) + 1e-9))
    ranked = np.sort(np.where(stayed[1:], worst[1:], np.inf))
    high = float(ranked[len(ranked) - 1 - allowed]) if len(ranked) > allowed else np.inf
    last = round(settings.judged_at_rest / case.loop["sample_time"])
    kinds = {sensor.name: sensor.measures for sensor in case.rig.sensors}
    torques = [i for i, name in enumerate(sensors) if kinds[name] == "torque"]
    apart = np.abs(played.readings[:, torques, 0] - vehicle[:, torques, 0])
    rests = bool(np.ptp(vehicle[-last:, :, 0], axis=0).max() < settings.at_rest)
    quiet = float(np.std(played.commands[-last:], axis=0)[:, stayed].max(initial=0.0)) if rests else None
    first = played.faults[played.faults != 0]
    fault = FAULTS[int(first[0])] if len(first) else "" if stayed.all() else "an error that is not finite"
    return DriveErrors(
        float(worst[0]) if stayed[0] else None, float(np.median(drawn)) if len(drawn) else None,
        high if np.isfinite(high) else None, len(worst) - 1, int(stayed[1:].sum()), fault, quiet,
        float(apart.max()) if stayed[0] and apart.size else None,
    )  # fmt: skip
