"""Orders of a turning drivetrain: where they meet modes (Campbell diagram)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import brentq

from modelling.display import Displayed
from modelling.errors import InputError, unknown
from modelling.linear.steady_motion import is_linear
from modelling.modal.modes import damped_modes
from modelling.modal.pairing import mac, pairs
from modelling.modal.result import Modes
from modelling.system import OperatingPoint, System

POINTS = 400  # speeds of a diagram unless stated: a peak of 1 % damping is met within a tenth of its width
SPEEDS_OF_MODES = 40  # speeds at which the modes of a nonlinear model are calculated
TWO_PI = 2 * np.pi


class Crossing(NamedTuple):
    """Where an order meets a mode.

    Attributes
    ----------
    order : float
    mode : int
        Its number, by frequency at the lowest speed; a rigid-body mode counts, an overdamped motion does not.
    speed : float
        Of the inertia, rad/s.
    frequency, natural_frequency : float
        Hz; at the first one the mode rings (Im λ/2π), the other is abs(λ)/2π.
    damping_ratio : float
    """

    order: float
    mode: int
    speed: float
    frequency: float
    natural_frequency: float
    damping_ratio: float


@dataclass(frozen=True)
class Campbell(Displayed):
    """Modes over speed, and the orders that meet them.

    Attributes
    ----------
    of : str
        The inertia that orders count the turns of.
    speeds : ndarray (s,)
        Of that inertia, rad/s.
    frequencies, natural_frequencies, damping_ratios : ndarray (s, m)
        A column a mode, followed over speed by its shape; Hz, at which it rings (Im λ/2π), and abs(λ)/2π. NaN where a
        mode is overdamped or not there.
    orders : tuple of float
    crossings : tuple of Crossing
        By speed.
    """

    of: str
    speeds: np.ndarray
    frequencies: np.ndarray
    natural_frequencies: np.ndarray
    damping_ratios: np.ndarray
    orders: tuple[float, ...]
    crossings: tuple[Crossing, ...]

    def to_dict(self) -> dict[str, Any]:
        """The content of ``campbell.json``, SI."""
        return {
            "of": self.of, "crossings": [one._asdict() for one in self.crossings], "orders": list(self.orders),
            "speeds": self.speeds.tolist(), "frequencies": _listed(self.frequencies),
            "natural_frequencies": _listed(self.natural_frequencies), "damping_ratios": _listed(self.damping_ratios),
        }  # fmt: skip


def _listed(values: np.ndarray) -> list[list[float | None]]:
    """Values (s, m) of modes over speed; None where a mode is not there."""
    return [[None if np.isnan(value) else value for value in row] for row in values.tolist()]


def turning(system: System, of: str, speed: float) -> System:
    """The system in steady motion with this speed (rad/s) of an inertia; other speeds stated before are left out."""
    torques = () if system.operating_point is None else system.operating_point.torques
    return replace(system, operating_point=OperatingPoint(((of, speed),), torques))


def checked_speeds(system: System, of: str, speeds: np.ndarray) -> np.ndarray:
    """Speeds (s,) of an inertia as an array.

    Raises
    ------
    InputError
        If the inertia is unknown or the speeds do not rise from above 0.
    """
    names = [inertia.name for inertia in system.inertias]
    if of not in names:
        raise unknown(of, names, "of")
    speeds = np.asarray(speeds, float)
    if speeds.ndim != 1 or len(speeds) < 2 or not (np.isfinite(speeds).all() and (np.diff(speeds) > 0).all()):
        raise InputError("speeds", "do not rise", "give two or more rising speeds in rad/s")
    if speeds[0] <= 0:
        raise InputError("speeds", f"{speeds[0]:g} rad/s is not possible", "begin above 0")
    return speeds


def check_orders(orders: Sequence[float]) -> None:
    """Check that there are orders above 0.

    Raises
    ------
    InputError
        If there is none, or one is not above 0.
    """
    if not orders or any(not order > 0 for order in orders):
        raise InputError("orders", f"{list(orders)} are no orders", "give numbers above 0, e.g. 0.5, 1, 2")


def campbell(system: System, speeds: np.ndarray, of: str, orders: Sequence[float]) -> Campbell:
    """Damped modes over speed, followed by their shapes, and where orders meet them.

    The modes of a linear model do not depend on speed. Those of another model are its modes in steady motion, at up to
    40 of the speeds, and at each crossing. From one speed to the next a mode goes to the one whose shape is most like
    its own: largest sum of modal assurance criteria (Allemang, The modal assurance criterion, Sound and Vibration,
    2003).

    Parameters
    ----------
    speeds : array (s,)
        Of the inertia ``of``, rad/s, rising from above 0.
    orders : sequence of float
        Cycles a turn of the inertia.

    Raises
    ------
    InputError
        If an inertia is unknown, a speed or order impossible, or there is no steady motion at a speed.
    """
    speeds = checked_speeds(system, of, speeds)
    check_orders(orders)
    steady = is_linear(system)
    if not steady:
        every = -(-len(speeds) // SPEEDS_OF_MODES)
        speeds = np.append(speeds[:-1:every], speeds[-1])
    poles = _followed(system, speeds[:1] if steady else speeds, of)
    poles = np.tile(poles, (len(speeds), 1)) if steady else poles
    crossings = []
    for order in orders:
        apart = poles.imag - order * speeds[:, None]
        there = np.isfinite(apart[:-1]) & np.isfinite(apart[1:])  # a mode that is not there meets nothing
        for i, mode in np.argwhere(there & np.diff(np.signbit(apart), axis=0)):
            at = _meeting(system, of, order, speeds[i : i + 2], poles[i : i + 2, mode], steady)
            if at is not None:
                speed, pole = at
                crossings.append(Crossing(float(order), int(mode) + 1, speed, *_of_pole(pole)))
    crossings.sort(key=lambda one: one.speed)
    return Campbell(of, speeds, *_of_pole(poles), tuple(map(float, orders)), tuple(crossings))


def _of_pole(pole: Any) -> tuple[Any, Any, Any]:
    """Frequency at which it rings and natural frequency in Hz, damping ratio; of a rigid-body mode 0."""
    size = np.abs(pole)
    ratio = np.where(np.isnan(size), np.nan, -np.real(pole) / np.where(size > 0, size, 1.0)) + 0.0
    found = np.imag(pole) / TWO_PI, size / TWO_PI, ratio
    return found if np.ndim(pole) else tuple(float(each) for each in found)  # type: ignore[return-value]


def _meeting(
    system: System, of: str, order: float, ends: np.ndarray, poles: np.ndarray, steady: bool
) -> tuple[float, complex] | None:
    """Speed (rad/s) between two at which an order meets a mode, and its pole there; None if it is overdamped there."""
    if steady:
        return float(poles[0].imag / order), complex(poles[0])

    def pole(speed: float) -> complex:
        share = (speed - ends[0]) / (ends[1] - ends[0])
        known = damped_modes(turning(system, of, speed)).eigenvalues
        return complex(known[np.argmin(np.abs(known - (1 - share) * poles[0] - share * poles[1]))])

    def apart(speed: float) -> float:
        return pole(speed).imag - order * speed

    low, high = (float(end) for end in ends)
    if not apart(low) * apart(high) < 0:
        return None
    speed = float(brentq(apart, low, high, rtol=1e-10))
    met = pole(speed)
    return (speed, met) if abs(met.imag - order * speed) < 1e-6 * order * speed else None


def _followed(system: System, speeds: np.ndarray, of: str) -> np.ndarray:
    """Poles (s, m) of damped modes, rigid ones at 0; NaN where a mode is not there or does not swing."""
    found = [damped_modes(turning(system, of, float(speed))) for speed in speeds]
    most = max(len(one) for one in found)
    poles = np.full((len(speeds), most), np.nan + 1j * np.nan)
    place, J = np.arange(len(found[0])), {f"inertias.{one.name}": one.J.value for one in system.inertias}
    weight = np.diag([J.get(name, 0.0) for name in found[0].masses])
    for i, now in enumerate(found):
        if i:
            place = _places(found[i - 1], now, place, most, weight)
        swings = np.abs(now.damping_ratios) < 1  # an overdamped motion has no frequency that an order could meet
        known = np.where(now.frequencies > 0, now.eigenvalues, 0.0)
        poles[i, place] = np.where(swings, known, np.nan + 1j * np.nan)
    return poles[:, np.isfinite(poles).any(axis=0)]


def _places(before: Modes, now: Modes, place: np.ndarray, most: int, weight: np.ndarray) -> np.ndarray:
    """Columns (m,) of the modes now, from those before: each stays with the mode that its shape is most like."""
    places = np.full(len(now), -1)
    for row, column in pairs(mac(before.mass_amplitudes, now.mass_amplitudes, weight), -1.0):
        places[column] = place[row]
    free = iter(sorted(set(range(most)) - set(places.tolist())))
    return np.array([next(free) if one < 0 else one for one in places])
