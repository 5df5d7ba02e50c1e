"""Channel files: other people's names, units and signs."""

import numpy as np
import pytest

import rigmatch as rm
from matching.cli import main
from modelling.errors import InputError
from modelling.model_file import from_dict
from modelling.recordings.read import Channel, read_channels, read_recording

MODEL = """
[inertias.motor]
J = 0.1
[inertias.load]
J = 1
[shafts.side]
between = ["motor", "load"]
stiffness = 1000
damping = 1
[inputs.motor_torque]
on = "motor"
[sensors.motor_speed]
measures = "speed"
of = "motor"
"""


@pytest.fixture
def system():
    return from_dict(
        {
            "inertias": {"motor": {"J": 0.1}, "load": {"J": 1.0}},
            "shafts": {"side": {"between": ["motor", "load"], "stiffness": 1000, "damping": 1}},
            "inputs": {"motor_torque": {"on": "motor"}},
            "sensors": {"motor_speed": {"measures": "speed", "of": "motor"}},
        }
    )


@pytest.fixture
def measured(tmp_path):
    path = tmp_path / "measured.csv"
    time = np.arange(0, 1, 0.01)
    rows = np.stack([60 / (2 * np.pi) * 3 * time, time, -10 * time], axis=1)
    np.savetxt(path, rows, delimiter=",", header="nEM [1/min],t [s],M_EM_ist", comments="")
    return path


def channel_file(tmp_path, text):
    path = tmp_path / "channels.toml"
    path.write_text(text)
    return path


GOOD = """
[channels]
time = "t"
motor_speed = "nEM"
motor_torque = { channel = "M_EM_ist", unit = "N*m", sign = -1 }
"""


def test_names_units_and_signs(tmp_path, system, measured):
    channels = read_channels(channel_file(tmp_path, GOOD))
    assert channels["motor_torque"] == Channel("M_EM_ist", "N*m", -1.0)
    recording = read_recording(measured, system, channels)
    np.testing.assert_allclose(recording["motor_torque"], 10 * recording.time)
    np.testing.assert_allclose(recording["motor_speed"], 3 * recording.time)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[channels]\nmotor_torque = 'M_EM_is'\ntime = 't'", "did you mean 'M_EM_ist'?"),
        ("[channels]\nmotor_speed = { chanel = 'nEM' }", "did you mean 'channel'?"),
        ("[channel]\nmotor_speed = 'nEM'", "did you mean 'channels'?"),
        ("[channels]", "is missing or empty"),
        ("[channels]\nmotor_speed = 3", "names no channel"),
        ("[channels]\nmotor_speed = { channel = 'nEM', sign = 2 }", "is no sign"),
        ("[channels]\nmotor_speed = { channel = 'nEM', unit = 3 }", "is no unit"),
        ("[channels]\nmotor_speed = { channel = 'nEM', factor = 0 }", "is 0"),
        ("[channels]\nmotor_speed = { channel = 'nEM', factor = 'x' }", "is no quantity"),
        ("[channels]\nmotor_speed = { channel = 'nEM', group = -1 }", "is no group"),
        ("[channels]\ntime = 't'\nmotor_torque = { channel = 'M_EM_ist', group = 1 }", ".csv files have no groups"),
        ("[channels]\nmotor_speed = 'nEM'\nmotor_torque = 'nEM'", "is 'motor_speed' already"),
        ("[channels]\ntime = 't'\nmotor_torque = 'M_EM_ist'\nmotor_speed = { channel = 'nEM', unit = 'kg' }", "kg"),
        ("[channels\n", "line"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(tmp_path, system, measured, text, said):
    with pytest.raises(InputError) as error:
        read_recording(measured, system, read_channels(channel_file(tmp_path, text)))
    assert said in str(error.value)
    assert "\n" not in str(error.value)


def test_a_near_miss_is_pointed_out(tmp_path, system):
    path = tmp_path / "near.csv"
    path.write_text("time [s],motor_torque [N*m],motor_sped [rad/s]\n0,1,0\n0.01,1,0.1\n0.02,1,0.2\n")
    assert any("is it column 'motor_sped'?" in note for note in read_recording(path, system).notes)


def test_simulate_takes_a_channel_file(tmp_path, measured):
    (tmp_path / "model.toml").write_text(MODEL)
    words = ["simulate", tmp_path / "model.toml", measured, "--out", tmp_path / "out"]
    assert main([str(word) for word in words]) == 2
    words += ["--channels", channel_file(tmp_path, GOOD)]
    assert main([str(word) for word in words]) == 0
    assert (tmp_path / "out" / "simulated.csv").exists()
    simulated = rm.simulate(tmp_path / "model.toml", measured, channels=tmp_path / "channels.toml")
    written = np.genfromtxt(tmp_path / "out" / "simulated.csv", delimiter=",", names=True)
    np.testing.assert_allclose(written["motor_speed_rads"], simulated["motor_speed"], rtol=1e-7, atol=1e-7)
