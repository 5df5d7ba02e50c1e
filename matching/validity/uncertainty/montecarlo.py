"""The Monte Carlo method of JCGM 101: adaptive, seeded, on all cores, in bounded memory."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import sympy

from matching.validity.budget.budget import Budget, Measurand
from matching.validity.uncertainty.draws import sampler
from matching.validity.uncertainty.histogram import Histogram
from matching.validity.uncertainty.propagate import LARGEST_VALUE, too_large
from matching.validity.uncertainty.rounding import numerical_tolerance
from modelling.common.errors import InputError
from modelling.units import Unit

PILOT = 10  # chunks kept to place the histogram's edges
MOST_DRAWS = 2_000_000  # draws until the result is stable
MOST_TO_DECIDE = 10_000_000  # draws until a question to the result is decided as well, some seconds
WIDEST_DRAWS = 1e150  # of wider ones the sum of squares over all draws is no floating-point number
QUESTION_GROWTH = 1.25  # the question is asked again when there are so many times the draws


@dataclass(frozen=True)
class MonteCarlo:
    """Expectation, standard uncertainty and coverage intervals by Monte Carlo, in SI.

    ``spread`` (4,) is twice the standard deviation, over the chunks, of the averages of (value, uncertainty, low end,
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
    most: int = MOST_DRAWS,
    workers: int | None = None,
    undecided: Callable[[MonteCarlo], bool] | None = None,
) -> MonteCarlo:  # what is drawn, and when there are enough draws
    """The distribution of the measurand by propagating those of the inputs.

    Parameters
    ----------
    draws : int, optional
        So many draws; without it, chunk after chunk until value, uncertainty and both ends of the interval are stable
        to ``digits`` significant digits of the uncertainty (JCGM 101, 7.9), ``most`` at the most.
    undecided : function, optional
        Whether a stable result leaves a question open: then more is drawn, :data:`MOST_TO_DECIDE` at the most.
    seed : int
        The same seed gives the same result, however many ``workers`` (threads) there are.

    Raises
    ------
    InputError
        The formula has no finite real value for some draws.
    """
    chunk = max(math.ceil(100 / (1 - budget.coverage)), 10_000)
    limit = max(2, math.ceil((draws or (MOST_TO_DECIDE if undecided else most)) / chunk))
    values = _drawn_values(budget, measurand, seed, chunk)
    workers = workers or min(os.cpu_count() or 1, 8)
    with ThreadPoolExecutor(workers) as pool:
        pilot = list(pool.map(values, range(min(PILOT, limit))))
        histogram = Histogram.around(np.concatenate(pilot), budget.coverage)

        def summary(y: np.ndarray) -> tuple:
            return _summary(y, histogram, budget.coverage)

        def chunks() -> Iterator[tuple]:
            yield from map(summary, pilot)
            pilot.clear()
            for first in range(PILOT, limit, 4 * workers):  # waves bound what is in memory at a time
                yield from pool.map(lambda place: summary(values(place)), range(first, min(first + 4 * workers, limit)))

        def result() -> MonteCarlo:
            return _result(budget.coverage, histogram, rows, seed, digits)

        rows: list[tuple] = []
        next_question = 0.0
        for counts, moments, low, high in chunks():
            histogram.add(counts, *moments)
            rows.append((moments[1], math.sqrt(moments[2] / (moments[0] - 1)), low, high))
            if draws is not None or len(rows) < max(PILOT, next_question) or not _stable(rows, digits, histogram):
                continue
            if undecided is None or not undecided(result()):
                break
            next_question = QUESTION_GROWTH * len(rows)
        return result()


def _summary(y: np.ndarray, histogram: Histogram, coverage: float) -> tuple:
    """Of a chunk of values (count,): its counts by bin, its moments, and the ends of its shortest interval."""
    mean = float(y.mean())
    low, high = _shortest(np.sort(y), coverage)
    moments = (len(y), mean, float(np.sum((y - mean) ** 2)), float(y.min()), float(y.max()))
    return histogram.tally(y), moments, low, high


def _drawn_values(budget: Budget, measurand: Measurand, seed: int, count: int) -> Callable[[int], np.ndarray]:
    """The measurand's values (count,) of the chunk at a place; each place has random numbers of its own."""
    symbols = [sympy.Symbol(quantity.name, real=True) for quantity in budget.inputs]
    function = sympy.lambdify(symbols, measurand.expression, "numpy", cse=True)
    draw = sampler(budget)

    def values(place: int) -> np.ndarray:
        generator = np.random.Generator(np.random.SFC64(np.random.SeedSequence(seed, spawn_key=(place,))))
        with np.errstate(all="ignore"):
            y = np.broadcast_to(np.asarray(function(*draw(generator, count)), dtype=float), (count,))
        if not np.all(np.isfinite(y)):
            raise InputError(
                f"{budget.where}: measurand {measurand.name}.formula",
                f"has no finite real value for {np.count_nonzero(~np.isfinite(y))} of {count} draws",
                "narrow an input or correct it",
            )
        if max(abs(y.max()), abs(y.min())) > LARGEST_VALUE or y.max() - y.min() > WIDEST_DRAWS:
            raise too_large(budget, measurand)
        return y

    return values


def _result(coverage: float, histogram: Histogram, rows: list[tuple], seed: int, digits: int) -> MonteCarlo:
    tail = (1 - coverage) / 2
    # The average over the chunks, whose scatter is known: where the shortest interval of all draws lies is decided by
    # where its flat minimum happens to be, and scatters more with n^(−1/3).
    low, high = np.mean([row[2:] for row in rows], axis=0).tolist()
    shortest = low, high
    symmetric = (histogram.quantile(tail), histogram.quantile(1 - tail))
    if histogram.standard_deviation == 0:  # an exact result, which the histogram's bins hold to a bin only
        shortest = symmetric = (histogram.mean, histogram.mean)
    return MonteCarlo(
        histogram.mean,
        histogram.standard_deviation,
        shortest,
        symmetric,
        coverage,
        histogram.number,
        seed,
        _stable(rows, digits, histogram),
        numerical_tolerance(histogram.standard_deviation, digits),
        _spread(rows),
        histogram,
    )


def _stable(rows: list[tuple], digits: int, histogram: Histogram) -> bool:
    tolerance = numerical_tolerance(histogram.standard_deviation, digits)
    return histogram.standard_deviation == 0 or bool(np.all(_spread(rows) < tolerance))


def _spread(rows: list[tuple]) -> np.ndarray:
    table = np.array(rows)
    return 2 * table.std(axis=0, ddof=1) / math.sqrt(len(rows))


def _shortest(ordered: np.ndarray, coverage: float) -> tuple[float, float]:
    held = round(coverage * len(ordered))
    widths = ordered[held:] - ordered[: len(ordered) - held]
    start = int(np.argmin(widths))
    return float(ordered[start]), float(ordered[start + held])
