"""The two recordings of a fidelity case, reference and test, of the same manoeuvre."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from modelling.common.errors import InputError
from modelling.common.tables import check_keys, no_pipe, text
from modelling.fidelity.checks import STEP_DEVIATION, check_time
from modelling.measurement.channels import Channel, read_channels
from modelling.measurement.gaps import GAP_STEPS
from modelling.measurement.read import read_signals
from modelling.measurement.recording import Recording
from modelling.units import Unit, signal_unit

KEYS = ("reference", "test", "reference_channels", "test_channels")
STEP_DIFFERENCE = 1e-4  # of the step: between reference and test; over 10 000 samples it adds up to one
NO_UNIT = Unit("SI", 1.0, 0.0, None)  # of a column without unit: SI, of whatever dimension


@dataclass(frozen=True)
class MeasuredPair:
    """A signal (t,) of reference and test in SI, and the reference's unit."""

    reference: np.ndarray
    test: np.ndarray
    unit: Unit


@dataclass(frozen=True)
class RecordingPair:
    """Reference and test at the same step (s); both begin at the same event of the manoeuvre."""

    reference: Recording
    test: Recording
    step: float

    @property
    def notes(self) -> tuple[str, ...]:
        """What was corrected in both, with the file's name."""
        return tuple(
            f"{Path(recording.source).name}: {note}"
            for recording in (self.reference, self.test)
            for note in recording.notes
        )

    def signal(self, reference: str, test: str, where: str) -> MeasuredPair:
        """The signals of two columns.

        Raises
        ------
        InputError
            If a column does not exist, or they have different dimensions.
        """
        units = []
        for name, recording in ((reference, self.reference), (test, self.test)):
            if name not in recording.channels:
                raise InputError(
                    where,
                    f"{recording.source} has no column '{name}'",
                    f"choose {', '.join(recording.channels) or 'another file'}",
                )
            unit = recording.units[name]
            units.append(signal_unit(unit, f"{recording.source}: column {name!r}") if unit else NO_UNIT)
        dimensions = [unit.dimension for unit in units]
        if None not in dimensions and dimensions[0] != dimensions[1]:
            raise InputError(
                where, f"reference is in {units[0].text}, test in {units[1].text}", "give both the same dimension"
            )
        return MeasuredPair(self.reference[reference], self.test[test], units[0])


def read_recordings(
    table: Any, path: Path, names: Collection[str], channels: Mapping[str, Channel] | None = None
) -> RecordingPair:
    """The two recordings that a case names, relative to the case file.

    Parameters
    ----------
    table : table ``[recordings]`` of the case
    path : Path
        The case file.
    names : collection of str
        Columns that the case compares.
    channels : mapping of str to Channel, optional
        What channels are called in both files; channel files that the case names for either are preferred.

    Raises
    ------
    InputError
        Where a recording cannot be read, or the two do not fit together.
    """
    where = f"{path}: recordings"
    check_keys(table, KEYS, where)
    recordings = []
    for role in ("reference", "test"):
        key = f"{role}_channels"
        mapping = read_channels(no_pipe(path.parent / text(table, key, where), where)) if key in table else channels
        file = no_pipe(path.parent / text(table, role, where), where)
        recordings.append(evenly_spaced(read_signals(file, names, mapping)))
    reference, test = recordings
    steps = [check_time(recording.time, f"{recording.source}: time") for recording in recordings]
    if len(reference.time) != len(test.time):
        raise InputError(
            where,
            f"reference has {len(reference.time)} samples, test {len(test.time)}",
            "cut or resample both to the same length",
        )
    if abs(steps[0] - steps[1]) > STEP_DIFFERENCE * steps[0]:
        raise InputError(where, f"reference has a step of {steps[0]:g} s, test of {steps[1]:g} s", "resample one")
    return RecordingPair(reference, test, steps[0])


def evenly_spaced(recording: Recording) -> Recording:
    """A recording whose time stamps jitter, on as many equal steps through them (least squares); others as they are."""
    time = recording.time
    steps = np.diff(time)
    step = (time[-1] - time[0]) / (len(time) - 1)
    jitter, gap = np.abs(steps - step).max(), steps.max() >= GAP_STEPS * np.median(steps)
    if jitter <= STEP_DEVIATION * step or gap:
        return recording
    number = np.arange(len(time))
    even = np.polyval(np.polyfit(number, time, 1), number)
    channels = {name: np.interp(even, time, values) for name, values in recording.channels.items()}
    note = "time stamps are uneven: brought to equal steps, linear between samples"
    return replace(recording, time=even, channels=channels, notes=(*recording.notes, note))
