"""One table of spellings, every kind of file: what is taken means the same everywhere, else one line refuses it."""

import math

import numpy as np
import pytest

from matching.match.requirements import read_limits
from matching.uncertainty.budget import budget_from_tables
from modelling.errors import InputError
from modelling.model_file import from_dict
from modelling.recordings.read import Channel, read_channels, read_recording

RPM, SPEED, TORQUE = 2 * math.pi / 60, "rad/s", "N*m"
TAKEN = [
    *((text, SPEED, RPM) for text in ("1/min", "1/minutes", "/min", "min-1", "rpm", "RPM", "U/min", "rev/min")),
    ("deg/s", SPEED, math.pi / 180),
    *((text, TORQUE, 1.0) for text in ("N*m", "Nm", "N.m", "N-m", "N·m")), ("kNm", TORQUE, 1e3),
]  # fmt: skip
REFUSED = [
    *((text, SPEED) for text in ("1/h", "mHz", "Bq", "1/s", "m/s", "Grad/s", "krad/s", "rad/Ms")),
    *((text, TORQUE) for text in ("W*s", "eV/rad", "N*m/%", "N*m/rad")),
]  # fmt: skip
SI = {SPEED: 250.0, TORQUE: 40.0}  # a value that no rule on sizes objects to
SENSOR = {SPEED: "motor_speed", TORQUE: "link_torque"}
TIME = np.arange(200) * 1e-3


def system(uncertainty=None):
    sensors = {
        "motor_speed": {"measures": "speed", "of": "motor"},
        "link_torque": {"measures": "torque", "of": "link"},
    }
    for name, value in (uncertainty or {}).items():
        sensors[name] |= {"uncertainty": value}
    shaft = {"between": ["motor", "load"], "stiffness": 300.0, "damping": 0.5}
    tables = {"inertias": {"motor": {"J": 0.1}, "load": {"J": 1.0}}, "shafts": {"link": shaft}}
    return from_dict(tables | {"inputs": {"motor_torque": {"on": "motor"}}, "sensors": sensors}, "model.toml")


def model(folder, text, si, value):
    found = system({SENSOR[si]: f"{value!r} {text}"})
    return next(sensor for sensor in found.sensors if sensor.name == SENSOR[si]).uncertainty


def case(folder, text, si, value):
    key = {SPEED: "dynamometer_speed", TORQUE: "dynamometer_torque"}[si]
    return read_limits({"limits": {key: f"{value!r} {text}"}}, system(), "case.toml")[0][key]


def budget(folder, text, si, value):
    reading = {"value": value, "unit": text, "uncertainty": 1.0}
    tables = {"measurand": {"name": "y", "formula": "reading", "unit": text}, "inputs": {"reading": reading}}
    return budget_from_tables(tables, "budget.toml").inputs[0].value


def rows(folder, unit, si, value):
    wave = value * np.cos(2 * np.pi * 5 * TIME)
    lines = [f"{t!r},0.0,{y!r}" for t, y in zip(TIME.tolist(), wave.tolist(), strict=True)]
    path = folder / "recording.csv"
    path.write_text("\n".join([f"time [s],motor_torque [N*m],{SENSOR[si]}{unit}", *lines]), encoding="utf-8")
    return path


def recording(folder, text, si, value):
    return read_recording(rows(folder, f" [{text}]", si, value), system())[SENSOR[si]].max()


def channels(folder, text, si, value):
    (folder / "channels.toml").write_text(
        f'[channels]\n{SENSOR[si]} = {{ channel = "{SENSOR[si]}", unit = "{text}" }}\n', encoding="utf-8"
    )
    named = read_channels(folder / "channels.toml")
    assert isinstance(named[SENSOR[si]], Channel)
    return read_recording(rows(folder, "", si, value), system(), named)[SENSOR[si]].max()


@pytest.mark.parametrize("reader", [model, case, budget, recording, channels])
@pytest.mark.parametrize(("text", "si", "factor"), TAKEN)
def test_taken_alike(tmp_path, reader, text, si, factor):
    assert reader(tmp_path, text, si, SI[si] / factor) == pytest.approx(SI[si], rel=1e-12)


@pytest.mark.parametrize("reader", [model, case, recording, channels])
@pytest.mark.parametrize(("text", "si"), REFUSED)
def test_refused_alike(tmp_path, reader, text, si):
    with pytest.raises(InputError) as refused:
        reader(tmp_path, text, si, SI[si])
    assert "\n" not in str(refused.value)
    assert text in str(refused.value)


@pytest.mark.parametrize(("text", "result"), [("mHz", "rad/s"), ("Hz", "1/min"), ("rad/s", "Hz"), ("1/min", "Hz")])
def test_a_budget_does_not_turn_cycles_into_radians(text, result):
    """A budget takes any quantity; a reading in one of these units is off by 2·pi in the other."""
    tables = {"inputs": {"f": {"value": 40.0, "unit": text, "uncertainty": 1.0}}}
    with pytest.raises(InputError, match=r"budget.toml: measurand.formula: f in .* counts .*2\*pi"):
        budget_from_tables(tables | {"measurand": {"name": "y", "formula": "f", "unit": result}}, "budget.toml")
    factor = "f/(2*pi)" if result == "Hz" else "2*pi*f"
    with_factor = {"name": "y", "formula": factor, "unit": result}
    if text != "1/min" and result != "1/min":  # beside turns, pi has a meaning of its own
        budget_from_tables(tables | {"measurand": with_factor}, "budget.toml")
    ratio = {"name": "y", "formula": "f*(f/f_0)", "unit": text}
    both = {"f": tables["inputs"]["f"], "f_0": {"value": 2.0, "unit": text, "uncertainty": 0.1}}
    budget_from_tables({"measurand": ratio, "inputs": both}, "budget.toml")
