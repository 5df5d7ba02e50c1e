"""From recordings to the data of a fit: segments without gaps, noise, and channels that do not measure."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from matching.diagnosis.data.segmentation import FEWEST_SAMPLES, segments_between_gaps
from matching.diagnosis.data.segments import FitData, Segment
from matching.diagnosis.data.sensor_noise import noise_from_scatter
from matching.diagnosis.data.stuck_channels import remove_stuck_values
from modelling.common.errors import InputError
from modelling.measurement.recording import Recording
from modelling.model.system import System


def prepare_data(system: System, recordings: Sequence[Recording]) -> tuple[FitData, list[str]]:
    """Segments of several recordings of one system, and notes on what was left out.

    Raises
    ------
    InputError
        If no sensor of the model was recorded, or too little is left.
    """
    segments: list[Segment] = []
    notes: list[str] = []
    for number, recording in enumerate(recordings, 1):
        more, remarks = _segments(system, recording, number)
        segments += more
        notes += remarks
    if not segments:
        raise InputError(
            recordings[0].source, "has no part without gaps that is long enough", f"{FEWEST_SAMPLES} samples"
        )
    noise, remarks = _noise(system, segments)
    data = FitData(tuple(segments), noise)
    if not data.readings_count:
        raise InputError(recordings[0].source, "has no usable reading", "see the notes on its channels")
    return data, list(dict.fromkeys(notes + remarks))


def _segments(system: System, recording: Recording, number: int) -> tuple[list[Segment], list[str]]:
    """Segments of one recording, and notes."""
    if not recording.sensors(system):
        names = ", ".join(part.name for part in system.sensors) or "none"
        raise InputError(recording.source, "has no sensor of the model", f"the model has {names}")
    notes: list[str] = []
    readings = np.full((len(recording.time), len(system.sensors)), np.nan)
    for j, sensor in enumerate(system.sensors):
        if sensor.name in recording.channels:
            readings[:, j], remarks = remove_stuck_values(recording[sensor.name], recording.time, sensor.name)
            notes += remarks
    inputs = np.ascontiguousarray(recording.inputs(system))
    parts, remarks = segments_between_gaps(recording.time, recording.source)
    segments = [Segment(recording.time[p], inputs[p], readings[p], recording.source, number) for p in parts]
    return segments, notes + remarks


def _noise(system: System, segments: Sequence[Segment]) -> tuple[np.ndarray, list[str]]:
    """Standard uncertainty (y,) of the sensors, as stated or estimated, and notes on the latter."""
    noise, notes = [], []
    for j, sensor in enumerate(system.sensors):
        uncertainty = sensor.uncertainty
        if not uncertainty:
            uncertainty = noise_from_scatter([segment.readings[:, j] for segment in segments])
            scatter = f"{uncertainty:.3g} {sensor.unit}"
            notes.append(f"{sensor.name} states no uncertainty: {scatter} is estimated from its scatter")
        noise.append(uncertainty)
    return np.array(noise), notes
