"""Start states of held-out data with backlash, and which inertias turn together."""

from dataclasses import replace

import numpy as np
import pytest

from matching.diagnosis.data import FitData, Segment
from matching.diagnosis.descent import Fit
from matching.diagnosis.holdout import holdout_residuals, rms_by_sensor, simulate_other
from matching.diagnosis.problem import angles_without_reading, base_problem, first_state, flank_shifts
from matching.diagnosis.simulation import simulate_readings
from modelling.equations.casadi_code import compiled
from modelling.model_file import from_dict

GAP = 0.05


def chain(**effects):
    return from_dict({
        "inertias": {"motor": {"J": 0.1}, "hub": {"J": 0.2}, "load": {"J": 1.0}},
        "shafts": {
            "link": {"between": ["motor", "hub"], "stiffness": 300, "damping": 0.6},
            "side": {"between": ["hub", "load"], "stiffness": 400, "damping": 0.6, "ratio": 2.0},
        },
        "inputs": {"torque": {"on": "motor"}},
        "sensors": {
            "motor_speed": {"measures": "speed", "of": "motor", "uncertainty": 0.02},
            "load_speed": {"measures": "speed", "of": "load", "uncertainty": 0.02},
            "link_torque": {"measures": "torque", "of": "link", "uncertainty": 0.02},
        },
    } | effects)  # fmt: skip


def test_shifts_go_to_both_flanks_and_leave_the_other_shafts_untwisted() -> None:
    system = chain(effects=[{"kind": "backlash", "at": "shafts.link", "gap": GAP}])
    none, low, high = flank_shifts(system, compiled(system))
    assert not none.any()
    np.testing.assert_allclose(low, -high)
    motor, hub, load = high[:3]
    assert motor - hub == pytest.approx(-GAP / 2)
    assert hub / 2 - load == pytest.approx(0.0)
    assert not high[3:].any()
    assert len(flank_shifts(chain(), compiled(chain()))) == 1


@pytest.mark.parametrize("flank", [-1, 1])
def test_a_recording_that_begins_on_a_flank_is_simulated_to_the_noise(flank: int) -> None:
    system = chain(effects=[{"kind": "backlash", "at": "shafts.link", "gap": GAP}])
    model, time = compiled(system), np.arange(600) * 1e-3
    torque = flank * (8.0 + 4 * np.sin(2 * np.pi * 3 * time))
    start = np.concatenate([[0.0, -flank * (GAP / 2 + 0.02), -flank * (GAP / 4 + 0.01)], [5.0, 5.0, 2.5]])
    segment = Segment(time, torque[:, None], np.zeros((600, 3)), "made")
    exact = simulate_readings(model, [segment], model.p0[None], [start[None]], 8000.0)[0][0]
    noise = 0.02 * np.random.default_rng(1).standard_normal(exact.shape)
    data = FitData((replace(segment, readings=exact + noise),), np.full(3, 0.02))
    problem, v = base_problem(system, data)
    problem = replace(problem, steps_per_second=8000.0)
    residual = problem.residuals(v[None])[0]
    fit = Fit(problem, v, residual, np.zeros((len(residual), len(v))), float(residual @ residual))
    assert rms_by_sensor(holdout_residuals(simulate_other(fit, data))) == pytest.approx(1.0, abs=0.1)


def test_imposed_angle_is_where_the_drivetrain_begins():
    """All of it stands at the first angle, behind a ratio of 2 at half; speeds as the angle changes."""
    system = from_dict({
        "inertias": {"motor": {"J": 0.1}, "load": {"J": 1.0}},
        "shafts": {"link": {"between": ["motor", "load"], "stiffness": 300, "ratio": 2.0}},
        "inputs": {"road": {"on": "motor", "measures": "angle"}},
        "sensors": {"torque": {"measures": "torque", "of": "link"}},
        "effects": [{"kind": "imposed_motion", "at": "inertias.motor"}],
    })  # fmt: skip
    model, time = compiled(system), np.arange(0, 1, 0.01)
    segment = Segment(time, 3.0 + 4.0 * time[:, None], np.full((len(time), 1), np.nan))
    state = dict(zip(model.states, first_state(system, model, segment), strict=True))
    by_name = dict(zip(model.coordinates, list(state.values())[: model.n], strict=True))
    assert by_name == pytest.approx({"motor": 3.0, "load": 1.5})
    assert list(state.values())[model.n + model.coordinates.index("motor")] == pytest.approx(4.0)
    assert not angles_without_reading(system, model)


def start_of(system, readings, inputs=None):
    """The first state by name, from readings of ten samples."""
    model = compiled(system)
    inputs = np.zeros((10, len(system.inputs))) if inputs is None else inputs
    x = first_state(system, model, Segment(np.arange(10) * 0.01, inputs, np.tile(readings, (10, 1))))
    return dict(zip(model.coordinates, zip(x[: model.n], x[model.n :])))


def with_sensors(**sensors):
    return chain(sensors={
        name: {"measures": measures, "of": of, "uncertainty": 0.01} for name, (measures, of) in sensors.items()
    })  # fmt: skip


def test_measured_speeds_are_taken_and_others_turn_with_their_mean() -> None:
    """The side shaft halves: 30 rad/s at the motor and 10 at the load are 25 at the hub."""
    found = start_of(with_sensors(a=("speed", "motor"), t=("torque", "link"), b=("speed", "load")), [30.0, 7.0, 10.0])
    assert found == {"motor": (0.0, 30.0), "hub": (0.0, 25.0), "load": (0.0, 10.0)}


@pytest.mark.parametrize("measured", ["motor", "pinion", "left"])
def test_a_drivetrain_with_ratios_and_a_differential_starts_without_twist(measured) -> None:
    """Motor at 200 rad/s: behind a ratio of 10, a gear of 2 and a differential the wheels turn at 10 rad/s."""
    system = from_dict({
        "inertias": {name: {"J": 0.1} for name in ("motor", "pinion", "cage", "left", "right")},
        "shafts": {"input": {"between": ["motor", "pinion"], "stiffness": 4e5, "ratio": 10.0}},
        "gears": {"final": {"between": ["pinion", "cage"], "ratio": 2.0}},
        "differentials": {"axle": {"cage": "cage", "left": "left", "right": "right"}},
        "inputs": {"torque": {"on": "motor"}},
        "sensors": {"n": {"measures": "speed", "of": measured, "uncertainty": 0.01}},
    })  # fmt: skip
    truth = {"motor": 200.0, "pinion": 20.0, "cage": 10.0, "left": 10.0, "right": 10.0}
    found = start_of(system, [truth[measured]])
    assert {name: speed for name, (_, speed) in found.items()} == pytest.approx({name: truth[name] for name in found})


def test_an_angle_gives_the_whole_part_its_angle_and_no_speed() -> None:
    """The side shaft halves: where the motor stands at 0.6 rad the load stands at 0.3."""
    found = start_of(with_sensors(a=("angle", "motor"), b=("angle", "load"), n=("speed", "hub")), [0.6, 5.0, 4.0])
    assert {name: angle for name, (angle, _) in found.items()} == pytest.approx({"motor": 0.6, "hub": 0.6, "load": 0.3})
    assert {name: speed for name, (_, speed) in found.items()} == {"motor": 4.0, "hub": 4.0, "load": 2.0}


def test_readings_that_are_missing_leave_rest() -> None:
    found = start_of(with_sensors(a=("angle", "motor"), n=("speed", "hub")), [np.nan, np.nan])
    assert set(found.values()) == {(0.0, 0.0)}
