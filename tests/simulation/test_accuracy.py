"""Steps follow a stated tolerance: against right-hand sides written here, and against finer steps for stiff models."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from small_drives import chain

from matching.diagnosis.data import Segment
from matching.diagnosis.simulation import simulate_readings
from modelling.equations.casadi_code import compiled
from modelling.model_file import from_dict
from modelling.simulation.simulate import simulate
from modelling.simulation.stepping import InitialValueProblem, Stepping
from tests.simulation.drives import excitation, system_with

RANGE_SHARE = 1e-3  # largest error allowed, of a reading's range
TIME = np.arange(401) * 1e-3
TORQUE = 300 * np.sign(np.sin(2 * np.pi * 4 * TIME + 0.1))


def drive(J, effect):
    return from_dict(
        {
            "inertias": {"motor": {"J": J, "drag": 0.02}, "load": {"J": 1.0, "drag": 0.15}},
            "shafts": {"link": {"between": ["motor", "load"], "stiffness": 200.0, "damping": 0.5}},
            "inputs": {"motor_torque": {"on": "motor"}},
            "sensors": {
                "motor_speed": {"measures": "speed", "of": "motor"},
                "link_torque": {"measures": "torque", "of": "link"},
            },
            "effects": [effect],
        },
        "test",
    )


def independent(J, damping, drag):
    """Motor speed and link torque of the same drive by an implicit method of order five."""

    def link(x):
        rate = x[2] - x[3]
        return 200 * (x[0] - x[1]) + 0.5 * rate + damping * rate * abs(rate)

    def rate(t, x):
        torque = link(x)
        motor = np.interp(t, TIME, TORQUE) - torque - 0.02 * x[2] - drag * x[2] * abs(x[2])
        return [x[2], x[3], motor / J, torque - 0.15 * x[3]]

    done = solve_ivp(rate, (0, TIME[-1]), np.zeros(4), "Radau", TIME, rtol=1e-9, atol=1e-10, max_step=1e-3)
    return {"motor_speed": done.y[2], "link_torque": link(done.y)}


@pytest.mark.parametrize(
    ("J", "damping", "drag"), [(0.005, 0.05, 0.0), (0.05, 5.0, 0.0), (0.005, 0.0, 0.05), (5e-4, 0.0, 5.0)]
)
def test_laws_that_grow_with_the_square_of_speed(J, damping, drag, path):
    effect = {"kind": "quadratic_damping", "at": "shafts.link", "coefficient": damping}
    if drag:
        effect = {"kind": "quadratic_drag", "at": "inertias.motor", "coefficient": drag}
    got = simulate(drive(J, effect), TIME, {"motor_torque": TORQUE}, compile=path)
    for name, expected in independent(J, damping, drag).items():
        assert np.abs(got[name] - expected).max() < RANGE_SHARE * np.ptp(expected), name
        assert got.integration_error[name] < 1e-4


def stiff_chain():
    """22 inertias with a light one between stiff, overdamped shafts: 3.6 kHz, decays within µs."""
    omega = 2 * np.pi * 3600
    J, stiffness, damping = [0.05] * 22, [5e4] * 21, [5.0] * 21
    J[7], stiffness[6:8], damping[6:8] = 2e-3, [omega**2 * 1e-3] * 2, [12 * omega * 1e-3] * 2
    sensors = {
        "first": {"measures": "speed", "of": "i0"},
        "last": {"measures": "speed", "of": "i21"},
        "torque": {"measures": "torque", "of": "s10"},
    }
    return chain(J, stiffness, damping, inputs={"motor": {"on": "i0"}}, sensors=sensors)


def test_a_stiff_chain_is_stepped_implicitly_and_right():
    model = compiled(stiff_chain())
    motor = 50 * np.sin(2 * np.pi * 2 * TIME) + 20 * np.sign(np.sin(2 * np.pi * 5 * TIME))
    got = simulate(model, TIME, {"motor": motor})
    fine = simulate(model, TIME, {"motor": motor}, steps_per_second=5e5)
    assert got.implicit
    assert got.steps_per_second < 1.2e4
    for name, expected in fine.readings.items():
        assert np.abs(got[name] - expected).max() < 1e-4 * np.ptp(expected), name


def test_implicit_steps_have_order_four(path):
    model = compiled(system_with("hardening"))
    time, inputs = excitation(1.0, rate=50.0)
    u = np.stack([inputs[name] for name in model.inputs], axis=1)
    recorded = InitialValueProblem(model, time, u, model.p0[None], np.zeros((1, 4)))
    fine = recorded.run(Stepping(25600.0), path).readings
    errors = [
        np.abs(recorded.run(Stepping(rate, implicit=True), path).readings - fine).max()
        for rate in (200.0, 400.0, 800.0)
    ]
    np.testing.assert_allclose(np.log2(np.array(errors[:-1]) / errors[1:]), 4, atol=0.4)


def test_a_finer_tolerance_gives_smaller_errors():
    system, (time, inputs) = system_with("hardening"), excitation(0.5)
    fine = simulate(system, time, inputs, steps_per_second=64000.0)["link_torque"]
    errors = [
        np.abs(simulate(system, time, inputs, tolerance=share)["link_torque"] - fine).max() / np.ptp(fine)
        for share in (1e-2, 1e-8)
    ]
    assert errors[0] < 1e-2
    assert errors[1] < 1e-8


def test_a_fit_steps_a_stiff_chain_implicitly():
    """With the few steps a sample that a fit takes, explicit ones run away."""
    model = compiled(stiff_chain())
    motor = 50 * np.sin(2 * np.pi * 2 * TIME)[:, None]
    segment = Segment(TIME, motor, np.zeros((len(TIME), 3)))
    (got,) = simulate_readings(model, [segment], model.p0[None], [np.zeros((1, len(model.states)))], 8000.0)
    expected = simulate(model, TIME, motor)
    for j, name in enumerate(model.sensors):
        assert np.abs(got[0, :, j] - expected[name]).max() < 1e-4 * np.ptp(expected[name]), name
