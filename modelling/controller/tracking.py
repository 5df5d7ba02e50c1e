"""Torque gain, flange zero and dead time of each dynamometer, tracked while the bed runs.

The balance of a rotor states the air-gap torque by what is measured. :class:`RotorTracker` compares it with the command
over minutes and says what has drifted. It changes nothing in the controller. The C sources do the same.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

GAIN, DELAY, ZERO, DRAG = range(4)  # parameters of the regression
DRIFTED = {"torque gain": 1, "flange zero": 2, "dead time": 4}  # bits of a warning
BITS = {GAIN: 1, ZERO: 2, DELAY: 4}


@dataclass(frozen=True)
class Rotors:
    """The balance of k rotors: air-gap torque = J·dω/dt + drag·ω − sign·flange.

    Attributes
    ----------
    inertia, drag, sign : ndarray (k,)
        kg·m² and N·m·s/rad of the rotor; sign of the flange's torque on it, over the gain of a flange that reads wrong.
        An inertia of 0 is not judged: there is no flange, or the rotor carries more than it.
    delay : tuple of float (k)
        Samples from a command to the reading of the flange that shows it: dead time and lags of inverter and flange.
    late : tuple of float (k)
        Samples by which the speed's change is read later than the flange's torque: an encoder's count is the mean speed
        of a sample.
    """

    inertia: np.ndarray
    drag: np.ndarray
    sign: np.ndarray
    delay: tuple[float, ...]
    late: tuple[float, ...] = ()

    @classmethod
    def unknown(cls, k: int) -> Rotors:
        """Nothing is judged."""
        return cls(np.zeros(k), np.zeros(k), np.ones(k), (0.0,) * k, (0.0,) * k)

    @property
    def kept(self) -> int:
        """Commands that have to be kept."""
        return 2 + int(max(self.delay, default=0.0))

    def acting(self, sent: np.ndarray) -> np.ndarray:
        """Commands (k,) that the readings of this sample show, straight between past ones (n, k), the newest first."""
        whole = np.array(self.delay).astype(int)
        part, at = np.array(self.delay) - whole, np.arange(len(self.delay))
        found: np.ndarray = sent[whole, at] + part * (sent[whole + 1, at] - sent[whole, at])
        return found

    def air_torque(self, rate: np.ndarray, speed: np.ndarray, flange: np.ndarray) -> np.ndarray:
        """Torques (k,) that the air gaps deliver by rad/s², rad/s and N·m (k,)."""
        found: np.ndarray = self.inertia * rate + self.drag * speed - self.sign * flange
        return found


@dataclass(frozen=True)
class Tracking:
    """How drifts are tracked, and from where on they are a warning; k dynamometers.

    Attributes
    ----------
    smoothing, second_smoothing : float
        s: time constants of two filters on all signals. With the first the noise of the speed, as torque of the
        inertia, has the spectrum of white noise; the second takes off the counts of the encoder. Chosen by trial among
        0.01 to 1 s and 0 to 0.01 s: a dead time is known to ± 0.01 ms after 30 s, and to ± 1 ms with 0.01 s alone.
    older : float
        s by which the instruments are older than the regressors. The noise of a reading is in the commands that follow;
        with instruments that are older than this noise no parameter is biased by it. Twice the second smoothing.
    block : float
        s: sums are closed after this time; scores of blocks state the uncertainty.
    forgetting : float
        s: time constant with which old blocks lose their weight: several tip-ins of a drive. A drift within this time
        is what limits the uncertainty.
    settling : float
        s that no sample counts after a standstill, a refused reading, or the begin of an emulation: four times the
        smoothing.
    least_blocks : int
        Before anything is judged: those of the forgetting.
    certainty : float
        Standard uncertainties by which a value has to lie beyond its limit. At 3 chance alone does it once in 700. The
        warning ends when the value is within its limit.
    sure : float
        Part of its limit for drift that the uncertainty of a value may have: one less certain is not judged and is no
        first value; its warning stays as it was. On a bed that hardly moves gain, delay and zero are not told apart.
    prior : ndarray (k, 4)
        Standard uncertainties of gain (1), delay (s), zero (N·m) and drag (N·m·s/rad) before anything is read: wide.
    inertia : float
        Relative tolerance of the rotors' inertia. It bends gain and delay, and is part of their uncertainty.
    most : ndarray (k, 2)
        How far gain (1) and delay (s) may be off what the match was made for: half-widths of its drawn beds.
    drift : ndarray (k, 3)
        How far gain (1), delay (s) and zero (N·m) may be off their first value in this run.
    """

    prior: np.ndarray
    most: np.ndarray
    drift: np.ndarray
    inertia: float = 0.05
    smoothing: float = 0.25
    second_smoothing: float = 0.01
    older: float = 0.02
    block: float = 1.0
    forgetting: float = 20.0
    settling: float = 1.0
    least_blocks: int = 20
    certainty: float = 3.0
    sure: float = 0.25

    @classmethod
    def unknown(cls, k: int) -> Tracking:
        """Nothing is a warning."""
        return cls(np.ones((k, 4)), np.full((k, 2), np.inf), np.full((k, 3), np.inf))


@dataclass
class Tracked:
    """What is known of one dynamometer, with standard uncertainties.

    Attributes
    ----------
    gain, delay, zero : float
        Air-gap torque over command (1: as calibrated); dead time and lags less the planned ones, s; the flange's zero,
        N·m, the rotor's friction included.
    gain_uncertainty, delay_uncertainty, zero_uncertainty : float
    drifted : int
        Sum of :data:`DRIFTED`: what is beyond its limit.
    """

    gain: float
    delay: float
    zero: float
    gain_uncertainty: float
    delay_uncertainty: float
    zero_uncertainty: float
    drifted: int = 0


@dataclass
class _Sums:
    """Sums over samples: instruments with regressors, with the torque that is missing, with that of the inertia."""

    regressors: np.ndarray = field(default_factory=lambda: np.zeros((4, 4)))
    missing: np.ndarray = field(default_factory=lambda: np.zeros(4))
    inertia: np.ndarray = field(default_factory=lambda: np.zeros(4))


class RotorTracker:
    """Tracks one dynamometer, sample by sample; the twin of ``track`` in ``sources/controller.c``.

    Parameters
    ----------
    rotors : Rotors
    tracking : Tracking
    at : int
        Which dynamometer.
    sample_time : float
        s.
    """

    def __init__(self, rotors: Rotors, tracking: Tracking, at: int, sample_time: float):
        self._rotors, self._tracking, self._at, self._step = rotors, tracking, at, sample_time
        self._prior = 1 / tracking.prior[at] ** 2  # of residuals of 1 N·m
        self._filters: np.ndarray | None = None  # (2, 3): both of command, flange, speed
        self._ring = np.zeros((samples(tracking.older, sample_time), 4))
        self._newest, self._wait = 0, samples(tracking.settling, sample_time)
        self._sums, self._block, self._counted, self._blocks = _Sums(), _Sums(), 0, 0
        self._scores, self._slow = np.zeros((4, 4)), np.zeros(4)
        self._first: dict[int, tuple[float, float, float]] = {}  # value, variance, what the inertia makes of it
        gain, delay, zero, _ = tracking.prior[at]
        self.tracked = Tracked(1.0, 0.0, 0.0, float(gain), float(delay), float(zero))

    def step(self, acting: float, flange: float, speed: float, counts: bool) -> None:
        """One sample: the command that acts, flange torque and speed; ``counts``: the bed is emulating and moving."""
        rotors, tracking, at = self._rotors, self._tracking, self._at
        now = np.array([acting, flange, speed])
        if self._filters is None:
            self._filters = np.stack([now, now])
        before = self._filters[1].copy()
        first, second = share(tracking.smoothing, self._step), share(tracking.second_smoothing, self._step)
        self._filters[0] += first * (now - self._filters[0])
        self._filters[1] += second * (self._filters[0] - self._filters[1])
        slopes = (self._filters[1] - before) / self._step
        command, torque = self._filters[1, :2] - rotors.late[at] * self._step * slopes[:2]
        turning = self._filters[1, 2]
        regressors = np.array([command, -slopes[0], 1.0, -turning])
        of_inertia = rotors.inertia[at] * slopes[2]
        missing = of_inertia + rotors.drag[at] * turning - rotors.sign[at] * torque - command
        instruments = self._ring[self._newest].copy()
        self._ring[self._newest] = regressors
        self._newest = (self._newest + 1) % len(self._ring)
        if not counts:
            self._wait, self._counted, self._block = samples(tracking.settling, self._step), 0, _Sums()
        elif self._wait > 0:
            self._wait -= 1
        else:
            self._block.regressors += np.outer(instruments, regressors)
            self._block.missing += instruments * missing
            self._block.inertia += instruments * of_inertia
            self._counted += 1
            if self._counted == samples(tracking.block, self._step):
                self._close()

    def _close(self) -> None:
        """A block is full: estimate anew."""
        tracking, at, block = self._tracking, self._at, self._block
        kept = np.exp(-tracking.block / tracking.forgetting)
        for name in vars(block):
            setattr(self._sums, name, kept * getattr(self._sums, name) + getattr(block, name))
        self._counted, self._block, self._blocks = 0, _Sums(), self._blocks + 1
        inverse = _inverse(self._sums.regressors + np.diag(self._prior))
        if inverse is None:  # readings beyond all bounds: they are forgotten
            self._sums, self._scores, self._blocks = _Sums(), np.zeros((4, 4)), 0
            return
        found = inverse @ self._sums.missing
        score = block.missing - block.regressors @ found
        self._scores = kept**2 * self._scores + np.outer(score, score)
        variances = np.diag(inverse @ (self._scores + np.diag(self._prior)) @ inverse.T)
        bent = tracking.inertia / np.sqrt(3) * (inverse @ self._sums.inertia)  # by what the inertia may be off
        known = bool((np.diag(inverse) > 0).all() and (variances * self._prior <= 1).all())
        if not known:  # the bed has hardly moved
            found, variances, bent = np.zeros(4), 1 / self._prior, np.zeros(4)
        begins = not known or self._blocks <= tracking.least_blocks
        self._slow = self._slow + (1.0 if begins else 1 - kept) * (found - self._slow)
        total = np.sqrt(variances + bent**2)
        before = self.tracked.drifted
        sign = self._rotors.sign[at]
        gain, delay, zero = float(1 + found[GAIN]), float(found[DELAY]), float(-found[ZERO] / sign)
        # a mean of the value is as late behind it as the value is behind the truth
        of_gain, of_delay, of_zero, _ = np.hypot(total, found - self._slow).tolist()
        self.tracked = Tracked(gain, delay, zero, of_gain, of_delay, of_zero / abs(sign))
        for number, what in enumerate((GAIN, DELAY, ZERO)):
            most, off, u = tracking.drift[at, number], bool(before & BITS[what]), np.sqrt(variances[what])
            if self._blocks >= tracking.least_blocks and u <= tracking.sure * most:
                value, variance, bent_then = self._first.setdefault(what, (found[what], variances[what], bent[what]))
                u = np.sqrt(variances[what] + variance + (bent[what] - bent_then) ** 2)
                beyond = [(abs(found[what] - value) - most, u)]
                if what in (GAIN, DELAY):
                    beyond.append((abs(found[what]) - tracking.most[at, number], total[what]))
                off = any(by > (0 if off else tracking.certainty * u) for by, u in beyond)
            self.tracked.drifted += BITS[what] if off else 0


def _inverse(matrix: np.ndarray) -> np.ndarray | None:
    try:
        found: np.ndarray = np.linalg.inv(matrix)
    except np.linalg.LinAlgError:
        return None
    return found if np.isfinite(found).all() else None


def samples(time: float, sample_time: float) -> int:
    """Samples of a time, at least one."""
    return max(round(time / sample_time), 1)


def share(time_constant: float, sample_time: float) -> float:
    """Of a change that a filter takes over in a sample."""
    return float(1 - np.exp(-sample_time / time_constant))
