"""Plans what excites the controlled bed for its proof: every compared torque, as much as the sensors' noise asks for.

Torques of the road act inside the residual vehicle, so only what the dynamometers make of them has limits. Where the
vehicle hardly answers, they may be many times those of a drive: else nothing is seen beside the noise.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import scipy

from matching.excitation.controlled import ControlledBeds, controlled_beds
from matching.excitation.limits import SLOWEST, ExcitationLimits, demanded_limits
from matching.excitation.motion import ExcitedBeds, ExcitedMotion, SpeedHold
from matching.excitation.recorded_bed import RecordedBed, recorded_bed
from matching.excitation.signals import fade
from matching.fmu.controller import exported_controller
from matching.frequency.case.case import Case
from modelling.common.errors import InputError
from modelling.controller.settings import NO_LIMIT, Settings
from modelling.controller.torque_gone import GONE, KEPT_SAMPLES, has_gone
from modelling.measurement.write import csv_text

PERIODS = 16.0  # of the lowest frequency of the band
SHORTEST = 20.0  # s
BELOW_BAND, ABOVE_BAND = 0.7, 1.2  # of the band's ends: so far the excitation reaches
FREE = 0.25  # share of every limit that stays free
DEMANDED_SHARE = 0.8  # of the manoeuvre's largest torque: peak of a torque that a motor has to give
BEDS = 8  # drawn from what is uncertain, that the limits hold on beside the bed as planned
PHASES = 30  # draws, of which the flattest wave is taken
SAMPLES_A_PERIOD = 8.0  # of the highest frequency, for peaks of motions
NEIGHBOURS = 0.05  # relative distance in frequency within which a response's largest value counts: notches stay noisy
VISIBLE_VARIANCE = 0.1  # of a response over its square, a spectral line alone: beyond it noise hides it
SMALLER = 0.9  # factor on the excitation until no watchdog can take it for a broken shaft
NEARLY_LOST = 0.9, 1.5  # of the thresholds for a torque that is gone: the margin to them


@dataclass(frozen=True)
class Proof:
    """What excites the controlled bed.

    Attributes
    ----------
    inputs : tuple of str (e)
        Compared torques.
    torques : ndarray (t, e)
        N·m, at steps of ``step`` (s).
    used : dict
        Largest share of each limit over the beds that were computed.
    visible : dict
        Share of the band (logarithm of frequency) in which each compared function is expected to show above the noise.
    """

    inputs: tuple[str, ...]
    torques: np.ndarray = field(repr=False)
    step: float
    used: dict[str, float]
    visible: dict[str, float]

    def to_dict(self) -> dict[str, Any]:
        """As ``proof.json`` holds it."""
        duration = len(self.torques) * self.step
        return {"inputs": list(self.inputs), "duration": duration, "limits_used": self.used, "visible": self.visible}


def proof_csv(proof: Proof) -> str:
    """Text of the proof's torques as CSV."""
    time = np.arange(len(proof.torques)) * proof.step
    torques = {name: proof.torques[:, j] for j, name in enumerate(proof.inputs)}
    return csv_text(time, torques, dict.fromkeys(proof.inputs, "N*m"))


def plan_proof(case: Case, speed: float, seed: int = 0) -> Proof:
    """Random-phase multisines on every compared torque, together, over the band of a tuned case.

    Each line is as strong as its part in the error's variance asks for at a given use of the limits; the whole is as
    strong as the limits leave it, on the bed as planned and on beds drawn from what is uncertain.

    Parameters
    ----------
    case : Case
    speed : float
        Of the rotors, rad/s, that the deviations start from.

    Raises
    ------
    InputError
        If the manoeuvre has none of a compared torque that a motor gives, or nothing limits a torque.
    """
    bed, exported = recorded_bed(case), exported_controller(case)
    names = tuple(dict.fromkeys(pair.input for pair in case.compared))
    demanded = demanded_limits(bed, {})
    _check(case, bed, names, demanded)
    step = case.loop["sample_time"]
    count = round(max(PERIODS / case.band[0], SHORTEST) / step)
    lines = np.arange(
        int(np.ceil(BELOW_BAND * case.band[0] * count * step)), int(ABOVE_BAND * case.band[1] * count * step) + 1
    )
    box = case.uncertainty
    values = [box.at(place) for place in np.vstack([np.zeros(len(box.uncertain)), box.draw(BEDS, seed)])]
    beds = controlled_beds(bed, values, exported.law, names, lines / (count * step))
    limits = ExcitationLimits(bed, speed, DEMANDED_SHARE / (1 - FREE) * demanded)
    steady = ExcitedBeds(bed, values, SpeedHold.of(exported.settings)).steady(speed)
    limits.check_steady(steady, 1 - FREE)
    shaping = _Shaping(case, bed, limits, steady, beds, lines, count, exported.settings)
    spectra = np.stack([shaping.alone(e, name, seed) for e, name in enumerate(names)], axis=1)
    spectra *= shaping.largest(spectra, names)
    motion, demands = shaping.motion(spectra, names)
    return Proof(
        names, shaping.wave(spectra, count) * fade(count, step)[:, None], step, limits.used(steady, motion, demands),
        _visible(case, bed, beds, lines / (count * step), np.abs(spectra) ** 2 * count / 4),
    )  # fmt: skip


def _check(case: Case, bed: RecordedBed, names: tuple[str, ...], demanded: np.ndarray) -> None:
    k = len(case.loop.dynamometers)
    for name in names:
        if name in bed.inputs and demanded[bed.inputs.index(name) - k] == 0:
            raise InputError(f"manoeuvre.{name}", "is missing", "its largest torque says how large the proof may be")
        if name not in bed.inputs and "dynamometer_torque" not in case.limits:
            raise InputError("limits.dynamometer_torque", "is missing", f"it says how large {name} may be in the proof")


@dataclass(frozen=True)
class _Shaping:
    """Spectra (l, e) of the excitation, complex amplitudes of cosines at ``lines`` (l,) of ``count`` samples."""

    case: Case
    bed: RecordedBed
    limits: ExcitationLimits
    steady: tuple[np.ndarray, np.ndarray]
    beds: ControlledBeds
    lines: np.ndarray
    count: int
    settings: Settings

    def alone(self, e: int, name: str, seed: int) -> np.ndarray:
        """Spectrum (l,) of one torque that uses the limits alone: least variance of the error for their use."""
        use = self._use(e, name)
        needed = np.sqrt(np.sum(self._noise_to_response(e) / self.lines[:, None], axis=1))
        amplitude = np.sqrt(needed / use)
        rng = np.random.default_rng((seed, e))
        drawn = amplitude * np.exp(2j * np.pi * rng.random((PHASES, len(amplitude))))
        waves = self.wave(drawn.T, self._coarse).T
        spectrum = drawn[np.argmin(np.abs(waves).max(axis=1))]
        spectra = np.zeros((len(spectrum), self.beds.commands.shape[3]), complex)
        spectra[:, e] = spectrum
        names = [""] * spectra.shape[1]
        names[e] = name
        return np.asarray(spectrum * self.largest(spectra, tuple(names)))

    def largest(self, spectra: np.ndarray, names: tuple[str, ...]) -> float:
        """Factor that brings the excitation to the limits, and keeps it from what a watchdog takes for a fault."""
        motion, demands = self.motion(spectra, names)
        scale = self.limits.largest_scale(self.steady, motion, demands, 1 - FREE)
        torques = [self.bed.sensors.index(dynamometer.torque_sensor) for dynamometer in self.case.loop.dynamometers]
        answers = np.einsum("blye,le->bly", self.beds.outputs[:, :, torques], spectra)
        moved = np.stack([self.wave(spectrum, self.count) for spectrum in answers])  # (b, t, k)
        still = self.steady[1][:, None, torques]
        while scale > 0 and _seems_lost(still + scale * moved, self.settings):
            scale *= SMALLER
        return scale

    def motion(self, spectra: np.ndarray, names: tuple[str, ...]) -> tuple[ExcitedMotion, np.ndarray]:
        """The beds' periodic motion and the demands (t, u), by the inputs of the recorded bed."""
        commands, outputs = (
            np.stack(
                [self.wave(np.einsum("lye,le->ly", of_bed, spectra), self._coarse) for of_bed in responses], axis=1
            )
            for responses in (self.beds.commands, self.beds.outputs)
        )
        demands = np.zeros((self._coarse, len(self.bed.inputs)))
        waves = self.wave(spectra, self._coarse)
        for e, name in enumerate(names):
            if name in self.bed.inputs:
                demands[:, self.bed.inputs.index(name)] = waves[:, e]
        return ExcitedMotion(commands, outputs), demands

    def wave(self, spectra: np.ndarray, count: int) -> np.ndarray:
        """One period (t, …) of spectra (l, …), as so many samples."""
        every = np.zeros((count // 2 + 1, *spectra.shape[1:]), complex)
        every[self.lines] = spectra * count / 2
        return np.fft.irfft(every, count, axis=0)

    @property
    def _coarse(self) -> int:
        return min(2 * int(SAMPLES_A_PERIOD / 2 * self.lines[-1]), self.count)

    def _noise_to_response(self, e: int) -> np.ndarray:
        """Variance of noise over squared response (l, h) of the compared functions of a torque, notches filled."""
        name = tuple(dict.fromkeys(pair.input for pair in self.case.compared))[e]
        sensors = [self.bed.sensors.index(pair.sensor) for pair in self.case.compared if pair.input == name]
        power = np.abs(self.beds.outputs[0][:, sensors, e]) ** 2
        middle = len(self.lines) // 2
        width = max(int(NEIGHBOURS * self.lines[middle]), 1)
        return np.asarray(self.bed.noise[sensors] ** 2 / scipy.ndimage.maximum_filter1d(power, 2 * width + 1, axis=0))

    def _use(self, e: int, name: str) -> np.ndarray:
        """Root sum of squares (l,) of the shares of the limits that a torque of 1 N·m uses, on the bed as planned."""
        case, bed = self.case, self.bed
        outputs, total = np.abs(self.beds.outputs[0][:, :, e]) ** 2, np.zeros(len(self.lines))
        if "dynamometer_torque" in case.limits:
            total += (np.abs(self.beds.commands[0][:, :, e]) ** 2).sum(axis=1) / case.limits["dynamometer_torque"] ** 2
        rotors = [bed.sensors.index(dynamometer.speed_sensor) for dynamometer in case.loop.dynamometers]
        total += outputs[:, rotors].sum(axis=1) / ((1 - SLOWEST) * self.limits.speed) ** 2
        limited = [f"shafts.{shaft}.{what}" for what in ("torque", "twist") for shaft in bed.shafts]
        for row, limit in enumerate(limited, len(bed.sensors)):
            if limit in case.limits:
                total += outputs[:, row] / case.limits[limit] ** 2
        if name in bed.inputs:
            total += 1 / self.limits.demanded[bed.inputs.index(name) - len(case.loop.dynamometers)] ** 2
        return np.sqrt(total)


def _seems_lost(torques: np.ndarray, settings: Settings) -> bool:
    """Whether flange torques (b, t, k) come near what the controller takes for a broken shaft."""
    if (settings.lost_torque >= NO_LIMIT).all():
        return False
    below, above = NEARLY_LOST
    count = torques.shape[1] - KEPT_SAMPLES
    recent = np.stack([torques[:, KEPT_SAMPLES - i : KEPT_SAMPLES - i + count] for i in range(KEPT_SAMPLES + 1)])
    return bool(has_gone(recent, below * settings.lost_torque, above * GONE).any())


def _visible(
    case: Case, bed: RecordedBed, beds: ControlledBeds, frequencies: np.ndarray, powers: np.ndarray
) -> dict[str, float]:
    """Share of the band where each compared function shows; ``powers`` (l, e) of the torques' spectral lines."""
    names = list(dict.fromkeys(pair.input for pair in case.compared))
    inside = (frequencies >= case.band[0]) & (frequencies <= case.band[1])
    weights = np.where(inside, 1 / frequencies, 0.0)
    visible = {}
    for pair in case.compared:
        e, y = names.index(pair.input), bed.sensors.index(pair.sensor)
        variance = bed.noise[y] ** 2 / (np.abs(beds.outputs[0][:, y, e]) ** 2 * powers[:, e])
        visible[f"{pair.input} → {pair.sensor}"] = float(weights @ (variance < VISIBLE_VARIANCE) / weights.sum())
    return visible
