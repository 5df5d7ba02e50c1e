"""Drawn beds by two assemblies that share nothing: state spaces in the search, dynamic stiffness in the check."""

import numpy as np
import pytest

from matching.frequency.beds.closed_loop import action, bed_set, closed_matrices, damping, errors
from matching.frequency.independent.beds_check import Judge, check_beds
from modelling.bed.observer_design import design
from modelling.bed.observer_model import observer_model


@pytest.fixture(scope="module")
def controller(small_case):
    return design(observer_model(small_case.rig, small_case.residual_vehicle, small_case.loop), small_case.loop.values)


@pytest.mark.parametrize("seed", range(4))
def test_both_see_the_same_bed(small_case, controller, seed):
    values = small_case.uncertainty.at(small_case.uncertainty.draw(1, seed)[0] * (1 + 2 * (seed == 3)))
    judge = Judge(small_case, controller)
    beds = bed_set(small_case, [values], judge.frequencies)
    acting = action(controller, judge.frequencies)
    size, ratio = damping(np.linalg.eigvals(closed_matrices(beds.sampled, controller)), controller.sample_time)
    verdict = judge.verdict(values)
    assert verdict.stable == (size[0] < 1)
    assert verdict.damping_ratio == pytest.approx(ratio[0], rel=1e-6)
    assert verdict.measured == pytest.approx(np.sqrt(errors(beds, acting, ("motor_torque",)).mean()), rel=1e-7)
    assert verdict.unmeasured == pytest.approx(np.sqrt(errors(beds, acting, ()).mean()), rel=1e-7)
    assert verdict.measured != pytest.approx(verdict.unmeasured, rel=1e-3)


def test_a_bed_whose_dynamometer_pushes_the_wrong_way_is_found_unstable(small_case, controller):
    judge = Judge(small_case, controller)
    assert judge.verdict({}).stable
    assert not judge.verdict({"dynamometers.dyno.torque_gain": -1.0}).stable


def test_every_drawn_bed_counts(small_case, controller):
    found = check_beds(small_case, controller, 1e-4, 12, 5)
    assert (found.drawn, found.stable, found.damped) == (12, 12, 12)
    assert found.holds
    strict = check_beds(small_case, controller, found.smallest_damping_ratio * 1.0001, 12, 5)
    assert (strict.damped, strict.holds) == (11, False)
    assert found.to_dict()["unmeasured_95"] == pytest.approx(np.quantile(found.unmeasured, 0.95))
