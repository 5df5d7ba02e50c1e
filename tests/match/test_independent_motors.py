"""A motor at each wheel: on the bed both sides stand apart, in the car one body joins them."""

import numpy as np
import pytest
import tomli_w

from matching.match.case import demands
from matching.match.case_file import load_case
from matching.match.loop import bed_set, controller_on, frequency_response, linear_bed, responses
from matching.match.loop_modes import ClosedLoop, inside_unit_circle
from matching.match.responses import error_figures
from matching.report.drivetrain import layout
from modelling.errors import InputError
from modelling.linear.steady_motion import speeds_of, torques_of
from modelling.modal.modes import modes
from modelling.model_file import from_dict

STIFFNESS, RATIO, MOTOR, WHEEL, BODY = 6000.0, 9.0, 0.03, 1.1, 150.0  # N·m/rad, 1, kg·m²


def half(side, outer):
    """Inertias, shafts, inputs and sensors that both have on one side."""
    return {
        "inertias": {f"motor_{side}": {"J": MOTOR, "drag": 0.002}, f"{outer}_{side}": {"J": WHEEL}},
        "shafts": {f"side_{side}": {
            "between": [f"motor_{side}", f"{outer}_{side}"], "ratio": RATIO, "stiffness": STIFFNESS, "damping": 9,
        }},
        "inputs": {f"torque_{side}": {"on": f"motor_{side}"}},
        "sensors": {
            f"speed_{side}": {"measures": "speed", "of": f"motor_{side}"},
            f"side_torque_{side}": {"measures": "torque", "of": f"side_{side}"},
        },
    }  # fmt: skip


def joined(*models):
    """Tables of models in one."""
    whole = {}
    for model in models:
        for table, entries in model.items():
            whole[table] = [*whole.get(table, []), *entries] if table == "effects" else whole.get(table, {}) | entries
    return whole


def vehicle():
    tyres = {"shafts": {}, "effects": []}
    for side in ("left", "right"):
        tyres["shafts"][f"tyre_{side}"] = {"between": [f"wheel_{side}", "body"], "stiffness": 2e4, "damping": 30}
        tyres["effects"].append({"kind": "slip", "at": f"shafts.tyre_{side}", "coefficient": 1500})
    return joined(
        half("left", "wheel"), half("right", "wheel"), {"inertias": {"body": {"J": BODY, "drag": 0.8}}}, tyres
    )


def rig(*sides):
    models = []
    for side in sides:
        bed = {
            "inertias": {f"rotor_{side}": {"J": 0.6, "drag": 0.02}},
            "shafts": {f"flange_{side}": {
                "between": [f"adapter_{side}", f"rotor_{side}"], "stiffness": 2e5, "damping": 15,
            }},
            "inputs": {f"dyno_{side}": {"on": f"rotor_{side}"}},
            "sensors": {
                f"flange_torque_{side}": {"measures": "torque", "of": f"flange_{side}"},
                f"rotor_speed_{side}": {"measures": "speed", "of": f"rotor_{side}"},
            },
        }  # fmt: skip
        models += [half(side, "adapter"), bed]
    whole = joined(*models)
    for side in sides:
        whole["inertias"][f"adapter_{side}"] = {"J": 0.05}
    return whole


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    folder = tmp_path_factory.mktemp("motors")
    sides = ("left", "right")
    data = {
        "vehicle": "vehicle.toml", "rig": "rig.toml",
        "dynamometers": {side: {
            "torque_input": f"dyno_{side}", "torque_sensor": f"flange_torque_{side}",
            "speed_sensor": f"rotor_speed_{side}", "follows": f"side_{side}",
        } for side in sides},
        "loop": {
            "structure": "model_based", "knows": ["torque_left", "torque_right"], "dead_time": 0.002,
            "proportional_gain": 20, "integral_gain": 20,
        },
        "operating_point": {"vehicle_speed": "50 km/h", "rolling_radius": 0.3},
        "targets": [{"mode": 2}],
        "response": {"compare": [
            {"input": f"torque_{one}", "sensor": f"speed_{other}"} for one in sides for other in sides
        ]},
        "manoeuvre": {"torque_left": {"kind": "tip_in", "amplitude": 60}},
    }  # fmt: skip
    for name, content in (("vehicle", vehicle()), ("rig", rig(*sides)), ("case", data)):
        (folder / f"{name}.toml").write_text(tomli_w.dumps(content))
    return load_case(folder / "case.toml")


def test_two_chains_have_the_modes_of_one_twice(case):
    one = [mode.frequency for mode in modes(from_dict(rig("left")))]
    np.testing.assert_allclose([mode.frequency for mode in modes(case.rig)], np.repeat(one, 2), atol=1e-6)


def test_both_motors_hold_the_speed(case):
    body = 50 / 3.6 / 0.3
    assert speeds_of(case.vehicle)["body"] == pytest.approx(body)
    left, right = (torques_of(case.vehicle)[f"torque_{side}"] for side in ("left", "right"))
    assert left == pytest.approx(right)
    wheel = body + 0.4 * body / 1500
    assert left == pytest.approx(0.4 * body / RATIO + 0.002 * RATIO * wheel)


def test_one_motor_moves_the_other_side_through_the_emulated_body(case):
    """On the bed alone no torque crosses over; matched, both sides answer as in the car."""
    parts = linear_bed(case)
    alone = parts.rig.response(2j * np.pi * np.array([2.0]))[0]
    outputs, inputs = parts.rig.space.outputs, parts.rig.space.inputs
    assert abs(alone[outputs.index("speed_right"), inputs.index("torque_left")]) < 1e-12
    controller = controller_on(parts)
    assert inside_unit_circle(ClosedLoop.of(parts, controller).poles, 0)
    figures = error_figures(case, parts)
    assert figures.after < 0.05
    beds = bed_set(case, [{}], np.array([2.0]))
    answers = responses(beds, frequency_response(controller, beds.frequencies), case.loop.measured)[0, 0]
    crossed = [pair.input == "torque_left" and pair.sensor == "speed_right" for pair in case.compared].index(True)
    assert abs(answers[crossed]) > 1e-3
    left, right = demands(case).chains
    assert left.speed.max() > right.speed.max() > right.speed[0] * 1.01


def test_what_nothing_drives_is_still_missing_a_shaft():
    model = rig("left", "right")
    del model["inputs"]["torque_right"], model["inputs"]["dyno_right"]
    with pytest.raises(InputError, match="motor_right, adapter_right, rotor_right are not connected to 'motor_left'"):
        from_dict(model)


def test_parts_that_stand_apart_are_drawn_one_below_the_other():
    placed = layout(from_dict(rig("left", "right")))
    assert {name: placed.lane[name] for name in ("motor_left", "rotor_left", "motor_right", "rotor_right")} == {
        "motor_left": 0, "rotor_left": 0, "motor_right": 1, "rotor_right": 1,
    }  # fmt: skip
    assert placed.column["rotor_left"] == placed.column["rotor_right"] == 2
    assert [joint.name for joint in placed.joints] == ["side_left", "flange_left", "side_right", "flange_right"]
