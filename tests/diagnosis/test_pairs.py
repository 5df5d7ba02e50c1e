"""Pairs of candidates against least squares with known signatures."""

from types import SimpleNamespace

import numpy as np
import pytest

from matching.diagnosis.moves import screened_pairs
from matching.diagnosis.screening import ScreenedCandidate
from matching.diagnosis.settings import DiagnosisSettings
from modelling.effects.effect import Guess

SIGNATURES = {"first": [1.0, 0.1, 0.0, 0.0], "second": [1.0, -0.1, 0.0, 0.0], "third": [0.0, 0.0, 1.0, 0.0]}


def screening(residual: np.ndarray, readings: int = 0) -> SimpleNamespace:
    """A residual (4,), signatures by name of the place, and base parameters that take the last reading."""
    return SimpleNamespace(
        residual=residual,
        basis=np.array([[0.0], [0.0], [0.0], [1.0]]),
        mask=np.arange(4) < readings,
        signature=lambda addition: np.array(SIGNATURES[next(iter(addition))]),
    )


def candidate(name: str, residual: np.ndarray, positive: bool = False) -> ScreenedCandidate:
    signature = np.array(SIGNATURES[name])
    reduction = float(signature @ residual) ** 2 / float(signature @ signature)
    guess = Guess(({name: 1.0},), lambda a: None if positive and a[0] < 0 else {"size": float(a[0])})
    return ScreenedCandidate("kind", name, {"size": 1.0}, reduction, guess)


def test_two_that_hide_each_other_are_found_together_with_their_sizes() -> None:
    """2·first − 2·second: alone each takes a hundredth, together all."""
    residual = np.array([0.0, 0.4, 0.01, 0.0])
    some = sorted((candidate(name, residual) for name in SIGNATURES), key=lambda one: -one.reduction)
    assert some[0].reduction < 0.02 * float(residual @ residual)
    best = screened_pairs(screening(residual), some, DiagnosisSettings())[0]
    sizes = {one.at: one.parameters["size"] for one in (best.first, best.second)}
    assert sizes == {"first": pytest.approx(2.0), "second": pytest.approx(-2.0)}
    assert best.reduction == pytest.approx(0.4**2)


def test_a_pair_whose_effects_do_not_exist_is_left_out() -> None:
    residual = np.array([0.0, 0.4, 0.01, 0.0])
    some = [candidate("first", residual), candidate("second", residual, positive=True)]
    assert screened_pairs(screening(residual), some, DiagnosisSettings()) == []


def test_no_pair_where_one_explains_almost_all() -> None:
    residual = np.array([3.0, 0.3, 0.2, 0.0])
    some = sorted((candidate(name, residual) for name in SIGNATURES), key=lambda one: -one.reduction)
    assert screened_pairs(screening(residual, readings=4), some, DiagnosisSettings()) == []
    assert screened_pairs(screening(residual), some, DiagnosisSettings()) != []  # the rest, were it no noise
