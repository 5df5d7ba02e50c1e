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

from dataclasses import dataclass, replace

import numpy as np

from matching.match.beds import noise_of_sensors
from matching.match.case import Case
from matching.match.loop import bed_set, compared_sensors, frequency_response, return_difference, without_limits
from modelling.bed.bed import ControlLaw


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
        s by which the triggers of two recordings may be apart.
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


LEARNING = LearningSettings()


def with_added_torques(law: ControlLaw) -> ControlLaw:
    """The law with the added torques (k) as further known ones: they are part of what is sent."""
    k = len(law.dynamometers)
    return replace(
        law, Bw=np.hstack([law.Bw, np.zeros((len(law.A), k))]), Dw=np.hstack([law.Dw, np.eye(k)]),
        known=(*law.known, *(added_to(name) for name in law.dynamometers)),
    )  # fmt: skip


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
        step, box = law.sample_time, case.uncertainty
        padded = int(2 ** np.ceil(np.log2(samples + 1.0 / step)))
        lines = np.arange(1, int(settings.highest * padded * step) + 1) / (padded * step)
        controller = without_limits(with_added_torques(law))
        acting = frequency_response(controller, lines)
        values = [{}, *(box.at(position) for position in box.draw(settings.drawn, settings.seed))]
        beds = bed_set(case, values, lines)
        own = acting.of_known[:, :, [acting.known.index(added_to(name)) for name in law.dynamometers]]
        difference = return_difference(beds, acting)
        commands = np.linalg.solve(difference, np.broadcast_to(own, (len(values), *own.shape)))
        by_reading = beds.commanded[0] @ np.linalg.solve(difference[0], acting.of_readings)
        sensors = noise_of_sensors(case, case.loop.controller_sensors)
        noise = samples * ((np.abs(by_reading) ** 2) @ sensors**2 + noise_of_sensors(case, compared_sensors(case)) ** 2)
        return cls(step, padded, beds.commanded @ commands, noise, settings)

    def correction(self, errors: np.ndarray, ranges: np.ndarray) -> Correction:
        """What to add to the torques after repetitions with the same ones.

        Parameters
        ----------
        errors : ndarray (r, n, c)
            Sensor less vehicle. Two or more tell what does not repeat; of one, the stated noise of the sensors does.
        ranges : ndarray (c,)
            Of the vehicle's signals, which weight the sensors.
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
        effect = np.zeros((self.padded // 2 + 1, len(ranges)), complex)
        effect[lines] = part * moved[0]
        predicted = errors.mean(axis=0) + ranges * np.fft.irfft(effect, self.padded, axis=0)[:count]
        return Correction(
            part * wanted, part, predicted,
            *(self._rms(power, errors.shape) for power in (noise, np.abs(E) ** 2, np.abs(E + part * moved[0]) ** 2)),
        )  # fmt: skip

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
