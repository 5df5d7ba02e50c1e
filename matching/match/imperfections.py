"""Beds that are not the model that their controller was designed with: what differs, and rows of such beds in time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from matching.match.beds import noise_of_sensors
from matching.match.box import of_system
from matching.match.case import Case
from matching.match.coupled import controller_rows, run_in_of
from matching.match.loop import interface_speed, shaft_torque
from modelling.bed.nonlinear import BedHardware, NonlinearBeds
from modelling.bed.vehicle import specimen_of
from modelling.controller.law import ExportedController
from modelling.effects import EFFECTS
from modelling.effects.effect import Kind
from modelling.linear.steady_motion import torques_of
from modelling.running.beds import BedRows
from modelling.running.controllers import Schedule
from modelling.running.run import Motion, run
from modelling.running.sensors import NEVER, SensorErrors
from modelling.running.vehicles import SpecimenAndVehicle
from modelling.simulation.stepping import SimulationError
from modelling.system import Effect, Quantity, Sensor, System, mirror_image

# --- In what a bed differs from the model that its controller was designed with.

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
        Quantities that are not as planned, SI, named as :class:`matching.match.box.Uncertain`.
    gap, friction : float
        Lash (rad) of every shaft that the cut runs through, dry friction (N·m) of the inertias on the bed's side of
        these. Shafts with lash of their own, and inertias with friction, keep it.
    demand_factor, demand_late : float
        Measured or demanded torques act with this factor, and so much later (s), than the controller assumes.
    poor_sensors : bool
        Noise of the sensors' uncertainty, zeros of torques that move as the manoeuvre begins, encoders for speeds.
    encoders : bool
        Encoders for speeds alone, without noise and offset.
    """

    words: str
    values: Mapping[str, float] = field(default_factory=dict)
    gap: float = 0.0
    friction: float = 0.0
    demand_factor: float = 1.0
    demand_late: float = 0.0
    poor_sensors: bool = False
    encoders: bool = False


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


def perturbed_system(system: System, imperfection: Imperfection, case: Case) -> System:
    """Rig or vehicle with what is wrong of the parts that it has: shared components are wrong in both alike."""
    values = of_system(imperfection.values, system)
    effects = []
    with_play = {effect.at for effect in system.effects if effect.law.free_play}
    rubbing = {effect.at for effect in system.effects if effect.law.sticks}
    for interface in case.residual_vehicle.interfaces:
        place = f"shafts.{interface.shaft}"
        if imperfection.gap and place not in with_play:
            effects.append(_effect(LASH, place, imperfection.gap))
        shaft = next(part for part in case.vehicle.shafts if part.name == interface.shaft)
        near = next(end for end in shaft.between if end != interface.vehicle_end)
        place = f"inertias.{near}"
        if place not in rubbing:  # of no torque too, so that beds with and without it have the same equations
            rubbing.add(place)
            effects.append(_effect(FRICTION, place, imperfection.friction))
    return system.with_values(values).with_effects(*effects)


def _effect(law: Kind, place: str, size: float) -> Effect:
    return Effect(law.kind, place, tuple((name, Quantity(size)) for name in required_parameters(law)))


# --- Rows of beds and vehicles in time; b rows, t samples.

ANGLE_OF_A_COUNT = 2 * np.pi / 8192  # rad, of an encoder that does not state its counts
OFFSET_IN_UNCERTAINTIES = 2.0  # of a torque sensor, one way or the other


@dataclass(frozen=True)
class BedRun:
    """What is simulated.

    Attributes
    ----------
    imperfection : Imperfection
    torques : mapping of str to ndarray (t,)
        N·m by input, as demanded, one value a sample, counted from the operating point.
    known : tuple of str
        Inputs of the rig whose torque the controller knows; it always knows those of the residual vehicle.
    """

    imperfection: Imperfection
    torques: Mapping[str, np.ndarray] = field(repr=False)
    known: tuple[str, ...] = ()


def acting(case: Case, run: BedRun) -> dict[str, np.ndarray]:
    """Torques (t,) that act, N·m by input: those of the rig are not what was demanded."""
    on_rig, wrong = {part.name for part in case.rig.inputs}, run.imperfection
    time = np.arange(len(next(iter(run.torques.values())))) * case.loop["sample_time"]
    return {
        name: wrong.demand_factor * np.interp(time - wrong.demand_late, time, torque) if name in on_rig else torque
        for name, torque in run.torques.items()
    }


def hardware(case: Case, imperfection: Imperfection) -> BedHardware:
    """Lags, delay and torque gains of an imperfect bed."""
    values, loop = imperfection.values, case.loop
    return BedHardware(
        tuple(loop.lags("inverter_lag", values.get("loop.inverter_lag")).tolist()),
        tuple(loop.lags("torque_sensor_lag", values.get("loop.torque_sensor_lag")).tolist()),
        tuple(loop.command_delays(values.get("loop.dead_time")).tolist()),
        tuple(values.get(f"dynamometers.{dynamometer.name}.torque_gain", 1.0) for dynamometer in loop.dynamometers),
    )


def with_cut_torques(case: Case) -> tuple[Case, list[str]]:
    """The case with a sensor of the torque at each cut in vehicle and rig, and their names: models may have none."""
    made, torques, _ = with_cut_sensors(case)
    return made, torques


def with_cut_sensors(case: Case) -> tuple[Case, list[str], list[str]]:
    """The case with sensors of torque and speed at each cut, and their names; of the speed on either side its own."""
    cuts = case.residual_vehicle.interfaces
    torques, speeds = [shaft_torque(cut.shaft) for cut in cuts], [interface_speed(cut.shaft) for cut in cuts]

    def of(ends: Sequence[str]) -> list[Sensor]:
        at_cuts = [Sensor(name, "torque", cut.shaft) for name, cut in zip(torques, cuts, strict=True)]
        return at_cuts + [Sensor(name, "speed", end) for name, end in zip(speeds, ends, strict=True)]

    vehicle = _with_sensors(case.vehicle, of([cut.vehicle_end for cut in cuts]))
    rig = _with_sensors(case.rig, of([cut.rig_end for cut in cuts]))
    return replace(case, vehicle=vehicle, rig=rig), torques, speeds


def _with_sensors(system: System, sensors: Sequence[Sensor]) -> System:
    there = {sensor.name for sensor in system.sensors}
    return replace(system, sensors=(*system.sensors, *(each for each in sensors if each.name not in there)))


def vehicle_rows(
    case: Case, rows: Sequence[Imperfection], pushes: Sequence[str] = (), steps: float = 0.0
) -> BedRows | SpecimenAndVehicle:  # fmt: skip
    """Nonlinear vehicles with the specimens of these beds; the vehicle of others behind them where the case has one.

    ``pushes`` (k) are inputs that act at the cuts beside the shafts; with a vehicle of rigmatch's own it has them.
    ``steps`` as :class:`modelling.bed.nonlinear.NonlinearBeds` has it.
    """
    vehicles, others = [perturbed_system(case.vehicle, row, case) for row in rows], case.vehicle_in_the_loop
    if others is None:
        emulated = () if case.gearboxes is None else case.gearboxes.emulated
        return BedRows(NonlinearBeds(vehicles, case.loop, steps=steps, sticking=emulated))
    residual, loop = case.residual_vehicle, case.loop
    specimens = [specimen_of(replace(residual, vehicle=vehicle)) for vehicle in vehicles]
    cuts = [residual.cut_at(one.follows) for one in loop.dynamometers]
    started, ends = others.started(run_in_of(case), len(rows)), [cut.vehicle_end for cut in cuts]
    return SpecimenAndVehicle(
        BedRows(NonlinearBeds(specimens, loop, steps=steps)), started, ends,
        others.timing(loop["sample_time"]).steps, pushes,
    )  # fmt: skip


def bed_rows(
    case: Case, sensors: Sequence[str], rows: Sequence[Imperfection], errors: SensorErrors | None = None,
    steps: float = 0.0,
) -> BedRows:  # fmt: skip
    """Nonlinear beds with lags and dead time, whose ``sensors`` a controller reads; ``steps`` as of the vehicles."""
    loop = case.loop
    beds = NonlinearBeds(
        [perturbed_system(case.rig, row, case) for row in rows], loop, loop.dynamometers,
        [hardware(case, row) for row in rows], steps,
    )  # fmt: skip
    return BedRows(beds, sensors, errors)


def bed(case: Case, drawn: int = 0, seed: int = 0) -> BedRows:
    """The bed of a case as planned, then ``drawn`` ones from its box, as rows for :func:`modelling.running.run.run`.

    Of a match's result give ``result.tuned``. Their sensors are those of the rig file, exact but for the lag of torque
    flanges.
    """
    rows = [Imperfection(""), *(Imperfection("", case.uncertainty.at(at)) for at in case.uncertainty.draw(drawn, seed))]
    return bed_rows(case, [sensor.name for sensor in case.rig.sensors], rows if drawn else rows[:1])


def white_noise(case: Case, sensors: Sequence[str]) -> np.ndarray:
    """Standard deviation (s,) of what is white of it, SI: of an encoder that states its counts, none but what is stated
    in addition."""
    by_name = {sensor.name: sensor for sensor in case.rig.sensors}
    every = [by_name[name] for name in sensors]
    whole = noise_of_sensors(case, sensors)
    return np.array([u if one.counts is None else one.uncertainty or 0.0 for one, u in zip(every, whole, strict=True)])


def count_angles(case: Case, sensors: Sequence[str]) -> np.ndarray:
    """Angle (s,) of one count of an encoder, rad; 0 of a sensor that measures no speed."""
    by_name = {sensor.name: sensor for sensor in case.rig.sensors}
    every = [by_name[name] for name in sensors]
    return np.array([
        0.0 if one.measures != "speed" else ANGLE_OF_A_COUNT if one.counts is None else 2 * np.pi / one.counts
        for one in every
    ])  # fmt: skip


def are_speeds(case: Case, sensors: Sequence[str]) -> np.ndarray:
    """Which sensors of the rig (s,) measure speeds, bool."""
    by_name = {sensor.name: sensor for sensor in case.rig.sensors}
    return np.array([by_name[name].measures == "speed" for name in sensors])


def sensor_gains(sensors: Sequence[str], rows: Sequence[Imperfection]) -> np.ndarray:
    """Reading over true value (b, s)."""
    return np.array([[row.values.get(f"sensors.{name}.gain", 1.0) for name in sensors] for row in rows])


def poor_sensors(
    case: Case, sensors: Sequence[str], rows: Sequence[Imperfection], seed: int, begun: int
) -> SensorErrors:  # fmt: skip
    """Sensors of these rows: poor ones, encoders alone, or exact ones.

    All that is wrong of them begins at sample ``begun``, with the emulation: what noise of a speed hold makes of the
    begin is judged by :mod:`matching.match.minutes`.
    """
    u, speeds = noise_of_sensors(case, sensors), are_speeds(case, sensors)
    poor = np.array([row.poor_sensors for row in rows])[:, None]
    counting = poor | np.array([row.encoders for row in rows])[:, None]
    sides = np.random.default_rng(seed).choice([-1.0, 1.0], len(sensors))
    shape = len(rows), len(sensors)
    return SensorErrors(
        tuple(sensors), sensor_gains(sensors, rows), np.zeros(shape),
        poor * np.where(speeds, 0.0, OFFSET_IN_UNCERTAINTIES * sides * u),
        np.broadcast_to(poor * white_noise(case, sensors), shape).copy(),
        np.where(counting, count_angles(case, sensors), 0.0), np.full((2, *shape), NEVER, dtype=np.int64), begun, 0,
        begun, seed,
    )  # fmt: skip


def vehicle_motions(case: Case, runs: Sequence[BedRun], sensors: Sequence[str]) -> list[np.ndarray]:
    """Readings (t, y) of the nonlinear vehicle with the specimen of every bed, less those of the operating point.

    Raises
    ------
    SimulationError
        If one grows out of bounds.
    """
    plant = vehicle_rows(case, [each.imperfection for each in runs])
    found = run(plant, None, _of_rows([acting(case, each) for each in runs], plant.inputs), keep=sensors)
    if found.lost.any():
        raise SimulationError("simulation", "the motion of the vehicle grows out of bounds", "check its parameters")
    steady = plant.beds.steady[[plant.beds.model.sensors.index(name) for name in sensors]]
    return [found.readings[:, :, i] - steady[:, i] for i in range(len(runs))]


@dataclass(frozen=True)
class BedMotion:
    """Readings (t, y) of the chosen sensors and commands (t, k), less their values at the operating point."""

    readings: np.ndarray = field(repr=False)
    commands: np.ndarray = field(repr=False)


HOLD_S = 0.5  # of speed hold at the operating point before a run, of which an emulation's means are taken


def bed_motions(
    case: Case, controller: ExportedController, runs: Sequence[BedRun], sensors: Sequence[str], seed: int = 0,
    hold: float = HOLD_S,
) -> list[BedMotion | None]:  # fmt: skip
    """The beds under the exported controller; None for those whose motion grows out of bounds.

    All runs have imperfections of one structure: lash or none. ``seed`` is that of the sensors' noise, ``hold`` (s)
    the speed hold before emulation begins.
    """
    found, plant, before = emulated(case, controller, runs, sensors, seed, hold)
    steady = plant.beds.steady[[plant.beds.model.sensors.index(name) for name in sensors]]
    return [
        None if lost else BedMotion(
            found.readings[before:, :, i] - steady[:, i], found.commands[before:, :, i] - plant.beds.trim[:, i]
        )
        for i, lost in enumerate(found.lost)
    ]  # fmt: skip


def emulated(
    case: Case, controller: ExportedController, runs: Sequence[BedRun], sensors: Sequence[str], seed: int = 0,
    hold: float = HOLD_S,
) -> tuple[Motion, BedRows, int]:  # fmt: skip
    """The motion of :func:`bed_motions` with its speed hold, the rows, and how many samples they are held."""
    rows, loop = [each.imperfection for each in runs], case.loop
    before = max(round(hold / controller.law.sample_time), 1)
    errors = poor_sensors(case, controller.law.sensors, rows, seed, before)
    plant = bed_rows(case, controller.law.sensors, rows, errors)
    on_rig, trim = {part.name for part in case.rig.inputs}, known_at_operating_point(case)
    drives, told = [], []
    for each in runs:
        drives.append({name: _waiting(torque, before) for name, torque in acting(case, each).items()})
        told.append({
            name: _waiting(torque, before) for name, torque in each.torques.items()
            if name not in on_rig or name in each.known
        })  # fmt: skip
    known = _of_rows(told, controller.law.known)
    count = before + max(len(torque) for each in runs for torque in each.torques.values())
    known = {name: known.get(name, np.zeros(count)) + trim.get(name, 0.0) for name in controller.law.known}
    speeds = [plant.beds.model.sensors.index(one.speed_sensor) for one in loop.dynamometers]
    schedule = Schedule.held_first(before, count, plant.beds.steady[speeds], plant.beds.trim)
    rows_of = controller_rows(case, controller, schedule, len(runs))
    return run(plant, rows_of, _of_rows(drives, plant.inputs), known, samples=count, keep=sensors), plant, before


def known_at_operating_point(case: Case) -> dict[str, float]:
    """Torques of vehicle and rig at the operating point by input, N·m; clutches beyond the cut are closed."""
    return {**case.closed_clutches, **torques_of(case.vehicle), **torques_of(case.rig)}


def _waiting(torque: np.ndarray, before: int) -> np.ndarray:
    """A torque (t,) that has its first value for so many samples before."""
    return np.concatenate([np.full(before, torque[0]), torque])


def _of_rows(torques: Sequence[Mapping[str, np.ndarray]], names: Sequence[str]) -> dict[str, np.ndarray]:
    """Torques (t, b) by name of rows with torques (t,); 0 where a row has none."""
    made = {}
    for name in names:
        given = [each.get(name) for each in torques]
        if any(each is not None for each in given):
            count = max(len(each) for each in given if each is not None)
            made[name] = np.stack([np.zeros(count) if each is None else each for each in given], axis=1)
    return made
