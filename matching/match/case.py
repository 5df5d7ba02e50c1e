"""A match as asked for: what is matched to what, by which loop, and which quantities may move."""

from __future__ import annotations

import dataclasses
import fnmatch
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
import scipy

from modelling import display
from modelling.bed.bed import Loop
from modelling.bed.manoeuvres import Manoeuvre
from modelling.bed.vehicle import ResidualVehicle, TorqueCurve, read_torque_curve
from modelling.errors import InputError, unknown
from modelling.linear.steady_motion import operating_motion, torques_of
from modelling.modal.modes import damped_modes, modes
from modelling.modal.result import Mode, Modes
from modelling.modal.sensitivity import mac
from modelling.simulation.simulate import simulate
from modelling.system import Sensor, Shaft, System
from modelling.units import to_si

# --- What is not known exactly of a bed: the box that beds are drawn from.

# Relative half-widths unless a case says otherwise; of the dead time in s.
DEFAULT = {
    "rig.inertias.*.J": 0.05,
    "rig.shafts.*.stiffness": 0.05,
    "rig.shafts.*.damping": 0.3,
    "loop.dead_time": 5e-4,
    "loop.inverter_lag": 0.2,
    "loop.torque_sensor_lag": 0.2,
    "loop.torque_gain": 0.03,
}
LARGEST_SHARE = 0.99  # of a value, as its half-width
TORQUE_SENSOR_GAIN = 0.005  # relative half-width, of the dynamometers' torque sensors


@dataclass(frozen=True)
class Uncertain:
    """One quantity: its value, and how far it may be off either way, both SI.

    Names are ``rig.…``, ``vehicle.…`` for what the rig lacks, ``loop.dead_time``, ``loop.inverter_lag``,
    ``loop.torque_sensor_lag``, ``dynamometers.NAME.torque_gain`` and ``sensors.NAME.gain``.
    """

    name: str
    value: float
    half_width: float


@dataclass(frozen=True)
class Box:
    """Everything uncertain; p quantities."""

    uncertain: tuple[Uncertain, ...] = ()

    def at(self, position: np.ndarray) -> dict[str, float]:
        """Values by name at a position (p,) in the box, each coordinate from −1 to 1."""
        return {
            quantity.name: max(quantity.value + quantity.half_width * float(x), 0.0)
            for quantity, x in zip(self.uncertain, position, strict=True)
        }

    def draw(self, count: int, seed: int) -> np.ndarray:
        """Positions (count, p), each coordinate even over −1 … 1."""
        return np.random.default_rng(seed).uniform(-1, 1, (count, len(self.uncertain)))

    def spread(self, count: int) -> np.ndarray:
        """Positions (count, p) that fill the box evenly, the first of them as well (Sobol 1967); always the same."""
        if not self.uncertain:
            return np.zeros((count, 0))
        sequence = scipy.stats.qmc.Sobol(len(self.uncertain), seed=0)
        return 2 * sequence.random_base2(int(np.ceil(np.log2(count))))[:count] - 1

    def of_kind(self, kind: str) -> Box:
        """What begins with ``kind`` alone."""
        return Box(tuple(quantity for quantity in self.uncertain if quantity.name.startswith(kind)))

    def without(self, *kinds: str) -> Box:
        """The same box with what begins with one of ``kinds`` known exactly."""
        return Box(tuple(quantity for quantity in self.uncertain if not quantity.name.startswith(kinds)))

    def about(self, values: Mapping[str, float]) -> Box:
        """The same box about other values by name: half-widths keep their share of it, the dead time's is kept."""
        return Box(tuple(_about(quantity, values) for quantity in self.uncertain))


def _about(quantity: Uncertain, values: Mapping[str, float]) -> Uncertain:
    value = values.get(quantity.name, quantity.value)
    kept = quantity.name == "loop.dead_time" or not quantity.value
    width = quantity.half_width if kept else quantity.half_width * abs(value / quantity.value)
    return Uncertain(quantity.name, value, width)


def of_system(values: Mapping[str, float], system: System) -> dict[str, float]:
    """Quantities of a rig or a vehicle among values by their names in a box; what both have is there under ``rig.``."""
    known = system.parameters
    plain = {name.split(".", 1)[1]: value for name, value in values.items() if name.startswith(("rig.", "vehicle."))}
    return {name: value for name, value in plain.items() if name in known}


def read_uncertainty(data: Mapping[str, Any], vehicle: System, rig: System, loop: Loop, where: str) -> Box:
    """The box of a case: the defaults, and over them what ``[uncertainty]`` says."""
    table = data.get("uncertainty", {})
    if not isinstance(table, dict):
        raise InputError(f"{where}: uncertainty", "is no table", 'write "rig.inertias.*.J" = 0.05 under [uncertainty]')
    known = _known(vehicle, rig, loop)
    by_name: dict[str, Uncertain] = {}
    for key, value in {**DEFAULT, **table}.items():
        names = _fitting(key, known)
        if not names:
            if key in DEFAULT and key not in table:
                continue
            raise unknown(key, [*known, *DEFAULT, "sensors.*.gain"], f"{where}: uncertainty")
        share = to_si(value, "s" if key == "loop.dead_time" else "1", f"{where}: uncertainty.{key!r}")
        if not 0 <= share < 1:
            raise InputError(f"{where}: uncertainty.{key!r}", f"{share:g} is not possible", "0 ≤ value < 1 is needed")
        for name in names:
            half_width = share if name == "loop.dead_time" else share * abs(known[name])
            by_name[name] = Uncertain(name, known[name], half_width)
    for dynamometer in loop.dynamometers:
        name = f"sensors.{dynamometer.torque_sensor}.gain"
        by_name.setdefault(name, Uncertain(name, 1.0, TORQUE_SENSOR_GAIN))
    return Box(tuple(quantity for quantity in by_name.values() if quantity.half_width > 0))


def uncertainty_table(box: Box, vehicle: System, rig: System, loop: Loop) -> dict[str, float]:
    """``[uncertainty]`` of a case file with every quantity by its own name: what is not in the box is 0 there."""
    widths = {quantity.name: quantity for quantity in box.uncertain}
    table = {}
    for name, value in _known(vehicle, rig, loop).items():
        width = widths.get(name)
        if width is None:
            defaults = any(name in _fitting(key, {name: value}) for key in DEFAULT)
            if defaults or name in {f"sensors.{dynamometer.torque_sensor}.gain" for dynamometer in loop.dynamometers}:
                table[name] = 0.0
        elif name == "loop.dead_time":
            table[name] = width.half_width
        elif width.value:
            share = float(f"{width.half_width / abs(width.value):.12g}")  # 0.05, not 0.05000000000000001
            table[name] = min(share, LARGEST_SHARE)
    return table


def _known(vehicle: System, rig: System, loop: Loop) -> dict[str, float]:
    of_rig = rig.parameters
    known = {f"rig.{name}": quantity.value for name, quantity in of_rig.items()}
    known |= {f"vehicle.{name}": quantity.value for name, quantity in vehicle.parameters.items() if name not in of_rig}
    known |= {f"loop.{name}": loop[name] for name in ("dead_time", "inverter_lag", "torque_sensor_lag")}
    known |= {f"dynamometers.{dynamometer.name}.torque_gain": 1.0 for dynamometer in loop.dynamometers}
    return known | {f"sensors.{name}.gain": 1.0 for name in loop.controller_sensors}


def _fitting(key: str, known: Mapping[str, float]) -> list[str]:
    """Names that a key of the case file stands for."""
    return fnmatch.filter(known, "dynamometers.*.torque_gain" if key == "loop.torque_gain" else key)


# --- Case


@dataclass(frozen=True)
class Compared:
    """A transfer function that vehicle and rig are compared by: an input and a sensor both know by name."""

    input: str
    sensor: str


@dataclass(frozen=True)
class Target:
    """A vehicle mode the rig has to show: its number, and how far frequency (relative) and damping ratio may be off."""

    mode: int
    frequency_tolerance: float = 0.01
    damping_tolerance: float = 0.02


@dataclass(frozen=True)
class Move:
    """A quantity that may move.

    Attributes
    ----------
    name : str
        ``residual_vehicle.…``, ``rig.…`` or ``loop.…``.
    together : tuple of str
        The name itself and its mirror image, which moves with it.
    start, lower, upper : float
        In SI.
    unit : str
    planned : float
        Value, SI, from which a change is counted, wherever the search starts: the model's, or as the case states it.
    """

    name: str
    together: tuple[str, ...]
    start: float
    lower: float
    upper: float
    unit: str
    planned: float


@dataclass(frozen=True)
class Case:
    """A match as asked for; see ``examples/road_to_rig/case.toml`` for every key with a comment.

    Vehicle, rig and the parts of the residual vehicle carry the operating point, if the case states one.
    """

    vehicle: System
    rig: System
    residual_vehicle: ResidualVehicle
    loop: Loop
    targets: tuple[Target, ...]
    band: tuple[float, float]
    compared: tuple[Compared, ...]
    manoeuvre: Mapping[str, Manoeuvre]
    limits: Mapping[str, float]
    moves: tuple[Move, ...]
    title: str = ""
    path: str = field(default="", compare=False)
    uncertainty: Box = field(default_factory=Box)
    tolerance: float = 0.1  # largest response error to measured torques that is still called matched
    unmeasured_tolerance: float = 0.3  # the same to unmeasured torques
    torque_curve: TorqueCurve | None = None
    simple_vehicle: System | None = None  # the vehicle with a residual vehicle of the user's own, if the case has one
    notes: tuple[str, ...] = ()  # what was changed of the model files, as sentences

    @property
    def emulated_vehicle(self) -> System:
        """The vehicle that the controller emulates: with the user's residual vehicle where the case has one."""
        return self.vehicle if self.simple_vehicle is None else self.simple_vehicle

    def _repr_html_(self) -> str:
        return display.html(self)


# --- Tables and texts of a case file, checked.


def text_of(table: Mapping[str, Any], key: str, where: str) -> str:
    """A text that has to be there."""
    value = table.get(key)
    if not isinstance(value, str) or not value:
        raise InputError(f"{where}: {key}", "is missing or no text", f'write {key} = "…"')
    return value


def table_of(data: Mapping[str, Any], key: str, where: str, known: set[str] | None = None) -> dict[str, Any]:
    """A table, empty where it is left out; with ``known`` no other keys may stand in it."""
    table = data.get(key, {})
    if not isinstance(table, dict):
        raise InputError(f"{where}: {key}", "is no table", f"write [{key}]")
    for name in table:
        if known is not None and name not in known:
            raise unknown(name, sorted(known), f"{where}: {key}")
    return table


# --- Reading the limits of a case file.

LIMIT_UNITS = {
    "modulus_margin": "1",
    "margin_from": "Hz",
    "rolled_off": "1",
    "rolled_off_from": "Hz",
    "command_noise": "N*m",
    "damping_ratio": "1",
    "damping_share": "1",
    "dynamometer_torque": "N*m",
    "dynamometer_speed": "rad/s",
    "dynamometer_power": "W",
}
DEFAULT_LIMITS = {
    "modulus_margin": 0.5,
    "rolled_off": 0.5,
    "rolled_off_from": 100.0,  # where a model of a drivetrain ends
    "damping_ratio": 0.01,
    "damping_share": 1 / 3,
}
MARGIN_FROM_HIGHEST_TARGET = 2.0  # times the highest target mode: ``margin_from`` unless stated
NOISE_SHARE = 0.02  # of the dynamometers' torque limit: ``command_noise`` unless stated
TORQUE_OVER_SPEED = "dynamometer_torque_over_speed"  # as a limit: 1, on the share of the curve that is used


def limit_units(rig: System) -> dict[str, str]:
    """Unit of every limit that a case may state, by its key; but for the torque over speed, which is a list."""
    return (
        LIMIT_UNITS
        | {f"shafts.{part.name}.torque": "N*m" for part in rig.shafts}
        | {f"shafts.{part.name}.twist": "rad" for part in rig.shafts}
    )


def read_limits(data: Mapping[str, Any], rig: System, where: str) -> tuple[dict[str, float], TorqueCurve | None]:
    """Limits by key, SI, and the dynamometers' torque over speed; its last speed limits the speed."""
    table = table_of(data, "limits", where)
    units = limit_units(rig)
    limits: dict[str, float] = dict(DEFAULT_LIMITS)
    curve = None
    for key, value in table.items():
        if key == TORQUE_OVER_SPEED:
            curve = read_torque_curve(value, f"{where}: limits.{key}")
            continue
        if key not in units:
            raise unknown(key, [*units, TORQUE_OVER_SPEED], f"{where}: limits")
        limits[key] = to_si(value, units[key], f"{where}: limits.{key}")
        if not limits[key] > 0:
            raise InputError(f"{where}: limits.{key}", f"{limits[key]:g} is not possible", "greater than 0 is needed")
    for key, usual in {"modulus_margin": "0.5", "damping_ratio": "0.01", "damping_share": "1/3"}.items():
        if limits[key] >= 1:
            wrong, right = f"{limits[key]:g} cannot be reached", f"less than 1 is needed; {usual} is usual"
            raise InputError(f"{where}: limits.{key}", wrong, right)
    if curve is not None:
        limits[TORQUE_OVER_SPEED] = 1.0
        limits["dynamometer_speed"] = min(limits.get("dynamometer_speed", curve.speeds[-1]), curve.speeds[-1])
    return limits, curve


# --- What the vehicle's own manoeuvre asks of adapters and dynamometers, as constraints on what may move.
#
# If the rig reproduces the vehicle's response, the cut shafts carry the vehicle's torques and their ends turn as the
# vehicle's do. Behind the cut stands a chain of adapters and the rotor: each of its shafts carries the interface torque
# less what the inertias before it and their drag take, the dynamometer what is left. Torques and speeds are absolute:
# the vehicle begins at its operating point, at standstill without one.


@dataclass(frozen=True)
class DynamometerChain:
    """What stands behind one cut, from there to the rotor, and the manoeuvre there.

    ``shafts`` holds each shaft with the inertias before it, ``inertias`` all of them;
    ``torque`` (t,) N·m, ``acceleration`` (t,) rad/s² and ``speed`` (t,) rad/s of the vehicle's interface; ``drag`` of
    each inertia, N·m·s/rad.
    """

    dynamometer: str
    shafts: tuple[tuple[str, tuple[str, ...]], ...]
    inertias: tuple[str, ...]
    torque: np.ndarray
    acceleration: np.ndarray
    speed: np.ndarray
    drag: Mapping[str, float] = field(default_factory=dict)

    def remaining_torque(self, passed: tuple[str, ...]) -> np.ndarray:
        """Interface torque (t,) less the drag of the inertias that it has passed, N·m."""
        return self.torque - sum(self.drag.get(name, 0.0) for name in passed) * self.speed

    def peak(self, passed: tuple[str, ...], inertia: float, factor: np.ndarray | float = 1.0) -> float:
        """Largest |(remaining torque − inertia·acceleration)·factor| over the manoeuvre, inertia in kg·m²."""
        return float(np.abs((self.remaining_torque(passed) - inertia * self.acceleration) * factor).max())


class ExceededLimit(NamedTuple):
    """A limit of a dynamometer or of the shafts before it, what the manoeuvre takes of it, and what is allowed; SI."""

    dynamometer: str
    limit: str
    demand: float
    allowed: float


@dataclass(frozen=True)
class Demands:
    """Chains of a case, the limits they have to keep, and the dynamometers' torque over speed if it is stated."""

    chains: tuple[DynamometerChain, ...]
    limits: Mapping[str, float]
    torque_curve: TorqueCurve | None = None

    def taken(self, values: Mapping[str, float]) -> list[ExceededLimit]:
        """Every limit with what the manoeuvre takes of it, whether it is exceeded or not."""
        every = []
        for chain in self.chains:
            demands = {}
            for shaft, before in chain.shafts:
                torque = chain.peak(before, sum(values[f"rig.inertias.{name}.J"] for name in before))
                demands[f"shafts.{shaft}.torque"] = torque
                demands[f"shafts.{shaft}.twist"] = torque / max(values[f"rig.shafts.{shaft}.stiffness"], 1e-9)
            total = sum(values[f"rig.inertias.{name}.J"] for name in chain.inertias)
            for name, factor in self._at_the_rotor(chain).items():
                demands[name] = chain.peak(chain.inertias, total, factor)
            demands["dynamometer_speed"] = float(np.abs(chain.speed).max())
            every += [
                ExceededLimit(chain.dynamometer, name, demand, self.limits[name])
                for name, demand in demands.items()
                if name in self.limits
            ]
        return every

    def shares(self, values: Mapping[str, float]) -> np.ndarray:
        """What the manoeuvre takes of every limit, as a share of it."""
        return np.array([one.demand / one.allowed for one in self.taken(values)])

    def broken(self, values: Mapping[str, float], part: float = 1.001) -> list[ExceededLimit]:
        """Limits that the manoeuvre takes more than a part of, worst first."""
        broken = [one for one in self.taken(values) if one.demand > one.allowed * part]
        return sorted(broken, key=lambda exceeded: exceeded.allowed / exceeded.demand)

    def quantities(self, limit: str) -> set[str]:
        """Names of the quantities of the rig that decide what the manoeuvre takes of a limit."""
        names: set[str] = set()
        for chain in self.chains:
            behind: dict[str, tuple[str, ...]] = dict.fromkeys(self._at_the_rotor(chain), chain.inertias)
            behind |= {
                f"shafts.{shaft}.{what}": inertias for shaft, inertias in chain.shafts for what in ("torque", "twist")
            }
            names |= {f"rig.inertias.{name}.J" for name in behind.get(limit, ())}
            if limit in behind and limit.endswith(".twist"):
                names.add(f"rig.{limit.removesuffix('.twist')}.stiffness")
        return names

    def _at_the_rotor(self, chain: DynamometerChain) -> dict[str, np.ndarray | float]:
        """What the dynamometer's torque (t,) is multiplied by for each limit on it."""
        factors: dict[str, np.ndarray | float] = {"dynamometer_torque": 1.0, "dynamometer_power": chain.speed}
        if self.torque_curve is not None:
            factors[TORQUE_OVER_SPEED] = 1 / self.torque_curve.at(chain.speed)
        return factors


def rig_values(case: Case) -> dict[str, float]:
    """Every quantity of the rig, SI, by its name in a case."""
    return {f"rig.{name}": quantity.value for name, quantity in case.rig.parameters.items()}


def demands(case: Case, points: int = 400) -> Demands:
    """Simulate the vehicle's manoeuvre and find what it asks behind every cut.

    Parameters
    ----------
    points : int
        The manoeuvre is thinned to about so many samples, extremes kept.
    """
    time = max(case.manoeuvre.values(), key=lambda torque: torque.duration).time(1000.0)
    inputs = {part.name: np.zeros(len(time)) for part in case.vehicle.inputs}
    inputs |= {name: driven.torque(time) for name, driven in case.manoeuvre.items() if name in inputs}
    inputs = {name: torque + inputs[name] for name, torque in torques_of(case.vehicle).items()}
    cuts = {interface.shaft: interface for interface in case.residual_vehicle.interfaces}
    watched: list[Sensor] = []
    for name, interface in cuts.items():
        watched.append(Sensor(f"cut_{name}_torque", "torque", name))
        watched += [Sensor(f"cut_{name}_{what}", what, interface.vehicle_end) for what in ("speed", "acceleration")]
    vehicle = replace(case.vehicle, sensors=(*case.vehicle.sensors, *watched))
    start = None if vehicle.operating_point is None else operating_motion(vehicle).state
    readings = simulate(vehicle, time, inputs, start=start).readings
    drag = {part.name: part.drag.value for part in case.rig.inertias}
    chains = []
    for dyno in case.loop.dynamometers:
        cut = cuts[dyno.follows]
        rotor = next(part.on for part in case.rig.inputs if part.name == dyno.torque_input)
        shafts, inertias = _path(case, cut.rig_end, rotor, dyno.follows)
        torque = readings[f"cut_{cut.shaft}_torque"] * cut.factor
        acceleration, speed = (readings[f"cut_{cut.shaft}_{what}"] for what in ("acceleration", "speed"))
        extremes = [place(of) for of in (torque, acceleration) for place in (np.argmax, np.argmin)]
        keep = np.union1d(np.linspace(0, len(time) - 1, points).astype(int), extremes)
        chains.append(
            DynamometerChain(dyno.name, shafts, inertias, torque[keep], acceleration[keep], speed[keep], drag)
        )
    return Demands(tuple(chains), case.limits, case.torque_curve)


def _path(
    case: Case, start: str, end: str, without: str
) -> tuple[tuple[tuple[str, tuple[str, ...]], ...], tuple[str, ...]]:
    """Shafts from the cut to the rotor, each with the inertias passed before it, and all inertias up to the rotor."""
    joints: list[Shaft] = [part for part in case.rig.shafts if part.name != without]
    paths: list[tuple[str, tuple[str, ...], tuple[str, ...]]] = [(start, (), (start,))]
    reached = {start}
    while paths:
        here, shafts, passed = paths.pop(0)
        if here == end:
            return tuple((name, passed[: i + 1]) for i, name in enumerate(shafts)), passed
        for joint in joints:
            if here in joint.between:
                other = joint.between[1 - joint.between.index(here)]
                if other not in reached:
                    reached.add(other)
                    paths.append((other, (*shafts, joint.name), (*passed, other)))
    return (), (start, end)


# --- Target modes.

FARTHEST_DAMPED = float(np.log(1.5))  # between a mode's damped and undamped frequency, logarithm
LEAST_SCORE = 1e-3  # of any pair that may be one mode, so that as many as possible are paired


def target_modes(case: Case) -> list[tuple[Mode, Mode]]:
    """For every target the undamped vehicle mode it numbers and the damped mode it is.

    Each damped mode is one undamped mode: both are paired as a whole, by shape and frequency, since neighbours that lie
    1 % apart may come in another order, or mix, once they are damped.
    """
    plain, damped = modes(case.vehicle), damped_modes(case.vehicle)
    counterpart = _paired(plain, damped, {f"inertias.{part.name}": part.J.value for part in case.vehicle.inertias})
    pairs = []
    for number, target in enumerate(case.targets, 1):
        where = f"{case.path}: targets[{number}].mode"
        if target.mode > len(plain):
            raise InputError(where, f"the vehicle has {len(plain)} modes", "see 'rigmatch modes' of the vehicle file")
        wanted = plain[target.mode - 1]
        if wanted.frequency == 0:
            raise InputError(where, f"mode {target.mode} is a rigid motion", "name an elastic mode")
        best = counterpart.get(wanted.number)
        if best is None:
            raise InputError(
                where,
                f"mode {target.mode} ({wanted.frequency:.3g} Hz) is overdamped in the vehicle",
                "name a mode that swings",
            )
        pairs.append((wanted, best))
    return pairs


def _paired(plain: Modes, damped: Modes, inertia: Mapping[str, float]) -> dict[int, Mode]:
    """The damped mode of every undamped one that has one, by the number of the latter."""
    elastic = [mode for mode in plain if mode.frequency > 0]
    swinging = [mode for mode in damped if mode.frequency > 0 and mode.damping_ratio < 1]
    score = np.zeros((len(elastic), len(swinging)))
    for row, first in enumerate(elastic):
        for column, second in enumerate(swinging):
            far = abs(np.log(second.frequency / first.frequency))
            if first.symmetry == second.symmetry and far <= FARTHEST_DAMPED:
                score[row, column] = LEAST_SCORE + weighted_mac(first.shape, second.shape, inertia) * np.exp(-far)
    places = zip(*scipy.optimize.linear_sum_assignment(score, maximize=True), strict=True)
    return {elastic[row].number: swinging[column] for row, column in places if score[row, column] > 0}


def weighted_mac(first: Mapping[str, complex], second: Mapping[str, complex], inertia: Mapping[str, float]) -> float:
    """Modal assurance criterion over what both shapes hold, each coordinate weighted by its inertia, kg·m² (else 1)."""
    names = [name for name in first if name in second]
    weight = np.sqrt([inertia.get(name, 1.0) for name in names])
    a, b = (weight * np.array([shape[name] for name in names]) for shape in (first, second))
    return float(abs(np.vdot(a, b)) ** 2 / max(np.vdot(a, a).real * np.vdot(b, b).real, 1e-300))


# --- What every bed and the loop have to keep, for a controller to count as robust.


@dataclass(frozen=True)
class Requirements:
    """Robustness requirements of a case, by its ``[limits]``.

    Attributes
    ----------
    damping_ratio, damping_share : float
        Least damping ratio of every mode on every bed: this share of the least damping of the target modes.
    modulus_margin, margin_from : float
        Least singular value of I + L, and from where it counts, Hz.
    rolled_off, rolled_off_from : float
        Largest abs(T), and from where it counts, Hz.
    command_noise : float or None
        N·m rms.
    """

    damping_ratio: float
    damping_share: float
    modulus_margin: float
    margin_from: float
    rolled_off: float
    rolled_off_from: float
    command_noise: float | None


def requirements(case: Case) -> Requirements:
    """What a case asks for."""
    damped = [mode for _, mode in target_modes(case)]
    limits = case.limits
    noise = limits.get("command_noise")
    if noise is None and "dynamometer_torque" in limits:
        noise = NOISE_SHARE * limits["dynamometer_torque"]
    return Requirements(
        limits["damping_share"] * min(mode.damping_ratio for mode in damped),
        limits["damping_share"],
        limits["modulus_margin"],
        limits.get("margin_from", MARGIN_FROM_HIGHEST_TARGET * max(mode.frequency for mode in damped)),
        limits["rolled_off"],
        limits["rolled_off_from"],
        noise,
    )


# --- What moves as parts 0 … 1 of its range, and back.

LOGARITHMIC_FROM_RATIO = 4.0  # upper over lower bound, above which a range is scaled by its logarithm


def unscaled(part: Any, move: Move) -> Any:
    """Value of a move in SI from its scaled part 0 … 1 (float or CasADi expression, and so the value)."""
    if is_logarithmic(move):
        return move.lower * (move.upper / move.lower) ** part
    return move.lower + (move.upper - move.lower) * part


def scaled(value: float, move: Move) -> float:
    """Scaled part 0 … 1 of a value in SI."""
    if is_logarithmic(move):
        return float(np.log(value / move.lower) / np.log(move.upper / move.lower))
    return (value - move.lower) / (move.upper - move.lower)


def is_logarithmic(move: Move) -> bool:
    """Whether a move is scaled by its logarithm."""
    return move.lower > 0 and move.upper / move.lower > LOGARITHMIC_FROM_RATIO


# --- A case at other values of what may move.


def apply(case: Case, values: Mapping[str, float]) -> Case:
    """The case with quantities ``rig.…``, ``residual_vehicle.…`` and ``loop.…`` changed, SI.

    What is uncertain goes with them: beds are drawn about the changed values.
    """
    rig = {name.removeprefix("rig."): value for name, value in values.items() if name.startswith("rig.")}
    emulated = {
        name.removeprefix("residual_vehicle."): value
        for name, value in values.items()
        if name.startswith("residual_vehicle.")
    }
    loop = {name.removeprefix("loop."): value for name, value in values.items() if name.startswith("loop.")}
    parts = tuple(
        part.with_values({name: value for name, value in emulated.items() if name in part.parameters})
        for part in case.residual_vehicle.parts
    )
    return dataclasses.replace(
        case,
        rig=case.rig.with_values(rig, designed=True),
        residual_vehicle=dataclasses.replace(case.residual_vehicle, parts=parts),
        loop=case.loop.with_values(loop),
        uncertainty=case.uncertainty.about(values),
    )


# --- Weights on changes: what holds much of a target mode's energy moves with little weight, what holds little is
# fixed.
#
# Shares are the modal sensitivity coefficients of the paper's Eqs. 6 and 7, summed over mirror images. Quantities of
# the residual vehicle are judged by the vehicle's target modes, adapters and rotors by the rig mode of the same
# symmetry that is most like the target on what both share, ratios and the loop's own quantities always move.

LEAST_SHARE_TO_MOVE = 0.01  # of a target mode's energy: with less a quantity is fixed, not identified accurately


def change_weight(part: float) -> float:
    """Weight of a change of what holds this share of a target mode's energy."""
    return float(1 / max(part, LEAST_SHARE_TO_MOVE))


def released_moves(case: Case, shares: np.ndarray) -> list[Move]:
    """What of a case's moves is released, by the shares (moves,) of :func:`shares_of`."""
    return [move for move, part in zip(case.moves, shares, strict=True) if part >= LEAST_SHARE_TO_MOVE]


def shares_of(case: Case, vehicle: Modes, rig_modes: list[Mode | None]) -> np.ndarray:
    """Share of each of a case's moves (moves,)."""
    return np.array([share(case, move, vehicle, rig_modes) for move in case.moves])


def counterparts(case: Case) -> list[Mode | None]:
    """For every target the rig mode that answers to it: same symmetry, most alike on the shared inertias, or None."""
    rig = modes(case.rig)
    shared = [
        part.name for part in case.rig.inertias if part.name in {inertia.name for inertia in case.vehicle.inertias}
    ]
    counterpart_modes: list[Mode | None] = []
    for wanted, _ in target_modes(case):
        shape = np.array([[wanted.shape.get(f"inertias.{name}", 0.0)] for name in shared])
        elastic = [mode for mode in rig if mode.frequency > 0 and mode.symmetry == wanted.symmetry]
        if not elastic:
            counterpart_modes.append(None)
            continue
        if np.abs(shape).max(initial=0.0) < 1e-6:  # it leaves the shared part at rest: the lowest of its symmetry
            counterpart_modes.append(elastic[0])
            continue
        macs = [
            float(mac(shape, np.array([[mode.shape.get(f"inertias.{name}", 0.0)] for name in shared]))[0, 0])
            for mode in elastic
        ]
        counterpart_modes.append(
            elastic[int(np.argmax(np.array(macs) > 0.8)) if max(macs) > 0.8 else int(np.argmax(macs))]
        )
    return counterpart_modes


def _nearest(found: Modes, wanted: Sequence[Mode]) -> list[Mode]:
    """Of the elastic modes of a vehicle those of the wanted symmetries that come nearest in frequency."""
    elastic = [mode for mode in found if mode.frequency > 0]
    alike = ([mode for mode in elastic if mode.symmetry == one.symmetry] for one in wanted)
    return [
        min(some, key=lambda mode: abs(np.log(mode.frequency / one.frequency)))
        for one, some in zip(wanted, alike, strict=True) if some
    ]  # fmt: skip


def share(case: Case, move: Move, vehicle: Modes, rig_modes: list[Mode | None]) -> float:
    """Largest share of a target mode's energy that a quantity and its mirror image hold, 0 … 1; the loop's own: 1."""
    if move.name.startswith("loop.") or move.name.endswith(".ratio"):
        return 1.0
    if move.name.startswith("residual_vehicle."):
        judged = [vehicle[target.mode - 1] for target in case.targets]
        if case.simple_vehicle is not None:
            judged = _nearest(modes(case.simple_vehicle), judged)
    else:
        judged = [mode for mode in rig_modes if mode]
    best = 0.0
    for mode in judged:
        total = 0.0
        for name in move.together:
            place, _, key = name.split(".", 1)[1].rpartition(".")
            total += (mode.kinetic if key in ("J", "drag") else mode.potential).get(place, 0.0)
        best = max(best, total)
    return best
