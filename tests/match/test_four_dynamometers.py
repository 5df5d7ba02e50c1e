"""Any number of dynamometers: the margin by singular values, in the programme and in tolerance studies."""

from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from matching.match.case_file import load_case
from matching.match.continuous_loop import ExactLoop, encirclements
from matching.match.loop import parts_of
from matching.match.match import match
from matching.match.programme import closed_loop, margin
from matching.match.tolerance import _distance, determinant

CASE = Path(__file__).parents[2] / "examples" / "four_wheel" / "case.toml"
GENTLE = {"proportional_gain": 20.0, "integral_gain": 20.0, "torque_feed_forward": 0.2, "lead_time": 0.003}


@pytest.fixture(scope="module")
def case():
    loaded = load_case(CASE)
    return replace(loaded, loop=loaded.loop.with_values(GENTLE))


def test_the_margin_of_the_programme_is_the_smallest_singular_value(case):
    """Never more than it, and less by 4 % at most."""
    loop = closed_loop(case, [("loop.proportional_gain",)])
    free = ca.SX.sym("free", 1)
    fixed = ca.SX.sym("fixed", len(loop.fixed))
    term = margin(loop.general, free, free, fixed)
    frequencies = np.geomspace(0.3, 200, 25)
    sizes = np.linalg.svd(ExactLoop(parts_of(case)).return_difference(2j * np.pi * frequencies), compute_uv=False)[
        :, -1
    ]
    for frequency, size in zip(frequencies, sizes, strict=True):
        at = [0.0, 2 * np.pi * frequency, 0.5]
        scaled = float(term.plain(at, case.loop["proportional_gain"], loop.fixed))
        squared = (scaled + 0.25) / (1 - scaled)  # from (σ² − least²)/(1 + σ²)
        assert 0.955 * size <= np.sqrt(squared) <= size * (1 + 1e-9)


def test_a_tolerance_study_takes_the_whole_matrix():
    random = np.random.default_rng(5)
    D = random.normal(size=(6, 4, 4)) + 1j * random.normal(size=(6, 4, 4))
    np.testing.assert_allclose(_distance(D), np.linalg.svd(D, compute_uv=False)[:, -1])
    np.testing.assert_allclose(determinant(D), np.linalg.det(D))
    for k in (1, 2):
        np.testing.assert_allclose(_distance(D[:, :k, :k]), np.linalg.svd(D[:, :k, :k], compute_uv=False)[:, -1])
        np.testing.assert_allclose(determinant(D[:, :k, :k]), np.linalg.det(D[:, :k, :k]))


def test_four_gentle_dynamometers_are_stable(case):
    winding = encirclements(parts_of(case))
    assert winding.unstable == 0
    assert winding.clear


@pytest.mark.long
def test_four_wheels_are_matched():
    result = match(load_case(CASE), starts=1)
    assert result.status == "matched", result.limits
    assert result.verification.modulus_margin >= 0.5
    assert result.response_error.after < 0.05
