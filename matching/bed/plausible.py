"""Whether a recording can be one of this bed under this controller, and which channel is wrong where it cannot.

The bed's model gives every sensor from the torque commands, whatever the controller does, and the controller gives its
commands from the sensors. Both hold over most of the band even where the bed is off by tenths; a reversed sign or a
wrong unit breaks them. What one factor on one channel explains is named. Nothing is corrected, and nothing is judged.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from matching.bed.excite import recorded_bed
from matching.bed.measured import repetition
from matching.match.case import Case
from matching.match.exported import controller_on_the_bed
from matching.match.loop import frequency_response
from matching.match.responses import ComparedBed
from modelling.errors import InputError, listed
from modelling.recordings.channel_faults import CONVERSIONS, KINDS, fault
from modelling.recordings.recording import Recording

THIS_BED = "this bed"
THIS_CONTROLLER = "this controller: was emulation on, with the controller of this match"


class NotThisBed(InputError):
    """A recording fits neither the model of the bed nor the fault of one channel: the bed is another."""


@dataclass(frozen=True)
class PlausibleSettings:
    """When a recording no longer fits. Distances are moduli of complex logarithms: 1 is a factor of 2.7 or 57°."""

    fits: float = 1.0  # median over the band: off by 10 % in everything it is 0.3; a wrong sign is π, 1/min is 2.3
    lines: int = 300  # frequencies looked at, at most
    fewest: int = 8  # lines that tell something of a sensor
    enough: float = 1 / 3  # of the lines of a torque, at least, that tell something of a sensor
    cancelled: float = 0.5  # of the sum of moduli, that what the inputs add has to reach at a line
    farthest: float = 20.0  # distance of a sensor that reads nothing where the model gives something
    faint: float = 1e-4  # of a torque's strongest line in power: what is weaker does not excite
    alike: float = 0.9  # correlation of a recorded torque with the planned one, at least
    followed: tuple[tuple[float, str], ...] = (
        (0.0, "was not followed by its dynamometer"),
        (0.25, "was followed by its dynamometer to a quarter only"),
    )


PLAUSIBLE = PlausibleSettings()


def check_recording(
    case: Case, recording: Recording, torques: Sequence[str], settings: PlausibleSettings = PLAUSIBLE
) -> None:
    """Whether an evenly sampled recording fits the case's bed.

    Parameters
    ----------
    torques : sequence of str
        Compared torques that excite the bed in it.

    Raises
    ------
    InputError
        That names the channel, or says that the recording fits neither this bed nor one channel's fault.
    """
    bed = recorded_bed(case)
    sensors = [name for name in bed.sensors if name in recording.channels]
    for name in sensors:
        if not np.ptp(recording[name]) > 0:
            raise InputError(
                f"{recording.source}: {name}", fault("stuck", name, size=f" from {recording[name][0]:g}").words,
                "connect the sensor, or leave the channel out",
            )  # fmt: skip
    commands = {dynamometer.torque_input for dynamometer in case.loop.dynamometers}
    complete = all(name in recording.channels for name in commands)
    inputs = [name for name in (bed.inputs if complete else torques) if name in recording.channels]
    lines = _lines(recording, case.band, torques, [*dict.fromkeys([*inputs, *torques, *sensors])], settings)
    frequencies = lines.frequencies
    if complete:
        H = bed.response({}, frequencies)
        columns, rows = [bed.inputs.index(name) for name in inputs], [bed.sensors.index(name) for name in sensors]
        model = H[:, rows][:, :, columns]
    else:
        compared = ComparedBed(case, controller=controller_on_the_bed(case))
        sensors = [name for name in sensors if name in {sensor for _, sensor in compared.pairs}]
        model = _of_pairs(compared.pairs, compared.at(frequencies).matched, inputs, sensors)
    kinds = {sensor.name: sensor.measures for sensor in case.rig.sensors}
    causes = {}
    for name in [*inputs, *torques, *sensors]:
        quantity = kinds.get(name, "torque")
        units = [(1 / one.factor, f"is probably {one.words.removeprefix('is ')}") for one in CONVERSIONS
                 if quantity in one.quantities and abs(np.log(one.factor)) > settings.fits]  # fmt: skip
        causes[name] = ((-1.0, KINDS["sign"].sensor), *units, *(settings.followed if name in commands else ()))
    fit = _Fit(model, inputs, sensors, lines, causes, settings)
    told = fit.check(recording.source, THIS_BED if complete else None)
    read = list(case.loop.controller_sensors)
    # of a law beside a vehicle of others no linear model says its commands: see check_commands
    if complete and set(read) <= set(sensors) and case.vehicle_in_the_loop is None:
        acting = frequency_response(controller_on_the_bed(case), lines.frequencies)
        known = [name for name in acting.known if name in lines.values]
        picked = [list(acting.known).index(name) for name in known]
        law = np.concatenate([acting.of_readings, acting.of_known[:, :, picked]], axis=2)
        sent = [dynamometer.torque_input for dynamometer in case.loop.dynamometers]
        right = {name for name, distance in zip(sensors, told, strict=True) if np.isfinite(distance)} | set(inputs)
        causes = {name: () if name in right else found for name, found in causes.items()}
        _Fit(law, [*read, *known], sent, lines, causes, settings).check(recording.source, THIS_CONTROLLER)


def check_commands(
    case: Case, recording: Recording, torques: Sequence[str], predicted: Mapping[str, np.ndarray],
    settings: PlausibleSettings = PLAUSIBLE,
) -> None:  # fmt: skip
    """Whether the commands of a recording are about those that the controller gives on the bed as planned.

    Parameters
    ----------
    torques : sequence of str
        Compared torques that excite the bed in it.
    predicted : mapping of str to ndarray (t,)
        Commands on the bed as planned under these torques, N·m by input; at the recording's samples.

    Raises
    ------
    InputError
        If they are far off over most of the band.
    """
    if any(name not in recording.channels for name in predicted):
        return
    as_predicted = {f"{name} as predicted": each for name, each in predicted.items()}
    whole = replace(recording, channels={**recording.channels, **as_predicted})
    lines = _lines(whole, case.band, torques, [*torques, *predicted, *as_predicted], settings)
    for name, other in zip(predicted, as_predicted, strict=True):
        one = np.ones((len(lines.frequencies), 1, 1), complex)
        _Fit(one, [other], [name], lines, {name: (), other: ()}, settings).check(recording.source, THIS_CONTROLLER)


def check_excitation(
    recording: Recording, planned: Mapping[str, np.ndarray], step: float, settings: PlausibleSettings = PLAUSIBLE
) -> None:
    """Whether a recording holds the torques that were planned for it, at whatever time they begin.

    Parameters
    ----------
    planned : mapping of str to ndarray (t,)
        By name, N·m, at steps of ``step`` (s).

    Raises
    ------
    InputError
        That names the torque.
    """
    for name, torque in planned.items():
        time = np.arange(recording.time[0], recording.time[-1] + step / 2, step)
        recorded = np.interp(time, recording.time, recording.channels.get(name, np.zeros(len(recording.time))))
        recorded, wanted = recorded - np.mean(recorded), torque - np.mean(torque)
        product = scipy.signal.correlate(recorded, wanted)
        late = int(np.argmax(np.abs(product))) - (len(wanted) - 1)  # samples; what was recorded of it counts
        first, second = recorded[max(late, 0) :], wanted[max(-late, 0) :]
        count = min(len(first), len(second))
        norms = np.linalg.norm(first[:count]) * np.linalg.norm(second[:count])
        alike = np.abs(first[:count] @ second[:count]) / max(float(norms), 1e-300)
        if alike < settings.alike:
            raise InputError(
                f"{recording.source}: {name}", f"is not the torque that was planned (correlation {alike:.2f})",
                "add the torques of this round's excitation.csv, and record them",
            )  # fmt: skip


@dataclass(frozen=True)
class _Lines:
    """Spectra (f,) of channels by name, at frequencies (f,), Hz, that a torque excites.

    ``groups`` (g, f) are the lines of each torque, or all of them where torques share theirs.
    """

    frequencies: np.ndarray
    values: Mapping[str, np.ndarray]
    groups: np.ndarray


def _lines(
    recording: Recording,
    band: tuple[float, float],
    torques: Sequence[str],
    names: Sequence[str],
    settings: PlausibleSettings,
) -> _Lines:
    """Of the periods of a recording, or of all of it."""
    step = float(np.mean(np.diff(recording.time)))
    whole = repetition(np.stack([recording[name] for name in torques], axis=1), round(1 / (band[0] * step)))
    count = len(recording.time) if whole is None else whole.count * whole.period
    first = 0 if whole is None else whole.first
    window = np.hanning(count) if whole is None else np.ones(count)
    f = np.fft.rfftfreq(count, step)
    spectra = {}
    for name in names:
        part = recording[name][first : first + count]
        spectra[name] = np.fft.rfft((part - part.mean()) * window)
    power = np.abs(np.stack([spectra[name] for name in torques])) ** 2
    inside = (f >= band[0]) & (f <= band[1])
    strong = inside & (power > settings.faint * (power * inside).max(axis=1, keepdims=True))
    used = np.flatnonzero(strong.any(axis=0))
    used = used[np.unique(np.linspace(0, len(used) - 1, min(len(used), settings.lines)).astype(int))]
    alone = strong[:, used] & (strong[:, used].sum(axis=0) == 1)
    groups = alone if (alone.sum(axis=1) >= settings.fewest).all() else np.ones((1, len(used)), bool)
    return _Lines(f[used], {name: spectrum[used] for name, spectrum in spectra.items()}, groups)


def _of_pairs(
    pairs: Sequence[tuple[str, str]], values: np.ndarray, inputs: Sequence[str], sensors: Sequence[str]
) -> np.ndarray:
    """Responses (f, y, u) of compared functions (f, h); 0 where a pair is not compared."""
    model = np.zeros((len(values), len(sensors), len(inputs)), complex)
    for h, (source, sensor) in enumerate(pairs):
        if source in inputs and sensor in sensors:
            model[:, sensors.index(sensor), inputs.index(source)] = values[:, h]
    return model


@dataclass(frozen=True)
class _Fit:
    """Responses (f, y, u) from inputs to outputs, their spectra, and what a factor that mends a channel would mean."""

    model: np.ndarray
    inputs: Sequence[str]
    outputs: Sequence[str]
    lines: _Lines
    causes: Mapping[str, Sequence[tuple[float, str]]]
    settings: PlausibleSettings

    def check(self, source: str, of_what: str | None) -> np.ndarray:
        """Whether the outputs are those of the model, or of the model with one channel wrong.

        ``of_what`` says what else does not fit; None: a bed may answer otherwise, and only a channel's fault is told.
        The distances (y,) come back; NaN where nothing is told of an output.
        """
        distances = self._distances({})
        if not (distances > self.settings.fits).any():
            return distances
        found = []
        for name in dict.fromkeys([*self.inputs, *self.outputs]):
            for factor, words in self.causes[name]:
                left = self._distances({name: factor})
                told = 2 * np.isfinite(left).sum() >= np.isfinite(distances).sum()
                if told and not (left > self.settings.fits).any():
                    found.append((float(np.nansum(left)), name, words))
        if found:
            _, name, words = min(found)
            raise InputError(f"{source}: {name}", words, "mend the channel, or say so in a channel file")
        if of_what is None:
            return distances
        wrong = [name for name, far in zip(self.outputs, distances > self.settings.fits, strict=True) if far]
        raise (NotThisBed if of_what == THIS_BED else InputError)(
            source, f"does not fit {of_what}: {listed(wrong)} {'is' if len(wrong) == 1 else 'are'} far off over most "
            "of the band, and no single channel explains it", "look at the recording and at what ran on the bed",
        )  # fmt: skip

    def _distances(self, factors: Mapping[str, float]) -> np.ndarray:
        """Largest median distance (y,) over the groups of lines, where channels are multiplied by factors.

        Frequencies at which the contributions of the inputs nearly cancel are left out: there a small error of the
        model changes everything. NaN: none are left.
        """
        driven, seen = (
            np.stack([self.lines.values[name] * factors.get(name, 1.0) for name in names], axis=1)
            for names in (self.inputs, self.outputs)
        )
        parts = self.model * driven[:, None]
        given = parts.sum(axis=2)
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = np.minimum(np.abs(np.log(seen / given)), self.settings.farthest)
        counted = np.abs(given) > self.settings.cancelled * np.abs(parts).sum(axis=2)
        found = np.full((len(self.lines.groups), seen.shape[1]), np.nan)
        for g, group in enumerate(self.lines.groups):
            for y in range(seen.shape[1]):
                lines = group & counted[:, y]
                if lines.sum() >= max(self.settings.fewest, self.settings.enough * group.sum()):
                    found[g, y] = np.median(distance[lines, y])
        return np.asarray(np.fmax.reduce(found, axis=0))
