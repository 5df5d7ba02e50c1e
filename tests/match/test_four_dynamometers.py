"""A dynamometer at every wheel."""

from pathlib import Path

import pytest

from matching.match.case_file import load_case
from matching.match.match import match

CASE = Path(__file__).parents[2] / "examples" / "four_wheel" / "case.toml"


@pytest.mark.long
def test_four_wheels_are_matched():
    result = match(load_case(CASE), starts=1)
    assert result.status == "matched", result.limits
    assert result.verification.modulus_margin >= 0.5
    assert result.response_error.after < 0.05
