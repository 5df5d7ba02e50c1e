"""How the intervals of a recording are divided into steps, and which of them need finer ones."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from modelling.simulation.integrator.task import Trajectories, fewest_steps

OUTLIERS_IN = 32  # samples, of which one may miss a jump of torque: it lies on either side of it
NO_RANGE = 1e-6  # of a reading's size: a range below that is rounding
KINKED_ORDER, SMOOTH_ORDER = 2, 4  # with which the local errors of an interval fall at least


@dataclass(frozen=True)
class Stepping:
    """How a recording is stepped through: each interval between samples in ``refinement`` times the steps that
    ``steps_per_second`` asks for, at least one; implicit or explicit. ``refinement`` may be (t-1,)."""

    steps_per_second: float
    refinement: int | np.ndarray = 1
    implicit: bool = False

    def finer(self, factor: int | np.ndarray) -> Stepping:
        """The same with every step divided, by one factor or one an interval (t-1,)."""
        return replace(self, refinement=self.refinement * factor)

    def count(self, time: np.ndarray) -> float:
        """Steps in all for samples at ``time`` (t,)."""
        return float(np.sum(self.refinement * fewest_steps(np.diff(time), self.steps_per_second)))

    def mean_rate(self, time: np.ndarray) -> float:
        """Steps a second, on average over ``time`` (t,)."""
        return self.count(time) / float(np.ptp(time))


def difference(coarse: Trajectories, fine: Trajectories, rough: bool) -> np.ndarray:
    """Largest differences (y,) of the readings over their ranges; of the states where there are no readings.

    ``rough``: the worst of :data:`OUTLIERS_IN` samples does not count.
    """
    first, second = (_by_column(done.readings if done.readings.shape[-1] else done.states) for done in (coarse, fine))
    apart = np.abs(first - second)
    return ((_outliers_lowered(apart) if rough else apart).max(axis=2) / _ranges(second)).max(axis=0, initial=0.0)


def local_errors(done: Trajectories, coordinates: int, rough: bool) -> np.ndarray:
    """Local errors (t-1,) of the intervals: of whichever reading or state behind the angles has the largest share of
    its range, over all rows of a batch. ``rough`` as for :func:`difference`, for the readings."""
    sensors = done.readings.shape[-1]
    errors = np.abs(_by_column(done.errors))
    if rough:
        errors[:, :sensors] = _outliers_lowered(errors[:, :sensors])
    of_readings, of_states = _ranges(_by_column(done.readings)), _ranges(_by_column(done.states[:, :, coordinates:]))
    return (errors / np.concatenate([of_readings, of_states], axis=1)[:, :, None]).max(axis=(0, 1), initial=0.0)


def divisions(errors: np.ndarray, allowed: float, order: int) -> np.ndarray:
    """Factors (t-1,), powers of two, by which steps are divided so that the ``errors`` (t-1,) add up to ``allowed``.

    The largest errors are lowered to one level; those below it stay.
    """
    falling = np.sort(errors)[::-1]
    count = np.arange(len(errors))
    rest = np.append(np.cumsum(falling[::-1])[::-1], 0.0)[: len(errors)]
    level = float(np.max((allowed - rest) / np.maximum(count, 1), initial=0.0, where=(count > 0) & (rest < allowed)))
    level = max(level, allowed / len(errors))
    wanted = np.log2(np.maximum(errors / level, 1.0)) / order
    return (2 ** np.ceil(wanted)).astype(np.int64)


def _by_column(values: np.ndarray) -> np.ndarray:
    """(b, k, t) of (b, t, k), contiguous: NumPy reduces the last axis ten times faster."""
    return np.ascontiguousarray(np.swapaxes(values, 1, 2))


def _ranges(values: np.ndarray) -> np.ndarray:
    """Ranges (b, k) of (b, k, t); 1 where there is none."""
    largest, smallest = values.max(axis=2, initial=-np.inf), values.min(axis=2, initial=np.inf)
    ranges = np.maximum(largest - smallest, NO_RANGE * np.maximum(np.abs(largest), np.abs(smallest)))
    return np.where(ranges > 0, ranges, 1.0)


def _outliers_lowered(values: np.ndarray) -> np.ndarray:
    """(b, k, t) with the worst of every :data:`OUTLIERS_IN` samples as large as the second."""
    whole = values.shape[2] // OUTLIERS_IN * OUTLIERS_IN
    windows = values[:, :, :whole].reshape(*values.shape[:2], -1, OUTLIERS_IN)
    lowered = np.minimum(windows, np.partition(windows, -2, axis=3)[..., -2:-1])
    return np.concatenate([lowered.reshape(*values.shape[:2], whole), values[:, :, whole:]], axis=2)
