"""Forced response: the steady vibration that orders of a turning drivetrain excite, and its critical speeds."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import lru_cache, partial
from math import isfinite, lcm
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import minimize_scalar

from modelling.display import Displayed, labelled
from modelling.errors import InputError, unknown
from modelling.linear.elements import elements, null_space, unit_rows
from modelling.linear.linearise import Linear, linearise
from modelling.linear.state_space import Transfer, transfer_of
from modelling.linear.steady_motion import is_linear
from modelling.modal.orders import Campbell, campbell, check_orders, checked_speeds, turning
from modelling.system import Effect, Sensor, System

Amplitude = complex | Callable[[np.ndarray], np.ndarray]  # SI; or a function of the speeds (s,), rad/s


@dataclass(frozen=True)
class CriticalSettings:
    """The numbers by which a speed is called critical.

    Attributes
    ----------
    amplification : float
        Torque amplitude of an order over its quasi-static one, at least: √2 (3 dB), the half-power convention.
    prominence : float
        The same over the torque amplitude that lies between this maximum and a higher one: 1.1 (10 %), about what a
        measured order shows. Trial: bumps of examples/engine rise by 1 to 2 %.
    half_widths : float
        Distance of the maximum from the pole of its mode, in half widths of the peak, at most: 4. There a resonance has
        fallen to a quarter; a maximum further off is the hump that several modes leave between two zeros.
    """

    amplification: float = 2**0.5
    prominence: float = 1.1
    half_widths: float = 4.0


class Critical(NamedTuple):
    """A critical speed: the torque of a shaft under one order has a maximum that stands out.

    Attributes
    ----------
    shaft : str
    speed : float
        rad/s of the inertia whose turns are counted.
    torque : float
        Largest torque over a period of all orders together, N·m; infinite where nothing damps the mode.
    order : float
        Whose amplitude has its maximum here.
    mode : int
        That makes it; the number of a Campbell diagram.
    frequency : float
        Of the vibration, Hz.
    amplitude, static : float
        Of this order alone, N·m: the torque amplitude, and the one if nothing swung (quasi-static).
    """

    shaft: str
    speed: float
    torque: float
    order: float
    mode: int
    frequency: float
    amplitude: float
    static: float


class Largest(NamedTuple):
    """The largest torques of a shaft over the speeds, about the mean torque.

    Attributes
    ----------
    shaft : str
    speed, torque : float
        rad/s, and the largest value over a period of all orders together in N·m.
    order : float
        With the largest amplitude there.
    at_end : bool
        The speed is the lowest or the highest one: beyond it the torque may be larger.
    peak_to_peak, fatigue : float
        Largest difference within a period, N·m, and half of it: the alternating torque that a coupling or shaft has to
        bear for ever (DIN 740-2 calls what is allowed T_KW).
    """

    shaft: str
    speed: float
    torque: float
    order: float
    at_end: bool
    peak_to_peak: float
    fatigue: float


@dataclass(frozen=True)
class OrderResponse(Displayed):
    """Steady vibration under torques, or imposed motions, that repeat with the turns of an inertia.

    Attributes
    ----------
    of : str
        The inertia that orders count the turns of.
    speeds : ndarray (s,)
        Of that inertia, rad/s: those asked for, and closer ones about every resonance.
    orders : tuple of float (o,)
    shafts, inertias : tuple of str (n,), (k,)
    torques, angles : ndarray (s, o, n), (s, o, k), complex
        Of every order: torque amplitude of the shafts, N·m, and angle amplitude of the inertias, rad.
    peak_torques, peak_angles : ndarray (s, n), (s, k)
        Largest value over a period of all orders together.
    peak_to_peak : ndarray (s, n)
        Largest difference of the torque within a period.
    critical : tuple of Critical
        The largest torque of every shaft first.
    largest : tuple of Largest
        By shaft.
    excited_by : mapping of str to str
        What acts, by input: ``torque``, or the ``speed`` or ``angle`` that is imposed.
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
    peak_to_peak: np.ndarray = field(repr=False)
    critical: tuple[Critical, ...]
    largest: tuple[Largest, ...]
    excited_by: Mapping[str, str]

    def to_dict(self) -> dict[str, Any]:
        """The content of ``response.json``, SI; a torque without bound is None."""
        return {
            "of": self.of, "critical": [_entries(one) for one in self.critical],
            "largest": [_entries(one) for one in self.largest], "orders": list(self.orders),
            "excited_by": dict(self.excited_by), "speeds": self.speeds.tolist(),
            "torques": {name: self.peak_torques[:, i].tolist() for i, name in enumerate(self.shafts)},
            "peak_to_peak": {name: self.peak_to_peak[:, i].tolist() for i, name in enumerate(self.shafts)},
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


def _entries(one: Critical | Largest) -> dict[str, Any]:
    return {
        key: None if isinstance(value, float) and not isfinite(value) else value for key, value in one._asdict().items()
    }


# --- What acts, and what the drivetrain answers at any speed.


@dataclass(frozen=True)
class _Forced:
    """A drivetrain that reads the torque of every shaft and the angle of every inertia, and what acts on it."""

    system: System
    of: str
    orders: tuple[float, ...]
    acting: Mapping[tuple[str, float], Amplitude]
    linear: bool

    def about(self, speed: float) -> tuple[Linear, Transfer]:
        """The linear model in steady motion at a speed, rad/s."""
        return _about(self.system if self.linear else turning(self.system, self.of, speed))

    def amplitudes(self, speeds: np.ndarray) -> np.ndarray:
        """Of every order and input at speeds (s,), (s, o, u), complex."""
        found = np.zeros((len(speeds), len(self.orders), len(self.system.inputs)), complex)
        names = [part.name for part in self.system.inputs]
        for (name, order), stated in self.acting.items():
            value = np.asarray(stated(speeds) if callable(stated) else stated)
            if name in self.system.imposed_by:  # the model follows an imposed motion through a filter: taken off
                kind, measures = self.system.imposed_by[name], self.system.input_quantities[name]
                value = value / kind.imposed_response(measures, 1j * order * speeds)
            found[:, self.orders.index(order), names.index(name)] = value
        return found

    def answers(self, speeds: np.ndarray) -> np.ndarray:
        """Readings of every order at speeds (s,), (s, o, y), complex."""
        s, pushes = 1j * np.outer(speeds, self.orders), self.amplitudes(speeds)
        if self.linear:
            H = self.about(0.0)[1].at(s.ravel())
            return np.asarray(np.einsum("soyu,sou->soy", H.reshape(*s.shape, *H.shape[1:]), pushes))
        each = [
            np.einsum("oyu,ou->oy", self.about(float(speed))[1].at(s[i]), pushes[i]) for i, speed in enumerate(speeds)
        ]
        return np.array(each)


@lru_cache(maxsize=64)
def _about(system: System) -> tuple[Linear, Transfer]:
    linear = linearise(system)
    return linear, transfer_of(linear, range(len(linear.model.sensors)), range(len(linear.model.inputs)))


def order_response(
    system: System, speeds: np.ndarray, of: str, torques: Mapping[tuple[str, float], Amplitude],
    settings: CriticalSettings | None = None,
) -> OrderResponse:  # fmt: skip
    """Steady vibration under torques of given orders, linear about the steady motion at every speed.

    Parameters
    ----------
    speeds : array (s,)
        Of the inertia ``of``, rad/s, rising from above 0.
    torques : mapping of (str, float) to complex or function
        By input and order: amplitude in N·m (of an imposed speed in rad/s, of an angle in rad), with its phase as an
        angle of the order's own cycle; or a function of the speeds (s,) that gives it.
    settings : CriticalSettings, optional

    Raises
    ------
    InputError
        If a name is unknown, a speed or order impossible, there is no steady motion at a speed, or a motion is
        undamped at one of the speeds.
    """
    speeds = checked_speeds(system, of, speeds)
    check_acting(system, torques)
    seen = _watched(system)
    orders = tuple(sorted({order for _, order in torques}))
    forced = _Forced(seen, of, orders, torques, is_linear(seen))
    map_ = campbell(seen, speeds, of, orders)
    speeds = np.unique(np.concatenate([speeds, *_near(map_, speeds, orders)]))
    judged = _Judged(forced, map_, settings or CriticalSettings(), len(system.shafts))
    speeds, found = judged.refined(speeds)
    shafts, inertias = tuple(part.name for part in system.shafts), tuple(part.name for part in system.inertias)
    of_torque, of_angle = found[:, :, : len(shafts)], found[:, :, len(shafts) :]
    high, low = extremes(of_torque, orders)
    of_angles = extremes(of_angle, orders)
    critical = judged.critical(speeds, of_torque)
    return OrderResponse(
        of, speeds, orders, shafts, inertias, of_torque, of_angle, np.maximum(high, -low),
        np.maximum(of_angles[0], -of_angles[1]), high - low, critical, judged.largest(speeds, of_torque, critical),
        {name: system.input_quantities[name] for name in dict.fromkeys(name for name, _ in torques)},
    )  # fmt: skip


def check_acting(system: System, torques: Mapping[tuple[str, float], Any]) -> None:
    """Check that what acts names inputs and orders.

    Raises
    ------
    InputError
        If nothing acts, an input is unknown, or an order is not above 0.
    """
    inputs = [part.name for part in system.inputs]
    for name, order in torques:
        if name not in inputs:
            raise unknown(name, inputs, "torques")
        if name in system.pedals:
            on = next(part.on for part in system.inputs if part.name == name)
            wrong = f"{name} is a pedal, and orders are torques"
            raise InputError("torques", wrong, f'name a torque on the same inertia: [inputs.pulses] with on = "{on}"')
        if not order > 0:
            raise InputError("torques", f"{order:g} is no order", "give a number above 0")
    if not torques:
        raise InputError("torques", "there is none", "give one by input and order")
    check_orders([order for _, order in torques])


def _watched(system: System) -> System:
    """The same drivetrain, which reads the torque of every shaft, then the angle of every inertia."""
    read = [Sensor(f"torque_of_shaft_{number}", "torque", part.name) for number, part in enumerate(system.shafts)]
    read += [Sensor(f"angle_of_inertia_{number}", "angle", part.name) for number, part in enumerate(system.inertias)]
    effects = tuple(each for each in system.effects if not _on_sensor(each))
    return replace(system, sensors=tuple(read), effects=effects)


def _on_sensor(effect: Effect) -> bool:
    return any(place.startswith("sensors.") for place in effect.places)


# --- Speeds at which a resonance is looked at: about each pole, in half widths of its peak.

HALF_WIDTHS = np.array([0.0, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0])  # at 16 a peak has fallen to 6 % of its height
UNDAMPED = 1e-9  # damping ratio, below which rounding decides on it: the peak has no bound


def _near(map_: Campbell, speeds: np.ndarray, orders: Sequence[float]) -> list[np.ndarray]:
    """Speeds within the range, close to where an order meets the pole of a mode."""
    centres = [(one.order, one.frequency, one.natural_frequency, one.damping_ratio) for one in map_.crossings]
    for end in (0, -1):  # a peak whose summit lies outside still has a flank inside
        rows = zip(map_.frequencies[end], map_.natural_frequencies[end], map_.damping_ratios[end])
        centres += [(order, *row) for row in rows if row[0] > 0 for order in orders]
    found = [np.zeros(0)]
    for order, rings, natural, ratio in centres:
        half = 2 * np.pi * natural * abs(ratio) / order
        near = 2 * np.pi * rings / order + half * np.concatenate([-HALF_WIDTHS, HALF_WIDTHS])
        if abs(ratio) > UNDAMPED:
            found.append(near[(near > speeds[0]) & (near < speeds[-1])])
    return found


# --- Extremes over a period of the sum of orders.

CYCLE = 64  # points a cycle of the highest order; a parabola through three of them finds the extreme to 1e-5
LONGEST_PERIOD = 48  # turns; orders without a shorter common period meet in phase sooner or later


def extremes(amplitudes: np.ndarray, orders: Sequence[float]) -> tuple[np.ndarray, np.ndarray]:
    """Largest and smallest value (s, n) over a period of Re Σ amplitudes (s, o, n)·exp(i·order·angle)."""
    sizes = np.abs(amplitudes).sum(axis=1)
    turns = lcm(*(Fraction(order).limit_denominator(LONGEST_PERIOD).denominator for order in orders))
    if len(orders) == 1 or turns > LONGEST_PERIOD or any(abs(turns * o - round(turns * o)) > 1e-6 for o in orders):
        return sizes, -sizes
    angle = np.linspace(0, 2 * np.pi * turns, int(np.ceil(CYCLE * turns * max(orders))), endpoint=False)
    moving = np.exp(1j * np.outer(angle, orders))
    values = [(moving @ one).real for one in amplitudes]
    shape = amplitudes.shape[0], amplitudes.shape[2]
    high = np.array([_top(one) for one in values]).reshape(shape)
    low = np.array([_top(-one) for one in values]).reshape(shape)
    return np.minimum(high, sizes), -np.minimum(low, sizes)


def _top(values: np.ndarray) -> np.ndarray:
    """Maximum (n,) of periodic values (t, n), by the parabola through the largest one and its neighbours."""
    if not values.shape[1]:
        return np.zeros(0)
    at, columns = values.argmax(axis=0), np.arange(values.shape[1])
    before, here, after = (values[(at + step) % len(values), columns] for step in (-1, 0, 1))
    bend = before - 2 * here + after
    return np.asarray(here - np.where(bend < 0, (after - before) ** 2 / np.where(bend < 0, 8 * bend, 1.0), 0.0))


# --- Maxima over speed: refined, judged, attributed.

SUMMIT = 1e-5  # of the distance of its neighbours: where a maximum is found, which is then right to 1e-9


@dataclass(frozen=True)
class _Judged:
    """Maxima of the torques of the first ``shafts`` readings."""

    forced: _Forced
    map_: Campbell
    settings: CriticalSettings
    shafts: int

    def refined(self, speeds: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Speeds (s,) with those of every maximum that stands out, and the answers there."""
        found = self.forced.answers(speeds)
        sizes = np.abs(found[:, :, : self.shafts])
        more = []
        for o in range(sizes.shape[1]):
            for j in range(self.shafts):
                for i in _summits(sizes[:, o, j]):
                    if _prominence(sizes[:, o, j], i, 0.0) > 1.01:
                        more.append(self._summit(speeds[i - 1], speeds[i + 1], partial(_size, o=o, j=j)))
        for j in range(self.shafts):
            for i in {int(np.argmax(values)) for values in _together(found[:, :, j : j + 1], self.forced.orders)}:
                if 0 < i < len(speeds) - 1:
                    low, high = speeds[i - 1], speeds[i + 1]
                    more.append(self._summit(low, high, partial(self._peak, j=j)))
        new = np.setdiff1d(np.array(more), speeds)
        if not len(new):
            return speeds, found
        every = np.concatenate([speeds, new])
        order = np.argsort(every)
        return every[order], np.concatenate([found, self.forced.answers(new)])[order]

    def _peak(self, one: np.ndarray, j: int) -> float:
        return float(_together(one[None, :, j : j + 1], self.forced.orders)[0][0])

    def _summit(self, low: float, high: float, size: Callable[[np.ndarray], float]) -> float:
        """Speed between two at which ``size`` of the answer (o, y) is largest."""
        best = minimize_scalar(
            lambda speed: -size(self.forced.answers(np.array([speed]))[0]), bounds=(low, high), method="bounded",
            options={"xatol": SUMMIT * (high - low)},
        )  # fmt: skip
        return float(best.x)

    def critical(self, speeds: np.ndarray, torques: np.ndarray) -> tuple[Critical, ...]:
        """Maxima of one order (s, o, n) that stand out, the largest torque of every shaft first."""
        sizes, peaks = np.abs(torques), np.maximum.reduce(np.abs(extremes(torques, self.forced.orders)))
        found = self._unbounded(speeds)
        bare = {(one.shaft, one.order): one.speed for one in found}
        for o, order in enumerate(self.forced.orders):
            for j, part in enumerate(self.forced.system.shafts):
                for i in _summits(sizes[:, o, j]):
                    near = bare.get((part.name, order))
                    if near is not None and speeds[i - 1] <= near <= speeds[i + 1]:
                        continue
                    speed, size = float(speeds[i]), float(sizes[i, o, j])
                    static, mode = self._static(speed)[o, j], self._mode(speed, o, j)
                    if not mode or _prominence(sizes[:, o, j], i, static) < self.settings.prominence:
                        continue
                    if size < self.settings.amplification * static:
                        continue
                    hertz = order * speed / (2 * np.pi)
                    found.append(
                        Critical(part.name, speed, float(peaks[i, j]), order, mode, hertz, size, float(static))
                    )
        places = {part.name: place for place, part in enumerate(self.forced.system.shafts)}
        return tuple(sorted(found, key=lambda one: (places[one.shaft], -one.torque, one.speed)))

    def _unbounded(self, speeds: np.ndarray) -> list[Critical]:
        """Where an order that acts meets a mode that nothing damps."""
        found = []
        for met in self.map_.crossings:
            if abs(met.damping_ratio) > UNDAMPED:
                continue
            o = self.forced.orders.index(met.order)
            beside = met.speed * (1 + 1e-6)
            static = self._static(met.speed)[o]
            size = np.abs(self.forced.answers(np.array([beside]))[0, o])
            for j, part in enumerate(self.forced.system.shafts):
                if size[j] > 1e3 * max(static[j], 1e-9 * size.max()):
                    found.append(
                        Critical(
                            part.name, met.speed, np.inf, met.order, met.mode, met.frequency, np.inf, float(static[j])
                        )
                    )
        return found

    def largest(self, speeds: np.ndarray, torques: np.ndarray, critical: Sequence[Critical]) -> tuple[Largest, ...]:
        """The largest torques (s, o, n) of every shaft."""
        high, low = extremes(torques, self.forced.orders)
        peaks, found = np.maximum(high, -low), []
        for j, part in enumerate(self.forced.system.shafts):
            bare = next((one for one in critical if one.shaft == part.name and one.torque == np.inf), None)
            if bare is not None:
                found.append(Largest(part.name, bare.speed, np.inf, bare.order, False, np.inf, np.inf))
                continue
            i, across = int(peaks[:, j].argmax()), float((high - low)[:, j].max())
            order = self.forced.orders[int(np.abs(torques[i, :, j]).argmax())]
            at_end = i in (0, len(speeds) - 1)
            found.append(Largest(part.name, float(speeds[i]), float(peaks[i, j]), order, at_end, across, across / 2))
        return tuple(found)

    def _static(self, speed: float) -> np.ndarray:
        """Quasi-static torque amplitude (o, n) of every order: every shaft only accelerates what lies beyond it."""
        linear, transfer = self.forced.about(speed)
        pushes = self.forced.amplitudes(np.array([speed]))[0]
        return np.abs(pushes @ _without_swinging(linear, transfer)[:, : self.shafts])

    def _mode(self, speed: float, o: int, j: int) -> int:
        """Number of the mode that makes the maximum of a shaft's torque under an order; 0 if no resonance does."""
        pushes = self.forced.amplitudes(np.array([speed]))[0, o]
        omega = self.forced.orders[o] * speed
        poles, added = self.forced.about(speed)[1].by_poles(1j * omega, pushes)
        pole = poles[
            int((np.abs(added[j]) / np.abs(1j * omega - poles)).argmax())
        ]  # a summit is of the part that changes fastest
        if not pole.imag > 0 or abs(omega - pole.imag) > self.settings.half_widths * abs(pole.real):
            return 0
        row = int(np.abs(self.map_.speeds - speed).argmin())
        known = 1j * self.map_.frequencies[row] - self.map_.damping_ratios[row] * self.map_.natural_frequencies[row]
        apart = np.where(self.map_.frequencies[row] > 0, np.abs(2 * np.pi * known - pole), np.inf)
        return int(np.argmin(apart)) + 1


def _without_swinging(linear: Linear, transfer: Transfer) -> np.ndarray:
    """Readings (u, y) of shafts per N·m of each input if no shaft swung: inertia relief; 0 for an imposed motion."""
    n = linear.model.n
    parts = elements(linear.model, linear.p[None], linear.x0)
    mass, stiff = parts.mass_matrix()[0], parts.spring_transformation[parts.stiffness[0] != 0]
    free = null_space(unit_rows(stiff)) if len(stiff) else np.eye(n)
    held = null_space(free.T) if free.size else np.eye(n)
    forces = mass @ linear.B[n : 2 * n]
    forces = forces - mass @ free @ np.linalg.solve(free.T @ mass @ free, free.T @ forces)
    K = held.T @ parts.stiffness_matrix()[0] @ held
    readings = linear.C[:, :n] @ held @ np.linalg.solve(K, held.T @ forces)
    acts = [name not in linear.model.system.imposed_by for name in linear.model.inputs]
    return np.asarray(np.where(acts, readings, 0.0).T)


def _size(one: np.ndarray, o: int, j: int) -> float:
    return float(abs(one[o, j]))


def _together(amplitudes: np.ndarray, orders: Sequence[float]) -> tuple[np.ndarray, np.ndarray]:
    """Largest absolute value and largest difference (s,) over a period of amplitudes (s, o, 1)."""
    high, low = extremes(amplitudes, orders)
    return np.maximum(high, -low)[:, 0], (high - low)[:, 0]


def _summits(values: np.ndarray) -> list[int]:
    """Local maxima of values (s,), ends left out."""
    inner = (values[1:-1] > values[:-2]) & (values[1:-1] >= values[2:])
    return [int(i) for i in np.flatnonzero(inner) + 1]


def _prominence(values: np.ndarray, i: int, static: float) -> float:
    """A maximum over the larger of the least values to either side before a larger one; beyond the ends: ``static``."""
    least = []
    for side in (values[i::-1], values[i:]):
        larger = np.flatnonzero(side > values[i])
        least.append(float(side[: larger[0]].min() if len(larger) else min(side.min(), max(static, 0.0))))
    return float(values[i] / max(*least, 1e-300))
