"""Damped modes of the closed loop, with what rig and emulated vehicle hold of them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, Protocol

import numpy as np
import scipy
from scipy.linalg import block_diag

from matching.match.loop import Body, LinearMotion, Parts, body
from modelling.bed.vehicle import FeedForward, ResidualVehicle, cut
from modelling.errors import unknown
from modelling.linear.state_space import linear_motion
from modelling.modal.modes import labels
from modelling.modal.result import Mode
from modelling.system import System

# --- What the residual vehicle of a bed reads while the bed runs: the vehicle's own sensors on the emulated side.
#
# The residual vehicle turns on the torque that the bed measures at each flange, lag included, and on the road torques
# of
# the manoeuvre. In the structure ``pi`` that is the model in the loop, as tuned. A model-based feed-forward
# keeps the vehicle's own values, so there, and on the rig without control whose residual vehicle has no effect, it is
# the
# one cut out of the vehicle. Its sensors are compared with the vehicle's for R_RVM (Eq. 21).

PLACE = "residual_vehicle."


def emulated(
    parts: Parts, traces: Mapping[str, np.ndarray], torques: Mapping[str, np.ndarray], *, tuned: bool
) -> dict[str, np.ndarray]:
    """Readings (t,) of the residual vehicle by ``residual_vehicle.SENSOR``, SI.

    Parameters
    ----------
    traces : mapping
        Of a rig from rest at the loop's sample time, by name; the torque sensors of the dynamometers are used.
    torques : mapping
        Of the manoeuvre by input (t,), linear between samples; those that act inside the residual vehicle are used.
    tuned : bool
        Whether it has its tuned values or those of the vehicle.
    """
    loop = parts.case.loop
    bodies = (
        parts.residual
        if tuned
        else tuple(body(part) for part in cut(parts.case.emulated_vehicle, parts.case.rig).parts)
    )
    count = len(next(iter(traces.values())))
    step, rate = loop["sample_time"], np.array([[1 / loop["torque_sensor_lag"]]])
    measured = {
        cut.torque: sign * linear_motion(-rate, rate, traces[dyno.torque_sensor][:, None], step)[:, 0]
        for dyno, cut, sign in zip(parts.dynamometers, parts.cuts, parts.toward, strict=True)
    }
    outputs: dict[str, np.ndarray] = {}
    for part in bodies:
        space, nothing = part.space, np.zeros(count)
        drive = np.stack([measured.get(name, torques.get(name, nothing)) for name in space.inputs], axis=1)
        y = linear_motion(space.A, space.B, drive, step) @ space.C.T + drive @ space.D.T
        outputs |= {PLACE + name: y[:, i] for i, name in enumerate(space.outputs)}
    return outputs


def on_emulated_side(vehicle: System, parts: Parts) -> tuple[str, ...]:
    """Sensors of the vehicle that the residual vehicle has too, less those right at the cuts, which the rotors show."""
    ends = {cut.vehicle_end for cut in parts.cuts}
    there = {sensor.name for part in parts.residual for sensor in part.system.sensors if sensor.of not in ends}
    return tuple(sensor.name for sensor in vehicle.sensors if sensor.name in there)


# --- The loop with its exact dead time, frequency by frequency, in NumPy.


class ExactLoop:
    """The feedback loop of a case; k dynamometers, complex s (f,).

    Parameters
    ----------
    parts : Parts
    dead_time : float, optional
        s; that of the case unless given.
    """

    def __init__(self, parts: Parts, dead_time: float | None = None):
        self.parts = parts
        self.dead_time = parts.case.loop["dead_time"] if dead_time is None else dead_time

    def return_difference(self, s: np.ndarray) -> np.ndarray:
        """I + L at the dynamometers' commands, (f, k, k)."""
        k = len(self.parts.dynamometers)
        plant = self._measured(s, [dynamometer.torque_input for dynamometer in self.parts.dynamometers])
        return np.eye(k) - self._controller(s)[:, :, : 2 * k] @ plant

    def response(self, s: np.ndarray, inputs: Sequence[str], sensors: Sequence[str]) -> np.ndarray:
        """Response (f, y, u) of the rig's sensors to torques on the rig or in the residual vehicle, by feedback
        alone.
        """
        parts, k = self.parts, len(self.parts.dynamometers)
        rig, s = parts.rig.space, np.asarray(s, complex)
        for name in inputs:
            if name not in (*rig.inputs, *parts.simulated):
                raise unknown(name, [*rig.inputs, *parts.simulated], "response")
        H, act = parts.rig.response(s), self._controller(s)
        here = [i for i, name in enumerate(inputs) if name in rig.inputs]
        drive = np.zeros((len(s), k, len(inputs)), complex)
        drive[:, :, here] = act[:, :, : 2 * k] @ self._measured(s, [inputs[i] for i in here])
        for i, name in enumerate(inputs):
            if name in parts.simulated:
                drive[:, :, i] = act[:, :, 2 * k + parts.simulated.index(name)]
        torque = np.linalg.solve(self.return_difference(s), drive)
        rows = [rig.outputs.index(name) for name in sensors]
        columns = [rig.inputs.index(dynamometer.torque_input) for dynamometer in parts.dynamometers]
        total = H[:, rows][:, :, columns] @ torque
        total[:, :, here] += H[:, rows][:, :, [rig.inputs.index(inputs[i]) for i in here]]
        return total

    def _measured(self, s: np.ndarray, inputs: Sequence[str]) -> np.ndarray:
        """Signed, lagged flange torques and rotor speeds (f, 2k, u) of the rig alone for its inputs."""
        parts, rig = self.parts, self.parts.rig.space
        H = parts.rig.response(s)[:, :, [rig.inputs.index(name) for name in inputs]]
        torque = H[:, [rig.outputs.index(dyno.torque_sensor) for dyno in parts.dynamometers]]
        speed = H[:, [rig.outputs.index(dyno.speed_sensor) for dyno in parts.dynamometers]]
        lag = 1 / (1 + np.asarray(s) * parts.case.loop["torque_sensor_lag"])
        return np.concatenate([torque * parts.toward[:, None] * lag[:, None, None], speed], axis=1)

    def _controller(self, s: np.ndarray) -> np.ndarray:
        """Air-gap torques (f, k, 2k + r) for flange torques, rotor speeds, simulated torques; lags included."""
        parts, loop, k = self.parts, self.parts.case.loop, len(self.parts.dynamometers)
        s = np.asarray(s, complex)
        sources = [*(cut.torque for cut in parts.cuts), *parts.simulated]
        count = len(sources) + k  # columns: flange torques (k), rotor speeds (k), simulated torques (r)
        reference = np.zeros((len(s), k, count), complex)
        columns = [*range(k), *range(2 * k, count)]
        for part in parts.residual:
            H, space = part.response(s), part.space
            for j, cut in enumerate(parts.cuts):
                for column, name in zip(columns, sources, strict=True):
                    if cut.speed in space.outputs and name in space.inputs:
                        reference[:, j, column] = H[:, space.outputs.index(cut.speed), space.inputs.index(name)]
        signals = np.eye(2 * k, count)
        law = loop.structure.commands(
            loop.values, s[:, None], [reference[:, j] for j in range(k)], list(signals[k:]), list(signals[:k])
        )
        act = np.exp(-s * self.dead_time) / (1 + s * loop["inverter_lag"])
        return act[:, None, None] * np.stack(law, axis=1)


# --- Padé approximations of a dead time as chains of all-pass sections, well conditioned at any order.


def pade(delay: float, order: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """A (n, n), B (n,), C (n,), D of the diagonal Padé approximation of e^(−s·delay), one input, one output.

    Its poles are those of the Bessel filter: the denominator is the reverse Bessel polynomial in s·delay/2. Each pair
    of poles is one all-pass section in companion form with time in units of its own corner frequency.
    """
    poles = _poles(order) / delay
    A, B, C, D = np.zeros((0, 0)), np.zeros(0), np.zeros(0), 1.0
    for pole in poles[poles.imag >= 0]:
        a, b, c, d = _section(pole)
        # in series: what leaves the chain so far enters the section
        A = np.block([[A, np.zeros((len(A), len(a)))], [np.outer(b, C), a]])
        B, C, D = np.concatenate([B, b * D]), np.concatenate([d * C, c]), d * D
    return A, B, C, D


@lru_cache
def _poles(order: int) -> np.ndarray:
    """Poles (n,) of the approximation of e^(−s)."""
    return 2 * np.asarray(scipy.signal.besselap(order, norm="delay")[1])


def _section(pole: complex) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """(p* + s)/(p − s)-type all-pass of a real pole or a conjugate pair."""
    if abs(pole.imag) <= 1e-9 * abs(pole):
        rate = -pole.real  # (rate − s)/(rate + s) = −1 + 2·rate/(s + rate)
        return np.array([[-rate]]), np.array([rate]), np.array([2.0]), -1.0
    corner, decay = abs(pole), -2 * pole.real  # 1 − 2·decay·s/(s² + decay·s + corner²)
    A = np.array([[0.0, corner], [-corner, -decay]])
    return A, np.array([0.0, decay]), np.array([0.0, -2.0]), 1.0


def parallel(delay: float, order: int, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The same for ``count`` signals at once, delayed by s: A (count·n, count·n), B, C, D; only D = 1 without delay."""
    if delay <= 0:
        return np.zeros((0, 0)), np.zeros((0, count)), np.zeros((count, 0)), np.eye(count)
    A, B, C, D = pade(delay, order)
    many = [A] * count, [B[:, None]] * count, [C[None]] * count
    return block_diag(*many[0]), block_diag(*many[1]), block_diag(*many[2]), D * np.eye(count)


def phase_error(delay: float, order: int, frequencies: np.ndarray) -> np.ndarray:
    """Phase (f,) in rad by which the approximation is off at frequencies (f,), Hz; its gain is 1 everywhere."""
    omega = 2 * np.pi * np.asarray(frequencies)
    if delay <= 0:
        return np.zeros_like(omega)
    poles = _poles(order) / delay
    # all-pass: twice the phase of the denominator, summed pole by pole so that it never wraps
    lag = 2 * np.arctan2(omega[:, None] - poles.imag, -poles.real).sum(axis=1)
    return np.abs(omega * delay - lag)


def good_up_to(delay: float, order: int, error: float) -> float:
    """Frequency in Hz below which the phase error stays under ``error`` (rad)."""
    if delay <= 0:
        return np.inf
    frequencies = np.linspace(0.01, 1.0, 2000) * order / delay
    off = np.flatnonzero(phase_error(delay, order, frequencies) > error)
    return float(frequencies[off[0]]) if len(off) else float(frequencies[-1])


# --- Poles of the closed loop, the dead time replaced by Padé approximations of several orders.

ORDERS = (3, 5, 8)
MORE = (12, 16, 20, 24)  # taken as well where the dead time is long for what the loop does
BELIEVED = np.radians(5.0)  # phase error up to which an approximation counts, as far as the loop has gain
TRUSTED = np.radians(1.0)  # phase error up to which an approximation is believed
RESTING_BELOW = 1e-6  # rad/s: a rigid motion without drag stands here, neither stable nor unstable


@dataclass(frozen=True)
class Approximation:
    """Poles of the feedback loop with one approximation of the dead time.

    Attributes
    ----------
    order : int
    poles : ndarray (x,)
        rad/s.
    phase_error : float
        rad, largest over the band of the case.
    good_up_to : float
        Hz, up to where the phase error stays under 1°.
    """

    order: int
    poles: np.ndarray
    phase_error: float
    good_up_to: float

    @property
    def abscissa(self) -> float:
        """Largest real part, 1/s."""
        return float(self.poles.real.max())

    def unstable(self, neutral: int) -> int:
        """Poles that are not stable, see :func:`resting_and_right`."""
        return resting_and_right(self.poles, neutral)[1]


def resting_and_right(poles: np.ndarray, neutral: int) -> tuple[int, int]:
    """How many poles (x,), 1/s, at 0 are rigid motions without drag, and how many poles are not stable.

    At most ``neutral`` poles at 0 are taken for such motions, which the vehicle has as well; more are not stable.
    """
    resting = int(np.sum(np.abs(poles) < RESTING_BELOW))
    right = int(np.sum((poles.real >= 0) & (np.abs(poles) >= RESTING_BELOW)))
    return min(resting, neutral), right + max(resting - neutral, 0)


def closed_matrix(parts: Parts, order: int, dead_time: float | None = None) -> np.ndarray:
    """State matrix (x, x) of the closed feedback loop: states [bed, controller, dead time].

    ``dead_time`` (s) replaces that of the case.
    """
    delay = parts.case.loop["dead_time"] if dead_time is None else dead_time
    bed, controller, k = parts.bed, parts.controller, len(parts.dynamometers)
    Ap, Bp, Cp, Dp = parallel(delay, order, k)
    y, v = bed.C[: 2 * k], bed.B[:, :k]
    Bc, Dc = controller.B[:, : 2 * k], controller.D[:, : 2 * k]
    u = [Dc @ y, controller.C]  # command from bed and controller states
    return np.block(
        [
            [bed.A + v @ Dp @ u[0], v @ Dp @ u[1], v @ Cp],
            [Bc @ y, controller.A, np.zeros((len(controller.A), len(Ap)))],
            [Bp @ u[0], Bp @ u[1], Ap],
        ]
    )


def approximations(
    parts: Parts, dead_time: float | None = None, orders: tuple[int, ...] = ORDERS
) -> tuple[Approximation, ...]:
    """Poles for every Padé order, lowest first, with the case's dead time (s) or another."""
    delay = parts.case.loop["dead_time"] if dead_time is None else dead_time
    band = np.linspace(0, parts.case.band[1], 50)
    return tuple(
        Approximation(
            order,
            np.linalg.eigvals(closed_matrix(parts, order, dead_time)),
            float(phase_error(delay, order, band).max()),
            good_up_to(delay, order, TRUSTED),
        )
        for order in orders
    )


def sampled_poles(parts: Parts) -> np.ndarray:
    """Poles z (x,) of the feedback loop as it runs: controller sampled (Tustin), held, a true delay line, rig exact.

    The delay line is half a sample shorter than the dead time, which counts the hold, as in the simulation.
    """
    step, k = parts.case.loop["sample_time"], len(parts.dynamometers)
    bed, law = parts.bed, parts.sampled_controller
    motion = LinearMotion(bed.A, bed.B, k, step, parts.case.loop.command_delay())
    A, B, C, D = law.A, law.B[:, : 2 * k], law.C, law.D[:, : 2 * k]
    n, c, oldest = len(bed.A), len(law.A), max(i for i, _ in motion.commands)
    y = bed.C[: 2 * k]
    closed = np.zeros((n + c + oldest * k,) * 2)
    issue = np.zeros((k, len(closed)))  # the command of this sample
    issue[:, :n], issue[:, n : n + c] = D @ y, C
    closed[:n, :n] = motion.whole
    closed[n : n + c, :n], closed[n : n + c, n : n + c] = B @ y, A
    for i, push in motion.commands:
        if i == 0:
            closed[:n] += push @ issue
        else:
            closed[:n, n + c + (i - 1) * k : n + c + i * k] += push
    if oldest:
        closed[n + c : n + c + k] = issue
        closed[n + c + k :, n + c : -k] = np.eye((oldest - 1) * k)
    return np.linalg.eigvals(closed)


def orders_for(delay: float, edge: float) -> tuple[int, ...]:
    """Orders to take: 3, 5, 8 and as many more as bring the phase error at ``edge`` (Hz) to 5°."""
    orders = list(ORDERS)
    for order in MORE:
        if phase_error(delay, orders[-1], np.array([edge]))[0] <= BELIEVED:
            break
        orders.append(order)
    return tuple(orders)


def neutral_motions(parts: Parts) -> int:
    """Rigid motions of the residual vehicle that nothing slows: poles at 0 that the vehicle has as well."""
    return sum(int(np.sum(np.abs(np.linalg.eigvals(part.space.A)) < RESTING_BELOW)) for part in parts.residual)


# --- Stability by encirclements and the modulus margin, on the loop with its exact dead time.

LOWEST, HIGHEST = 1e-4, 5e3  # Hz
STEP = 0.3  # rad: largest phase step of det(I + L) that is believed
MOST_FREQUENCIES = 200_000  # frequencies
STEPS_A_ROUND, ROUNDS = 16, 7  # about a minimum of the margin: 8⁻⁷ = 5e-7 of the interval between grid points is left

Difference = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Encirclements:
    """What the return difference I + L(jω) says.

    Attributes
    ----------
    unstable : int
        Closed-loop poles in the right half plane.
    open_loop_unstable : int
        Those of the open loop, which were counted by its matrices.
    resting : int
        Closed-loop poles at 0.
    remainder : float
        By how much the winding missed a whole number; 0.5 where a pole stands on the imaginary axis elsewhere.
    modulus_margin : float
        Least singular value of I + L from where it counts on: least distance from −1 of a loop of one dynamometer.
    margin_frequency : float
        Hz, where it is reached.
    gain_edge : float
        Hz, above which the loop gain stays below a half: what happens to the phase beyond does not matter.
    frequencies : ndarray (f,)
        Hz, those that were needed.
    """

    unstable: int
    open_loop_unstable: int
    resting: int
    remainder: float
    modulus_margin: float
    margin_frequency: float
    gain_edge: float
    frequencies: np.ndarray

    @property
    def clear(self) -> bool:
        """Whether the winding is a whole number."""
        return abs(self.remainder) < 0.1


def encirclements(parts: Parts, dead_time: float | None = None, margin_from: float = 0.0) -> Encirclements:
    """Count encirclements and find the margin of a case's feedback loop, from ``margin_from`` (Hz) on."""
    loop = ExactLoop(parts, dead_time)
    open_loop = np.concatenate(
        [np.linalg.eigvals(part.space.A) for part in parts.residual] + [np.linalg.eigvals(parts.rig.space.A)]
    )
    resting = int(np.sum(np.abs(open_loop) < RESTING_BELOW))
    resting += parts.case.loop.structure.integrators(parts.case.loop.values) * len(parts.dynamometers)
    right = int(np.sum((open_loop.real > 1e-9) & (np.abs(open_loop) >= RESTING_BELOW)))
    corners = np.abs(open_loop[open_loop.imag > 0]) / (2 * np.pi)
    return count(loop.return_difference, right, resting, loop.dead_time, corners, margin_from)


def count(
    difference: Difference, right: int, resting: int, delay: float, corners: np.ndarray, margin_from: float = 0.0
) -> Encirclements:
    """Encirclements of the origin by det(I + L) along the imaginary axis.

    The winding is that of det(I + L)·(s/(s + 1))^r, r the open loop's poles at 0, so that neither end has a pole:
    1 at s → ∞, c·s^m at s → 0 with m closed-loop poles there, and its phase turns by −π·(unstable − right) − m·π/2 in
    between (Nyquist, the contour passing 0 on its right).

    Parameters
    ----------
    difference : callable
        s (f,) → I + L (f, k, k).
    right, resting : int
        Poles of the open loop in the right half plane and at 0.
    delay : float
        s; the grid resolves its turning phase.
    corners : ndarray
        Hz, where the open loop resonates: the grid starts finer there.
    margin_from : float
        Hz, from where on the modulus margin counts.
    """
    frequencies = np.union1d(_grid(delay, corners, _top(difference)), [margin_from] if margin_from > 0 else [])
    values = difference(2j * np.pi * frequencies)
    while True:
        s = 2j * np.pi * frequencies
        curve = np.linalg.det(values) * (s / (s + 1)) ** resting
        step = np.angle(curve[1:] / curve[:-1])
        wide = np.flatnonzero((np.abs(step) > STEP) & (np.diff(frequencies) > 1e-9 * frequencies[1:]))
        if not len(wide) or len(frequencies) > MOST_FREQUENCIES:
            break
        new = np.sqrt(frequencies[wide] * frequencies[wide + 1])
        values = np.insert(values, wide + 1, difference(2j * np.pi * new), axis=0)
        frequencies = np.insert(frequencies, wide + 1, new)
    slope = np.log(np.abs(curve[1] / curve[0])) / np.log(frequencies[1] / frequencies[0])
    left = round(float(slope))
    unstable = right - step.sum() / np.pi - left / 2
    remainder = 0.5 if len(wide) or np.abs(step).max() > STEP else float(unstable - round(unstable))
    first = min(int(np.searchsorted(frequencies, margin_from)), len(frequencies) - 1)
    margin, where = modulus_margin(difference, frequencies[first:], values[first:])
    gaining = frequencies[_gain(values) > 0.5]
    edge = float(gaining.max(initial=LOWEST))
    return Encirclements(round(unstable), right, left, remainder, margin, where, edge, frequencies)


def _gain(values: np.ndarray) -> np.ndarray:
    """Largest singular value (f,) of L for I + L (f, k, k)."""
    return np.linalg.norm(values - np.eye(values.shape[-1]), 2, axis=(1, 2))


def _top(difference: Difference) -> float:
    """Frequency in Hz up to where the loop is followed: 5 kHz, or more until its gain has gone."""
    top = HIGHEST
    while top < 1e6 and _gain(difference(np.array([2j * np.pi * top])))[0] > 0.05:
        top *= 2
    return top


def _grid(delay: float, corners: np.ndarray, top: float) -> np.ndarray:
    parts = [np.geomspace(LOWEST, top, 500)]
    parts.append(np.array([1e-7, 1e-6, 1e-5]))  # so low that the curve begins on the real axis
    near = np.concatenate([-np.geomspace(0.3, 1e-4, 12), [0.0], np.geomspace(1e-4, 0.3, 12)])
    parts += [corner * (1 + near) for corner in corners]
    if delay > 0:
        parts.append(np.linspace(LOWEST, top, int(min(top * delay * 2 * np.pi / STEP + 2, MOST_FREQUENCIES / 10))))
    grid = np.unique(np.concatenate(parts))
    return grid[(grid > 0) & (grid <= top)]


def modulus_margin(difference: Difference, frequencies: np.ndarray, values: np.ndarray) -> tuple[float, float]:
    """Least singular value of I + L and its frequency in Hz, refined about the five lowest minima of a grid.

    Parameters
    ----------
    difference : callable
        s (n,) → I + L (n, k, k).
    frequencies, values : ndarray (f,), (f, k, k)
        Hz, and the same there.
    """
    sizes = np.linalg.svd(values, compute_uv=False)[:, -1]
    padded = np.concatenate([[np.inf], sizes, [np.inf]])
    minima = np.flatnonzero((sizes <= padded[:-2]) & (sizes <= padded[2:]))
    lowest = minima[np.argsort(sizes[minima])][:5]
    before, after = frequencies[np.maximum(lowest - 1, 0)], frequencies[np.minimum(lowest + 1, len(sizes) - 1)]
    least, where = _refined(difference, np.log(before), np.log(after))
    best = int(np.argmin(least))
    return float(least[best]), float(where[best])


def _refined(difference: Difference, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Least singular values (m,) in intervals of the logarithm of the frequency, and where in Hz.

    All intervals are searched at once: each round keeps the two steps about the lowest of its points.
    """
    rows = np.arange(len(low))
    for _ in range(ROUNDS):
        grid = np.linspace(low, high, STEPS_A_ROUND + 1, axis=-1)
        values = difference(2j * np.pi * np.exp(grid.ravel()))
        sizes = np.linalg.svd(values, compute_uv=False)[:, -1].reshape(grid.shape)
        lowest = np.argmin(sizes, axis=1)
        low, high = grid[rows, np.maximum(lowest - 1, 0)], grid[rows, np.minimum(lowest + 1, STEPS_A_ROUND)]
    return sizes[rows, lowest], np.exp(grid[rows, lowest])


# --- Loop modes

EMULATED = "residual_vehicle."


@dataclass(frozen=True)
class LoopMode:
    """A damped mode of the closed loop.

    Attributes
    ----------
    frequency, damping_ratio : float
        |λ|/2π in Hz and −Re λ/|λ|; a rigid motion stands at 0.0 with damping ratio 0.
    belongs_to : str
        ``feed_forward``: a mode of the model-based feed-forward, which measured torques excite; ``feedback``: of the
        feedback loop, which all other torques excite.
    symmetry : str
    kinetic, potential : dict
        Energy shares of the rig (``inertias.NAME``) and the emulated vehicle (``residual_vehicle.inertias.NAME``); each
        adds up to 1.
    shape : dict
        Complex amplitudes of the rig's inertias, under the vehicle's names where they stand for its own: shared ones,
        and the rig's end of a cut for the inertia behind the cut.
    eigenvalue : complex
        rad/s.
    """

    number: int
    frequency: float
    damping_ratio: float
    belongs_to: str
    symmetry: str
    kinetic: dict[str, float]
    potential: dict[str, float]
    eigenvalue: complex
    shape: dict[str, complex] = field(repr=False, default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """As ``result.json`` holds it."""
        keys = ("number", "frequency", "damping_ratio", "symmetry", "belongs_to", "kinetic", "potential")
        return {key: getattr(self, key) for key in keys}


def feedback_modes(parts: Parts, order: int = ORDERS[-1]) -> tuple[LoopMode, ...]:
    """Modes of the feedback loop, up to where the Padé approximation of that order can be believed.

    Without torque from the dynamometers they are the rig's own: the residual vehicle turns along, but nothing feels it.
    """
    if parts.case.loop.torqueless:
        return tuple(_listed(parts, (), *np.linalg.eig(parts.bed.A), 0, np.inf, "feedback"))
    eigenvalues, vectors = np.linalg.eig(closed_matrix(parts, order))
    limit = good_up_to(parts.case.loop["dead_time"], order, TRUSTED)
    start = len(parts.bed.A)
    return tuple(_listed(parts, parts.residual, eigenvalues, vectors, start, limit, "feedback"))


def feed_forward_modes(
    parts: Parts, feed_forward: FeedForward, reference: ResidualVehicle, belongs_to: str = "feed_forward"
) -> tuple[LoopMode, ...]:
    """Modes of the feed-forward's model, which follows ``reference``, up to 0.45 of its sampling frequency."""
    z, vectors = np.linalg.eig(feed_forward.A - feed_forward.B @ feed_forward.F)
    alive = np.abs(z) > 1e-6
    eigenvalues = np.log(z[alive].astype(complex)) / feed_forward.sample_time
    residual = tuple(body(part) for part in reference.parts)
    start = len(parts.bed.A)
    limit = 0.45 / feed_forward.sample_time
    return tuple(_listed(parts, residual, eigenvalues, vectors[:, alive], start, limit, belongs_to))


# more than six parameters: eigenpairs, and what they are read with
def _listed(
    parts: Parts,
    residual: Sequence[Body],
    eigenvalues: np.ndarray,
    vectors: np.ndarray,
    start: int,
    limit: float,
    belongs_to: str,
) -> Iterable[LoopMode]:
    rig = parts.rig
    rows = [(rig, slice(0, len(rig.space.A)), "")]
    for part in residual:
        rows.append((part, slice(start, start + len(part.space.A)), EMULATED))
        start += len(part.space.A)
    oscillating = (eigenvalues.imag > 1e-9) & (np.abs(eigenvalues) < 2 * np.pi * limit)
    chosen = np.flatnonzero(oscillating | _rigid(parts, residual, eigenvalues, vectors, rows))
    chosen = chosen[np.lexsort((np.abs(eigenvalues[chosen]), eigenvalues[chosen].imag > 0))]
    names = _names_in_vehicle(parts)
    for number, i in enumerate(chosen, 1):
        kinetic, potential = _energies(rows, vectors[:, i])
        turns = rig.turns @ vectors[rows[0][1], i]
        turns = turns / max(turns, key=abs, default=1.0)
        value, rigid = complex(eigenvalues[i]), eigenvalues[i].imag <= 1e-9
        yield LoopMode(
            number,
            0.0 if rigid else abs(value) / (2 * np.pi),
            0.0 if rigid else -value.real / abs(value),
            belongs_to,
            str(labels(turns[:, None], rig.J, rig.image)[0]),
            kinetic,
            {} if rigid else potential,
            value,
            dict(zip((names.get(name, name) for name in rig.masses), turns.tolist(), strict=True)),
        )


def _energies(rows: list[tuple[Body, slice, str]], vector: np.ndarray) -> tuple[dict[str, float], dict[str, float]]:
    kinetic: dict[str, float] = {}
    potential: dict[str, float] = {}
    for side, place, prefix in rows:
        speeds, twists = side.turns @ vector[place], side.twists @ vector[place]
        kinetic |= {prefix + name: float(e) for name, e in zip(side.masses, side.J * np.abs(speeds) ** 2, strict=True)}
        potential |= {
            prefix + name: float(e) for name, e in zip(side.springs, side.stiffness * np.abs(twists) ** 2, strict=True)
        }
    return _shares(kinetic), _shares(potential)


def _shares(energy: dict[str, float]) -> dict[str, float]:
    total = sum(energy.values()) or 1.0
    return {name: value / total for name, value in energy.items()}


def _rigid(
    parts: Parts,
    residual: Sequence[Body],
    eigenvalues: np.ndarray,
    vectors: np.ndarray,
    rows: list[tuple[Body, slice, str]],
) -> np.ndarray:
    """Which eigenvalues (m,) are rig and vehicle coasting as one: real, nothing twists, each rotor turns as its cut."""
    rigid = np.zeros(len(eigenvalues), bool)
    for i in np.flatnonzero(np.abs(eigenvalues.imag) <= 1e-9):
        vector = vectors[:, i]
        moving = sum(float(side.J @ np.abs(side.turns @ vector[place]) ** 2) for side, place, _ in rows)
        twisted = sum(float(side.stiffness @ np.abs(side.twists @ vector[place]) ** 2) for side, place, _ in rows)
        slip, speed = 0.0, 1.0 if not residual else 0.0
        for dyno, cut in zip(parts.dynamometers, parts.cuts, strict=True) if residual else ():
            rotor = parts.rig.space.output(dyno.speed_sensor) @ vector[rows[0][1]]
            wanted = sum(
                side.space.output(cut.speed) @ vector[place]
                for side, place, _ in rows[1:]
                if cut.speed in side.space.outputs
            )
            slip, speed = slip + abs(rotor - wanted) ** 2, speed + abs(rotor) ** 2
        rigid[i] = twisted < 1e-2 * moving and slip < 1e-2 * speed
    return rigid


def _names_in_vehicle(parts: Parts) -> dict[str, str]:
    return {f"inertias.{cut.rig_end}": f"inertias.{cut.vehicle_end}" for cut in parts.cuts}


def match_mode(
    vehicle_mode: Mode, modes: Sequence[LoopMode], inertia: Mapping[str, float] | None = None
) -> tuple[LoopMode, float] | None:
    """The mode of the closed loop that a vehicle mode became, with its MAC 0 … 1.

    The MAC is the modal assurance criterion over the drive side and the ends of the cuts, each coordinate weighted
    by its ``inertia`` (kg·m² by ``inertias.NAME``, 1 unless given). Among the modes that look alike (0.5 or more), the
    one with the nearest eigenvalue on a logarithmic scale and most alike is taken: MAC·exp(−|ln s/s₀|), so that
    of two that move the drive side alike the damping decides, too. None if no mode looks alike, a rigid one, or an
    overdamped motion.
    """
    best: tuple[float, LoopMode, float] | None = None
    for mode in modes:
        if mode.frequency <= 0 or vehicle_mode.frequency <= 0:
            continue
        mac = _mac(vehicle_mode, mode, inertia or {})
        score = mac * float(np.exp(-abs(np.log(eigenvalue_of(mode) / eigenvalue_of(vehicle_mode)))))
        if mac >= 0.5 and (best is None or score > best[0]):
            best = score, mode, mac
    return None if best is None else (best[1], best[2])


class SwingingMotion(Protocol):
    """What has a frequency in Hz and a damping ratio."""

    @property
    def frequency(self) -> float:
        """Hz."""

    @property
    def damping_ratio(self) -> float:
        """−Re s/|s|."""


def eigenvalue_of(mode: SwingingMotion) -> complex:
    """2π·f·(−ζ + j·√(1 − ζ²)), 1/s."""
    damping = float(np.clip(mode.damping_ratio, -1, 1))
    return 2 * np.pi * mode.frequency * complex(-damping, np.sqrt(1 - damping**2))


def _mac(vehicle_mode: Mode, mode: LoopMode, inertia: Mapping[str, float]) -> float:
    names = [name for name in vehicle_mode.shape if name in mode.shape]
    weight = np.sqrt([inertia.get(name, 1.0) for name in names])
    first = weight * np.array([vehicle_mode.shape[name] for name in names])
    second = weight * np.array([mode.shape[name] for name in names])
    return float(
        abs(np.vdot(first, second)) ** 2 / max(np.vdot(first, first).real * np.vdot(second, second).real, 1e-300)
    )
