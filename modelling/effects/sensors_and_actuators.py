"""Faults of channels: gains, offsets, drifts, lags and delays of sensors and inputs, clocks of loggers."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial

import numpy as np
from sympy import Max, Min, pi, sin, sqrt

from modelling.effects.effect import (
    LONG_DELAYS,
    SECOND_STATE,
    SHORT_DELAYS,
    Change,
    Drivetrain,
    EquationBuilder,
    FittedMotion,
    Guess,
    InputPath,
    Kind,
    Parameter,
    RecordedRange,
    SensorPath,
    State,
    Symbols,
    delays_near,
    first_delays,
    fixed_delays,
    if_positive,
    late,
    members,
    shared_place,
)

# --- The delay of a sensor as a linear model holds it: an all-pass of second order.


class AllPass(Kind):
    """Two equal all-passes in a row, ((1 − s·delay/4)/(1 + s·delay/4))², in place of exp(−s·delay).

    Its gain is 1 at all frequencies and its phase −4·arctan(ω·delay/4), which is off by (ω·delay)³/48 rad: 0.002 rad at
    30 Hz for 2.5 ms. A case turns ``sensor_delay`` into it, for control design and simulation need states.
    """

    kind = "all_pass"
    words = "reads {delay} late (all-pass of second order)"
    in_recording = "this channel alone is late by the same time at all frequencies; no other channel is off."
    tables = ("sensors",)
    parameters = {"delay": Parameter("s", lower=1e-7)}
    shareable = True
    state = State("signal", "{place} behind the first half of its delay", settles=True)
    second_state = "{place} behind both halves of its delay"
    linear = True
    sought = False  # a diagnosis looks for ``sensor_delay``

    def sensor(self, path: SensorPath, p: Symbols, assembly: EquationBuilder) -> None:
        for name in (f"{path.place}.{self.kind}", f"{path.place}.{self.kind}{SECOND_STATE}"):
            value = path.value
            lagged = assembly.add_state(name, lambda z, value=value: 4 * (value - z) / p["delay"])  # type: ignore[misc]
            path.value = 2 * lagged - value


# --- The zero of an angle sensor.


class AngleZero(Kind):
    """Reads ``zero`` (rad) where the angle is 0; an encoder starts anywhere, in every recording anew.

    A fit estimates the zeros of angle sensors anyway, one for every recording; no diagnosis names them as a cause.
    """

    kind = "angle_zero"
    words = "reads {zero} where the angle is zero"
    in_recording = "a constant difference between two angles, another one in every recording; nothing is wrong."
    tables = ("sensors",)
    parameters = {"zero": Parameter("rad")}

    def sensor(self, path: SensorPath, p: Symbols, assembly: EquationBuilder) -> None:
        path.value += p["zero"]

    def guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        yield from ()

    def places(self, system: Drivetrain) -> list[str]:
        return [f"sensors.{sensor.name}" for sensor in system.sensors if sensor.measures == "angle"]


# --- By how many seconds a channel is recorded late, whatever the kind of effect that says so.

LATE_SIGN = {"clock_offset": 1.0, "sensor_delay": 1.0, "dead_time": -1.0}  # an input that acts later is recorded early


def recorded_late(kind: str, time: float) -> float:
    """The time (s) by which the only parameter of a kind says that a channel is recorded late; negative if early."""
    return LATE_SIGN[kind] * time


def known_offsets(value: Mapping[str, float]) -> Iterator[float]:
    """Times (s) by which channels of a model are recorded late, from its quantities by full name."""
    for name, time in value.items():
        kind = name.split(".")[-2] if "." in name else ""
        if kind in LATE_SIGN:
            yield recorded_late(kind, time)


# --- The clock of a logger that is ahead of or behind that of the others.

LEAST_STEPS = 0.5  # sampling steps of an offset that a further channel may share


class ClockOffset(Kind):
    """All channels of a logger are stamped ``offset`` (s) too late: they show what was that long ago.

    A sensor then reads the past; an input has acted earlier than recorded. A negative offset is a clock that is behind.
    """

    kind = "clock_offset"
    words = "is recorded with a clock that is {offset} late"
    in_recording = "all channels of one logger come by the same time too late or too early beside the others."
    tables = ("inputs", "sensors")
    parameters = {"offset": Parameter("s")}
    shareable = True
    is_clock = True

    def input(self, path: InputPath, p: Symbols, assembly: EquationBuilder) -> None:
        path.delay -= p["offset"]

    def sensor(self, path: SensorPath, p: Symbols, assembly: EquationBuilder) -> None:
        path.delay += p["offset"]

    def guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        """Of one channel that shares a known offset: an input that is recorded late, or a sensor that is early.

        A sensor that is late has a delay, an input that is early a dead time; these are looked for as such.
        """
        table = at.split(".")[0]
        for offset in known_offsets(motion.value):
            if abs(offset) > LEAST_STEPS * motion.step and (offset > 0) == (table == "inputs"):
                change = late(motion, at)(-offset if table == "inputs" else offset)
                yield Guess((change,), _fixed(offset))

    def shared_guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        """Early sensors; late ones too where the group is that of all sensors; of one channel, :meth:`guesses`.

        Late sensors of one quantity are those of a shared delay, which is looked for as such.
        """
        if len(members(at)) < 2:
            yield from self.guesses(motion, at)
            return
        for early in SHORT_DELAYS:
            yield Guess((late(motion, at)(-early),), _scaled(-early))
        yield from fixed_delays(motion, _stamped_early(motion, at), "offset", LONG_DELAYS, -1.0)
        if len(members(at)) == len(motion.reading):
            yield from first_delays(motion, late(motion, at), "offset")

    def nearby(self, motion: FittedMotion, at: str, best: dict[str, float]) -> Iterator[Guess]:
        offset = best["offset"]
        change = late(motion, at) if offset > 0 else _stamped_early(motion, at)
        return delays_near(motion, change, "offset", offset, math.copysign(1.0, offset))

    def fit_bounds(self, key: str, guess: float, step: float) -> tuple[float, float]:
        """Early stays early, late stays late."""
        return (0.0, math.inf) if guess > 0 else (-math.inf, 0.0)

    def recorded_bounds(self, key: str, at: str, recorded: RecordedRange) -> tuple[float, float]:
        return -recorded.longest_memory, recorded.longest_memory

    def shared_places(self, system: Drivetrain) -> list[str]:
        """The sensors of each quantity, as loggers divide channels, and all sensors where there are several inputs.

        That of all sensors is that of all inputs with the opposite sign; of a single input it is a dead time.
        """
        groups: dict[str, list[str]] = {}
        for sensor in system.sensors:
            groups.setdefault(sensor.measures, []).append(f"sensors.{sensor.name}")
        several = [group for group in groups.values() if len(group) > 1] if len(groups) > 1 else []
        if len(list(system.inputs)) > 1 and sum(len(group) for group in groups.values()) > 1:
            several.append([place for group in groups.values() for place in group])
        return [shared_place(group) for group in several]


def _stamped_early(motion: FittedMotion, at: str) -> Change:
    """What sensors read more when their clock is early by so much."""
    change = late(motion, at)
    return lambda early: change(-early)


def _fixed(offset: float) -> Callable[[np.ndarray], dict[str, float] | None]:
    return lambda a: {"offset": offset} if a[0] > 0 else None


def _scaled(offset: float) -> Callable[[np.ndarray], dict[str, float] | None]:
    return lambda a: {"offset": offset * float(a[0])} if a[0] > 0 else None


# --- An input that acts with a delay.


class DeadTime(Kind):
    """Acts ``delay`` (s) later than recorded."""

    kind = "dead_time"
    words = "acts {delay} later than recorded"
    in_recording = "every response begins later by the same time; the phase falls in proportion to frequency."
    tables = ("inputs",)
    parameters = {"delay": Parameter("s", lower=0.0)}
    only_delays = True
    shareable = True

    def input(self, path: InputPath, p: Symbols, assembly: EquationBuilder) -> None:
        path.delay += p["delay"]

    def guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        yield from first_delays(motion, late(motion, at), "delay")

    def nearby(self, motion: FittedMotion, at: str, best: dict[str, float]) -> Iterator[Guess]:
        return delays_near(motion, late(motion, at), "delay", best["delay"])

    def recorded_bounds(self, key: str, at: str, recorded: RecordedRange) -> tuple[float, float]:
        return 0.0, recorded.longest_memory


# --- An input with a wrong scale factor.


class InputGain(Kind):
    """Acts with ``factor`` times the recorded value."""

    kind = "input_gain"
    words = "acts with {factor} times the recorded value"
    in_recording = "all responses to this input are too large or too small by one factor, whatever the frequency."
    tables = ("inputs",)
    parameters = {"factor": Parameter("1")}
    shareable = True
    linear = True

    def input(self, path: InputPath, p: Symbols, assembly: EquationBuilder) -> None:
        path.value *= p["factor"]

    def guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        yield Guess(({at: motion.input[at.split(".")[1]]},), lambda a: {"factor": 1 + float(a[0])})


# --- An input with a constant error.


class InputOffset(Kind):
    """Acts with ``offset`` (N·m) more than recorded.

    No recording tells it from a constant torque on the inertia of the input, with the opposite sign: a diagnosis looks
    for that, and names both.
    """

    kind = "input_offset"
    words = "acts with {offset} more than recorded"
    in_recording = "the motion drifts to one side though the recorded torque has none, as under a constant torque."
    tables = ("inputs",)
    zero_of_recording = True
    parameters = {"offset": Parameter("N*m")}
    sought = False

    def input(self, path: InputPath, p: Symbols, assembly: EquationBuilder) -> None:
        path.value += p["offset"]

    def guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        yield Guess(({at: motion.time * 0 + 1.0},), lambda a: {"offset": float(a[0])})


# --- First-order lag of an input or a sensor.


class Lag(Kind):
    """First-order lag with ``time_constant`` (s)."""

    kind = "lag"
    words = "follows with a first-order lag of {time_constant}"
    in_recording = "edges are rounded; amplitude falls and phase lags above 1/(2π·time constant)."
    tables = ("inputs", "sensors")
    parameters = {"time_constant": Parameter("s", lower=1e-7)}
    shareable = True
    state = State("signal", "{place} behind its lag", settles=True)
    linear = True

    def input(self, path: InputPath | SensorPath, p: Symbols, assembly: EquationBuilder) -> None:
        value = path.value
        path.value = assembly.add_state(
            f"{path.place}.{self.kind}", lambda lagged: (value - lagged) / p["time_constant"]
        )

    def sensor(self, path: SensorPath, p: Symbols, assembly: EquationBuilder) -> None:
        at_once = path.value.subs(assembly.time, 0)
        ramp = path.value - at_once
        path.value = at_once
        self.input(path, p, assembly)
        path.value += ramp.subs(assembly.time, assembly.time - p["time_constant"])  # a drift, after the lag has settled

    def guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        signal = motion.signal(at)
        for time_constant in (1e-3, 4e-3, 1.6e-2, 6.4e-2):
            yield Guess(
                ({at: motion.lagged(signal, time_constant) - signal},), if_positive("time_constant", time_constant)
            )

    def fit_bounds(self, key: str, guess: float, step: float) -> tuple[float, float]:
        return (0.25 * step, max(20 * guess, step))

    def recorded_bounds(self, key: str, at: str, recorded: RecordedRange) -> tuple[float, float]:
        return 0.0, recorded.longest_memory


# --- An actuator that is at its limit.

LIMITS = (0.5, 0.7, 0.85, 0.95)  # of the largest value, that are tried


class Saturation(Kind):
    """Acts with the recorded value, at most ``limit`` (N·m) either way."""

    kind = "saturation"
    words = "acts with {limit} at most"
    in_recording = "responses are too small where this input is large, and right where it is not."
    tables = ("inputs",)
    parameters = {"limit": Parameter("N*m", lower=0.0)}

    def input(self, path: InputPath, p: Symbols, assembly: EquationBuilder) -> None:
        path.value = Max(-p["limit"], Min(p["limit"], path.value))

    def guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        yield from self._at(motion, at, LIMITS)

    def nearby(self, motion: FittedMotion, at: str, best: dict[str, float]) -> Iterator[Guess]:
        largest = float(np.abs(motion.signal(at)).max())
        return self._at(motion, at, best["limit"] / largest * np.linspace(0.85, 1.15, 13))

    def _at(self, motion: FittedMotion, at: str, shares: Iterable[float]) -> Iterator[Guess]:
        signal = motion.signal(at)
        for limit in np.abs(signal).max(initial=0.0) * np.array(list(shares)):
            if limit > 0:
                yield Guess(({at: np.clip(signal, -limit, limit) - signal},), _known("limit", float(limit)))

    def recorded_bounds(self, key: str, at: str, recorded: RecordedRange) -> tuple[float, float]:
        return 0.0, recorded.input_torque


def _known(key: str, value: float) -> Callable[[np.ndarray], dict[str, float] | None]:
    """The parameter of a guess whose amplitude says nothing about it, but has to be near 1."""
    return lambda a: {key: value} if a[0] > LEAST_AMPLITUDE else None


LEAST_AMPLITUDE = 0.2


# --- An actuator whose torque cannot change as fast as it is asked to.


class RateLimit(Kind):
    """Acts with the recorded value, which changes by ``rate`` (N·m/s) at most."""

    kind = "rate_limit"
    words = "acts with a torque that changes by {rate} at most"
    in_recording = "steps of this input act as ramps of one slope, and large vibrations as triangles that lag."
    tables = ("inputs",)
    parameters = {"rate": Parameter("N*m/s", lower=1e-9)}
    rate_bound = "rate"
    looks_ahead = True
    abrupt = True
    state = State("signal", "{place} behind its rate limit", settles=True)

    def input(self, path: InputPath, p: Symbols, assembly: EquationBuilder) -> None:
        # where it may follow it does so within a short time, which is taken off the recording again; a simulation makes
        # that time so short that it changes no reading
        wanted, follows = path.value, assembly.follow_time
        path.delay -= follows
        path.value = assembly.add_state(
            f"{path.place}.{self.kind}", lambda z: Max(-p["rate"], Min(p["rate"], (wanted - z) / follows))
        )

    def guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        change = np.abs(motion.per_segment(lambda t, s: np.gradient(s, t), motion.signal(at)))
        yield from self._at(motion, at, float(np.quantile(change, 0.99)) * np.array([0.1, 0.25, 0.5, 0.8]))

    def nearby(self, motion: FittedMotion, at: str, best: dict[str, float]) -> Iterator[Guess]:
        return self._at(motion, at, best["rate"] * np.geomspace(0.6, 1.7, 9))

    def _at(self, motion: FittedMotion, at: str, rates: Iterable[float]) -> Iterator[Guess]:
        """Rates with which the signal gets through its range within the recording; of a signal that hardly ever
        changes, the quantiles of its rate are rounding."""
        signal = motion.signal(at)
        for rate in rates:
            if rate * float(np.ptp(motion.time)) > float(np.ptp(signal)) > 0:
                slow = motion.per_segment(partial(_followed, float(rate)), signal)
                yield Guess(({at: slow - signal},), _known("rate", float(rate)))


def _followed(rate: float, time: np.ndarray, signal: np.ndarray) -> np.ndarray:
    """A signal (t,) followed with so much change per second at most."""
    z = float(signal[0])
    out = [z]
    for wanted, most in zip(signal[1:].tolist(), (rate * np.diff(time)).tolist(), strict=True):
        change = wanted - z
        z = wanted if -most <= change <= most else z + (most if change > 0 else -most)
        out.append(z)
    return np.array(out)


# --- A motor whose torque constant falls with its current, as iron saturates.


class FallingTorqueConstant(Kind):
    """Acts with u/√(1 + (u/``torque``)²) where u is recorded: the constant has fallen by 29 % at that torque."""

    kind = "falling_torque_constant"
    words = "has a torque constant that falls with the current, by 29 % at {torque}"
    in_recording = "responses to large values of this input are too small, to small ones they are right."
    tables = ("inputs",)
    parameters = {"torque": Parameter("N*m", lower=1e-9)}

    def input(self, path: InputPath, p: Symbols, assembly: EquationBuilder) -> None:
        path.value = path.value / sqrt(1 + (path.value / p["torque"]) ** 2)

    def guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        signal = motion.signal(at)
        largest = float(np.abs(signal).max(initial=0.0))
        for share in (1.0, 2.0, 5.0) if largest > 0 else ():  # of the largest value
            torque = share * largest
            yield Guess(({at: signal / np.sqrt(1 + (signal / torque) ** 2) - signal},), partial(_falling, torque))


def _falling(torque: float, a: np.ndarray) -> dict[str, float] | None:
    """What is lost grows with the inverse square of the torque, nearly."""
    return {"torque": torque / math.sqrt(a[0])} if a[0] > 0 else None


# --- A sensor that reads with a delay.


class SensorDelay(Kind):
    """Reads the value of ``delay`` (s) ago."""

    kind = "sensor_delay"
    words = "reads {delay} late"
    in_recording = "this channel alone is late by the same time at all frequencies; no other channel is off."
    tables = ("sensors",)
    parameters = {"delay": Parameter("s", lower=0.0)}
    only_delays = True
    shareable = True

    def sensor(self, path: SensorPath, p: Symbols, assembly: EquationBuilder) -> None:
        path.delay += p["delay"]

    def guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        yield from first_delays(motion, late(motion, at), "delay")

    def nearby(self, motion: FittedMotion, at: str, best: dict[str, float]) -> Iterator[Guess]:
        return delays_near(motion, late(motion, at), "delay", best["delay"])

    def recorded_bounds(self, key: str, at: str, recorded: RecordedRange) -> tuple[float, float]:
        return 0.0, recorded.longest_memory


# --- A sensor whose zero drifts.


class SensorDrift(Kind):
    """Offset that grows with ``rate`` per second from the start of the recording."""

    kind = "sensor_drift"
    words = "drifts by {rate}"
    in_recording = "the difference to the model grows in a straight line with time, at standstill as well."
    tables = ("sensors",)
    parameters = {"rate": Parameter("sensor/s")}

    def sensor(self, path: SensorPath, p: Symbols, assembly: EquationBuilder) -> None:
        path.value += p["rate"] * assembly.time

    def guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        yield Guess(({at: motion.time},), lambda a: {"rate": float(a[0])})

    def recorded_bounds(self, key: str, at: str, recorded: RecordedRange) -> tuple[float, float]:
        fastest = recorded.width[at.split(".")[1]] / recorded.duration
        return -fastest, fastest


# --- A sensor with hum of the mains, or another steady line.


class Hum(Kind):
    """Reads amplitude·sin(2π·frequency·t + phase) besides, t from the start of the recording.

    The audit of the channels finds it and takes it off; no diagnosis looks for it as a cause.
    """

    kind = "hum"
    words = "reads a hum of {amplitude} at {frequency} besides"
    in_recording = "a line of one frequency that does not change with the motion, at standstill as well."
    tables = ("sensors",)
    parameters = {
        "amplitude": Parameter("sensor"), "frequency": Parameter("Hz", lower=0.0), "phase": Parameter("rad")
    }  # fmt: skip
    sought = False

    def sensor(self, path: SensorPath, p: Symbols, assembly: EquationBuilder) -> None:
        path.value += p["amplitude"] * sin(2 * pi * p["frequency"] * assembly.time + p["phase"])


# --- A sensor with a wrong scale factor.


class SensorGain(Kind):
    """Reads ``factor`` times the true value."""

    kind = "sensor_gain"
    words = "reads {factor} times the true value"
    in_recording = "this channel alone is off by one factor, also where the motion is slow."
    tables = ("sensors",)
    parameters = {"factor": Parameter("1")}
    shareable = True
    linear = True

    def sensor(self, path: SensorPath, p: Symbols, assembly: EquationBuilder) -> None:
        path.value *= p["factor"]

    def guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        yield Guess(({at: motion.reading[at.split(".")[1]]},), lambda a: {"factor": 1 + float(a[0])})


# --- Sensor offset


class SensorOffset(Kind):
    """Reads ``offset`` more than the true value."""

    kind = "sensor_offset"
    words = "reads {offset} too much"
    in_recording = "this channel alone differs by a constant, at standstill as well."
    tables = ("sensors",)
    parameters = {"offset": Parameter("sensor")}

    def sensor(self, path: SensorPath, p: Symbols, assembly: EquationBuilder) -> None:
        path.value += p["offset"]

    def guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        yield Guess(({at: motion.time * 0 + 1.0},), lambda a: {"offset": float(a[0])})

    def recorded_bounds(self, key: str, at: str, recorded: RecordedRange) -> tuple[float, float]:
        largest = recorded.largest_reading[at.split(".")[1]]
        return -largest, largest
