"""Why a candidate was not taken, one reason each."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from diagnosis.linear import KnownProblem, fit_at

from matching.diagnosis.causes import Cause, ExtendedModel
from matching.diagnosis.search import in_local_minimum
from matching.diagnosis.selection import Hypothesis, with_balanced_sensors
from matching.diagnosis.verdict import fitted_candidates

NAME = "sensors.s.sensor_offset.offset"


def hypothesis(mean_square: float, causes: bool = True, at_bound: bool = False, screened: float = 0.0) -> Hypothesis:
    problem = KnownProblem({NAME: (0.0, 4.0)}, lambda v: np.full(1000, np.sqrt(mean_square)))
    fit = fit_at(problem, np.array([0.0 if at_bound else 2.0]), np.ones((1000, 1)))
    named = (Cause("sensor_offset", "sensors.s", ("offset",)),) if causes else ()
    return Hypothesis(ExtendedModel(None, named, {}, {}), fit, screened)


class Judge:
    """Held-out residuals by hypothesis: its fit's mean square and what is stated of it."""

    def __init__(self, squares: dict[int, float]):
        self.squares = squares

    def simulate(self, fit):
        parts = [np.full((100, 1), np.sqrt(self.squares[id(fit)]))]
        return [SimpleNamespace(errors=None, parts=lambda residual: parts)]


@pytest.mark.parametrize(
    ("mean_square", "unseen", "at_bound", "reason"),
    [
        (8.95, 4.0, False, "not_better"),  # 50 less than 9000, where noise takes 10 times χ² a reading
        (4.0, 9.5, False, "worse_unseen"),
        (4.0, 8.5, True, "at_bound"),
        (4.0, 8.5, False, "rival"),
    ],
)
def test_reason(mean_square: float, unseen: float, at_bound: bool, reason: str) -> None:
    base, one = hypothesis(9.0, causes=False), hypothesis(mean_square, at_bound=at_bound)
    judge = Judge({id(base.fit): 9.0, id(one.fit): unseen})
    state = SimpleNamespace(base=base, best=base, noise_threshold=10.0, with_one_cause=[one])
    (found,) = fitted_candidates(state, judge)
    assert (found.kind, found.at, found.not_taken) == ("sensor_offset", "sensors.s", reason)
    assert found.misfit == pytest.approx(np.sqrt(mean_square))
    assert found.misfit_holdout == pytest.approx(np.sqrt(unseen))
    (taken,) = fitted_candidates(SimpleNamespace(**vars(state) | {"best": one}), judge)
    assert taken.not_taken == ""
    assert taken.to_dict()["not_taken"] is None


@pytest.mark.parametrize("impossible", ["not_physical", "beyond_recording"])
def test_what_cannot_be_meant_is_said_before_what_unseen_data_say(impossible: str, monkeypatch) -> None:
    base, one = hypothesis(9.0, causes=False), hypothesis(4.0)
    state = SimpleNamespace(base=base, best=base, noise_threshold=10.0, with_one_cause=[one])
    monkeypatch.setattr(ExtendedModel, "not_taken", lambda model, fit: impossible if fit is one.fit else "")
    for unseen in (8.5, 9.5):
        (found,) = fitted_candidates(state, Judge({id(base.fit): 9.0, id(one.fit): unseen}))
        assert found.not_taken == impossible


def test_sensors_are_weighted_anew_only_where_they_are_weighted_at_all(monkeypatch) -> None:
    one = hypothesis(4.0)
    again = hypothesis(5.0).fit
    monkeypatch.setattr("matching.diagnosis.selection.iteratively_reweighted", lambda fit: again)
    monkeypatch.setattr("matching.diagnosis.selection.pooled_error", lambda fit: 1.0)
    for weighting, expected in ((None, one.fit), (object(), again)):
        monkeypatch.setattr(one.fit.problem, "weighting", weighting, raising=False)
        assert with_balanced_sensors(one).fit is expected


def test_the_candidate_that_was_promised_most_of_gets_windows_if_its_fit_does_not_keep_half() -> None:
    parent = hypothesis(9.0, causes=False)
    near, far, hopeless = hypothesis(5.0, screened=1000.0), hypothesis(6.0), hypothesis(7.0)
    broken = hypothesis(12.0, screened=8000.0)
    assert in_local_minimum(parent, [near, far, hopeless, broken]) == [broken, near, far]
    kept = replace(broken, fit=hypothesis(4.5).fit)  # 4500 of 8000
    assert in_local_minimum(parent, [kept, near, far]) == [kept, near]
    assert in_local_minimum(parent, [hypothesis(1.0), near])[1:] == []  # more than three times the best


def test_further_causes_far_from_the_noise_get_windows_only_where_a_promise_is_not_kept() -> None:
    parent, kept, near = hypothesis(90.0), hypothesis(50.0, screened=1000.0), hypothesis(60.0)
    assert in_local_minimum(parent, [kept, near]) == []
    broken = hypothesis(120.0, screened=80_000.0)
    assert in_local_minimum(parent, [kept, near, broken]) == [broken]
    assert in_local_minimum(hypothesis(12.0), [hypothesis(5.0), hypothesis(6.0)]) != []  # 2.2 times the noise
