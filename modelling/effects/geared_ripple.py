"""Torque on one inertia that varies with the angle of another: teeth of a gear, pulses of an engine at the wheels."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial

import numpy as np
from sympy import sin

from modelling.effects.first_guess import FittedMotion, Guess
from modelling.effects.interface import Drivetrain, EquationBuilder, Motion, Symbols
from modelling.effects.kind import Kind, Parameter
from modelling.effects.place import members, shared_place
from modelling.effects.recorded_range import RecordedRange
from modelling.effects.torque_ripple import (
    HIGHEST_ORDER,
    LOWEST_ORDER,
    TorqueRipple,
    outstanding_orders,
    wave_parameters,
)

SUFFIXES = {1: "", 2: "_2", 3: "_3"}  # of the harmonics' parameters
LEAST_LAG = 1.0  # rad of the ripple's phase, by which one angle has to leave a fixed ratio to the other; else a ripple
# over its own angle is the same torque, if that is one of an order that is looked for
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
        ratio, lag = _parting(angle, motion.angle[first])
        if lag < RIGID * np.ptp(angle) or (HIGHEST_ORDER * lag < LEAST_LAG and ratio >= 1):
            return
        for order, chosen_from in outstanding_orders(angle, motion.torque_gradient[first]):
            if order * lag > LEAST_LAG or order * ratio < LOWEST_ORDER:
                yield _guess(members(at)[0], angle, order, (1,), chosen_from)

    def nearby(self, motion: FittedMotion, at: str, best: dict[str, float]) -> Iterator[Guess]:
        """Pulses of that order, and orders near the best one, half a line apart, as of a ripple of its own angle."""
        first, second = members(at)
        angle = motion.angle[second.split(".")[1]]
        yield _guess(first, angle, best["order"], tuple(SUFFIXES))
        span = float(np.ptp(angle))
        if span > 4 * np.pi:
            for order in best["order"] + np.arange(-0.4, 0.4, max(np.pi / span, 0.004)):
                yield _guess(first, angle, float(order), (1,))

    def fit_bounds(self, key: str, guess: float, step: float) -> tuple[float, float]:
        return TorqueRipple().fit_bounds(key, guess, step) if key == "order" else (-math.inf, math.inf)

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
    """The ratio of an angle (t,) to another (magnitude), and the range (rad) of what is left of it by that."""
    straight = np.column_stack([other, np.ones_like(other)])
    line = np.linalg.lstsq(straight, angle, rcond=None)[0]
    return abs(float(line[0])), float(np.ptp(angle - straight @ line))


def _guess(place: str, angle: np.ndarray, order: float, harmonics: tuple[int, ...], chosen_from: float = 1.0) -> Guess:
    waves = [function(k * order * angle) for k in harmonics for function in (np.sin, np.cos)]
    return Guess(tuple({place: wave} for wave in waves), partial(_parameters, order, harmonics), chosen_from)


def _parameters(order: float, harmonics: tuple[int, ...], a: np.ndarray) -> dict[str, float]:
    """Parameters for the amplitudes a (2·k,) of sine and cosine, harmonic by harmonic."""
    out = {"order": order}
    for k, pair in zip(harmonics, a.reshape(-1, 2), strict=True):
        wave = wave_parameters(order, pair)
        out |= {f"amplitude{SUFFIXES[k]}": wave["amplitude"], f"phase{SUFFIXES[k]}": wave["phase"]}
    return out
