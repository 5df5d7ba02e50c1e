"""What to record to tell rivals apart: both are simulated over candidate manoeuvres."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from matching.diagnosis.data.segments import Segment
from matching.diagnosis.fitting import batch_simulation as runs
from matching.diagnosis.search.compare import Named

DURATION = 8.0  # s


@dataclass(frozen=True)
class Manoeuvre:
    """One input's waveform, and how far two rivals then part (root mean square in times the noise)."""

    input: str
    waveform: str
    amplitude: float
    duration: float
    separation: float
    sensor: str

    def sentence(self, one: str, other: str) -> str:
        """What to record, in words."""
        what = f"{self.waveform} of {self.amplitude:.3g} N·m on {self.input} for {self.duration:g} s"
        if self.separation < 1:
            return (
                f"no torque on the inputs tells {one} from {other}: at best {self.separation:.2g} times the noise"
                f" of {self.sensor}"
                f" ({what}); measure a further shaft torque or speed next to them"
            )
        return f"record {what}: {one} and {other} would part by {self.separation:.3g} times the noise of {self.sensor}"


def waveforms(time: np.ndarray) -> dict[str, np.ndarray]:
    """Shapes between −1 and 1 over time (t,)."""
    span = time[-1]
    sweep = np.sin(2 * np.pi * (0.5 * time + (30.0 - 0.5) * time**2 / (2 * span)))
    return {
        "a step": np.where(time > 0.5, 1.0, 0.0),
        "steps to and fro": np.sign(np.sin(2 * np.pi * time / (span / 4) + 1e-9)),
        "a slow sine (0.5 Hz)": np.sin(np.pi * time),
        "a sweep from 0.5 to 30 Hz": sweep,
        "a sweep from 0.5 to 30 Hz about a constant torque": 0.5 + 0.5 * sweep,
    }


def propose(one: Named, other: Named) -> Manoeuvre | None:
    """The manoeuvre that parts two fits most, from rest; None if nothing could be simulated."""
    data = one.fit.problem.data
    step = float(np.median(np.diff(data.segments[0].time)))
    time = step * np.arange(round(DURATION / step))
    inputs = one.fit.problem.model.inputs
    largest = np.max([np.abs(segment.inputs).max(axis=0) for segment in data.segments], axis=0)
    best: Manoeuvre | None = None
    for i, name in enumerate(inputs):
        for waveform, shape in waveforms(time).items():
            for factor in (1.0, 2.0):
                amplitude = factor * float(largest[i]) or 1.0
                torque = np.zeros((len(time), len(inputs)))
                torque[:, i] = amplitude * shape
                difference = _simulated(one, time, torque) - _simulated(other, time, torque)
                parted = np.sqrt(np.mean((difference / data.noise) ** 2, axis=0))
                if not np.isfinite(parted).all():
                    continue
                j = int(np.argmax(parted))
                if best is None or parted[j] > 1.2 * best.separation:
                    sensor = one.fit.problem.model.sensors[j]
                    best = Manoeuvre(name, waveform, amplitude, DURATION, float(parted[j]), sensor)
    return best


def _simulated(named: Named, time: np.ndarray, inputs: np.ndarray) -> np.ndarray:
    problem = named.fit.problem
    p, _ = problem.unpack(named.fit.v)
    segment = Segment(time, inputs, np.full((len(time), len(problem.data.noise)), np.nan))
    return runs.readings(problem.model, segment, p[None], np.zeros((1, len(problem.model.states))), problem.steps)[0]
