"""When a match will be over, as far as its steps tell."""

import pytest

from matching.arguments import PROGRESS_ALWAYS, steps
from matching.expected_end import OF_A_MATCH, share_over, time_left


@pytest.mark.parametrize(
    ("step", "share"),
    [("weights", 0.45), ("verification", 0.4), ("verification on fresh beds", 0.66), ("start 9 of 18 at most", 0.25)],
)
def test_share_of_a_step(step, share):
    assert share_over(step, OF_A_MATCH) == pytest.approx(share)


def test_what_is_not_known_is_not_said():
    assert time_left("a step of another command", 10.0, OF_A_MATCH) == ""


@pytest.mark.parametrize(("seconds", "said"), [(10.0, "about 5 s left"), (600.0, "about 5 min left")])
def test_time_left_in_words(seconds, said):
    assert said in time_left("weights", seconds, {"weights": 2 / 3})


def test_the_line_of_progress_says_when_the_end_is_expected(monkeypatch, capsys):
    monkeypatch.setenv(PROGRESS_ALWAYS, "1")
    with steps("match", OF_A_MATCH) as tell:
        tell("weights")
    assert "match: weights, about 0 s left [" in capsys.readouterr().err
