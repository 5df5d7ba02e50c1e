"""Plans the recording of the bed without emulation that tells most of what the match depends on, within its limits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from matching.match.box import Box
from matching.match.case import Case, Compared
from matching.match.exported import exported_controller
from matching.match.loop import (
    Bed,
    bed_of,
    bed_set,
    compared_sensors,
    disturbing,
    drive,
    law_response,
    responses,
    responses_of,
    return_difference,
    shaft_torque,
    side_by_side,
)
from matching.match.operating_range import rotor_speed
from modelling.bed.bed import ControlLaw
from modelling.controller.law import Settings
from modelling.display import Displayed
from modelling.errors import InputError
from modelling.linear.resolvent import transfer
from modelling.recordings.read import csv_text
from modelling.system import Sensor

# --- The bed without emulation, as a recording shows it: torques that are commanded or demanded in, readings out.

UNKNOWN_NOISE = 1.0  # standard deviation of a sensor without a stated uncertainty, in its SI unit


@dataclass(frozen=True)
class RecordedBed:
    """A case's bed with every sensor of the rig, and further torques of shafts that have limits.

    Attributes
    ----------
    case : Case
        Compares all that is no sensor of the controller: :func:`matching.match.loop.bed_of` gives it then.
    inputs : tuple of str (u)
        Inputs of the rig: the dynamometers', then the others.
    sensors : tuple of str (y)
        Those of the rig.
    noise : ndarray (y,)
        Standard deviation of a sample, SI.
    shafts : tuple of str (s)
        Shafts whose torques, then twists, stand behind the sensors.
    """

    case: Case
    inputs: tuple[str, ...]
    sensors: tuple[str, ...]
    noise: np.ndarray
    shafts: tuple[str, ...]

    def at(self, values: Mapping[str, float]) -> Bed:
        """The bed at values of what is uncertain (:class:`matching.match.box.Uncertain`), SI."""
        return bed_of(self.case, values)

    def mixing(self, values: Mapping[str, float]) -> np.ndarray:
        """Sensors, then torques (N·m) and twists (rad) of the shafts, by what a bed reads and compares (y + 2s, r + c).

        A twist is what the stiffness leaves of the torque.
        """
        names = [*self.case.loop.controller_sensors, *compared_sensors(self.case)]
        seen = dict(zip(names, np.eye(len(names)), strict=True))
        torques, twists = [], []
        for shaft in self.case.rig.shafts:
            first, second = (seen[_speed_of(end)] for end in shaft.between)
            rate = first / (1.0 if shaft.ratio is None else shaft.ratio.value) - second
            stiffness, damping = (
                values.get(f"rig.shafts.{shaft.name}.{key}", getattr(shaft, key).value)
                for key in ("stiffness", "damping")
            )
            torques.append(seen[shaft_torque(shaft.name)])
            twists.append((torques[-1] - damping * rate) / stiffness)
        return np.array([*(seen[name] for name in self.sensors), *torques, *twists])

    def rows(self, bed: Bed, values: Mapping[str, float]) -> tuple[np.ndarray, np.ndarray]:
        """C (y + 2s, x) and D (y + 2s, u) of sensors, shafts' torques (N·m) and twists (rad)."""
        mixing, (y, k) = self.mixing(values), (len(bed.readings), bed.commands.shape[1])
        D = np.pad(mixing[:, y:] @ bed.compared_torques, ((0, 0), (k, 0)))
        return mixing @ np.vstack([bed.readings, bed.compared]), D

    def response(self, values: Mapping[str, float], frequencies: np.ndarray) -> np.ndarray:
        """Responses (f, y, u) of the sensors to the inputs, dead time of the commands included.

        A command varies linearly between samples in a recording, so the half sample of hold that the dead time of the
        loop counts is none of it.
        """
        bed = self.at(values)
        C, D = self.rows(bed, values)
        s = 2j * np.pi * frequencies
        y, k = len(self.sensors), bed.commands.shape[1]
        H = transfer(bed.A, np.hstack([bed.commands, bed.torques]), C[:y], D[:y], s)
        H[:, :, :k] *= np.exp(-s[:, None] * bed.delay)[:, None, :]
        return H


def bed_inputs(case: Case) -> tuple[str, ...]:
    """Inputs (u) of a case's rig: the dynamometers', then the others.

    Raises
    ------
    InputError
        If one is a pedal: what is planned, measured and learned on a bed are torques.
    """
    if pedals := [part for part in case.rig.inputs if part.name in case.rig.pedals]:
        wrong = "is a pedal with a torque map, and this command works with torques"
        right = f"give the rig's file a torque on {pedals[0].on!r} in its place"
        raise InputError(f"{case.path}: rig: inputs.{pedals[0].name}", wrong, right)
    return (*(dynamometer.torque_input for dynamometer in case.loop.dynamometers), *disturbing(case))


def _speed_of(inertia: str) -> str:
    """Name of the added sensor of an inertia's speed."""
    return f"excited_speed_{inertia}"


def recorded_bed(case: Case) -> RecordedBed:
    """The bed of a case as a recording shows it."""
    rig, loop = case.rig, case.loop
    shafts = tuple(shaft.name for shaft in rig.shafts)
    ends = dict.fromkeys(end for shaft in rig.shafts for end in shaft.between)
    further = (
        *(Sensor(shaft_torque(name), "torque", name) for name in shafts),
        *(Sensor(_speed_of(end), "speed", end) for end in ends),
    )
    watched = replace(rig, sensors=(*rig.sensors, *further))
    known = set(loop.controller_sensors)
    # the inputs of these pairs are not looked at: the sensors are
    source = loop.dynamometers[0].torque_input
    compared = tuple(Compared(source, sensor.name) for sensor in watched.sensors if sensor.name not in known)
    noise = [UNKNOWN_NOISE if sensor.uncertainty is None else sensor.uncertainty for sensor in rig.sensors]
    return RecordedBed(
        replace(case, rig=watched, compared=compared),
        bed_inputs(case),
        tuple(sensor.name for sensor in rig.sensors), np.array(noise), shafts,
    )  # fmt: skip


# --- What torques do to beds under their controller, by frequency.


@dataclass(frozen=True)
class ControlledBeds:
    """Responses of beds under emulation; b beds, f frequencies, e torques, k dynamometers.

    Attributes
    ----------
    commands : ndarray (b, f, k, e)
    outputs : ndarray (b, f, y + 2s, e)
        Sensors of the rig, then torques and twists of its shafts.
    noise : ndarray (b, f, y, n)
        What the sensors show of n independent noises of variance 1 a sample: their own, and what the controller makes
        of it.
    """

    commands: np.ndarray
    outputs: np.ndarray
    noise: np.ndarray


def controlled_beds(
    bed: RecordedBed,
    values: Sequence[Mapping[str, float]],
    law: ControlLaw,
    torques: Sequence[str],
    frequencies: np.ndarray,
) -> ControlledBeds:
    """Responses to torques (e), inputs of the rig or known to the law, at frequencies (f,), Hz.

    Parameters
    ----------
    values : sequence of mappings (b)
        Values of what is uncertain, SI.
    """
    names, y = bed.case.loop.controller_sensors, len(bed.sensors)
    beds = responses_of(bed.case, [bed.at(of_bed) for of_bed in values], values, frequencies, vehicle=np.zeros(0))
    acting, mixing = law_response(law, frequencies, names), np.stack([bed.mixing(of_bed) for of_bed in values])[:, None]
    driven, around = drive(beds, acting, torques, law.known), return_difference(beds, acting)
    commands, by_commands = (
        np.linalg.solve(around, driven.commands),
        np.concatenate([beds.held, beds.commanded], axis=2),
    )
    outputs = mixing @ (np.concatenate([driven.read, driven.answered], axis=2) + by_commands @ commands)
    read = [bed.sensors.index(name) for name in names]
    deviations = np.diag(bed.noise)[:, read]
    alone = np.diag(np.where(np.isin(range(y), read), 0.0, bed.noise))
    of_noise = np.linalg.solve(around, acting.of_readings * bed.noise[read])
    moved = deviations + mixing[:, :, :y] @ by_commands @ of_noise
    beside = np.broadcast_to(alone, (*moved.shape[:2], y, y))
    return ControlledBeds(commands, outputs, np.concatenate([moved, beside], axis=3))


# --- Fisher information of a recording about what is uncertain, and the spectrum that makes the most of it.

STEP = 0.1  # of a half-width, for central differences
PRIOR = 3.0  # information of an even distribution over ±1: one over its variance
ROUNDS = 200  # of the multiplicative algorithm
FREQUENCIES_AT_ONCE = 4000  # frequencies
FAINT = 1e-3  # of the largest spectral line: what is smaller tells nothing


def sensitivities(bed: RecordedBed, box: Box, frequencies: np.ndarray) -> np.ndarray:
    """Derivatives (p, f, y, u) of the responses by each quantity in half-widths, over the noise of the sensors.

    ``frequencies`` (f,) are in Hz.
    """
    p = len(box.uncertain)
    slopes = []
    for i in range(p):
        above, below = (bed.response(box.at(sign * STEP * np.eye(p)[i]), frequencies) for sign in (1, -1))
        slopes.append((above - below) / (2 * STEP))
    return np.stack(slopes) / bed.noise[:, None]


def information(bed: RecordedBed, box: Box, inputs: np.ndarray, step: float, lowest: float) -> np.ndarray:
    """Fisher information (p, p) of a recording with inputs (t, u) at steps (s), noise white (Ljung 1999, eq. 9.29).

    What lies below ``lowest`` (Hz) is left out: the unknown start takes it.
    """
    spectrum = np.fft.rfft(inputs, axis=0)
    f = np.fft.rfftfreq(len(inputs), step)
    power = np.abs(spectrum).max(axis=1)
    used = np.flatnonzero((f >= lowest) & (power > FAINT * power.max()))
    p = len(box.uncertain)
    total = np.zeros((p, p))
    for begin in range(0, len(used), FREQUENCIES_AT_ONCE):
        part = used[begin : begin + FREQUENCIES_AT_ONCE]
        answers = np.einsum("pfyu,fu->pfy", sensitivities(bed, box, f[part]), spectrum[part])
        flat = answers.reshape(p, -1)
        total += 2 / len(inputs) * np.real(flat.conj() @ flat.T)
    return total


def line_information(bed: RecordedBed, box: Box, lines: np.ndarray, of_input: np.ndarray, count: int) -> np.ndarray:
    """Information (l, p, p) of ``count`` samples of a sine, mean square 1 (N·m)², at each line (l,) in Hz."""
    slopes = sensitivities(bed, box, lines)
    of_lines = slopes[:, np.arange(len(lines)), :, of_input]  # (l, p, y): NumPy puts the paired axis first
    return count * np.real(np.einsum("lpy,lqy->lpq", of_lines.conj(), of_lines))


def optimal_powers(lines: np.ndarray, of_input: np.ndarray, weights: np.ndarray, budget: np.ndarray) -> np.ndarray:
    """Mean squares (l,) of the lines, each input's adding up to its budget (u,), that minimise tr(W·(F + prior)⁻¹).

    Multiplicative algorithm (Silvey, Titterington and Torsney 1978; Yu 2010), which converges on this convex problem.

    Parameters
    ----------
    lines : ndarray (l, p, p)
        Information of each line with mean square 1.
    of_input : ndarray (l,)
    weights : ndarray (p, p)
    """
    powers = np.zeros(len(lines))
    for j, allowance in enumerate(budget):
        mine = of_input == j
        powers[mine] = allowance / max(mine.sum(), 1)
    prior = PRIOR * np.eye(len(weights))
    for _ in range(ROUNDS):
        inverse = np.linalg.inv(prior + np.tensordot(powers, lines, 1))
        gain = np.einsum("pq,lqp->l", inverse @ weights @ inverse, lines)
        for j, allowance in enumerate(budget):
            mine = of_input == j
            moved = powers[mine] * np.sqrt(np.maximum(gain[mine], 0.0))
            if moved.sum() > 0:
                powers[mine] = allowance * moved / moved.sum()
    return powers


# --- What an excitation does to beds under a slow speed hold, from sample to sample; b beds at once.

SLOWER = 0.05  # crossover of the speed hold that runs beside an excitation, over that of the controller's own


@dataclass(frozen=True)
class SpeedHold:
    """Gains (k,) of the speed hold of each dynamometer, N·m·s/rad and N·m/rad."""

    proportional: np.ndarray
    integral: np.ndarray

    @classmethod
    def of(cls, settings: Settings) -> SpeedHold:
        """Slow enough to leave an excitation alone: the controller's own, slowed down."""
        return cls(SLOWER * settings.hold_proportional, SLOWER**2 * settings.hold_integral)


@dataclass(frozen=True)
class ExcitedMotion:
    """Deviations from the steady motion; b beds, t samples, k dynamometers.

    Attributes
    ----------
    commands : ndarray (t, b, k)
        Torque commands, speed hold included, N·m.
    outputs : ndarray (t, b, y + 2s)
        Sensors of the rig, then torques and twists of its shafts.
    """

    commands: np.ndarray
    outputs: np.ndarray

    def scaled(self, factor: float) -> ExcitedMotion:
        """The motion under that many times the torques: all is linear."""
        return ExcitedMotion(factor * self.commands, factor * self.outputs)


class ExcitedBeds:
    """Several beds of a case, ready to be excited.

    Parameters
    ----------
    bed : RecordedBed
    values : sequence of mappings (b)
        Values of what is uncertain.
    hold : SpeedHold
    """

    def __init__(self, bed: RecordedBed, values: Sequence[Mapping[str, float]], hold: SpeedHold):
        loop = bed.case.loop
        self._hold, self._step = hold, loop["sample_time"]
        beds = [bed.at(bed_values) for bed_values in values]
        self._sampled = side_by_side(beds)
        rows = [bed.rows(linear, bed_values) for linear, bed_values in zip(beds, values, strict=True)]
        self._C, self._D = np.stack([C for C, _ in rows]), np.stack([D for _, D in rows])
        at = [bed.sensors.index(dynamometer.speed_sensor) for dynamometer in loop.dynamometers]
        self._speeds = at
        self._continuous = beds

    def steady(self, speed: float, demands: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Commands (b, k) and outputs (b, y + 2s) of the steady motion with every rotor at a speed, rad/s.

        ``demands`` (d,) are mean torques of the inputs that are no dynamometer's, N·m.
        """
        commands, outputs = [], []
        for linear, C, D in zip(self._continuous, self._C, self._D, strict=True):
            n, k = linear.commands.shape
            given = np.zeros(linear.torques.shape[1]) if demands is None else demands
            equations = np.block([[linear.A, linear.commands], [C[self._speeds], np.zeros((k, k))]])
            wanted = np.append(-linear.torques @ given, np.full(k, speed))
            solution = np.linalg.lstsq(equations, wanted, rcond=None)[0]
            commands.append(solution[n:])
            outputs.append(C @ solution[:n] + D[:, k:] @ given)
        return np.stack(commands), np.stack(outputs)

    def run(self, demands: np.ndarray) -> ExcitedMotion:
        """Deviations under demanded torques (t, u), linear between samples, from the steady motion on.

        What is applied in a sample is the mean of the demand over it.
        """
        beds = self._sampled
        t, (b, waiting, k) = len(demands), beds.B.shape
        applied = np.vstack([(demands[:-1] + demands[1:]) / 2, demands[-1:]])
        pushed = np.einsum("bxd,td->tbx", beds.torques, applied[:, k:])
        direct = np.einsum("byd,td->tby", self._D[:, :, k:], demands[:, k:])
        sent, integral, states = np.empty((t, b, k)), np.zeros((b, k)), np.zeros((t + 1, b, waiting))
        speed_rows = np.pad(self._C[:, self._speeds], ((0, 0), (0, 0), (0, waiting - beds.states)))
        both = np.concatenate([beds.A, beds.B], axis=2)  # one product a sample
        for i in range(t):
            error = -np.matmul(speed_rows, states[i, :, :, None])[:, :, 0]
            sent[i] = applied[i, :k] + self._hold.proportional * error + integral
            integral += self._hold.integral * self._step * error
            acting = np.concatenate([states[i], sent[i]], axis=1)
            states[i + 1] = np.matmul(both, acting[:, :, None])[:, :, 0] + pushed[i]
        outputs = np.swapaxes(np.matmul(self._C, np.moveaxis(states[:-1, :, : beds.states], 0, 2)), 0, 2)
        return ExcitedMotion(sent, np.swapaxes(outputs, 1, 2) + direct)


# --- The bed's limits on an excitation: how much of each is used.

SLOWEST = 0.2  # of the steady speed: no rotor comes nearer to standstill, where dry friction would hold it
BISECTIONS = 14
LARGEST_SCALE = 1e6


@dataclass(frozen=True)
class _Extremes:
    """Extremes over the samples: outputs (b, y + 2s), commands 2 × (b, k), demands (d,); all commands and speeds."""

    highest: np.ndarray
    lowest: np.ndarray
    command: tuple[np.ndarray, np.ndarray]
    demand: np.ndarray
    commands: np.ndarray
    speeds: np.ndarray

    @classmethod
    def of(cls, motion: ExcitedMotion, demands: np.ndarray, speed_rows: list[int]) -> _Extremes:
        k = motion.commands.shape[2]
        return cls(
            motion.outputs.max(axis=0), motion.outputs.min(axis=0),
            (motion.commands.max(axis=0), motion.commands.min(axis=0)), np.abs(demands[:, k:]).max(axis=0),
            motion.commands, motion.outputs[:, :, speed_rows],
        )  # fmt: skip


@dataclass(frozen=True)
class ExcitationLimits:
    """Largest absolute values; ``demanded`` are the largest torques (d,) of inputs that are no dynamometer's, N·m."""

    bed: RecordedBed
    speed: float
    demanded: np.ndarray

    def used(
        self, steady: tuple[np.ndarray, np.ndarray], motion: ExcitedMotion, demands: np.ndarray
    ) -> dict[str, float]:
        """Largest share of each limit, by its name in the case, over all beds and samples.

        Parameters
        ----------
        steady : (ndarray (b, k), ndarray (b, y + 2s))
            Commands and outputs of the steady motion.
        motion : ExcitedMotion
        demands : ndarray (t, u)
        """
        return self._shares(steady, _Extremes.of(motion, demands, self._speed_rows), 1.0)

    @property
    def _speed_rows(self) -> list[int]:
        return [self.bed.sensors.index(dynamometer.speed_sensor) for dynamometer in self.bed.case.loop.dynamometers]

    def _shares(self, steady: tuple[np.ndarray, np.ndarray], moved: _Extremes, scale: float) -> dict[str, float]:
        case, limits = self.bed.case, self.bed.case.limits
        highest, lowest = (steady[1] + scale * reading for reading in (moved.highest, moved.lowest))
        largest = np.maximum(np.abs(highest), np.abs(lowest)).max(axis=0)  # (y + 2s,)
        commands = np.maximum(
            np.abs(steady[0] + scale * moved.command[0]), np.abs(steady[0] + scale * moved.command[1])
        )
        shares = {"slowest rotor": float((1 - lowest[:, self._speed_rows].min() / self.speed) / (1 - SLOWEST))}
        if np.isfinite(largest_torques := case.limits_of("torque")).any():
            shares["dynamometer_torque"] = float((commands / largest_torques).max())
        peaks = {"dynamometer_speed": largest[self._speed_rows].max()}
        if "dynamometer_power" in limits or case.torque_curve is not None:
            torques, speeds = steady[0] + scale * moved.commands, self.speed + scale * moved.speeds
            peaks["dynamometer_power"] = np.abs(torques * speeds).max()
            if case.torque_curve is not None:
                shares["dynamometer_torque_over_speed"] = case.torque_curve.used(torques, speeds)
        shares |= {name: float(peak / limits[name]) for name, peak in peaks.items() if name in limits}
        names = [f"shafts.{shaft}.{what}" for what in ("torque", "twist") for shaft in self.bed.shafts]
        for name, peak in zip(names, largest[len(self.bed.sensors) :], strict=True):
            if name in limits:
                shares[name] = float(peak / limits[name])
        for name, peak, limit in zip(self.bed.inputs[commands.shape[1] :], moved.demand, self.demanded, strict=True):
            if limit > 0:
                shares[f"inputs.{name}"] = float(scale * peak / limit)
        return shares

    def check_steady(self, steady: tuple[np.ndarray, np.ndarray], allowed: float) -> None:
        """The steady speed alone must hold every limit up to a share ``allowed``."""
        still = ExcitedMotion(np.zeros((1, *steady[0].shape)), np.zeros((1, *steady[1].shape)))
        used = self.used(steady, still, np.zeros((1, len(self.bed.inputs))))
        name = max(used, key=lambda key: used[key])
        if used[name] > allowed:
            raise InputError(
                "--speed",
                f"{self.speed:g} rad/s alone takes {100 * used[name]:.0f} % of {name}, "
                f"{100 * allowed:.0f} % are allowed",
                "choose another speed",
            )

    def largest_scale(
        self, steady: tuple[np.ndarray, np.ndarray], motion: ExcitedMotion, demands: np.ndarray, allowed: float
    ) -> float:
        """Largest factor on an excitation with every limit used up to a share ``allowed``.

        Parameters are those of :meth:`used`; demands (t, u) in N·m.
        """

        moved = _Extremes.of(motion, demands, self._speed_rows)

        def holds(scale: float) -> bool:
            return max(self._shares(steady, moved, scale).values()) <= allowed

        low, high = 0.0, 1.0
        while holds(high) and high < LARGEST_SCALE:
            low, high = high, 2 * high
        for _ in range(BISECTIONS):
            middle = (low + high) / 2
            low, high = (middle, high) if holds(middle) else (low, middle)
        return low


def check_demanded(case: Case, stated: Mapping[str, float]) -> None:
    """Whether stated torques are those of inputs that are no dynamometer's."""
    names = disturbing(case)
    for name in stated:
        if name not in names:
            raise InputError(f"--limit {name}", "is no input beside the dynamometers'", f"choose of {', '.join(names)}")


def demanded_limits(bed: RecordedBed, stated: Mapping[str, float]) -> np.ndarray:
    """Largest torques (d,) of the inputs beside the dynamometers: as stated, else as large as the manoeuvre."""
    case, names = bed.case, bed.inputs[len(bed.case.loop.dynamometers) :]
    demands = []
    for name in names:
        manoeuvre = case.manoeuvre.get(name)
        peak = 0.0 if manoeuvre is None else float(np.abs(manoeuvre.torque(manoeuvre.time())).max())
        demands.append(stated.get(name, peak))
    return np.array(demands)


# --- A planned excitation with what it is expected to tell.


@dataclass(frozen=True)
class Expected:
    """A quantity before and after the recording: standard uncertainties in its SI unit, and its part of the error.

    ``share_before`` and ``share_after`` are response errors (rms over the compared functions and the band) that come
    from not knowing this quantity alone.
    """

    name: str
    value: float
    unit: str
    before: float
    after: float
    share_before: float
    share_after: float

    def to_dict(self) -> dict[str, Any]:
        """As ``excite.json`` holds it."""
        return {
            "name": self.name, "value": self.value, "unit": self.unit, "standard_uncertainty_before": self.before,
            "standard_uncertainty_after": self.after, "response_error_before": self.share_before,
            "response_error_after": self.share_after,
        }  # fmt: skip


@dataclass(frozen=True)
class Part:
    """A part of an excitation: what it is, begin and end (s), and its factor on the shape."""

    kind: str
    begin: float
    end: float
    amplitude: float


@dataclass(frozen=True)
class ExcitationPlan(Displayed):
    """A planned excitation; t samples, u inputs.

    Attributes
    ----------
    speed : float
        rad/s: the rotors' steady speed, held slowly beside the excitation.
    hold : dict
        Gains of that speed hold by dynamometer.
    time, torques : ndarray (t,), (t, u)
        Demanded torques beside the speed hold's, N·m.
    parts : tuple of Part
    fitted_until : float
        s: the recording up to here is fitted, which is all of it: a diagnosis judges by blocks, left out in turn.
    expected : tuple of Expected
        What matters most for the match first.
    error_before, error_after, allowed : float
        Response error from all that is not known together, and what the case allows.
    longer : float
        Times as long an excitation that leaves no more than what is allowed; 1 where this one does, infinite where none
        does.
    used : dict
        Largest share of each limit over the beds that were simulated.
    margin, beds : float, int
        Share of every limit left free, and number of beds simulated.
    notes : tuple of str
        What the user should know.
    """

    title: str
    speed: float
    hold: dict[str, tuple[float, float]]
    inputs: tuple[str, ...]
    time: np.ndarray = field(repr=False)
    torques: np.ndarray = field(repr=False)
    parts: tuple[Part, ...]
    fitted_until: float
    expected: tuple[Expected, ...]
    error_before: float
    error_after: float
    allowed: float
    longer: float
    used: dict[str, float]
    margin: float
    beds: int
    notes: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """As ``excite.json`` holds it."""
        return {
            "title": self.title,
            "file": "excitation.csv",
            "speed": self.speed,
            "speed_hold": {name: {"proportional": p, "integral": i} for name, (p, i) in self.hold.items()},
            "duration": float(self.time[-1]),
            "parts": [vars(part) for part in self.parts],
            "fitted_until": self.fitted_until,
            "response_error": {"before": self.error_before, "after": self.error_after, "allowed": self.allowed},
            "times_as_long": self.longer if np.isfinite(self.longer) else None,
            "expected": [quantity.to_dict() for quantity in self.expected],
            "limits_used": self.used,
            "margin": self.margin,
            "beds": self.beds,
            "notes": list(self.notes),
        }


def excitation_csv(plan: ExcitationPlan) -> str:
    """Text of ``excitation.csv``: demanded torques beside the speed hold's, linear between samples."""
    return torques_csv(plan.time, plan.inputs, plan.torques)


def torques_csv(time: np.ndarray, inputs: Sequence[str], torques: np.ndarray) -> str:
    """Text of torques (t, u), N·m, at times (t,), s, as CSV."""
    return csv_text(time, dict(zip(inputs, torques.T, strict=True)), dict.fromkeys(inputs, "N*m"))


# --- How much the response error of the controlled bed depends on each quantity that is not known exactly.

POINTS = 60  # frequencies over the band


def error_weights(case: Case) -> np.ndarray:
    """Matrix W (p, p) with mean square response error = θᵀ·W·θ for small offsets θ, in half-widths of the case's box.

    The controller stays as it is, the bed is off, and the vehicle has the bed's specimen.
    """
    box, loop = case.uncertainty, case.loop
    p = len(box.uncertain)
    low, high = np.log(case.band)
    frequencies = np.exp(low + (high - low) * (np.arange(POINTS) + 0.5) / POINTS)
    positions = STEP * np.vstack([np.eye(p), -np.eye(p)])
    beds = bed_set(case, [box.at(position) for position in positions], frequencies)
    acting = law_response(exported_controller(case).law.linear, frequencies, loop.controller_sensors)
    ratio = responses(beds, acting, acting.known) / beds.vehicle
    slopes = np.log(ratio[:p] / ratio[p:]) / (2 * STEP)
    flat = slopes.reshape(p, -1)
    return np.real(flat.conj() @ flat.T) / flat.shape[1]


# --- Shapes of excitation: multisine, chirp and steps, each beginning and ending at zero.

FADE = 0.25  # s at both ends of a part
STEP_RISE = 0.02  # s: a step is a ramp of this time
CREST_TRIES = 40  # draws of the phases, of which the flattest is taken


def fade(samples: int, step: float) -> np.ndarray:
    """Window (t,) that rises and falls by half a cosine at its ends; ``step`` in s."""
    edge = min(round(FADE / step), samples // 4)
    window = np.ones(samples)
    window[:edge] = (1 - np.cos(np.pi * np.arange(edge) / edge)) / 2
    window[samples - edge :] = window[:edge][::-1]
    return window


def multisine(
    lines: np.ndarray, of_input: np.ndarray, powers: np.ndarray, inputs: int, samples: int, step: float, seed: int
) -> np.ndarray:
    """Torques (t, u): sines at lines (l,), Hz, of mean squares ``powers`` (l,), with drawn phases and a small peak.

    ``of_input`` (l,) is each line's input, ``step`` in s.
    """
    rng = np.random.default_rng(seed)
    time = np.arange(samples) * step
    waves = 2j * np.pi * lines[:, None] * time
    out = np.zeros((samples, inputs))
    for j in range(inputs):
        mine = np.flatnonzero((of_input == j) & (powers > 0))
        if not len(mine):
            continue
        amplitude = np.sqrt(2 * powers[mine])
        carriers = np.exp(waves[mine])
        drawn = np.exp(2j * np.pi * rng.random((CREST_TRIES, len(mine))))
        shapes = np.real((drawn * amplitude) @ carriers)
        out[:, j] = shapes[np.argmin(np.abs(shapes).max(axis=1))]
    return out * fade(samples, step)[:, None]


def chirp(low: float, high: float, input_index: int, inputs: int, samples: int, step: float) -> np.ndarray:
    """Torques (t, u): a sine of amplitude 1 whose frequency (Hz) grows exponentially, on one input; ``step`` in s."""
    time, lasts = np.arange(samples) * step, samples * step
    rate = np.log(high / low)
    out = np.zeros((samples, inputs))
    out[:, input_index] = np.sin(2 * np.pi * low * lasts / rate * np.expm1(rate * time / lasts))
    return out * fade(samples, step)[:, None]


def steps(input_index: int, inputs: int, samples: int, step: float) -> np.ndarray:
    """Torques (t, u): up, down through zero to the other side, and back, amplitude 1, on one input; ``step`` in s."""
    lasts = samples * step
    at = np.array([0.05, 0.05, 0.35, 0.35, 0.65, 0.65]) * lasts
    at[1::2] += STEP_RISE
    out = np.zeros((samples, inputs))
    out[:, input_index] = np.interp(np.arange(samples) * step, at, [0.0, 1.0, 1.0, -1.0, -1.0, 0.0])
    return out


# --- Beds of the box on which an excitation comes nearest to each limit, and by how much it has to be smaller there.

SLOPE_STEP = 0.5  # of a half-width, over which the slope of a limit's use is taken
BEDS_AT_ONCE = 8  # beds that are simulated together: recordings of all sensors and shafts are held in memory


def scale_on_worst_beds(limits: ExcitationLimits, box: Box, hold: SpeedHold, torques: np.ndarray) -> float:
    """Largest factor, at most 1, on demanded ``torques`` (t, u), N·m, with no limit exceeded on the box's worst beds.

    For each limit that is the corner to which its use rises, by its slope over each uncertain quantity. No margin is
    left there: the margin is for what is not in the box.
    """
    positions = np.vstack([np.zeros(len(box.uncertain)), SLOPE_STEP * np.eye(len(box.uncertain))])
    used: list[dict[str, float]] = []
    for first in range(0, len(positions), BEDS_AT_ONCE):
        beds = _beds(limits, box, hold, positions[first : first + BEDS_AT_ONCE])
        (commands, outputs), motion = beds.steady(limits.speed), beds.run(torques)
        for b in range(len(commands)):
            part = slice(b, b + 1)
            moved = ExcitedMotion(motion.commands[:, part], motion.outputs[:, part])
            used.append(limits.used((commands[part], outputs[part]), moved, torques))
    shares = np.array([list(of_bed.values()) for of_bed in used])  # (1 + p, l)
    corners = np.unique(np.sign(shares[1:] - shares[0]).T, axis=0)
    scale = 1.0
    for first in range(0, len(corners), BEDS_AT_ONCE):
        beds = _beds(limits, box, hold, corners[first : first + BEDS_AT_ONCE])
        steady = beds.steady(limits.speed)
        limits.check_steady(steady, 1.0)
        scale = min(scale, limits.largest_scale(steady, beds.run(torques), torques, 1.0))
    return scale


def _beds(limits: ExcitationLimits, box: Box, hold: SpeedHold, positions: np.ndarray) -> ExcitedBeds:
    return ExcitedBeds(limits.bed, [box.at(position) for position in positions], hold)


# --- Plans an identification recording: what matters for the match, within the bed's limits.

SHARES = (("multisine", 0.42), ("chirp", 0.16), ("steps", 0.12), ("multisine", 0.30))  # of the duration
LINES = 90  # of the multisine, over the frequencies excited
HIGHEST_TIMES_BAND, HIGHEST_TIMES_SAMPLING = 2.0, 0.06  # highest frequency, the lower of the two: a sample is short
EVEN = 0.3  # share of each input's power that is spread evenly, for what no quantity of the model stands for
REST = 0.5  # s without excitation at the beginning
SPEED_SHARE = 0.25  # of the largest speed: where the bed turns unless the case or the caller says otherwise
SHORTEST_PLAN = 6.0  # s
SHAPING_BEDS = 4  # of those simulated, that each part is made as large as possible on
LONGEST = 100.0  # times as long as an excitation: nobody records longer to know more
SECOND_SEED = 1  # of the last multisine: another wave than the first


@dataclass(frozen=True)
class ExcitationOrder:
    """What is wanted of a plan: duration (s), share of every limit that stays free, steady speed of the rotors (rad/s;
    None: from the case), largest torques of inputs that are no dynamometer's (N·m), beds to simulate, seed."""

    duration: float = 20.0
    margin: float = 0.2
    speed: float | None = None
    largest: Mapping[str, float] = field(default_factory=dict)
    beds: int = 20
    seed: int = 0


def plan_excitation(case: Case, order: ExcitationOrder | None = None) -> ExcitationPlan:
    """Plan the recording that tells most of what the match depends on."""
    order = order or ExcitationOrder()
    case = replace(case, uncertainty=case.uncertainty.without("vehicle."))  # no recording of the bed tells these
    bed = recorded_bed(case)
    check_order(case, order)
    speed = steady_speed(case) if order.speed is None else order.speed
    limits = ExcitationLimits(bed, speed, demanded_limits(bed, order.largest))
    box = case.uncertainty
    hold = SpeedHold.of(exported_controller(case).settings)
    drawn = [
        box.at(position) for position in np.vstack([np.zeros(len(box.uncertain)), box.draw(order.beds, order.seed)])
    ]
    beds = ExcitedBeds(bed, drawn, hold)
    steady = beds.steady(speed)
    limits.check_steady(steady, 1 - order.margin)
    weights = error_weights(case)
    torques, parts = _signals(bed, ExcitedBeds(bed, drawn[:SHAPING_BEDS], hold), limits, weights, order)
    motion = beds.run(torques)
    # parts run into each other, and some beds answer more than those that the parts were shaped on
    together = min(limits.largest_scale(steady, motion, torques, 1 - order.margin), 1.0)
    within = scale_on_worst_beds(limits, box, hold, together * torques)
    together *= within
    torques, motion = together * torques, motion.scaled(together)
    parts = tuple(replace(part, amplitude=together * part.amplitude) for part in parts)
    used = limits.used(steady, motion, torques)
    step = case.loop["sample_time"]
    recorded = np.hstack([motion.commands[:, 0], torques[:, motion.commands.shape[2] :]])
    total = information(bed, box, recorded, step, _lowest(case, order))
    names = [dynamometer.name for dynamometer in case.loop.dynamometers]

    def left(longer: float) -> np.ndarray:
        return np.asarray(np.linalg.inv(longer * total + PRIOR * np.eye(len(total))))

    covariance = left(1.0)
    enough = (n for n in np.geomspace(1, LONGEST, 24) if np.sqrt(np.trace(weights @ left(n))) <= case.tolerance)
    return ExcitationPlan(
        case.title, speed,
        {name: (float(p), float(i)) for name, p, i in zip(names, hold.proportional, hold.integral, strict=True)},
        bed.inputs, np.arange(len(torques)) * step, torques, parts, len(torques) * step,
        _expected(case, weights, covariance), float(np.sqrt(np.trace(weights) / PRIOR)),
        float(np.sqrt(np.trace(weights @ covariance))), case.tolerance,
        float(next(enough, np.inf)), used, order.margin, order.beds + 1, _notes(bed, limits, within),
    )  # fmt: skip


def check_order(case: Case, order: ExcitationOrder) -> None:
    """Whether a case holds what a plan needs, and an order can be met."""
    check_demanded(case, order.largest)
    stated = np.isfinite(case.limits_of("torque")).all(), "dynamometer_speed" in case.limits
    for name, there in zip(("dynamometer_torque", "dynamometer_speed"), stated, strict=True):
        if not there:
            raise InputError(
                f"{case.path}: limits.{name}", "is missing", "an excitation is planned within the bed's limits"
            )
    if not case.uncertainty.uncertain:
        right = "state under [uncertainty] what is not known exactly"
        raise InputError(f"{case.path}: uncertainty", "nothing is uncertain", right)
    if order.duration < SHORTEST_PLAN:
        raise InputError("--duration", f"{order.duration:g} s are too short", f"{SHORTEST_PLAN:g} s or more are needed")
    if not 0 <= order.margin < 1:
        raise InputError("--margin", f"{order.margin:g} is no share", "0 ≤ margin < 1 is needed")


def steady_speed(case: Case) -> float:
    """Steady speed of the rotors, rad/s: the operating point's if there is one, else a share of the largest.

    So it is with a vehicle of others: it is compared in time at any speed, and answers the more clearly the faster.
    """
    speed = rotor_speed(case.rig, case.loop)
    if speed > 0 and case.vehicle_in_the_loop is None:
        return speed
    if "dynamometer_speed" not in case.limits:
        raise InputError(
            f"{case.path}: limits.dynamometer_speed", "is missing", "a steady speed on the bed is chosen by it"
        )
    return SPEED_SHARE * case.limits["dynamometer_speed"]


def _lowest(case: Case, order: ExcitationOrder) -> float:
    return max(case.band[0] / 2, 3 / (SHARES[0][1] * order.duration))


def _signals(
    bed: RecordedBed, beds: ExcitedBeds, limits: ExcitationLimits, weights: np.ndarray, order: ExcitationOrder
) -> tuple[np.ndarray, tuple[Part, ...]]:
    """Torques (t, u) and parts, each part as large as the limits leave it: what a plan is made of."""
    case = bed.case
    steady, step, count = beds.steady(limits.speed), case.loop["sample_time"], len(bed.inputs)
    low = _lowest(case, order)
    high = min(HIGHEST_TIMES_BAND * case.band[1], HIGHEST_TIMES_SAMPLING / step)
    allowed = 1 - order.margin
    sizes = np.concatenate([case.limits_of("torque"), limits.demanded])
    usable = [j for j, size in enumerate(sizes) if size > 0]
    lasts = SHARES[0][1] * order.duration
    lines = np.unique(np.round(np.geomspace(low, high, LINES) * lasts)) / lasts
    of_input = np.array(usable)[np.arange(len(lines)) % len(usable)]
    each = line_information(bed, case.uncertainty, lines, of_input, round(lasts / step))
    scale = 0.1
    for _ in range(2):  # the best spectrum depends a little on how large it may be
        budget = (scale * sizes) ** 2
        powers = (1 - EVEN) * optimal_powers(each, of_input, weights, budget)
        for j in usable:
            powers[of_input == j] += EVEN * budget[j] / max(np.sum(of_input == j), 1)
        shape = multisine(lines, of_input, powers, count, round(lasts / step), step, order.seed)
        scale *= limits.largest_scale(steady, beds.run(shape), shape, allowed)
    pieces, parts, at = [np.zeros((round(REST / step), count))], [], REST
    for number, (kind, share) in enumerate(SHARES):
        samples = round((share * order.duration - (REST if number == 0 else 0.0)) / step)
        if kind == "multisine":
            shape = multisine(
                lines, of_input, powers, count, samples, step, order.seed + (SECOND_SEED if number else 0)
            )
        else:
            single = [
                chirp(low, case.band[1], j, count, samples // len(usable), step) * sizes[j] if kind == "chirp"
                else steps(j, count, samples // len(usable), step) * sizes[j]
                for j in usable
            ]  # fmt: skip
            shape = np.vstack(single)
        factor = limits.largest_scale(steady, beds.run(shape), shape, allowed)
        pieces.append(factor * shape)
        parts.append(Part(kind, at, at + len(shape) * step, factor))
        at += len(shape) * step
    return np.vstack(pieces), tuple(parts)


def _expected(case: Case, weights: np.ndarray, covariance: np.ndarray) -> tuple[Expected, ...]:
    """What matters most first."""
    expected = []
    for quantity, weight, variance in zip(
        case.uncertainty.uncertain, np.diag(weights), np.diag(covariance), strict=True
    ):
        before, after = 1 / np.sqrt(PRIOR), float(np.sqrt(variance))
        name = quantity.name
        unit = "1"
        if name.startswith("rig."):
            unit = case.rig.units[name.removeprefix("rig.")]
        elif name.startswith("loop."):
            unit = case.loop.quantities[name.removeprefix("loop.")].unit
        expected.append(
            Expected(
                name, quantity.value, unit, before * quantity.half_width, after * quantity.half_width,
                float(np.sqrt(weight) * before), float(np.sqrt(weight) * after),
            )
        )  # fmt: skip
    return tuple(sorted(expected, key=lambda quantity: -quantity.share_before))


def _notes(bed: RecordedBed, limits: ExcitationLimits, within: float) -> tuple[str, ...]:
    k = len(bed.case.loop.dynamometers)
    notes = [
        f"{100 * (1 - within):.0f} % smaller than drawn beds allow: "
        "else the worst bed of [uncertainty] would exceed a limit"
    ]
    notes = notes if within < 0.995 else []
    notes += [
        f"{name} is not excited: the case's manoeuvre has none of it, and no limit is stated for it"
        for name, largest in zip(bed.inputs[k:], limits.demanded, strict=True)
        if largest == 0
    ]
    notes += [
        f"{part.name} states no uncertainty: its noise is taken as 1 {part.unit}"
        for part in bed.case.rig.sensors
        if part.uncertainty is None and part.name in bed.sensors
    ]
    return tuple(notes)
