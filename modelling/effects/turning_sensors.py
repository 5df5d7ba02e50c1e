"""Errors of a sensor that turn with its shaft: an encoder off its centre, teeth of a wheel, poles of a resolver."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from functools import partial

import numpy as np
from sympy import cos, sin

from modelling.effects.effect import (
    Drivetrain,
    EquationBuilder,
    FittedMotion,
    Guess,
    Kind,
    Parameter,
    RecordedRange,
    SensorPath,
    SimplerEffect,
    Symbols,
)
from modelling.effects.torques import TorqueRipple, orders_near, outstanding_orders, wave_parameters

HARMONICS = {1: "", 2: "_2"}  # of the parameters: a disc off its centre that is oval besides
MEASURES = ("angle", "speed")  # of the sensors that turn with a shaft; a speed is read as the change of such an angle


class SensorRipple(Kind):
    """The angle that it reads is off by Σ amplitude_k·sin(k·order·angle + phase_k); a speed by the rate of that."""

    kind = "sensor_ripple"
    words = "reads an angle that is off by {amplitude} with order {order} per turn of its shaft"
    in_recording = (
        "an oscillation whose frequency follows the speed, in this channel alone; in a speed it grows with the speed, "
        "and at standstill there is none."
    )
    tables = ("sensors",)
    parameters = {
        "order": Parameter("1", lower=0.0), "amplitude": Parameter("rad"), "phase": Parameter("rad"),
        "amplitude_2": Parameter("rad", optional=True), "phase_2": Parameter("rad", optional=True),
    }  # fmt: skip
    zero_mean = ("amplitude", "amplitude_2")

    def sensor(self, path: SensorPath, p: Symbols, assembly: EquationBuilder) -> None:
        assert path.motion is not None
        angle, speed = path.motion.angle, path.motion.speed
        for k, suffix in HARMONICS.items():
            if f"amplitude{suffix}" in p:
                wave, order = k * p["order"] * angle + p.get(f"phase{suffix}", 0), k * p["order"]
                off = sin(wave) if path.measures == "angle" else order * speed * cos(wave)
                path.value += p[f"amplitude{suffix}"] * off

    def guesses(self, motion: FittedMotion, at: str) -> Iterator[Guess]:
        over = _over(motion, at)
        for order, chosen_from in outstanding_orders(motion.angle[over], _by_angle(motion, at)):
            yield _guess(motion, at, order, (1,), chosen_from)

    def nearby(self, motion: FittedMotion, at: str, best: dict[str, float]) -> Iterator[Guess]:
        """An error of twice the order besides, and orders near the best one."""
        yield _guess(motion, at, best["order"], tuple(HARMONICS))
        for order in orders_near(motion.angle[_over(motion, at)], best["order"], _by_angle(motion, at)):
            yield _guess(motion, at, order, (1,))

    def places(self, system: Drivetrain) -> list[str]:
        return [f"sensors.{sensor.name}" for sensor in system.sensors if sensor.measures in MEASURES]

    def simpler(
        self, at: str, parameters: Mapping[str, float], value: Mapping[str, float], system: Drivetrain
    ) -> Iterator[SimplerEffect]:
        """The error of the order alone."""
        if "amplitude_2" in parameters:
            yield SimplerEffect(self.kind, at, {key: parameters[key] for key in ("order", "amplitude", "phase")})

    def fit_bounds(self, key: str, guess: float, step: float) -> tuple[float, float]:
        return TorqueRipple().fit_bounds(key, guess, step) if key == "order" else (-math.inf, math.inf)

    def canonical(self, parameters: dict[str, float]) -> dict[str, float]:
        out = dict(parameters)
        for suffix in HARMONICS.values():
            if f"amplitude{suffix}" in parameters:
                wave = {"amplitude": parameters[f"amplitude{suffix}"], "phase": parameters.get(f"phase{suffix}", 0.0)}
                out |= {f"{key}{suffix}": value for key, value in TorqueRipple().canonical(wave).items()}
        return out

    def recorded_bounds(self, key: str, at: str, recorded: RecordedRange) -> tuple[float, float]:
        return (
            (recorded.lowest_order(recorded.sensor_of[at.split(".")[1]]), math.inf)
            if key == "order"
            else (-math.inf, math.inf)
        )


def _over(motion: FittedMotion, at: str) -> str:
    """The inertia over whose angle a sensor's error repeats."""
    return motion.sensor_of[at.split(".")[1]]


def _by_angle(motion: FittedMotion, at: str) -> np.ndarray:
    """−∂χ²/∂(error of the angle) (t,), but for phase and order: at a speed sensor an error counts by the speed."""
    name = at.split(".")[1]
    gradient = motion.reading_gradient[name]
    return gradient if motion.reads[name] == "angle" else gradient * motion.speed[_over(motion, at)]


def _guess(motion: FittedMotion, at: str, order: float, harmonics: tuple[int, ...], chosen_from: float = 1.0) -> Guess:
    name, over = at.split(".")[1], _over(motion, at)
    angle, speed = motion.angle[over], motion.speed[over]
    waves: list[np.ndarray] = []
    for k in harmonics:
        sine, cosine = np.sin(k * order * angle), np.cos(k * order * angle)
        rate = k * order * speed
        waves += [sine, cosine] if motion.reads[name] == "angle" else [rate * cosine, -rate * sine]
    return Guess(tuple({at: wave} for wave in waves), partial(_parameters, order, harmonics), chosen_from)


def _parameters(order: float, harmonics: tuple[int, ...], a: np.ndarray) -> dict[str, float]:
    out = {"order": order}
    for k, pair in zip(harmonics, a.reshape(-1, 2), strict=True):
        wave = wave_parameters(order, pair)
        out |= {f"{key}{HARMONICS[k]}": wave[key] for key in ("amplitude", "phase")}
    return out


# --- The table by which such an error is taken off.

POINTS_A_PERIOD, FEWEST_POINTS = 16, 360  # of the table: a straight line between misses 0.5 % of a sine


def correction(parameters: dict[str, float]) -> np.ndarray:
    """Angles (t,) of one turn, rad, the error of the angle there, rad, and that of a speed over the speed, (t, 3).

    Parameters
    ----------
    parameters : dict of str to float
        Of a :class:`SensorRipple`, whose order is taken as the nearest whole number.
    """
    order = round(parameters["order"])
    highest = order * max(k for k, suffix in HARMONICS.items() if f"amplitude{suffix}" in parameters)
    angle = np.linspace(0, 2 * np.pi, max(FEWEST_POINTS, POINTS_A_PERIOD * highest), endpoint=False)
    error, rate = np.zeros_like(angle), np.zeros_like(angle)
    for k, suffix in HARMONICS.items():
        size, phase = parameters.get(f"amplitude{suffix}", 0.0), parameters.get(f"phase{suffix}", 0.0)
        error += size * np.sin(k * order * angle + phase)
        rate += size * k * order * np.cos(k * order * angle + phase)
    return np.column_stack([angle, error, rate])
