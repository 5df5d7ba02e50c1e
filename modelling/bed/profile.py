"""A speed profile driven: torques over time with which a driver makes the nonlinear vehicle follow it, when asked."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from modelling.bed.bed import Loop
from modelling.bed.manoeuvres import Manoeuvre, RecordedTorque
from modelling.bed.nonlinear import NonlinearBeds
from modelling.effects.torque_map import PedalMap
from modelling.errors import InputError, unknown
from modelling.linear.steady_motion import speeds_of
from modelling.recordings.read import read_signals
from modelling.running.beds import BedRows
from modelling.running.run import run
from modelling.simulation.stepping import SimulationError
from modelling.system import Sensor, System
from modelling.toml import no_pipe
from modelling.units import to_si

GRAVITY = 9.81  # m/s²


@dataclass(frozen=True)
class Driver:
    """A driver: PI on the vehicle's speed, which gives the torque of one input, and with brakes pulls these below 0.

    If the input is a pedal, he takes the one with which its map gives the torque, and brakes below what that can.

    Attributes
    ----------
    input : str
    brakes : tuple of str
        Inputs with a brake; together they brake as the input's torque would.
    proportional, integral : float
        N·m·s/rad and N·m/rad, by the error of the speed of the vehicle's inertias: torque of the input per rad/s.
    largest : float
        N·m: its torque stays within ± this, counted from standstill.
    """

    input: str
    brakes: tuple[str, ...] = ()
    proportional: float = 40.0
    integral: float = 20.0
    largest: float = 400.0


UNITS = {"proportional": "N*m*s/rad", "integral": "N*m/rad", "largest": "N*m"}


def read_driver(entry: Any, known: Sequence[str], brakes: Sequence[str], place: str) -> Driver:
    """A driver from a table; without one, of the first input that is known. ``brakes`` are the inputs with one.

    Raises
    ------
    InputError
        Naming the key that is wrong.
    """
    table = {} if entry is None else entry
    if not isinstance(table, Mapping):
        raise InputError(f"{place}.driver", "is no table", 'write driver = { input = "motor_torque" }')
    for key in table:
        if key not in ("input", "brakes", *UNITS):
            raise unknown(str(key), ["input", "brakes", *UNITS], f"{place}.driver")
    name = table.get("input", known[0] if known else "")
    if name not in known:
        raise unknown(str(name), list(known), f"{place}.driver.input")
    pulled = table.get("brakes", [])
    if not isinstance(pulled, list) or not all(isinstance(each, str) for each in pulled):
        raise InputError(f"{place}.driver.brakes", "is no list of inputs", 'write brakes = ["brake_left"]')
    for each in pulled:
        if each not in brakes:
            there = f"there are {', '.join(map(repr, brakes))}"
            right = there if brakes else 'add an effect kind = "brake" to the vehicle'
            raise InputError(f"{place}.driver.brakes", f"{each!r} is no input with a brake", right)
    values = {key: to_si(table[key], unit, f"{place}.driver.{key}") for key, unit in UNITS.items() if key in table}
    for key, value in values.items():
        if value < 0:
            raise InputError(f"{place}.driver.{key}", f"{value:g} is not possible", "0 or more is needed")
    return Driver(name, tuple(pulled), **values)


@dataclass(frozen=True)
class SpeedProfile:
    """Times (t,) in s from 0 on, speeds (t,) of the vehicle in m/s, and grades (t,) as tangents."""

    time: np.ndarray
    speed: np.ndarray
    grade: np.ndarray


def read_speed_profile(file: Any, folder: Path, place: str) -> SpeedProfile:
    """A profile from a file with columns ``time``, ``vehicle_speed`` and, where the road climbs, ``grade``.

    Raises
    ------
    InputError
        If the file lacks the speed, or its units are others.
    """
    if not isinstance(file, str) or not file:
        raise InputError(f"{place}.profile", "is no text", 'write profile = "speed.csv"')
    recording = read_signals(no_pipe(folder / file, place), ["vehicle_speed", "grade"])
    if "vehicle_speed" not in recording.channels:
        right = "columns time, vehicle_speed [km/h] and, if the road climbs, grade [%] are needed"
        raise InputError(f"{place}.profile", f"{file} has no column 'vehicle_speed'", right)
    for name, unit in (("vehicle_speed", "m/s"), ("grade", "1")):
        if stated := recording.units.get(name):
            to_si(f"1 {stated}", unit, f"{place}.profile: {name}")
    time = recording.time - recording.time[0]
    grade = recording["grade"] if "grade" in recording.channels else np.zeros(len(time))
    return SpeedProfile(time, recording["vehicle_speed"], grade)


@dataclass(frozen=True, eq=False)
class DrivenTorques(Mapping[str, Manoeuvre]):
    """Torques by input, less those of the vehicle's operating point, with which a driver follows a profile.

    The driver sits in the nonlinear vehicle; grades act on its bodies. What comes out is played to vehicle and bed
    alike. It is driven once, when a torque is first asked for.

    Attributes
    ----------
    profile, driver : SpeedProfile, Driver
    vehicle : System
        At the operating point where the profile begins, at rest at standstill.
    loop : Loop
        Its sample time is the driver's.
    bodies : tuple of str
        Inertias whose mean speed is the vehicle's; ``radius`` (m) is that of the tyres.
    radius : float
    turning : mapping of str to float
        Speed of every inertia of the vehicle in motion, rad/s: how the torque of a driver is shared among brakes; empty
        without any.
    given : mapping of str to Manoeuvre
        Torques that are stated beside the profile.

    Raises
    ------
    InputError
        At once, if the road climbs and nothing acts on the bodies.
    SimulationError
        When it is driven, if the vehicle's motion grows out of bounds.
    """

    profile: SpeedProfile
    driver: Driver
    vehicle: System
    loop: Loop
    bodies: tuple[str, ...]
    radius: float
    turning: Mapping[str, float]
    given: Mapping[str, Manoeuvre]

    def __post_init__(self) -> None:
        self._names  # noqa: B018  # a road that nothing can act for is said when the case is read

    @cached_property
    def _names(self) -> tuple[str, ...]:
        of_grade = _of_grade(self.profile.grade, self.vehicle, self.bodies, self.radius)
        return tuple(dict.fromkeys((*of_grade, self.driver.input, *self.driver.brakes, *self.given)))

    def __getitem__(self, name: str) -> Manoeuvre:
        return self.given[name] if name in self.given else self._driven[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)

    @property
    def behind(self) -> tuple[float, float]:
        """Largest difference of the vehicle's speed from the profile, m/s, and its time, s."""
        return self._drive[1]

    @property
    def _driven(self) -> dict[str, RecordedTorque]:
        return self._drive[0]

    @cached_property
    def _drive(self) -> tuple[dict[str, RecordedTorque], tuple[float, float]]:
        step, profile, driver = self.loop["sample_time"], self.profile, self.driver
        time = np.arange(round(float(profile.time[-1]) / step) + 1) * step
        wanted = np.interp(time, profile.time, profile.speed) / self.radius
        torques = _of_grade(np.interp(time, profile.time, profile.grade), self.vehicle, self.bodies, self.radius)
        pedal = self.vehicle.pedals.get(driver.input)
        engine = [part.on for part in self.vehicle.inputs if part.name == driver.input and pedal is not None]
        sensors = tuple(Sensor(f"driven_speed_{name}", "speed", name) for name in (*self.bodies, *engine))
        vehicle = replace(self.vehicle, sensors=(*self.vehicle.sensors, *sensors))
        plant = BedRows(NonlinearBeds([vehicle], self.loop), [sensor.name for sensor in sensors],
                        held=(driver.input, *driver.brakes))  # fmt: skip
        trim = plant.idle()[:, 0]
        held = float(trim[0])
        if pedal is not None:
            held = pedal.torque(speeds_of(self.vehicle)[engine[0]], held)
        at_wheel = _Following(driver, wanted, self._shares(), held, step, plant.sensors, pedal=pedal)
        found = run(plant, at_wheel, torques, samples=len(time), keep=plant.sensors)
        if found.lost.any():
            raise SimulationError("drives", "the vehicle's motion grows out of bounds", "check it")
        torques |= {name: found[name][:, 0] - at for name, at in zip(plant.commands, trim, strict=True)}
        apart = self.radius * np.abs(found.readings[:, : len(self.bodies), 0].mean(axis=1) - wanted)
        worst = int(apart.argmax())
        driven = {name: RecordedTorque.of(time, torque) for name, torque in torques.items()}
        return driven, (float(apart[worst]), float(time[worst]))

    def _shares(self) -> np.ndarray:
        """Torque of each brake over the driver's (brakes,)."""
        on, driver = {part.name: part.on for part in self.vehicle.inputs}, self.driver
        ratios = [self.turning[on[driver.input]] / self.turning[on[name]] for name in driver.brakes]
        return np.abs(np.array(ratios)) / max(len(ratios), 1)


@dataclass
class _Following:
    """A driver as a controller: torque or pedal of its input, then torques of its brakes (N·m), for the speeds of the
    bodies and, if its input is a ``pedal``, that of its inertia."""

    driver: Driver
    wanted: np.ndarray
    shares: np.ndarray
    integral: float
    span: float
    sensors: tuple[str, ...]
    known: tuple[str, ...] = ()
    pedal: PedalMap | None = None

    def step(self, sample: int, readings: np.ndarray, known: np.ndarray) -> np.ndarray:
        """See :class:`modelling.running.plant.Controller`."""
        driver, bodies, turning = self.driver, readings, 0.0
        least, most = 0.0 if len(self.shares) else -driver.largest, driver.largest  # of the input itself
        if self.pedal is not None:
            bodies, turning = readings[:-1], float(readings[-1].mean())
            over = self.pedal.over_pedal(turning)
            least, most = float(over.min()), min(most, float(over.max()))
        error = float(self.wanted[sample] - bodies.mean())
        asked = driver.proportional * error + self.integral
        given = min(max(asked, -driver.largest if len(self.shares) else least), most)
        self.integral += driver.integral * self.span * error if given == asked else 0.0
        own = max(given, least)
        own = own if self.pedal is None else self.pedal.pedal(turning, own)
        return np.concatenate([[own], max(least - given, 0.0) * self.shares])[:, None]


def _of_grade(grade: np.ndarray, vehicle: System, bodies: Sequence[str], radius: float) -> dict[str, np.ndarray]:
    """Torques (t,) of a road that climbs, by the first input on each body; none on the flat."""
    if not grade.any():
        return {}
    made = {}
    for body in bodies:
        on = [part.name for part in vehicle.inputs if part.on == body]
        if not on:
            right = f'add an input, [inputs.road] with on = "{body}", to the vehicle'
            raise InputError("profile", f"climbs, and no torque acts on {body!r}", right)
        J = vehicle.parameters[f"inertias.{body}.J"].value
        made[on[0]] = -J / radius * GRAVITY * np.sin(np.arctan(grade))
    return made
