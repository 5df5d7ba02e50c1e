"""What a recording has shown: the range in which an effect found in it must lie."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

LONGEST_MEMORY_SHARE = 0.25  # of the recording: a longer delay or lag cannot be told from a start state
FEWEST_PERIODS = 1.0  # within the range of an angle: a torque over it has been recorded once as a whole
FEWEST_PASSES = 2.0  # periods over the whole path: it has been recorded to repeat


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
        By inertia: over how many turns it moves, the path of all segments together.
    range_of_turns : dict of str to float
        By inertia: largest minus smallest angle of the segment that covers most, in turns.
    input_torque : float
        Largest torque of all inputs together, N·m.
    """

    duration: float
    torque: Mapping[str, float]
    largest_reading: Mapping[str, float]
    width: Mapping[str, float]
    turns: Mapping[str, float]
    range_of_turns: Mapping[str, float]
    input_torque: float

    def lowest_order(self, inertia: str) -> float:
        """Lowest order per turn of a torque that the recording shows to repeat over the angle of an inertia."""
        once = FEWEST_PERIODS / max(self.range_of_turns[inertia], 1e-9)
        return max(once, FEWEST_PASSES / max(self.turns[inertia], 1e-9))

    @property
    def longest_memory(self) -> float:
        """Longest delay or time constant that shows in the recording, s."""
        return LONGEST_MEMORY_SHARE * self.duration
