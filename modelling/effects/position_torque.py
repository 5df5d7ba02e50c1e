"""A torque that repeats over the angle of an axis which does not turn round and round (screw, rack, robot joint)."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial

import numpy as np
from sympy import pi, sin

from modelling.effects.first_guess import FittedMotion, Guess
from modelling.effects.interface import Drivetrain, EquationBuilder, Motion, Symbols
from modelling.effects.kind import Kind, Parameter
from modelling.effects.recorded_range import RecordedRange

HARMONICS = (1, 2, 3)
SUFFIXES = {1: "", 2: "_2", 3: "_3"}
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
    zero_mean = ("amplitude",)

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
