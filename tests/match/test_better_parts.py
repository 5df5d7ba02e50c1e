"""More accurate encoders never make a verdict worse: one bed with an open differential, and its neighbours."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest

from matching.match.case_file import load_case
from matching.match.match import match
from matching.match.variables import SearchSettings

CASE = load_case(Path(__file__).parent / "found" / "better_encoder_worse_verdict" / "case.toml")
ONCE = SearchSettings(remedies=False)


def with_counts(counts):
    rig = replace(CASE.rig, sensors=tuple(
        replace(one, counts=counts, uncertainty=None) if one.name.startswith("rotor") else one
        for one in CASE.rig.sensors
    ))  # fmt: skip
    return replace(CASE, rig=rig)


@pytest.mark.long
@pytest.mark.timeout(1200)
def test_the_verdict_never_gets_worse_from_encoder_to_encoder():
    results = [match(with_counts(counts), settings=ONCE) for counts in (1024, 2048, 4096, 8192)]
    ranks = [(one.status == "matched", one.response_error.unmeasured <= CASE.unmeasured_tolerance) for one in results]
    assert ranks == sorted(ranks)
    assert ranks[-1] == (True, True)
    for coarse, fine in pairwise(results):
        if coarse.status == fine.status == "matched":
            assert fine.response_error.unmeasured <= 1.05 * coarse.response_error.unmeasured
    # where the coarse one limits, the encoder is named or play is; never a sensor that is missing
    causes = {one.cause for result in results for one in result.findings if one.limits}
    assert causes <= {"free_play", "standstill", "emulation_left"}


@pytest.mark.long
@pytest.mark.timeout(1200)
def test_encoders_that_state_their_counts_do_not_drift():
    """A bed with four of them stays in emulation at speed: what is read for want of finer counts is no drift."""
    case = load_case(Path(__file__).parents[2] / "examples" / "four_wheel" / "case.toml")
    sensors = tuple(
        replace(one, counts=8192, uncertainty=None) if one.measures == "speed" else one for one in case.rig.sensors
    )
    result = match(replace(case, rig=replace(case.rig, sensors=sensors)), settings=ONCE, ordering=False)
    assert result.status == "matched"
