"""Model files: what is read and written, and one clear line for everything that is wrong."""

import re
import time
from pathlib import Path

import pytest

from modelling.equations.casadi_code import compiled
from modelling.errors import InputError
from modelling.model_file import dumps, from_dict, load, to_dict
from modelling.toml import LARGEST_FILE

ROOT = Path(__file__).parents[2]
GOOD = """
title = "Two-mass drive"
reference = "motor"
[inertias.motor]
J = 0.1
drag = 0.01
[inertias.load]
J = "1.0 kg*m^2"
[shafts.link]
between = ["motor", "load"]
ratio = 1.0
stiffness = { value = 200, tolerance = 0.1 }
damping = 0.5
[inputs.motor_torque]
on = "motor"
[sensors.link_torque]
measures = "torque"
of = "link"
uncertainty = 0.3
[mirror]
pairs = []
[[effects]]
kind = "backlash"
at = "shafts.link"
gap = 0.02
"""
GEARS = """
[inertias.a]
J = 1
[inertias.b]
J = 1
[inertias.c]
J = 1
[gears.one]
between = ["a", "b"]
ratio = 2
[gears.two]
between = ["b", "c"]
ratio = 3
[gears.three]
between = ["a", "c"]
ratio = RATIO
"""
# (what is replaced, by what, what the line must say)
SPOILED = {
    "empty file": (GOOD, "", r"inertias: the model has none; at least one"),
    "misspelt table": ("[inertias.load]", "[inertia.load]", r"'inertia' does not exist; did you mean 'inertias'\?"),
    "misspelt key": ("damping = 0.5", "dampling = 0.5", r"shafts\.link: 'dampling' .*did you mean 'damping'\?"),
    "misspelt end": (
        '["motor", "load"]', '["motor", "laod"]', r"shafts\.link\.between: 'laod' .*did you mean 'load'\?",
    ),
    "missing end": ('between = ["motor", "load"]', "", r"shafts\.link: 'between' is missing"),
    "one end": ('["motor", "load"]', '["motor"]', r"shafts\.link\.between: is no pair"),
    "three ends": ('["motor", "load"]', '["motor", "load", "x"]', r"is no pair"),
    "ends as text": ('["motor", "load"]', '"motor, load"', r"is no pair"),
    "ends as numbers": ('["motor", "load"]', "[1, 2]", r"int where a name in quotes is expected"),
    "same end twice": ('["motor", "load"]', '["motor", "motor"]', r"joins 'motor' to itself"),
    "negative inertia": ("J = 0.1", "J = -0.1", r"inertias\.motor\.J: -0\.1 is not possible; greater than 0"),
    "no inertia": ("J = 0.1", "J = 0", r"inertias\.motor\.J: 0 is not possible"),
    "inertia missing": ("J = 0.1", "", r"inertias\.motor: 'J' is missing; give a number in kg\*m\^2"),
    "negative drag": ("drag = 0.01", "drag = -1", r"inertias\.motor\.drag: -1 is not possible; 0 or more"),
    "negative damping": ("damping = 0.5", "damping = -0.5", r"shafts\.link\.damping: -0\.5"),
    "negative stiffness": ("{ value = 200, tolerance = 0.1 }", "-200", r"shafts\.link\.stiffness: -200"),
    "bound below zero": ("tolerance = 0.1", "lower = -100, upper = 500", r"stiffness: -100 is not possible"),
    "ratio zero": ("ratio = 1.0", "ratio = 0", r"shafts\.link\.ratio: a ratio of 0"),
    "ratio range through zero": ("ratio = 1.0", "ratio = {value=1, lower=-1, upper=2}", r"a ratio of 0"),
    "unknown unit": (
        '"1.0 kg*m^2"', '"1.0 stone"', r"inertias\.load\.J: unit 'stone' does not fit|unknown unit 'stone'",
    ),
    "nonsense unit": ('"1.0 kg*m^2"', '"1.0 blub"', r"inertias\.load\.J: 'blub' is no unit; a unit like kg\*m\^2"),
    "unit of another dimension": ('"1.0 kg*m^2"', '"1.0 N*m"', r"unit 'N\*m' does not fit"),
    "unit tower": ('"1.0 kg*m^2"', '"1 9^9^9"', r"'9\^9\^9' is no unit"),
    "unit tower of metres": ('"1.0 kg*m^2"', '"1 m^9^9^9^9"', r"is no unit"),
    "unit power": ('"1.0 kg*m^2"', '"1 m**99999999"', r"is no unit"),
    "code for a unit": ('"1.0 kg*m^2"', "\"1 __import__('os')\"", r"is no unit"),
    "words for a number": ('"1.0 kg*m^2"', '"heavy"', r"'heavy' is no quantity"),
    "NaN": ("J = 0.1", "J = nan", r"inertias\.motor\.J: 'nan' is not finite"),
    "infinite": ("J = 0.1", "J = inf", r"inertias\.motor\.J: 'inf' is not finite"),
    "infinite text": ('"1.0 kg*m^2"', '"1e999 kg*m^2"', r"is not finite"),
    "integer beyond floats": ("J = 0.1", "J = 1" + "0" * 400, r"integer of hundreds of digits"),
    "endless digits": ("J = 0.1", "J = 1" + "0" * 5000, r"cannot be read: .*digits"),
    "too large for any drivetrain": ("J = 0.1", "J = 1.7e308", r"from 1e-50 to 1e\+50 in kg\*m\^2"),
    "too small for any drivetrain": ('"1.0 kg*m^2"', '"1e-300 kg*m^2"', r"inertias\.load\.J: .* too small"),
    "NaN tolerance": ("tolerance = 0.1", "tolerance = nan", r"tolerance: 'nan' is not finite"),
    "negative tolerance": ("tolerance = 0.1", "tolerance = -0.1", r"tolerance: -0\.1 is negative"),
    "bounds crossed": ("tolerance = 0.1", "lower = 300, upper = 100", r"bounds 300 … 100 do not enclose 200"),
    "one bound": ("tolerance = 0.1", "lower = 100", r"has the keys lower, value; write"),
    "bounds and tolerance": ("tolerance = 0.1", "tolerance = 0.1, lower = 1, upper = 300", r"has the keys"),
    "quantity as list": ("J = 0.1", "J = [0.1]", r"list where a quantity is expected"),
    "quantity as truth": ("J = 0.1", "J = true", r"bool where a quantity is expected"),
    "quantity as date": ("J = 0.1", "J = 2026-01-01", r"date where a quantity is expected"),
    "inertia as number": ("[inertias.load]\nJ =", "[inertias]\nload =", r"load: is no table|load has no value"),
    "table as list": ("[inputs.motor_torque]\non", "[[inputs]]\non", r"inputs: is no table"),
    "effects as table": ("[[effects]]", "[effects]", r"effects: is no list of tables"),
    "title as number": ('title = "Two-mass drive"', "title = 7", r"title: 7 is no text; put it in quotes"),
    "unknown reference": ('reference = "motor"', 'reference = "moter"', r"reference: 'moter' .*did you mean 'motor'\?"),
    "duplicate name": ("[inertias.load]", "[inertias.motor]", r"line \d+: \[inertias.motor\] is there twice"),
    "input and sensor alike": ("[sensors.link_torque]", "[sensors.motor_torque]", r"an input has the same name"),
    "disconnected part": (
        "[shafts.link]", "[inertias.far]\nJ = 1\n[shafts.link]", r"far are not connected to",
    ),
    "input on nothing": (
        'on = "motor"', 'on = "wheel"', r"inputs\.motor_torque\.on: 'wheel' does not exist; known are motor",
    ),
    "sensor of nothing": ('of = "link"', 'of = "motor"', r"sensors\.link_torque\.of: 'motor' does not exist"),
    "sensor of unknown kind": ('"torque"', '"torqe"', r"measures: 'torqe' .*did you mean 'torque'\?"),
    "uncertainty zero": ("uncertainty = 0.3", "uncertainty = 0", r"uncertainty: 0 is not possible"),
    "uncertainty in metres": ("uncertainty = 0.3", 'uncertainty = "0.3 m"', r"unit 'm' does not fit"),
    "mirror with itself": ("pairs = []", 'pairs = [["load", "load"]]', r"joins 'load' to itself"),
    "mirror of a stranger": ("pairs = []", 'pairs = [["load", "left"]]', r"mirror\.pairs: 'left' does not exist"),
    "mirrored twice": ("pairs = []", 'pairs = [["load", "motor"], ["motor", "load"]]', r"stands in two pairs"),
    "mirror misspelt": ("pairs = []", "pears = []", r"mirror: is not understood"),
    "effect of unknown kind": (
        '"backlash"', '"backlach"', r"effects\[1\]\.kind: 'backlach' .*did you mean 'backlash'\?",
    ),
    "effect nowhere": ('at = "shafts.link"', "", r"effects\[1\]: 'at' is missing"),
    "effect at a list of lists": ('"shafts.link"', '[["shafts.link"]]', r"effects\[1\]\.at: .* does not exist"),
    "effect at a stranger": ('"shafts.link"', '"shafts.lnik"', r"effects\[1\]\.at: .*did you mean 'shafts.link'\?"),
    "effect key misspelt": ("gap = 0.02", "gaps = 0.02", r"effects\[1\] \(backlash\): 'gaps' .*did you mean 'gap'\?"),
    "effect key missing": ("gap = 0.02", "", r"effects\[1\] \(backlash\): 'gap' is missing; give a number in rad"),
    "effect out of bounds": ("gap = 0.02", "gap = -0.02", r"effects\[1\]\.gap: -0\.02 is not possible"),
    "effect twice": (
        "gap = 0.02", 'gap = 0.02\n[[effects]]\nkind="backlash"\nat="shafts.link"\ngap=1', r"stands twice",
    ),
    "not TOML": ("J = 0.1", "J : 0.1", r"line \d+: a key is followed by a colon"),
    "nested deep": ("pairs = []", "pairs = " + "[" * 20000 + "]" * 20000, r"nested too deeply|is not TOML|is no pair"),
    "unusable name": ("[inertias.load]", '[inertias."lo ad"]', r"is no usable name"),
    "gear without ratio": (GOOD, GEARS.replace("ratio = RATIO", ""), r"gears\.three: 'ratio' is missing"),
    "differential without cage": (
        GOOD, GEARS.replace("RATIO", "6")
        + '[differentials.d]\nleft = "a"\nright = "b"', r"differentials\.d: 'cage' is missing",
    ),
}  # fmt: skip


def line_of(path):
    """The one line that loading (and deriving) a file must end in."""
    with pytest.raises(InputError) as caught:
        compiled(load(path))
    line = str(caught.value)
    assert "\n" not in line
    assert len(line) < 600
    return line


@pytest.mark.parametrize("name", SPOILED)
def test_one_line_for_what_is_wrong(name, tmp_path):
    old, new, expected = SPOILED[name]
    assert old in GOOD
    path = tmp_path / "spoiled.toml"
    path.write_text(GOOD.replace(old, new, 1))
    line = line_of(path)
    assert line.startswith(str(path))
    assert re.search(expected, line), line


@pytest.mark.parametrize(("ratio", "expected"), [("6", "says again"), ("5", "locks the drivetrain")])
def test_locked_and_redundant_gears(ratio, expected, tmp_path):
    path = tmp_path / "gears.toml"
    path.write_text(GEARS.replace("RATIO", ratio))
    assert expected in line_of(path)


def test_files_that_are_no_text(tmp_path):
    path = tmp_path / "model.toml"
    assert "does not exist" in line_of(path)
    path.write_bytes(b"\x00\xff\xfe" * 100)
    assert "byte 1 is not UTF-8" in line_of(path)
    assert "directory" in line_of(tmp_path).lower()
    with path.open("wb") as file:  # 100 MB of nonsense, told by its size and not read
        file.truncate(100_000_000)
    began = time.perf_counter()
    assert "is too large for a model or case file" in line_of(path)
    assert time.perf_counter() - began < 1.0
    path.write_bytes(b"x" * (LARGEST_FILE - 1))
    assert "is not TOML" in line_of(path)


def examples():
    found = sorted((ROOT / "examples").glob("*/vehicle.toml")) + sorted((ROOT / "examples").glob("*/rig.toml"))
    assert found
    return found


@pytest.mark.parametrize("path", examples(), ids=lambda path: f"{path.parent.name}-{path.stem}")
def test_examples_round_trip(path, tmp_path):
    system = load(path)
    again = tmp_path / "again.toml"
    again.write_text(dumps(system))
    assert load(again) == system
    assert from_dict(to_dict(system)) == system


def test_everything_round_trips(tmp_path):
    data = {
        "title": 'Quotes " and ü',
        "reference": "cage",
        "inertias": {name: {"J": 0.1, "drag": 0.3} for name in ("m", "cage", "l", "r")},
        "gears": {"g": {"between": ["m", "cage"], "ratio": {"value": 9.7, "lower": 9.0, "upper": 10.0}}},
        "differentials": {"d": {"cage": "cage", "left": "l", "right": "r"}},
        "shafts": {"s": {"between": ["l", "r"], "stiffness": "2 kN*m/rad", "damping": 0.2, "ratio": -1.5}},
        "inputs": {"u": {"on": "m"}},
        "sensors": {"w": {"measures": "speed", "of": "m", "uncertainty": "1 1/min"}},
        "mirror": {"pairs": [["l", "r"]]},
        "effects": [
            {"kind": "backlash", "at": "shafts.s", "gap": {"value": 0.02, "tolerance": 0.5}},
            {"kind": "coulomb_friction", "at": "inertias.m", "torque": 1.0, "torque_reverse": 2.0},
            {"kind": "wrong_parameter", "at": "gears.g.ratio", "value": 9.9},
            {"kind": "sensor_offset", "at": "sensors.w", "offset": "2 1/min"},
        ],
    }
    system = from_dict(data)
    path = tmp_path / "all.toml"
    path.write_text(dumps(system))
    assert load(path) == system
    assert system.parameters["shafts.s.stiffness"].value == 2000.0
    assert system.parameters["shafts.s.backlash.gap"].lower == pytest.approx(0.01)
    assert set(system.uncertain) == {"gears.g.ratio", "shafts.s.backlash.gap"}
    assert system.parameters["sensors.w.sensor_offset.offset"].value == pytest.approx(0.20944, rel=1e-4)
