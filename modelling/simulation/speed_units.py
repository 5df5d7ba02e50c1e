"""Speeds without a unit that fit the model in 1/min and not in rad/s."""

from __future__ import annotations

from dataclasses import replace
from math import pi

import numpy as np

from modelling.common.errors import InputError
from modelling.equations.compiled import Model, compiled
from modelling.measurement.gaps import long_gaps
from modelling.measurement.recording import Recording
from modelling.model.system import System
from modelling.simulation.recorded_start import recorded_start
from modelling.simulation.result import SimulationError
from modelling.simulation.simulate import simulate, with_stick_speed

PER_MINUTE = 2 * pi / 60  # rad/s
FITS, FAR_OFF = 0.25, 0.5  # misfit over the standard deviation: of a model about right; where the unit may be wrong
CLEARLY = 3.0  # times better in 1/min
TOLERANCE = 1e-2  # of the simulations here


def check_speed_units(model: System | Model, recording: Recording) -> None:
    """Check that the speeds for which the file states no unit can be in rad/s.

    The model is simulated on the recorded inputs of the longest part without a long gap, begun as recorded: once with
    the speeds as they stand, and if they are far off, once more with them as 1/min.

    Raises
    ------
    InputError
        If they fit the model in 1/min only; says what to write.
    """
    names = [
        sensor.name
        for sensor in (model if isinstance(model, System) else model.system).sensors
        if sensor.measures == "speed" and recording.units.get(sensor.name) == "" and sensor.name in recording.channels
    ]
    if not names:
        return
    model = compiled(model) if isinstance(model, System) else model
    recording = _longest_part(recording)
    as_read = min(_misfits(model, recording, names))
    if as_read <= FAR_OFF:
        return
    scaled = {name: values * (PER_MINUTE if name in names else 1.0) for name, values in recording.channels.items()}
    if max(_misfits(model, replace(recording, channels=scaled), names)) < min(FITS, as_read / CLEARLY):
        raise InputError(
            f"{recording.source}: {', '.join(names)}",
            "no unit is stated, and the values fit the model in 1/min only, not in rad/s",
            f'state the unit, for example {names[0]} = {{ channel = "{names[0]}", unit = "1/min" }} in a channel file',
        )


def _longest_part(recording: Recording) -> Recording:
    """The longest part between gaps too long to bridge: over a gap, which may last for years, inputs are unknown."""
    gaps = long_gaps(recording.time)
    if not gaps:
        return recording
    begins = [float(recording.time[0]), *(end for _, end in gaps)]
    ends = [*(begin for begin, _ in gaps), float(recording.time[-1])]
    begin, end = max(zip(begins, ends, strict=True), key=lambda part: part[1] - part[0])
    return recording.cut(begin, np.nextafter(end, np.inf)) if end > begin else recording


def _misfits(model: Model, recording: Recording, names: list[str]) -> list[float]:
    """Root mean squares of simulated minus recorded speeds over the standard deviations; infinite if nothing moves."""
    inputs = recording.inputs(model.system)
    try:
        p = with_stick_speed(model, recording.time, inputs, model.p0)
        start = recorded_start(model, recording, p)
        done = simulate(model, recording.time, inputs, start=start, sensors=names, tolerance=TOLERANCE)
    except SimulationError:
        return [np.inf] * len(names)
    misfits = []
    for name in names:
        there = np.isfinite(recording[name])
        spread = float(np.std(recording[name][there])) if there.any() else 0.0
        error = float(np.sqrt(np.mean((done[name] - recording[name])[there] ** 2))) if there.any() else 0.0
        misfits.append(error / spread if spread else np.inf)
    return misfits
