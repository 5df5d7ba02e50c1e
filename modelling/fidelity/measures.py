"""The partial fidelities and how they combine: Eqs. 13 to 23, with the paper's own arithmetic there by name.

``definition`` is what the paper defines: Eq. 18 as RMSE over range, sums over the m signals divided by 2m (Eqs. 17, 21)
or m (Eq. 22), so that an ideal test bed scores exactly one. ``published`` divides every sum by six, which alone gives
the paper's Tab. 3; an ideal test bed then scores 0.82. ``literal`` takes Eq. 18 as printed, range inside the root,
whose value depends on the unit.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from modelling.common.errors import InputError

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
