"""Frequency responses from a recording, to be laid over those of a model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from matching.bed_test.local_rational import response, spectra
from modelling.common.errors import InputError
from modelling.measurement.recording import Recording
from modelling.model.system import System

POINTS = 60  # of a measured response, spaced logarithmically
PERIODS = 6.0  # of the lowest frequency within the recording
SAMPLES_A_PERIOD = 6.0  # of the highest frequency
MOVES = 1e-9  # of a torque's largest value: what changes less does not excite


@dataclass(frozen=True)
class MeasuredCurves:
    """Responses (f, y, u) at frequencies (f,), Hz, NaN where undetermined, with standard uncertainty of the modulus."""

    frequencies: np.ndarray
    inputs: tuple[str, ...]
    sensors: tuple[str, ...]
    values: np.ndarray
    uncertainties: np.ndarray


def measured_curves(recording: Recording, system: System) -> MeasuredCurves:
    """Responses of a recording's sensors to those of its inputs that change.

    Raises
    ------
    InputError
        If no input changes, no sensor was recorded, or the recording is too short.
    """
    inputs = [part.name for part in system.inputs if np.ptp(recording[part.name]) > MOVES * _size(recording, part.name)]
    sensors = [part.name for part in system.sensors if part.name in recording.channels]
    if not inputs or not sensors:
        what = "no input changes" if not inputs else "no sensor of the model was recorded"
        raise InputError(recording.source, what, "record one that the model can answer")
    time = recording.time
    even = np.linspace(time[0], time[-1], len(time))
    signals = {name: np.interp(even, time, recording[name]) for name in (*inputs, *sensors)}
    step, lasts = float(even[1] - even[0]), float(even[-1] - even[0])
    low, high = PERIODS / lasts, 1 / (SAMPLES_A_PERIOD * step)
    try:
        spectrum = spectra(
            np.stack([signals[name] for name in inputs], axis=1),
            np.stack([signals[name] for name in sensors], axis=1),
            step,
            high,
        )
        responses = response([spectrum], np.geomspace(low, high, POINTS))
    except ValueError as error:
        raise InputError(recording.source, f"is too short: {error}", "record longer") from None
    spread = np.sqrt(responses.variances / 2)
    return MeasuredCurves(responses.frequencies, tuple(inputs), tuple(sensors), responses.values, spread)


def _size(recording: Recording, name: str) -> float:
    return max(float(np.abs(recording[name]).max()), 1e-300)
