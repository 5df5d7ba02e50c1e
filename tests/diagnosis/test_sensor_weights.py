"""When causes are searched for a second time, with sensors weighted by what the base model leaves of them."""

from types import SimpleNamespace

import numpy as np
import pytest

from matching.diagnosis import identify_causes as module


def fit(error: float, sensors: int = 2, name: str = "noise") -> SimpleNamespace:
    """A fit whose first sensor errs by so many times its noise."""
    errors = np.ones((100, sensors)) * [error, *[1.0] * (sensors - 1)]
    data = SimpleNamespace(readings_by_sensor=np.full(sensors, 100))
    return SimpleNamespace(errors=[errors], problem=SimpleNamespace(data=data), name=name)


@pytest.fixture
def identified(monkeypatch: pytest.MonkeyPatch):
    """(base error, error left, whether unseen data gain, sensors) → weights of the answer, and of the searches made."""

    def run(base: float, left: float, gains: bool = True, sensors: int = 2) -> tuple[str, list[str]]:
        searches = []

        def search(_system, weighted, _holdout, _progress):
            searches.append(weighted.name)
            return SimpleNamespace(
                state=SimpleNamespace(best=SimpleNamespace(fit=fit(left, sensors))), weights=weighted.name
            )

        monkeypatch.setattr(module, "_identify", search)
        monkeypatch.setattr(module, "iteratively_reweighted", lambda one: fit(base, sensors, "balanced"))
        monkeypatch.setattr(module, "at_noise", lambda best: left == 1.0)
        monkeypatch.setattr(module, "UnseenData", lambda holdout: SimpleNamespace(earns_place=lambda *_: gains))
        answer = module.identify_causes(None, fit(base, sensors), None, lambda _: None)
        return answer.weights, searches

    return run


def test_one_search_where_the_noise_is_reached_or_nearly(identified) -> None:
    assert identified(50.0, 1.0) == ("noise", ["noise"])
    assert identified(50.0, 2.0) == ("noise", ["noise"])


def test_a_second_search_is_taken_only_where_unseen_data_gain(identified) -> None:
    assert identified(50.0, 20.0) == ("balanced", ["noise", "balanced"])
    assert identified(50.0, 20.0, gains=False) == ("noise", ["noise", "balanced"])


def test_far_from_the_noise_only_the_second_is_made_and_with_one_sensor_only_the_first(identified) -> None:
    assert identified(500.0, 20.0) == ("balanced", ["balanced"])
    assert identified(500.0, 20.0, sensors=1) == ("noise", ["noise"])
