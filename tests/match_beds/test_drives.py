"""Drives as they stand on beds, under an observer: each ends matched and verified, or limited for a true reason.

An engine's firing orders as a measured torque with a brake at the wheel; a launch from standstill through a lash that
the drive's own torque closes; one dynamometer in the place of a whole axle with its differential.
"""

import numpy as np
import pytest
from small_bed import AXLE, CASE, RIG, VEHICLE

from matching.match.case_file import load_case
from matching.match.match import match
from matching.match.variables import SearchSettings

pytestmark = pytest.mark.long
EFFORT = SearchSettings(drawn=2, rounds=2, steps=12, emulated=0)


def load(folder, vehicle=VEHICLE, rig=RIG, case=CASE):
    for name, text in (("vehicle.toml", vehicle), ("rig.toml", rig), ("case.toml", case)):
        (folder / name).write_text(text)
    return load_case(folder / "case.toml")


def matched(case):
    return match(case, beds=4, settings=EFFORT)


def reasons_are_true(result):
    """Status and limits agree with the figures that they speak of."""
    beds, error = result.robust.beds, result.response_error
    holds = [
        all(target.met for target in result.targets), beds.stable == beds.damped == beds.drawn,
        beds.worst.damping_ratio > 0, error.after <= result.case.tolerance,
        error.unmeasured <= result.case.unmeasured_tolerance, result.verification.modulus_margin >= 0.5,
        result.robust.loop.largest_rolled_off <= 0.5, max(result.robust.loop.command_noise.values()) <= 30,
    ]  # fmt: skip
    return result.verification.stable and (result.status == "matched") == (all(holds) and not result.limits)


def test_firing_orders_and_a_brake(tmp_path):
    """A four-cylinder engine's second and fourth order at 900 1/min, 30 and 60 Hz; a brake acts behind the cut."""
    time = np.arange(0, 2, 1e-3)
    torque = 40 * (1 - np.exp(-time / 0.2)) * (1 + np.sin(2 * np.pi * 30 * time) + 0.4 * np.sin(2 * np.pi * 60 * time))
    rows = "\n".join(f"{t:.3f},{own:.4f}" for t, own in zip(time, torque, strict=True))
    (tmp_path / "orders.csv").write_text(f"time [s],motor_torque [N*m]\n{rows}\n")
    brake = '[manoeuvre.brake]\nkind = "kick"\namplitude = -60\nduration = 2\n'
    case = CASE.replace('kind = "tip_in"\namplitude = 50\nduration = 2\n', f'file = "orders.csv"\n{brake}')
    case = case.replace(
        '    { input = "road"', '    { input = "brake", sensor = "side_torque" },\n    { input = "road"'
    )
    result = matched(load(tmp_path, VEHICLE + '[inputs.brake]\non = "wheel"\n', case=case))
    assert reasons_are_true(result), result.limits
    assert result.status == "matched", result.limits
    table = result.in_time
    assert table.rows[0].measured["side_torque"] < 0.01  # both orders, of which one lies above the band
    assert table.rows[-1].largest() < 0.2


def test_launch_from_standstill_through_a_lash(tmp_path):
    lash = '[[effects]]\nkind = "backlash"\nat = "shafts.side"\ngap = 0.03\n'
    case = CASE.replace('kind = "tip_in"\namplitude = 50', 'kind = "drive_away"\namplitude = 50\ncreep = 8')
    result = matched(load(tmp_path, VEHICLE + lash, RIG + lash, case))
    assert reasons_are_true(result), result.limits
    assert result.status == "limited"  # at standstill nothing loads the lash, so the linear models do not hold there
    assert any("lash of shafts.side is open at standstill" in words for words in result.limits)
    assert result.in_time.rows[0].measured["side_torque"] < 0.05  # in time the bed follows the vehicle through it


def test_one_dynamometer_for_a_whole_axle(tmp_path):
    result = matched(load(tmp_path, AXLE, case=CASE.replace("mode = 2", "mode = 3")))  # two motions are rigid
    assert reasons_are_true(result), result.limits
    assert result.status == "matched", result.limits
    assert result.targets[0].identified == pytest.approx(result.targets[0].vehicle, rel=0.02)
    assert result.in_time.rows[0].largest() < 0.01
