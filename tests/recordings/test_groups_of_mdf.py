"""MDF files as data loggers write them: status texts, several channels of a name, groups that start apart."""

import numpy as np
import pytest

from modelling.errors import InputError
from modelling.model_file import from_dict
from modelling.recordings.read import Channel, read_channels, read_recording, read_signals

asammdf = pytest.importorskip("asammdf")

SYSTEM = from_dict({
    "inertias": {"motor": {"J": 0.1}, "load": {"J": 1.0}},
    "shafts": {"link": {"between": ["motor", "load"], "stiffness": 100.0}},
    "inputs": {"motor_torque": {"on": "motor"}, "brake": {"on": "load"}},
    "sensors": {"motor_speed": {"measures": "speed", "of": "motor"}},
})  # fmt: skip
TIME = np.arange(200) * 0.01
TORQUE, BRAKE, SPEED = np.sin(TIME), np.cos(3 * TIME), 5 * TIME


def signal(values, unit, name, time=TIME, **more):
    return asammdf.Signal(values, time, unit, name, **more)


def recorded(tmp_path, *signals, channels=None):
    with asammdf.MDF(version="4.10") as file:
        for each in signals:
            file.append([each])
        file.save(tmp_path / "run.mf4", overwrite=True)
    return read_recording(tmp_path / "run.mf4", SYSTEM, channels)


INPUTS = [signal(TORQUE, "Nm", "motor_torque"), signal(BRAKE, "Nm", "brake")]


def test_where_all_channels_have_other_names_the_input_is_named_and_what_is_there(tmp_path):
    german = [signal(TORQUE, "Nm", "Drehmoment_EM"), signal(SPEED, "1/min", "Drehzahl_EM")]
    with pytest.raises(InputError, match=r"'motor_torque' was not recorded.*Drehmoment_EM.*--channels"):
        recorded(tmp_path, *german)
    with pytest.raises(InputError, match=r"none of the channels that are asked for; there are .*Drehzahl_EM"):
        read_signals(tmp_path / "run.mf4", ["motor_torque"])


def test_a_status_text_among_numbers_is_a_missing_value(tmp_path):
    """As a CAN signal: 0.1·raw − 5 rad/s, and 65535 means "not available"."""
    raw = np.rint((SPEED + 5) / 0.1).astype(np.uint16)
    raw[[3, 50]] = 65535
    conversion = {
        "lower_0": 65535, "upper_0": 65535, "text_0": b"not available", "default_addr": {"a": 0.1, "b": -5.0}
    }  # fmt: skip
    got = recorded(tmp_path, *INPUTS, signal(raw, "rad/s", "motor_speed", conversion=conversion))
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(got["motor_speed"])), [3, 50])
    good = np.isfinite(got["motor_speed"])
    np.testing.assert_allclose(got["motor_speed"][good], SPEED[good], atol=0.051)


def test_texts_that_hold_the_numbers_are_named(tmp_path):
    texts = np.array([f"{value:.4f}".encode() for value in SPEED])
    texts[7] = b"SNA"
    got = recorded(tmp_path, *INPUTS, signal(texts, "rad/s", "motor_speed", encoding="utf-8"))
    assert np.flatnonzero(np.isnan(got["motor_speed"])) == [7]
    assert any("motor_speed has the texts SNA among its numbers" in note for note in got.notes)


def test_states_are_no_numbers(tmp_path):
    states = np.where(np.arange(200) % 5, b"on", b"12")
    with pytest.raises(InputError, match="'motor_speed': holds no numbers"):
        recorded(tmp_path, *INPUTS, signal(states, "", "motor_speed", encoding="utf-8"))


def test_a_constant_of_the_same_name_does_not_displace_what_varies(tmp_path):
    long = np.arange(2000) * 0.001
    constant = signal(np.full(2000, 7.0), "Nm", "motor_torque", long)
    got = recorded(tmp_path, constant, *INPUTS)
    np.testing.assert_allclose(got["motor_torque"], TORQUE, atol=1e-12)
    assert any("motor_torque is in 2 groups, taken from group 1: the one that varies" in note for note in got.notes)


def test_different_channels_of_one_name_have_to_be_chosen(tmp_path):
    other = signal(-TORQUE, "Nm", "motor_torque")
    with pytest.raises(InputError, match=r"different values in the groups 0, 2; .* group = 0 }"):
        recorded(tmp_path, *INPUTS, other)
    path = tmp_path / "channels.toml"
    path.write_text('[channels]\nmotor_torque = { channel = "motor_torque", group = 2, factor = 2 }\n')
    got = recorded(tmp_path, *INPUTS, other, channels=read_channels(path))
    np.testing.assert_allclose(got["motor_torque"], -2 * TORQUE, atol=1e-12)
    with pytest.raises(InputError, match="is not in group 1; it is in 0, 2"):
        recorded(tmp_path, *INPUTS, other, channels={"motor_torque": Channel("motor_torque", group=1)})


@pytest.mark.parametrize("late", [0.5, 0.503])
def test_inputs_that_start_half_a_second_apart_count_from_the_later_one(tmp_path, late):
    begin = TIME + late
    got = recorded(tmp_path, INPUTS[0], signal(np.cos(3 * begin), "Nm", "brake", begin))
    assert got.time[0] == pytest.approx(0.5, abs=0.011)
    assert got.time[-1] == pytest.approx(TIME[-1], abs=0.011)
    np.testing.assert_allclose(got["motor_torque"], np.sin(got.time), atol=1e-4)
    np.testing.assert_allclose(got["brake"], np.cos(3 * got.time), atol=1e-3)
    assert any("50 rows left out" in note or "51 rows left out" in note for note in got.notes), got.notes
