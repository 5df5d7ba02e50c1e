"""From recordings to the data of a fit: segments, noise, and channels that do not measure what they should."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from matching.diagnosis.data.segments import Data, Segment
from modelling.common.errors import InputError
from modelling.measurement.recording import Recording
from modelling.model.system import System

STUCK = 0.05  # s that a sensor may show the same value
LONG_GAP = 0.1  # s without samples, over which inputs are not taken as linear
SHORTEST = 64  # samples of a segment


def prepare_data(system: System, recordings: Sequence[Recording]) -> tuple[Data, list[str]]:
    """Segments of several recordings of one system, and notes of what was left out.

    Raises
    ------
    InputError
        If no sensor of the model was recorded, or too little is left.
    """
    notes: list[str] = []
    segments: list[Segment] = []
    for recording in recordings:
        if not recording.sensors(system):
            names = ", ".join(part.name for part in system.sensors) or "none"
            raise InputError(recording.source, "has no sensor of the model", f"the model has {names}")
        readings = np.full((len(recording.time), len(system.sensors)), np.nan)
        for j, sensor in enumerate(system.sensors):
            if sensor.name in recording.channels:
                own = recording[sensor.name].copy()
                notes += _stuck(own, recording.time, sensor.name)
                readings[:, j] = own
        inputs = np.ascontiguousarray(recording.inputs(system))
        cuts = [0, *(np.flatnonzero(np.diff(recording.time) > LONG_GAP) + 1), len(recording.time)]
        for first, last in pairwise(cuts):
            if last - first < SHORTEST:
                if len(cuts) > 2:
                    notes.append(f"{last - first} samples between gaps at {recording.time[first]:g} s are left out")
                    continue
                raise InputError(recording.source, f"has {last - first} samples", f"at least {SHORTEST} are needed")
            cut = slice(first, last)
            segments.append(Segment(recording.time[cut], inputs[cut], readings[cut], recording.source))
    if not segments:
        raise InputError(recordings[0].source, "has no stretch without gaps that is long enough", f"{SHORTEST} samples")
    noise = []
    for j, sensor in enumerate(system.sensors):
        stated = sensor.uncertainty
        if not stated:
            stated = _scatter([segment.readings[:, j] for segment in segments])
            notes.append(f"{sensor.name} states no uncertainty: {stated:.3g} {sensor.unit} is read off its scatter")
        noise.append(stated)
    data = Data(tuple(segments), np.array(noise))
    if not data.samples.any():
        raise InputError(recordings[0].source, "has no usable reading", "see the notes on its channels")
    return data, list(dict.fromkeys(notes))


def _stuck(own: np.ndarray, time: np.ndarray, name: str) -> list[str]:
    """Take out, in place, stretches over which a channel keeps one value: it is stuck or at the end of its range."""
    same = np.concatenate([[False], (np.diff(own) == 0), [False]])
    edges = np.flatnonzero(np.diff(same.astype(int)))
    notes: list[str] = []
    share = float(np.mean(np.diff(own[np.isfinite(own)]) == 0)) if np.isfinite(own).sum() > 1 else 0.0
    if share > 0.5:  # coarse steps, or slow motion read finely: not stuck
        return notes
    low, high = np.nanmin(own), np.nanmax(own)
    for first, last in zip(edges[::2], edges[1::2], strict=True):
        if last - first >= 8 and time[last] - time[first] >= min(STUCK, 0.1 * float(np.ptp(time))):
            where = "at the end of its range" if own[first] in (low, high) else "stuck"
            notes.append(f"{name} is {where} from {time[first]:g} to {time[last]:g} s; left out")
            own[first : last + 1] = np.nan
    return notes


def _scatter(parts: Sequence[np.ndarray]) -> float:
    """Standard deviation of white noise on a smooth signal, from its second differences (median, so that jumps do not
    count)."""
    second = np.concatenate([np.diff(part, 2) for part in parts])
    second = second[np.isfinite(second)]
    found = float(np.median(np.abs(second))) / 0.6745 / np.sqrt(6) if len(second) else 0.0
    whole = np.concatenate(parts)
    return max(found, 1e-6 * float(np.nanmax(np.abs(whole), initial=0.0)), 1e-12)


def split(data: Data, share: float = 0.7) -> tuple[Data, list[int]]:
    """The first part of every recording to fit, and how many samples of each segment of it the fit sees."""
    kept, counts = [], []
    names = list(dict.fromkeys(segment.name for segment in data.segments))
    for name in names:
        own = [segment for segment in data.segments if segment.name == name]
        left = round(share * sum(len(segment.time) for segment in own))
        for segment in own:
            take = len(segment.time) if left >= len(segment.time) else left
            take = take if take >= SHORTEST else 0
            counts.append(take)
            if take:
                kept.append(segment.part(0, take))
            left -= take if take else left
    return Data(tuple(kept), data.noise), counts
