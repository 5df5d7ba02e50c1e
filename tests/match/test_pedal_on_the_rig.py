"""A pedal on the rig: with a map that gives 200 N·m times the pedal, a case is the one with a torque in other units."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from matching.bed.excite import bed_inputs
from matching.match.bounds import estimator_bound
from matching.match.case_file import load_case
from matching.match.loop import control_law, linear_bed
from modelling.errors import InputError

EXAMPLE = Path(__file__).parents[2] / "examples" / "road_to_rig"
FULL = 200.0  # N·m
MAP = f"""
[[effects]]
kind = "torque_map"
at = "inputs.motor_torque"
speed = [-2000, 2000]
pedal = [0, 0.4, 1]
torque = [[0, {0.4 * FULL}, {FULL}], [0, {0.4 * FULL}, {FULL}]]
"""


@pytest.fixture
def cases(tmp_path):
    """With a torque, and with a pedal."""
    for name in ("torque", "pedal"):
        (tmp_path / name).mkdir()
        for file in ("observer.toml", "vehicle.toml", "rig.toml"):
            shutil.copy(EXAMPLE / file, tmp_path / name)
    for file in ("vehicle.toml", "rig.toml"):
        with (tmp_path / "pedal" / file).open("a", encoding="utf-8") as text:
            text.write(MAP)
    case = tmp_path / "pedal" / "observer.toml"
    text = case.read_text(encoding="utf-8")
    begin = text.index("[manoeuvre.motor_torque]")
    case.write_text(text[:begin] + text[begin:].replace("amplitude = 100 ", 'amplitude = "50 %" ', 1), encoding="utf-8")
    return [load_case(tmp_path / name / "observer.toml") for name in ("torque", "pedal")]


def test_the_observer_is_the_same_but_for_the_unit_of_what_it_knows(cases):
    by_torque, by_pedal = (control_law(linear_bed(case)) for case in cases)
    assert by_torque.known == by_pedal.known
    random, k = np.random.default_rng(3), len(by_torque.dynamometers)
    free, states = (np.full(k, -1e9), np.full(k, 1e9)), [np.zeros(law.states) for law in (by_torque, by_pedal)]
    largest, apart = 0.0, 0.0
    for _ in range(300):
        readings, torques = 5 * random.standard_normal(len(by_torque.sensors)), np.zeros(len(by_torque.known))
        torques[by_torque.known.index("motor_torque")] = 100 * random.uniform()
        pedals = torques / FULL
        sent, states[0] = by_torque.step(states[0], readings, torques, free)
        same, states[1] = by_pedal.step(states[1], readings, pedals, free)
        largest, apart = max(largest, np.abs(sent).max()), max(apart, np.abs(sent - same).max())
    assert largest > 100
    assert apart < 1e-6 * largest


def test_sizes_count_in_its_torque(cases):
    assert cases[1].largest_torque == pytest.approx(cases[0].largest_torque)
    assert estimator_bound(cases[1]) == pytest.approx(estimator_bound(cases[0]), rel=1e-5)


def test_commands_on_the_bed_and_a_dynamometer_refuse_it(cases):
    with pytest.raises(InputError, match=r"rig: inputs\.motor_torque: is a pedal with a torque map, and this command"):
        bed_inputs(cases[1])
    rig = Path(cases[1].path).parent / "rig.toml"
    rig.write_text(rig.read_text(encoding="utf-8").replace("inputs.motor_torque", "inputs.dyno_left").replace(
        "[inputs.dyno_left]\non = \"motor\"", "[inputs.motor_torque]\non = \"motor\""), encoding="utf-8")  # fmt: skip
    with pytest.raises(InputError, match=r"dynamometers\.left\.torque_input: 'dyno_left' is a pedal"):
        load_case(cases[1].path)
