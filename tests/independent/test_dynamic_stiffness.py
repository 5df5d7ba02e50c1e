"""Dynamic stiffness against the derived equations and closed forms."""

from dataclasses import replace

import numpy as np
import pytest
from independent.dynamic_stiffness import Chain, NotCovered, plain_response

from modelling.linear.state_space import response
from modelling.model_file import from_dict
from modelling.system import OperatingPoint

BRANCHED = {
    "inertias": {"motor": {"J": 0.05}, "cage": {"J": 0.02}, "left": {"J": 1.0, "drag": 0.2}, "right": {"J": 1.4},
                 "body": {"J": 80.0, "drag": 1.0}},
    "gears": {"reduction": {"between": ["motor", "cage"], "ratio": 9.0}},
    "differentials": {"axle": {"cage": "cage", "left": "left", "right": "right"}},
    "shafts": {
        "side": {"between": ["left", "body"], "stiffness": 9e3, "damping": 12.0, "ratio": 0.8},
        "other": {"between": ["right", "body"], "stiffness": 7e3, "damping": 5.0},
    },
    "inputs": {"torque": {"on": "motor"}},
    "sensors": {
        "twist_torque": {"measures": "torque", "of": "side"},
        "speed": {"measures": "speed", "of": "body"},
        "angle": {"measures": "angle", "of": "right"},
        "acceleration": {"measures": "acceleration", "of": "left"},
    },
}  # fmt: skip
EFFECTS = [
    [],
    [{"kind": "slip", "at": "shafts.side", "coefficient": 40.0}],
    [{"kind": "compliance", "at": "shafts.other", "stiffness": 2e4, "J": 0.03}],
    [{"kind": "hysteresis", "at": "shafts.side", "torque": 4.0, "angle": 0.01}],
    [{"kind": "wrong_parameter", "at": "inertias.right.J", "value": 2.5}],
    [{"kind": "backlash", "at": "shafts.side", "gap": 0.02}, {"kind": "hardening", "at": "shafts.side", "cubic": 1e6}],
]


@pytest.mark.parametrize("effects", EFFECTS, ids=lambda effects: "+".join(own["kind"] for own in effects) or "linear")
def test_responses_of_a_model_are_those_of_its_equations(effects):
    """Gear, differential, ratios and every effect that is linear at rest, against the derived equations."""
    system = from_dict({**BRANCHED, "effects": effects})
    f = np.geomspace(0.3, 80, 12)
    derived = response(system, f)
    for j, sensor in enumerate(BRANCHED["sensors"]):
        own = plain_response(Chain(system), 2j * np.pi * f, "torque", sensor)
        np.testing.assert_allclose(own, derived.values[:, j, 0], rtol=1e-7)


@pytest.mark.parametrize("ratio", [0.7, 2.6, 4.0])
def test_responses_of_a_power_split_are_those_of_its_equations(ratio):
    """All three members of a planetary gear turn, a gear and shafts behind them."""
    split = {
        "inertias": {name: {"J": J} for name, J in (("engine", 0.15), ("carrier", 0.01), ("sun", 0.02), ("ring", 0.05),
                                                    ("axle", 0.3), ("car", 90.0))},
        "planetary_gears": {"split": {"sun": "sun", "carrier": "carrier", "ring": "ring", "ratio": ratio}},
        "gears": {"final": {"between": ["ring", "axle"], "ratio": 3.1}},
        "shafts": {"damper": {"between": ["engine", "carrier"], "stiffness": 600.0, "damping": 2.0},
                   "side": {"between": ["axle", "car"], "stiffness": 8e3, "damping": 6.0}},
        "inputs": {"torque": {"on": "engine"}},
        "sensors": {"speed": {"measures": "speed", "of": "sun"}, "side_torque": {"measures": "torque", "of": "side"}},
    }  # fmt: skip
    system = from_dict(split)
    f = np.geomspace(0.3, 80, 12)
    derived = response(system, f)
    for j, sensor in enumerate(split["sensors"]):
        own = plain_response(Chain(system), 2j * np.pi * f, "torque", sensor)
        np.testing.assert_allclose(own, derived.values[:, j, 0], rtol=1e-7)


MOVING = [
    [{"kind": "quadratic_drag", "at": "inertias.body", "coefficient": 0.3}],
    [{"kind": "quadratic_drag", "at": "inertias.body", "coefficient": 0.3},
     {"kind": "slip", "at": "shafts.side", "coefficient": 40.0},
     {"kind": "slip", "at": "shafts.other", "coefficient": 50.0}],
    [{"kind": "coulomb_friction", "at": "inertias.left", "torque": 3.0},
     {"kind": "stribeck_friction", "at": "inertias.body", "torque": 2.0, "breakaway": 4.0, "speed": 8.0}],
    [{"kind": "backlash", "at": "shafts.side", "gap": 0.02}, {"kind": "hardening", "at": "shafts.side", "cubic": 3e6},
     {"kind": "quadratic_drag", "at": "inertias.body", "coefficient": 0.5}],
    [{"kind": "tyre_slip", "at": "shafts.side", "slip_stiffness": 900.0, "peak": 120.0},
     {"kind": "tyre_slip", "at": "shafts.other", "slip_stiffness": 1100.0, "peak": 150.0, "shape": 1.4},
     {"kind": "quadratic_drag", "at": "inertias.body", "coefficient": 0.5}],
]  # fmt: skip


@pytest.mark.parametrize("effects", MOVING, ids=lambda effects: "+".join(effect["kind"] for effect in effects))
@pytest.mark.parametrize("point", [OperatingPoint((("body", 12.0),)), OperatingPoint((), (("torque", 15.0),))])
def test_responses_in_steady_motion_are_those_of_the_equations(effects, point):
    """About a speed, and about the speed that a torque holds."""
    system = replace(from_dict({**BRANCHED, "effects": effects}), operating_point=point)
    f = np.geomspace(0.05, 80, 12)
    derived = response(system, f)
    for j, sensor in enumerate(BRANCHED["sensors"]):
        values = plain_response(Chain(system), 2j * np.pi * f, "torque", sensor)
        np.testing.assert_allclose(values, derived.values[:, j, 0], rtol=1e-6)


def test_the_drag_of_the_speed_counts():
    """0.3·ω² at 12 rad/s is a drag of 7.2 N·m·s/rad more, which slows the drive at 0.05 Hz."""
    system = from_dict({**BRANCHED, "effects": MOVING[0]})
    moving = replace(system, operating_point=OperatingPoint((("body", 12.0),)))
    drag = system.parameters["inertias.body.drag"].value + 2 * 0.3 * 12.0
    s = 2j * np.pi * np.array([0.05, 3.0])
    wanted = plain_response(Chain(system.with_values({"inertias.body.drag": drag})), s, "torque", "speed")
    np.testing.assert_allclose(plain_response(Chain(moving), s, "torque", "speed"), wanted, rtol=1e-9)


def test_two_masses_in_closed_form():
    """J₁ and J₂ on a spring: the torque over the drive is J₂·k/(J₁·J₂·s² + k·(J₁ + J₂))."""
    J1, J2, k = 0.1, 1.0, 200.0
    system = from_dict(
        {
            "inertias": {"a": {"J": J1}, "b": {"J": J2}},
            "shafts": {"link": {"between": ["a", "b"], "stiffness": k}},
            "inputs": {"torque": {"on": "a"}},
            "sensors": {"link_torque": {"measures": "torque", "of": "link"}},
        }
    )
    s = 2j * np.pi * np.array([0.5, 3.0, 20.0])
    own = plain_response(Chain(system), s, "torque", "link_torque")
    np.testing.assert_allclose(own, J2 * k / (J1 * J2 * s**2 + k * (J1 + J2)), rtol=1e-12)


def test_what_is_not_known_is_said():
    system = from_dict({**BRANCHED, "effects": [{"kind": "coulomb_friction", "at": "inertias.left", "torque": 3.0}]})
    with pytest.raises(NotCovered, match="coulomb_friction"):
        Chain(system)
