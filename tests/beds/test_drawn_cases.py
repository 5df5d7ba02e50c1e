"""Sixty drawn drives on drawn beds: each ends matched and verified, or limited for a reason that is true."""

import json
import re
import time
import tomllib
from dataclasses import replace

import pytest
from drawn_cases import BUILDS, DEAD_TIMES_S, STRUCTURES, draw

from matching.frequency.beds.requirements import LARGEST_ROLLED_OFF
from matching.frequency.beds.tune import TuningEffort
from matching.frequency.case.load import load_case
from matching.frequency.search.match import match
from matching.frequency.search.observed import match_with_observer
from matching.frequency.search.question import question_of
from matching.report.match.text import content, summary

CASES = 60
LONGEST_S = 40  # of processor time, with the search's usual effort
SHORTER_DEAD_TIME = re.compile(r"solved with ([\d.]+) ms, every target is met")


def broken(result):
    """What of a result is not as a match has to be, by its figures alone."""
    checks, robust, error, case = result.verification, result.robust, result.response_error, result.case
    found = []
    if not checks.stable or checks.disagreements:
        found.append("loop")
    if checks.violations:
        found.append("limits")
    if not all(target.met for target in result.targets):
        found.append("targets")
    if robust is not None and robust.beds.drawn:
        if not robust.beds.stable == robust.beds.damped == robust.beds.drawn:
            found.append("beds")
        if robust.beds.worst is not None and robust.beds.worst.damping_ratio <= 0:
            found.append("worst bed")
    if case.loop.structure.is_observer:
        loop, required = robust.loop, robust.required
        if not (error.after <= case.tolerance and error.unmeasured <= case.unmeasured_tolerance):
            found.append("errors")
        if loop.largest_rolled_off > LARGEST_ROLLED_OFF:
            found.append("roll-off")
        if required.command_noise is not None and max(loop.command_noise) > required.command_noise:
            found.append("noise")
    return found


def ends_well(result):
    """Status, sentences and figures agree, and the result can be written and read."""
    written = content(result)
    json.dumps(written, allow_nan=False)
    assert summary(written).startswith(result.status.upper())
    if result.status == "matched":
        assert not result.limits
        assert not broken(result)
    else:
        assert broken(result) or any("the manoeuvre takes" in sentence for sentence in result.limits), result.limits
        assert any(any(letter.isdigit() for letter in sentence) for sentence in result.limits), result.limits


@pytest.mark.long
@pytest.mark.parametrize("seed", range(CASES))
def test_a_drawn_case_ends_well(seed, tmp_path):
    case = load_case(draw(seed, tmp_path))
    begin = time.process_time()
    result = match(case)
    took = time.process_time() - begin
    ends_well(result)
    for milliseconds in re.findall(SHORTER_DEAD_TIME, " ".join(result.limits)):
        shorter = replace(case, loop=case.loop.with_values({"dead_time": float(milliseconds) * 1e-3}))
        assert all(target.met for target in match(shorter).targets)
    assert took < LONGEST_S


def test_one_case_in_a_hurry(tmp_path):
    """A chain with one dynamometer under an observer that has hardly been tuned."""
    case = load_case(draw(0, tmp_path))
    effort = TuningEffort(drawn=2, pool=4, rounds=1, steps=1, fresh=3)
    ends_well(match_with_observer(question_of(case), 0, lambda _: None, effort))


def test_the_draws_cover_builds_structures_dead_times_and_sensors(tmp_path):
    cases = [tomllib.loads(draw(seed, tmp_path / str(seed)).read_text()) for seed in range(CASES)]
    loops = [case["loop"] for case in cases]
    assert {(index % len(BUILDS), loop["structure"]) for index, loop in enumerate(loops)} == {
        (build, structure) for build in range(len(BUILDS)) for structure in STRUCTURES
    }
    assert {loop["dead_time"] for loop in loops} == set(DEAD_TIMES_S)
    assert {len(case["dynamometers"]) for case in cases} == {1, 2, 4}
    assert {"knows" in loop for loop in loops} == {"measures" in loop for loop in loops} == {True, False}
    assert {"operating_point" in case for case in cases} == {True, False}
