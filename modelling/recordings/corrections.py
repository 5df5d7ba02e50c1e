"""What loggers do to values: numbers that stand for none, angles and counters that start anew, values that are held.

Each is corrected with a note, and only where the values leave no doubt.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

TURN = 2 * math.pi  # rad


@dataclass(frozen=True)
class CorrectionSettings:
    """From which values on a correction or a note leaves no doubt; ratios without a unit.

    Where no source is given, the number was chosen by trial: recordings without the fault (``tests/recordings``, the
    examples, drives and beds of others) stay as they are, and recordings with the fault are corrected.

    Attributes
    ----------
    overrange : float
        SI: a larger number stands for a missing value. SCPI (IEEE 488.2) writes 9.91E37, loggers write the largest
        float, 3.4028235E38, or ±1e30; no quantity of a drivetrain is so large.
    far_beyond : float
        Times all other values: a value that is larger gets a note.
    far_beyond_share : float
        Largest share of the samples that a value far beyond the others has; a more frequent one is a signal.
    far_beyond_samples, wrap_samples, magnitude_samples : int
        Least number of samples that the note of a value far beyond the others, the search for wraps, and the note of
        a magnitude need.
    counter_bits : tuple of int
        Widths of counters and numbers without sign: those of integer types and of 24-bit converters.
    jump : float
        Of the period, or of the span while the period is not known: a larger step is a jump. Below one half, the
        direction of a motion is known from two samples (sampling theorem).
    most_jumps, most_unknown_jumps : float
        Largest share of the steps that jump, with a period that is known, and with one that is not.
    least_unknown_jumps : int
        Least number of jumps for the note of an unknown period.
    smooth : float
        Times the usual (99 %) step: the largest step that is left when whole periods are taken off a jump.
    largest_motion : float
        Of the period, from sample to sample: beyond it, nobody can tell how far it turned.
    period_used : float
        Of the period: least span of a counter that wraps.
    middle : float
        Of the period, to both sides of its half: numbers stored without sign leave this range empty.
    held_changes : int
        Least number of changes of a channel that is held.
    most_changes : float
        Largest share of the rows with a change: a channel that is held changes every second row at most.
    on_lattice : float
        Least share of the changes that come whole intervals after the one before.
    skipped : float
        Largest share of intervals without a change, where two values happen to be equal.
    smooth_input : float
        Largest rms of an input's changes over its standard deviation; a real staircase changes more.
    one_step, one_step_share : float
        Changes below ``one_step`` times the smallest are one step of the resolution; where more than this share of
        the changes are, the channel is coarse and not held.
    rebounds : int
        Least number of visits of a speed to zero, each back to where it came from, that make it a magnitude.
    near_zero : float
        Of the largest speed: below it, the speed visits zero.
    short_visit : float
        Largest share of the samples in one visit to zero; a longer one is a standstill.
    steep : float
        Of the usual (95 %) step: least change of speed into and out of a visit.
    longest_constant : float
        s, or a tenth of a shorter recording: how long a sensor that moves may show one value.
    fewest_equal : int
        Equal values one after another before a sensor keeps its value.
    coarse_share : float
        Of values equal to the one before: beyond it, the resolution is coarse or the motion slow, and nothing is kept.
    fewest_levels, fewest_of_sensor : int
        That a rounded signal takes at least; a command that switches between a few levels is exact, a sensor is not.
    most_levels : int
        Steps in the range of a rounded signal; finer ones are those of its digits.
    on_a_level : float
        Of a step: how far a value lies from a level at most.
    """

    overrange: float = 9.99e29
    far_beyond: float = 20.0
    far_beyond_share: float = 0.05
    far_beyond_samples: int = 20
    wrap_samples: int = 10
    magnitude_samples: int = 100
    counter_bits: tuple[int, ...] = (16, 24, 32)
    jump: float = 0.5
    most_jumps: float = 0.5
    most_unknown_jumps: float = 0.2
    least_unknown_jumps: int = 3
    smooth: float = 6.0
    largest_motion: float = 0.4
    period_used: float = 0.9
    middle: float = 0.1
    held_changes: int = 20
    most_changes: float = 0.55
    on_lattice: float = 0.95
    skipped: float = 0.3
    smooth_input: float = 0.5
    one_step: float = 1.5
    one_step_share: float = 0.5
    rebounds: int = 3
    near_zero: float = 0.03
    short_visit: float = 0.02
    steep: float = 0.3
    longest_constant: float = 0.05
    fewest_equal: int = 8
    coarse_share: float = 0.5
    fewest_levels: int = 64
    fewest_of_sensor: int = 8
    most_levels: int = 2**14
    on_a_level: float = 0.1


SETTINGS = CorrectionSettings()

# --- Numbers that stand for missing values.


def without_overrange(values: np.ndarray) -> tuple[np.ndarray, int]:
    """Values (t,) with NaN for numbers that stand for none, and how many those were."""
    with np.errstate(invalid="ignore"):
        over = np.abs(values) >= SETTINGS.overrange
    return (np.where(over, np.nan, values), int(over.sum())) if over.any() else (values, 0)


def far_beyond_note(name: str, time: np.ndarray, values: np.ndarray) -> list[str]:
    """A note of one value far beyond all others, as -9999 may stand for missing ones; values (t,) at times (t,)."""
    there = values[np.isfinite(values)]
    if len(there) < SETTINGS.far_beyond_samples:
        return []
    sizes = np.abs(there)
    extreme = there[int(np.argmax(sizes))]
    rest = sizes[there != extreme]
    count = len(there) - len(rest)
    few = count <= SETTINGS.far_beyond_share * len(there)
    if not few or not len(rest) or not 0 < SETTINGS.far_beyond * rest.max() < abs(extreme):
        return []
    first = time[int(np.argmax(values == extreme))]
    times = f"{count} times, first" if count > 1 else "once,"
    wrong = f"{name} is {extreme:g} (SI) {times} at {first:g} s, far beyond all other values"
    return [f"{wrong}: if it stands for a missing value, leave the cell empty"]


# --- Angles and counters that start anew, and numbers stored without their sign.


def unwrapped(values: np.ndarray, period: float) -> np.ndarray:
    """Values (t,) that go on where they start anew after a period; NaN stays."""
    result = values.copy()
    there = np.isfinite(values)
    result[there] = np.unwrap(values[there], period=period)
    return result


def _smooth_after(values: np.ndarray, period: float) -> bool:
    """Whether values (t,) jump, and if a period is taken off the jumps, move as steadily there as elsewhere."""
    step = np.diff(values)
    jumps = np.abs(step) > SETTINGS.jump * period
    if not jumps.any() or jumps.mean() > SETTINGS.most_jumps:
        return False
    moved = np.abs(step - period * np.round(step / period))
    usual = float(np.quantile(moved[~jumps], 0.99)) if (~jumps).any() else 0.0
    smooth = float(moved[jumps].max()) <= max(SETTINGS.smooth * usual, 1e-9 * period)
    return smooth and float(moved.max()) <= SETTINGS.largest_motion * period


def _counter_step(values: np.ndarray) -> float:
    """What one count of a counter is worth: all values (t,) are whole multiples of it; 0 where there is none."""
    levels = np.unique(np.abs(values))
    levels = levels[levels > 0]
    if len(levels) < 2:
        return 0.0
    small = levels[levels < 1e-3 * levels[-1]]  # their digits reach further
    step, least = float(levels[0]), 1e-11 * float(levels[-1])
    for own in (small, levels):
        for _ in range(40):  # Euclid's algorithm
            left = np.abs(own - step * np.round(own / step))
            left = left[left > max(1e-3 * step, least if own is levels else 0.0)]
            if not len(left):
                break
            step = float(left.min())
        if step < least:
            return 0.0
        if len(own):
            step = float(own[-1]) / round(float(own[-1]) / step)
    return step


def corrected_wraps(name: str, values: np.ndarray, *, angle: bool) -> tuple[np.ndarray, float, list[str]]:
    """Values (t,) in SI without the jumps of an angle or counter that starts anew, or of a number without sign.

    Returns
    -------
    values : ndarray (t,)
    period : float
        Of an angle that was unwrapped; otherwise 0.
    notes : list of str
    """
    there = np.isfinite(values)
    own = values[there]
    if len(own) < SETTINGS.wrap_samples:
        return values, 0.0, []
    span = float(np.ptp(own))
    largest = float(np.abs(np.diff(own)).max())
    if largest <= SETTINGS.jump * span or span == 0:
        return values, 0.0, []
    step = _counter_step(own)
    jumps = int((np.abs(np.diff(own)) > SETTINGS.jump * span).sum())
    if angle:
        for period in (TURN, 360.0, *(2.0**bits * step for bits in SETTINGS.counter_bits if step)):
            if 0.5 * period < span <= period * 1.001 and _smooth_after(own, period):
                said = "360°" if period == TURN else f"{period:g} rad"
                note = f"{name} jumps by {said} {jumps} times: it starts anew after a period, and is unwrapped"
                return unwrapped(values, period), period, [note]
        return values, 0.0, []
    for bits in SETTINGS.counter_bits if step else ():
        period = 2.0**bits * step
        empty = (np.abs(own % period - 0.5 * period) >= SETTINGS.middle * period).all()
        if own.min() >= 0 and empty and SETTINGS.period_used * period < span <= period and _smooth_after(own, period):
            negative = there & (values > 0.5 * period)
            note = (
                f"{name}: {negative.sum()} values near {period:g} (SI) are negative ones stored without sign, corrected"
            )
            return np.where(negative, values - period, values), 0.0, [note]
        if SETTINGS.period_used * period < span <= period and _smooth_after(own, period):
            note = f"{name} jumps by {period:g} (SI) {jumps} times: its {bits} bits overflow, and it is unwrapped"
            return unwrapped(values, period), 0.0, [note]
    return values, 0.0, []


def jumps_note(name: str, values: np.ndarray) -> list[str]:
    """A note of an angle (t,) that jumps again and again, always the same way: it may start anew."""
    own = values[np.isfinite(values)]
    if len(own) < SETTINGS.wrap_samples:
        return []
    step = np.diff(own)
    span = float(np.ptp(own))
    jumps = step[np.abs(step) > SETTINGS.jump * span]
    some = SETTINGS.least_unknown_jumps <= len(jumps) <= SETTINGS.most_unknown_jumps * len(step)
    if not some or abs(np.sign(jumps).sum()) != len(jumps):
        return []
    return [f"{name} jumps by some {np.median(np.abs(jumps)):.3g} rad {len(jumps)} times: if it starts anew after a "
            "period, write period = … (in the file's unit) in a channel file"]  # fmt: skip


# --- Values that are repeated until the next one comes.


def held_rows(values: np.ndarray, *, input_torque: bool) -> tuple[np.ndarray, int]:
    """Values (t,) with NaN in place of repeats, and how many rows there are to a value; 0 if none is held.

    A channel is held where it changes every k rows alone. A coarse resolution, of which most changes are one step, and
    an input that moves in real steps are left as they are.
    """
    if len(values) < 2 * SETTINGS.held_changes or not np.isfinite(values).all():
        return values, 0
    step = np.diff(values)
    changes = np.flatnonzero(step) + 1
    if not SETTINGS.held_changes <= len(changes) <= SETTINGS.most_changes * len(values):
        return values, 0
    apart = np.diff(changes)
    every = int(np.bincount(apart).argmax())
    off = np.abs(apart - every * np.maximum(np.round(apart / every), 1))
    if every < 2 or np.mean(off <= (every >= 4)) < SETTINGS.on_lattice:
        return values, 0
    moving = apart[apart <= 3 * every]
    if len(moving) < (1 - SETTINGS.skipped) * len(apart) or np.mean(moving > 1.5 * every) > SETTINGS.skipped:
        return values, 0
    sizes = np.abs(step[changes - 1])
    if np.mean(sizes < SETTINGS.one_step * sizes.min()) > SETTINGS.one_step_share:
        return values, 0
    held = values[changes]
    if input_torque and np.sqrt(np.mean(np.diff(held) ** 2)) > SETTINGS.smooth_input * np.std(held):
        return values, 0
    kept = np.full(len(values), np.nan)
    at = np.unique(np.concatenate([[changes[0] % every] if changes[0] >= every else [], changes]).astype(int))
    for begin, end in pairwise(changes):  # values that happened to be equal
        if end - begin > 1.5 * every:
            at = np.append(at, np.arange(begin + every, end - every // 2, every))
    at = np.unique(at.astype(int))
    kept[at] = values[at]
    return kept, every


# --- A sensor that keeps one value: it hangs, or is at the end of its range.


def kept_values(
    values: np.ndarray, time: np.ndarray, shortest: float = SETTINGS.longest_constant
) -> Iterator[tuple[int, int, str]]:
    """First and last sample of each time that a sensor keeps its value, and which fault that is: ``clipped`` at its
    largest or smallest value, else ``stuck``; values (t,) at times (t,) in s.

    Shorter times than ``shortest`` (s) are none, nor are fewer equal values than chance gives.
    """
    measured = values[np.isfinite(values)]
    if len(measured) > 1 and np.mean(np.diff(measured) == 0) > SETTINGS.coarse_share:
        return
    ends = np.nanmin(values, initial=np.inf), np.nanmax(values, initial=-np.inf)
    equals_next = np.concatenate([[False], np.diff(values) == 0, [False]])
    edges = np.flatnonzero(np.diff(equals_next.astype(int)))
    shortest = min(shortest, 0.1 * float(np.ptp(time)))
    for first, last in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        if last - first >= SETTINGS.fewest_equal and time[last] - time[first] >= shortest:
            yield first, last, "clipped" if values[first] in ends else "stuck"


# --- Values that are rounded.


def resolution(values: np.ndarray, fewest: int = SETTINGS.fewest_levels) -> float:
    """The step to which values (t,) are rounded; 0 where none shows, or where they have fewer levels."""
    levels = np.unique(values)
    if len(levels) < fewest:
        return 0.0
    gaps = np.diff(levels)
    step = float(gaps.min())
    if np.ptp(levels) > SETTINGS.most_levels * step:
        return 0.0
    for _ in range(3):  # the digits of a file blur the step; all gaps together tell it better
        step = float(gaps.sum() / np.maximum(np.round(gaps / step), 1).sum())
    places = (levels - levels[0]) / step
    return step if np.abs(places - np.round(places)).max() < SETTINGS.on_a_level else 0.0


# --- A speed without its sign.


def magnitude_note(name: str, values: np.ndarray) -> list[str]:
    """A note of a speed (t,) that is never negative and again and again turns round at zero."""
    own = values[np.isfinite(values)]
    if len(own) < SETTINGS.magnitude_samples or own.min() < 0:
        return []
    near = own < SETTINGS.near_zero * own.max()
    ends = np.flatnonzero(np.diff(np.concatenate([[False], near, [False]]).astype(int)))
    visits = [
        (begin, end) for begin, end in zip(ends[::2], ends[1::2], strict=True) if begin > 2 and end < len(own) - 2
    ]
    steep = SETTINGS.steep * float(np.quantile(np.abs(np.diff(own)), 0.95))
    short = [
        (begin, end)
        for begin, end in visits
        if end - begin <= max(3, SETTINGS.short_visit * len(own))
        and own[begin - 3] > own[begin] + 1.5 * steep
        and own[end + 1] > own[end - 1] + steep
    ]
    if len(short) < SETTINGS.rebounds:
        return []
    return [f"{name} is never negative, and turns round at zero {len(short)} times: it may be a magnitude without sign"]
