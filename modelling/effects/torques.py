"""Torques on an inertia, constant or over an angle; imposed motion; quantities that are not what the model states."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from functools import partial
from typing import Protocol

import numpy as np
import scipy
from sympy import Abs, And, Expr, Float, Integer, Max, Or, Piecewise, Rational, pi, sin

from modelling.effects.effect import (
    Drivetrain,
    EquationBuilder,
    FittedMotion,
    Guess,
    InputPath,
    Kind,
    Motion,
    Parameter,
    RecordedRange,
    State,
    Symbols,
    between,
    members,
    shared_place,
)
from modelling.effects.sensors_and_actuators import InputOffset

# --- A resisting torque that does not depend on motion (grade, offset load).


class ConstantTorque(Kind):
    """A constant ``torque`` against positive motion."""

    kind = "constant_torque"
    words = "bears a resisting torque of {torque} that does not depend on motion"
    in_recording = (
        "the speed that a constant motor torque holds is lower than the model's by the same torque in both "
        "directions of load, and at standstill the drive does not stay at rest."
    )
    tables = ("inertias",)
    zero_of_recording = True
    parameters = {"torque": Parameter("N*m")}
    speed_exponent = 0

    def inertia(self, motion: Motion, p: Symbols, assembly: EquationBuilder, name: str) -> None:
        assembly.add_torque(name, -p["torque"], motion)

    def guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        yield Guess(({at: -np.ones_like(motion.time)},), lambda a: {"torque": float(a[0])})

    def same_as(self, at: str, system: Drivetrain) -> list[tuple[str, str]]:
        """An offset of each input on the inertia, with the opposite sign."""
        return [(InputOffset.kind, f"inputs.{part.name}") for part in system.inputs if f"inertias.{part.on}" == at]

    def recorded_bounds(self, key: str, at: str, recorded: RecordedRange) -> tuple[float, float]:
        largest = recorded.torque[at.split(".")[1]]
        return -largest, largest


# --- A brake: dry friction whose torque an input gives.


class Brake(Kind):
    """The input is the torque (N·m, 0 or more) with which its inertia is braked, against its motion, and held at rest.

        torque = −u/deflection·(d + settling·ḋ),  ḋ = speed − |speed|·d/deflection,

    with the ``deflection`` (rad) through which pads and caliper give way before they slide under the full torque, and
    the time ``settling`` (s) with which they do so. A brake that is held does not creep: below its torque it is a
    spring, at speed dry friction.

    Source: the law of Dahl with a micro-damper, as in Canudas de Wit, Olsson, Åström, Lischinsky, A new model for
    control of systems with friction, IEEE TAC 40 (1995) 419 to 425, of one friction torque at all speeds.
    """

    kind = "brake"
    words = "brakes with the torque of the input, and gives way by {deflection} before it slides"
    in_recording = "speeds fall evenly to standstill while it is pulled, and stay there."
    tables = ("inputs",)
    parameters = {
        "deflection": Parameter("rad", lower=1e-4),
        "settling": Parameter("s", lower=0.0, optional=True),
    }
    state = State("rad", "deflection of the brake of {place}")
    state_dependent = True
    brakes = True
    sought = False  # whether an input is a brake is known

    def input(self, path: InputPath, p: Symbols, assembly: EquationBuilder) -> None:
        speed, name = assembly.motions[path.on].speed, f"{path.place}.{self.kind}"
        path.value *= -dry_friction(speed, p["deflection"], p.get("settling"), assembly, name)


SETTLING = 0.002  # s: a braked wheel that comes to rest swings once or twice


def dry_friction(speed: Expr, deflection: Expr, settling: Expr | None, assembly: EquationBuilder, state: str) -> Expr:
    """Dry friction against a sliding speed (rad/s) as a share of its torque: the law of :class:`Brake`.

    Parameters
    ----------
    deflection, settling : Expr
        rad, s; without ``settling`` it is :data:`SETTLING`.
    state : str
        Name of the state that it adds, the deflection.
    """

    def rate(d: Expr) -> Expr:
        return speed - Max(Abs(speed), assembly.creep) * d / deflection

    d = assembly.add_state(state, rate)
    return (d + (Float(SETTLING) if settling is None else settling) * rate(d)) / deflection


ENGAGING = 1e-3  # s: time constant with which a dog clutch is in or out, far below the 20 to 50 ms of its actuator


def dog(
    slip: Expr, asked: Expr, below: Expr, deflection: Expr, settling: Expr | None, assembly: EquationBuilder, state: str
) -> Expr:  # fmt: skip
    """Torque of a dog clutch as a share of what it is asked to carry: a spring and a damper once its teeth are in.

        share = e·(d + settling·slip)/deflection,  ḋ = e·slip − (1 − e)·d/T,  ė = (1 or 0 − e)/T

    e goes to 1 where it is asked for and the slip is below a bound, or it is in already; else to 0. It holds any
    torque.

    Parameters
    ----------
    slip, asked, below, deflection, settling : Expr
        rad/s, N·m, rad/s, rad, s; without ``settling`` it is :data:`SETTLING`.
    state : str
        Name of the deflection d, the first state that it adds; the second one is :data:`ENGAGED` behind it.
    """

    def rate(e: Expr) -> Expr:
        goes_in = And(asked > 0, Or(Abs(slip) < below, e > Rational(1, 2)))
        return (Piecewise((Integer(1), goes_in), (Integer(0), True)) - e) / Float(ENGAGING)

    e = assembly.add_state(f"{state}{ENGAGED}", rate)
    d = assembly.add_state(state, lambda d: e * slip - (1 - e) * d / Float(ENGAGING))
    return e * (d + (Float(SETTLING) if settling is None else settling) * slip) / deflection


ENGAGED = ".engaged"


class ConverterTables(Protocol):
    """The tables of a torque converter, see :class:`modelling.system.Converter`."""

    @property
    def speed_ratios(self) -> tuple[float, ...]:
        """Turbine speed over pump speed."""

    @property
    def capacity_factors(self) -> tuple[float, ...]:
        """N·m/(rad/s)²."""

    @property
    def torque_ratios(self) -> tuple[float, ...]:
        """Turbine torque over pump torque."""


SLOWEST_PUMP = 1e-3  # rad/s: below it the speed ratio is not formed, and the torque is none


def converted(pump: Expr, turbine: Expr, tables: ConverterTables) -> tuple[Expr, Expr]:
    """Torques of a torque converter at its pump, against it, and at its turbine, with it, for their speeds (rad/s)."""
    ratio = turbine * pump / Max(pump**2, Float(SLOWEST_PUMP**2))
    points, factors, gains = (
        [Float(value) for value in values]
        for values in (tables.speed_ratios, tables.capacity_factors, tables.torque_ratios)
    )
    torque = between(ratio, points, factors) * pump * Abs(pump)
    return torque, between(ratio, points, gains) * torque


# --- Torque that varies with the angle (cogging, torque ripple, universal joint).

MOST_ORDERS = 4  # that are tried from one spectrum, of its low orders and of its high ones
FEW_TURNS = 4 * np.pi  # rad; over less a spectrum is too coarse
GENTLE = 0.3  # share of a ripple with which its fit begins
CLOSE = 17  # orders that are tried within half a line of the best
SIDE_LOBES, FINEST_ORDER = 0.4, 0.002  # reach and smallest step of the orders tried near the best: 400 at the most
MOST_NEAR = 8  # of these are screened: the true one's neighbours promise nearly as much, its side lobes clearly less
LOWEST_ORDER = 0.4  # per turn, that is searched for: a period of several turns is that of another shaft
HIGHEST_ORDER = 100.0  # the same: above cogging, the least common multiple of slots and poles, 36 to 90
HIGHEST_FOLLOWED = 24.0  # over another shaft's angle, and where all orders are tried: above joints, teeth and pulses


class TorqueRipple(Kind):
    """amplitude·sin(order·angle + phase), driving."""

    kind = "torque_ripple"
    words = "has a torque ripple of {amplitude} with order {order} per turn"
    in_recording = "an oscillation whose frequency follows the speed: a slanted line in a plot of spectra over speed."
    tables = ("inertias",)
    parameters = {"order": Parameter("1", lower=0.0), "amplitude": Parameter("N*m"), "phase": Parameter("rad")}
    state_dependent = True
    zero_mean = ("amplitude",)

    def inertia(self, motion: Motion, p: Symbols, assembly: EquationBuilder, name: str) -> None:
        assembly.add_torque(name, p["amplitude"] * sin(p["order"] * motion.angle + p["phase"]), motion)

    def guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        name = at.split(".")[1]
        for order, chosen_from in _orders(motion, name, name):
            yield _ripple_guess(at, motion.angle[name], order, (1,), chosen_from)

    def nearby(self, motion: FittedMotion, at: str, best: dict[str, float]) -> Iterator[Guess]:
        angle = motion.angle[at.split(".")[1]]
        for order in orders_near(angle, best["order"], motion.torque_gradient[at.split(".")[1]]):
            yield _ripple_guess(at, angle, order, (1,))

    def fit_bounds(self, key: str, guess: float, step: float) -> tuple[float, float]:
        return (max(guess - 0.3, LOWEST_ORDER), guess + 0.3) if key == "order" else super().fit_bounds(key, guess, step)

    def canonical(self, parameters: dict[str, float]) -> dict[str, float]:
        shift = math.pi if parameters["amplitude"] < 0 else 0.0
        phase = math.remainder(parameters["phase"] + shift, 2 * math.pi)
        return parameters | {"amplitude": abs(parameters["amplitude"]), "phase": phase}

    def akin(
        self, at: str, parameters: Mapping[str, float], motion: FittedMotion
    ) -> Iterator[tuple[str, str, dict[str, float]]]:
        """A ripple of that order over another shaft's angle."""
        return _over_other_angles(at, at.split(".")[1], parameters, motion)

    def recorded_bounds(self, key: str, at: str, recorded: RecordedRange) -> tuple[float, float]:
        name = at.split(".")[1]
        if key == "order":
            return recorded.lowest_order(name), math.inf
        return (-math.inf, recorded.torque[name]) if key == "amplitude" else (-math.inf, math.inf)


def _over_other_angles(
    place: str, over: str, parameters: Mapping[str, float], motion: FittedMotion
) -> Iterator[tuple[str, str, dict[str, float]]]:
    """The ripple on an inertia over other angles than that of ``over``: of those that can be told from it, those that
    leave a fixed ratio to it most first."""
    own, found = motion.angle[over], list[tuple[float, str, str, dict[str, float]]]()
    for other, angle in motion.angle.items():
        if other == over or not np.ptp(angle) > 0:
            continue
        ratio, lag = _parting(own, angle)
        if parameters["order"] * lag < TOLD_APART:
            continue
        wave = {"order": parameters["order"] * abs(ratio), "amplitude": math.copysign(parameters["amplitude"], ratio)}
        wave["phase"] = math.copysign(1.0, ratio) * parameters["phase"]
        on = f"inertias.{other}"
        kind, at = (TorqueRipple.kind, place) if on == place else (GearedRipple.kind, shared_place((place, on)))
        found.append((lag, kind, at, wave))
    yield from ((kind, at, wave) for _, kind, at, wave in sorted(found, key=lambda one: -one[0]))


def wave_parameters(order: float, a: np.ndarray) -> dict[str, float]:
    """Parameters of a ripple for the amplitudes a (2,) of sine and cosine."""
    return {"order": order, "amplitude": float(np.hypot(*a)), "phase": float(np.arctan2(a[1], a[0]))}


def _orders(motion: FittedMotion, name: str, over: str) -> Iterator[tuple[float, float]]:
    """Orders over the angle of an inertia that stand out of the torque on another.

    Of its gradient: a matched filter finds what is near the noise. Of the torque that is lacking: through a resonance
    the readings answer most where an order meets it, and that hides the order.
    """
    angle, highest = motion.angle[over], HIGHEST_ORDER if over == name else HIGHEST_FOLLOWED
    yield from outstanding_orders(angle, motion.torque_gradient[name], highest)
    if np.ptp(angle) >= FEW_TURNS:  # below, all orders are offered anyway
        yield from outstanding_orders(angle, motion.torque_lacking[name], highest)


def orders_near(angle: np.ndarray, best: float, gradient: np.ndarray) -> list[float]:
    """Of the orders near the best one, half a line apart, those that promise most by the gradient (t,) of χ²: a
    reversing motion gives the true one many side lobes. Next to the best they are closer: a ripple that holds a slow
    motion back leads a simulation astray where its phase is off."""
    span = float(np.ptp(angle))
    if span <= FEW_TURNS:
        return []
    apart = max(np.pi / span, FINEST_ORDER)
    near = np.concatenate([best + np.arange(-SIDE_LOBES, SIDE_LOBES, apart), best + np.linspace(-apart, apart, CLOSE)])
    promised = [abs(np.exp(1j * order * angle) @ gradient) for order in near]
    return near[np.argsort(promised)[: -MOST_NEAR - 1 : -1]].tolist()


def outstanding_orders(
    angle: np.ndarray, torque: np.ndarray, highest: float = HIGHEST_ORDER
) -> Iterator[tuple[float, float]]:
    """Orders up to a ``highest`` at which a torque over an angle stands out of its spectrum, and from how many each was
    chosen."""
    span = float(np.ptp(angle))
    if not 0.5 * np.pi < span < 1e6:
        return
    # an order that turns further than half a period a sample cannot be seen; some samples are slower than the mean
    highest = min(highest if span >= FEW_TURNS else HIGHEST_FOLLOWED, 4 * np.pi * len(angle) / span)
    if span < FEW_TURNS:  # too coarse a spectrum: all orders, half a spectral line apart
        yield from ((float(order), 1.0) for order in np.arange(np.pi / span, highest, np.pi / span))
        return
    # torque summed over bins of angle, then one FFT over angle; ten bins a period of the highest order
    width = 2 * np.pi / (10 * highest)
    length = 2 * int(span / width) + 2  # half of it zeros: orders twice as fine as the span resolves
    strength = np.abs(np.fft.rfft(np.bincount(((angle - angle.min()) / width).astype(int), torque, length)))
    orders = np.arange(len(strength)) / (length * width / (2 * np.pi))
    fine = orders[1]
    used = (orders > max(LOWEST_ORDER, 2 * fine)) & (orders <= highest)
    if not used.any():
        return
    orders, strength = orders[used], strength[used]
    level = scipy.ndimage.median_filter(strength, 2 * int(0.75 / fine) + 1, mode="reflect")
    outstanding = strength / (level + 1e-3 * strength.max() + 1e-300)
    low = orders <= HIGHEST_FOLLOWED
    for band in (low, ~low):  # high orders are many, and the best of their noise must not hide a low one
        left = np.where(band, outstanding, 0.0)
        for _ in range(MOST_ORDERS if band.any() else 0):
            best = int(np.argmax(left))
            yield float(orders[best]), max(int(band.sum()) / MOST_ORDERS, 1.0)
            left[abs(orders - orders[best]) < 3 * fine + 0.1] = 0.0


# --- Torque on one inertia that varies with the angle of another: teeth of a gear, pulses of an engine at the wheels.

SUFFIXES = {1: "", 2: "_2", 3: "_3"}  # of the harmonics' parameters
LEAST_LAG = 1.0  # rad of the ripple's phase, by which one angle has to leave a fixed ratio to the other; else a ripple
# over its own angle is the same torque, if that is one of an order that is looked for
TOLD_APART = 0.02  # rad of the same: the torque of a ripple is then another by 2 % of its amplitude
RIGID = 1e-6  # of an angle's range: what leaves a fixed ratio by less is joined by rigid gears


class GearedRipple(Kind):
    """Σ amplitude_k·sin(k·order·angle of the second inertia + phase_k), driving the first; pulses have harmonics."""

    kind = "geared_ripple"
    words = "has a torque ripple of {amplitude} with order {order} per turn of {second}"
    in_recording = "an oscillation whose frequency follows the speed of another shaft, also where the two speeds part."
    tables = ("inertias",)
    follows = True
    parameters = {
        "order": Parameter("1", lower=0.0), "amplitude": Parameter("N*m"), "phase": Parameter("rad"),
        "amplitude_2": Parameter("N*m", optional=True), "phase_2": Parameter("rad", optional=True),
        "amplitude_3": Parameter("N*m", optional=True), "phase_3": Parameter("rad", optional=True),
    }  # fmt: skip
    state_dependent = True
    zero_mean = ("amplitude", "amplitude_2", "amplitude_3")

    def inertia(self, motion: Motion, p: Symbols, assembly: EquationBuilder, name: str) -> None:
        first, second = members(name)
        angle = assembly.motions[second.split(".")[1]].angle
        for k, suffix in SUFFIXES.items():
            if f"amplitude{suffix}" in p:
                wave = sin(k * p["order"] * angle + p.get(f"phase{suffix}", 0))
                assembly.add_torque(first, p[f"amplitude{suffix}"] * wave, motion)

    def candidate_places(self, system: Drivetrain) -> list[str]:
        places = self.places(system)
        return [shared_place((first, second)) for first in places for second in places if first != second]

    def shared_guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        yield from self.guesses(motion, at)

    def guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        first, second = (place.split(".")[1] for place in members(at))
        angle = motion.angle[second]
        of_model = motion.model_angle or motion.angle
        ratio, lag = _parting(of_model[second], of_model[first])
        ratio = abs(ratio)
        if lag < RIGID * np.ptp(angle) or (HIGHEST_FOLLOWED * lag < LEAST_LAG and ratio >= 1):
            return
        for order, chosen_from in _orders(motion, first, second):
            if order * lag > LEAST_LAG or order * ratio < LOWEST_ORDER:
                yield _ripple_guess(members(at)[0], angle, order, (1,), chosen_from)

    def nearby(self, motion: FittedMotion, at: str, best: dict[str, float]) -> Iterator[Guess]:
        """Pulses of that order, and orders near the best one."""
        first, second = members(at)
        angle = motion.angle[second.split(".")[1]]
        yield _ripple_guess(first, angle, best["order"], tuple(SUFFIXES))
        for order in orders_near(angle, best["order"], motion.torque_gradient[first.split(".")[1]]):
            yield _ripple_guess(first, angle, order, (1,))

    def fit_bounds(self, key: str, guess: float, step: float) -> tuple[float, float]:
        return TorqueRipple().fit_bounds(key, guess, step) if key == "order" else (-math.inf, math.inf)

    def akin(
        self, at: str, parameters: Mapping[str, float], motion: FittedMotion
    ) -> Iterator[tuple[str, str, dict[str, float]]]:
        """A ripple of that order over the angle of its own inertia, or of a third one."""
        first, second = members(at)
        return _over_other_angles(first, second.split(".")[1], parameters, motion)

    def canonical(self, parameters: dict[str, float]) -> dict[str, float]:
        out = dict(parameters)
        for suffix in SUFFIXES.values():
            amplitude, phase = parameters.get(f"amplitude{suffix}"), parameters.get(f"phase{suffix}", 0.0)
            if amplitude is not None:
                turned = math.remainder(phase + (math.pi if amplitude < 0 else 0.0), 2 * math.pi)
                out |= {f"amplitude{suffix}": abs(amplitude), f"phase{suffix}": turned}
        return out

    def recorded_bounds(self, key: str, at: str, recorded: RecordedRange) -> tuple[float, float]:
        first, second = (place.split(".")[1] for place in members(at))
        if key == "order":
            return recorded.lowest_order(second), math.inf
        return (-math.inf, recorded.torque[first]) if key.startswith("amplitude") else (-math.inf, math.inf)


def _parting(angle: np.ndarray, other: np.ndarray) -> tuple[float, float]:
    """Slope of the line by which an angle (t,) follows another, and the range (rad) of its deviation from that line."""
    straight = np.column_stack([other, np.ones_like(other)])
    line = np.linalg.lstsq(straight, angle, rcond=None)[0]
    return float(line[0]), float(np.ptp(angle - straight @ line))


def _ripple_guess(
    place: str, angle: np.ndarray, order: float, harmonics: tuple[int, ...], chosen_from: float = 1.0
) -> Guess:
    waves = [function(k * order * angle) for k in harmonics for function in (np.sin, np.cos)]
    return Guess(tuple({place: wave} for wave in waves), partial(_parameters, order, harmonics), chosen_from)


def _parameters(order: float, harmonics: tuple[int, ...], a: np.ndarray) -> dict[str, float]:
    """Parameters for the amplitudes a (2·k,) of sine and cosine, harmonic by harmonic: a fit begins with a share of
    them, since a ripple of full size may catch a slow motion in another of its valleys."""
    out = {"order": order}
    for k, pair in zip(harmonics, a.reshape(-1, 2), strict=True):
        wave = wave_parameters(order, GENTLE * pair)
        out |= {f"amplitude{SUFFIXES[k]}": wave["amplitude"], f"phase{SUFFIXES[k]}": wave["phase"]}
    return out


# --- An inertia whose motion was recorded and is imposed, instead of a torque on it.

BANDWIDTH = 3000.0  # rad/s of the filter through which the recording drives the inertia; at 50 Hz it errs by 0.5 %
DELAYS = {"speed": 1 / BANDWIDTH, "angle": 2 / BANDWIDTH}  # s, by which the filter is late at low frequencies


class ImposedMotion(Kind):
    """The inertia follows the input on it, a recorded ``speed`` (rad/s) or ``angle`` (rad), whatever torque that takes.

    The recording is not differentiated: the inertia follows it through a filter of first order (speed) or of second
    order with critical damping (angle), far above the frequencies of drivetrains; its delay is taken off the recording.
    Without such an input the inertia is held.
    """

    kind = "imposed_motion"
    words = "moves as recorded"
    in_recording = "its motion is that of a drive of its own, whatever torque acts on it."
    tables = ("inertias",)
    linear = True
    imposes_motion = True
    sought = False  # what drives an inertia is known of a bed, not found in its recordings

    def inertia(self, motion: Motion, p: Symbols, assembly: EquationBuilder, name: str) -> None:
        assembly.impose(name, motion, -BANDWIDTH * motion.speed)

    def imposed_input(self, path: InputPath, measures: str, motion: Motion, assembly: EquationBuilder) -> None:
        path.delay -= Float(DELAYS[measures])
        acceleration: Expr = BANDWIDTH * (path.value - motion.speed)
        if measures == "angle":
            acceleration = BANDWIDTH**2 * (path.value - motion.angle) - 2 * BANDWIDTH * motion.speed
        assembly.impose(path.place, motion, acceleration)

    def imposed_response(self, measures: str, s: np.ndarray) -> np.ndarray:
        order = 2 if measures == "angle" else 1
        return np.asarray(np.exp(DELAYS[measures] * s) / (1 + s / BANDWIDTH) ** order)


# --- A torque that repeats over the angle of an axis which does not turn round and round (screw, rack, robot joint).

HARMONICS = (1, 2, 3)
PERIODS = (1.25, 0.6, 0.3, 0.15)  # first guesses, of the range of the angle
MOST_TURNS = 3.0  # above, a torque over the turn is a ripple, whose order its spectrum shows
FEWEST_PASSES = 2.0  # the path over the range: a place is passed at least twice


class PositionTorque(Kind):
    """Σ amplitude_k·sin(2π·k·angle/``period`` + phase_k), resisting; the second and third harmonic are optional."""

    kind = "position_torque"
    words = "bears a resisting torque of {amplitude} that repeats over {period} of its angle"
    in_recording = "the residual over the angle repeats whenever the axis passes the same place, either way."
    tables = ("inertias",)
    parameters = {
        "period": Parameter("rad", lower=1e-9),
        "amplitude": Parameter("N*m"), "phase": Parameter("rad"),
        "amplitude_2": Parameter("N*m", optional=True), "phase_2": Parameter("rad", optional=True),
        "amplitude_3": Parameter("N*m", optional=True), "phase_3": Parameter("rad", optional=True),
    }  # fmt: skip
    state_dependent = True
    zero_mean = ("amplitude", "amplitude_2", "amplitude_3")

    def inertia(self, motion: Motion, p: Symbols, assembly: EquationBuilder, name: str) -> None:
        for k, suffix in SUFFIXES.items():
            if f"amplitude{suffix}" in p:
                angle = 2 * pi * k * motion.angle / p["period"] + p.get(f"phase{suffix}", 0)
                assembly.add_torque(name, -p[f"amplitude{suffix}"] * sin(angle), motion)

    def candidate_places(self, system: Drivetrain) -> list[str]:
        """None: a part of its period mimics an offset, and encoders start elsewhere in every recording.

        A diagnosis shows such a torque as a curve over the angle instead.
        """
        return []

    def guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        angle = motion.angle[at.split(".")[1]]
        span = float(np.ptp(angle))
        path = sum(float(np.abs(np.diff(angle[part])).sum()) for part in motion.segments)
        if not 0 < span < 2 * np.pi * MOST_TURNS or path < FEWEST_PASSES * span:
            return
        for share in PERIODS:
            for harmonics in ((1,), HARMONICS):
                waves = [2 * np.pi * k / (share * span) * angle for k in harmonics]
                additions = tuple({at: -wave(x)} for x in waves for wave in (np.sin, np.cos))
                yield Guess(additions, partial(_harmonics, share * span))

    def fit_bounds(self, key: str, guess: float, step: float) -> tuple[float, float]:
        return (0.7 * guess, 1.4 * guess) if key == "period" else super().fit_bounds(key, guess, step)

    def canonical(self, parameters: dict[str, float]) -> dict[str, float]:
        out = dict(parameters)
        for suffix in SUFFIXES.values():
            if f"amplitude{suffix}" in parameters:
                amplitude, phase = parameters[f"amplitude{suffix}"], parameters.get(f"phase{suffix}", 0.0)
                out[f"amplitude{suffix}"] = abs(amplitude)
                out[f"phase{suffix}"] = math.remainder(phase + (math.pi if amplitude < 0 else 0.0), 2 * math.pi)
        return out

    def recorded_bounds(self, key: str, at: str, recorded: RecordedRange) -> tuple[float, float]:
        largest = recorded.torque[at.split(".")[1]]
        return (-largest, largest) if key.startswith("amplitude") else (-math.inf, math.inf)


def _harmonics(period: float, a: np.ndarray) -> dict[str, float]:
    """Parameters for the amplitudes a (2·k,) of sine and cosine, harmonic by harmonic."""
    out = {"period": period}
    for k, (sine, cosine) in enumerate(a.reshape(-1, 2), 1):
        out[f"amplitude{SUFFIXES[k]}"] = float(np.hypot(sine, cosine))
        out[f"phase{SUFFIXES[k]}"] = float(np.arctan2(cosine, sine))
    return out


# --- Wrong parameter


class Quantified(Protocol):
    """What has a value, SI."""

    value: float


class WrongParameter(Kind):
    """The quantity at the place (e.g. ``inertias.body.J``) is ``value`` instead."""

    kind = "wrong_parameter"
    words = "is {value}, not what the model gives"
    in_recording = "the frequencies of modes are off, in every recording and at every amplitude alike."
    tables = ("inertias", "shafts", "gears")
    parameters = {"value": Parameter("quantity")}
    linear = True
    replaces_quantity = True

    def places(self, system: Drivetrain) -> list[str]:
        return [name for name in system.parameters if name.count(".") == 2 and name.partition(".")[0] != "gearboxes"]

    def candidate_places(self, system: Drivetrain) -> list[str]:
        """A whole-number ratio is counted in teeth: it is known, and what looks like another one is a loss."""
        counted = {name for name in system.parameters if name.endswith(".ratio") and _whole(system.parameters[name])}
        return [name for name in self.places(system) if name not in counted]

    def guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        known = motion.value[at]
        scale = abs(known) or 1.0
        yield Guess(
            ({at: scale},),
            lambda a: {"value": known + scale * float(a[0])} if known + scale * float(a[0]) >= 0 else None,
        )

    def fit_bounds(self, key: str, guess: float, step: float) -> tuple[float, float]:
        return (0.0, float("inf")) if guess >= 0 else super().fit_bounds(key, guess, step)


def _whole(quantity: Quantified) -> bool:
    return float(quantity.value).is_integer()
