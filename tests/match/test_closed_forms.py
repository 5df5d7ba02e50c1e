"""Small laws of the match against answers worked out by hand."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from match import drawn

from matching.match.case_file import load_case
from matching.match.demands import BehindCut, CutMotion, Demands
from matching.match.findings import sentences
from matching.match.limits import DeadTimeTrial, Relaxations, _delay
from matching.match.loop import linear_bed
from matching.match.problem import (
    confirmed,
    differing_components,
    problem_of,
    reached,
)
from modelling.bed.controllers import STRUCTURES
from modelling.bed.vehicle import cut
from modelling.errors import InputError
from modelling.linear.state_space import state_space
from modelling.system import Sensor
from modelling.topology import Joint

EXAMPLES = Path(__file__).parents[2] / "examples"
WANTED = SimpleNamespace(frequency=2.0, damping_ratio=0.05)


@pytest.fixture
def small(tmp_path):
    return load_case(drawn.draw(2, tmp_path))


@pytest.mark.parametrize(
    ("frequency", "damping_ratio", "is_reached"),
    [
        (2.0, 0.05, True), (2.019, 0.05, True), (1.981, 0.05, True), (2.0, 0.069, True), (2.0, 0.031, True),
        (2.021, 0.05, False), (1.979, 0.05, False), (2.0, 0.071, False), (2.0, 0.029, False),
    ],
)  # fmt: skip
def test_a_target_is_reached_within_both_tolerances(frequency, damping_ratio, is_reached):
    assert reached(frequency, damping_ratio, WANTED, 0.01, 0.02) == is_reached


def test_the_simulation_is_believed_to_two_percent():
    """It has to show the loop's mode, however far the case lets that be from the vehicle's."""
    assert confirmed(2.345, 0.05, 2.3, WANTED, 0.02)
    assert not confirmed(2.347, 0.05, 2.3, WANTED, 0.02)
    assert not confirmed(2.3, 0.071, 2.3, WANTED, 0.02)


def test_a_dead_time_is_named_only_where_it_was_solved_and_did(small):
    case = replace(small, loop=replace(small.loop, structure=STRUCTURES["pi"]))
    missed = [SimpleNamespace(vehicle=5.0)]
    problem = problem_of(case)
    assert _delay(problem, missed, Relaxations()) == []
    (enough,) = sentences(_delay(problem, missed, Relaxations(DeadTimeTrial(0.0005, 0.004))))
    assert enough.endswith("; solved with 4 ms, every target is met")
    degrees = 360 * 5.0 * case.loop["dead_time"]
    assert f"leaves {degrees:.0f}° at 5.00 Hz" in enough
    (neither,) = sentences(_delay(problem, missed, Relaxations(DeadTimeTrial(0.0005, None))))
    assert "solved with one sample, 0.5 ms, the targets are not met either" in neither
    assert "leaves" not in neither  # what does not help is not blamed
    assert "model_based" not in neither
    *_, other = sentences(_delay(problem, missed, Relaxations(DeadTimeTrial(0.0005, None), {}, "model_based")))
    assert 'structure = "model_based"' in other


def test_dynamometer_demands_by_hand():
    """Torque 10 N·m less 2 kg·m² · 3 rad/s² is 4 N·m; at 5 rad/s that takes 20 W."""
    motion = CutMotion("adapter", *(np.array([x]) for x in (10.0, 3.0, 5.0)))
    flange = Joint("shafts.flange", ("adapter", "rotor"))
    part = BehindCut(("adapter", "rotor"), (flange,), (motion,), {"left": "rotor"})
    limits = {
        "dynamometer_torque": 1.0,
        "dynamometer_power": 1.0,
        "dynamometer_speed": 1.0,
        "shafts.flange.torque": 1.0,
    }
    limits["shafts.flange.twist"] = 1e-3
    values = {"rig.inertias.adapter.J": 0.5, "rig.inertias.rotor.J": 1.5, "rig.shafts.flange.stiffness": 1000.0}
    values |= {"rig.inertias.adapter.drag": 0.0, "rig.inertias.rotor.drag": 0.0}
    demand = {limit: value for _, limit, value, _ in Demands((part,), limits).broken(values)}
    assert demand == pytest.approx(
        {
            "dynamometer_torque": 4.0, "dynamometer_power": 20.0, "dynamometer_speed": 5.0,
            "shafts.flange.torque": 8.5, "shafts.flange.twist": 8.5e-3,
        }
    )  # fmt: skip
    shares = Demands((part,), {"dynamometer_power": 40.0}).shares(values)
    assert shares.tolist() == pytest.approx([0.5])  # 20 W of 40 W


def test_sign_and_ratio_of_a_flange_and_of_a_cut(tmp_path):
    """A shaft of ratio 4 with the rotor at its first end: 1 N·m of it drives the rotor with −1/4 N·m."""
    drawn.draw(2, tmp_path)
    text = (tmp_path / "rig.toml").read_text()
    forth = load_case(tmp_path / "case.toml")
    assert linear_bed(forth).torque_signs.tolist() == [1.0]
    assert cut(forth.vehicle, forth.rig).interfaces[0].factor == 1.0
    (tmp_path / "rig.toml").write_text(text.replace('["adapter", "rotor"]', '["rotor", "adapter"]\nratio = 4'))
    back = load_case(tmp_path / "case.toml")
    assert linear_bed(back).torque_signs.tolist() == [-0.25]
    for name in ("rig.toml", "vehicle.toml"):
        swapped = (tmp_path / name).read_text().replace('["hub", "adapter"]', '["adapter", "hub"]\nratio = 5')
        (tmp_path / name).write_text(swapped.replace('["hub", "wheel"]', '["wheel", "hub"]\nratio = 5'))
    turned = load_case(tmp_path / "case.toml")
    assert cut(turned.vehicle, turned.rig).interfaces[0].factor == pytest.approx(-1 / 5)


def test_shared_components_that_differ_are_named(small):
    assert differing_components(small) == []
    heavier = replace(small, rig=small.rig.with_values({"inertias.motor.J": 0.05}))
    (sentence,) = differing_components(heavier)
    assert sentence.startswith("inertias.motor.J is ")
    assert "0.05 kg" in sentence


@pytest.mark.parametrize("name", ["road_to_rig", "compact_bev", "adapter_only", "four_wheel"])
def test_examples_share_what_they_name_alike(name):
    assert differing_components(load_case(EXAMPLES / name / "case.toml")) == []


def test_only_pi_without_gains_is_torqueless(small):
    none = dict.fromkeys(
        ("proportional_gain", "integral_gain", "torque_feed_forward", "acceleration_feed_forward"), 0.0
    )
    assert replace(small.loop, structure=STRUCTURES["pi"]).with_values(none).torqueless
    assert not replace(small.loop, structure=STRUCTURES["pi"]).with_values(none | {"integral_gain": 1.0}).torqueless
    assert not replace(small.loop, structure=STRUCTURES["model_based"]).with_values(none).torqueless


def test_torques_a_structure_takes_as_measured():
    assert STRUCTURES["pi"].measured_inputs(["motor"], ["road"]) == ()
    assert STRUCTURES["model_based"].measured_inputs(["motor"], ["road"]) == ("motor", "road")


@pytest.mark.parametrize("stiffness", [2e5, 3e6, 5e7, 1e9])
def test_a_flange_may_be_as_stiff_as_it_is(small, stiffness):
    """Its torque depends on a twist alone, whatever the rounding; a free angle is refused still."""
    stiff = small.rig.with_values({"shafts.flange.stiffness": stiffness})
    assert len(state_space(stiff).outputs) == len(stiff.sensors)
    reading = replace(stiff, sensors=(*stiff.sensors, Sensor("rotor_angle", "angle", "rotor")))
    with pytest.raises(InputError, match="rotor_angle"):
        state_space(reading)
