"""Inputs between their samples: straight lines act like the smooth signal, and a perfect model stays adequate."""

import numpy as np
import pytest
from plant.marks import needs_compiler
from plant.orders import Order

from matching.diagnosis.data import FitData, Segment
from matching.diagnosis.diagnose import diagnose
from matching.diagnosis.inputs import SMOOTH, STRAIGHT, as_taken
from modelling.model_file import load
from modelling.recordings.read import read_recording


@pytest.mark.parametrize("jitter", [0.0, 0.05])
def test_lines_through_the_new_samples_have_the_integral_of_the_smooth_signal(jitter: float) -> None:
    """An impulse is the integral of a torque over a smooth weight; of 12 Hz at 187 Hz straight lines miss 1.4 %."""
    frequency, rate = 12.0, 187.0
    rng = np.random.default_rng(0)
    time = (np.arange(380) + jitter * rng.uniform(-1, 1, 380)) / rate
    signal = np.sin(2 * np.pi * frequency * time)
    data = FitData((Segment(time, np.stack([signal, signal], axis=1), np.zeros((380, 1))),), np.ones(1))
    (segment,) = as_taken(data, (SMOOTH, STRAIGHT)).segments
    fine = np.linspace(time[0], time[-1], 200_001)
    weight = np.sin(2 * np.pi * frequency * fine) * np.sin(np.pi * (fine - fine[0]) / np.ptp(fine)) ** 2
    exact = np.trapezoid(weight * np.sin(2 * np.pi * frequency * fine), fine)
    straight, smooth = (
        np.trapezoid(weight * np.interp(fine, time, column), fine) / exact - 1
        for column in (signal, segment.inputs[:, 0])
    )
    assert straight == pytest.approx(-0.0135, abs=1e-3)
    assert abs(smooth) < (2e-4 if jitter == 0.0 else 1e-3)
    np.testing.assert_array_equal(segment.inputs[:, 1], signal)


@needs_compiler
@pytest.mark.parametrize("torque", ["smooth", "stepped", "noisy"])
def test_a_perfect_model_sampled_at_200_hz_is_adequate(torque: str, tmp_path) -> None:
    Order("perfect", "two_mass", (), 0.0, 5, (), 200, torque).make(6.0).write(tmp_path)
    system = load(tmp_path / "model.toml")
    found = diagnose(system, [read_recording(tmp_path / "recording.csv", system)])
    assert (found.verdict, found.causes) == ("adequate", [])
    assert any("smooth between samples" in note for note in found.notes) == (torque == "smooth")
