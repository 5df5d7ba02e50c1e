"""A recording: channels in SI on one time base, with notes of what was corrected."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from modelling.common.errors import InputError
from modelling.measurement.gaps import long_gaps
from modelling.model.system import System


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
    """

    time: np.ndarray
    channels: dict[str, np.ndarray] = field(repr=False)
    notes: tuple[str, ...] = ()
    source: str = ""
    units: Mapping[str, str] = field(default_factory=dict, repr=False)
    clock_groups: tuple[tuple[str, ...], ...] = ()

    def __getitem__(self, name: str) -> np.ndarray:
        """A channel, (t,)."""
        return self.channels[name]

    def inputs(self, system: System) -> np.ndarray:
        """Inputs (t, u) in the order of the system, N·m."""
        columns = [self.channels[part.name] for part in system.inputs]
        return np.stack(columns, axis=1) if columns else np.empty((len(self.time), 0))

    def sensors(self, system: System) -> list[str]:
        """Names of the system's sensors that were recorded."""
        return [part.name for part in system.sensors if part.name in self.channels]

    def check_continuous(self) -> None:
        """For calculations that need all inputs at all times; see :mod:`modelling.measurement.gaps`.

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
        if len(time) == len(self.time) and np.allclose(time, self.time, rtol=0, atol=1e-9 * step):
            return self
        notes = [f"resampled to {1 / step:g} Hz, linear between samples"]
        if step > 1.01 * median_step:
            notes.append(f"resampled to a lower rate without a filter: frequencies above {0.5 / step:g} Hz alias")
        channels = {name: np.interp(time, self.time, values) for name, values in self.channels.items()}
        return replace(self, time=time, channels=channels, notes=(*self.notes, *notes))
