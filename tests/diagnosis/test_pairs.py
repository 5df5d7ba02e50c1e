"""Pairs of candidates against least squares with known signatures."""

from types import SimpleNamespace

import numpy as np
import pytest

from matching.diagnosis import search as pairs
from matching.diagnosis.screening import ScreenedCandidate
from matching.diagnosis.search import ScreenedPair, fitted_pairs, screened_pairs
from modelling.effects.effect import Guess

SIGNATURES = {"first": [1.0, 0.1, 0.0, 0.0], "second": [1.0, -0.1, 0.0, 0.0], "third": [0.0, 0.0, 1.0, 0.0]}


def screening(residual: np.ndarray) -> SimpleNamespace:
    """A residual (4,), signatures by name of the place, and base parameters that take the last reading."""
    return SimpleNamespace(
        residual=residual,
        basis=np.array([[0.0], [0.0], [0.0], [1.0]]),
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
    best = screened_pairs(screening(residual), some)[0]
    sizes = {one.at: one.parameters["size"] for one in (best.first, best.second)}
    assert sizes == {"first": pytest.approx(2.0), "second": pytest.approx(-2.0)}
    assert best.reduction == pytest.approx(0.4**2)


def test_a_pair_whose_effects_do_not_exist_is_left_out() -> None:
    residual = np.array([0.0, 0.4, 0.01, 0.0])
    some = [candidate("first", residual), candidate("second", residual, positive=True)]
    assert screened_pairs(screening(residual), some) == []


def test_no_pair_where_one_explains_almost_all() -> None:
    residual = np.array([3.0, 0.3, 0.2, 0.0])
    some = sorted((candidate(name, residual) for name in SIGNATURES), key=lambda one: -one.reduction)
    assert screened_pairs(screening(residual), some) == []


def test_a_pair_that_cannot_be_fitted_does_not_end_the_search(monkeypatch) -> None:
    residual = np.array([0.0, 0.4, 0.01, 0.0])
    first, second, third = (candidate(name, residual) for name in SIGNATURES)
    causes = SimpleNamespace(causes=())

    def with_cause(kind, at, *_):
        return SimpleNamespace(causes=(SimpleNamespace(kind=kind, at=at),), with_cause=with_cause)

    def fit(model, *_):
        if model.causes[0].at == "second":
            raise FloatingPointError
        return "fitted"

    monkeypatch.setattr(pairs, "replace", lambda *_, **__: SimpleNamespace(causes=(), with_cause=with_cause))
    monkeypatch.setattr(pairs, "compilable", lambda models: True)
    monkeypatch.setattr(pairs, "fit_extended", fit)
    problem = SimpleNamespace(data=SimpleNamespace(sampling_interval=1.0), bounds={})
    base = SimpleNamespace(fit=SimpleNamespace(problem=problem, values={}), model=causes)
    some = [ScreenedPair(first, second, 3.0), ScreenedPair(second, third, 2.0)]
    assert [one.fit for one in fitted_pairs(base, some, (), SimpleNamespace(take=lambda: True))] == ["fitted"]
