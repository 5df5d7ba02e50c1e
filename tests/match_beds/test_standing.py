"""A standing vehicle stands on the bed, too: coarse encoders and zeros of flanges, judged by a bed of its own."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from match_beds.free_play import Train, own_values
from match_beds.other_beds import front_axle, geared_rotor, light_vehicle, stiff_half_shafts, two_axles, write_models
from match_beds.standing import largest_motion
from plant.marks import needs_compiler
from scipy.linalg import expm

from matching.match import minutes as judge
from matching.match.case_file import load_case
from matching.match.exported import exported_controller
from matching.match.imperfections import Imperfection
from matching.match.match import match
from matching.match.minutes import Minute, Minutes, MinuteSettings

APART = Path(__file__).parent / "coarse_encoders"  # an open differential, encoders of 512 counts
SETTINGS = MinuteSettings()
ALLOWED = 1.0  # rad/s beyond the vehicle's own motion


@pytest.fixture(scope="module")
def apart():
    return load_case(APART / "case.toml")


def flange_noise(case):
    sensors = {sensor.name: sensor for sensor in case.rig.sensors}
    return np.array([sensors[one.torque_sensor].uncertainty for one in case.loop.dynamometers])


def vehicle_motion(case, rows, zeros, seconds):
    """rad/s (b,) by which a cut of each vehicle turns under torques (b, k) at its cuts: exact steps."""
    found = []
    for row, torques in zip(rows, zeros, strict=True):
        train = Train(case.vehicle, own_values(row, case.vehicle, "rig.") | own_values(row, case.vehicle, "vehicle."))
        cuts = {one.shaft: one.vehicle_end for one in case.residual_vehicle.interfaces}
        ends = [cuts[one.follows] for one in case.loop.dynamometers]
        push = sum(torque * train.pushed(train.basis.T @ train.at(end)) for end, torque in zip(ends, torques))
        size, step = len(train.A), 0.02
        block = np.zeros((size + 1,) * 2)
        block[:size, :size], block[:size, size] = train.A, push
        grown, x, most = expm(block * step), np.zeros(size), 0.0
        speeds = np.stack([np.concatenate([np.zeros(train.n), train.at(end) @ train.basis, np.zeros(train.m)])
                           for end in ends])  # fmt: skip
        for _ in range(round(seconds / step)):
            x = grown[:size, :size] @ x + grown[:size, size]
            most = max(most, np.abs(speeds @ x).max())
        found.append(most)
    return np.array(found)


@needs_compiler
def test_zeros_of_flanges_turn_the_wheels_as_on_a_bed_of_its_own_and_by_less_than_walking_pace(apart, monkeypatch):
    """±0.35 N·m, nothing else: they turned the wheels of an open differential against each other by 14 rad/s."""
    controller, u = exported_controller(apart), flange_noise(apart)
    signs = np.array([[1.0, 1.0], [1.0, -1.0]])
    rows = [judge._Row("at rest", Imperfection(""), False, each) for each in signs]
    stepped = replace(SETTINGS, seconds=20.0, zero_s=0.0, pulse=0.0)
    own = np.array(["torque" in name for name in controller.law.sensors]) * np.r_[u, np.zeros(3)]
    made = judge._errors

    def without_noise(*arguments):
        nothing = np.zeros((len(rows), len(own)))
        return replace(made(*arguments), noise=nothing, count=nothing)

    monkeypatch.setattr(judge, "_errors", without_noise)
    found = judge._played(apart, controller, rows, 0, stepped, own)
    silent = replace(apart, rig=replace(apart.rig, sensors=tuple(
        replace(sensor, uncertainty=1e-300) for sensor in apart.rig.sensors)))  # fmt: skip
    wanted = largest_motion(silent, controller, [{}, {}], signs * u, 20.0, np.zeros(len(own)), 0)
    moved = judge._largest(found.rotors).max(axis=0)
    assert moved == pytest.approx(wanted, rel=0.02)
    allowed = ALLOWED + vehicle_motion(apart, [{}, {}], signs * u, 20.0)
    assert (wanted < allowed).all()


def test_a_bed_that_turns_names_what_turns_it_and_a_value_that_would_do(apart):
    """Encoders of 30 rad/s: the noise, not the flanges, and a smaller uncertainty with which the bed was run."""
    rig = replace(apart.rig, sensors=tuple(
        replace(sensor, uncertainty=30.0) if sensor.name.startswith("rotor") else sensor for sensor in apart.rig.sensors
    ))  # fmt: skip
    coarse = replace(apart, rig=rig)
    fine_controller = exported_controller(apart)  # as a tuner leaves it that does not know of the encoder
    found = judge.minutes(coarse, fine_controller, 1, replace(SETTINGS, seconds=10.0, drawn=1))
    (standing,) = [one for one in found.judgements if one.what == "standing"]
    assert standing.size > standing.allowed >= ALLOWED
    assert standing.cause == "sensors.rotor_l_speed.uncertainty"
    (name, value) = standing.remedy
    assert name == standing.cause
    assert 0 < value < 30.0
    (finding,) = [one for one in found.findings if one.cause == "standstill"]
    assert "an encoder of" in finding.sentence()
    assert "does not stand" in finding.sentence()


def test_what_stands_is_no_limit_and_what_was_not_run_neither():
    still = Minutes(60.0, (Minute("at rest", 60.0, "", 0.2, 0.2, 1.1), Minute("at speed", 60.0, "", 7.0)))
    assert still.judgements == still.findings == still.moved == []
    moved = replace(still, runs=(*still.runs, Minute("at rest on drawn bed 1", 60.0, "", 5.0, 5.0, 1.1)))
    (found,) = moved.judgements
    assert (found.what, found.size, found.allowed, found.beds, found.of) == ("standing", 5.0, 1.1, 1, 2)


def coarse(number):
    """Ten beds of five kinds, encoders of 256 to 2048 counts, with zeros of 0.2 to 1.5 N·m."""
    random = np.random.default_rng(7100 + number)
    kind = (front_axle, stiff_half_shafts, light_vehicle, geared_rotor, two_axles)[number % 5]
    vehicle, rig, case = kind()
    counts, zero = int(2 ** random.integers(8, 12)), float(random.uniform(0.2, 1.5))
    step = case["loop"].get("sample_time", 1e-3)
    for name, sensor in rig["sensors"].items():
        if name.startswith("rotor"):
            sensor["uncertainty"] = 2 * np.pi / counts / step / np.sqrt(6)
        if name.startswith("flange"):
            sensor["uncertainty"] = zero
    return vehicle, rig, case, counts, random


@pytest.mark.long
@needs_compiler
@pytest.mark.parametrize("number", range(10))
def test_what_is_matched_stands_for_two_minutes(number, tmp_path):
    vehicle, rig, data, counts, random = coarse(number)
    data["limits"]["opened_shafts"] = False  # shafts without play: standing alone is asked
    case = load_case(write_models(vehicle, rig, data, tmp_path, random))
    result = match(case, ordering=False)
    standing = [one for one in result.minutes.judgements if one.what == "standing"]
    if standing:
        assert result.status == "limited"
        assert standing[0].cause
        return
    tuned, k = result.tuned, len(case.loop.dynamometers)
    rows = [{}, {}, *(tuned.uncertainty.at(at) for at in random.uniform(-1, 1, (2, len(tuned.uncertainty.uncertain))))]
    against = np.where(np.arange(k) % 2 == 0, 1.0, -1.0)
    zeros = np.stack([np.ones(k), against, *random.choice([-1.0, 1.0], (2, k))]) * flange_noise(tuned)
    controller = exported_controller(tuned)
    speeds = [one.speed_sensor for one in tuned.loop.dynamometers]
    encoders = np.array([2 * np.pi / counts if name in speeds else 0.0 for name in controller.law.sensors])
    moved = largest_motion(tuned, controller, rows, zeros, 120.0, encoders, number)
    ratio = np.abs(judge._rotor_over_cut(tuned)).max()
    assert (moved <= ratio * (ALLOWED + vehicle_motion(tuned, rows, zeros, 120.0))).all()
