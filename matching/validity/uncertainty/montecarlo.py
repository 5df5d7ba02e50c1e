"""The Monte Carlo method of JCGM 101: adaptive, seeded, on all cores, in bounded memory."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import sympy

from matching.validity.budget.budget import Budget, Measurand
from matching.validity.uncertainty.draws import sampler
from matching.validity.uncertainty.histogram import Histogram
from matching.validity.uncertainty.rounding import numerical_tolerance
from modelling.common.errors import InputError
from modelling.units import Unit

PILOT = 10  # chunks kept to place the histogram's edges
MOST = 2_000_000


@dataclass(frozen=True)
class MonteCarlo:
    """Expectation, standard uncertainty and coverage intervals by Monte Carlo, in SI.

    ``spread`` holds twice the standard deviation, over the chunks, of the averages of (value, uncertainty, low end,
    high end): what the draws leave uncertain (JCGM 101, 7.9.4). ``stable`` says that all four are within the
    numerical tolerance.
    """

    value: float
    standard_uncertainty: float
    shortest: tuple[float, float]
    symmetric: tuple[float, float]
    coverage: float
    draws: int
    seed: int
    stable: bool
    tolerance: float
    spread: np.ndarray
    histogram: Histogram = field(repr=False)

    def to_dict(self, unit: Unit) -> dict[str, Any]:
        """As ``uncertainty.json`` holds it, in a unit."""
        return {
            "value": unit.value_from_si(self.value),
            "standard_uncertainty": unit.difference_from_si(self.standard_uncertainty),
            "shortest_interval": [unit.value_from_si(end) for end in self.shortest],
            "symmetric_interval": [unit.value_from_si(end) for end in self.symmetric],
            "draws": self.draws,
            "seed": self.seed,
            "stable": self.stable,
        }


def monte_carlo(
    budget: Budget,
    measurand: Measurand,
    *,
    seed: int = 1,
    draws: int | None = None,
    digits: int = 2,
    most: int = MOST,
    workers: int | None = None,
    strictness: float = 1.0,
) -> MonteCarlo:
    """The distribution of the measurand by propagating those of the inputs.

    Parameters
    ----------
    draws : int, optional
        So many draws; without it, chunk after chunk until value, uncertainty and both ends of the interval are stable
        to ``digits`` significant digits of the uncertainty over ``strictness`` (JCGM 101, 7.9), ``most`` at the most.
    seed : int
        The same seed gives the same result, however many ``workers`` (threads) there are.

    Raises
    ------
    InputError
        The formula has no finite real value for some draws.
    """
    chunk = max(math.ceil(100 / (1 - budget.coverage)), 10_000)
    limit = max(2, math.ceil((most if draws is None else draws) / chunk))
    function = sympy.lambdify(
        [sympy.Symbol(one.name, real=True) for one in budget.inputs], measurand.expression, "numpy", cse=True
    )
    draw = sampler(budget)

    def values(place: int) -> np.ndarray:
        generator = np.random.Generator(np.random.SFC64(np.random.SeedSequence(seed, spawn_key=(place,))))
        with np.errstate(all="ignore"):
            y = np.asarray(function(*draw(generator, chunk)), dtype=float)
        y = np.broadcast_to(y, (chunk,))
        if not np.all(np.isfinite(y)):
            raise InputError(
                f"{budget.where}: measurand {measurand.name}.formula",
                f"has no finite real value for {np.count_nonzero(~np.isfinite(y))} of {chunk} draws",
                "narrow an input or correct it",
            )
        return y

    workers = workers or min(os.cpu_count() or 1, 8)
    with ThreadPoolExecutor(workers) as pool:
        pilot = list(pool.map(values, range(min(PILOT, limit))))
        histogram = Histogram.around(np.concatenate(pilot), budget.coverage)

        def summary(y: np.ndarray) -> tuple:
            mean = float(y.mean())
            low, high = _shortest(np.sort(y), budget.coverage)
            moments = (len(y), mean, float(np.sum((y - mean) ** 2)), float(y.min()), float(y.max()))
            return histogram.tally(y), moments, low, high

        def chunks() -> Iterator[tuple]:
            yield from map(summary, pilot)
            pilot.clear()
            for first in range(PILOT, limit, 4 * workers):  # waves bound what is in memory at a time
                yield from pool.map(lambda place: summary(values(place)), range(first, min(first + 4 * workers, limit)))

        rows, tolerance, stable = [], math.nan, False
        for counts, moments, low, high in chunks():
            histogram.add(counts, *moments)
            rows.append((moments[1], math.sqrt(moments[2] / (moments[0] - 1)), low, high))
            if len(rows) == limit or (draws is None and len(rows) >= PILOT):
                tolerance = numerical_tolerance(histogram.standard_deviation, digits) / strictness
                stable = bool(np.all(_spread(rows) < tolerance)) or histogram.standard_deviation == 0
                if stable and draws is None:
                    break
    tail = (1 - budget.coverage) / 2
    shortest = histogram.shortest(budget.coverage)
    symmetric = (histogram.quantile(tail), histogram.quantile(1 - tail))
    if histogram.standard_deviation == 0:  # an exact result, which the histogram's bins hold to a bin only
        shortest = symmetric = (histogram.mean, histogram.mean)
    return MonteCarlo(
        histogram.mean,
        histogram.standard_deviation,
        shortest,
        symmetric,
        budget.coverage,
        histogram.number,
        seed,
        stable,
        tolerance,
        _spread(rows),
        histogram,
    )


def _spread(rows: list[tuple]) -> np.ndarray:
    table = np.array(rows)
    return 2 * table.std(axis=0, ddof=1) / math.sqrt(len(rows))


def _shortest(ordered: np.ndarray, coverage: float) -> tuple[float, float]:
    held = round(coverage * len(ordered))
    widths = ordered[held:] - ordered[: len(ordered) - held]
    start = int(np.argmin(widths))
    return float(ordered[start]), float(ordered[start + held])
