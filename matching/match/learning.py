"""Torques learned over repetitions of one manoeuvre: what the controlled bed gets wrong in the same way every time.

A controller answers what nobody could foresee; what repeats is foreseen. Torques added to the commands, sample by
sample from the trigger of the manoeuvre on, are corrected after every repetition by what the error was in all of it,
before and after each moment (norm-optimal iterative learning: Bristow, Tharayil and Alleyne, IEEE Control Systems
Magazine 26(3), 2006, 96). The controller knows of the added torques, so that its observer does not answer them.

The closed loop of the bed as planned predicts what a torque does to the error; drawn beds show how far to trust that.
At a frequency where the error would not shrink on one of them, less is learned or nothing, and the whole correction is
as large as all of them allow with the error that was measured.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from matching.match.beds import noise_of_sensors
from matching.match.case import Case, Compared
from matching.match.loop import (
    BedSet,
    bed_set,
    beds_of,
    compared_sensors,
    frequency_response,
    responses_of,
    return_difference,
    without_limits,
)
from modelling.bed.bed import ControlLaw
from modelling.bed.vehicle import Interface, ResidualVehicle
from modelling.linear.state_space import state_space
from modelling.system import Input, Sensor


@dataclass(frozen=True)
class LearningSettings:
    """How it is learned.

    Attributes
    ----------
    highest : float
        Hz, up to which anything is learned: above, a bed is not known.
    drawn : int
        Beds drawn from the case's box, which every correction has to improve.
    price : float
        Of a torque: share of what the loop answers at most, below which its answer is too small to be worth a torque.
    shares : tuple of float
        Of the norm-optimal correction at one frequency, and of the whole: the largest that every bed allows.
    trust : float
        Times the power that does not repeat: what a line has more than that is learned.
    neighbours : int
        Lines over which powers are averaged.
    begin : float
        s after the trigger, before the manoeuvre begins: errors count from their mean there.
    quiet : float
        s at the end over which the error is faded out, so that the end does not look like a jump.
    seed : int
        Of the drawn beds.
    beyond_noise : float
        Times the noise of the mean error: what its predicted fall has to exceed for another repetition to be worth it.
    gains : float
        Of the error that a repetition has to take away, too.
    latest_trigger : float
        s within which the trigger of a recording is looked for.
    same_trigger, same_speed, same_torque, same_length, ended, dead : float
        What makes a recording no repetition: a trigger later by so many s, rotors that begin faster or slower by so
        many rad/s, another demanded torque (root mean square over its range), a length below that share of the longest,
        an error over the range of the vehicle's motion with which emulation has ended, a channel that moves less than
        that share of what it moves in another recording. Chosen by trial: five times what noise makes.
    end : float
        s in which the learned torques end.
    """

    highest: float = 60.0
    drawn: int = 20
    price: float = 0.03
    trust: float = 1.5
    neighbours: int = 9
    shares: tuple[float, ...] = (1.0, 0.7, 0.5, 0.35, 0.25, 0.0)
    begin: float = 0.02
    quiet: float = 0.1
    seed: int = 1
    beyond_noise: float = 1.2
    gains: float = 0.2
    latest_trigger: float = 0.5
    same_trigger: float = 0.005
    same_speed: float = 1.0
    same_torque: float = 0.02
    same_length: float = 0.95
    ended: float = 0.5
    dead: float = 0.01
    end: float = 0.05


LEARNING = LearningSettings()


def with_added_torques(law: ControlLaw) -> ControlLaw:
    """The law with the added torques (k) as further known ones: they are part of what is sent."""
    k = len(law.dynamometers)
    return replace(
        law, Bw=np.hstack([law.Bw, np.zeros((len(law.A), k))]), Dw=np.hstack([law.Dw, np.eye(k)]),
        known=(*law.known, *(added_to(name) for name in law.dynamometers)),
    )  # fmt: skip


@dataclass(frozen=True)
class CutReadings:
    """Torque and speed at the vehicle's end of a cut by what is measured at the rotor, up to the highest frequency.

    torque = torque_by_torque·flange + torque_by_speed·d(speed)/dt into the vehicle,
    speed = speed_by_speed·speed + speed_by_torque·d(flange)/dt: what lies between is stiff.
    """

    torque_sensor: str
    speed_sensor: str
    torque_by_torque: float
    torque_by_speed: float
    speed_by_speed: float
    speed_by_torque: float


OPENED = 1e-9  # of the stiffness and damping of a cut shaft that is taken out
MATCHED_AT = 20.0  # Hz, where the four numbers of CutReadings are read off


def cut_readings(case: Case) -> dict[str, CutReadings] | None:
    """By the cut shaft, in the order of the dynamometers; None where a dynamometer has no torque flange."""
    loop, found = case.loop, {}
    for one in loop.dynamometers:
        if one.torque_sensor is None:
            return None
        cut = next(cut for cut in case.residual_vehicle.interfaces if cut.shaft == one.follows)
        shaft = next(part for part in case.rig.shafts if part.name == cut.shaft)
        place = shaft.between.index(cut.rig_end)
        opened = case.rig.with_values({
            f"shafts.{cut.shaft}.{what}": OPENED * case.rig.parameters[f"shafts.{cut.shaft}.{what}"].value
            for what in ("stiffness", "damping")
        })  # fmt: skip
        ratio = 1.0 if shaft.ratio is None else shaft.ratio.value
        through = 1.0 if place == 1 else -1 / ratio  # torque on that end for 1 N·m in the shaft
        space = state_space(replace(
            opened, inputs=(*opened.inputs, Input("torque_at_cut", cut.rig_end)),
            sensors=(*opened.sensors, Sensor("speed_at_cut", "speed", cut.rig_end)), operating_point=None,
        ))  # fmt: skip
        w = 2 * np.pi * MATCHED_AT
        columns = np.stack([space.input("torque_at_cut") * through, space.input(one.torque_input)], axis=1)
        rows = np.stack([space.output(name) for name in (one.torque_sensor, one.speed_sensor, "speed_at_cut")])
        answers = rows @ np.linalg.solve(1j * w * np.eye(len(space.A)) - space.A, columns)
        inverse = np.linalg.inv(answers[:2])  # torques by readings
        speed = answers[2] @ inverse
        into = cut.factor * inverse[0]
        found[cut.shaft] = CutReadings(
            one.torque_sensor, one.speed_sensor, float(into[0].real), float(into[1].imag / w), float(speed[1].real),
            float(speed[0].imag / w),
        )  # fmt: skip
    return found


def residual_response(residual: ResidualVehicle, shafts: Sequence[str], frequencies: np.ndarray) -> np.ndarray:
    """Speeds (f, k, k) at the cuts for 1 N·m into the residual vehicle at each of them."""
    s, found = 2j * np.pi * frequencies, np.zeros((len(frequencies), len(shafts), len(shafts)), complex)
    for part in residual.parts:
        space = state_space(part)
        here = [j for j, shaft in enumerate(shafts) if _interface(residual, shaft).torque in space.inputs]
        if not here:
            continue
        cuts = [_interface(residual, shafts[j]) for j in here]
        columns = np.stack([space.input(cut.torque) for cut in cuts], axis=1)
        rows = np.stack([space.output(cut.speed) for cut in cuts])
        states = np.linalg.solve(
            s[:, None, None] * np.eye(len(space.A)) - space.A, np.broadcast_to(columns, (len(s), *columns.shape))
        )
        found[np.ix_(range(len(s)), here, here)] = rows @ states
    return found


def _interface(residual: ResidualVehicle, shaft: str) -> Interface:
    return next(cut for cut in residual.interfaces if cut.shaft == shaft)


def _lines(law: ControlLaw, samples: int, settings: LearningSettings) -> tuple[np.ndarray, int]:
    """Frequencies (f,), Hz, up to the highest one, and the samples of the transform."""
    padded = int(2 ** np.ceil(np.log2(samples + 1.0 / law.sample_time)))
    count = int(settings.highest * padded * law.sample_time)
    return np.arange(1, count + 1) / (padded * law.sample_time), padded


def _values(case: Case, settings: LearningSettings) -> list[dict[str, float]]:
    box = case.uncertainty
    return [{}, *(box.at(position) for position in box.draw(settings.drawn, settings.seed))]


def _added(case: Case, law: ControlLaw, beds: BedSet, lines: np.ndarray) -> tuple[np.ndarray, np.ndarray, BedSet]:
    """Commands (b, f, k, k) by added torques, compared sensors (f, c, y) by wrong readings as planned, and the beds."""
    acting = frequency_response(without_limits(with_added_torques(law)), lines)
    own = acting.of_known[:, :, [acting.known.index(added_to(name)) for name in law.dynamometers]]
    difference = return_difference(beds, acting)
    commands = np.linalg.solve(difference, np.broadcast_to(own, (len(difference), *own.shape)))
    by_reading = beds.commanded[0] @ np.linalg.solve(difference[0], acting.of_readings)
    return commands, by_reading, beds


def added_to(dynamometer: str) -> str:
    """Name of the torque that is added to a dynamometer's command."""
    return f"{dynamometer}.added_torque"


@dataclass(frozen=True)
class Learner:
    """What a correction needs of the controlled bed; n samples, c compared sensors, k dynamometers, b beds, f lines.

    Attributes
    ----------
    step : float
        s.
    padded : int
        Samples of the transform: the motion, and room in which it dies out.
    answers : ndarray (b, f, c, k), complex
        Of the compared sensors to added torques, the bed as planned first, at the lines up to the highest frequency.
    noise : ndarray (f, c)
        Power of a line of each compared sensor that the sensors' stated noise makes.
    settings : LearningSettings
    """

    step: float
    padded: int
    answers: np.ndarray
    noise: np.ndarray
    settings: LearningSettings = LEARNING

    @classmethod
    def of(cls, case: Case, law: ControlLaw, samples: int, settings: LearningSettings = LEARNING) -> Learner:
        """For a tuned case at its operating point, its linear law, and motions of so many samples."""
        lines, padded = _lines(law, samples, settings)
        values = _values(case, settings)
        commands, by_reading, beds = _added(case, law, bed_set(case, values, lines), lines)
        sensors = noise_of_sensors(case, case.loop.controller_sensors)
        noise = samples * ((np.abs(by_reading) ** 2) @ sensors**2 + noise_of_sensors(case, compared_sensors(case)) ** 2)
        return cls(law.sample_time, padded, beds.commanded @ commands, noise, settings)

    @classmethod
    def at_cuts(
        cls, case: Case, law: ControlLaw, samples: int, ends: Mapping[str, CutReadings],
        settings: LearningSettings = LEARNING,
    ) -> Learner:  # fmt: skip
        """For errors at the cuts: speeds there less those of the residual vehicle under the torque that is measured.

        What vehicle and bed have in common does not enter: whatever it does is in the measured torque.

        Parameters
        ----------
        ends : mapping of str to CutReadings
            By the cut shaft, in the order of the dynamometers.
        """
        lines, padded = _lines(law, samples, settings)
        values, pairs = _values(case, settings), []
        for one in ends.values():
            pairs += [Compared(case.compared[0].input, name) for name in (one.torque_sensor, one.speed_sensor)]
        reading = replace(case, compared=tuple(dict.fromkeys(pairs)))
        beds = responses_of(reading, beds_of(reading, values), values, lines, np.zeros((len(values), len(lines), 0)))
        commands, by_reading, beds = _added(reading, law, beds, lines)
        names, s = compared_sensors(reading), 2j * np.pi * lines
        vehicle = residual_response(case.residual_vehicle, tuple(ends), lines)
        of_cuts = np.zeros((len(lines), len(ends), len(names)), complex)  # of the error by the readings
        for j, one in enumerate(ends.values()):
            torque, speed = names.index(one.torque_sensor), names.index(one.speed_sensor)
            of_cuts[:, j, speed] += one.speed_by_speed
            of_cuts[:, j, torque] += s * one.speed_by_torque
            of_cuts[:, :, torque] -= vehicle[:, :, j] * one.torque_by_torque
            of_cuts[:, :, speed] -= vehicle[:, :, j] * (s * one.torque_by_speed)[:, None]
        sensors = noise_of_sensors(reading, case.loop.controller_sensors)
        own = np.abs(of_cuts) ** 2 @ noise_of_sensors(reading, names) ** 2
        noise = samples * (np.abs(of_cuts @ by_reading) ** 2 @ sensors**2 + own)
        return cls(law.sample_time, padded, of_cuts @ beds.commanded @ commands, noise, settings)

    def correction(
        self, errors: np.ndarray, ranges: np.ndarray, added: np.ndarray | float = 0.0,
        limits: np.ndarray | float = np.inf,
    ) -> Correction:  # fmt: skip
        """What to add to the torques after repetitions with the same ones.

        Parameters
        ----------
        errors : ndarray (r, n, c)
            Sensor less vehicle. Two or more tell what does not repeat; of one, the stated noise of the sensors does.
        ranges : ndarray (c,)
            Of the vehicle's signals, which weight the sensors.
        added : ndarray (n, k) or float
            Torques, N·m, with which the repetitions were made.
        limits : ndarray (k,) or float
            N·m: added torques stay within ± these, and end at the last sample.
        """
        settings, lines = self.settings, slice(1, self.answers.shape[1] + 1)
        each = np.stack([np.fft.rfft(self._faded(one) / ranges, self.padded, axis=0)[lines] for one in errors])
        E, count = each.mean(axis=0), errors.shape[1]
        noise = self._smooth(self._noise_power(each, ranges))
        size = self._smooth((np.abs(E) ** 2).sum(axis=1))
        repeats = np.maximum(1 - settings.trust * noise / np.maximum(size, 1e-300), 0.0)
        G = self.answers / ranges[:, None]
        adjoint = np.swapaxes(G[0].conj(), 1, 2)
        price = settings.price**2 * np.linalg.norm(G[0], ord=2, axis=(1, 2)).max() ** 2
        L = -np.linalg.solve(adjoint @ G[0] + price * np.eye(G.shape[-1]), adjoint)  # (f, k, c)
        share = repeats * self._contracting(L, G)
        wanted = self._in_time(share[:, None] * (L @ E[..., None])[..., 0], count)
        moved = (G @ np.fft.rfft(wanted, self.padded, axis=0)[lines][..., None])[..., 0]  # (b, f, c)
        sizes = {part: np.sqrt((np.abs(E + part * moved) ** 2).sum(axis=(1, 2))) for part in settings.shares}
        part = min(settings.shares, key=lambda one: float(sizes[one].max()))
        torques = self._limited(added + part * wanted, limits) - added
        moved = (G[0] @ np.fft.rfft(torques, self.padded, axis=0)[lines][..., None])[..., 0]
        effect = np.zeros((self.padded // 2 + 1, len(ranges)), complex)
        effect[lines] = moved
        predicted = errors.mean(axis=0) + ranges * np.fft.irfft(effect, self.padded, axis=0)[:count]
        return Correction(
            torques, part, predicted,
            *(self._rms(power, errors.shape) for power in (noise, np.abs(E) ** 2, np.abs(E + moved) ** 2)),
        )  # fmt: skip

    def _limited(self, torques: np.ndarray, limits: np.ndarray | float) -> np.ndarray:
        """Torques (n, k) within their limits that end at the last sample."""
        kept: np.ndarray = np.clip(torques, -np.asarray(limits), np.asarray(limits))
        last = min(round(self.settings.end / self.step), len(kept))
        kept[len(kept) - last :] *= np.cos(np.linspace(0, np.pi / 2, last))[:, None] ** 2
        return kept

    def size(self, error: np.ndarray, ranges: np.ndarray) -> float:
        """Root mean square of an error (n, c) over the ranges (c,), of all sensors, up to the highest frequency."""
        lines = slice(1, self.answers.shape[1] + 1)
        spectrum = np.fft.rfft(self._faded(error) / ranges, self.padded, axis=0)[lines]
        return self._rms(np.abs(spectrum) ** 2, error[None].shape)

    def _rms(self, power: np.ndarray, shape: tuple[int, ...]) -> float:
        """Root mean square over n samples and c sensors of a motion of ``shape`` (r, n, c) by the power of its lines
        (Parseval)."""
        _, count, sensors = shape
        return float(np.sqrt(2 * power.sum() / (self.padded * count * sensors)))

    def _faded(self, error: np.ndarray) -> np.ndarray:
        """An error (n, c) from where it begins, faded out at its end."""
        count = len(error)
        last = min(round(self.settings.quiet / self.step), count)
        faded = error - error[: max(round(self.settings.begin / self.step), 1)].mean(axis=0)
        faded[count - last :] *= np.cos(np.linspace(0, np.pi / 2, last))[:, None] ** 2
        return faded

    def _noise_power(self, each: np.ndarray, ranges: np.ndarray) -> np.ndarray:
        """Of the mean's lines (f,), summed over sensors: by the scatter of the repetitions, or as stated."""
        if len(each) > 1:
            scatter: np.ndarray = each.var(axis=0, ddof=1).sum(axis=1) / len(each)
            return scatter
        power: np.ndarray = (self.noise / ranges**2).sum(axis=1)
        return power

    def _smooth(self, power: np.ndarray) -> np.ndarray:
        """A power (f,) averaged over neighbouring lines."""
        width = min(self.settings.neighbours, len(power))
        weights = np.ones(width)
        averaged: np.ndarray = np.convolve(power, weights, "same") / np.convolve(np.ones(len(power)), weights, "same")
        return averaged

    def _contracting(self, L: np.ndarray, G: np.ndarray) -> np.ndarray:
        """Share (f,) of the correction at each frequency with which the torques' error falls on every bed."""
        eye = np.eye(L.shape[1])
        share = np.zeros(len(L))
        for candidate in sorted(self.settings.shares):
            left = np.linalg.norm(eye + candidate * L @ G, ord=2, axis=(2, 3)).max(axis=0)
            share = np.where(left <= 1 + 1e-9, candidate, share)
        return share

    def _in_time(self, spectrum: np.ndarray, count: int) -> np.ndarray:
        """Torques (n, k) of lines (f, k): what falls before the trigger cannot be played."""
        whole = np.zeros((self.padded // 2 + 1, spectrum.shape[1]), complex)
        whole[1 : len(spectrum) + 1] = spectrum
        return np.fft.irfft(whole, self.padded, axis=0)[:count]


@dataclass(frozen=True)
class Correction:
    """What to add to the torques of the last repetition.

    Attributes
    ----------
    torques : ndarray (n, k)
        N·m.
    share : float
        Of the norm-optimal correction: what every drawn bed allows with the error that was measured.
    predicted : ndarray (n, c)
        Error that the bed as planned has with them.
    noise, size, left : float
        Root mean squares over the ranges, of all sensors: of what does not repeat in the mean error, of all of it, and
        of the error that is predicted.
    """

    torques: np.ndarray
    share: float
    predicted: np.ndarray
    noise: float
    size: float
    left: float
