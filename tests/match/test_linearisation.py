"""Lash and dry friction: linear about a loaded, moving operating point, refused or said where there is none."""

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tomli_w

from matching.match.case_file import load_case
from matching.match.loop import linear_bed
from matching.match.match import match
from matching.match.problem import check_sliding, opened_lashes, unloaded_lashes
from matching.match.verify import simulate_case
from modelling.errors import InputError
from modelling.linear.steady_motion import torques_of
from modelling.modal.modes import modes

COMPACT = Path(__file__).parents[2] / "examples" / "compact_bev"
LASH = {"kind": "backlash", "at": "shafts.rotor_shaft", "gap": 0.02}
FRICTION = {"kind": "coulomb_friction", "at": "inertias.motor", "torque": 15.0}
GENTLE = {"proportional_gain": 20.0, "integral_gain": 20.0, "torque_feed_forward": 0.2, "lead_time": 0.003}


def compact(folder, *effects, moving=True, **entries):
    """compact_bev with further effects in vehicle and rig; or at standstill."""
    for name in ("vehicle", "rig"):
        model = tomllib.loads((COMPACT / f"{name}.toml").read_text())
        model["effects"] = [*model.get("effects", []), *effects]
        (folder / f"{name}.toml").write_text(tomli_w.dumps(model))
    data = tomllib.loads((COMPACT / "case.toml").read_text())
    data["operating_point"] |= entries
    if not moving:
        del data["operating_point"]
    (folder / "case.toml").write_text(tomli_w.dumps(data))
    case = load_case(folder / "case.toml")
    return replace(case, loop=case.loop.with_values(GENTLE))


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    return compact(tmp_path_factory.mktemp("plain"))


@pytest.fixture(scope="module")
def hard(tmp_path_factory):
    return compact(tmp_path_factory.mktemp("hard"), LASH, FRICTION)


def test_under_load_and_in_motion_both_are_as_if_they_were_not_there(plain, hard):
    """The motor holds 15 N·m of friction more; the loop of the optimiser and the bodies are the same."""
    assert torques_of(hard.vehicle)["motor_torque"] == pytest.approx(torques_of(plain.vehicle)["motor_torque"] + 15)
    for one, other in zip(
        (linear_bed(plain).rig, *linear_bed(plain).residual),
        (linear_bed(hard).rig, *linear_bed(hard).residual),
        strict=True,
    ):
        np.testing.assert_allclose(other.space.A, one.space.A, rtol=1e-7, atol=1e-6)


def test_the_simulation_begins_there(plain, hard):
    """A tip-in that keeps the lash closed moves the nonlinear bed as the linear one; it starts without a bump."""
    time = np.arange(300) * plain.loop["sample_time"]
    torques = {"motor_torque": 20 * np.clip((time - 0.02) / 0.05, 0, 1)}
    traces = []
    for case in (plain, hard):
        traces.append(simulate_case(linear_bed(case), torques))
    for name in ("motor_speed", "side_left_torque", "dynamometers.left.torque", "dynamometers.left.speed"):
        wanted = traces[0].matched[name]
        np.testing.assert_allclose(traces[1].matched[name], wanted, atol=2e-4 * np.ptp(wanted))
    assert np.ptp(traces[1].matched["dynamometers.left.torque"][:40]) < 1e-6 * np.ptp(wanted) + 1e-6
    assert opened_lashes(hard, traces[1]) == []
    released = replace(traces[1], matched=traces[1].matched | {"shafts.rotor_shaft.torque": -100 * time})
    (sentence,) = opened_lashes(hard, released)
    assert "shafts.rotor_shaft" in sentence


def test_friction_at_standstill_is_refused(tmp_path):
    case = compact(tmp_path, FRICTION, moving=False)
    with pytest.raises(InputError, match=r"case\.toml: operating_point: the dry friction of inertias\.motor sticks"):
        match(case)
    check_sliding(compact(tmp_path, FRICTION))


def test_a_lash_without_load_is_said(tmp_path):
    """At standstill; and in motion where the motor torque only carries its own drag."""
    (sentence,) = unloaded_lashes(compact(tmp_path, LASH, moving=False))
    assert "shafts.rotor_shaft is open at standstill" in sentence
    assert unloaded_lashes(compact(tmp_path, LASH)) == []
    coasting = compact(tmp_path, LASH, motor_torque=0.002 * 9.7 * 8.0, vehicle_speed=8.0 * 0.31)
    (sentence,) = unloaded_lashes(coasting)
    assert "open at the operating point" in sentence
    loaded = [mode.frequency for mode in modes(compact(tmp_path, LASH).vehicle)]
    np.testing.assert_allclose([mode.frequency for mode in modes(coasting.vehicle)], loaded, rtol=1e-6, atol=1e-6)


def test_an_overrun_closes_the_other_flank(tmp_path):
    """The motor brakes with 20 N·m at 30 km/h, pushed by a slope: the lash lies on its reverse flank."""
    case = compact(tmp_path, LASH, motor_torque=-20)
    assert unloaded_lashes(case) == []
    torques = torques_of(case.vehicle)
    body, wheel = 30 / 3.6 / 0.31, 2 * 9.7 * 20  # the slope drives what the motor and the drags take
    assert torques["road_torque"] == pytest.approx(wheel / 2 + 0.6 * body + 9.7**2 * 0.002 * body, rel=1e-3)
    plain = compact(tmp_path)
    np.testing.assert_allclose(linear_bed(case).rig.space.A, linear_bed(plain).rig.space.A, rtol=1e-7, atol=1e-6)


def test_a_delay_that_both_have_changes_no_response(plain, tmp_path):
    """A motor torque that acts 4 ms late on the road and on the bed: the same loop, and a sentence."""
    late = {"kind": "dead_time", "at": "inputs.motor_torque", "delay": "4 ms"}
    case = compact(tmp_path, late)
    assert case.rig == plain.rig
    assert case.residual_vehicle == plain.residual_vehicle
    (note,) = case.notes
    assert "inputs.motor_torque is delayed by 4 ms" in note


def test_a_delay_of_the_rig_alone_is_refused(tmp_path):
    compact(tmp_path)
    rig = tomllib.loads((tmp_path / "rig.toml").read_text())
    rig["effects"] = [{"kind": "dead_time", "at": "inputs.motor_torque", "delay": 0.004}]
    (tmp_path / "rig.toml").write_text(tomli_w.dumps(rig))
    with pytest.raises(InputError, match=r"inputs\.motor_torque: is delayed by 4 ms, in the vehicle by 0 ms"):
        load_case(tmp_path / "case.toml")
