"""First guesses of a time by which a signal is late: short ones, from which a fit finds its way, and long ones.

A signal that comes longer than a quarter of a period late differs from one in time by no more than one that comes
later still. A fit then ends in the next local minimum, so the screening looks at long delays one by one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from modelling.effects.first_guess import FittedMotion, Guess, if_positive
from modelling.effects.place import members
from modelling.effects.recorded_range import LONGEST_MEMORY_SHARE

SHORT_DELAYS = (1e-3, 4e-3, 1.6e-2, 6.4e-2)  # s
LONG_DELAYS = (0.25, 0.7, 2.0)  # s, as far as the recording can show them
SHORTEST_REFINED = 0.1  # s, of delays near which further ones are looked at
REFINED = np.geomspace(0.4, 2.5, 61)  # times the best delay, each 3 % longer than the one before

Change = Callable[[float], dict[str, np.ndarray | float]]  # delay in s → what it adds, by place


def late(motion: FittedMotion, at: str) -> Change:
    """What a delay adds to the signals of the inputs and sensors at a place."""
    signals = {place: motion.signal(place) for place in members(at)}
    return lambda delay: {place: motion.delayed(signal, delay) - signal for place, signal in signals.items()}


def first_delays(motion: FittedMotion, change: Change, key: str) -> Iterator[Guess]:
    """Delays of all magnitudes that the recording can show."""
    for delay in SHORT_DELAYS:
        yield Guess((change(delay),), if_positive(key, delay))
    yield from fixed_delays(motion, change, key, LONG_DELAYS)


def fixed_delays(
    motion: FittedMotion, change: Change, key: str, delays: Sequence[float], sign: float = 1.0
) -> Iterator[Guess]:
    """Long delays whose amplitude says nothing about their time: ``key`` is ``sign`` times the delay itself."""
    longest = LONGEST_MEMORY_SHARE * max(float(np.ptp(motion.time[part])) for part in motion.segments)
    for delay in delays:
        if delay < longest:
            yield Guess((change(delay),), _fixed(key, sign * delay))


def delays_near(motion: FittedMotion, change: Change, key: str, best: float, sign: float = 1.0) -> Iterator[Guess]:
    """Delays near the best one, if it is so long that a fit would not move from one to the next."""
    if abs(best) > SHORTEST_REFINED:
        yield from fixed_delays(motion, change, key, [float(d) for d in abs(best) * REFINED], sign)


def _fixed(key: str, value: float) -> Callable[[np.ndarray], dict[str, float] | None]:
    return lambda a: {key: value} if a[0] > 0 else None
