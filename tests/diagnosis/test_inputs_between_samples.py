"""Inputs between their samples: straight lines act like the smooth signal, and a perfect model stays adequate."""

import numpy as np
import pytest
from plant.marks import needs_compiler
from plant.orders import Order
from scipy.linalg import expm

from matching.diagnosis.data import FitData, Segment
from matching.diagnosis.diagnose import diagnose
from matching.diagnosis.inputs import HELD, SMOOTH, STRAIGHT, as_taken
from matching.diagnosis.simulation import between_samples
from modelling.model_file import from_dict, load
from modelling.recordings.read import read_recording
from modelling.recordings.recording import Recording
from modelling.system import System


@pytest.mark.parametrize("jitter", [0.0, 0.05])
def test_lines_through_the_new_samples_have_the_integral_of_the_smooth_signal(jitter: float) -> None:
    """An impulse is the integral of a torque over a smooth weight; of 12 Hz at 187 Hz straight lines miss 1.4 %."""
    frequency, rate = 12.0, 187.0
    rng = np.random.default_rng(0)
    time = (np.arange(380) + jitter * rng.uniform(-1, 1, 380)) / rate
    signal = np.sin(2 * np.pi * frequency * time)
    data = FitData((Segment(time, np.stack([signal, signal], axis=1), np.zeros((380, 1))),), np.ones(1))
    (segment,) = as_taken(data, (SMOOTH, STRAIGHT)).segments
    rows, inputs, shares = between_samples(segment)
    fine = np.linspace(time[0], time[-1], 200_001)
    weight = np.sin(2 * np.pi * frequency * fine) * np.sin(np.pi * (fine - fine[0]) / np.ptp(fine)) ** 2
    exact = np.trapezoid(weight * np.sin(2 * np.pi * frequency * fine), fine)
    straight, smooth = (
        np.trapezoid(weight * np.interp(fine, at, column), fine) / exact - 1
        for at, column in ((time, signal), (rows, inputs[:, 0]))
    )
    assert straight == pytest.approx(-0.0135, abs=1e-3)
    assert abs(smooth) < 2e-4
    np.testing.assert_array_equal(inputs[::4, 1], signal)
    np.testing.assert_allclose(shares.reshape(-1, 4), 0.25)


def test_a_held_input_keeps_its_value_beside_a_smooth_one() -> None:
    time, value = np.arange(10.0), np.arange(10.0) ** 2
    data = FitData((Segment(time, np.stack([value, value], axis=1), np.zeros((10, 1))),), np.ones(1))
    rows, inputs, _ = between_samples(as_taken(data, (SMOOTH, HELD)).segments[0])
    np.testing.assert_allclose(inputs[:, 0], rows**2 - 2 / 12 / 16, atol=1e-9)  # lines have the moments of the parabola
    np.testing.assert_array_equal(inputs[:, 1], value[np.minimum(np.floor(rows), 9).astype(int)])


def precise_chain(seed: int, fine: int = 16) -> tuple[System, Recording]:
    """A perfect chain of four, driven smoothly at up to a sixth of the sampling frequency; a noise of a ten-thousandth
    of the range. By matrix exponentials over a sixteenth of a sample."""
    rng, n, rate, count = np.random.default_rng(seed), 4, 150.0, 1500
    J, k, drag = rng.uniform(0.02, 0.3, n), rng.uniform(300, 8000, n - 1), rng.uniform(0.02, 0.2, n)
    c = 2e-3 * k
    rows = np.eye(n)[:-1] - np.eye(n)[1:]
    springs, dampers = rows.T @ np.diag(k) @ rows, rows.T @ np.diag(c) @ rows + np.diag(drag)
    block = np.zeros((2 * n + 2, 2 * n + 2))
    block[:n, n : 2 * n], block[2 * n, 2 * n + 1] = np.eye(n), 1.0
    block[n : 2 * n, : 2 * n], block[n, 2 * n] = -np.hstack([springs, dampers]) / J[:, None], 1 / J[0]
    over = expm(block / (fine * rate))[: 2 * n]
    time = np.arange(count * fine) / (fine * rate)
    drive = sum(np.sin(2 * np.pi * f * time + f) for f in rng.uniform(0.3, 25, 12))
    x = np.zeros((len(time), 2 * n))
    for i in range(len(time) - 1):
        x[i + 1] = over @ np.array([*x[i], drive[i], (drive[i + 1] - drive[i]) * fine * rate])
    readings = {"first": x[:, n], "last": x[:, -1], "torque": x[:, :n] @ rows[1] * k[1] + x[:, n:] @ rows[1] * c[1]}
    noise = {name: 1e-4 * float(np.ptp(own)) for name, own in readings.items()}

    def about(value: float) -> dict[str, float]:
        return {"value": value * float(rng.uniform(0.8, 1.25)), "tolerance": 0.5}

    places = {"first": ("speed", "i0"), "last": ("speed", "i3"), "torque": ("torque", "s1")}
    model = {
        "inertias": {f"i{i}": {"J": float(J[i]), "drag": about(drag[i])} for i in range(n)},
        "shafts": {f"s{i}": {"between": [f"i{i}", f"i{i + 1}"], "stiffness": about(k[i]), "damping": about(c[i])}
                   for i in range(n - 1)},
        "inputs": {"drive": {"on": "i0"}},
        "sensors": {name: {"measures": measures, "of": of, "uncertainty": noise[name]}
                    for name, (measures, of) in places.items()},
    }  # fmt: skip
    channels = {name: own[::fine] + noise[name] * rng.standard_normal(count) for name, own in readings.items()}
    return from_dict(model), Recording(time[::fine], {"drive": drive[::fine], **channels})


@pytest.mark.parametrize("seed", [0, 4])
def test_a_precise_recording_of_a_perfect_model_is_adequate(seed: int) -> None:
    system, recording = precise_chain(seed)
    found = diagnose(system, [recording])
    assert (found.verdict, found.causes) == ("adequate", [])


@needs_compiler
@pytest.mark.parametrize("torque", ["smooth", "stepped", "noisy"])
def test_a_perfect_model_sampled_at_200_hz_is_adequate(torque: str, tmp_path) -> None:
    Order("perfect", "two_mass", (), 0.0, 5, (), 200, torque).make(6.0).write(tmp_path)
    system = load(tmp_path / "model.toml")
    found = diagnose(system, [read_recording(tmp_path / "recording.csv", system)])
    assert (found.verdict, found.causes) == ("adequate", [])
    assert any("smooth between samples" in note for note in found.notes) == (torque == "smooth")
