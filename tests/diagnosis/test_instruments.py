"""Bias by noise that comes back through a controller, made by the truth plant; the reference tells it."""

import tomllib
from pathlib import Path

import numpy as np
import pytest
from plant.bench import record
from plant.excitation import Excitation
from plant.hidden import Hidden
from plant.marks import needs_compiler
from plant.systems import Drive
from scipy.signal import lfilter

from matching.diagnosis.causes import ExtendedModel
from matching.diagnosis.closed_loop import closed_loop_notes, instrumented_fit
from matching.diagnosis.data import prepare_data
from matching.diagnosis.descent import solve
from matching.diagnosis.hypotheses import Hypothesis
from matching.diagnosis.problem import base_problem
from modelling.errors import InputError
from modelling.model_file import dumps, from_dict
from modelling.recordings.read import read_recording
from modelling.recordings.recording import Recording

STEP, SAMPLES = 2e-3, 10_000  # s
J, DRAG, GAIN = 0.5, 0.4, 6.0  # kg·m², N·m·s/rad, N·m·s/rad
NOISE, MEMORY = 0.3, 0.95  # rad/s; of a sample's noise in the next


def model(reference: str | None = "wanted"):
    return from_dict({
        "inertias": {"disc": {"J": {"value": 0.45, "tolerance": 0.5}, "drag": {"value": 0.3, "tolerance": 0.9}}},
        "inputs": {"brake": {"on": "disc"} | ({"reference": reference} if reference else {})},
        "sensors": {"speed": {"measures": "speed", "of": "disc", "uncertainty": NOISE}},
    })  # fmt: skip


def recorded(
    *, fed_back: bool = True, memory: float = MEMORY, level: float = NOISE, hidden: tuple[Hidden, ...] = ()
) -> Recording:
    """A disc whose speed is controlled; the controller reads the noise that is recorded, or none."""
    values = {"inertias.disc.J": J, "inertias.disc.drag": DRAG}
    drive = Drive("", "", ["disc"], {}, {"brake": "disc"}, {"speed": ("speed", "disc")}, values, {"brake": 5.0})
    rng = np.random.default_rng(4)
    noise = level * np.sqrt(1 - memory**2) * lfilter([1], [1, -memory], rng.standard_normal(SAMPLES))
    steps = np.repeat(rng.uniform(-1, 1, SAMPLES // 400), 400)
    wanted = lfilter([0.02], [1, -0.98], steps)
    none = np.zeros((SAMPLES, 1))
    excitation = Excitation(none, 0, {"brake": (GAIN, 2.0)}, wanted[:, None], noise[:, None] if fed_back else none, 0.0)
    take = record(drive, list(hidden), excitation, STEP)
    channels = {"brake": take.inputs[:, 0], "speed": take.readings["speed"] + noise, "wanted": wanted}
    return Recording(take.time, channels)


def fitted(recording: Recording, reference: str | None = "wanted") -> Hypothesis:
    system = model(reference)
    data, _ = prepare_data(system, [recording])
    fit = solve(*base_problem(system, data))
    return Hypothesis(ExtendedModel(system, (), dict(fit.problem.bounds), fit.values), fit)


@needs_compiler
def test_noise_that_is_fed_back_biases_and_the_reference_tells_by_how_much() -> None:
    recording = recorded()
    final = fitted(recording)
    found = instrumented_fit(final.fit, {0: [recording["wanted"]]})
    assert abs(final.fit.values["inertias.disc.J"] / J - 1) > 0.1
    for name, truth in (("inertias.disc.J", J), ("inertias.disc.drag", DRAG)):
        assert abs(found.values[name] - truth) < 4 * found.uncertainties[name]
    assert found.uncertainties["inertias.disc.J"] < 0.1 * J
    (note,) = closed_loop_notes(final, [recording])
    assert "biases parameters; with the reference: inertias.disc.J" in note
    assert f"instead of {final.fit.values['inertias.disc.J']:.4g}" in note


@needs_compiler
def test_noise_that_no_controller_reads_biases_nothing() -> None:
    recording = recorded(fed_back=False)
    (note,) = closed_loop_notes(fitted(recording), [recording])
    assert "no parameter is off by more than chance" in note


@needs_compiler
@pytest.mark.parametrize(
    ("hidden", "level", "why"),
    [
        (Hidden("coulomb_friction", "inertias.disc", {"torque": 1.5}), 0.05, "more than the sensors' noise is left"),
        (Hidden("input_lag", "inputs.brake", {"time_constant": 0.1}), NOISE, "what is left follows the reference too"),
    ],
)
def test_beside_an_error_of_the_model_no_bias_can_be_told(hidden: Hidden, level: float, why: str) -> None:
    recording = recorded(hidden=(hidden,), memory=0.0, level=level)
    (note,) = closed_loop_notes(fitted(recording), [recording])
    assert f"cannot be decided: {why}" in note


@needs_compiler
def test_a_reference_that_moves_nothing_decides_nothing() -> None:
    recording = recorded(memory=0.0)
    channels = recording.channels | {"wanted": np.random.default_rng(9).standard_normal(SAMPLES)}
    other = Recording(recording.time, channels)
    (note,) = closed_loop_notes(fitted(other), [other])
    assert "cannot be decided: the reference moves" in note


def test_a_sensor_is_no_reference() -> None:
    with pytest.raises(InputError, match="'speed' is an input or a sensor"):
        model("speed")


@needs_compiler
def test_without_its_reference_it_cannot_be_decided() -> None:
    recording = recorded(memory=0.0)
    for reference, channels in ((None, [recording]), ("other", [recording]), ("wanted", [])):
        (note,) = closed_loop_notes(fitted(recording, reference), channels)
        assert "follows the noise of speed" in note
        assert "cannot be decided without the controller's reference" in note


def test_a_reference_is_read_from_the_recording_where_it_is_there(tmp_path: Path) -> None:
    path, time = tmp_path / "recording.csv", np.arange(100) * STEP
    columns = [time, np.sin(time), np.cos(time), 60 * time]
    np.savetxt(path, np.stack(columns, axis=1), delimiter=",", comments="",
               header="time [s],brake [N*m],speed [rad/s],wanted [1/min]")  # fmt: skip
    recording = read_recording(path, model())
    assert recording["wanted"] == pytest.approx(2 * np.pi * time, abs=1e-9)
    assert not any("wanted" in note for note in recording.notes)
    assert "wanted" not in read_recording(path, model(None)).channels
    assert from_dict(tomllib.loads(dumps(model()))) == model()
