"""Which intervals of a recording get finer steps, and what local errors say."""

from dataclasses import replace

import numpy as np
import pytest

from modelling.equations.casadi_code import compiled
from modelling.simulation import compiled as native
from modelling.simulation import interpreted as virtual
from modelling.simulation.stepping import (
    FASTEST,
    KINKED_ORDER,
    MOST_INTERPRETED,
    SMOOTH_ORDER,
    InitialValueProblem,
    SimulationError,
    Stepping,
    difference,
    divisions,
    local_errors,
    run_to_tolerance,
)
from modelling.simulation.task import make_task
from tests.simulation.drives import excitation, system_with


def test_the_largest_errors_are_lowered_to_one_level():
    errors = np.array([1.0, 64.0, 1.0, 16.0])
    np.testing.assert_array_equal(divisions(errors, 10.0, KINKED_ORDER), [1, 4, 1, 2])  # 1 + 4 + 1 + 4
    np.testing.assert_array_equal(divisions(errors, 10.0, SMOOTH_ORDER), [1, 2, 1, 2])
    np.testing.assert_array_equal(divisions(errors, 100.0, KINKED_ORDER), [1, 1, 1, 1])
    np.testing.assert_array_equal(divisions(errors, 0.25, KINKED_ORDER), [4, 32, 4, 16])  # 1/16 each


def recorded(*kinds, seconds=0.5, **values):
    model = compiled(system_with(*kinds))
    time, inputs = excitation(seconds)
    u = np.stack([inputs[name] for name in model.inputs], axis=1)
    return InitialValueProblem(model, time, u, model.vector(values)[None], np.zeros((1, len(model.states))))


@pytest.mark.parametrize("implicit", [False, True])
def test_both_paths_give_the_same_local_errors(implicit):
    given = recorded("hardening", "lag", seconds=0.1)
    task = make_task(
        given.model, given.time, given.inputs, given.p, given.start, 1000.0, refinement=2, implicit=implicit
    )
    fast, slow = native.run_compiled(task, errors=True), virtual.run(task, errors=True)
    if fast is None:
        pytest.skip("no compiler")
    assert fast.errors.shape[2] == len(given.model.sensors) + len(given.model.states) - given.model.n
    np.testing.assert_allclose(fast.errors, slow.errors, atol=1e-12 * np.abs(fast.readings).max(), rtol=1e-6)


def test_local_errors_of_a_quadrature_in_closed_form():
    """Without shaft torque and drag, speed is the integral of the torque: a hat of torque within a pair of steps."""
    given = recorded()
    model = given.model
    names = [name for name in model.parameters if name.endswith((".stiffness", ".damping", ".drag"))]
    p = model.vector(dict.fromkeys(names, 0.0))[None]
    time = np.array([0.0, 2.0, 4.0])
    u = np.zeros((3, len(model.inputs)))
    column = model.inputs.index("motor_torque")
    u[1, column] = 1.0
    J = p[0, model.parameters.index("inertias.motor.J")]
    late = np.full((1, len(model.inputs)), 0.5)  # s: the kink of the torque lies a quarter into the second pair
    task = replace(make_task(model, time, u, p, given.start, 1.0), input_delay=late)
    errors = virtual.run(task, errors=True).errors[0]
    speed = len(model.sensors) + [name for name in model.states if name.startswith("speed")].index("speed(motor)")
    # second interval, torque at 2, 2.5, 3, 3.5, 4 s: 0.75, 1, 0.75, 0.5, 0.25; Runge-Kutta is Simpson's rule on each
    # step: (0.75 + 4·1 + 0.75)/6 + (0.75 + 4·0.5 + 0.25)/6; the pair: (0.75 + 4·0.75 + 0.25)/3
    assert errors[1, speed] == pytest.approx(((5.5 + 3.0) / 6 - 4.0 / 3) / J, rel=1e-9)


def test_steps_are_divided_where_a_lash_closes_and_the_error_is_what_is_stated(path):
    given = recorded("backlash")
    done = run_to_tolerance(given, 1e-4, path)
    divided = np.asarray(done.stepping.refinement) / np.min(done.stepping.refinement)
    assert np.mean(divided == 1) > 0.5
    assert divided.max() >= 8
    fine = given.run(Stepping(100 * done.stepping.mean_rate(given.time)))
    error = difference(done.trajectories, fine, rough=True)
    assert error.max() < 1e-4
    assert done.error.max() < 1e-4
    assert done.error.max() > error.max() / 3


def test_local_errors_add_up_to_the_error_of_a_smooth_motion():
    given = recorded("hardening")
    coarse = given.run(Stepping(500.0, refinement=2), errors=True)
    fine = given.run(Stepping(64000.0))
    total = local_errors(coarse, given.model.n, rough=False).sum()
    error = difference(coarse, fine, rough=False).max()
    assert error < total < 100 * error


def test_steps_a_second_are_limited_and_the_error_that_is_left_is_stated():
    """An undamped shaft of 1e11 N·m/rad: this tolerance would take some 22 million steps a second."""
    given = recorded(seconds=0.005, **{"shafts.link.stiffness": 1e11, "shafts.link.damping": 0.0})
    done = run_to_tolerance(given, 1e-6)
    assert 0 < done.stepping.mean_rate(given.time) <= FASTEST
    exact = given.run(Stepping(1.6e8))
    assert 1e-6 < difference(done.trajectories, exact, rough=False).max() < done.error.max() < 0.1


def test_steps_without_a_compiler_are_limited_in_one_line():
    """A minute and gigabytes otherwise; within the limit, the error that is left is stated."""
    stiff = {"shafts.link.stiffness": 1e11, "shafts.link.damping": 0.0}
    with pytest.raises(SimulationError, match="take too long without a C compiler; install one"):
        recorded(seconds=0.5, **stiff).run(Stepping(1e8), compiled=False)
    done = run_to_tolerance(recorded(seconds=0.005, **stiff), 1e-6, compiled=False)
    assert done.stepping.count(recorded(seconds=0.005).time) * len(recorded().model.states) <= MOST_INTERPRETED
    assert done.error.max() > 1e-6
