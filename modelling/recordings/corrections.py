"""What loggers do to values: numbers that stand for none, angles and counters that start anew, values that are held.

Each is corrected with a note, and only where the values leave no doubt.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

# --- Numbers that stand for missing values.

OVERRANGE = 9.99e29  # SCPI writes 9.91E37, loggers 3.4028235E38 or ±1e30: no quantity of a drivetrain is so large
FAR_BEYOND = 20.0  # times all other values
FEW = 0.05  # of the samples: more of one value are a signal


def without_overrange(values: np.ndarray) -> tuple[np.ndarray, int]:
    """Values (t,) with NaN for numbers that stand for none, and how many those were."""
    with np.errstate(invalid="ignore"):
        over = np.abs(values) >= OVERRANGE
    return (np.where(over, np.nan, values), int(over.sum())) if over.any() else (values, 0)


def far_beyond_note(name: str, time: np.ndarray, values: np.ndarray) -> list[str]:
    """A note of one value far beyond all others, as -9999 may stand for missing ones; values (t,) at times (t,)."""
    there = values[np.isfinite(values)]
    if len(there) < 20:
        return []
    sizes = np.abs(there)
    extreme = there[int(np.argmax(sizes))]
    rest = sizes[there != extreme]
    count = len(there) - len(rest)
    if not len(rest) or count > FEW * len(there) or not 0 < FAR_BEYOND * rest.max() < abs(extreme):
        return []
    first = time[int(np.argmax(values == extreme))]
    times = f"{count} times, first" if count > 1 else "once,"
    wrong = f"{name} is {extreme:g} (SI) {times} at {first:g} s, far beyond all other values"
    return [f"{wrong}: if it stands for a missing value, leave the cell empty"]


# --- Angles and counters that start anew, and numbers stored without their sign.

TURN = 2 * math.pi  # rad
COUNTER_BITS = (16, 24, 32)
SMOOTH = 6.0  # times the usual largest step: a jump that is larger without a whole period is no motion
LARGEST_MOTION = 0.4  # of a period from sample to sample: beyond it, nobody can tell how far it turned


def unwrapped(values: np.ndarray, period: float) -> np.ndarray:
    """Values (t,) that go on where they start anew after a period; NaN stays."""
    result = values.copy()
    there = np.isfinite(values)
    result[there] = np.unwrap(values[there], period=period)
    return result


def _smooth_after(values: np.ndarray, period: float) -> bool:
    """Whether values (t,) jump, and if a period is taken off the jumps, move as steadily there as elsewhere."""
    step = np.diff(values)
    jumps = np.abs(step) > 0.5 * period
    if not jumps.any() or jumps.mean() > 0.5:
        return False
    moved = np.abs(step - period * np.round(step / period))
    usual = float(np.quantile(moved[~jumps], 0.99)) if (~jumps).any() else 0.0
    return float(moved.max()) <= LARGEST_MOTION * period and float(moved[jumps].max()) <= max(
        SMOOTH * usual, 1e-9 * period
    )


def _resolution(values: np.ndarray) -> float:
    """The step of which all values (t,) are whole multiples; 0 where there is none."""
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
    if len(own) < 10:
        return values, 0.0, []
    span = float(np.ptp(own))
    largest = float(np.abs(np.diff(own)).max())
    if largest <= 0.5 * span or span == 0:
        return values, 0.0, []
    step = _resolution(own)
    jumps = int((np.abs(np.diff(own)) > 0.5 * span).sum())
    if angle:
        for period in (TURN, 360.0, *(2.0**bits * step for bits in COUNTER_BITS if step)):
            if 0.5 * period < span <= period * 1.001 and _smooth_after(own, period):
                said = "360°" if period == TURN else f"{period:g} rad"
                note = f"{name} jumps by {said} {jumps} times: it starts anew after a period, and is unwrapped"
                return unwrapped(values, period), period, [note]
        return values, 0.0, []
    for bits in COUNTER_BITS if step else ():
        period = 2.0**bits * step
        empty = not ((own % period > 0.4 * period) & (own % period < 0.6 * period)).any()
        if own.min() >= 0 and empty and 0.9 * period < span <= period and _smooth_after(own, period):
            negative = there & (values > 0.5 * period)
            note = (
                f"{name}: {negative.sum()} values near {period:g} (SI) are negative ones stored without sign, corrected"
            )
            return np.where(negative, values - period, values), 0.0, [note]
        if 0.9 * period < span <= period and _smooth_after(own, period):
            note = f"{name} jumps by {period:g} (SI) {jumps} times: its {bits} bits overflow, and it is unwrapped"
            return unwrapped(values, period), 0.0, [note]
    return values, 0.0, []


def jumps_note(name: str, values: np.ndarray) -> list[str]:
    """A note of an angle (t,) that jumps again and again, always the same way: it may start anew."""
    own = values[np.isfinite(values)]
    if len(own) < 10:
        return []
    step = np.diff(own)
    span = float(np.ptp(own))
    jumps = step[np.abs(step) > 0.5 * span]
    if len(jumps) < 3 or len(jumps) > 0.2 * len(step) or abs(np.sign(jumps).sum()) != len(jumps):
        return []
    return [f"{name} jumps by some {np.median(np.abs(jumps)):.3g} rad {len(jumps)} times: if it starts anew after a "
            "period, write period = … (in the file's unit) in a channel file"]  # fmt: skip


# --- Values that are repeated until the next one comes.

LEAST_CHANGES = 20
ON_LATTICE = 0.95  # of the changes come a whole number of usual intervals after the one before
MOST_SKIPPED = 0.3  # of the intervals hold no change, as where two values happen to be equal
SMOOTH_INPUT = 0.5  # rms of an input's changes over its standard deviation; a real staircase changes more


def held_rows(values: np.ndarray, *, input_torque: bool) -> tuple[np.ndarray, int]:
    """Values (t,) with NaN in place of repeats, and how many rows there are to a value; 0 if none is held.

    A channel is held where it changes every k rows alone. A coarse resolution, of which most changes are one step, and
    an input that moves in real steps are left as they are.
    """
    if len(values) < 2 * LEAST_CHANGES or not np.isfinite(values).all():
        return values, 0
    step = np.diff(values)
    changes = np.flatnonzero(step) + 1
    if len(changes) < LEAST_CHANGES or len(changes) > 0.55 * len(values):
        return values, 0
    apart = np.diff(changes)
    every = int(np.bincount(apart).argmax())
    off = np.abs(apart - every * np.maximum(np.round(apart / every), 1))
    if every < 2 or np.mean(off <= (every >= 4)) < ON_LATTICE:
        return values, 0
    moving = apart[apart <= 3 * every]
    if len(moving) < (1 - MOST_SKIPPED) * len(apart) or np.mean(moving > 1.5 * every) > MOST_SKIPPED:
        return values, 0
    sizes = np.abs(step[changes - 1])
    if np.mean(sizes < 1.5 * sizes.min()) > 0.5:
        return values, 0
    held = values[changes]
    if input_torque and np.sqrt(np.mean(np.diff(held) ** 2)) > SMOOTH_INPUT * np.std(held):
        return values, 0
    kept = np.full(len(values), np.nan)
    at = np.unique(np.concatenate([[changes[0] % every] if changes[0] >= every else [], changes]).astype(int))
    for begin, end in pairwise(changes):  # values that happened to be equal
        if end - begin > 1.5 * every:
            at = np.append(at, np.arange(begin + every, end - every // 2, every))
    at = np.unique(at.astype(int))
    kept[at] = values[at]
    return kept, every


# --- A speed without its sign.

REBOUNDS = 3  # at least, from zero back to where the speed came from
NEAR_ZERO = 0.03  # of the largest speed
SHORT = 0.02  # of the samples, for one visit to zero


def magnitude_note(name: str, values: np.ndarray) -> list[str]:
    """A note of a speed (t,) that is never negative and again and again turns round at zero."""
    own = values[np.isfinite(values)]
    if len(own) < 100 or own.min() < 0:
        return []
    near = own < NEAR_ZERO * own.max()
    ends = np.flatnonzero(np.diff(np.concatenate([[False], near, [False]]).astype(int)))
    visits = [
        (begin, end) for begin, end in zip(ends[::2], ends[1::2], strict=True) if begin > 2 and end < len(own) - 2
    ]
    steep = 0.3 * float(np.quantile(np.abs(np.diff(own)), 0.95))
    short = [
        (begin, end)
        for begin, end in visits
        if end - begin <= max(3, SHORT * len(own))
        and own[begin - 3] > own[begin] + 1.5 * steep
        and own[end + 1] > own[end - 1] + steep
    ]
    if len(short) < REBOUNDS:
        return []
    return [f"{name} is never negative, and turns round at zero {len(short)} times: it may be a magnitude without sign"]
