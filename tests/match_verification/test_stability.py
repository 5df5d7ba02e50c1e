"""Poles of the sampled loop against closed forms, and rigid motions that coast."""

from dataclasses import replace

import numpy as np
import pytest

from matching.match.damping import is_stable_loop
from matching.match.loop import feedback_on, linear_bed
from matching.match.loop_modes import ClosedLoop, neutral_motions
from modelling.linear.state_space import discretise


def test_poles_of_an_integrator_under_a_sampled_gain_are_those_of_the_textbook():
    """x⁺ = x + T·u(k − 1), u = −K·x: z² − z + K·T = 0, which leaves the unit circle at K·T = 1."""
    step, gain = 0.001, 400.0
    held = discretise(np.zeros((1, 1)), np.ones((1, 1)), step)
    matrix = np.array([[held.transition[0, 0], held.held[0, 0]], [-gain, 0.0]])
    z = np.linalg.eigvals(matrix)
    np.testing.assert_allclose(np.sort_complex(z), np.sort_complex(np.roots([1, -1, gain * step])), rtol=1e-12)
    assert is_stable_loop(z, 0)
    assert not is_stable_loop(np.roots([1, -1, 1.01]), 0)


def test_a_pole_at_one_is_a_rigid_motion_only_where_there_is_one():
    assert is_stable_loop(np.array([1.0, 0.5]), 1)
    assert not is_stable_loop(np.array([1.0, 0.5]), 0)


def test_an_apparent_solution_is_found_out(reference):
    """A loop with a large margin everywhere that is not stable."""
    values = {
        "proportional_gain": 16.8236, "integral_gain": 100.0, "torque_feed_forward": 1.4399,
        "acceleration_feed_forward": 1.0321, "lead_time": 0.0, "dead_time": 0.0005,
    }  # fmt: skip
    bed = linear_bed(replace(reference, loop=reference.loop.with_values(values)))
    assert np.abs(_closed(bed).poles).max() > 1


def _closed(bed):
    return ClosedLoop.of(bed, feedback_on(bed))


def test_without_torque_the_modes_are_those_of_the_rig_with_its_lags(reference):
    gains = ("proportional_gain", "integral_gain", "torque_feed_forward", "acceleration_feed_forward")
    loop = reference.loop.with_values(dict.fromkeys(gains, 0.0))
    bed = linear_bed(replace(reference, loop=loop))
    values = np.linalg.eigvals(_closed(bed).matrix)
    wanted = np.exp(np.linalg.eigvals(bed.bed.A) * loop["sample_time"])
    for z in wanted:
        assert np.abs(values - z).min() < 1e-7


def without_drag(case, rig):
    def free(system):
        return system.with_values({name: 0.0 for name in system.parameters if name.endswith(".drag")})

    residual = case.residual_vehicle
    tuned = replace(residual, parts=tuple(free(part) for part in residual.parts))
    return linear_bed(replace(case, residual_vehicle=tuned, rig=free(case.rig) if rig else case.rig))


@pytest.mark.parametrize("rig", [False, True])
@pytest.mark.parametrize(("gain", "stable"), [(100.0, True), (10.0, False)])
def test_a_vehicle_without_drag_coasts(reference, rig, gain, stable):
    """Rigid motions that nothing slows stand at 1: in the vehicle as in the loop, neither stable nor unstable."""
    bed = without_drag(replace(reference, loop=reference.loop.with_values({"proportional_gain": gain})), rig)
    assert neutral_motions(bed) == 2
    assert is_stable_loop(_closed(bed).poles, 2) == stable
