"""Compiled and virtual path, readings and derivatives."""

import numpy as np
import pytest

from modelling.effects import EFFECTS as registry
from modelling.equations.casadi_code import compiled
from modelling.simulation.simulate import sensitivities, simulate, simulate_batch, with_stick_speed
from tests.simulation.drives import EFFECTS, excitation, system_with

MIXED = [
    (),
    ("backlash", "coulomb_friction", "dead_time", "sensor_delay", "lag"),
    ("hysteresis", "hardening", "stribeck_friction", "sensor_gain", "sensor_drift"),
    ("slip", "compliance", "quadratic_drag", "brake", "wrong_parameter", "gain_drift", "parameter_drift"),
    ("constant_torque", "torque_ripple", "input_gain", "sensor_offset", "input_offset", "load_friction"),
    ("gear_loss", "position_torque", "clock_offset", "tyre_slip", "all_pass", "recording_friction", "geared_ripple"),
    ("imposed_motion", "hardening", "coulomb_friction", "sensor_delay"),
]


@pytest.mark.parametrize("kinds", MIXED, ids="+".join)
def test_every_kind_is_simulated_alike_by_both_paths(kinds):
    system = system_with(*kinds)
    time, inputs = excitation(1.0)
    inputs |= {name: np.abs(inputs[name]) for name in system.brakes}
    fast, slow = simulate(system, time, inputs), simulate(system, time, inputs, compile=False)
    for name, reading in fast.readings.items():
        np.testing.assert_allclose(reading, slow.readings[name], atol=1e-9 * np.ptp(reading), rtol=0)


def test_the_mixtures_hold_every_kind():
    assert {kind for kinds in MIXED for kind in kinds} == set(EFFECTS) <= set(registry)


@pytest.mark.parametrize("kinds", MIXED, ids="+".join)
def test_derivatives_are_those_of_finite_differences(kinds, path):
    model = compiled(system_with(*kinds))
    time, inputs = excitation(0.4)
    start = {"speed(motor)": 0.3, "speed(load)": 0.3, "angle(motor)": 0.02}
    start |= {name: 0.5 for name in model.states if name.endswith(".lag")}  # given, so that parameters do not move it
    p, steps = with_stick_speed(model, time, inputs, model.p0, start), 4000.0
    names = [name for name in model.parameters if not name.startswith("simulation")] + list(start)
    got = sensitivities(model, time, inputs, p, names, start, steps_per_second=steps, compile=path)
    base = dict(zip(model.parameters, p, strict=True)) | start

    def readings(values):
        row = np.array([values[name] for name in model.parameters])
        begin = {name: values[name] for name in start}
        return simulate_batch(model, time, inputs, row[None], begin, steps_per_second=steps, compile=path)[0]

    np.testing.assert_allclose(got.readings, readings(base), rtol=1e-12)
    for column, name in enumerate(names):
        differences = []
        for h in (1e-5 * max(abs(base[name]), 1e-2), 1e-8):  # the small one where a kink of the law is near
            expected = (readings(base | {name: base[name] + h}) - readings(base | {name: base[name] - h})) / (2 * h)
            rounding = 1e-8 / h
            differences.append(
                np.abs(got.jacobian[:, :, column] - expected) / (np.abs(expected).max(axis=0) + rounding)
            )
        assert min(np.median(one) for one in differences) < 1e-5, name
        assert max(np.mean(one < 1e-4) for one in differences) > 0.98, name
