"""The partial fidelities and how they combine: Eqs. 13 to 23, with the paper's own arithmetic there by name.

``definition`` is what the paper defines: Eq. 18 as RMSE over range, sums over the m signals divided by 2m (Eqs. 17, 21)
or m (Eq. 22), so that an ideal test bed scores exactly one. ``published`` divides every sum by six, which alone gives
the paper's Tab. 3; an ideal test bed then scores 0.82. ``literal`` takes Eq. 18 as printed, range inside the root,
whose value depends on the unit.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import scipy

from modelling.errors import InputError
from modelling.fidelity.delay import Delay, delay

# --- Checks of the signals that a fidelity is calculated from.

STEP_DEVIATION = 0.01  # of a step: time stamps that deviate less count as equally spaced


def check_time(time: np.ndarray, where: str = "time") -> float:
    """The step in s of an equally spaced, increasing time axis (t,).

    Raises
    ------
    InputError
        Fewer than two values, a value that is not finite, or steps that differ by more than ``STEP_DEVIATION``.
    """
    time = np.asarray(time, dtype=float)
    if time.ndim != 1 or len(time) < 2 or not np.all(np.isfinite(time)):
        raise InputError(where, "is no list of at least two finite times", "give times in s")
    step = float(time[-1] - time[0]) / (len(time) - 1)
    if not step > 0 or np.max(np.abs(np.diff(time) - step)) > STEP_DEVIATION * step:
        raise InputError(where, "does not increase in equal steps", "resample both recordings to one step")
    return step


def check_pair(reference: np.ndarray, test: np.ndarray, count: int | None, where: str) -> None:
    """Check reference and test signal, both (t,) with t = ``count`` where that is known.

    Raises
    ------
    InputError
        Unequal lengths, or a sample that is not finite.
    """
    if reference.ndim != 1 or reference.shape != test.shape or (count is not None and len(reference) != count):
        expected = "" if count is None else f", time has {count}"
        raise InputError(
            where, f"reference has {reference.size} samples, test {test.size}{expected}", "give equally many"
        )
    for name, signal in (("reference", reference), ("test", test)):
        if not np.all(np.isfinite(signal)):
            index = int(np.flatnonzero(~np.isfinite(signal))[0])
            raise InputError(
                where, f"sample {index + 1} of the {name} is {signal[index]}", "every sample must be finite"
            )


# --- Measures

ARITHMETICS = ("definition", "published")
NRMSE_FORMS = ("definition", "literal")
PUBLISHED_DIVISOR = 6
WEIGHTS = {"system_dynamics": 0.4, "residual_vehicle_model": 0.4, "measurement_uncertainty": 0.2}


def signal_range(reference: np.ndarray, where: str = "signal") -> float:
    """Range of the reference signal (t,).

    Raises
    ------
    InputError
        If it is zero: nothing can be normalised by it.
    """
    width = float(np.max(reference) - np.min(reference))
    if not width > 1e-12 * float(np.max(np.abs(reference))):
        raise InputError(
            where, "the reference signal is constant: its range is zero", "choose a manoeuvre that excites it"
        )
    return width


def nrmse_fidelity_of(mean_square: float, width: float, form: str = "definition") -> float:
    """R_NRMSE from the mean square of the deviation and the range of the reference."""
    if form == "literal":
        return max(0.0, 1 - math.sqrt(mean_square / width))
    return max(0.0, 1 - math.sqrt(mean_square) / width)


def chi(f_max: float) -> float:
    """χ of Eq. 20 in s⁻³: a delay of 1/(6·f_max) shall give R_τ = ½. ``f_max`` in Hz."""
    return math.tan(math.pi / 4) * (6 * f_max) ** 3


def delay_fidelity(delay: float | np.ndarray, f_max: float) -> Any:
    """R_τ of Eq. 19 for delays in s, one or (b,); the sign of a delay does not matter."""
    return 1 - 2 / math.pi * np.arctan(chi(f_max) * np.abs(delay) ** 3)


def dynamics_fidelity(
    nrmse: Sequence[float], delays: Sequence[float], arithmetic: str = "definition", where: str = "fidelity"
) -> float:
    """R_SD or R_RVM (Eqs. 17, 21) from R_NRMSE and R_τ of the m signals, all dimensionless.

    Raises
    ------
    InputError
        If ``arithmetic`` is ``"published"`` and m is not the paper's number of signals.
    """
    total = math.fsum(r * r for r in (*nrmse, *delays))
    if arithmetic == "published":
        _like_the_paper(len(nrmse), 2, where)
        return math.sqrt(total / PUBLISHED_DIVISOR)
    return min(1.0, math.sqrt(total / (2 * len(nrmse))))


def measurement_fidelity(ratios: Sequence[float], arithmetic: str = "definition", where: str = "fidelity") -> float:
    """R_MU (Eq. 22) from U/range of the m signals (Eq. 23), cut at 0.

    Raises
    ------
    InputError
        If ``arithmetic`` is ``"published"`` and m is not the paper's number of sensors.
    """
    total = math.fsum(ratio * ratio for ratio in ratios)
    if arithmetic == "published":
        _like_the_paper(len(ratios), 4, where)
        return 1 - math.sqrt(total / PUBLISHED_DIVISOR)
    return max(0.0, 1 - math.sqrt(total / len(ratios)))


def _like_the_paper(count: int, wanted: int, where: str) -> None:
    if count != wanted:
        raise InputError(
            where,
            f"the published arithmetic divides by 6 and means something for {wanted} signals only, not {count}",
            'use arithmetic = "definition"',
        )


def check_weights(weights: dict[str, float], where: str = "weights") -> None:
    """Raises ``InputError`` unless the weights are not negative and sum to one (Eq. 15)."""
    for name, weight in weights.items():
        if not math.isfinite(weight) or weight < 0:
            raise InputError(where, f"{name} = {weight!r}", "a weight is a number of at least 0")
    if abs(math.fsum(weights.values()) - 1) > 1e-9:
        raise InputError(where, f"the weights sum to {math.fsum(weights.values()):.6g}", "they must sum to 1 (Eq. 15)")


def total_fidelity(partial: dict[str, float], weights: dict[str, float]) -> float:
    """R_XiL (Eqs. 14, 16); both tables have the same domains."""
    return min(1.0, math.sqrt(math.fsum(weights[name] * partial[name] ** 2 for name in weights)))


def representativeness(
    times: Sequence[float], shapes: Sequence[float], reliabilities: Sequence[float], total_time: float | None = None
) -> float:
    """R_A of dos Santos (Eq. 13): time-weighted sum of shape factor K times reliability C over the samples of a group.

    ``total_time`` is t_T in the unit of ``times``, by default their sum.

    Raises
    ------
    InputError
        If the lists differ in length, a time is negative or the total is not positive.
    """
    if not (len(times) == len(shapes) == len(reliabilities) > 0):
        raise InputError(
            "representativeness",
            f"{len(times)} times, {len(shapes)} shape factors and {len(reliabilities)} reliabilities",
            "give as many of each, at least one",
        )
    total = math.fsum(times) if total_time is None else total_time
    if not total > 0 or min(times) < 0:
        raise InputError(
            "representativeness", "times must not be negative and their total must be positive", "correct them"
        )
    return math.fsum(t / total * k * c for t, k, c in zip(times, shapes, reliabilities, strict=True))


# --- What an XiL fidelity consists of: signals, their partial fidelities, sensors, and the total.

DYNAMIC_DOMAINS = ("system_dynamics", "residual_vehicle_model")
MEASUREMENT_DOMAIN = "measurement_uncertainty"


@dataclass(frozen=True)
class FidelityMethod:
    """How a fidelity is calculated.

    Attributes
    ----------
    f_max : float
        Largest relevant frequency of the manoeuvre, Hz (Eq. 20).
    arithmetic, nrmse_form : str
        See :mod:`modelling.fidelity.measures`.
    longest_delay : float, optional
        Largest delay that is looked for, s; by default a quarter of the recording.

    Raises
    ------
    InputError
        If ``f_max`` is not positive, or a form is not known.
    """

    f_max: float
    arithmetic: str = "definition"
    nrmse_form: str = "definition"
    longest_delay: float | None = None

    def __post_init__(self) -> None:
        if not (math.isfinite(self.f_max) and self.f_max > 0):
            raise InputError("f_max", f"{self.f_max!r} is not possible", "give a frequency above 0 in Hz")
        for name, value, known in (
            ("arithmetic", self.arithmetic, ARITHMETICS),
            ("nrmse", self.nrmse_form, NRMSE_FORMS),
        ):
            if value not in known:
                raise InputError(name, f"'{value}' is not known", f"choose {' | '.join(known)}")


@dataclass(frozen=True)
class SignalPair:
    """Reference and test signal in the same SI unit, with what is known of the test bed's sensor.

    Attributes
    ----------
    reference, test : ndarray (t,)
    expanded_uncertainty : float, optional
        U of the test bed's sensor, in the unit of the signals.
    coverage_factor : float
        k of U.
    degrees_of_freedom : float
        Of U.
    noise : tuple of float, optional
        Standard deviation of the white noise of one sample of reference and test; by default estimated from the part
        of the spectrum above f_max.
    """

    reference: np.ndarray
    test: np.ndarray
    expanded_uncertainty: float | None = None
    coverage_factor: float = 2.0
    degrees_of_freedom: float = math.inf
    noise: tuple[float, float] | None = None


@dataclass(frozen=True)
class SignalFidelity:
    """R_NRMSE and R_τ of one signal of a dynamic domain.

    Attributes
    ----------
    name : str
    nrmse, delay_fidelity : float
        R_NRMSE (Eq. 18) and R_τ (Eq. 19).
    delay : Delay
        The delay (s) that R_τ follows from.
    nrmse_uncertainty : float
        Standard uncertainty of a stated R_NRMSE; 0 where signals are there.
    pair : SignalPair, optional
        The signals, unless the values were stated.
    mean_square, width : float
        Mean square deviation and range of the reference, SI; NaN where the values were stated.
    """

    name: str
    nrmse: float
    delay: Delay
    delay_fidelity: float
    nrmse_uncertainty: float = 0.0
    pair: SignalPair | None = None
    mean_square: float = math.nan
    width: float = math.nan


@dataclass(frozen=True)
class SensorUncertainty:
    """One signal of the measurement domain: U/range (Eq. 23) and the degrees of freedom of U."""

    name: str
    ratio: float
    degrees_of_freedom: float = math.inf


@dataclass(frozen=True)
class Fidelity:
    """R_XiL with its parts.

    Attributes
    ----------
    total : float
        R_XiL.
    domains, weights : dict of str to float
        Fidelity and weight of each domain.
    signals : dict of str to tuple of SignalFidelity
        By dynamic domain.
    sensors : tuple of SensorUncertainty
    method : FidelityMethod
    step : float, optional
        Sampling step, s; None where all values were stated.
    notes : tuple of str
        What was corrected in the recordings.
    """

    total: float
    domains: dict[str, float]
    weights: dict[str, float]
    signals: dict[str, tuple[SignalFidelity, ...]]
    sensors: tuple[SensorUncertainty, ...]
    method: FidelityMethod
    step: float | None = None
    notes: tuple[str, ...] = ()

    @property
    def f_max(self) -> float:
        """Largest relevant frequency, Hz."""
        return self.method.f_max


# --- The XiL fidelity of one test bed on one manoeuvre: of each signal, of each domain, in total.


# Seven parameters: the signals, and the paper's own settings by keyword, most with a default.
def fidelity_of_signals(
    time: np.ndarray,
    system_dynamics: Mapping[str, SignalPair],
    residual_vehicle_model: Mapping[str, SignalPair] | None = None,
    *,
    f_max: float,
    weights: Mapping[str, float] | None = None,
    nrmse: str = "definition",
    longest_delay: float | None = None,
) -> Fidelity:
    """R_SD, R_RVM, R_MU and R_XiL (Eqs. 14–23) of simultaneous reference and test signals.

    Parameters
    ----------
    time : ndarray (t,)
        s, at equal steps; only differences count.
    system_dynamics, residual_vehicle_model : mapping of str to SignalPair
        Each signal (t,). Pairs with an ``expanded_uncertainty`` make up R_MU.
    f_max, nrmse, longest_delay
        See :class:`FidelityMethod`.
    weights : mapping of str to float, optional
        By domain, for exactly the domains there are; by default the paper's 0.4, 0.4, 0.2.

    Raises
    ------
    InputError
        Unequal lengths, NaN, a constant reference, weights that do not sum to one or do not fit the domains.
    """
    step = check_time(time)
    method = FidelityMethod(f_max, nrmse_form=nrmse, longest_delay=longest_delay)
    pairs = dict(zip(DYNAMIC_DOMAINS, (system_dynamics, residual_vehicle_model or {}), strict=True))
    for domain, members in pairs.items():
        for name, pair in members.items():
            check_pair(np.asarray(pair.reference), np.asarray(pair.test), len(time), f"{domain}.{name}")
    signals = {
        domain: tuple(assess_signal(name, pair, step, method, domain) for name, pair in members.items())
        for domain, members in pairs.items()
        if members
    }
    sensors = tuple(
        SensorUncertainty(signal.name, signal.pair.expanded_uncertainty / signal.width, signal.pair.degrees_of_freedom)
        for members in signals.values()
        for signal in members
        if signal.pair is not None and signal.pair.expanded_uncertainty is not None
    )
    return assemble(signals, sensors, weights, method, step)


def assemble(
    signals: dict[str, tuple[SignalFidelity, ...]],
    sensors: tuple[SensorUncertainty, ...],
    weights: Mapping[str, float] | None,
    method: FidelityMethod,
    step: float | None = None,
    where: str = "fidelity",
) -> Fidelity:
    """R_XiL (Eqs. 14, 16) from the fidelities of signals by domain and from the sensors; ``step`` is in s.

    Raises
    ------
    InputError
        If the weights do not sum to one, or do not name exactly the domains there are.
    """
    domains = {
        name: dynamics_fidelity(
            [signal.nrmse for signal in members],
            [signal.delay_fidelity for signal in members],
            method.arithmetic,
            where,
        )
        for name, members in signals.items()
    }
    if sensors:
        domains[MEASUREMENT_DOMAIN] = measurement_fidelity(
            [sensor.ratio for sensor in sensors], method.arithmetic, where
        )
    weights = dict(WEIGHTS if weights is None else weights)
    if set(weights) != set(domains):
        raise InputError(
            f"{where}: weights",
            f"they name {', '.join(weights)}, but there are values for {', '.join(domains) or 'nothing'}",
            "give a weight to each domain that has signals, no other",
        )
    check_weights(weights, f"{where}: weights")
    return Fidelity(total_fidelity(domains, weights), domains, weights, signals, sensors, method, step)


def assess_signal(
    name: str, pair: SignalPair, step: float, method: FidelityMethod, where: str = "signal"
) -> SignalFidelity:
    """R_NRMSE (Eq. 18) and R_τ (Eq. 19) of one pair of signals (t,) with a step in s.

    Where the delay is undetermined, R_τ is that of the smallest delay that explains the signals as well as any, and 0
    where no delay does.

    Raises
    ------
    InputError
        Unequal lengths, a sample that is not finite, a constant reference.
    """
    where = f"{where}.{name}"
    reference, test = (np.asarray(signal, dtype=float) for signal in (pair.reference, pair.test))
    check_pair(reference, test, None, where)
    width = signal_range(reference, where)
    mean_square = float(np.mean((reference - test) ** 2))
    estimate = delay(reference, test, step, method.longest_delay)
    r_tau = 0.0 if estimate.nearest is None else float(delay_fidelity(estimate.nearest, method.f_max))
    r_nrmse = nrmse_fidelity_of(mean_square, width, method.nrmse_form)
    return SignalFidelity(name, r_nrmse, estimate, r_tau, 0.0, pair, mean_square, width)


# --- The uncertainty of R_XiL itself, by Monte Carlo over signal noise, delays and U.
#
# Without it the fidelities of two test beds cannot be compared. Each draw is one repetition of the measurement:
#
# - The mean square deviation of a signal under white noise of standard deviation σ in each of its t samples is σ²/t
#   times a noncentral χ² with t degrees of freedom, exactly. The noncentrality is the deviation without noise.
# - The sensor's U is mostly systematic: one offset with u = U/k for each draw and signal, the same for all its samples.
# - The extremes of the reference carry the noise of one sample each.
# - Delays are normal with their standard uncertainty. Where the delay is undetermined, R_τ is drawn uniformly between 0
#   and the value for the smallest delay that fits. That value is the best case and the one stated, so the interval
#   reaches from a lower bound up to it.
# - U itself scatters as a standard deviation with its degrees of freedom, as χ.

SMALLEST_WIDTH = 0.1  # of the reference's range: draws of the range do not fall below it
SHORTEST_SPECTRUM = 32  # samples below which no noise is estimated
FEWEST_LINES = 8  # spectral lines above the band that a noise estimate needs


@dataclass(frozen=True)
class DrawnValue:
    """Mean, standard uncertainty and coverage interval of a drawn fidelity, 0 … 1."""

    mean: float
    standard_uncertainty: float
    interval: tuple[float, float]
    coverage: float

    def to_dict(self) -> dict[str, Any]:
        """As ``fidelity.json`` holds it."""
        return asdict(self) | {"interval": list(self.interval)}


@dataclass(frozen=True)
class FidelityDistribution:
    """Draws (b,) of R_XiL and of each domain.

    ``upper_ends`` holds the stated value of the total and of each domain that has a signal with an undetermined delay:
    the best case.
    """

    total: np.ndarray
    domains: dict[str, np.ndarray]
    coverage: float
    upper_ends: dict[str, float]

    def summary(self) -> dict[str, DrawnValue]:
        """Mean, standard uncertainty and shortest interval of ``"total"`` and of each domain."""
        return {
            name: _summary(draws, self.coverage, self.upper_ends.get(name))
            for name, draws in (("total", self.total), *self.domains.items())
        }


def fidelity_distribution(
    fidelity: Fidelity, draws: int = 20_000, seed: int = 1, coverage: float = 0.95
) -> FidelityDistribution:
    """Distribution of R_XiL and its domains over ``draws`` repetitions of the measurement."""
    generator = np.random.default_rng(seed)
    published = fidelity.method.arithmetic == "published"
    squares: dict[str, np.ndarray] = {}
    for domain, members in fidelity.signals.items():
        values = [_signal_draws(signal, fidelity, generator, draws) for signal in members]
        divisor = PUBLISHED_DIVISOR if published else 2 * len(members)
        squares[domain] = np.sum([nrmse**2 + tau**2 for nrmse, tau in values], axis=0) / divisor
    if fidelity.sensors:
        ratios = np.array([_ratio_draws(sensor, generator, draws) for sensor in fidelity.sensors])
        divisor = PUBLISHED_DIVISOR if published else len(ratios)
        squares[MEASUREMENT_DOMAIN] = np.maximum(0.0, 1 - np.sqrt(np.sum(ratios**2, axis=0) / divisor)) ** 2
    total = np.sum([fidelity.weights[name] * square for name, square in squares.items()], axis=0)
    undetermined = [
        name for name, members in fidelity.signals.items() if any(signal.delay.value is None for signal in members)
    ]
    upper_ends = {name: fidelity.domains[name] for name in undetermined}
    if undetermined:
        upper_ends["total"] = fidelity.total
    return FidelityDistribution(
        np.sqrt(total), {name: np.sqrt(square) for name, square in squares.items()}, coverage, upper_ends
    )


def noise_of(pair: SignalPair, step: float, f_max: float) -> tuple[float, float]:
    """Standard deviation of a sample's noise in reference and test: as stated, or estimated from above f_max.

    The estimate takes the spectrum above twice f_max as white noise; 0 where the recording does not reach there.
    """
    if pair.noise is not None:
        return pair.noise
    return _noise_above(pair.reference, step, 2 * f_max), _noise_above(pair.test, step, 2 * f_max)


def _noise_above(signal: np.ndarray, step: float, frequency: float) -> float:
    """Standard deviation of white noise with the signal's mean power above a frequency in Hz."""
    if len(signal) < SHORTEST_SPECTRUM:
        return 0.0
    window = scipy.signal.windows.hann(len(signal), sym=False)
    power = np.abs(np.fft.rfft(scipy.signal.detrend(signal) * window)) ** 2 / np.sum(window**2)
    above = np.fft.rfftfreq(len(signal), step) > frequency
    return math.sqrt(float(np.mean(power[above]))) if np.count_nonzero(above) > FEWEST_LINES else 0.0


def _signal_draws(
    signal: SignalFidelity, fidelity: Fidelity, generator: np.random.Generator, draws: int
) -> tuple[np.ndarray, np.ndarray]:
    """Draws (b,) of R_NRMSE and R_τ of a signal."""
    if signal.pair is None or fidelity.step is None:
        nrmse = np.clip(signal.nrmse + signal.nrmse_uncertainty * generator.standard_normal(draws), 0, 1)
    else:
        nrmse = _nrmse_draws(signal, signal.pair, fidelity, generator, draws)
    return nrmse, _delay_draws(signal, fidelity.f_max, generator, draws)


def _nrmse_draws(
    signal: SignalFidelity, pair: SignalPair, fidelity: Fidelity, generator: np.random.Generator, draws: int
) -> np.ndarray:
    noise = noise_of(pair, fidelity.step or 0.0, fidelity.f_max)
    variance, count = noise[0] ** 2 + noise[1] ** 2, len(pair.reference)
    deviation = float(np.mean(np.asarray(pair.test) - np.asarray(pair.reference)))
    u = 0.0 if pair.expanded_uncertainty is None else pair.expanded_uncertainty / pair.coverage_factor
    offset = u * generator.standard_normal(draws)
    noiseless = max(signal.mean_square - variance, 0.0)
    mean_square = noiseless + np.maximum(2 * deviation * offset + offset**2, -noiseless)
    if variance > 0:
        mean_square = variance / count * generator.noncentral_chisquare(count, count * mean_square / variance)
    width = signal.width + math.sqrt(2) * noise[0] * generator.standard_normal(draws)
    width = np.maximum(width, SMALLEST_WIDTH * signal.width)
    if fidelity.method.nrmse_form == "literal":
        return np.clip(1 - np.sqrt(mean_square / width), 0, 1)
    return np.clip(1 - np.sqrt(mean_square) / width, 0, 1)


def _delay_draws(signal: SignalFidelity, f_max: float, generator: np.random.Generator, draws: int) -> np.ndarray:
    delay = signal.delay
    if delay.value is None:
        return signal.delay_fidelity * generator.random(draws)
    if not delay.standard_uncertainty:
        return np.full(draws, signal.delay_fidelity)
    return delay_fidelity(delay.value + delay.standard_uncertainty * generator.standard_normal(draws), f_max)


def _ratio_draws(sensor: SensorUncertainty, generator: np.random.Generator, draws: int) -> np.ndarray:
    if math.isinf(sensor.degrees_of_freedom):
        return np.full(draws, sensor.ratio)
    return sensor.ratio * np.sqrt(generator.chisquare(sensor.degrees_of_freedom, draws) / sensor.degrees_of_freedom)


def _summary(draws: np.ndarray, coverage: float, upper_end: float | None) -> DrawnValue:
    """Summary of draws (b,); with an upper end, the interval reaches from the lower quantile up to it."""
    ordered = np.sort(draws)
    inside = min(round(coverage * len(ordered)), len(ordered) - 1)
    if upper_end is None:
        start = int(np.argmin(ordered[inside:] - ordered[: len(ordered) - inside]))
        interval = float(ordered[start]), float(ordered[start + inside])
    else:
        interval = float(ordered[-1 - inside]), max(float(ordered[-1]), upper_end)
    return DrawnValue(float(draws.mean()), float(draws.std()), interval, coverage)
