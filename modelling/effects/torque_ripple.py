"""Torque that varies with the angle (cogging, torque ripple, universal joint)."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial

import numpy as np
import scipy
from sympy import sin

from modelling.effects.first_guess import FittedMotion, Guess
from modelling.effects.interface import EquationBuilder, Motion, Symbols
from modelling.effects.kind import Kind, Parameter
from modelling.effects.recorded_range import RecordedRange

MOST_ORDERS = 4  # that are tried from one spectrum
LOWEST_ORDER = 0.4  # per turn, that is searched for: a period of several turns is that of another shaft
HIGHEST_ORDER = 24.0  # the same: above those of cogging and joints


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
        angle, gradient = motion.angle[at.split(".")[1]], motion.torque_gradient[at.split(".")[1]]
        for order, chosen_from in outstanding_orders(angle, gradient):
            yield _guess(at, angle, order, chosen_from)

    def nearby(self, motion: FittedMotion, at: str, best: dict[str, float]) -> Iterator[Guess]:
        """Orders near the best one, half a line apart: a reversing motion gives the true one many side lobes."""
        angle = motion.angle[at.split(".")[1]]
        span = float(np.ptp(angle))
        if span > 4 * np.pi:
            for order in best["order"] + np.arange(-0.4, 0.4, max(np.pi / span, 0.004)):
                yield _guess(at, angle, float(order))

    def fit_bounds(self, key: str, guess: float, step: float) -> tuple[float, float]:
        return (max(guess - 0.3, LOWEST_ORDER), guess + 0.3) if key == "order" else super().fit_bounds(key, guess, step)

    def canonical(self, parameters: dict[str, float]) -> dict[str, float]:
        shift = math.pi if parameters["amplitude"] < 0 else 0.0
        phase = math.remainder(parameters["phase"] + shift, 2 * math.pi)
        return parameters | {"amplitude": abs(parameters["amplitude"]), "phase": phase}

    def recorded_bounds(self, key: str, at: str, recorded: RecordedRange) -> tuple[float, float]:
        name = at.split(".")[1]
        if key == "order":
            return recorded.lowest_order(name), math.inf
        return (-math.inf, recorded.torque[name]) if key == "amplitude" else (-math.inf, math.inf)


def _guess(at: str, angle: np.ndarray, order: float, chosen_from: float = 1.0) -> Guess:
    additions = ({at: np.sin(order * angle)}, {at: np.cos(order * angle)})
    return Guess(additions, partial(wave_parameters, order), chosen_from)


def wave_parameters(order: float, a: np.ndarray) -> dict[str, float]:
    """Parameters of a ripple for the amplitudes a (2,) of sine and cosine."""
    return {"order": order, "amplitude": float(np.hypot(*a)), "phase": float(np.arctan2(a[1], a[0]))}


def outstanding_orders(angle: np.ndarray, gradient: np.ndarray) -> Iterator[tuple[float, float]]:
    """Orders at which −∂χ²/∂torque over angle stands out of its spectrum, and from how many each was chosen."""
    span = float(np.ptp(angle))
    if not 0.5 * np.pi < span < 1e6:
        return
    # an order that turns further than half a period a sample cannot be seen; some samples are slower than the mean
    highest = min(HIGHEST_ORDER, 4 * np.pi * len(angle) / span)
    if span < 2 * np.pi:  # too coarse a spectrum: all orders, half a spectral line apart
        yield from ((float(order), 1.0) for order in np.arange(np.pi / span, highest, np.pi / span))
        return
    # gradient summed over bins of angle, then one FFT over angle; ten bins a period of the highest order
    width = 2 * np.pi / (10 * highest)
    length = 2 * int(span / width) + 2  # half of it zeros: orders twice as fine as the span resolves
    strength = np.abs(np.fft.rfft(np.bincount(((angle - angle.min()) / width).astype(int), gradient, length)))
    orders = np.arange(len(strength)) / (length * width / (2 * np.pi))
    fine = orders[1]
    used = (orders > max(LOWEST_ORDER, 2 * fine)) & (orders <= highest)
    if not used.any():
        return
    orders, strength = orders[used], strength[used]
    level = scipy.ndimage.median_filter(strength, 2 * int(0.75 / fine) + 1, mode="constant")
    outstanding = strength / (level + 1e-3 * strength.max() + 1e-300)
    for _ in range(MOST_ORDERS):
        best = int(np.argmax(outstanding))
        yield float(orders[best]), max(len(orders) / MOST_ORDERS, 1.0)
        outstanding[abs(orders - orders[best]) < 3 * fine + 0.1] = 0.0
