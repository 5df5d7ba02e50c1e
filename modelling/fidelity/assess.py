"""The XiL fidelity of one test bed on one manoeuvre: per signal, per domain, total. Arrays in, no files."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from modelling.common.errors import InputError
from modelling.fidelity.delay import Delay, delay
from modelling.fidelity.measures import (
    ARITHMETICS,
    NRMSE,
    WEIGHTS,
    check_weights,
    delay_fidelity,
    dynamics_fidelity,
    measurement_fidelity,
    nrmse_fidelity_of,
    signal_range,
    total_fidelity,
)

DYNAMIC = ("system_dynamics", "residual_vehicle_model")
MEASUREMENT = "measurement_uncertainty"


@dataclass(frozen=True)
class SignalPair:
    """Reference and test signal ``(t,)`` in the same (SI) unit, with what is known of their sensor.

    ``noise`` is the standard deviation of the white noise of one sample of reference and test; None lets it be
    estimated from what lies above f_max. ``expanded_uncertainty`` is U of the test bed's sensor, with its k.
    """

    reference: np.ndarray
    test: np.ndarray
    expanded_uncertainty: float | None = None
    coverage_factor: float = 2.0
    degrees_of_freedom: float = math.inf
    noise: tuple[float, float] | None = None
    unit: str = ""


@dataclass(frozen=True)
class SignalFidelity:
    """One signal of a dynamic domain: R_NRMSE and R_τ, with the delay behind the latter (s) and its uncertainty.

    ``nrmse_uncertainty`` belongs to given values, ``pair``, ``mean_square`` and ``width`` to signals.
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
class Sensor:
    """One signal of the measurement domain: U/range (Eq. 23) and the degrees of freedom of U."""

    name: str
    ratio: float
    degrees_of_freedom: float = math.inf


@dataclass(frozen=True)
class Fidelity:
    """R_XiL with all its parts; the sampling step in s where signals were given, and notes of what was mended."""

    total: float
    domains: dict[str, float]
    weights: dict[str, float]
    signals: dict[str, tuple[SignalFidelity, ...]]
    sensors: tuple[Sensor, ...]
    f_max: float
    arithmetic: str = "definition"
    nrmse_form: str = "definition"
    step: float | None = field(default=None)
    notes: tuple[str, ...] = ()

    def recombined(
        self, signals: Mapping[str, tuple[tuple[float, float], ...]], ratios: tuple[float, ...]
    ) -> tuple[float, dict[str, float]]:
        """R_XiL and domains from other pairs (R_NRMSE, R_τ) a dynamic domain and other U/range, combined alike."""
        domains = {
            name: dynamics_fidelity([r for r, _ in pairs], [r for _, r in pairs], self.arithmetic)
            for name, pairs in signals.items()
        }
        if ratios:
            domains[MEASUREMENT] = measurement_fidelity(ratios, self.arithmetic)
        return total_fidelity(domains, self.weights), domains


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
    time : (t,)
        In s, at equal steps; only differences count.
    system_dynamics, residual_vehicle_model
        Signal pairs by name, each signal ``(t,)``. Pairs with an ``expanded_uncertainty`` make up R_MU.
    f_max : float
        Largest relevant frequency of the manoeuvre in Hz (Eq. 20).
    weights
        By domain, for exactly the domains there are; the paper's 0.4, 0.4, 0.2 by default when all three are there.

    Raises
    ------
    InputError
        Unequal lengths, NaN, a constant reference, weights that do not sum to one or do not fit the domains.
    """
    step = check_time(time)
    given = {"system_dynamics": system_dynamics, "residual_vehicle_model": residual_vehicle_model or {}}
    signals = {
        domain: tuple(
            assess_signal(name, pair, step, f_max, nrmse, longest_delay, len(time), domain)
            for name, pair in pairs.items()
        )
        for domain, pairs in given.items()
        if pairs
    }
    sensors = tuple(
        Sensor(one.name, one.pair.expanded_uncertainty / one.width, one.pair.degrees_of_freedom)
        for members in signals.values()
        for one in members
        if one.pair is not None and one.pair.expanded_uncertainty is not None
    )
    return assemble(signals, sensors, weights, f_max, nrmse_form=nrmse, step=step)


def assemble(
    signals: dict[str, tuple[SignalFidelity, ...]],
    sensors: tuple[Sensor, ...],
    weights: Mapping[str, float] | None,
    f_max: float,
    arithmetic: str = "definition",
    nrmse_form: str = "definition",
    step: float | None = None,
    where: str = "fidelity",
) -> Fidelity:
    """R_XiL from partial fidelities; the weights must name exactly the domains there are."""
    if arithmetic not in ARITHMETICS or nrmse_form not in NRMSE:
        raise InputError(
            where,
            f"arithmetic '{arithmetic}', nrmse '{nrmse_form}'",
            f"choose {' | '.join(ARITHMETICS)} and {' | '.join(NRMSE)}",
        )
    if not (math.isfinite(f_max) and f_max > 0):
        raise InputError(f"{where}: f_max", f"{f_max!r} is not possible", "give a frequency above 0 in Hz")
    domains = {
        name: dynamics_fidelity(
            [one.nrmse for one in members], [one.delay_fidelity for one in members], arithmetic, where
        )
        for name, members in signals.items()
    }
    if sensors:
        domains[MEASUREMENT] = measurement_fidelity([one.ratio for one in sensors], arithmetic, where)
    if weights is None:
        weights = WEIGHTS
    if set(weights) != set(domains):
        raise InputError(
            f"{where}: weights",
            f"they name {', '.join(weights)}, but there are values for {', '.join(domains) or 'nothing'}",
            "give a weight to each domain that has signals, no other",
        )
    weights = dict(weights)
    check_weights(weights, f"{where}: weights")
    return Fidelity(
        total_fidelity(domains, weights), domains, weights, signals, sensors, f_max, arithmetic, nrmse_form, step
    )


def assess_signal(
    name: str,
    pair: SignalPair,
    step: float,
    f_max: float,
    nrmse: str = "definition",
    longest_delay: float | None = None,
    count: int | None = None,
    where: str = "signal",
) -> SignalFidelity:
    """R_NRMSE and R_τ of one pair; an undetermined delay counts as the smallest that explains the signals, or as
    none of the fidelity where no delay does."""
    where = f"{where}.{name}"
    reference, test = (np.asarray(signal, dtype=float) for signal in (pair.reference, pair.test))
    check_pair(reference, test, count, where)
    if not (math.isfinite(f_max) and f_max > 0):
        raise InputError("f_max", f"{f_max!r} is not possible", "give a frequency above 0 in Hz")
    width = signal_range(reference, where)
    mean_square = float(np.mean((reference - test) ** 2))
    found = delay(reference, test, step, longest_delay)
    by_delay = float(delay_fidelity(found.nearest, f_max)) if found.nearest is not None else 0.0
    return SignalFidelity(
        name, nrmse_fidelity_of(mean_square, width, nrmse), found, by_delay, 0.0, pair, mean_square, width
    )


def check_time(time: np.ndarray, where: str = "time") -> float:
    """The step of an equally spaced, increasing time axis in s; raises ``InputError`` otherwise."""
    time = np.asarray(time, dtype=float)
    if time.ndim != 1 or len(time) < 2 or not np.all(np.isfinite(time)):
        raise InputError(where, "is no list of at least two finite times", "give times in s")
    steps = np.diff(time)
    step = float(time[-1] - time[0]) / (len(time) - 1)
    if not step > 0 or np.max(np.abs(steps - step)) > 0.01 * step:
        raise InputError(where, "does not increase in equal steps", "resample both recordings to one step")
    return step


def check_pair(reference: np.ndarray, test: np.ndarray, count: int | None, where: str) -> None:
    """Raises ``InputError`` on unequal lengths or samples that are not finite."""
    if reference.ndim != 1 or reference.shape != test.shape or (count is not None and len(reference) != count):
        expected = "" if count is None else f", time has {count}"
        raise InputError(
            where, f"reference has {reference.size} samples, test {test.size}{expected}", "give equally many"
        )
    for kind, signal in (("reference", reference), ("test", test)):
        if not np.all(np.isfinite(signal)):
            place = int(np.flatnonzero(~np.isfinite(signal))[0])
            raise InputError(
                where, f"sample {place + 1} of the {kind} is {signal[place]}", "every sample must be finite"
            )
