"""Checks of the signals that a fidelity is calculated from."""

from __future__ import annotations

import numpy as np

from modelling.common.errors import InputError

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
