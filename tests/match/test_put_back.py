"""Which adapters go back to what was planned, by objectives known beforehand, and the answers that are compared."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from matching.match import adapters as ordering
from matching.match.solve import Solution, as_good_as

LEFT, RIGHT = (SimpleNamespace(name=name, planned=1.0, together=(name,)) for name in ("left", "right"))


def verified():
    return SimpleNamespace(solution=Solution({}, 1.0, (), True, as_good_to=as_good_as(1.0, 0.02)), task=None)


@pytest.mark.parametrize(
    ("objectives", "back"),
    [
        ({"left": 1.03, "right": 1.035, "both": 1.07}, {"left", "right"}),  # one alone would gain 1.4 %
        ({"left": 1.03, "right": 1.035, "both": 1.10}, {"left"}),
        ({"left": 1.2, "right": 1.035, "both": 1.3}, {"right"}),
        ({"left": 1.2, "right": 1.2, "both": 1.5}, set()),
        ({"left": 1.03, "right": 1.03, "both": 1.04}, {"left", "right"}),
        ({"left": 1.03, "right": 1.035, "both": None}, {"left"}),
    ],
)
def test_what_gains_less_than_2_percent_over_the_best_or_over_the_order_goes_back(monkeypatch, objectives, back):
    def as_planned(question, match, moves):
        value = objectives["both" if len(moves) == 2 else moves[0].name]
        return None if value is None else Solution({}, value, (), True)

    def settle(question, match, moves, best):
        """What is still ordered changes least, up to the limit."""
        objective = best.objective if len(moves) == 2 else match.solution.as_good_to
        solution = replace(best, objective=objective, as_good_to=match.solution.as_good_to)
        return SimpleNamespace(solution=solution, back={move.name for move in moves})

    monkeypatch.setattr(ordering, "replace", lambda match, **new: SimpleNamespace(**{**vars(match), **new}))
    monkeypatch.setattr(ordering, "_as_planned", as_planned)
    monkeypatch.setattr(ordering, "_with_some_as_planned", settle)
    settled = ordering._settled(None, verified(), [LEFT, RIGHT], as_planned(None, None, [LEFT, RIGHT]))
    assert settled.back == back
    assert settled.solution.objective <= settled.solution.as_good_to


@pytest.mark.parametrize(
    ("without", "held", "better"), [(1.2, 1.1, 1.1), (1.1, 1.2, 1.1), (None, 1.2, 1.2), (1.3, None, 1.3)]
)
def test_the_better_one_of_both_searches_counts(monkeypatch, without, held, better):
    """The search without the quantity may end in a worse place than the answer with it held."""
    made = [None if value is None else Solution({"gain": value}, value, (), True) for value in (without, held)]
    monkeypatch.setattr(ordering, "_task_as_planned", lambda *_: SimpleNamespace(moves=("gain",)))
    monkeypatch.setattr(ordering, "warm", lambda *_: made[0])
    monkeypatch.setattr(ordering, "some_as_planned", lambda *_: made[1])
    answer = ordering._as_planned(None, verified(), [LEFT])
    assert answer.objective == better
    assert answer.values == {"left": 1.0, "gain": better}
