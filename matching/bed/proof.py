"""Plans what excites the controlled bed for its proof, and says what the recording will tell before it is made.

Torques of the road act inside the residual vehicle, so only what the dynamometers make of them has limits. Where the
vehicle hardly answers, they may be many times those of a drive: else nothing is seen beside the noise.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from matching.bed.excite import (
    FADE,
    SLOWEST,
    ControlledBeds,
    ExcitationLimits,
    ExcitedBeds,
    ExcitedMotion,
    RecordedBed,
    SpeedHold,
    controlled_beds,
    demanded_limits,
    fade,
    recorded_bed,
    torques_csv,
)
from matching.bed.measured import MeasuredFunction, MeasuredMode, measured_mode
from matching.bed.vehicle_beside import reached_by_torques, turning_at
from matching.bed.verify import (
    LARGEST_UNKNOWN,
    SUFFICIENT,
    UNKNOWN_VARIANCE,
    Figures,
    log_weights,
    standard_uncertainty,
    together_variance,
)
from matching.match.case import Case
from matching.match.exported import controller_on_the_bed, exported_controller
from matching.match.responses import ComparedBed
from matching.match.targets import target_modes
from modelling.controller.law import GONE, KEPT_SAMPLES, NO_LIMIT, Settings, has_gone
from modelling.display import Displayed
from modelling.errors import InputError, listed
from modelling.linear.steady_motion import torques_of


@dataclass(frozen=True)
class ProofSettings:
    """What a proof is planned by; the origin of a number is given where it is not a choice."""

    longest: float = 180.0  # s: what a bed gives to one recording
    sufficient: float = SUFFICIENT  # of a tolerance: standard uncertainty that decides
    least_periods: int = 2  # fewer leave no bin between the lines for the noise
    below_band: float = 0.7  # of the band's lower end: modes near it are fitted with what lies below
    above_band: float = 1.2  # of the band's upper end
    of_half_width: float = 1.0  # distance of a torque's lines over a target mode's half-width: sums over them are exact
    of_mode: float = 0.05  # the same over its frequency: ten lines in the range that a mode is fitted in
    of_band: float = 0.125  # the same over the band's lower end
    distance: float = 0.015  # relative distance of a torque's lines, at least: fewer lines are stronger ones
    decayed: float = 4.0  # time constants of the slowest target mode before the first period that counts
    free: float = 0.25  # share of every limit that stays free
    demanded_share: float = 0.8  # of the manoeuvre's largest torque: peak of a torque that a motor has to give
    kept_closed: float = 0.25  # of a free play's mean torque, that is left at the least moment
    beds: int = 8  # drawn from what is uncertain, that the limits hold on beside the bed as planned
    phases: int = 30  # draws, of which the flattest wave is taken
    samples_a_period: float = 8.0  # of the highest frequency, for peaks of motions
    neighbours: float = 0.05  # relative distance within which a response's largest value counts: notches stay noisy
    smaller: float = 0.9  # factor on the excitation until no watchdog can take it for a broken shaft
    nearly_lost: tuple[float, float] = (0.9, 1.5)  # of the thresholds for a torque that is gone: the margin to them
    errors: tuple[float, ...] = (0.0, 0.1, 0.25, 0.5, 1.0, 2.0)  # of the tolerance: the uncertainty is stated for these


PROOF = ProofSettings()


@dataclass(frozen=True)
class ExpectedUncertainty:
    """What a recording will tell of a response error: standard uncertainties (n,) for errors (n,).

    ``name`` is ``measured`` or ``unmeasured`` torques, ``allowed`` the error that the case allows.
    """

    name: str
    allowed: float
    errors: tuple[float, ...]
    uncertainties: tuple[float, ...]

    @property
    def largest(self) -> float:
        """The largest of them: it says which error is told from none."""
        return max(self.uncertainties)

    def at(self, error: float) -> float:
        """The standard uncertainty to expect for an error."""
        return float(np.interp(error, self.errors, self.uncertainties))

    def to_dict(self) -> dict[str, Any]:
        """As ``proof.json`` holds it."""
        return {
            "name": self.name, "allowed": self.allowed, "errors": list(self.errors),
            "standard_uncertainties": list(self.uncertainties),
        }  # fmt: skip


@dataclass(frozen=True)
class Proof(Displayed):
    """What excites the controlled bed.

    Attributes
    ----------
    inputs : tuple of str (e)
        Compared torques.
    torques : ndarray (t, e)
        N·m, at steps of ``step`` (s).
    period, periods : float, int
        Length of a period (s), and how many follow each other at the end.
    used : dict
        Largest share of each limit over the beds that were computed.
    visible : dict
        Share of the band (logarithm of frequency) in which each compared function is expected to show above the noise.
    expected : tuple of ExpectedUncertainty
        By kind of torque.
    modes : dict
        Expected standard uncertainties of frequency (Hz) and damping ratio by target mode; None: it will not show.
    notes : tuple of str
        What the limits do not allow, and what would.
    """

    inputs: tuple[str, ...]
    torques: np.ndarray = field(repr=False)
    step: float
    period: float
    periods: int
    used: dict[str, float]
    visible: dict[str, float]
    expected: tuple[ExpectedUncertainty, ...]
    modes: dict[int, MeasuredMode | None]
    notes: tuple[str, ...]

    @property
    def duration(self) -> float:
        """Of the recording, s."""
        return len(self.torques) * self.step

    def to_dict(self) -> dict[str, Any]:
        """As ``proof.json`` holds it."""
        return {
            "inputs": list(self.inputs), "duration": self.duration, "period": self.period, "periods": self.periods,
            "limits_used": self.used, "visible": self.visible,
            "expected": [one.to_dict() for one in self.expected],
            "modes": [
                {
                    "vehicle_mode": number,
                    "frequency_uncertainty": None if mode is None else mode.frequency_uncertainty,
                    "damping_uncertainty": None if mode is None else mode.damping_uncertainty,
                }
                for number, mode in self.modes.items()
            ],
            "notes": list(self.notes),
        }  # fmt: skip


def proof_csv(proof: Proof) -> str:
    """Text of the proof's torques as CSV."""
    return torques_csv(np.arange(len(proof.torques)) * proof.step, proof.inputs, proof.torques)


def plan_proof(case: Case, speed: float, seed: int = 0, settings: ProofSettings = PROOF) -> Proof:
    """Random-phase multisines on every compared torque, together, over the band of a tuned case.

    Each torque has spectral lines of its own, and some lines stay empty: they show what is not linear. Each line is as
    strong as its part in the error's variance asks for at a given use of the limits; the whole is as strong as the
    limits leave it, on the bed as planned and on beds drawn from what is uncertain. So many periods are planned that
    errors and target modes are decided: a standard uncertainty of a third of the tolerance.

    Parameters
    ----------
    case : Case
    speed : float
        Of the rotors, rad/s, that the deviations start from.

    Raises
    ------
    InputError
        Where the case lacks a limit that the size of the torques is planned by.
    """
    case, left_out = reached_by_torques(case)
    bed, exported = recorded_bed(case), exported_controller(case)
    names = tuple(dict.fromkeys(pair.input for pair in case.compared))
    demanded = demanded_limits(bed, {})
    _check(case, bed, names, demanded)
    times = _Times.of(case, len(names), settings)
    lines, of_input = _lines(times.period, case.band, len(names), np.random.default_rng((seed, len(names))), settings)
    box = case.uncertainty
    values = [box.at(place) for place in np.vstack([np.zeros(len(box.uncertain)), box.draw(settings.beds, seed)])]
    beds = controlled_beds(bed, values, exported.law.linear, names, lines / times.period)
    still = ExcitedBeds(bed, values, SpeedHold.of(exported.settings))
    most = settings.demanded_share * demanded
    mean, steady = _loaded(case, bed, still, speed, names, most)
    emulated: dict[str, float] = {}
    if case.operating_range is not None and not mean.any():
        mean, emulated = _holding(case, bed, speed, names, most)
        steady = still.steady(speed, mean)
    room = most - np.abs(mean)
    limits = ExcitationLimits(bed, speed, room / (1 - settings.free))
    limits.check_steady(steady, 1 - settings.free)
    shaping = _Shaping(
        case, bed, limits, steady, beds, lines, of_input, times.samples, exported.settings, settings
    )  # fmt: skip
    spectra = np.stack([shaping.alone(e, name, seed) for e, name in enumerate(names)], axis=1)
    spectra *= shaping.largest(spectra, names)
    spectra *= shaping.closed(spectra, names)
    motion, demands = shaping.motion(spectra, names)
    told = _Told(case, bed, beds, lines / times.period, spectra, times, settings)
    periods, notes = told.periods()
    wave = shaping.wave(spectra, times.samples)
    total = times.begin + periods * times.samples
    rows = np.arange(-times.begin, periods * times.samples + times.edge) % times.samples
    torques = wave[rows] * fade(total + times.edge, times.step)[:, None]
    means = dict(zip(bed.inputs[len(case.loop.dynamometers) :], mean.tolist(), strict=True)) | emulated
    torques = torques + np.array([means.get(name, 0.0) for name in names])
    notes = (*notes, *left_out, *_of_free_play(case, means), *_of_holding(case, means))
    return Proof(
        names, torques, times.step, times.period, periods, limits.used(steady, motion, demands), told.visible(periods),
        told.expected(periods), told.modes(periods), notes,
    )  # fmt: skip


def _check(case: Case, bed: RecordedBed, names: tuple[str, ...], demanded: np.ndarray) -> None:
    k = len(case.loop.dynamometers)
    for name in names:
        if name in bed.inputs and demanded[bed.inputs.index(name) - k] == 0:
            raise InputError(f"manoeuvre.{name}", "is missing", "its largest torque says how large the proof may be")
        if name not in bed.inputs and np.isinf(case.limits_of("torque")).any():
            raise InputError("limits.dynamometer_torque", "is missing", f"it says how large {name} may be in the proof")


def _free_play_rows(bed: RecordedBed) -> list[int]:
    """Outputs that are the torques of shafts with free play."""
    shafts = [place.removeprefix("shafts.") for place in bed.case.rig.free_plays if place.startswith("shafts.")]
    return [len(bed.sensors) + bed.shafts.index(shaft) for shaft in shafts]


def _loaded(
    case: Case, bed: RecordedBed, beds: ExcitedBeds, speed: float, names: tuple[str, ...], most: np.ndarray
) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray]]:
    """Mean torques (d,) of the inputs beside the dynamometers', N·m, that keep free play closed, and the steady motion.

    Half of what the input that loads the free play most may give; nothing where the rig has no free play.
    """
    none = np.zeros(len(most))
    steady = beds.steady(speed)
    rows = _free_play_rows(bed)
    able = [d for d, name in enumerate(bed.inputs[len(case.loop.dynamometers) :]) if name in names and most[d] > 0]
    if not rows or not able:
        return none, steady
    loads = []
    for d in able:
        alone = none.copy()
        alone[d] = most[d] / 2
        loads.append((alone, beds.steady(speed, alone)))
    alone, loaded = max(loads, key=lambda pair: np.abs(pair[1][1][:, rows]).min())
    other = beds.steady(speed, -alone)
    return (alone, loaded) if np.abs(loaded[1][:, rows]).min() >= np.abs(other[1][:, rows]).min() else (-alone, other)


def _holding(
    case: Case, bed: RecordedBed, speed: float, names: tuple[str, ...], most: np.ndarray
) -> tuple[np.ndarray, dict[str, float]]:
    """Mean torques, N·m, with which the vehicle keeps a speed: of the bed (d,), and by input of what is emulated.

    A vehicle over a range of speeds counts from no operating point: without a drive it would coast down in the proof.

    Raises
    ------
    InputError
        If a torque is larger than the proof may demand.
    """
    turning, mean = turning_at(case, speed), np.zeros(len(most))
    needs, emulated = torques_of(turning.rig), torques_of(turning.vehicle)
    for d, name in enumerate(bed.inputs[len(case.loop.dynamometers) :]):
        if name not in names:
            continue
        mean[d] = needs.get(name, 0.0)
        if abs(mean[d]) >= most[d]:
            raise InputError(
                f"manoeuvre.{name}", f"its largest torque leaves the proof {most[d]:.3g} N*m, and the vehicle needs "
                f"{abs(mean[d]):.3g} N*m to keep its speed at {speed:.3g} rad/s of the rotors",
                "give a lower --speed, or a larger torque",
            )  # fmt: skip
    return mean, {name: emulated[name] for name in names if name not in bed.inputs and emulated.get(name)}


def _of_holding(case: Case, means: Mapping[str, float]) -> list[str]:
    """What is said of a proof over a range of speeds."""
    loads = [f"{name} {mean:.3g} N·m" for name, mean in means.items() if mean]
    if case.operating_range is None or case.rig.free_plays or not loads:
        return []
    return [
        f"the torques hold a mean of {listed(loads)}, with which the vehicle about keeps its speed: bring the bed to "
        "it in speed hold, then ask for emulation"
    ]


def _of_free_play(case: Case, means: Mapping[str, float]) -> list[str]:
    """What is said of a proof of a bed with free play."""
    loads = [f"{name} {mean:.3g} N·m" for name, mean in means.items() if mean]
    if not case.rig.free_plays:
        return []
    places = listed([place.split(".")[1] for place in case.rig.free_plays])
    if not loads:
        return [f"no torque can load the free play of {places}: where it opens, the bed is not linear"]
    return [
        f"the free play of {places} stays closed: the torques hold a mean of {listed(loads)}; bring the bed to it in "
        "speed hold, then ask for emulation"
    ]


@dataclass(frozen=True)
class _Times:
    """Samples of a period, of what is repeated before the first one that counts, and of the fade at either end."""

    step: float
    samples: int
    begin: int
    edge: int
    most_periods: int
    wanted: float  # s, of a period: shorter where the longest recording does not hold two of them

    @property
    def period(self) -> float:
        return self.samples * self.step

    @classmethod
    def of(cls, case: Case, torques: int, settings: ProofSettings) -> _Times:
        step = case.loop["sample_time"]
        inside = [mode for _, mode in target_modes(case) if case.band[0] <= mode.frequency <= case.band[1]]
        widths = [mode.damping_ratio * mode.frequency for mode in inside]
        distances = [settings.of_band * case.band[0], *(settings.of_mode * mode.frequency for mode in inside)]
        distance = min([*distances, *(settings.of_half_width * width for width in widths if width > 0)])
        slowest = min([width for width in widths if width > 0], default=case.band[0])
        edge = round(FADE / step)
        begin = edge + round(min(settings.decayed / (2 * np.pi * slowest), settings.longest / 10) / step)
        wanted = (2 * torques + 1) / (2 * distance)
        room = settings.longest - (begin + edge) * step
        samples = int(min(wanted, room / settings.least_periods) / step)
        return cls(step, samples, begin, edge, int(room / (samples * step) + 1e-9), wanted)


def _lines(
    period: float, band: tuple[float, float], torques: int, rng: np.random.Generator, settings: ProofSettings
) -> tuple[np.ndarray, np.ndarray]:
    """Harmonics (l,) of a period, s, and the torque (l,) that each is for."""
    at, last = settings.below_band * band[0] * period, settings.above_band * band[1] * period
    cycle = np.array([*range(torques), *range(torques), -1])  # one of them stays empty
    slots: list[int] = []
    while at <= last:
        slots.append(math.ceil(at))
        at = slots[-1] + max(1.0, settings.distance * slots[-1] * 2 / len(cycle))
    owners = np.concatenate([rng.permutation(cycle) for _ in range(-(-len(slots) // len(cycle)))])[: len(slots)]
    return np.array(slots)[owners >= 0], owners[owners >= 0]


# --- How large each line is.


@dataclass(frozen=True)
class _Shaping:
    """Spectra (l, e) of the excitation, complex amplitudes of cosines at harmonics ``lines`` (l,) of ``count``
    samples, each for one torque, ``of_input`` (l,)."""

    case: Case
    bed: RecordedBed
    limits: ExcitationLimits
    steady: tuple[np.ndarray, np.ndarray]
    beds: ControlledBeds
    lines: np.ndarray
    of_input: np.ndarray
    count: int
    controller: Settings
    settings: ProofSettings

    def alone(self, e: int, name: str, seed: int) -> np.ndarray:
        """Spectrum (l,) of one torque that uses the limits alone: least variance of the error for their use.

        The variance of a mean square that is small is Σ(w·n/A²)², n the variance of noise over the squared response;
        at a given Σ(A·use)² it is least for A³ ∝ w·n/use.
        """
        own = np.flatnonzero(self.of_input == e)
        weights = log_weights(self.lines[own], (self.lines[0], self.lines[-1]))
        amplitude = np.cbrt(weights * self._noise_to_response(e, own) / self._use(e, name)[own])
        rng = np.random.default_rng((seed, e))
        drawn = amplitude * np.exp(2j * np.pi * rng.random((self.settings.phases, len(own))))
        spectra = np.zeros((self.settings.phases, len(self.lines)), complex)
        spectra[:, own] = drawn
        waves = self.wave(spectra.T, self._coarse).T
        spectrum = spectra[np.argmin(np.abs(waves).max(axis=1))]
        names = [""] * self.beds.commands.shape[3]
        names[e] = name
        whole = np.zeros((len(self.lines), len(names)), complex)
        whole[:, e] = spectrum
        return np.asarray(spectrum * self.largest(whole, tuple(names)))

    def largest(self, spectra: np.ndarray, names: tuple[str, ...]) -> float:
        """Factor that brings the excitation to the limits, and keeps it from what a watchdog takes for a fault."""
        motion, demands = self.motion(spectra, names)
        scale = self.limits.largest_scale(self.steady, motion, demands, 1 - self.settings.free)
        torques = [self.bed.sensors.index(flange) for flange in self.case.loop.flanges]
        answers = np.einsum("blye,le->bly", self.beds.outputs[:, :, torques], spectra)
        moved = np.stack([self.wave(spectrum, self.count) for spectrum in answers])  # (b, t, k)
        still = self.steady[1][:, None, torques]
        least = self.controller.lost_torque[self.case.loop.with_flange]
        while scale > 0 and _seems_lost(still + scale * moved, least, self.settings):
            scale *= self.settings.smaller
        return scale

    def closed(self, spectra: np.ndarray, names: tuple[str, ...]) -> float:
        """Factor, 1 at most, below which no free play opens: the torque there keeps a share of its mean."""
        rows = _free_play_rows(self.bed)
        mean = np.abs(self.steady[1][:, rows])
        if not rows or not mean.all():
            return 1.0
        peak = np.abs(self.motion(spectra, names)[0].outputs[:, :, rows]).max(axis=0)
        return float(min(1.0, ((1 - self.settings.kept_closed) * mean / np.maximum(peak, 1e-12)).min()))

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
        return min(2 * int(self.settings.samples_a_period / 2 * self.lines[-1]), self.count)

    def _noise_to_response(self, e: int, own: np.ndarray) -> np.ndarray:
        """Variance of noise over squared response at a torque's own lines, over its functions; notches are filled."""
        name = tuple(dict.fromkeys(pair.input for pair in self.case.compared))[e]
        sensors = [self.bed.sensors.index(pair.sensor) for pair in self.case.compared if pair.input == name]
        power = np.abs(self.beds.outputs[0][:, sensors, e]) ** 2
        near = np.abs(np.log(self.lines[own, None] / self.lines)) < self.settings.neighbours
        largest = np.where(near[:, :, None], power, 0.0).max(axis=1)
        variance = np.sum(np.abs(self.beds.noise[0][own][:, sensors]) ** 2, axis=2)
        return np.asarray(np.sum(variance / largest, axis=1))

    def _use(self, e: int, name: str) -> np.ndarray:
        """Root sum of squares (l,) of the shares of the limits that a torque of 1 N·m uses, on the bed as planned."""
        case, bed = self.case, self.bed
        outputs, total = np.abs(self.beds.outputs[0][:, :, e]) ** 2, np.zeros(len(self.lines))
        total += ((np.abs(self.beds.commands[0][:, :, e]) / case.limits_of("torque")) ** 2).sum(axis=1)
        rotors = [bed.sensors.index(dynamometer.speed_sensor) for dynamometer in case.loop.dynamometers]
        total += outputs[:, rotors].sum(axis=1) / ((1 - SLOWEST) * self.limits.speed) ** 2
        limited = [f"shafts.{shaft}.{what}" for what in ("torque", "twist") for shaft in bed.shafts]
        for row, limit in enumerate(limited, len(bed.sensors)):
            if limit in case.limits:
                total += outputs[:, row] / case.limits[limit] ** 2
        if name in bed.inputs:
            total += 1 / self.limits.demanded[bed.inputs.index(name) - len(case.loop.dynamometers)] ** 2
        return np.sqrt(total)


def _seems_lost(torques: np.ndarray, least: np.ndarray, settings: ProofSettings) -> bool:
    """Whether flange torques (b, t, f), above ``least`` (f,), come near what the controller takes for a broken one."""
    if (least >= NO_LIMIT).all():
        return False
    below, above = settings.nearly_lost
    count = torques.shape[1] - KEPT_SAMPLES
    recent = np.stack([torques[:, KEPT_SAMPLES - i : KEPT_SAMPLES - i + count] for i in range(KEPT_SAMPLES + 1)])
    return bool(has_gone(recent, below * least, above * GONE).any())


# --- What a recording of it will tell.


class _Told:
    """Uncertainties that noise leaves after a number of periods, by the formulas that judge the recording."""

    def __init__(
        self,
        case: Case,
        bed: RecordedBed,
        beds: ControlledBeds,
        frequencies: np.ndarray,
        spectra: np.ndarray,
        times: _Times,
        settings: ProofSettings,
    ):
        self._case, self._times, self._settings = case, times, settings
        self._targets = [
            (target, mode)
            for target, (_, mode) in zip(case.targets, target_modes(case), strict=True)
            if case.band[0] <= mode.frequency <= case.band[1]
        ]
        names = list(dict.fromkeys(pair.input for pair in case.compared))
        compared = ComparedBed(case, controller=controller_on_the_bed(case))
        answers = compared.at(frequencies)
        drawn = slice(1, None) if len(beds.outputs) > 1 else slice(None)  # the planned bed comes first
        # of every bed: frequencies (f,), response of the vehicle (f,), error (f,) and noise (f, n) of the bed's
        self._drawn: dict[str, list[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]]] = {}
        self._sources: dict[str, str] = {}
        self._functions: dict[str, MeasuredFunction] = {}
        self._kinds: dict[str, list[str]] = {}
        for h, (source, sensor) in enumerate(compared.pairs):
            e, y = names.index(source), bed.sensors.index(sensor)
            own = np.abs(spectra[:, e]) > 0
            # a cosine of amplitude A is A·√t/2 in a spectrum over √t of t samples, where noise has its variance
            line = np.abs(spectra[own, e]) * math.sqrt(times.samples) / 2
            name = f"{source} → {sensor}"
            self._sources[name] = source
            inside = own & (frequencies >= case.band[0]) & (frequencies <= case.band[1])
            line_inside, vehicle = line[inside[own]], answers.vehicle[inside, h]
            outputs = beds.outputs[drawn][:, inside, y, e]
            self._drawn[name] = [
                (frequencies[inside], vehicle, np.log(output / vehicle), noise / line_inside[:, None])
                for output, noise in zip(outputs, beds.noise[drawn][:, inside, y], strict=True)
            ]
            self._functions[name] = MeasuredFunction(
                frequencies[own],
                answers.matched[own, h],
                beds.noise[0][own, y] / line[:, None],
                np.ones(int(own.sum())),
            )
            self._kinds.setdefault("measured" if compared.measured[h] else "unmeasured", []).append(name)

    def periods(self) -> tuple[int, tuple[str, ...]]:
        """As many as the answers need, and what to say where the longest recording does not hold them."""
        settings, most = self._settings, self._times.most_periods
        enough = next((n for n in range(settings.least_periods, most + 1) if not self._open(n)), None)
        notes = []
        if enough is None:
            name, over = max(self._open(most).items(), key=lambda one: one[1])
            seconds = (self._times.begin + self._times.edge) * self._times.step + most * over**2 * self._times.period
            way = "its mode does not show" if math.isinf(over) else (
                f"{seconds:.0f} s would do, or limits {over:.2g} times as large, or sensors with a noise "
                f"{1 / over:.2g} times as large"
            )  # fmt: skip
            notes.append(
                f"{name} stays {over:.2g} times as uncertain as decides it in the {settings.longest:g} s that are "
                f"planned at most: {way}"
            )
        if self._times.period < 0.99 * self._times.wanted:
            notes.append(
                f"the lines of a torque are {self._times.wanted / self._times.period:.2g} times as far apart as the "
                f"target modes ask for: {settings.least_periods} periods of {self._times.wanted:.0f} s would resolve "
                "them"
            )
        return enough or max(most, settings.least_periods), tuple(notes)

    def _open(self, periods: int) -> dict[str, float]:
        """What is not decided, with its uncertainty over the one that would decide."""
        part, found = self._settings.sufficient, {}
        for one in self.expected(periods):
            found[f"the response error to {one.name} torques"] = one.largest / (part * one.allowed)
        for name, whole in self._functions.items():
            found[f"the response {name}"] = self._hidden(whole, periods)
        shown = self.modes(periods)
        for target, _ in self._targets:
            mode = shown[target.mode]
            allowed = (target.frequency_tolerance * (mode.frequency if mode else 1.0), target.damping_tolerance)
            ratios = [math.inf] if mode is None else [
                mode.frequency_uncertainty / (part * allowed[0]), mode.damping_uncertainty / (part * allowed[1])
            ]  # fmt: skip
            found[f"target mode {target.mode}"] = max(ratios)
        return {name: over for name, over in found.items() if over > 1}

    def expected(self, periods: int) -> tuple[ExpectedUncertainty, ...]:
        """By kind of torque."""
        allowed = {"measured": self._case.tolerance, "unmeasured": self._case.unmeasured_tolerance}
        found = []
        for kind, names in self._kinds.items():
            errors = tuple(part * allowed[kind] for part in self._settings.errors)
            uncertainties = []
            for error in errors:
                spread = math.sqrt(self._square_variance(names, periods, error))
                uncertainties.append(standard_uncertainty(error**2, spread))
            found.append(ExpectedUncertainty(kind, allowed[kind], errors, tuple(uncertainties)))
        return tuple(found)

    def _square_variance(self, names: Sequence[str], periods: int, error: float) -> float:
        """Of the mean square of functions, on beds that are off as drawn ones are, more or less: mean over these.
        Functions that would not be judged are left out; infinite where none would be."""
        total = 0.0
        for beds in zip(*(self._drawn[name] for name in names), strict=True):
            figures = [
                replace(self._figures(of_bed, periods, error), source=self._sources[name])
                for name, of_bed in zip(names, beds, strict=True)
            ]
            shown = [one for one in figures if one.known]
            total += together_variance(shown) / len(shown) ** 2 if shown else math.inf
        return total / len(self._drawn[names[0]])

    def _figures(self, of_bed: tuple[np.ndarray, ...], periods: int, error: float) -> Figures:
        """As a function of a bed would be judged after so many periods, its error scaled to ``error``."""
        frequencies, vehicle, off, noise = of_bed
        noise = noise / math.sqrt(periods)
        share = log_weights(frequencies, self._case.band)
        scaled = error / math.sqrt(max(float(share @ np.abs(off) ** 2), 1e-300)) * off
        # what is read has its noise on it
        relative = np.sum(np.abs(noise) ** 2, axis=1) / np.abs(vehicle * np.exp(scaled)) ** 2
        directed = np.where(np.abs(off) > 0, off / np.maximum(np.abs(off), 1e-300), 1.0)
        read = vehicle * np.exp(directed * np.sqrt(np.abs(scaled) ** 2 + np.minimum(relative, 1.0)))
        function = MeasuredFunction(frequencies, read, noise, np.ones(len(frequencies)))
        return Figures.of(function, vehicle, vehicle, self._case.band)

    def _hidden(self, whole: MeasuredFunction, periods: int) -> float:
        """Noise of a function over the noise with which as much of the band shows as a verdict needs."""
        function = whole.within(*self._case.band)
        relative = np.sqrt(function.variances / periods / UNKNOWN_VARIANCE) / np.abs(function.values)
        order = np.argsort(relative)
        shown = np.cumsum(log_weights(function.frequencies, self._case.band)[order])
        return float(relative[order][np.searchsorted(shown, 1 - LARGEST_UNKNOWN)])

    def visible(self, periods: int) -> dict[str, float]:
        """Share of the band where each compared function shows."""
        shares = {}
        for name, whole in self._functions.items():
            function = whole.within(*self._case.band)
            shown = function.variances / periods < UNKNOWN_VARIANCE * np.abs(function.values) ** 2
            shares[name] = float(log_weights(function.frequencies, self._case.band) @ shown)
        return shares

    def modes(self, periods: int) -> dict[int, MeasuredMode | None]:
        """Target modes of the band as the prediction shows them, with their uncertainties."""
        functions = [
            MeasuredFunction(one.frequencies, one.values, one.noise / math.sqrt(periods), one.shared)
            for one in self._functions.values()
        ]
        return {
            target.mode: measured_mode(functions, mode.frequency, mode.damping_ratio) for target, mode in self._targets
        }
