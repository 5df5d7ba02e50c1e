"""Gearboxes with clutches against equations of the tests' own: rigid dry friction, as a complementarity problem."""

import json
import shutil
import tomllib
from pathlib import Path

import numpy as np
import pytest
from result_schema import check_schema
from simulation.own_gearbox import drawn

import rigmatch as rm
from matching.cli import main
from modelling.bed.bed import predicted_part
from modelling.bed.observer import emulated_modes
from modelling.bed.vehicle import cut
from modelling.errors import InputError
from modelling.linear.linearise import linearise
from modelling.model_file import from_dict, to_dict
from modelling.simulation.simulate import simulate

EXAMPLES = Path(__file__).parents[2] / "examples"
READ = ("motor_speed", "wheel_speed", "side_torque")
INPUTS = ("motor_torque", "clutch_1", "clutch_2")


def _errors(seed: int, deflection: float, ratio_off: float = 0.0) -> tuple[dict[str, float], dict[str, float]]:
    """Rms and largest error by reading, %, over the range of the own motion."""
    shift = drawn(np.random.default_rng(seed), deflection)
    own = shift.own.simulate(shift.time, shift.torques)
    model = from_dict(tomllib.loads(shift.toml))
    ratio = shift.own.ratios[1] * (1 + ratio_off)
    model = model.with_values({"gearboxes.box.ratio_2": ratio})
    ours = simulate(model, shift.time, dict(zip(INPUTS, shift.torques.T, strict=True)), start="rest")
    slip = np.abs(own["slip_1"])
    assert (slip[400:600] < 0.05).all()  # the low gear sticks before the shift
    assert slip[-1] > 5  # and slips after it, while the high gear sticks
    assert own["motor_speed"][-1] == pytest.approx(shift.own.ratios[1] * own["wheel_speed"][-1], rel=0.1)
    error = {name: (ours[name] - own[name]) / np.ptp(own[name]) for name in READ}
    rms = {name: 100 * float(np.sqrt(np.mean(each**2))) for name, each in error.items()}
    return rms, {name: 100 * float(np.abs(each).max()) for name, each in error.items()}


@pytest.mark.parametrize("seed", range(4100, 4102))
def test_a_shift_is_that_of_rigid_friction_that_sticks(seed):
    rms, largest = _errors(seed, 5e-4)
    assert max(rms.values()) < 0.2
    assert max(largest.values()) < 1.0


@pytest.mark.long
@pytest.mark.parametrize("seed", range(5200, 5240))
def test_many_shifts_are_those_of_rigid_friction_that_sticks(seed):
    rms, largest = _errors(seed, 5e-4)
    assert max(rms.values()) < 0.2
    assert max(largest.values()) < 1.0


def test_what_differs_from_rigid_friction_is_the_give_of_the_clutches():
    """Half as much give, half as much error; another ratio is seen."""
    (_, wide), (_, narrow) = (_errors(4100, deflection) for deflection in (2e-3, 1e-3))
    assert 0.35 < narrow["side_torque"] / wide["side_torque"] < 0.7
    rms, _ = _errors(4100, 5e-4, ratio_off=0.01)
    assert max(rms.values()) > 0.5


def test_clutches_that_slip_fast_and_close_are_simulated():
    """400 rad/s of slip over a deflection of 0.0005 rad: the first finer steps are too coarse, finer ones are taken."""
    shift = drawn(np.random.default_rng(885002), 5e-4)
    time = np.arange(0, 1.5, 1e-3)
    torques = np.stack([40.0 * (time < 1.2), 300 * np.clip((time - 1.2) / 0.1, 0, 1), 0 * time], axis=1)
    ours = simulate(
        from_dict(tomllib.loads(shift.toml)), time, dict(zip(INPUTS, torques.T, strict=True)), start="rest"
    )  # fmt: skip
    own = shift.own.simulate(time, torques)
    assert own["slip_1"].max() > 400
    for name in READ:
        assert np.abs(ours[name] - own[name]).max() < 2e-3 * np.ptp(own[name]), name


def test_in_a_gear_it_is_a_rigid_gear():
    """Modes of each gear are those of the file with that gear written in place of the gearbox."""
    shift = drawn(np.random.default_rng(7), 0.01)
    data = tomllib.loads(shift.toml)
    model = from_dict(data)
    del data["gearboxes"], data["inputs"]["clutch_1"], data["inputs"]["clutch_2"]
    for gear, ratio in enumerate(shift.own.ratios, 1):
        plain = from_dict(data | {"gears": {"box": {"between": ["input", "output"], "ratio": ratio}}})
        assert model.in_gear(gear) == plain
        wanted = rm.modes(plain).frequencies
        np.testing.assert_allclose(rm.modes(model.in_gear({"box": gear})).frequencies, wanted)
    with pytest.warns(UserWarning, match=r"gearboxes\.box: in gear 1"):
        assert rm.modes(model).frequencies[1] == pytest.approx(rm.modes(model.in_gear(1)).frequencies[1])
    with pytest.raises(InputError, match=r"gearboxes\.box: a linear model holds one gear"):
        linearise(model)
    with pytest.raises(InputError, match=r"gearboxes\.box: has no gear 3; 1 to 2"):
        model.in_gear(3)
    assert plain.in_gear(4) is plain


def test_a_file_is_written_as_it_was_read():
    model = from_dict(tomllib.loads(drawn(np.random.default_rng(8), 0.01).toml))
    assert from_dict(to_dict(model)) == model
    moved = model.with_values({"gearboxes.box.ratio_2": 5.0, "gearboxes.box.deflection": "1 deg"})
    assert moved["gearboxes.box"].ratios[1].value == 5.0
    assert moved["gearboxes.box.deflection"].value == pytest.approx(np.pi / 180)
    ranged = model.with_ranges({"gearboxes.box.ratio_1": (9, 15)})
    assert list(ranged.uncertain) == ["gearboxes.box.ratio_1"]


def test_effects_of_a_capacity_act_on_the_clutch():
    """A clutch that carries half as much, 20 ms late, is one under such a torque."""
    shift = drawn(np.random.default_rng(9), 2e-3)
    time, told = shift.time, shift.torques.copy()
    changed = told.copy()
    changed[:, 2] = 0.5 * np.interp(time - 0.02, time, told[:, 2])
    effects = [
        {"kind": "input_gain", "at": "inputs.clutch_2", "factor": 0.5},
        {"kind": "dead_time", "at": "inputs.clutch_2", "delay": 0.02},
    ]
    plain = from_dict(tomllib.loads(shift.toml))
    weak_and_late = from_dict(tomllib.loads(shift.toml) | {"effects": effects})
    found, wanted, other = (
        simulate(model, time, dict(zip(INPUTS, torques.T, strict=True)), start="rest")["motor_speed"]
        for model, torques in ((weak_and_late, told), (plain, changed), (plain, told))
    )
    np.testing.assert_allclose(found, wanted, atol=1e-3 * np.ptp(wanted))
    assert np.abs(other - wanted).max() > 0.05 * np.ptp(wanted)
    assert [part.name for part in weak_and_late.in_gear(1).inputs] == ["motor_torque"]
    assert not weak_and_late.in_gear(1).effects


BRAKE = '[[effects]]\nkind = "brake"\nat = "inputs.clutch_1"\ndeflection = 0.02'
GEAR = '[gears.box]\nbetween = ["input", "output"]\nratio = 2'
# what is replaced, by what, what the line must say
SPOILED = {
    "no deflection": ("deflection = 0.01", "", r"gearboxes\.box: 'deflection' is missing; give a number in rad"),
    "too stiff": ("deflection = 0.01", "deflection = 1e-5", r"gearboxes\.box\.deflection: 1e-05 .*0\.0005 rad or more"),
    "no ratios": ("ratios", "ratio", r"gearboxes\.box: 'ratio' .*did you mean 'ratios'"),
    "a ratio as text": ("ratios = [", "ratios = ['x', ", r"gearboxes\.box\.ratios"),
    "a ratio of 0": ("ratios = [", "ratios = [0.0, ", r"gearboxes\.box\.ratios: a ratio of 0"),
    "one clutch short": ('["clutch_1", "clutch_2"]', '["clutch_1"]', r"capacities: names 1 inputs for 2 ratios"),
    "a clutch twice": ('["clutch_1", "clutch_2"]', '["clutch_1", "clutch_1"]', r"'clutch_1' stands twice"),
    "a clutch that is none": ('"clutch_2"]', '"clutch_3"]', r"capacities: 'clutch_3' .*did you mean 'clutch_2'"),
    "a clutch elsewhere": ('[inputs.clutch_2]\non = "input"', '[inputs.clutch_2]\non = "wheel"',
                           r'inputs\.clutch_2: is the torque of a clutch of gearboxes\.box; .*on = "input"'),
    "an end that is none": ('between = ["input", "output"]', 'between = ["input", "outptu"]', r"did you mean 'output'"),
    "a brake": ("[gearboxes.box]", f"{BRAKE}\n[gearboxes.box]",
                r"inputs\.clutch_1: is the torque of a clutch and of a brake"),
    "a gear of its name": ("[gearboxes.box]", f"{GEAR}\n[gearboxes.box]",
                           r"gears\.box has the same name"),
}  # fmt: skip


@pytest.mark.parametrize("spoil", SPOILED)
def test_bad_input_is_one_line(spoil):
    old, new, says = SPOILED[spoil]
    text = drawn(np.random.default_rng(1), 0.01).toml
    assert old in text
    with pytest.raises(InputError, match=says) as told:
        from_dict(tomllib.loads(text.replace(old, new, 1)), "model.toml")
    assert "\n" not in str(told.value)


def test_a_capacity_below_zero_is_refused():
    shift = drawn(np.random.default_rng(1), 0.01)
    torques = dict(zip(INPUTS, (shift.torques * [1, -1, 1]).T, strict=True))
    with pytest.raises(InputError, match=r"inputs\.clutch_1: .* the torque of a clutch is 0 or more"):
        simulate(from_dict(tomllib.loads(shift.toml)), shift.time, torques, start="rest")


def test_modes_campbell_and_response_are_told_gear_by_gear(tmp_path, capsys):
    model, shift = tmp_path / "box.toml", drawn(np.random.default_rng(3), 0.01)
    model.write_text(shift.toml, encoding="utf-8")
    read = from_dict(tomllib.loads(shift.toml))
    assert main(["modes", str(model), "--out", str(tmp_path / "modes"), "--json"]) == 0
    printed = capsys.readouterr()
    result = json.loads(printed.out)
    assert not printed.err
    check_schema("modes", result)
    told = [result, *result["gears"]]
    assert [one["gear"] for one in told] == ["box in gear 1", "box in gear 2"]
    for gear, one in enumerate(told, 1):
        wanted = rm.modes(read.in_gear(gear)).frequencies
        np.testing.assert_allclose([mode["frequency"] for mode in one["modes"]], wanted)
    assert (tmp_path / "modes" / "gear_2" / "modes.svg").exists()
    assert main(["modes", str(model), "--change", "gearboxes.box.ratio_2=7"]) == 0
    first, second = capsys.readouterr().out.split("box in gear 2:")
    assert "with the changes" in second
    assert "with the changes" not in first
    speed = ["--speed", "600:6000:20 1/min"]
    for command in (["campbell"], ["response", "--torques", "motor_torque:2=10"]):
        assert main([command[0], str(model), *speed, *command[1:], "--out", str(tmp_path / command[0])]) == 0
        said = capsys.readouterr()
        assert said.out.index("box in gear 1:") < said.out.index("box in gear 2:")
        assert not said.err
        assert (tmp_path / command[0] / "gear_2" / "report.html").exists()


def test_a_case_is_in_the_gear_whose_clutch_is_closed_at_the_operating_point(tmp_path):
    """Gear 1 by default; the controller that does not know the specimen ends at the gearbox."""
    for example in ("gear_change", "drive_away"):
        shutil.copytree(EXAMPLES / example, tmp_path / example)
    file = tmp_path / "gear_change" / "case.toml"
    before, _, rest = file.read_text(encoding="utf-8").partition("[[drives]]")
    text = (before + rest[rest.index("[[targets]]") :]).replace('"car.toml"', '"../drive_away/vehicle.toml"')
    rig = file.parent / "gearbox.toml"
    rig.write_text(rig.read_text(encoding="utf-8").replace("[10.05, 6.5]", "[12.0, 7.5]"), encoding="utf-8")

    def read(point: str = ""):
        file.write_text(text.replace("[operating_point]", f"[operating_point]\n{point}"), encoding="utf-8")
        return rm.load_case(file)

    case = read("clutch_high = 400")
    assert case.rig["gears.box"].ratio.value == 7.5
    assert "rig: gearboxes.box is in gear 2, its clutch locked" in case.notes
    assert any("ends at gears.box" in note for note in case.notes)
    with pytest.raises(InputError, match=r"operating_point: closes the clutches of 2 gears of gearboxes\.box"):
        read("clutch_high = 400\nclutch_low = 10")
    assert read().rig["gears.box"].ratio.value == 12.0
    assert any(
        "motor turns 10.05 times as fast as differential in the vehicle and 12 times on the rig" in note
        for note in read().notes
    )
    # the vehicle has no inertia behind its gear: it is cut at its own, whatever stands behind the gearbox of the rig
    plain = rm.load_case(tmp_path / "drive_away" / "case.toml")
    of_both = [
        emulated_modes(residual, 1e-3, predicted_part(rig, residual, case.loop))
        for rig in (case.rig, plain.rig)
        for residual in [cut(case.vehicle, rig)]
    ]
    assert of_both[0]
    np.testing.assert_allclose(*of_both)
