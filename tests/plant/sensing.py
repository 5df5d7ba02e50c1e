"""From the motion of the chain to what sensors read: the truth, faults hidden in sensors, then noise."""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter

from plant.engine import Motion
from plant.hidden import Hidden
from plant.systems import Drive

FINE = ("sensor_delay", "sensor_lag", "clock_jump", "clock_offset")  # faults that need the motion between samples


def rows_needed(effects: list[Hidden]) -> int:
    return 10 if any(e.kind in FINE for e in effects) else 1


def truth(drive: Drive, motion: Motion) -> dict[str, np.ndarray]:
    """Sensor name -> (t,) true value in SI."""
    found = {}
    for name, (what, of) in drive.sensors.items():
        if what == "torque":
            found[name] = motion.torque[:, list(drive.shafts).index(of)]
        else:
            found[name] = getattr(motion, what)[:, drive.inertias.index(of)]
    return found


def read(drive: Drive, motion: Motion, effects: list[Hidden], rows: int, begin: int) -> dict[str, np.ndarray]:
    """Sensor name -> (t,) noise-free reading at the recording's samples, the first of them sample `begin`."""
    signals = truth(drive, motion)
    fine = motion.time
    time = fine[begin * rows :: rows] - fine[begin * rows]
    readings = {}
    for name, value in signals.items():
        shift = np.zeros_like(time)
        for e in effects:
            if e.kind == "sensor_lag" and e.name == name:
                value = _lagged(value, fine[1] - fine[0], e.parameters["time_constant"])
            elif e.kind == "sensor_delay" and e.name == name:
                shift += e.parameters["delay"]
            elif e.kind == "clock_offset" and name in e.members:
                shift += e.parameters["offset"]
            elif e.kind == "clock_jump":
                shift += np.where(time >= e.parameters["time"], e.parameters["jump"], 0.0)
        late = np.any(shift)
        readings[name] = (
            np.interp(time + fine[begin * rows] - shift, fine, value) if late else value[begin * rows :: rows]
        )
    for e in effects:
        if e.at.startswith("sensors.") and e.kind != "clock_jump":
            readings[e.name] = _faulty(readings, e, time)
    return readings


def stamped_inputs(drive: Drive, inputs: np.ndarray, effects: list[Hidden], dt: float) -> np.ndarray:
    """Inputs (t, u) as loggers record them: one whose clock is late shows what was that long ago."""
    stamped, time = inputs.copy(), np.arange(len(inputs)) * dt
    for e in effects:
        for place in e.at.split("+") if e.kind == "clock_offset" else ():
            if place.startswith("inputs."):
                j = list(drive.inputs).index(place.split(".")[1])
                stamped[:, j] = np.interp(time - e.parameters["offset"], time, inputs[:, j])
    return stamped


def _lagged(value: np.ndarray, step: float, constant: float) -> np.ndarray:
    """First-order lag, exact for a signal that is linear between samples, settled at the start."""
    a = np.exp(-step / constant)
    last = constant / step * (1 - a) - a
    return lfilter([1 - a - last, last], [1, -a], value - value[0]) + value[0]


def _faulty(readings: dict[str, np.ndarray], e: Hidden, time: np.ndarray) -> np.ndarray:
    value, p = readings[e.name], e.parameters
    match e.kind:
        case "sensor_offset":
            return value + p["offset"]
        case "sensor_gain":
            return value * p["factor"]
        case "sensor_drift":
            return value + p["rate"] * time
        case "sensor_gain_drift":
            return value * (1 - p["change"] * np.expm1(-time / p["time_constant"]))
        case "crosstalk":
            return value + p["share"] * readings[p["from"]]  # type: ignore[index]
        case _:
            return value


def add_noise(
    readings: dict[str, np.ndarray], noise: dict[str, float], effects: list[Hidden], rng: np.random.Generator
) -> dict[str, np.ndarray]:
    """White noise of the stated standard deviation, then the converter's steps."""
    noisy = {name: value + noise[name] * rng.standard_normal(len(value)) for name, value in readings.items()}
    return converted(noisy, effects)


def converted(readings: dict[str, np.ndarray], effects: list[Hidden]) -> dict[str, np.ndarray]:
    """Readings rounded to the steps of a coarse converter, where one is hidden."""
    result = dict(readings)
    for e in effects:
        if e.kind == "quantisation":
            result[e.name] = np.round(result[e.name] / e.parameters["step"]) * e.parameters["step"]
    return result
