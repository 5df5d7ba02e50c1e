"""The torque map of an engine over speed and pedal: its law, its derivatives, its file, and the pedal that holds."""

import tomllib
from dataclasses import replace

import numpy as np
import pytest

import rigmatch as rm
from modelling.equations.casadi_code import compiled
from modelling.equations.lagrange import derive, signs
from modelling.errors import InputError
from modelling.linear.linearise import linearise
from modelling.linear.steady_motion import acting_torques_of, speeds_of, torques_of
from modelling.model_file import dumps, from_dict
from modelling.system import OperatingPoint

J, DRAG, RATIO, J_CAR, DRAG_CAR = 0.15, 0.02, 5.0, 130.0, 1.5
BASE = {
    "inertias": {"engine": {"J": J, "drag": DRAG}, "car": {"J": J_CAR, "drag": DRAG_CAR}},
    "shafts": {"link": {"between": ["engine", "car"], "ratio": RATIO, "stiffness": 3000.0, "damping": 10.0}},
    "inputs": {"pedal": {"on": "engine"}, "road": {"on": "car"}},
    "sensors": {
        "speed": {"measures": "speed", "of": "engine"}, "torque": {"measures": "torque", "of": "link"},
    },
}  # fmt: skip
SMALL = {"speed": [80, 200, 600], "pedal": [0, 0.3, 1], "torque": [[20, 60, 120], [-15, 50, 160], [-40, 20, 140]]}


def with_map(values, *further, **base):
    return from_dict(BASE | base | {"effects": [{"kind": "torque_map", "at": "inputs.pedal", **values}, *further]})


def drawn(random, monotone=True):
    """Speeds, pedals and torques of a map; its torque rises with the pedal where it is ``monotone``."""
    n, m = random.integers(2, 7), random.integers(2, 6)
    speeds = 40 + np.cumsum(random.uniform(20, 200, n))
    pedals = np.r_[0.0, np.cumsum(random.uniform(0.2, 1.0, m - 1))]
    torques = np.cumsum(random.uniform(5, 90, (n, m)), axis=1) - random.uniform(20, 80, (n, 1))
    return speeds, pedals / pedals[-1], torques if monotone else random.uniform(-60, 200, (n, m))


def between(speeds, pedals, torques, speed, pedal):
    """Bilinear, constant beyond: over the pedal at each speed, then over the speed."""
    return float(np.interp(speed, speeds, [np.interp(pedal, pedals, row) for row in torques]))


def tables(speeds, pedals, torques):
    return {"speed": speeds.tolist(), "pedal": pedals.tolist(), "torque": torques.tolist()}


def test_it_is_bilinear_and_constant_beyond():
    random = np.random.default_rng(7)
    for _ in range(6):
        of = drawn(random, monotone=False)
        model = compiled(with_map(tables(*of)))
        for _ in range(60):
            speed, pedal, road = random.uniform(-50, 1200), random.uniform(-0.3, 1.3), random.uniform(-90, 90)
            force = model.force([0.0, 0.0, speed, speed / RATIO], [pedal, road], model.p0).full().ravel()
            assert force[0] + DRAG * speed == pytest.approx(between(*of, speed, pedal), abs=1e-5)
            assert force[1] + DRAG_CAR * speed / RATIO == pytest.approx(road)


def test_its_derivatives_are_those_of_differences():
    random = np.random.default_rng(8)
    of = drawn(random)
    model, h = compiled(with_map(tables(*of))), 1e-6
    for _ in range(40):
        speed, pedal = random.uniform(50, 900), random.uniform(0.01, 0.99)
        if min(np.abs(of[0] - speed).min(), 1e3 * np.abs(of[1] - pedal).min()) < 1.0:
            continue  # near a point of the map
        A, B = (np.array(part) for part in model.jacobians([0, 0, speed, speed / RATIO], [pedal, 0], model.p0, 0)[:2])
        by_speed = (between(*of, speed + h, pedal) - between(*of, speed - h, pedal)) / (2 * h)
        by_pedal = (between(*of, speed, pedal + h) - between(*of, speed, pedal - h)) / (2 * h)
        d_link = 10.0 / RATIO**2
        assert J * A[2, 2] == pytest.approx(by_speed - DRAG - d_link, abs=1e-5)
        assert J * B[2, 0] == pytest.approx(by_pedal, rel=1e-5)


def test_at_its_ends_a_pedal_has_the_slope_of_one_that_is_pressed():
    model = compiled(with_map(SMALL))
    for pedal, slope in ((0.0, (50 + 15) / 0.3), (1.0, (160 - 50) / 0.7)):
        B = np.array(model.jacobians([0, 0, 200, 40], [pedal, 0], model.p0, 0)[1])
        assert J * B[2, 0] == pytest.approx(slope)


def test_a_file_has_rows_and_comes_back():
    system = with_map(SMALL | {"speed": ["800 1/min", 200, "6000 1/min"], "pedal": [0, "30 %", 1]})
    written = tomllib.loads(dumps(system))
    assert from_dict(written) == system
    assert written["effects"][0]["torque"] == SMALL["torque"]
    assert written["effects"][0]["pedal"] == SMALL["pedal"]
    assert system.parameters["inputs.pedal.torque_map.torque_2_3"].value == 160
    assert system.units["inputs.pedal.torque_map.torque_2_3"] == "N*m"
    uncertain = [[20, 60, {"value": 120, "lower": 100, "upper": 140}], *SMALL["torque"][1:]]
    assert list(with_map(SMALL | {"torque": uncertain}).uncertain) == ["inputs.pedal.torque_map.torque_1_3"]


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"speed": [80, 600, 200]}, "the values of speed do not increase"),
        ({"pedal": [0, 0.3, 0.3]}, "the values of pedal do not increase"),
        ({"pedal": [0, 30, 100]}, "30 is not possible; 0 … 1 is needed"),
        ({"torque": [[20, 60, 120], [-15, 50], [-40, 20, 140]]}, "torque needs 3 rows, one a speed, of 3 values"),
        ({"torque": SMALL["torque"][:2]}, "torque needs 3 rows"),
        ({"torque": [20, 60, 120]}, "is no list of rows"),
        ({"torque": [[20, 60, 120], [-15, "50 rad/s", 160], [-40, 20, 140]]}, "torque_2_2"),
        ({"torque": [[20, 60, float("inf")], [-15, 50, 160], [-40, 20, 140]]}, "is not finite"),
        ({"speed": [80]}, "needs a list speed of two values at least"),
        ({"load": [1, 2]}, "load"),
    ],
)
def test_what_is_wrong_is_one_line(changed, words):
    with pytest.raises(InputError, match="effects") as refused:
        with_map(SMALL | changed)
    assert words in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_pedal_is_no_brake_and_measures_nothing():
    with pytest.raises(InputError, match=r"inputs\.pedal: is a pedal with a torque map, and the torque of a brake"):
        with_map(SMALL, {"kind": "brake", "at": "inputs.pedal", "deflection": 0.01})
    with pytest.raises(InputError, match="leave out measures"):
        with_map(SMALL, inputs={"pedal": {"on": "engine", "measures": "torque"}, "road": {"on": "car"}})
    with pytest.raises(InputError, match="leave out measures"):
        with_map(SMALL, {"kind": "imposed_motion", "at": "inertias.engine"})


def test_it_comes_before_other_effects_at_its_input():
    lag = {"kind": "lag", "at": "inputs.pedal", "time_constant": 0.1}
    map_ = {"kind": "torque_map", "at": "inputs.pedal", **SMALL}
    for effects in ([lag, map_], [map_, lag]):
        model = compiled(from_dict(BASE | {"effects": effects}))
        rates = model.rates([0, 0, 200, 40, 7.0], [0.3, 0], model.p0).full().ravel()
        assert rates[4] == pytest.approx((50 - 7) / 0.1), "the lag's state is a torque"
        assert J * rates[2] == pytest.approx(7 - DRAG * 200)


def test_equations_call_it_a_pedal():
    equations = derive(with_map(SMALL))
    letters = {sign.component: sign.letter for symbol, sign in signs(equations).items() if str(symbol).startswith("u(")}
    assert letters == {"pedal": "p", "road": "M"}


def test_the_pedal_that_holds_a_speed_is_found_or_said():
    random, found, refused = np.random.default_rng(12), 0, 0
    for _ in range(40):
        of = drawn(random)
        speed, road = random.uniform(80, 700), random.uniform(-400, 200)
        needed = DRAG * speed + (DRAG_CAR * speed / RATIO - road) / RATIO
        system = replace(with_map(tables(*of)), operating_point=OperatingPoint((("engine", speed),), (("road", road),)))
        least, most = (between(*of, speed, pedal) for pedal in (0.0, 1.0))
        if least <= needed <= most:
            pedal, found = torques_of(system)["pedal"], found + 1
            assert 0 <= pedal <= 1
            assert between(*of, speed, pedal) == pytest.approx(needed, abs=1e-5)
            assert speeds_of(system)["car"] == pytest.approx(speed / RATIO)
            assert acting_torques_of(system)["pedal"] == pytest.approx(needed, abs=1e-5)
        else:
            with pytest.raises(InputError) as said:
                torques_of(system)
            refused += 1
            assert f"no pedal holds it, for {needed:.4g} N·m are needed at inputs.pedal" in str(said.value)
            assert f"gives {least:.4g} to {most:.4g} N·m at {speed:.4g} rad/s" in str(said.value)
    assert found > 8
    assert refused > 8


def test_about_an_operating_point_its_slope_over_speed_damps_and_a_response_is_per_pedal():
    speed, pedal, of = 400.0, 0.5, [np.array(rows) for rows in SMALL.values()]
    slope = (between(*of, speed + 1, pedal) - between(*of, speed - 1, pedal)) / 2
    by_pedal = (between(*of, speed, pedal + 0.01) - between(*of, speed, pedal - 0.01)) / 0.02
    system = with_map(SMALL)
    at = replace(system, operating_point=OperatingPoint((("engine", speed),), (("pedal", pedal),)))
    damped = replace(  # the same without a map, its slope as the engine's drag
        from_dict(BASE | {"inertias": BASE["inertias"] | {"engine": {"J": J, "drag": DRAG - slope}}}),
        operating_point=OperatingPoint((("engine", speed),), (("pedal", 0.0),)),
    )
    frequencies = np.array([0.5, 3.0, 8.0])
    of_map, plain = (rm.response(one, frequencies) for one in (at, damped))
    np.testing.assert_allclose(of_map["torque", "pedal"], by_pedal * plain["torque", "pedal"], rtol=1e-6)
    np.testing.assert_allclose(of_map["speed", "road"], plain["speed", "road"], rtol=1e-6)
    assert of_map.unit("torque", "pedal") == "N*m per pedal"
    assert of_map.unit("torque", "road") == "N*m per N*m"
    poles = [np.sort_complex(np.linalg.eigvals(linearise(one).A)) for one in (at, damped)]
    np.testing.assert_allclose(*poles, rtol=1e-6, atol=1e-6)


def test_a_pedal_in_per_cent_and_an_order_on_it_are_refused():
    system = with_map(SMALL)
    with pytest.raises(InputError, match=r"is 60 at 0\.25 s: a pedal is 0 to 1"):
        rm.simulate(system, {"pedal": rm.Step(amplitude=60, at=0.25, duration=1)})
    with pytest.raises(InputError, match="pedal is a pedal, and orders are torques"):
        rm.order_response(system, "600:6000 1/min", {"pedal:2": 100.0})
