"""What judges a tuned bed is set by the caller of a match."""

from dataclasses import replace

from needs import compiles

from matching.match.free_play import FREE_PLAY
from matching.match.match import JudgeSettings, match
from matching.match.minutes import MinuteSettings
from matching.match.robustness import DrawnBedsSettings
from matching.match.variables import SearchSettings

pytestmark = compiles


def test_beds_and_figures_of_the_judge_are_those_that_were_asked_for(small_case):
    effort = SearchSettings(drawn=2, pool=8, rounds=1, steps=1, blind=0, scenarios=0, emulated=1.0, remedies=False)
    judging = JudgeSettings(
        play=replace(FREE_PLAY, drawn=3), minutes=MinuteSettings(drawn=2, motion=1e-12),
        drawn_beds=DrawnBedsSettings(few=-1.0),
    )  # fmt: skip
    result = match(small_case, beds=6, settings=effort, judging=judging, ordering=False)
    assert result.lash.drawn == 3 + FREE_PLAY.as_planned
    where = [run.where for run in result.minutes.runs]
    assert "at rest on drawn bed 2" in where
    assert "at rest on drawn bed 3" not in where
    assert min(run.allowed for run in result.minutes.runs if run.allowed is not None) < MinuteSettings().motion
    assert sum(one.cause == "beds_error" for one in result.findings) >= 1
