"""A speed profile driven: torques over time with which a driver makes the nonlinear vehicle follow it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from modelling.bed.bed import Loop
from modelling.bed.manoeuvres import RecordedTorque
from modelling.bed.nonlinear import NonlinearBeds
from modelling.errors import InputError, unknown
from modelling.linear.steady_motion import torques_of
from modelling.recordings.read import read_signals
from modelling.simulation.stepping import SimulationError
from modelling.system import Sensor, System
from modelling.toml import no_pipe
from modelling.units import to_si

GRAVITY = 9.81  # m/s²


@dataclass(frozen=True)
class Driver:
    """A driver: PI on the vehicle's speed, which gives the torque of one input, and with brakes pulls these below 0.

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


def driven_along(
    profile: SpeedProfile, driver: Driver, vehicle: System, loop: Loop, bodies: Sequence[str], radius: float,
    turning: Mapping[str, float],
) -> dict[str, RecordedTorque]:  # fmt: skip
    """Torques by input, less those of the vehicle's operating point, with which a driver follows a profile.

    The driver sits in the nonlinear vehicle; grades act on its bodies. What comes out is played to vehicle and bed
    alike.

    Parameters
    ----------
    vehicle : System
        At the operating point where the profile begins, at rest at standstill.
    bodies : sequence of str
        Inertias whose mean speed is the vehicle's; ``radius`` (m) is that of the tyres.
    turning : mapping of str to float
        Speed of every inertia of the vehicle in motion, rad/s: how the torque of a driver is shared among brakes; empty
        without any.

    Raises
    ------
    InputError
        If the road climbs and nothing acts on the bodies.
    SimulationError
        If the vehicle's motion grows out of bounds.
    """
    step = loop["sample_time"]
    time = np.arange(round(float(profile.time[-1]) / step) + 1) * step
    wanted = np.interp(time, profile.time, profile.speed) / radius
    torques = _of_grade(np.interp(time, profile.time, profile.grade), vehicle, bodies, radius)
    sensors = tuple(Sensor(f"driven_speed_{name}", "speed", name) for name in bodies)
    beds = NonlinearBeds([replace(vehicle, sensors=(*vehicle.sensors, *sensors))], loop)
    rows = [beds.model.sensors.index(sensor.name) for sensor in sensors]
    begin, trim = float(beds.steady[rows].mean()), torques_of(vehicle)[driver.input]
    acting = np.zeros((len(time), len(beds.drives), 1))
    for name, torque in torques.items():
        acting[:, beds.drives.index(name), 0] = torque
    own, integral, x = beds.drives.index(driver.input), trim, beds.start
    on = {part.name: part.on for part in vehicle.inputs}
    braked = {
        beds.drives.index(name): turning[on[driver.input]] / turning[on[name]] / len(driver.brakes)
        for name in driver.brakes
    }
    for n in range(len(time)):
        error = wanted[n] - begin - float(beds.read(x, acting[n])[rows].mean())
        asked = driver.proportional * error + integral
        given = float(np.clip(asked, -driver.largest, driver.largest))
        integral += driver.integral * step * error if given == asked else 0.0
        acting[n:, own, 0] = (max(given, 0.0) if braked else given) - trim
        for number, ratio in braked.items():
            acting[n:, number, 0] = max(-given, 0.0) * abs(ratio)
        x = beds.advance(x, np.zeros((0, 1)), acting[n], acting[n])
        if not np.isfinite(x).all():
            raise SimulationError("drives", f"the vehicle's motion grows out of bounds at {time[n]:g} s", "check it")
    torques |= {name: acting[:, beds.drives.index(name), 0] for name in (driver.input, *driver.brakes)}
    return {name: RecordedTorque.of(time, torque) for name, torque in torques.items()}


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
