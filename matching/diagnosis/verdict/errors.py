"""Errors of base and final hypothesis on fitted and held-out data, and where the remaining error is largest."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from matching.diagnosis.candidates.motion import simulated_motion
from matching.diagnosis.data.segments import FitData
from matching.diagnosis.search.hypothesis import Hypothesis, at_noise, scatters_only, sensors_beyond_noise
from matching.diagnosis.verdict.result import PooledErrors, RemainingError, SensorErrors
from modelling.model.system import System

STATED_TOO_SMALL = 1.1  # times the stated uncertainty, from which scatter is said to be more
WORST_TIME_SHARE, WORST_TIME_SAMPLES = 16, 8  # the worst time is a sixteenth of a segment, at least so many samples


@dataclass(frozen=True)
class _Worst:
    """Samples of a segment and the mean square of the residual there."""

    square: float
    segment: int
    first: int
    last: int


def errors_by_sensor(
    system: System, base: Hypothesis, final: Hypothesis, before_holdout: np.ndarray, after_holdout: np.ndarray
) -> dict[str, SensorErrors]:
    """Root mean square errors of every sensor that was measured, SI.

    Parameters
    ----------
    before_holdout, after_holdout : ndarray (y,)
        On held-out data, in times the noise.
    """
    data = final.fit.problem.data
    before, after = ([test.ratio for test in fit.whiteness()] for fit in (base, final))
    out = {}
    for j, sensor in enumerate(system.sensors):
        if data.readings_by_sensor[j]:
            noise = float(data.noise[j])
            ratios = (before[j], after[j], before_holdout[j], after_holdout[j])
            out[sensor.name] = SensorErrors(noise, *(float(ratio * noise) for ratio in ratios))
    return out


def pooled_errors(whole: FitData, before: np.ndarray, after: np.ndarray) -> PooledErrors:
    """Errors on held-out data over each sensor's range, root mean square over the sensors.

    Parameters
    ----------
    whole : FitData
        Fitted and held-out data, of which the range is taken.
    before, after : ndarray (y,)
        On held-out data, in times the noise; NaN for a sensor without readings.
    """
    readings = np.concatenate([segment.readings for segment in whole.segments])
    measured = np.isfinite(readings).any(axis=0) & np.isfinite(after)
    width = np.zeros(len(whole.noise))
    width[measured] = np.nanmax(readings[:, measured], axis=0) - np.nanmin(readings[:, measured], axis=0)
    pooled = width > 0
    noise = whole.noise[pooled] / width[pooled]

    def rms(ratio: np.ndarray) -> float:
        return float(np.sqrt(np.mean((ratio[pooled] * noise) ** 2))) if pooled.any() else np.nan

    return PooledErrors(rms(before), rms(after), rms(np.ones(len(before))))


def remaining_errors(final: Hypothesis) -> list[RemainingError]:
    """For every sensor whose error is more than noise: when it is largest, with speeds and torques then."""
    problem, tests = final.fit.problem, final.whiteness()
    beyond = sensors_beyond_noise(final)
    if not beyond:
        return []
    motion, out = simulated_motion(final.fit), []
    for j, samples in beyond:
        worst = _worst_time(final, j)
        time, part = problem.data.segments[worst.segment].time, motion.segments[worst.segment]
        then = slice(part.start + worst.first, min(part.start + worst.last, part.stop))
        out.append(
            RemainingError(
                problem.model.sensors[j], tests[j].ratio,
                float(np.sqrt(worst.square)),
                float(time[worst.first]), float(time[min(worst.last, len(time) - 1)]),
                float(samples * np.median(np.diff(time))), _ranges(motion.speed, then), _ranges(motion.torque, then),
            )
        )  # fmt: skip
    return out


def _worst_time(final: Hypothesis, j: int) -> _Worst:
    """When the residual of a sensor is largest."""
    times = []
    for i, residual in enumerate(final.fit.errors):
        length = max(len(residual) // WORST_TIME_SHARE, WORST_TIME_SAMPLES)
        starts = range(0, max(len(residual) - length, 1), length)
        times += [_Worst(float(np.mean(residual[a : a + length, j] ** 2)), i, a, a + length) for a in starts]
    return max(times, key=lambda worst: worst.square)


def _ranges(signals: Mapping[str, np.ndarray], then: slice) -> dict[str, tuple[float, float]]:
    return {name: (float(values[then].min()), float(values[then].max())) for name, values in signals.items()}


def residual_once(final: Hypothesis) -> np.ndarray:
    """Residual (t, y), in times the noise, with every sample once: windows share the last of one and the first of the
    next."""
    segments, parts = final.fit.problem.data.segments, []
    for i, residual in enumerate(final.fit.errors):
        shared = i + 1 < len(segments) and segments[i + 1].name == segments[i].name
        shared = shared and segments[i + 1].time[0] == segments[i].time[-1]
        parts.append(residual[:-1] if shared else residual)
    return np.concatenate(parts)


def scatter_notes(final: Hypothesis) -> list[str]:
    """A sentence for every sensor that scatters by more than its stated uncertainty, where all of them only scatter."""
    if at_noise(final) or not scatters_only(final):
        return []
    sensors = final.fit.problem.system.sensors
    return [
        f"{sensor.name} scatters by {test.ratio:.3g} times its uncertainty, without a pattern: that is stated too small"
        for sensor, test in zip(sensors, final.whiteness(), strict=True)
        if test.ratio > STATED_TOO_SMALL
    ]
