"""Drives of a case in which a gearbox shifts, beside a car, a bed and a gearbox of the tests' own (``own_bed.c``)."""

import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from driving.own_bed import NOISE, Beside
from driving.test_shifts import STEP, Shift, drawn, played, shifting
from needs import compiles

from matching.bed.simulated_bed import bed_of
from matching.match.case import Drive
from matching.match.case_file import case_files, load_case
from matching.match.driving import DRIVING, driving
from matching.match.exported import exported_controller
from matching.match.operating_range import at_vehicle_speed
from matching.match.shifts import in_gears
from modelling.bed.manoeuvres import RecordedTorque, TipIn
from modelling.errors import InputError
from modelling.fmu.export import block, fmu
from modelling.linear.steady_motion import operating_motion, speeds_of, torques_of
from modelling.model_file import load
from modelling.simulation.simulate import simulate

EXAMPLE = Path(__file__).parents[2] / "examples" / "gear_change"
PLANNED = 1  # no bed is drawn but one
NOISE_LEAVES = 0.0025  # of the range: the noise of both beds has its own course


@pytest.fixture
def folder(tmp_path):
    return shutil.copytree(EXAMPLE, tmp_path / "gear_change")


def with_ratios(folder, low, high, specimen="unknown"):
    """The example with these ratios of car and bed, the noise of the own bed's sensors, without drives."""
    own = folder.parent / f"{low}_{high}"
    shutil.copytree(folder, own)
    for name in ("car.toml", "gearbox.toml"):
        text = re.sub(r"ratios = .*", f"ratios = [{low}, {high}]", (own / name).read_text(encoding="utf-8"))
        for sensor, noise in ((r"flange_\w+_torque", NOISE[0]), (r"(?:rotor_\w+|motor)_speed", NOISE[1])):
            counts = "\ncounts = 8192" if "speed" in sensor else ""
            text = re.sub(rf"(\[sensors.{sensor}\][^\[]*?uncertainty = )[^\n]*", rf"\g<1>{noise}{counts}", text)
        (own / name).write_text(text, encoding="utf-8")
    text = (own / "case.toml").read_text(encoding="utf-8").replace('"unknown"', f'"{specimen}"')
    before, rest = text.split("[[drives]]", 1)
    (own / "case.toml").write_text(before + rest[rest.index("[[targets]]") :], encoding="utf-8")
    return load_case(own / "case.toml")


def judged(case, shift):
    """The drive of an own shift, as the case judges it, and the inputs of the own car; one bed beside the planned."""
    car = shifting(0.003, shift)
    u, part = shift.played(car)
    time, names = np.arange(len(u)) * STEP, ("clutch_low", "clutch_high") if shift.up else ("clutch_high", "clutch_low")
    torques = {"motor_torque": u[:, 0] - u[0, 0], names[0]: u[:, 8], names[1]: u[:, 9]}
    made = {name: RecordedTorque.of(time, torque) for name, torque in torques.items()}
    drive = Drive("own shift", shift.kmh / 3.6, made, case.gearboxes.begun_in(made, "drive"))
    about = replace(case.operating_range, drives=(drive,))
    return driving(replace(case, operating_range=about), settings=replace(DRIVING, drawn=PLANNED)), part


def compared(case, shift, beside):
    """Vehicle beside the own car, rms over range (2,), and the errors on the bed: the case's and the own one's."""
    found, part = judged(case, shift)
    assert not found.not_run
    result = found.drives[0]
    run, error, _, faults = played(beside, 0.003, shift)
    assert not faults
    assert not result.errors.fault
    sides = [result.traces[1][f"side_{side}_torque"] for side in ("left", "right")]
    car = run.car[:, 1:3] - run.car[0, 1:3]
    ranges = np.ptp(car[part], axis=0)
    vehicle = np.stack([vehicle for vehicle, _, _ in sides], axis=1)[: len(car)]
    apart = np.sqrt(np.mean((vehicle[part] - car[part]) ** 2, axis=0)) / ranges
    bed = np.stack([bed for _, bed, _ in sides], axis=1)[: len(car)]
    own = np.sqrt(np.mean((bed[part] - vehicle[part]) ** 2, axis=0)) / np.ptp(vehicle[part], axis=0)
    print(f"{shift.kind}: vehicle {100 * apart.max():.2f} %, error {100 * own.max():.2f} %, own {100 * error:.2f} %")
    return apart.max(), own.max(), error


@compiles
@pytest.mark.parametrize("kind", ["power-on up", pytest.param("power-off down", marks=pytest.mark.long)])
def test_a_shift_is_judged_as_an_own_bed_shows_it(kind, folder, tmp_path):
    shift = Shift(kind)
    case = with_ratios(folder, shift.low, shift.high)
    vehicle, error, own = compared(case, shift, Beside(exported_controller(case), tmp_path / "beside"))
    assert vehicle <= 0.01
    assert error == pytest.approx(own, rel=0.3, abs=NOISE_LEAVES)


@compiles
@pytest.mark.long
def test_drawn_shifts_are_judged_as_an_own_bed_shows_them(folder, tmp_path):
    """Any kind, speed, ratio, torque and length."""
    random, found = np.random.default_rng(660128), []
    for number in range(12):
        shift = drawn(random)
        case = with_ratios(folder, shift.low, shift.high)
        found.append(compared(case, shift, Beside(exported_controller(case), tmp_path / str(number))))
    vehicle, error, own = np.array(found).T
    assert vehicle.max() <= 0.015
    np.testing.assert_allclose(error, own, rtol=0.3, atol=NOISE_LEAVES)


@compiles
@pytest.mark.long
def test_a_controller_that_holds_one_gear_ends_and_the_reason_is_said(folder):
    shift = Shift("power-on up")
    found, _ = judged(with_ratios(folder, shift.low, shift.high, "known"), shift)
    said = " ".join(found.sentences(1500.0))
    assert "leaves emulation" in said
    assert "its model holds box in one gear" in said


def test_drives_that_shift_are_written_and_read_again(folder, tmp_path):
    case = load_case(folder / "case.toml")
    assert [dict(drive.gears) for drive in case.operating_range.drives] == [{}, {"box": 1}, {"box": 2}]
    for name, text in case_files(case).items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    again = load_case(tmp_path / "case.toml")
    assert again.rig.gears == case.rig.gears
    assert [part.name for part in again.gearboxes.rig.inputs] == [part.name for part in case.gearboxes.rig.inputs] or (
        sorted(again.gearboxes.rig.capacities) == sorted(case.gearboxes.rig.capacities)
    )
    time = np.linspace(0, 3, 50)
    for one, other in zip(case.operating_range.drives, again.operating_range.drives, strict=True):
        assert one.gears == other.gears
        for name, torque in one.torques.items():
            np.testing.assert_allclose(torque.torque(time), other.torques[name].torque(time), atol=1e-9)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("clutch_low = [{ to = 400, hold = 0.65 }", "clutch_low = [{ to = 0, hold = 0.65 }", "closes 0 clutches"),
        ("{ to = 0, hold = 0.7 }, { to = 100", "{ to = 10, hold = 0.7 }, { to = 100", "closes 2 clutches"),
        ("{ to = 0, over = 0.15, hold = 2 }]\nclutch_high", "{ to = -9, over = 0.15 }]\nclutch_high", "reaches -9 N·m"),
    ],
)
def test_bad_clutch_torques_are_one_line(folder, old, new, said):
    file = folder / "case.toml"
    text = file.read_text(encoding="utf-8")
    assert old in text
    file.write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(InputError) as fault:
        load_case(file)
    assert said in str(fault.value)
    assert "drives[2]" in str(fault.value)


def test_the_vehicle_needs_the_same_gearbox(folder):
    file = folder / "case.toml"
    text = file.read_text(encoding="utf-8").replace('"car.toml"', f'"{EXAMPLE.parent / "drive_away" / "vehicle.toml"}"')
    file.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match="clutch_low: is a clutch of the rig alone"):
        load_case(file)


def test_a_clutch_carries_what_it_does_from_the_begin_on(folder):
    case = load_case(folder / "case.toml")
    step = TipIn(amplitude=400, at=0.0, rise_time=0.0, duration=1.0)
    assert case.gearboxes.begun_in({"clutch_high": step}, "drive") == {"box": 2}


CONVERTER = """
[inertias.turbine]
J = 0.02

[gearboxes.converter]
between = ["motor", "turbine"]
ratios = [1.0]
capacities = ["lock_up"]
deflection = 0.02
settling = 2e-5

[gearboxes.converter.converter]
speed_ratios = [0.0, 0.4, 0.7, 0.87, 1.0, 1.4]
capacity_factors = [2.4e-3, 2.3e-3, 1.9e-3, 1.3e-3, 0.0, -1.1e-3]
torque_ratios = [2.1, 1.6, 1.2, 1.0, 1.0, 1.0]

[inputs.lock_up]
on = "motor"
"""
AWAY = """
[[drives]]
title = "away on the converter, then locked"
motor_torque = [{ to = 0, hold = 0.2 }, { to = 60, over = 0.2, hold = 4 }]
lock_up = [{ to = 0, hold = 3 }, { to = 150, over = 0.5, hold = 1 }]
clutch_low = [{ to = 400, hold = 4 }]

"""
DOGS = """
[[drives]]
title = "the motor brings the teeth to one speed"
vehicle_speed = "50 km/h"
motor_torque = [
    { to = 0, hold = 0.2 }, { to = 80, over = 0.1, hold = 0.4 }, { to = 0, over = 0.1, hold = 0.05 },
    { to = -42, over = 0.05, hold = 0.28 }, { to = 0, over = 0.05, hold = 0.2 }, { to = 80, over = 0.2, hold = 1.5 },
]
clutch_low = [{ to = 1, hold = 0.82 }, { to = 0, hold = 3 }]
clutch_high = [{ to = 0, hold = 0.9 }, { to = 1, hold = 3 }]

"""


def changed(folder, of_models, drive):
    """The example with other gearboxes and one drive of its own."""
    for name in ("car.toml", "gearbox.toml"):
        (folder / name).write_text(of_models((folder / name).read_text(encoding="utf-8")), encoding="utf-8")
    before, rest = (folder / "case.toml").read_text(encoding="utf-8").split("[[drives]]", 1)
    (folder / "case.toml").write_text(before + drive + rest[rest.index("[[targets]]") :], encoding="utf-8")
    return load_case(folder / "case.toml")


def with_converter(text):
    before, mesh = text.split("[shafts.gear_mesh]")
    return before + "[shafts.gear_mesh]" + mesh.replace('["motor", "gearbox"]', '["turbine", "gearbox"]', 1) + CONVERTER


def with_dogs(text):
    return re.sub(r"settling = .*", 'settling = 2e-4\nengages_below = "8 rad/s"', text)


@compiles
@pytest.mark.long
@pytest.mark.parametrize(
    ("of_models", "drive", "begins"),
    [(with_converter, AWAY, {"converter": 0, "box": 1}), (with_dogs, DOGS, {"box": 1})],
)
def test_converters_and_dog_clutches_are_driven_too(folder, of_models, drive, begins):
    """The vehicle is beside one that is simulated to a tolerance, in steps of its own."""
    case = changed(folder, of_models, drive)
    (own,) = case.operating_range.drives
    assert dict(own.gears) == begins
    found = driving(case, settings=replace(DRIVING, drawn=PLANNED))
    assert not found.not_run
    result = found.drives[0]
    assert not result.errors.fault
    assert result.errors.planned <= 0.015
    live = case.gearboxes.vehicle
    time, traces = result.traces
    at_begin = at_vehicle_speed(in_gears(case, own.gears).vehicle, case.rig, case.operating_range, own.vehicle_speed)
    torques, speeds = torques_of(at_begin), speeds_of(at_begin)
    u = {part.name: np.full(len(time), torques.get(part.name, 0.0)) for part in live.inputs}
    for name, torque in own.torques.items():
        u[name] = u[name] + torque.torque(np.maximum(time, 1e-6))
    start = operating_motion(at_begin.shifting(live, {name: float(u[name][0]) for name in live.capacities})).state
    simulated = simulate(live, time, u, start=start if any(speeds.values()) else None)
    for name in ("side_left_torque", "motor_speed"):
        wanted = simulated.readings[name] - simulated.readings[name][0]
        apart = np.sqrt(np.mean((traces[name][0] - wanted) ** 2)) / np.ptp(wanted)
        print(f"{name}: {100 * apart:.3f} %")
        assert apart <= 0.005


@compiles
def test_the_fmu_of_a_bed_stays_in_the_gear_of_the_case(folder, tmp_path):
    """Its clutches are inputs that no controller gives."""
    pytest.importorskip("fmpy")
    bed = tmp_path / "bed.fmu"
    bed.write_bytes(fmu(block([load(folder / "gearbox.toml")], "bed", "bed"), "2.0").content)
    file = folder / "case.toml"
    text = file.read_text(encoding="utf-8")
    before, rest = text.split("[[drives]]", 1)
    without = before + rest[rest.index("[[targets]]") :]
    for case, ratio in (
        (text, 10.05),
        (without.replace("[operating_point]", "[operating_point]\nclutch_high = 500"), 6.5),
    ):
        file.write_text(case, encoding="utf-8")
        with bed_of(bed, load_case(file)) as slave:
            slave.begin(0.0)
            torques = np.array([5.0 * name.startswith("motor") for name in slave.inputs])
            for _ in range(300):
                slave.step(torques, 1e-3)
            read = dict(zip(slave.sensors, slave.readings(), strict=True))
        assert read["motor_speed"] > 1.0
        assert read["motor_speed"] == pytest.approx(ratio * read["rotor_left_speed"], rel=0.05)
    file.write_text(without, encoding="utf-8")
    with pytest.raises(InputError, match="has a clutch 'clutch_low' that nothing closes"):
        bed_of(bed, load_case(file))
