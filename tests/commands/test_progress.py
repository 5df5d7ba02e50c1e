"""Where the steps of a function are told."""

import sys

import pytest

import rigmatch as rm
from matching.progress import OF_A_COUNT, PROGRESS_ALWAYS, shown, time_left

BED = "examples/road_to_rig/case.toml"


def test_the_caller_is_told_in_place_of_the_terminal(capsys, monkeypatch):
    monkeypatch.setenv(PROGRESS_ALWAYS, "1")
    told = []
    with shown("match", told.append) as tell:
        tell("first step")
    assert told == ["first step"]
    assert capsys.readouterr().err == ""


def test_a_terminal_or_a_notebook_shows_steps_and_a_file_does_not(capsys, monkeypatch):
    monkeypatch.delenv(PROGRESS_ALWAYS, raising=False)
    for watched in (False, True):
        if watched:
            monkeypatch.setitem(sys.modules, "ipykernel.zmqshell", sys)
        with shown("map", None, OF_A_COUNT) as tell:
            tell("3 of 12 points")
        assert ("map: 3 of 12 points" in capsys.readouterr().err) is watched


def test_time_left_of_counted_parts_is_in_proportion():
    assert time_left("3 of 12 points", 10.0, OF_A_COUNT) == ", about 30 s left"
    assert time_left("0 of 12 points", 10.0, OF_A_COUNT) == ""


def test_a_study_tells_the_number_of_its_parts():
    told = []
    rm.tolerance(BED, 100, workers=1, progress=told.append)
    assert told[-1].split(" of ")[0] == told[-1].split(" of ")[1].removesuffix(" parts")


@pytest.mark.parametrize("name", ["commission", "diagnose", "identify", "map", "match", "tolerance"])
def test_every_long_function_takes_progress(name):
    import inspect

    assert str(inspect.signature(getattr(rm, name)).parameters["progress"].annotation) == "Callable[[str], None] | None"
