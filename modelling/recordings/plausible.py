"""Whether a recording can be what its header says: time in that unit, torque and speed in their columns, any motion."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from modelling import units
from modelling.errors import InputError
from modelling.recordings.channel_faults import hold_each_other
from modelling.system import System
from modelling.topology import joints, side, speed_ratios

# --- A drivetrain as one rigid body: its inertia, and torque and speed of a recording, all at the shaft of one sensor.


@dataclass(frozen=True)
class RigidBody:
    """Inertia (kg·m²), torque (t,) (N·m) and speed (t,) (rad/s) at one shaft, and how often time divides the speed's
    change: once where the speed was recorded, twice where it comes from an angle."""

    inertia: float
    torque: np.ndarray
    speed: np.ndarray
    order: int


def as_one_rigid_body(time: np.ndarray, channels: Mapping[str, np.ndarray], system: System) -> Iterator[RigidBody]:
    """One for each recorded speed or angle of an inertia, channels (t,) at times (t,) in s; complete ones alone.

    None with a gearbox: nobody recorded the torque that its clutches pass on.
    """
    if system.gearboxes:
        return
    for sensor in system.sensors:
        if sensor.measures not in ("speed", "angle") or sensor.name not in channels:
            continue
        ratios = speed_ratios(sensor.of, joints(system))
        inertia = sum(part.J.value * ratios[part.name] ** 2 for part in system.inertias if part.name in ratios)
        motion = channels[sensor.name]
        if inertia <= 0 or not np.isfinite(motion).all():
            continue
        order = 1 if sensor.measures == "speed" else 2
        speed = motion if order == 1 else np.gradient(motion, time)
        torque = 0 * time
        for part in (part for part in system.inputs if part.on in ratios):
            acting, own = channels[part.name], system.pedals.get(part.name)
            torque += ratios[part.on] * (acting if own is None else own.torques_at(ratios[part.on] * speed, acting))
        yield RigidBody(inertia, torque, speed, order)


# --- Whether a column of time can be in the unit it is read in: by the model's frequencies, and by the recorded motion.

SHORTER_UNITS = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}  # s
LONGER_UNITS = {"min": 60.0, "h": 3600.0}  # s
NEARLY = 3.0  # a stated unit is doubted where the factor to another one fits within so much
LONGEST_STEP = 1.0  # s: sampled more slowly, no drivetrain shows how it moves
CERTAIN = 5.0  # standard errors at least of the inertia that the recording shows
BLOCKS = (20, 60, 200)  # parts of a recording over which the momentum is balanced
BETWEEN_UNITS = math.sqrt(1e3)  # a factor nearer to another unit's than to one


def check_seconds(
    time: np.ndarray, channels: Mapping[str, np.ndarray], system: System, source: str, stated: str
) -> list[str]:
    """Check that times (t,) in s fit the model and what was recorded with them, channels (t,) in SI.

    Parameters
    ----------
    stated : str
        The unit that the file states; empty: they were read as seconds.

    Returns
    -------
    list of str
        A note where the motion looks as if times were in minutes or hours: an inertia may be wrong as well.

    Raises
    ------
    InputError
        If the recorded torques accelerate the inertias a thousand times faster or more than the recorded motion says.
        Without a stated unit also if the steps are too long to show the model's slowest shaft, or if nothing tells and
        a step is a second or more. Names the unit that fits.
    """
    step = float(np.median(np.diff(time)))
    where, has = f"{source}: column 'time'", f"is in {stated}" if stated else "has no unit"
    frequencies = _shaft_frequencies(system)
    if not stated and frequencies and step > 0.5 / min(frequencies):
        for unit, seconds in SHORTER_UNITS.items():
            if step * seconds <= 0.5 / min(frequencies):
                reason = f"steps of {step:g} s cannot show the model's {min(frequencies):.3g} Hz"
                raise InputError(where, f"{has}, and {reason}", _remedy(unit, stated))
    factor, scale = _time_factor(time, channels, system), _seconds(stated)
    near = NEARLY if stated else BETWEEN_UNITS
    if factor is not None:
        for unit, seconds in SHORTER_UNITS.items():
            if 1 / near < factor * seconds < near:
                reason = f"read so, the inertias follow their torques some {1 / seconds:g} times too slowly"
                raise InputError(where, f"{has}, and {reason}", _remedy(_unit_of(seconds * scale, unit), stated))
        for unit, seconds in LONGER_UNITS.items():
            if 1 / NEARLY < factor * seconds < NEARLY and factor < _least_held(channels, system) / NEARLY:
                return [
                    f"time {has}; read so, the inertias follow their torques some {seconds:g} times too fast: "
                    f"is it in {unit}, or is an inertia of the model wrong?"
                ]
    elif not stated and step >= LONGEST_STEP:
        right = "write its unit: 'time [s]', 'time [ms]' or 'time [us]'"
        raise InputError(where, f"{has}, and steps of {step:g} s are long for a drivetrain", right)
    return []


def _least_held(channels: Mapping[str, np.ndarray], system: System) -> float:
    """Least share of the whole inertia that turns with a recorded one: a wheel that spins leaves the car behind."""
    apart = {place for effect in system.effects if effect.law.slips for place in effect.places}
    shares = [1.0]
    for sensor in system.sensors:
        if sensor.measures in ("speed", "angle") and sensor.name in channels:
            ratios = speed_ratios(sensor.of, joints(system))
            held = side(sensor.of, joints(system, without=apart))
            sizes = {
                part.name: part.J.value * ratios[part.name] ** 2 for part in system.inertias if part.name in ratios
            }
            shares.append(sum(size for name, size in sizes.items() if name in held) / sum(sizes.values()))
    return min(shares)


def _seconds(unit: str) -> float:
    """Size of a unit of time in s."""
    return units.factor(unit, "s") if unit else 1.0


def _unit_of(seconds: float, otherwise: str) -> str:
    """The unit of a size in s."""
    return next((unit for unit, size in SHORTER_UNITS.items() if abs(size / seconds - 1) < 1e-6), otherwise)


def _remedy(unit: str, stated: str) -> str:
    if stated:
        return f"it is probably in {unit}: write 'time [{unit}]', or correct the inertias of the model"
    return f"it is probably in {unit}: write 'time [{unit}]' (or 'time [s]' if it is in seconds)"


def _shaft_frequencies(system: System) -> list[float]:
    """Frequency in Hz of each shaft with its two inertias alone, √(k·(1/J₁ + 1/J₂))/2π.

    It is never below the lowest mode of the drivetrain, and near enough to it to tell milliseconds from seconds.
    """
    inertias = {part.name: part.J.value for part in system.inertias}
    frequencies = []
    for shaft in system.shafts:
        first, second = (inertias.get(name, 0.0) for name in shaft.between)
        if first > 0 and second > 0 and shaft.stiffness.value > 0:
            first *= shaft.ratio.value**2 if shaft.ratio else 1.0  # reflected to the second's side
            frequencies.append(math.sqrt(shaft.stiffness.value * (1 / first + 1 / second)) / (2 * math.pi))
    return frequencies


def _time_factor(time: np.ndarray, channels: Mapping[str, np.ndarray], system: System) -> float | None:
    """How many times too long the recorded times are for the motion; None where nothing tells.

    The balance of momentum of the whole drivetrain as one rigid body, over parts of the recording: the integral of the
    torques is inertia times change of speed plus viscous, dry and constant torque. Where time is too long by a factor,
    so are the integral and with it the fitted inertia; with speeds from angles, by the factor's square.
    """
    best, factor = CERTAIN, None
    for body in as_one_rigid_body(time, channels, system):
        for count in BLOCKS:
            inertia, certainty = _fitted_inertia(time, body.torque, body.speed, count)
            if certainty > best and inertia > 0:
                best, factor = certainty, (inertia / body.inertia) ** (1 / body.order)
    return factor


def _fitted_inertia(time: np.ndarray, torque: np.ndarray, speed: np.ndarray, count: int) -> tuple[float, float]:
    """Inertia (kg·m²) that speeds and torques (t,) show over ``count`` parts, and over its standard error."""
    width = len(time) // (count + 1)
    if width < 3:
        return 0.0, 0.0
    steps = np.diff(time)

    def integral(values: np.ndarray) -> np.ndarray:
        return np.append(0.0, np.cumsum(0.5 * (values[1:] + values[:-1]) * steps))

    ends = np.arange(0, width * (count + 1), width)
    columns = [np.diff(speed[ends]), np.diff(integral(speed)[ends]), np.diff(integral(np.sign(speed))[ends])]
    columns.append(np.diff(time[ends]))
    matrix = np.stack([column / (np.linalg.norm(column) or 1.0) for column in columns], axis=1)
    impulse = np.diff(integral(torque)[ends])
    solution, _, rank, _ = np.linalg.lstsq(matrix, impulse, rcond=1e-9)
    free = len(impulse) - rank
    norm = float(np.linalg.norm(columns[0]))
    if free < 5 or norm == 0:
        return 0.0, 0.0
    residual = impulse - matrix @ solution
    error = math.sqrt(float(residual @ residual) / free * float(np.linalg.pinv(matrix.T @ matrix)[0, 0]))
    return float(solution[0]) / norm, float(solution[0]) / error if error > 0 else math.inf


# --- Columns of torque and speed that are exchanged.

EXCHANGED = 2.0  # the inertia that exchanged columns show is the model's within this factor
STANDS = 5.0  # where it is within this factor as the columns stand, nothing is exchanged
CLEARLY = 4 * CERTAIN  # standard errors of that inertia


def check_columns(time: np.ndarray, channels: Mapping[str, np.ndarray], system: System, source: str) -> None:
    """Check that no column of torque holds a speed, and the other way round.

    Torque accelerates the inertias of the model. If it does so only with two columns exchanged, they are.

    Raises
    ------
    InputError
        Naming the two columns.
    """
    for part in system.inputs:
        for sensor in system.sensors:
            if sensor.measures != "speed" or part.measures not in (None, "torque"):
                continue
            if part.name not in channels or sensor.name not in channels:
                continue
            turned = {**channels, part.name: channels[sensor.name], sensor.name: channels[part.name]}
            kept = {sensor.name, *(each.name for each in system.inputs)}
            alone = ({name: each[name] for name in kept & {*each}} for each in (channels, turned))
            as_is, other = (_shown_inertia(time, each, system) for each in alone)
            stands = as_is[1] > CERTAIN and 1 / STANDS < as_is[0] < STANDS
            if not stands and other[1] > CLEARLY and 1 / EXCHANGED < other[0] < EXCHANGED:
                raise hold_each_other(source, part.name, sensor.name, "accelerate the model's inertias as its J says")


def _shown_inertia(time: np.ndarray, channels: Mapping[str, np.ndarray], system: System) -> tuple[float, float]:
    """The inertia that channels (t,) show over that of the model, and over its standard error; the most certain one."""
    found = [(0.0, 0.0)]
    for body in as_one_rigid_body(time, channels, system):
        for count in BLOCKS:
            inertia, certainty = _fitted_inertia(time, body.torque, body.speed, count)
            found.append((inertia / body.inertia, certainty))
    return max(found, key=lambda each: each[1])


# --- Pedals.

PEDAL_NOISE = 0.2  # beyond the ends of a pedal: noise, or a zero that is off


def check_pedals(system: System, time: np.ndarray, inputs: Mapping[str, np.ndarray], source: str = "") -> None:
    """Check that pedals (t,) at times (t,) in s lie between 0 and 1.

    Raises
    ------
    InputError
        If one does not, as a pedal in per cent, or a torque.
    """
    for name in system.pedals:
        pedal = inputs.get(name)
        if pedal is None:
            continue
        beyond = np.flatnonzero((pedal < -PEDAL_NOISE) | (pedal > 1 + PEDAL_NOISE))
        if len(beyond):
            raise InputError(
                f"{source}: column {name!r}" if source else f"inputs.{name}",
                f"is {pedal[beyond[0]]:.4g} at {time[beyond[0]]:g} s: a pedal is 0 to 1",
                f"give it as a share, or with its unit: {name} [%]",
            )


# --- A recording in which nothing moves.

WITHIN_NOISE = 3.0  # times its uncertainty: a sensor whose readings spread by less shows no motion


def stands_still(channels: Mapping[str, np.ndarray], system: System) -> bool:
    """Whether no recorded sensor shows any motion: each is constant, or within its noise, and each speed is 0."""
    recorded = [sensor for sensor in system.sensors if sensor.name in channels]
    for sensor in recorded:
        values = channels[sensor.name][np.isfinite(channels[sensor.name])]
        spread = float(np.std(values)) if len(values) else 0.0
        rounding = 1e-12 * float(np.abs(values).max(initial=0.0))
        if spread > max(WITHIN_NOISE * (sensor.uncertainty or 0.0), rounding):
            return False
        turns = sensor.measures == "speed" and len(values)
        if turns and abs(values.mean()) > max(WITHIN_NOISE * (sensor.uncertainty or 0.0), spread):
            return False
    return bool(recorded)


def torque_changes(channels: Mapping[str, np.ndarray], system: System) -> bool:
    """Whether any input varies."""
    return any(np.ptp(channels[part.name]) > 0 for part in system.inputs if part.name in channels)


def standstill_notes(channels: Mapping[str, np.ndarray], system: System) -> list[str]:
    """A note of a recording in which no sensor shows any motion."""
    if not stands_still(channels, system):
        return []
    names = ", ".join(sensor.name for sensor in system.sensors if sensor.name in channels)
    if not torque_changes(channels, system):
        return [f"nothing moves: no input changes, and {names} stay within their noise"]
    return [f"nothing moves although inputs act: {names} stay within their noise; are the sensors connected?"]


def check_motion(channels: Mapping[str, np.ndarray], system: System, source: str) -> None:
    """Check that a recording shows something of the model.

    Raises
    ------
    InputError
        If no input changes and no sensor shows any motion.
    """
    if stands_still(channels, system) and not torque_changes(channels, system):
        raise InputError(
            source, "nothing moves in it: no input changes, and every sensor stays within its noise",
            "record a motion: torque steps, a sweep, or a roll-out",
        )  # fmt: skip
