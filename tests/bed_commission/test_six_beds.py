"""Beds that differ in one way each: a wrong channel ends the circle at once, free play is named and matched."""

import pytest
from virtual_bed.drawn_beds import REFERENCE
from virtual_bed.six_beds import commissioned

from matching.match.case_file import load_case


@pytest.mark.long
@pytest.mark.parametrize(("name", "said"), [("rpm", "1/min"), ("reversed", "sign")])
def test_a_wrong_channel_is_named_before_anything_is_fed_back(name, said, tmp_path):
    found = commissioned(load_case(REFERENCE), name, tmp_path)
    assert (found["status"], found["named"]) == ("wrong_channel", found["expected"])
    assert found["share_of_speed"] < 1
    assert said in found["text"].splitlines()[1]


@pytest.mark.long
@pytest.mark.timeout(600)
def test_a_bed_with_play_is_matched_and_judged(tmp_path):
    """Play of 0.17° at the gear output; the interval of every round beside the error on the true bed."""
    found = commissioned(load_case(REFERENCE), "play", tmp_path)
    assert found["play_named"]
    assert not found["play_elsewhere"]
    assert found["status"] == "as_predicted"
    assert all(one["covered"] for one in found["rounds"])
