"""What to record to tell rivals apart: both are simulated over several manoeuvres."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from matching.diagnosis.data.segments import FitData, Segment
from matching.diagnosis.fitting.batch_simulation import simulate_readings
from matching.diagnosis.search.hypothesis import Hypothesis
from modelling.model.system import System

DURATION = 8.0  # s
STEP_TIME = 0.5  # s
STEPS_PER_RUN = 4.0  # periods of the alternating steps
SLOW_HZ, SWEEP_HZ = 0.5, (0.5, 30.0)  # the band of drivability
FACTORS = (1.0, 0.5, 0.25, 0.1)  # of the largest recorded torque: a bed is only known to bear what was recorded
BEYOND_RECORDED = 1.05  # of the largest reading; a manoeuvre that drives a sensor further is not proposed
CLEARLY_BETTER = 1.2  # times the separation for a later manoeuvre to be preferred


@dataclass(frozen=True)
class ProposedManoeuvre:
    """One input's waveform, and by how much two rivals then differ.

    Attributes
    ----------
    input, waveform : str
    amplitude : float
        N·m.
    duration : float
        s.
    separation : float
        Root mean square of the difference, in times the noise of ``sensor``.
    sensor : str
    """

    input: str
    waveform: str
    amplitude: float
    duration: float
    separation: float
    sensor: str

    def sentence(self, cause: str, rival: str) -> str:
        """What to record, in words."""
        what = f"{self.waveform} of {self.amplitude:.3g} N·m on {self.input} for {self.duration:g} s"
        if self.separation < 1:
            return (
                f"no torque on the inputs tells {cause} from {rival}: at best {self.separation:.2g} times the noise "
                f"of {self.sensor} ({what}); measure a further shaft torque or speed next to them"
            )
        return (
            f"record {what}: {cause} and {rival} would differ by {self.separation:.3g} times the noise of {self.sensor}"
        )


def waveforms(time: np.ndarray) -> dict[str, np.ndarray]:
    """Shapes (t,) between −1 and 1 over time (t,), s, by name."""
    span = time[-1]
    low, high = SWEEP_HZ
    sweep = np.sin(2 * np.pi * (low * time + (high - low) * time**2 / (2 * span)))
    return {
        "a step": np.where(time > STEP_TIME, 1.0, 0.0),
        "steps to and fro": np.sign(np.sin(2 * np.pi * STEPS_PER_RUN * time / span + 1e-9)),
        f"a slow sine ({SLOW_HZ:g} Hz)": np.sin(2 * np.pi * SLOW_HZ * time),
        f"a sweep from {low:g} to {high:g} Hz": sweep,
        f"a sweep from {low:g} to {high:g} Hz about a constant torque": 0.5 + 0.5 * sweep,
    }


def propose_manoeuvre(hypothesis: Hypothesis, rival: Hypothesis) -> ProposedManoeuvre | None:
    """The manoeuvre in which two hypotheses differ most, from rest; None if nothing could be simulated.

    Simpler waveforms come first and are kept unless a later one is clearly better. Each has the largest amplitude that
    drives no speed, acceleration or shaft torque beyond what was recorded.
    """
    data, model = hypothesis.fit.problem.data, hypothesis.fit.problem.model
    time = data.sampling_interval * np.arange(round(DURATION / data.sampling_interval))
    largest = np.max([np.abs(segment.inputs).max(axis=0) for segment in data.segments], axis=0)
    recorded = _largest_readings(data, model.system)
    best: ProposedManoeuvre | None = None
    for i, name in enumerate(model.inputs):
        for waveform, shape in waveforms(time).items():
            for factor in FACTORS:
                amplitude = factor * float(largest[i])
                torque = np.zeros((len(time), len(model.inputs)))
                torque[:, i] = amplitude * shape
                readings = _readings(hypothesis, time, torque)
                difference = readings - _readings(rival, time, torque)
                separation = np.sqrt(np.mean((difference / data.noise) ** 2, axis=0))
                if not np.isfinite(separation).all() or np.any(np.abs(readings).max(axis=0) > recorded):
                    continue
                j = int(np.argmax(separation))
                if best is None or separation[j] > CLEARLY_BETTER * best.separation:
                    best = ProposedManoeuvre(
                        name, waveform, amplitude, DURATION, float(separation[j]), model.sensors[j]
                    )
                break
    return best


def _largest_readings(data: FitData, system: System) -> np.ndarray:
    """(y,) largest magnitudes that may be reached; infinite for angles, and for sensors that were not recorded."""
    readings = np.abs(np.concatenate([segment.readings for segment in data.segments]))
    largest = BEYOND_RECORDED * np.max(np.where(np.isfinite(readings), readings, 0.0), axis=0)
    free = [sensor.measures == "angle" for sensor in system.sensors]
    return np.where(free | (largest == 0), np.inf, largest)


def _readings(hypothesis: Hypothesis, time: np.ndarray, inputs: np.ndarray) -> np.ndarray:
    """Readings (t, y), SI, of a hypothesis from rest."""
    problem = hypothesis.fit.problem
    p, _ = problem.unpack(hypothesis.fit.v)
    segment = Segment(time, inputs, np.full((len(time), len(problem.data.noise)), np.nan))
    start = np.zeros((1, len(problem.model.states)))
    return simulate_readings(problem.model, [segment], p[None], [start], problem.steps_per_second)[0][0]
