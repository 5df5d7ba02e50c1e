"""The tuned controller as it runs, on beds that are not the model, next to the nonlinear vehicle."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from matching.match.box import of_system
from matching.match.case import Case
from matching.match.loop import control_law, linear_bed, shaft_torque
from matching.match.running import RunningLaw, stacked
from matching.match.running import run as run_batch
from matching.match.verify import manoeuvre_torques
from modelling.bed.bed import ControlLaw
from modelling.bed.nonlinear import BedHardware, NonlinearBeds
from modelling.bed.observer import NOISE
from modelling.effects import EFFECTS
from modelling.effects.effect import Kind
from modelling.errors import NoDesign
from modelling.linear.steady_motion import torques_of
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
        Noise and an offset of the sensors' uncertainty, encoders for speeds.
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


# --- What poor sensors make of the true signals: noise, offset, encoders that count.

ANGLE_OF_A_COUNT = 2 * np.pi / 8192  # rad, of an encoder
OFFSET_IN_UNCERTAINTIES = 2.0  # of a torque sensor, one way or the other


class PoorSensors:
    """Sensors of the beds that have poor ones; y sensors, b beds.

    Torques get noise and an offset. Speeds are differences of counts: the angle is known to a count at every sample,
    and noise of the sensor's uncertainty is added. A mean over a sample is half a sample late: that belongs to the
    dead time.

    Parameters
    ----------
    sensors : sequence of Sensor (y)
    poor, encoders : ndarray of bool (b,)
        Which beds have poor sensors, and which count alone, without noise and offset.
    gains : ndarray (y, b)
        Reading over what is measured, of every bed.
    step : float
        s, one sample.
    seed : int
        Of noise and signs.
    """

    def __init__(
        self, sensors: list[Sensor], poor: np.ndarray, gains: np.ndarray, step: float, seed: int,
        encoders: np.ndarray | None = None,
    ):  # fmt: skip
        self._random = np.random.default_rng(seed)
        self._poor, self._gains, self._step = poor, gains, step
        self._counting = poor if encoders is None else poor | encoders
        self._noise = np.array([sensor.uncertainty or NOISE[sensor.measures] for sensor in sensors])[:, None]
        self._counts = np.array([sensor.measures == "speed" for sensor in sensors])
        sides = self._random.choice([-1.0, 1.0], self._noise.shape)
        self._offset = np.where(self._counts[:, None], 0.0, OFFSET_IN_UNCERTAINTIES * sides * self._noise)
        self._angle, self._last, self._rest = np.zeros(gains.shape), np.zeros(gains.shape), np.zeros(gains.shape)

    def read(self, true: np.ndarray) -> np.ndarray:
        """Readings (y, b) of the true values (y, b), one sample after the other."""
        exact = self._gains * true
        if not self._counting.any():
            return exact
        self._angle, self._last = self._angle + self._step * (self._last + true) / 2, true
        rest = self._angle % ANGLE_OF_A_COUNT
        counting = np.where(self._counts[:, None] & self._counting, (self._rest - rest) / self._step, 0.0)
        self._rest = rest
        noise = self._noise * self._random.standard_normal((len(true), 1))
        read: np.ndarray = exact + counting + np.where(self._poor, self._offset + noise, 0.0)
        return read


# --- The control law on imperfect beds, sample by sample, and the vehicle under the same torques; b beds, t samples.


@dataclass(frozen=True)
class BedRun:
    """What is simulated.

    Attributes
    ----------
    imperfection : Imperfection
    torques : mapping of str to ndarray (t,)
        N·m by input, as demanded, one value a sample.
    known : tuple of str
        Inputs of the rig whose torque the controller knows; it always knows those of the residual vehicle.
    """

    imperfection: Imperfection
    torques: Mapping[str, np.ndarray] = field(repr=False)
    known: tuple[str, ...] = ()


@dataclass(frozen=True)
class BedMotion:
    """Readings (t, y) of the chosen sensors and commands (t, k), less their values at the operating point."""

    readings: np.ndarray = field(repr=False)
    commands: np.ndarray = field(repr=False)


def acting(case: Case, run: BedRun) -> dict[str, np.ndarray]:
    """Torques (t,) that act, N·m by input: those of the rig are not what was demanded."""
    on_rig, wrong = {part.name for part in case.rig.inputs}, run.imperfection
    time = np.arange(len(next(iter(run.torques.values())))) * case.loop["sample_time"]
    return {
        name: wrong.demand_factor * np.interp(time - wrong.demand_late, time, torque) if name in on_rig else torque
        for name, torque in run.torques.items()
    }


def vehicle_motions(case: Case, runs: Sequence[BedRun], sensors: Sequence[str]) -> list[np.ndarray]:
    """Readings (t, y) of the nonlinear vehicle with the specimen of every bed."""
    systems = [perturbed_system(case.vehicle, run.imperfection, case) for run in runs]
    beds = NonlinearBeds(systems, case.loop)
    drives = stacked([acting(case, run) for run in runs], beds.drives)
    found = run_batch(beds, drives, [beds.model.sensors.index(name) for name in sensors])
    if found.lost.any():
        raise SimulationError("simulation", "the motion of the vehicle grows out of bounds", "check its parameters")
    return [found.readings[:, :, i] for i in range(len(systems))]


def bed_motions(
    case: Case, law: ControlLaw, runs: Sequence[BedRun], sensors: Sequence[str], seed: int = 0
) -> list[BedMotion | None]:
    """The beds under the law; None for those whose motion grows out of bounds.

    All runs have imperfections of one structure: lash or none. ``seed`` is that of the sensors' noise.
    """
    loop = case.loop
    systems = [perturbed_system(case.rig, run.imperfection, case) for run in runs]
    beds = NonlinearBeds(systems, loop, loop.dynamometers, [hardware(case, run.imperfection) for run in runs])
    drives = stacked([acting(case, run) for run in runs], beds.drives)
    limit, held = case.limits_of("torque")[:, None], torques_of(case.rig)
    trim = np.array([held[dynamometer.torque_input] for dynamometer in loop.dynamometers])[:, None]
    running = RunningLaw(
        law, [beds.model.sensors.index(name) for name in law.sensors],
        [law.sensors.index(name) for name in loop.flanges],
        stacked([_known_torques(case, run) for run in runs], law.known), (-limit - trim, limit - trim),
        _sensing(case, law, runs, seed).read,
    )  # fmt: skip
    found = run_batch(beds, drives, [beds.model.sensors.index(name) for name in sensors], running)
    return [
        None if lost else BedMotion(found.readings[:, :, i], found.commands[:, :, i])
        for i, lost in enumerate(found.lost)
    ]


def hardware(case: Case, imperfection: Imperfection) -> BedHardware:
    """Lags, delay and torque gains of an imperfect bed."""
    values, loop = imperfection.values, case.loop
    return BedHardware(
        tuple(loop.lags("inverter_lag", values.get("loop.inverter_lag")).tolist()),
        tuple(loop.lags("torque_sensor_lag", values.get("loop.torque_sensor_lag")).tolist()),
        tuple(loop.command_delays(values.get("loop.dead_time")).tolist()),
        tuple(values.get(f"dynamometers.{dynamometer.name}.torque_gain", 1.0) for dynamometer in loop.dynamometers),
    )


def _known_torques(case: Case, run: BedRun) -> dict[str, np.ndarray]:
    """Torques as the controller knows them; unknown ones are 0."""
    on_rig = {part.name for part in case.rig.inputs}
    return {name: torque * (name not in on_rig or name in run.known) for name, torque in run.torques.items()}


def _sensing(case: Case, law: ControlLaw, runs: Sequence[BedRun], seed: int) -> PoorSensors:
    by_name = {sensor.name: sensor for sensor in case.rig.sensors}
    gains = [[run.imperfection.values.get(f"sensors.{name}.gain", 1.0) for run in runs] for name in law.sensors]
    poor = np.array([run.imperfection.poor_sensors for run in runs])
    encoders = np.array([run.imperfection.encoders for run in runs])
    return PoorSensors([by_name[name] for name in law.sensors], poor, np.array(gains), law.sample_time, seed, encoders)


# --- Whether a bed swings on in an open lash where the vehicle comes to rest.


@dataclass(frozen=True)
class FreePlay:
    """How beds with free play are judged in time.

    Attributes
    ----------
    gaps : (float, float)
        rad, whole lash of every shaft at the cut: of a drive from new (0.5°) to worn (5°).
    drawn : int
        Beds drawn from the case's box with drawn gaps: where none of thirty swings on, fewer than 10 % of all beds do
        (95 %).
    as_planned : int
        Runs of the bed as planned, from the least gap to the largest: a swing grows with its gap.
    duration : float
        s of a run: a swing of 1 Hz with a damping ratio of 0.05 is a fifth of itself in one second.
    pulse : (float, float)
        s, begin and end of the torque that closes the gap and then leaves it open.
    judged : float
        s at the end, over which the swing is taken: half a period of the slowest swing, 1 Hz.
    rest : float
        Of the range of the vehicle's torque, by which the bed's may swing more than the vehicle's: what swings by less
        is below what a response error of 0.1 allows.
    decaying : float
        Swing over that of the time before, below which the bed is still coming to rest.
    """

    gaps: tuple[float, float] = (float(np.radians(0.5)), float(np.radians(5.0)))
    drawn: int = 27
    as_planned: int = 3
    duration: float = 5.0
    pulse: tuple[float, float] = (0.2, 0.3)
    judged: float = 0.5
    rest: float = 0.02
    decaying: float = 0.95


FREE_PLAY = FreePlay()


@dataclass(frozen=True)
class OpenLash:
    """What lashes do on the bed as planned and on drawn ones.

    Attributes
    ----------
    drawn, limit_cycles : int
        ``limit_cycles`` swing on where the vehicle comes to rest, or are not stable.
    largest_swing, vehicle_swing : float
        N·m rms of the torque at a cut over the last half second, of the worst bed and of the vehicle next to it.
    """

    drawn: int
    limit_cycles: int
    largest_swing: float
    vehicle_swing: float
    settings: FreePlay = field(default=FREE_PLAY, repr=False)

    def to_dict(self) -> dict[str, Any]:
        """As ``result.json`` holds it."""
        return {name: value for name, value in vars(self).items() if name != "settings"}

    def words(self) -> str:
        """What the beds do."""
        low, high = np.degrees(self.settings.gaps)
        said = (
            f"{self.limit_cycles or 'none'} of {self.drawn} beds with {low:.2g}° to {high:.2g}° of free play in the "
            "cut shafts, as planned and drawn, "
        )
        if not self.limit_cycles:
            return (
                f"{said}swings on after a pulse by more than {self.settings.rest:.0%} of the range of the vehicle's "
                f"torque; the largest swing left is {self.largest_swing:.2g} N·m rms"
            )
        return f"{said}swing on after a pulse, by up to {self.largest_swing:.3g} N·m rms"


def lash_runs(
    case: Case, torques: Mapping[str, np.ndarray], known: tuple[str, ...], seed: int, settings: FreePlay = FREE_PLAY
) -> list[BedRun]:
    """A pulse at the input of the rig that the manoeuvre drives hardest, on drawn beds with drawn gaps.

    ``torques`` are those of the manoeuvre, (t,) in N·m by input.
    """
    pulse = _pulse(case, torques, len(next(iter(torques.values()))))
    if not pulse:
        return []
    gaps = np.random.default_rng(seed).uniform(*settings.gaps, settings.drawn)
    beds = case.uncertainty.draw(settings.drawn, seed + 1)
    return [
        BedRun(Imperfection("open lash", case.uncertainty.at(bed), float(gap)), pulse, known)
        for bed, gap in zip(beds, gaps, strict=True)
    ]  # fmt: skip


def _pulse(case: Case, torques: Mapping[str, np.ndarray], count: int) -> dict[str, np.ndarray]:
    """A pulse (t,) at the input of the rig that a manoeuvre drives hardest; empty without such an input."""
    driven = {dynamometer.torque_input for dynamometer in case.loop.dynamometers}
    sizes = {
        part.name: float(np.abs(torques.get(part.name, np.zeros(1))).max())
        for part in case.rig.inputs if part.name not in driven
    }  # fmt: skip
    if not sizes:
        return {}
    name, time = max(sizes, key=lambda name: sizes[name]), np.arange(count) * case.loop["sample_time"]
    size = sizes[name] or max(float(np.abs(torque).max()) for torque in torques.values())
    return {name: size * ((time >= FREE_PLAY.pulse[0]) & (time < FREE_PLAY.pulse[1]))}


def open_lash(
    vehicles: Sequence[np.ndarray],
    beds: Sequence[BedMotion | None],
    at: Sequence[int],
    step: float,
    settings: FreePlay = FREE_PLAY,
) -> OpenLash:
    """Judge vehicles (t, y) and beds of lashes by the readings ``at``, torques at the cuts; ``step`` in s."""
    count = min(round(settings.judged / step), len(vehicles[0]) // 2)
    before, last = slice(-2 * count, -count), slice(-count, None)
    swings, limit_cycles = [], 0
    for vehicle, bed in zip(vehicles, beds, strict=True):
        of_vehicle, of_bed = _swing(vehicle[last][:, at]), np.inf
        if bed is not None:
            of_bed = _swing(bed.readings[last][:, at])
            decaying = of_bed < settings.decaying * _swing(bed.readings[before][:, at])
            least = of_vehicle + settings.rest * float(np.ptp(vehicle[:, at], axis=0).max())
        limit_cycles += bed is None or (of_bed > least and not decaying)
        swings.append((of_bed, of_vehicle))
    worst = max(swings, key=lambda pair: pair[0] - pair[1])
    return OpenLash(len(beds), limit_cycles, *worst, settings)


def lashes(case: Case, seed: int = 0, settings: FreePlay = FREE_PLAY) -> OpenLash | None:
    """What free play in the cut shafts does on a tuned case's bed as planned and on drawn ones, in time.

    None where the controller gives no torque, where no input but the dynamometers' could move the bed, and where a
    bed or vehicle cannot be simulated.
    """
    if case.loop.torqueless:
        return None
    try:
        law, (torques, _) = control_law(linear_bed(case)), manoeuvre_torques(linear_bed(case))
        largest = {name: float(np.abs(torque).max()) for name, torque in torques.items()}
        count = round(settings.duration / law.sample_time)
        case, cuts = with_cut_torques(case)
        known = tuple(name for name in law.known if name in {part.name for part in case.rig.inputs})
        runs = lash_runs(case, {name: np.full(count, size) for name, size in largest.items()}, known, seed, settings)
        if not runs:
            return None
        planned = (
            Imperfection("open lash", gap=float(gap)) for gap in np.geomspace(*settings.gaps, settings.as_planned)
        )
        runs += [replace(runs[0], imperfection=each) for each in planned]
        beds = bed_motions(case, law, runs, cuts, seed)
        return open_lash(vehicle_motions(case, runs, cuts), beds, range(len(cuts)), law.sample_time, settings)
    except (NoDesign, SimulationError):
        return None


def _swing(torques: np.ndarray) -> float:
    """Largest standard deviation of torques (t, k)."""
    return float(np.std(torques, axis=0).max())


# --- Whether the counts of encoders keep a bed swinging at standstill.

COME_TO_REST_S = 4.0  # after a pulse and its opposite, which leave no speed behind


@dataclass(frozen=True)
class Standstill:
    """What encoders alone do after a pulse and its opposite, against the same bed with exact speeds.

    Attributes
    ----------
    command, flange : float
        N·m rms over the last two seconds, of the worst dynamometer: what encoders add to the command and to the torque
        at the flange, without one in the cut shaft. Noise and offset add to that.
    """

    command: float
    flange: float


def standstill(
    case: Case, law: ControlLaw, torques: Mapping[str, np.ndarray], known: tuple[str, ...]
) -> Standstill | None:
    """The bed of a case without an operating point; None where it turns, where no input could move it, or where it is
    not stable.

    Parameters
    ----------
    torques : mapping of str to ndarray (t,)
        The manoeuvre, which says how large the pulse is.
    """
    pulse = _pulse(case, torques, round(COME_TO_REST_S / law.sample_time))
    if not pulse or case.rig.operating_point is not None:
        return None
    back = round((FREE_PLAY.pulse[1] - FREE_PLAY.pulse[0]) / law.sample_time)
    both = {name: torque - np.roll(torque, back) for name, torque in pulse.items()}
    runs = [BedRun(Imperfection("", encoders=encoders), both, known) for encoders in (True, False)]
    case, _ = with_cut_torques(case)
    torques_read = [one.torque_sensor or shaft_torque(one.follows) for one in case.loop.dynamometers]
    counting, exact = bed_motions(case, law, runs, torques_read)
    if counting is None or exact is None:
        return None
    count = len(exact.commands) // 2
    off = counting.commands - exact.commands, counting.readings - exact.readings
    return Standstill(*(_swing(torque[-count:]) for torque in off))


# --- How far imperfect beds are from the nonlinear vehicle over the manoeuvre, and what they do with an open lash.

WATCHED_S = 3.0  # of the manoeuvre at most, from its beginning
SMALLEST_RANGE = 1e-300  # of a signal that the manoeuvre leaves at rest


@dataclass(frozen=True)
class TimeErrors:
    """Errors of one bed: root mean square over the range of the vehicle's signal; None where the bed is not stable.

    ``measured`` and ``unmeasured`` by sensor: the controller knows the rig's torques, or not.
    """

    words: str
    measured: Mapping[str, float] | None
    unmeasured: Mapping[str, float] | None

    def to_dict(self) -> dict[str, Any]:
        """As ``result.json`` holds it."""
        return {"what_is_wrong": self.words, "measured": self.measured, "unmeasured": self.unmeasured}

    def largest(self) -> float:
        """Over sensors and both kinds of torques; infinite where a bed is not stable."""
        both = (self.measured, self.unmeasured)
        return max(np.inf if errors is None else max(errors.values()) for errors in both)


@dataclass(frozen=True)
class BedTraces:
    """One bed for a figure: what is wrong, time (t,), by sensor (t,) vehicle and bed, torques measured and not."""

    words: str
    time: np.ndarray
    vehicle: Mapping[str, np.ndarray]
    measured: Mapping[str, np.ndarray]
    unmeasured: Mapping[str, np.ndarray]


@dataclass(frozen=True)
class InTime:
    """The tuned controller on beds that are not the model.

    Attributes
    ----------
    sensors : tuple of str
        Of the compared functions.
    rows : tuple of TimeErrors
        For what is wrong; of the drawn beds with everything wrong the worst.
    standstill : Standstill or None
        None where the case has an operating point, or no input but the dynamometers' could move the bed.
    seconds : float
        Of the manoeuvre.
    not_simulated : str
        Why there is nothing; empty otherwise.
    traces : BedTraces or None
        Of the worst bed with everything wrong; None where it is not stable.
    """

    sensors: tuple[str, ...] = ()
    rows: tuple[TimeErrors, ...] = ()
    standstill: Standstill | None = None
    seconds: float = 0.0
    not_simulated: str = ""
    traces: BedTraces | None = field(repr=False, default=None)

    def to_dict(self) -> dict[str, Any]:
        """As ``result.json`` holds it."""
        return {
            "duration": self.seconds, "sensors": list(self.sensors), "rows": [row.to_dict() for row in self.rows],
            "encoders_at_standstill": None if self.standstill is None else dict(vars(self.standstill)),
            "not_simulated": self.not_simulated,
        }  # fmt: skip


def simulate_deviations(case: Case, seed: int = 0) -> InTime:
    """The table of a tuned case over its manoeuvre; where it cannot be simulated the result says why."""
    if case.loop.torqueless:
        return InTime(not_simulated="the dynamometers give no torque")
    try:
        parts = linear_bed(case)
        torques, lead = manoeuvre_torques(parts)
        return errors_in_time(case, control_law(parts), torques, lead, seed)
    except (NoDesign, SimulationError) as fault:
        return InTime(not_simulated=str(fault))


def errors_in_time(
    case: Case, law: ControlLaw, torques: Mapping[str, np.ndarray], lead: int = 0, seed: int = 0
) -> InTime:
    """Run a law on imperfect beds over a manoeuvre.

    Parameters
    ----------
    torques : mapping of str to ndarray (t,)
        The manoeuvre by input, one value a sample.
    lead : int
        Samples at the beginning that only lead in and do not count.
    seed : int
        Of the drawn beds and the noise.
    """
    count = min(len(next(iter(torques.values()))), lead + round(WATCHED_S / law.sample_time) + 1)
    torques = {name: torque[:count] for name, torque in torques.items()}
    sensors = tuple(dict.fromkeys(pair.sensor for pair in case.compared))
    case, cuts = with_cut_torques(case)
    alone = vehicle_motions(case, [BedRun(Imperfection(""), torques)], cuts)[0]
    rows = imperfections(case, float(np.abs(alone).max(initial=0.0)), seed)
    known = tuple(name for name in law.known if name in {part.name for part in case.rig.inputs})
    runs = [BedRun(row, torques, measured) for row in rows for measured in (known, ())]
    read = (*sensors, *cuts)
    of_vehicles, of_beds = _simulated(case, law, runs, read, seed)
    results = [
        TimeErrors(row.words, *(_errors(of_beds[2 * i + j], of_vehicles[2 * i], sensors, lead) for j in (0, 1)))
        for i, row in enumerate(rows)
    ]
    every = [i for i, row in enumerate(rows) if row.words == EVERYTHING_DRAWN]
    worst = max(every, key=lambda i: results[i].largest())
    time = (np.arange(count) - lead) * law.sample_time
    signals = [of_vehicles[2 * worst], *(bed.readings for bed in of_beds[2 * worst : 2 * worst + 2] if bed is not None)]
    traces = None
    if len(signals) == 3:
        traces = BedTraces(EVERYTHING_DRAWN, time, *(dict(zip(sensors, signal.T, strict=False)) for signal in signals))
    kept = [results[i] for i in range(len(rows)) if i not in every or i == worst]
    still = standstill(case, law, torques, known)
    return InTime(sensors, tuple(kept), still, float(time[-1]), "", traces)


def with_cut_torques(case: Case) -> tuple[Case, list[str]]:
    """The case with a sensor of the torque at each cut in vehicle and rig, and their names: models may have none."""
    added = [Sensor(shaft_torque(cut.shaft), "torque", cut.shaft) for cut in case.residual_vehicle.interfaces]
    names = [sensor.name for sensor in added]
    if {sensor.name for sensor in case.rig.sensors}.issuperset(names):
        return case, names
    vehicle, rig = (replace(system, sensors=(*system.sensors, *added)) for system in (case.vehicle, case.rig))
    return replace(case, vehicle=vehicle, rig=rig), names


def _simulated(
    case: Case, law: ControlLaw, runs: Sequence[BedRun], sensors: Sequence[str], seed: int
) -> tuple[list[np.ndarray], list[BedMotion | None]]:
    """Vehicle and bed of every run; those without and those with lash side by side."""
    vehicles: dict[int, np.ndarray] = {}
    beds: dict[int, BedMotion | None] = {}
    for lash in (False, True):
        places = [i for i, run in enumerate(runs) if (run.imperfection.gap > 0) == lash]
        chosen = [runs[i] for i in places]
        distinct = {id(run.imperfection): run for run in chosen}
        motions = dict(zip(distinct, vehicle_motions(case, [*distinct.values()], sensors), strict=True))
        vehicles |= {i: motions[id(runs[i].imperfection)] for i in places}
        beds |= dict(zip(places, bed_motions(case, law, chosen, sensors, seed), strict=True))
    return [vehicles[i] for i in range(len(runs))], [beds[i] for i in range(len(runs))]


def _errors(bed: BedMotion | None, vehicle: np.ndarray, sensors: tuple[str, ...], lead: int) -> dict[str, float] | None:
    if bed is None:
        return None
    off, wanted = (bed.readings - vehicle)[lead:, : len(sensors)], vehicle[lead:, : len(sensors)]
    share = np.sqrt(np.mean(off**2, axis=0)) / np.maximum(np.ptp(wanted, axis=0), SMALLEST_RANGE)
    return dict(zip(sensors, share.tolist(), strict=True))
