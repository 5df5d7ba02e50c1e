"""The audit of the channels on perfect models with one fault of a channel; confidence by draws of unseen blocks."""

import numpy as np
import pytest

from matching.diagnosis.audit import _lines, time_hypotheses
from matching.diagnosis.base import fit_base
from matching.diagnosis.data import prepare_data
from matching.diagnosis.diagnose import diagnose
from matching.diagnosis.settings import DiagnosisSettings
from matching.diagnosis.times import channel_times
from modelling.model_file import load
from modelling.recordings.read import read_recording
from tests.campaign.perfect import draw, write

PERFECT = (4907, 7)  # three inertias, straight inputs, 224 Hz


def recorded(change, place):
    """A perfect model, and its recording after a change of the columns."""
    drawn = draw(*PERFECT)
    change(drawn.columns)
    write(drawn, place)
    system = load(place / "model.toml")
    return system, read_recording(place / "recording.csv", system)


def test_exchanged_channels_are_named_and_nothing_else(tmp_path):
    def exchange(columns):
        a, b = (name for name in columns if name.startswith("speed"))
        columns[a], columns[b] = columns[b], columns[a]

    system, recording = recorded(exchange, tmp_path)
    found = diagnose(system, [recording])
    speeds = [sensor.name for sensor in system.sensors if sensor.measures == "speed"]
    assert {c.name: c.exchanged_with for c in found.channels if c.exchanged_with} == dict(
        zip(speeds, speeds[::-1], strict=True)
    )
    assert not found.causes


@pytest.mark.parametrize("frequency", [50.0, 180.0])
def test_hum_of_the_mains_is_named_with_its_amplitude_and_no_cause(frequency, tmp_path):
    """180 Hz, the third multiple of 60 Hz, shows as its alias below half of the sampling frequency."""
    size = 0.0

    def hum(columns):
        nonlocal size
        (name,) = (name for name in columns if name.startswith("torque"))
        size = 0.02 * columns[name].std()
        columns[name] = columns[name] + size * np.sin(2 * np.pi * frequency * columns["time [s]"] + 1)

    system, recording = recorded(hum, tmp_path)
    found = diagnose(system, [recording])
    assert (found.verdict, found.causes) == ("adequate", [])
    (note,) = (note for note in found.notes if "hum of the mains" in note)
    assert float(note.split("amplitude ")[1].split()[0]) == pytest.approx(size, rel=0.1)


def test_a_late_channel_is_the_hypothesis_of_its_time(tmp_path):
    def late(columns):
        (name,) = (name for name in columns if name.startswith("torque"))
        columns[name] = np.concatenate([np.full(5, columns[name][0]), columns[name][:-5]])

    system, recording = recorded(late, tmp_path)
    data, _ = prepare_data(system, [recording])
    base = fit_base(system, data, DiagnosisSettings())
    suspected = time_hypotheses(system, base, channel_times(system, base))
    torque = next(f"sensors.{sensor.name}" for sensor in system.sensors if sensor.measures == "torque")
    ((kind, at, values),) = suspected
    assert (kind, at) == ("sensor_delay", torque)
    assert values["delay"] == pytest.approx(5 * data.sampling_interval, abs=data.sampling_interval)


@pytest.mark.parametrize("driven", [True, False])
def test_a_line_that_an_input_has_is_no_hum(driven):
    rng = np.random.default_rng(5)
    time = np.arange(4000) * 1e-3
    line = np.sin(2 * np.pi * 50 * time + 1)
    torque = np.stack([rng.standard_normal(4000), 3 * line * driven + rng.standard_normal(4000)], axis=1)
    found = _lines("speed", 0.5 * line + rng.standard_normal(4000), torque, 1e-3)
    assert [hum.source for hum in found] == ([] if driven else ["1 × 50 Hz"])
