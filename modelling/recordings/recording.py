"""A recording: channels in SI on one time base, with notes of what was corrected."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from modelling.errors import InputError
from modelling.recordings.channel_faults import fault
from modelling.system import System

# --- Gaps of a recording, and the one rule for them.
#
# A gap is a time without a value, whether rows are missing in the file or cells are empty, NaN or marked invalid.
#
# - In an input, a gap of up to ``longest_bridge`` (0.1 s, or two sampling steps if that is more) is bridged by a
#   straight line, and noted.
# - A longer gap in an input divides the recording: the rows without the input are left out, and noted. A diagnosis
#   takes the parts as separate recordings; a simulation and a fidelity refuse the recording.
# - A channel that is sampled slower than the others has no gap between its own samples.
# - In a sensor, values that are missing are left out of every comparison; nothing is bridged.

LONGEST_BRIDGE = 0.1  # s: a torque of drivability, below 30 Hz and sampled at 1 kHz, hardly changes its course in it
LONGEST_BRIDGE_STEPS = 2.0  # sampling steps, for slow recordings: one missing sample
REGULAR = 0.9  # of a slower channel's values that come as many rows after the one before
GAP_STEPS = 1.6  # sampling steps: a longer step of time is a gap


def longest_bridge(time: np.ndarray) -> float:
    """The longest gap in s between two values of a channel that a straight line bridges; time (t,) in s."""
    return max(LONGEST_BRIDGE, LONGEST_BRIDGE_STEPS * float(np.median(np.diff(time))) * (1 + 1e-6))


def long_gaps(time: np.ndarray) -> list[tuple[float, float]]:
    """Begin and end in s of the gaps in time (t,) that are too long to bridge."""
    index = np.flatnonzero(np.diff(time) > longest_bridge(time))
    return [(float(time[i]), float(time[i + 1])) for i in index]


def own_interval(time: np.ndarray, values: np.ndarray) -> float:
    """The time in s between two values (t,) of a channel that is sampled slower than the rows; 0 where it is not."""
    apart = np.diff(time[np.isfinite(values)])
    usual = float(np.median(apart)) if len(apart) > 1 else 0.0
    slower = usual > GAP_STEPS * float(np.median(np.diff(time)))
    return usual if slower and np.mean(apart <= GAP_STEPS * usual) >= REGULAR else 0.0


def bridge_of(time: np.ndarray, values: np.ndarray) -> float:
    """The longest gap in s between two values (t,) of this channel that a straight line bridges.

    A slower channel misses nothing between its own samples.
    """
    return max(longest_bridge(time), GAP_STEPS * own_interval(time, values))


def bridged(time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Values (t,), not all NaN, at times (t,) in s with short gaps filled by straight lines.

    NaN stays in long gaps, before the first and after the last value.
    """
    known = np.flatnonzero(np.isfinite(values))
    filled = np.interp(time, time[known], values[known], left=np.nan, right=np.nan)
    longest = bridge_of(time, values)
    for first, last in pairwise(known):
        if last > first + 1 and time[last] - time[first] > longest:
            filled[first + 1 : last] = np.nan
    return filled


def missing_note(name: str, time: np.ndarray, values: np.ndarray, treatment: str) -> str:
    """A note that values (t,) of a channel are missing, at what time (s) first, and what was done."""
    missing = ~np.isfinite(values)
    count = int(missing.sum())
    size = f"{count} value{'s' * (count > 1)}"
    return f"{fault('dropouts', name, f'at {time[np.argmax(missing)]:g} s', size=size).sentence}; {treatment}"


def rows_a_value(values: np.ndarray) -> int:
    """How many rows there are to a value (t,) of a channel that is sampled slower than the rows; 0 where it is not.

    It is where nearly every value (``REGULAR``) comes as many rows after the one before, give or take one.
    """
    apart = np.diff(np.flatnonzero(np.isfinite(values)))
    every = int(np.median(apart)) if len(apart) else 0
    return every if every > 1 and np.mean(np.abs(apart - every) <= 1) >= REGULAR else 0


# --- Recording


@dataclass(frozen=True)
class Recording:
    """What was measured.

    Attributes
    ----------
    time : ndarray (t,)
        s, rising.
    channels : dict of str to ndarray (t,)
        SI. Inputs of a model are complete; a sensor is NaN where a value is missing.
    notes : tuple of str
        What was corrected, or is unusual.
    source : str
        The file.
    units : mapping of str to str
        The unit that the file states for a channel; empty or absent where it states none.
    clock_groups : tuple of tuple of str
        Sensors of each further logger, whose clock was set to that of the first.
    clock_limits : tuple of float
        How far (s) each of these clocks may still be off.
    """

    time: np.ndarray
    channels: dict[str, np.ndarray] = field(repr=False)
    notes: tuple[str, ...] = ()
    source: str = ""
    units: Mapping[str, str] = field(default_factory=dict, repr=False)
    clock_groups: tuple[tuple[str, ...], ...] = ()
    clock_limits: tuple[float, ...] = ()

    def __getitem__(self, name: str) -> np.ndarray:
        """A channel, (t,)."""
        return self.channels[name]

    def inputs(self, system: System) -> np.ndarray:
        """Inputs (t, u) in the order of the system, N·m.

        Raises
        ------
        InputError
            If one was not recorded: what a clutch can carry, where the number of the gear was.
        """
        for part in system.inputs:
            if part.name not in self.channels:
                right = "record it; the number of the gear does not tell what a clutch carries"
                raise InputError(self.source, f"input {part.name!r} was not recorded", right)
        columns = [self.channels[part.name] for part in system.inputs]
        return np.stack(columns, axis=1) if columns else np.empty((len(self.time), 0))

    def sensors(self, system: System) -> list[str]:
        """Names of the system's sensors that were recorded."""
        return [part.name for part in system.sensors if part.name in self.channels]

    def check_continuous(self) -> None:
        """For calculations that need all inputs at all times; see :mod:`modelling.recordings.recording`.

        Raises
        ------
        InputError
            If the recording has a gap that is too long to bridge.
        """
        gaps = long_gaps(self.time)
        if gaps:
            begin, end = gaps[0]
            more = f" and {len(gaps) - 1} more" if len(gaps) > 1 else ""
            raise InputError(
                self.source,
                f"has a gap from {begin:g} to {end:g} s{more}",
                "cut the recording there: inputs are not bridged over so long a time",
            )

    def cut(self, begin: float, end: float) -> Recording:
        """The rows with begin ≤ time < end (s); time stamps stay.

        Raises
        ------
        InputError
            If fewer than two are left.
        """
        inside = (self.time >= begin) & (self.time < end)
        if inside.sum() < 2:
            raise InputError(
                self.source, f"has fewer than two rows from {begin:g} to {end:g} s", "choose a longer time window"
            )
        return replace(
            self, time=self.time[inside], channels={name: values[inside] for name, values in self.channels.items()}
        )

    def resampled(self, rate: float | None = None) -> Recording:
        """On a regular grid of ``rate`` (Hz; by default that of the median step), linear between samples.

        Nothing is filtered: at a lower rate than recorded, frequencies above half of it alias. A value next to a
        missing one is missing.
        """
        median_step = float(np.median(np.diff(self.time)))
        step = 1 / rate if rate else median_step
        time = self.time[0] + np.arange(int((self.time[-1] - self.time[0]) / step * (1 + 1e-12)) + 1) * step
        even = np.linspace(self.time[0], self.time[-1], len(self.time))  # steps add up to more than rounding
        if abs(step / median_step - 1) < 1e-9 and np.allclose(even, self.time, rtol=0, atol=1e-6 * step):
            return self
        notes = [f"resampled to {1 / step:g} Hz, linear between samples"]
        if step > 1.01 * median_step:
            notes.append(f"resampled to a lower rate without a filter: frequencies above {0.5 / step:g} Hz alias")
        channels = {name: np.interp(time, self.time, values) for name, values in self.channels.items()}
        return replace(self, time=time, channels=channels, notes=(*self.notes, *notes))
