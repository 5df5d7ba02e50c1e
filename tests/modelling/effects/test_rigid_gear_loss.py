"""Loss of a rigid gear: power in over the efficiency; refused where both sides do not determine it."""

import numpy as np
import pytest

from modelling.equations.casadi_code import compiled
from modelling.errors import InputError
from modelling.model_file import from_dict

TRAIN = {
    "inertias": {"a": {"J": 0.4, "drag": 0.1}, "b": {"J": 1.5, "drag": 0.2}, "c": {"J": 1.0}},
    "gears": {"g": {"between": ["a", "b"], "ratio": 2.0}},
    "shafts": {"s": {"between": ["b", "c"], "stiffness": 50, "damping": 0.3}},
    "inputs": {"u": {"on": "a"}},
    "sensors": {"w": {"measures": "speed", "of": "c"}},
}
LOSS = {"kind": "gear_loss", "at": "gears.g", "efficiency": 0.8, "efficiency_reverse": 0.7}
FRICTION = {"kind": "coulomb_friction", "at": "inertias.a", "torque": 1.5}


def test_a_rigid_gear_passes_on_power_over_its_efficiency():
    """By the balance of both inertias at accelerations of the compiled model, written out here by hand."""
    model = compiled(from_dict(TRAIN | {"effects": [LOSS, FRICTION]}))
    assert model.states == ["angle(b)", "angle(c)", "speed(b)", "speed(c)"]
    rng, driven = np.random.default_rng(1), set()
    for _ in range(20):
        x, u = 3 * rng.normal(size=4), 9 * rng.normal(size=1)
        x[2] += np.copysign(1.0, x[2])  # beyond the speed over which signs turn
        speed, acceleration = x[2], float(model.rates(x, u, model.p0)[2])
        shaft = 50 * (x[0] - x[1]) + 0.3 * (x[2] - x[3])
        motor = u[0] - 0.1 * 2 * speed - 1.5 * np.sign(speed) - 0.4 * 2 * acceleration
        taken, given = 2 * motor, 1.5 * acceleration + 0.2 * speed + shaft
        forward = taken * speed > 0
        assert given / taken == pytest.approx(0.8 if forward else 1 / 0.7, rel=1e-6)
        driven.add(forward)
    assert driven == {True, False}


def test_without_a_loss_the_torque_of_a_gear_follows_from_both_sides():
    model = compiled(from_dict(TRAIN))
    x, u = np.array([0.3, 0.1, 2.0, -1.0]), np.array([4.0])
    acceleration = float(model.rates(x, u, model.p0)[2])
    expected = 2 * (4.0 - 0.1 * 4.0 - 0.4 * 2 * acceleration)
    assert float(model.gear_torques(x, u, model.p0)) == pytest.approx(expected)


def test_a_gear_beside_a_differential_has_no_torque_of_its_own():
    data = {
        "inertias": {name: {"J": 1.0} for name in ("a", "cage", "left", "right")},
        "gears": {"g": {"between": ["a", "cage"], "ratio": 2.0}},
        "differentials": {"d": {"cage": "cage", "left": "left", "right": "right"}},
        "inputs": {"u": {"on": "a"}},
        "sensors": {"w": {"measures": "speed", "of": "left"}},
    }
    model = compiled(from_dict(data))
    assert np.isnan(float(model.gear_torques(np.ones(4), np.ones(1), model.p0)))
    with pytest.raises(InputError, match=r"in one rigid train with differentials\.d"):
        compiled(from_dict(data | {"effects": [LOSS]}))


@pytest.mark.parametrize(
    ("gears", "effects", "message"),
    [
        ({"h": {"between": ["b", "c"], "ratio": 3.0}}, [LOSS, LOSS | {"at": "gears.h"}], "both have losses"),
        (
            {},
            [LOSS, {"kind": "compliance", "at": "shafts.s", "stiffness": 9.0, "J": 0.1}],
            "beside a further inertia in s",
        ),
    ],
)
def test_a_loss_that_is_not_determined_is_refused(gears, effects, message):
    data = TRAIN | {"gears": TRAIN["gears"] | gears, "effects": effects}
    if gears:
        data["shafts"] = {}
    with pytest.raises(InputError, match=message):
        compiled(from_dict(data))
