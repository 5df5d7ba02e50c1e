"""Dynamometers of two sizes: each with a torque limit, and a noise of its command, of its own."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from matching.cli import main
from matching.match.case_file import case_files, load_case
from matching.match.demands import demands, rig_values
from matching.match.exported import exported_controller
from matching.match.imperfections import BedRun, Imperfection, bed_motions
from matching.match.requirements import requirements
from matching.match.robustness import not_kept
from matching.match.verify import verify
from modelling.errors import InputError
from modelling.running.controllers import unsupervised

ROAD = Path(__file__).parents[2] / "examples" / "road_to_rig"


def written(folder, limits="", dynamometer=""):
    """The reference with further keys of [limits], and of its left dynamometer."""
    for name in ("vehicle.toml", "rig.toml"):
        (folder / name).write_text((ROAD / name).read_text())
    text = (ROAD / "observer.toml").read_text().replace("[limits]\n", f"[limits]\n{limits}\n")
    (folder / "case.toml").write_text(text.replace("[dynamometers.left]\n", f"[dynamometers.left]\n{dynamometer}\n"))
    return folder / "case.toml"


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    """1500 N·m for both, 300 N·m for the left one; 20 N·m of noise for both."""
    return load_case(written(tmp_path_factory.mktemp("own"), '"dynamometers.left.torque" = "0.3 kN*m"'))


def test_a_limit_of_one_dynamometer_is_the_others_no_more(case):
    assert case.limits_of("torque").tolist() == [300.0, 1500.0]
    required = requirements(case)
    assert required.command_noise == (20.0, 20.0)
    assert required.sensor_offset == (6.0, 30.0)  # 2 % of each torque
    unstated = replace(case, limits={name: value for name, value in case.limits.items() if name != "command_noise"})
    assert requirements(unstated).command_noise == (6.0, 30.0)
    settings = exported_controller(case).settings
    assert settings.torque_limit.tolist() == [300.0, 1500.0]
    assert (settings.lost_torque / settings.torque_limit).tolist() == pytest.approx([0.2, 0.2])
    other = replace(case, limits={**case.limits, "dynamometers.right.command_noise": 3.0})
    assert requirements(other).command_noise == (20.0, 3.0)


def test_the_manoeuvre_is_held_against_each_ones_own_limit(case):
    """What it takes is what it takes with one limit for both; the left one's own lies below it."""
    taken = {one.limit: one for one in demands(case).taken(rig_values(case)) if "torque" in one.limit}
    own, common = taken["dynamometers.left.torque"], taken["dynamometer_torque"]
    assert (own.dynamometer, common.dynamometer) == ("left", "right")
    assert (own.allowed, common.allowed) == (300.0, 1500.0)
    one_for_both = replace(case, limits={name: value for name, value in case.limits.items() if "left" not in name})
    both = [one.demand for one in demands(one_for_both).taken(rig_values(case)) if one.limit == "dynamometer_torque"]
    assert sorted(both) == pytest.approx(sorted([own.demand, common.demand]), rel=1e-9)
    small = replace(case, limits={**case.limits, "dynamometers.left.torque": own.demand / 1.1})
    (broken,) = demands(small).broken(rig_values(small))
    assert broken.limit == "dynamometers.left.torque"
    assert [one.where for one in verify(small).violations if "torque" in one.limit] == ["dynamometers.left.torque"]


def test_in_time_each_command_stays_within_its_own_limit(case):
    controller = unsupervised(exported_controller(case))
    time = np.arange(400) * controller.law.sample_time
    run = BedRun(Imperfection(""), {"motor_torque": 400.0 * (time > 0.05)}, ("motor_torque",))
    commands = bed_motions(case, controller, [run], ["motor_speed"])[0].commands
    assert np.abs(commands).max(axis=0) == pytest.approx([300.0, 1500.0])


def test_noise_above_ones_own_limit_names_it(case):
    checked = verify(replace(case, limits={**case.limits, "dynamometers.left.command_noise": 0.5}), beds=4)
    assert checked.loop.command_noise["right"] < 20
    (found,) = [one for one in not_kept(case, checked) if one.cause == "command_noise"]
    sentence = found.sentence()
    assert "at dynamometer left, 0.5 N·m is allowed" in sentence


def test_own_limits_are_written_and_read_again(case, tmp_path):
    for name, text in case_files(case).items():
        (tmp_path / name).write_text(text)
    assert dict(load_case(tmp_path / "case.toml").limits) == dict(case.limits)


@pytest.mark.parametrize(
    ("limits", "dynamometer", "wrong"),
    [
        ('"dynamometers.lef.torque" = 300', "", r"'dynamometers\.lef\.torque'.*dynamometers\.left\.torque"),
        ('"dynamometers.left.torque" = 0', "", r"limits\.dynamometers\.left\.torque: 0 is not possible"),
        ("", "dynamometer_torque = 300", r'left\.dynamometer_torque: is a limit.*"dynamometers\.left\.torque" = …'),
        ("", "command_noise = 3", r"left\.command_noise: is a limit"),
    ],
)
def test_a_wrong_name_is_refused_in_one_line(tmp_path, capsys, limits, dynamometer, wrong):
    file = written(tmp_path, limits, dynamometer)
    with pytest.raises(InputError, match=wrong):
        load_case(file)
    assert main(["match", str(file), "--check"]) == 2
    assert capsys.readouterr().err.strip().count("\n") == 0
