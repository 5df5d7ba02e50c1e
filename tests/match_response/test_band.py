"""Means over the band: against closed forms and dense grids."""

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad

from matching.match.case_file import load_case
from matching.match.loop import body
from matching.match.responses import (
    ComparedBed,
    error_figures,
    log_squares,
    pooled,
)
from modelling.linear.band import antiresonances, converged_nodes, resonances
from modelling.model_file import from_dict

BAND = (0.5, 30.0)


def test_weights_make_a_mean_over_the_logarithm_of_frequency():
    nodes = converged_nodes(BAND, lambda f: np.stack([np.log(f) ** 2, np.ones_like(f)], axis=1))
    assert nodes.weights.sum() == pytest.approx(1)
    low, high = np.log(BAND)
    assert nodes.weights @ np.log(nodes.frequencies) == pytest.approx((low + high) / 2)
    root = nodes.root_mean(np.log(nodes.frequencies)[:, None] ** 2)
    assert root[0] == pytest.approx(np.sqrt((high**3 - low**3) / 3 / (high - low)))
    assert nodes.frequencies.min() > BAND[0]
    assert nodes.frequencies.max() < BAND[1]


@pytest.mark.parametrize("width", [1e-2, 1e-3])
def test_a_narrow_peak_is_found(width):
    """A resonance of a thousandth of the band: missed by any even grid, found with and without its break."""

    def peak(f):
        return (width**2 / ((f / 7.3 - 1) ** 2 + width**2))[:, None]

    exact = quad(lambda x: peak(np.exp(np.array([x])))[0, 0], *np.log(BAND), points=[np.log(7.3)], limit=500)[0]
    nodes = converged_nodes(BAND, peak, [7.3, 100.0])
    assert nodes.weights @ peak(nodes.frequencies)[:, 0] == pytest.approx(exact / np.log(60), rel=0.01)


def test_every_column_converges():
    def two(f):
        return np.stack([np.full_like(f, 1e3), 1e-6 / ((f / 3 - 1) ** 2 + 1e-5)], axis=1)

    nodes = converged_nodes(BAND, two)
    dense = np.geomspace(*BAND, 200_001)
    np.testing.assert_allclose(nodes.weights @ two(nodes.frequencies), two(dense).mean(axis=0), rtol=0.02)


def test_resonance_and_antiresonance_of_two_masses():
    J1, J2, k = 0.1, 1.0, 200.0
    system = from_dict(
        {
            "inertias": {"a": {"J": J1}, "b": {"J": J2}},
            "shafts": {"link": {"between": ["a", "b"], "stiffness": k}},
            "inputs": {"torque": {"on": "a"}},
            "sensors": {"speed": {"measures": "speed", "of": "a"}, "link_torque": {"measures": "torque", "of": "link"}},
        }
    )
    space = body(system).space
    np.testing.assert_allclose(resonances(space), np.sqrt(k / J1 + k / J2) / (2 * np.pi))
    np.testing.assert_allclose(antiresonances(space, "torque", "speed"), np.sqrt(k / J2) / (2 * np.pi))
    assert len(antiresonances(space, "torque", "link_torque")) == 0


def test_errors_of_known_ratios():
    ones = np.ones((7, 2), complex)
    assert log_squares(ones, ones).max() == 0
    np.testing.assert_allclose(log_squares(np.e * ones, ones), 1.0)
    np.testing.assert_allclose(log_squares(np.exp(0.3 + 0.4j) * ones, ones), 0.25)
    np.testing.assert_allclose(log_squares(ones, np.exp(-0.3j) * ones), 0.09)
    assert pooled([3.0, 4.0]) == pytest.approx(np.sqrt(12.5))


@pytest.mark.parametrize("example", ["compact_bev", "four_wheel"])
def test_figures_have_converged(example):
    """To 1 % of what a grid of 4000 frequencies gives, every function by itself."""
    case = load_case(Path(__file__).parents[2] / "examples" / example / "case.toml")
    found = error_figures(case)
    dense = np.geomspace(*case.band, 4000)
    curves = ComparedBed(case).at(dense)
    for name, values in (("after", curves.matched), ("unmeasured", curves.unmeasured), ("before", curves.rig)):
        exact = np.sqrt(log_squares(values, curves.vehicle).mean(axis=0))
        for error, function in zip(exact, found.functions, strict=True):
            if getattr(function, name) is not None:
                assert getattr(function, name) == pytest.approx(error, rel=0.01)
