"""What a recording has shown: the range in which an effect found in it must lie."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

LONGEST_MEMORY_SHARE = 0.25  # of the recording: a longer delay or lag cannot be told from a start state
FEWEST_PERIODS = 1.0  # over the angle that an inertia turns: a torque that repeats has been seen once as a whole


@dataclass(frozen=True)
class RecordedRange:
    """Ranges of a recording.

    Attributes
    ----------
    duration : float
        Longest time without a gap, s.
    torque : dict of str to float
        By inertia, N·m: no effect on it can be larger.
    largest_reading, width : dict of str to float
        By sensor, SI: largest magnitude, and largest minus smallest reading.
    turns : dict of str to float
        By inertia: over how many turns it moves, its segments together.
    """

    duration: float
    torque: Mapping[str, float]
    largest_reading: Mapping[str, float]
    width: Mapping[str, float]
    turns: Mapping[str, float]

    @property
    def longest_memory(self) -> float:
        """Longest delay or time constant that shows in the recording, s."""
        return LONGEST_MEMORY_SHARE * self.duration
