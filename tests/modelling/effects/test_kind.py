"""What a kind states about itself, against its compiled equations."""

import numpy as np
import pytest

from modelling.effects import EFFECTS
from modelling.equations.casadi_code import compiled
from modelling.modal.modes import modes
from modelling.model_file import from_dict
from modelling.units import unit_of

BASE = {
    "inertias": {"a": {"J": 0.4}, "b": {"J": 1.5}},
    "shafts": {"link": {"between": ["a", "b"], "stiffness": 300.0, "damping": 0.6}},
    "inputs": {"drive": {"on": "a"}},
    "sensors": {"speed": {"measures": "speed", "of": "b"}},
}
PLACES = {"shafts": "shafts.link", "inertias": "inertias.b", "inputs": "inputs.drive", "sensors": "sensors.speed"}
VALUES = {
    "all_pass": {"delay": 0.01}, "angle_zero": {"zero": 0.7}, "clock_offset": {"offset": 0.01},
    "input_offset": {"offset": 2.0},
    "gain_drift": {"change": 0.3, "time_constant": 2.0}, "parameter_drift": {"change": 0.3, "time_constant": 2.0},
    "gear_loss": {"efficiency": 0.9, "efficiency_reverse": 0.8},
    "position_torque": {"period": 2 * np.pi / 3, "amplitude": 2.0, "phase": 0.4},
    "backlash": {"gap": 0.02}, "compliance": {"stiffness": 900.0, "J": 0.1}, "constant_torque": {"torque": 3.0},
    "coulomb_friction": {"torque": 3.0}, "dead_time": {"delay": 0.01}, "hardening": {"cubic": 2e4},
    "imposed_motion": {},
    "hysteresis": {"torque": 4.0, "angle": 0.01}, "input_gain": {"factor": 1.2}, "lag": {"time_constant": 0.05},
    "quadratic_damping": {"coefficient": 2.0}, "quadratic_drag": {"coefficient": 0.7}, "sensor_delay": {"delay": 0.01},
    "sensor_drift": {"rate": 0.1}, "sensor_gain": {"factor": 0.9}, "sensor_offset": {"offset": 0.5},
    "relaxation": {"stiffness": 250.0, "time_constant": 0.02},
    "double_relaxation": {"stiffness": 250.0, "time_constant": 0.02, "stiffness_2": 90.0, "time_constant_2": 0.2},
    "directional_stiffness": {"factor": 0.6}, "warming_friction": {"torque": 3.0, "change": -0.5, "time_constant": 2.0},
    "saturation": {"limit": 4.0}, "rate_limit": {"rate": 40.0}, "falling_torque_constant": {"torque": 9.0},
    "brake": {"deflection": 0.2}, "hum": {"amplitude": 0.4, "frequency": 50.0, "phase": 0.3},
    "slip": {"coefficient": 9.0}, "stribeck_friction": {"torque": 3.0, "breakaway": 8.0, "speed": 2.0},
    "load_friction": {"coefficient": 0.1},
    "sensor_ripple": {"order": 2, "amplitude": 0.01, "phase": 0.4, "amplitude_2": 0.004, "phase_2": 1.0},
    "geared_ripple": {"order": 6, "amplitude": 2.0, "phase": 0.4},
    "recording_friction": {"torque": [2.0, 4.0]},
    "table": {"speed": [-3.0, -1.0, 0.0, 2.0], "torque": [5.0, 1.0, 0.0, -3.0]},
    "torque_map": {"speed": [-3.0, 0.0, 2.0], "pedal": [0.0, 0.4, 1.0], "torque": [[1, 4, 6], [0, 3, 5], [-2, 2, 3]]},
    "tyre_slip": {"slip_stiffness": 60.0, "peak": 12.0},
    "torque_ripple": {"order": 6, "amplitude": 2.0, "phase": 0.4}, "wrong_parameter": {"value": 3.3},
}  # fmt: skip


def with_effect(kind, **changed):
    at = "inertias.b.J" if EFFECTS[kind].replaces_quantity else PLACES[EFFECTS[kind].tables[0]]
    at = "shafts.link.stiffness" if EFFECTS[kind].changes_quantity else at
    at = ["inertias.a", at] if EFFECTS[kind].follows else at
    at = "inertias.a" if kind == "load_friction" else at  # where the input acts
    base = BASE | {"sensors": {"speed": {"measures": "angle", "of": "b"}}} if kind == "angle_zero" else BASE
    return compiled(from_dict(base | {"effects": [{"kind": kind, "at": at} | VALUES[kind] | changed]}))


def output(model, x, u, t=0.0):
    """Rates of the states and readings."""
    readings = model.readings(x, u, model.p0, t)
    return np.concatenate([np.array(part).ravel() for part in (model.rates(x, u, model.p0), readings)])


def states(model, count=8):
    rng = np.random.default_rng(1)
    return [np.concatenate([0.05 * rng.normal(size=model.n), rng.normal(size=len(model.states) - model.n)])
            for _ in range(count)]  # fmt: skip


def test_every_kind_is_tested_here():
    assert set(VALUES) == set(EFFECTS)


@pytest.mark.parametrize("kind", EFFECTS)
def test_state_dependent_where_the_eigenvalues_are(kind):
    model = with_effect(kind)
    sticks = "simulation.stick_speed" in model.parameters
    p = model.vector({"simulation.stick_speed": 1.0} if sticks else {})  # near the speeds of these states
    eigenvalues = [
        np.sort_complex(np.linalg.eigvals(np.array(model.jacobians(x, [5.0], p, 0.0)[0]))) for x in states(model)
    ]
    differ = max(np.abs(own - eigenvalues[0]).max() for own in eigenvalues) > 1e-6 * np.abs(eigenvalues).max()
    assert EFFECTS[kind].state_dependent == differ


@pytest.mark.parametrize("kind", EFFECTS)
def test_linear_where_responses_add_up_and_nothing_is_delayed(kind):
    model = with_effect(kind)
    delayed = any(np.array(delay).any() for delay in model.delays(model.p0))
    one, two = states(model, 2)
    added = output(model, one + two, [5.0], 1.0)
    adds_up = np.allclose(added, output(model, one, [2.0], 1.0) + output(model, two, [3.0], 1.0), rtol=1e-9, atol=1e-9)
    assert EFFECTS[kind].linear == (adds_up and not delayed)


@pytest.mark.parametrize("kind", EFFECTS)
def test_its_state_is_named_after_it(kind):
    model, law = with_effect(kind), EFFECTS[kind]
    (effect,) = model.system.effects
    wanted = [effect.name] * bool(law.state) + [f"{effect.name}.2"] * bool(law.second_state)
    assert model.states[2 * model.n :] == wanted
    meanings = [law.state.meaning if law.state else "", law.second_state]
    assert all("{place}" in meaning for meaning in meanings if meaning)


def test_units_of_states():
    units = {kind: law.state_unit(PLACES[law.tables[0]], with_effect(kind).system)
             for kind, law in EFFECTS.items() if law.state}  # fmt: skip
    assert units == {"all_pass": "rad/s", "gain_drift": "1", "hysteresis": "1", "lag": "N*m", "parameter_drift": "1",
                     "relaxation": "rad", "double_relaxation": "rad", "rate_limit": "N*m", "warming_friction": "1",
                     "slip": "rad", "tyre_slip": "rad", "brake": "rad"}  # fmt: skip
    assert EFFECTS["lag"].state_unit("sensors.speed", from_dict(BASE)) == "rad/s"


@pytest.mark.parametrize("kind", EFFECTS)
def test_what_settles_has_a_rate_that_falls_with_it(kind):
    """A state settles if its rate depends on itself, at rest, with a negative sign."""
    law = EFFECTS[kind]
    if law.state:
        model = with_effect(kind)
        A = np.array(model.jacobians(np.zeros(len(model.states)), [0.0], model.p0, 0.0)[0])
        still = np.abs(A[-1, : 2 * model.n]).max() < 1e-12  # what moves with the shaft settles with it, not by itself
        reads = law.tables == ("sensors",)  # and does not act on what it reads
        assert (law.state.settles or law.state.from_zero) == (A[-1, -1] < 0 and (still or reads))


@pytest.mark.parametrize("kind", EFFECTS)
def test_zero_mean_over_a_turn(kind):
    if EFFECTS[kind].zero_mean:
        model = with_effect(kind)
        zero = with_effect(kind, **dict.fromkeys(EFFECTS[kind].zero_mean, 0.0))
        angles = 2 * np.pi * np.arange(360) / 360
        mean = np.mean([output(model, [a, a, 1.0, 1.0], [2.0]) for a in angles], axis=0)
        np.testing.assert_allclose(mean, output(zero, [0.0, 0.0, 1.0, 1.0], [2.0]), atol=1e-9)


def test_what_sticks_changes_sign_over_the_stick_speed():
    for kind, law in EFFECTS.items():
        assert law.sticks == ("simulation.stick_speed" in with_effect(kind).parameters), kind


def test_free_play_is_the_distance_between_the_flanks():
    for kind, law in EFFECTS.items():
        if law.free_play:
            model = with_effect(kind)
            gap = VALUES[kind][law.free_play]
            assert model.system.free_plays == {"shafts.link": f"shafts.link.{kind}.{law.free_play}"}
            torque = [float(model.shaft_torques([twist, 0, 0, 0], [0.0], model.p0)) for twist in
                      (-gap / 2 - 0.01, -0.49 * gap, 0.49 * gap, gap / 2 + 0.01)]  # fmt: skip
            assert torque == pytest.approx([-3.0, 0.0, 0.0, 3.0])
            assert law.abrupt


def test_hysteresis_stiffens_the_shaft_in_modes():
    """For small twists a Dahl element is a spring of torque/angle in parallel (Dahl 1968)."""
    frequency = modes(with_effect("hysteresis").system).frequencies[1]
    assert frequency == pytest.approx(np.sqrt((300.0 + 4.0 / 0.01) * (1 / 0.4 + 1 / 1.5)) / (2 * np.pi))


def test_units_of_parameters_are_known():
    """A form that is written with a word of its own stands for the unit of the place."""
    of_places = {"sensor", "sensor/s", "quantity"}
    for kind, law in EFFECTS.items():
        for key, parameter in law.parameters.items():
            assert parameter.unit in of_places or unit_of(parameter.unit, f"{kind}.{key}") is not None
