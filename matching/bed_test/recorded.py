"""Recordings of the controlled bed: which torques excite it, what its sensors answer, at one sample time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from matching.frequency.case.case import Case
from modelling.common.errors import InputError, listed
from modelling.measurement.channels import Channel
from modelling.measurement.read import read_signals
from modelling.measurement.recording import Recording

MOVES = 1e-9  # of a torque's largest value: what changes less is constant
SAMPLES_A_PERIOD = 8.0  # of the highest frequency of the band that a recording needs
PERIODS = 4.0  # of the lowest frequency of the band that a recording has to last


@dataclass(frozen=True)
class BedRecordings:
    """Evenly sampled recordings of a case's compared functions.

    Attributes
    ----------
    recordings : tuple of Recording
    inputs : tuple of str (u)
        Compared torques that excite the bed in at least one recording.
    sensors : tuple of str (y)
        Compared sensors that every recording has.
    notes : tuple of str
    """

    recordings: tuple[Recording, ...]
    inputs: tuple[str, ...]
    sensors: tuple[str, ...]
    notes: tuple[str, ...]

    def signals(self, recording: Recording) -> tuple[np.ndarray, np.ndarray]:
        """Torques (t, u) and readings (t, y) of one recording."""
        rest = np.zeros(len(recording.time))
        torques = np.stack([recording.channels.get(name, rest) for name in self.inputs], axis=1)
        return torques, np.stack([recording[name] for name in self.sensors], axis=1)


def read_recordings(
    paths: Sequence[str | Path],
    case: Case,
    channels: Mapping[str, Channel] | None = None,
    sources: Sequence[str | Path] | None = None,
) -> BedRecordings:
    """Read recordings of the controlled bed with the names of the case's compared functions.

    A compared torque that a recording lacks is taken as constant there. ``sources`` say what the recordings are called
    where the paths are copies.

    Raises
    ------
    InputError
        A file that cannot be read; no compared torque changes; a compared sensor is in none; recordings too short or
        sampled too slowly for the band.
    """
    torques = list(dict.fromkeys(pair.input for pair in case.compared))
    wanted = list(dict.fromkeys(pair.sensor for pair in case.compared))
    drives = [part.name for part in case.rig.inputs]
    names = {*torques, *wanted, *drives}
    read = [
        replace(read_signals(Path(path), names, channels).resampled(), source=str(source))
        for path, source in zip(paths, sources or paths, strict=True)
    ]
    notes = [f"{recording.source}: {note}" for recording in read for note in recording.notes]
    for recording in read:
        _check_length(recording, case.band)
    sensors = tuple(name for name in wanted if all(name in recording.channels for recording in read))
    if not sensors:
        raise InputError(
            read[0].source,
            f"has none of the compared sensors {listed(wanted)}",
            "record them, or name them in a channel file",
        )
    notes += [f"{name} is not in every recording and not judged" for name in wanted if name not in sensors]
    inputs = tuple(name for name in torques if any(_moves(recording, name) for recording in read))
    if not inputs:
        raise InputError(
            read[0].source,
            f"holds no change of {listed(torques)}",
            "excite the bed with one of these torques and record it",
        )
    notes += [
        f"{name} does not change in any recording: its functions are not judged"
        for name in torques
        if name not in inputs
    ]
    return BedRecordings(tuple(read), inputs, sensors, tuple(notes))


def _moves(recording: Recording, name: str) -> bool:
    if name not in recording.channels:
        return False
    torque = recording[name]
    return bool(np.ptp(torque) > MOVES * max(np.abs(torque).max(), 1e-300))


def _check_length(recording: Recording, band: tuple[float, float]) -> None:
    step, lasts = float(np.median(np.diff(recording.time))), float(np.ptp(recording.time))
    if 1 / step < SAMPLES_A_PERIOD * band[1]:
        raise InputError(
            recording.source,
            f"is sampled at {1 / step:g} Hz",
            f"{SAMPLES_A_PERIOD * band[1]:g} Hz or more is needed for a band up to {band[1]:g} Hz",
        )
    if lasts < PERIODS / band[0]:
        raise InputError(
            recording.source,
            f"lasts {lasts:g} s",
            f"{PERIODS / band[0]:g} s or more is needed for a band from {band[0]:g} Hz",
        )
