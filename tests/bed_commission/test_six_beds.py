"""Beds that differ in one way each: a wrong channel ends the circle at once, free play is named and matched."""

import pytest
from virtual_bed.drawn_beds import REFERENCE
from virtual_bed.six_beds import commissioned

from matching.match.case_file import load_case


@pytest.mark.parametrize(("name", "said"), [("rpm", "1/min"), ("reversed", "sign")])
def test_a_wrong_channel_is_named_before_anything_is_fed_back(name, said, tmp_path):
    found = commissioned(load_case(REFERENCE), name, tmp_path)
    assert (found["status"], found["named"]) == ("wrong_channel", found["expected"])
    assert found["share_of_speed"] < 1
    assert said in found["text"].splitlines()[1]


@pytest.mark.long
@pytest.mark.timeout(600)
def test_a_bed_with_play_and_friction_is_matched_and_judged(tmp_path):
    """Play of 0.17°, friction and all values off by up to 3 %; error and intervals beside those of the true bed."""
    found = commissioned(load_case(REFERENCE), "play_and_friction", tmp_path)
    assert found["play_named"]
    assert not found["play_elsewhere"]
    assert found["status"] == "as_predicted"
    first, *_, last = found["rounds"]
    assert first["covered"]
    assert last["covered"]
    assert last["true"] < first["true"]
