"""Orders of a turning drivetrain: where they meet modes (Campbell diagram), and what they excite (forced response)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from modelling.display import Displayed, labelled
from modelling.errors import InputError, unknown
from modelling.linear.linearise import Linear, linearise
from modelling.linear.state_space import response
from modelling.linear.steady_motion import is_linear
from modelling.modal.modes import damped_modes, modes
from modelling.modal.pairing import mac, pairs
from modelling.modal.result import Modes
from modelling.system import Effect, OperatingPoint, Sensor, System

POINTS = 400  # speeds of a diagram unless stated: a peak of 1 % damping is met within a tenth of its width
SPEEDS_OF_MODES = 40  # speeds at which the modes of a nonlinear model are calculated
TWO_PI = 2 * np.pi


class Crossing(NamedTuple):
    """Where an order meets a mode: at this speed (rad/s) of the inertia; the mode by number at the lowest speed."""

    order: float
    mode: int
    speed: float
    frequency: float


@dataclass(frozen=True)
class Campbell(Displayed):
    """Modes over speed, and the orders that meet them.

    Attributes
    ----------
    of : str
        The inertia that orders count the turns of.
    speeds : ndarray (s,)
        Of that inertia, rad/s.
    frequencies, damping_ratios : ndarray (s, m)
        Hz; a column a mode, followed over speed by its shape. Damping ratios of a linear model are 0: not calculated.
    orders : tuple of float
    crossings : tuple of Crossing
        By speed.
    """

    of: str
    speeds: np.ndarray
    frequencies: np.ndarray
    damping_ratios: np.ndarray
    orders: tuple[float, ...]
    crossings: tuple[Crossing, ...]

    def to_dict(self) -> dict[str, Any]:
        """The content of ``campbell.json``, SI."""
        return {
            "of": self.of, "crossings": [one._asdict() for one in self.crossings], "orders": list(self.orders),
            "speeds": self.speeds.tolist(), "frequencies": _listed(self.frequencies),
            "damping_ratios": _listed(self.damping_ratios),
        }  # fmt: skip


def _listed(values: np.ndarray) -> list[list[float | None]]:
    """Values (s, m) of modes over speed; None where a mode is not there."""
    return [[None if np.isnan(value) else value for value in row] for row in values.tolist()]


class Critical(NamedTuple):
    """A largest value over speed: of a shaft's torque amplitude, N·m, at a speed in rad/s, mostly of one order."""

    shaft: str
    speed: float
    torque: float
    order: float


@dataclass(frozen=True)
class OrderResponse(Displayed):
    """Steady vibration under torques that repeat with the turns of an inertia.

    Attributes
    ----------
    of : str
        The inertia that orders count the turns of.
    speeds : ndarray (s,)
        Of that inertia, rad/s.
    orders : tuple of float (o,)
    shafts, inertias : tuple of str (n,), (k,)
    torques, angles : ndarray (s, o, n), (s, o, k), complex
        Of every order: torque amplitude of the shafts, N·m, and angle amplitude of the inertias, rad.
    peak_torques, peak_angles : ndarray (s, n), (s, k)
        Largest value over a period of all orders together.
    critical : tuple of Critical
        Local maxima of the peak torques, the largest of every shaft first.
    """

    of: str
    speeds: np.ndarray
    orders: tuple[float, ...]
    shafts: tuple[str, ...]
    inertias: tuple[str, ...]
    torques: np.ndarray = field(repr=False)
    angles: np.ndarray = field(repr=False)
    peak_torques: np.ndarray = field(repr=False)
    peak_angles: np.ndarray = field(repr=False)
    critical: tuple[Critical, ...]

    def to_dict(self) -> dict[str, Any]:
        """The content of ``response.json``, SI."""
        return {
            "of": self.of, "critical": [one._asdict() for one in self.critical], "orders": list(self.orders),
            "speeds": self.speeds.tolist(),
            "torques": {name: self.peak_torques[:, i].tolist() for i, name in enumerate(self.shafts)},
            "angles": {name: self.peak_angles[:, i].tolist() for i, name in enumerate(self.inertias)},
        }  # fmt: skip

    def to_xarray(self) -> Any:
        """Amplitudes over speed, order and component (xarray Dataset, complex).

        Raises
        ------
        InputError
            If xarray is not installed.
        """
        return labelled(
            {
                "torque": (["speed", "order", "shaft"], self.torques, "N*m"),
                "angle": (["speed", "order", "inertia"], self.angles, "rad"),
            },
            {
                "speed": (self.speeds, "rad/s"), "order": (np.array(self.orders), ""),
                "shaft": (list(self.shafts), ""), "inertia": (list(self.inertias), ""),
            },
        )  # fmt: skip


def turning(system: System, of: str, speed: float) -> System:
    """The system in steady motion with this speed (rad/s) of an inertia; other speeds stated before are left out."""
    torques = () if system.operating_point is None else system.operating_point.torques
    return replace(system, operating_point=OperatingPoint(((of, speed),), torques))


def _checked(system: System, of: str, speeds: np.ndarray) -> np.ndarray:
    names = [inertia.name for inertia in system.inertias]
    if of not in names:
        raise unknown(of, names, "of")
    speeds = np.asarray(speeds, float)
    if speeds.ndim != 1 or len(speeds) < 2 or not (np.isfinite(speeds).all() and (np.diff(speeds) > 0).all()):
        raise InputError("speeds", "do not rise", "give two or more rising speeds in rad/s")
    if speeds[0] <= 0:
        raise InputError("speeds", f"{speeds[0]:g} rad/s is not possible", "begin above 0")
    return speeds


def campbell(system: System, speeds: np.ndarray, of: str, orders: Sequence[float]) -> Campbell:
    """Modes over speed, followed by their shapes, and where orders meet them.

    The modes of a linear model do not depend on speed; they are undamped ones. Those of another model are its damped
    modes in steady motion, at up to 40 of the speeds. From one speed to the next a mode goes to the one whose shape is
    most like its own: largest sum of modal assurance criteria (Allemang, The modal assurance criterion, Sound and
    Vibration, 2003).

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
    speeds = _checked(system, of, speeds)
    if not orders or any(not order > 0 for order in orders):
        raise InputError("orders", f"{list(orders)} are no orders", "give numbers above 0, e.g. 0.5, 1, 2")
    if is_linear(system):
        found = modes(system)
        frequencies = np.tile(found.frequencies, (len(speeds), 1))
        ratios = np.zeros_like(frequencies)
    else:
        every = -(-len(speeds) // SPEEDS_OF_MODES)
        speeds = np.append(speeds[:-1:every], speeds[-1])
        frequencies, ratios = _followed(system, speeds, of)
    crossings = []
    for order in orders:
        line = order * speeds / TWO_PI
        for mode in range(frequencies.shape[1]):
            apart = frequencies[:, mode] - line
            there = np.isfinite(apart[:-1]) & np.isfinite(apart[1:])  # a mode that is not there meets nothing
            for i in np.flatnonzero(there & (np.diff(np.signbit(apart)))):
                share = apart[i] / (apart[i] - apart[i + 1])
                speed = float(speeds[i] + share * (speeds[i + 1] - speeds[i]))
                crossings.append(Crossing(float(order), mode + 1, speed, order * speed / TWO_PI))
    crossings.sort(key=lambda one: one.speed)
    return Campbell(of, speeds, frequencies, ratios, tuple(map(float, orders)), tuple(crossings))


def _followed(system: System, speeds: np.ndarray, of: str) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies and damping ratios (s, m) of damped modes; NaN where a mode is not there or does not swing."""
    found = [damped_modes(turning(system, of, float(speed))) for speed in speeds]
    most = max(len(one) for one in found)
    frequencies, ratios = np.full((len(speeds), most), np.nan), np.full((len(speeds), most), np.nan)
    place, J = np.arange(len(found[0])), {f"inertias.{one.name}": one.J.value for one in system.inertias}
    weight = np.diag([J.get(name, 0.0) for name in found[0].masses])
    for i, now in enumerate(found):
        if i:
            place = _places(found[i - 1], now, place, most, weight)
        swings = np.abs(now.damping_ratios) < 1  # an overdamped motion has no frequency that an order could meet
        frequencies[i, place] = np.where(swings, now.frequencies, np.nan)
        ratios[i, place] = np.where(swings, now.damping_ratios, np.nan)
    ever = np.isfinite(frequencies).any(axis=0)
    return frequencies[:, ever], ratios[:, ever]


def _places(before: Modes, now: Modes, place: np.ndarray, most: int, weight: np.ndarray) -> np.ndarray:
    """Columns (m,) of the modes now, from those before: each stays with the mode that its shape is most like."""
    places = np.full(len(now), -1)
    for row, column in pairs(mac(before.mass_amplitudes, now.mass_amplitudes, weight), -1.0):
        places[column] = place[row]
    free = iter(sorted(set(range(most)) - set(places.tolist())))
    return np.array([next(free) if one < 0 else one for one in places])


def order_response(
    system: System, speeds: np.ndarray, of: str, torques: Mapping[tuple[str, float], complex]
) -> OrderResponse:
    """Steady vibration under torques of given orders, linear about the steady motion at every speed.

    Parameters
    ----------
    speeds : array (s,)
        Of the inertia ``of``, rad/s, rising from above 0.
    torques : mapping of (str, float) to complex
        By input and order: amplitude in N·m, with its phase as an angle of the order's own cycle.

    Raises
    ------
    InputError
        If a name is unknown, a speed or order impossible, there is no steady motion at a speed, or a motion is
        undamped at its resonance.
    """
    speeds = _checked(system, of, speeds)
    inputs = [part.name for part in system.inputs]
    for name, order in torques:
        if name not in inputs:
            raise unknown(name, inputs, "torques")
        if not order > 0:
            raise InputError("torques", f"{order:g} is no order", "give a number above 0")
    if not torques:
        raise InputError("torques", "there is none", "give one by input and order")
    shafts, inertias = tuple(part.name for part in system.shafts), tuple(part.name for part in system.inertias)
    read = [Sensor(f"torque_of_shaft_{number}", "torque", name) for number, name in enumerate(shafts)]
    read += [Sensor(f"angle_of_inertia_{number}", "angle", name) for number, name in enumerate(inertias)]
    seen = replace(system, sensors=tuple(read), effects=tuple(each for each in system.effects if not _on_sensor(each)))
    orders = tuple(sorted({order for _, order in torques}))
    amplitudes = np.array([[torques.get((name, order), 0.0) for name in inputs] for order in orders])
    if is_linear(seen):
        frequencies = (speeds[:, None] * np.array(orders) / TWO_PI).ravel()
        H = response(linearise(seen), frequencies).values.reshape(len(speeds), len(orders), len(read), -1)
        answers = np.einsum("soyu,ou->soy", H, amplitudes)
    else:
        answers = np.empty((len(speeds), len(orders), len(read)), complex)
        for i, speed in enumerate(speeds):
            about: Linear = linearise(turning(seen, of, float(speed)))
            answers[i] = np.einsum("oyu,ou->oy", response(about, speed * np.array(orders) / TWO_PI).values, amplitudes)
    of_torque, of_angle = answers[:, :, : len(shafts)], answers[:, :, len(shafts) :]
    peaks = _peaks(of_torque, orders)
    return OrderResponse(
        of, speeds, orders, shafts, inertias, of_torque, of_angle, peaks, _peaks(of_angle, orders),
        _critical(speeds, shafts, orders, np.abs(of_torque), peaks),
    )  # fmt: skip


def _on_sensor(effect: Effect) -> bool:
    return any(place.startswith("sensors.") for place in effect.places)


CYCLE = 64  # points a cycle of the highest order, at which the sum of orders is looked at: 0.1 % of its peak


def _peaks(amplitudes: np.ndarray, orders: Sequence[float]) -> np.ndarray:
    """Largest absolute value (s, n) over a period of Σ amplitudes (s, o, n)·exp(i·order·angle)."""
    if len(orders) == 1:
        return np.asarray(np.abs(amplitudes[:, 0]))
    turns = 2 if all(abs(2 * order - round(2 * order)) < 1e-9 for order in orders) else 10  # no common period: long
    angle = np.linspace(0, TWO_PI * turns, int(np.ceil(CYCLE * turns * max(orders))), endpoint=False)
    moving = np.exp(1j * np.outer(angle, orders))
    return np.array([np.abs((moving @ one).real).max(axis=0) for one in amplitudes])


def _critical(
    speeds: np.ndarray, shafts: Sequence[str], orders: Sequence[float], sizes: np.ndarray, peaks: np.ndarray
) -> tuple[Critical, ...]:
    """Local maxima of the peaks (s, n) within the speeds, the largest of every shaft first."""
    found = []
    for j, shaft in enumerate(shafts):
        one = peaks[:, j]
        inner = np.flatnonzero((one[1:-1] > one[:-2]) & (one[1:-1] >= one[2:])) + 1
        for i in sorted(inner, key=lambda i: -one[i]):
            found.append(Critical(shaft, float(speeds[i]), float(one[i]), orders[int(sizes[i, :, j].argmax())]))
    return tuple(found)
