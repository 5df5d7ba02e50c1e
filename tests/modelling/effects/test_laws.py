"""Every effect's law against the specification's table, written here in NumPy."""

import itertools

import numpy as np
import pytest
from scipy.optimize import brentq

from modelling.effects import EFFECTS
from modelling.equations.casadi_code import compiled
from modelling.errors import InputError
from modelling.model_file import from_dict

K, D, RATIO = 300.0, 0.6, 2.0
BASE = {
    "inertias": {"a": {"J": 0.4}, "b": {"J": 1.5}},
    "shafts": {"link": {"between": ["a", "b"], "ratio": RATIO, "stiffness": K, "damping": D}},
    "inputs": {"drive": {"on": "a"}},
    "sensors": {
        "speed_b": {"measures": "speed", "of": "b"},
        "torque": {"measures": "torque", "of": "link"},
    },
}


def model_with(*effects):
    return compiled(from_dict(BASE | {"effects": list(effects)}))


def states(model, count=30, seed=4):
    """Random states, speeds well away from zero so that the sign of dry friction is full."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        x = np.concatenate(
            [
                rng.normal(0, 0.05, model.n),
                rng.normal(0, 5, model.n),
                rng.uniform(-0.9, 0.9, len(model.states) - 2 * model.n),
            ]
        )
        yield x, rng.normal(0, 20, 1), rng.uniform(0, 10)


def numbers(model, x, u, t=0.0):
    """q̈, ż, readings and shaft torque."""
    rates = model.rates(x, u, model.p0).full().ravel()
    readings = model.readings(x, u, model.p0, t).full().ravel()
    return rates[model.n : 2 * model.n], rates[2 * model.n :], readings, float(model.shaft_torques(x, u, model.p0))


def twist_and_rate(x):
    return x[0] / RATIO - x[1], x[2] / RATIO - x[3]


def no_pull(torque, side):
    return max(torque, 0.0) if side > 0 else min(torque, 0.0)


def backlash(twist, rate, gap=0.04):
    side = np.sign(twist)
    return no_pull(K * (twist - side * gap / 2) + D * rate, side) if abs(twist) > gap / 2 else 0.0


SHAFT_LAWS = {
    "backlash": ({"gap": 0.04}, backlash),
    "hardening": ({"cubic": -2e4}, lambda twist, rate: K * twist - 2e4 * twist**3 + D * rate),
}


@pytest.mark.parametrize("kind", SHAFT_LAWS)
def test_shaft_laws(kind):
    parameters, law = SHAFT_LAWS[kind]
    model = model_with({"kind": kind, "at": "shafts.link"} | parameters)
    seen = 0
    for x, u, _ in states(model, 200):
        twist, rate = twist_and_rate(x)
        if kind == "backlash" and abs(abs(twist) - 0.02) < 1e-3 * abs(rate):
            continue  # within the contact time the damping sets in gradually, see the simulation's tests
        acceleration, _, readings, torque = numbers(model, x, u)
        expected = law(twist, rate)
        assert torque == pytest.approx(expected, abs=1e-9)
        assert readings[1] == torque
        np.testing.assert_allclose(acceleration, [(u[0] - expected / RATIO) / 0.4, expected / 1.5], atol=1e-8)
        seen += 1
    assert seen > 150


FRICTION = {
    "coulomb_friction": ({"torque": 3.0}, lambda w, q: 3.0 * np.sign(w)),
    "coulomb_friction reverse": ({"torque": 3.0, "torque_reverse": 5.0}, lambda w, q: 3.0 if w > 0 else -5.0),
    "stribeck_friction": (
        {"torque": 3.0, "breakaway": 8.0, "speed": 2.5},
        lambda w, q: np.sign(w) * (3.0 + 5.0 * np.exp(-((w / 2.5) ** 2))),
    ),
    "quadratic_drag": ({"coefficient": 0.7}, lambda w, q: 0.7 * w * abs(w)),
    "constant_torque": ({"torque": -4.0}, lambda w, q: -4.0),
    "torque_ripple": (
        {"order": 12, "amplitude": 2.0, "phase": 0.7},
        lambda w, q: -2.0 * np.sin(12 * q + 0.7),
    ),
}


@pytest.mark.parametrize("name", FRICTION)
def test_inertia_laws(name):
    parameters, law = FRICTION[name]
    model = model_with({"kind": name.split()[0], "at": "inertias.b"} | parameters)
    for x, u, _ in states(model):
        twist, rate = twist_and_rate(x)
        acceleration, _, _, torque = numbers(model, x, u)
        assert torque == pytest.approx(K * twist + D * rate)
        np.testing.assert_allclose(acceleration[1], (torque - law(x[3], x[1])) / 1.5, rtol=1e-9, atol=1e-9)


def test_position_torque_with_harmonics():
    parameters = {"period": 0.8, "amplitude": 2.0, "phase": 0.7, "amplitude_3": -0.5, "phase_3": 0.2}
    model = model_with({"kind": "position_torque", "at": "inertias.b"} | parameters)
    for x, u, _ in states(model):
        acceleration, _, _, torque = numbers(model, x, u)
        turned = 2 * np.pi * x[1] / 0.8
        resisting = 2.0 * np.sin(turned + 0.7) - 0.5 * np.sin(3 * turned + 0.2)
        np.testing.assert_allclose(acceleration[1], (torque - resisting) / 1.5, rtol=1e-9, atol=1e-9)


def test_geared_ripple_acts_on_the_first_as_the_second_turns():
    parameters = {"order": 3.0, "amplitude": 2.0, "phase": 0.7, "amplitude_2": -0.5, "phase_2": 0.2}
    model = model_with({"kind": "geared_ripple", "at": ["inertias.a", "inertias.b"]} | parameters)
    for x, u, _ in states(model):
        acceleration, _, _, torque = numbers(model, x, u)
        wave = 2.0 * np.sin(3 * x[1] + 0.7) - 0.5 * np.sin(6 * x[1] + 0.2)
        np.testing.assert_allclose(acceleration[0], (u[0] + wave - torque / RATIO) / 0.4, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(acceleration[1], torque / 1.5, rtol=1e-9, atol=1e-9)


def test_friction_by_recording_is_that_of_its_number_and_their_mean_without_one():
    model = model_with({"kind": "recording_friction", "at": "inertias.b", "torque": [2.0, 5.0, 8.0]})
    index = model.parameters.index("simulation.recording")
    for (x, u, _), number in itertools.product(states(model, 4), range(4)):
        p = np.array(model.p0)
        p[index] = number
        rates, torque = model.rates(x, u, p).full().ravel(), float(model.shaft_torques(x, u, p))
        friction = (5.0, 2.0, 5.0, 8.0)[number] * np.sign(x[3])
        np.testing.assert_allclose(rates[3], (torque - friction) / 1.5, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("reverse", [None, 0.6])
def test_gear_loss_takes_power_in_over_power_out(reverse):
    """Power into the loss over power out of it is the efficiency of the direction in which it flows."""
    more = {} if reverse is None else {"efficiency_reverse": reverse}
    model = model_with({"kind": "gear_loss", "at": "shafts.link", "efficiency": 0.8} | more)
    driven = 0
    for x, u, _ in states(model):
        acceleration, _, readings, torque = numbers(model, x, u)
        assert readings[1] == torque  # before the loss
        passed = torque * x[3]  # power that the shaft gives to its second end
        kept = 1.5 * acceleration[1] * x[3]  # and what the inertia there gets of it
        if passed > 0:
            assert kept == pytest.approx(0.8 * passed)
            driven += 1
        else:
            assert passed == pytest.approx((reverse or 0.8) * kept)
    assert 5 < driven < 25


def test_offset_of_an_input_is_a_constant_torque_of_the_other_sign():
    one = model_with({"kind": "input_offset", "at": "inputs.drive", "offset": 2.5})
    other = model_with({"kind": "constant_torque", "at": "inertias.a", "torque": -2.5})
    for x, u, _ in states(one, 5):
        np.testing.assert_allclose(numbers(one, x, u)[0], numbers(other, x, u)[0], rtol=1e-12)
    assert list(EFFECTS["constant_torque"].same_as("inertias.a", one.system)) == [("input_offset", "inputs.drive")]
    assert list(EFFECTS["constant_torque"].same_as("inertias.b", one.system)) == []


def test_hysteresis_in_parallel():
    model = model_with({"kind": "hysteresis", "at": "shafts.link", "torque": 6.0, "angle": 0.01})
    assert model.states[-1] == "shafts.link.hysteresis"
    for x, u, _ in states(model):
        twist, rate = twist_and_rate(x)
        acceleration, (slope,), _, torque = numbers(model, x, u)
        pull = 6.0 * x[4]  # the state is z/torque
        assert torque == pytest.approx(K * twist + D * rate + pull)
        assert 6.0 * slope == pytest.approx(rate * (1 - np.sign(rate) * pull / 6.0) * 6.0 / 0.01)
        np.testing.assert_allclose(acceleration[0], (u[0] - torque / RATIO) / 0.4)


def test_slip_in_series():
    series = 9.0
    model = model_with({"kind": "slip", "at": "shafts.link", "coefficient": series})
    for x, u, _ in states(model):
        _, rate = twist_and_rate(x)
        _, (spring_rate,), _, torque = numbers(model, x, u)
        assert torque == pytest.approx(K * x[4] + D * spring_rate)
        assert torque == pytest.approx(series * (rate - spring_rate))


def test_compliance_is_one_more_mass():
    model = model_with({"kind": "compliance", "at": "shafts.link", "stiffness": 900.0, "J": 0.02})
    plain = compiled(
        from_dict(
            {
                "inertias": {"a": {"J": 0.4}, "b": {"J": 1.5}, "m": {"J": 0.02}},
                "shafts": {
                    "link": {"between": ["a", "m"], "ratio": RATIO, "stiffness": K, "damping": D},
                    "more": {"between": ["m", "b"], "stiffness": 900.0},
                },
                "inputs": {"drive": {"on": "a"}},
            }
        )
    )
    assert len(model.coordinates) == 3
    for x, u, _ in states(model):
        np.testing.assert_allclose(model.rates(x, u, model.p0).full(), plain.rates(x, u, plain.p0).full(), atol=1e-9)


def test_all_at_one_shaft():
    """Lash, hardening, slip, hysteresis and a further compliance together; the balance is solved by root finding."""
    gap, cubic, series, friction, angle, stiffness, J = 0.03, 8e4, 7.0, 4.0, 0.02, 900.0, 0.02
    at = {"at": "shafts.link"}
    model = model_with(
        at | {"kind": "compliance", "stiffness": stiffness, "J": J},
        at | {"kind": "hysteresis", "torque": friction, "angle": angle},
        at | {"kind": "slip", "coefficient": series},
        at | {"kind": "backlash", "gap": gap},
        at | {"kind": "hardening", "cubic": cubic},
    )
    middle = model.coordinates.index("shafts.link.compliance")
    slip, dahl = (model.states.index(f"shafts.link.{kind}") for kind in ("slip", "hysteresis"))
    place = {name: model.coordinates.index(name) for name in ("a", "b")}
    seen = set()
    for x, u, _ in states(model, 300):
        x[slip] = x[slip] / 20
        speed = x[model.n :]
        rate, spring, pull = speed[place["a"]] / RATIO - speed[middle], x[slip], friction * x[dahl]
        side = np.sign(spring) * (abs(spring) > gap / 2)
        over = spring - side * gap / 2
        if abs(abs(spring) - gap / 2) < 1e-3 * (abs(rate) + 1):
            continue

        def unit(spring_rate, side=side, over=over):
            return no_pull(K * over + cubic * over**3 + D * spring_rate, side) if side else 0.0

        def balance(spring_rate, pull=pull, rate=rate, unit=unit):
            return unit(spring_rate) + pull - series * (rate - spring_rate)

        spring_rate = brentq(balance, -1e4, 1e4, xtol=1e-12, rtol=1e-14)
        expected = unit(spring_rate) + pull
        rates = model.rates(x, u, model.p0).full().ravel()
        assert float(model.shaft_torques(x, u, model.p0)) == pytest.approx(expected, abs=1e-7)
        assert rates[slip] == pytest.approx(spring_rate, abs=1e-8)
        assert rates[dahl] == pytest.approx((spring_rate - abs(spring_rate) * x[dahl]) / angle, abs=1e-6)
        further = stiffness * (x[middle] - x[place["b"]])
        assert rates[model.n + middle] == pytest.approx((expected - further) / J, abs=1e-5)
        assert rates[model.n + place["b"]] == pytest.approx(further / 1.5, abs=1e-8)
        seen.add((side, unit(spring_rate) == 0))
    assert {(0.0, True), (1.0, False), (-1.0, False)} <= seen


def test_inputs():
    plain = model_with()
    gain = model_with({"kind": "input_gain", "at": "inputs.drive", "factor": 1.3})
    lag = model_with({"kind": "lag", "at": "inputs.drive", "time_constant": 0.05})
    late = model_with({"kind": "dead_time", "at": "inputs.drive", "delay": 0.02})
    assert late.delays(late.p0)[0].full().ravel() == pytest.approx([0.02])
    for x, u, _ in states(plain):
        expected = numbers(plain, x, 1.3 * u)[0]
        np.testing.assert_allclose(numbers(gain, x, u)[0], expected)
        np.testing.assert_allclose(numbers(late, x, u)[0], numbers(plain, x, u)[0])
        lagged = numbers(lag, np.append(x, 7.0), u)
        np.testing.assert_allclose(lagged[0], numbers(plain, x, np.array([7.0]))[0])
        assert lagged[1] == pytest.approx((u - 7.0) / 0.05)


def test_sensors():
    at = {"at": "sensors.torque"}
    plain = model_with()
    for kind, parameters, law in (
        ("sensor_offset", {"offset": 0.7}, lambda y, t: y + 0.7),
        ("sensor_gain", {"factor": 0.9}, lambda y, t: 0.9 * y),
        ("sensor_drift", {"rate": 0.03}, lambda y, t: y + 0.03 * t),
    ):
        model = model_with(at | {"kind": kind} | parameters)
        for x, u, t in states(model):
            truth = numbers(plain, x, u)[2]
            read = numbers(model, x, u, t)[2]
            assert read[1] == pytest.approx(law(truth[1], t))
            assert read[0] == truth[0]
    late = model_with(at | {"kind": "sensor_delay", "delay": 0.004})
    assert late.delays(late.p0)[1].full().ravel() == pytest.approx([0.0, 0.004])
    lag = model_with(at | {"kind": "lag", "time_constant": 0.05})
    for x, u, _ in states(plain):
        truth = numbers(plain, x, u)[2]
        _, slope, read, _ = numbers(lag, np.append(x, 7.0), u)
        assert read[1] == 7.0
        assert slope[0] == pytest.approx((truth[1] - 7.0) / 0.05)


def test_lag_of_an_accelerometer_follows_the_acceleration():
    at = {"kind": "lag", "at": "sensors.felt", "time_constant": 0.05}
    made = {
        "inertias": {"rotor": {"J": 2.0}},
        "inputs": {"motor": {"on": "rotor"}},
        "sensors": {"felt": {"measures": "acceleration", "of": "rotor"}},
    }
    model = compiled(from_dict(made | {"effects": [at]}))
    rate = np.array(model.rates([0.0, 0.0, 0.7], [6.0], model.p0)).ravel()
    assert rate[2] == pytest.approx((6.0 / 2.0 - 0.7) / 0.05)


def test_lag_behind_a_drift_delays_the_ramp_by_its_time_constant():
    effects = [
        {"kind": "sensor_drift", "at": "sensors.seen", "rate": 3.0},
        {"kind": "lag", "at": "sensors.seen", "time_constant": 0.05},
    ]
    made = {
        "inertias": {"rotor": {"J": 2.0}},
        "inputs": {"motor": {"on": "rotor"}},
        "sensors": {"seen": {"measures": "speed", "of": "rotor"}},
    }
    model = compiled(from_dict(made | {"effects": effects}))
    assert float(model.readings([0.0, 0.0, 0.7], [6.0], model.p0, 2.0)) == pytest.approx(0.7 + 3.0 * (2.0 - 0.05))


@pytest.mark.parametrize(
    "name", ["inertias.b.J", "shafts.link.stiffness", "shafts.link.damping", "shafts.link.ratio", "inertias.a.drag"]
)
def test_wrong_parameter(name):
    model = model_with({"kind": "wrong_parameter", "at": name, "value": 3.3})
    truth = compiled(from_dict(BASE).with_values({name: 3.3}))
    for x, u, _ in states(model, 10):
        np.testing.assert_allclose(model.rates(x, u, model.p0).full(), truth.rates(x, u, truth.p0).full())
    assert model.system.units[f"{name}.wrong_parameter.value"] == model.system.units[name]


def test_wrong_gear_ratio():
    data = {
        "inertias": {"a": {"J": 0.4}, "b": {"J": 1.5}},
        "gears": {"g": {"between": ["a", "b"], "ratio": 2.0}},
        "effects": [{"kind": "wrong_parameter", "at": "gears.g.ratio", "value": 3.0}],
    }
    model = compiled(from_dict(data))
    assert float(model.mass(model.p0)) == pytest.approx(0.4 * 9 + 1.5)


def test_every_kind_of_the_specification_is_there():
    """Kinds beyond it have a test file of their own."""
    table = (
        "backlash hardening hysteresis slip compliance coulomb_friction stribeck_friction quadratic_drag "
        "constant_torque torque_ripple dead_time lag input_gain sensor_offset "
        "sensor_gain sensor_drift sensor_delay wrong_parameter"
    )
    assert set(table.split()) <= set(EFFECTS)
    for kind in EFFECTS.values():
        assert kind.__doc__
        assert kind.parameters or kind.imposes_motion


def test_an_effect_is_refused_where_it_cannot_sit():
    for effect, message in (
        ({"kind": "backlash", "at": "inertias.a", "gap": 0.1}, "inertias.a"),
        ({"kind": "backlash", "at": "shafts.link", "gap": -0.1}, "-0.1 is not possible"),
        ({"kind": "backlash", "at": "shafts.link"}, "'gap' is missing"),
        ({"kind": "wrong_parameter", "at": "inertias.b", "value": 1.0}, "did you mean"),
    ):
        with pytest.raises(InputError, match=message):
            from_dict(BASE | {"effects": [effect]})
