"""A plan for the small bed, made once."""

import pytest
from small_bed import CASE, write

from matching.bed.excite import ExcitationOrder, plan_excitation
from matching.match.case_file import load_case

LIMITS = """
[limits]
dynamometer_torque = 400
dynamometer_speed = 120
dynamometer_power = "30 kW"
"shafts.flange.torque" = 500
"shafts.side.twist" = 0.05
"""
LIMITED = CASE[: CASE.index("[limits]")] + LIMITS


@pytest.fixture(scope="session")
def limited_path(tmp_path_factory):
    return write(tmp_path_factory.mktemp("limited"), LIMITED)


@pytest.fixture(scope="session")
def limited_case(limited_path):
    return load_case(limited_path)


@pytest.fixture(scope="session")
def plan(limited_case):
    return plan_excitation(limited_case, ExcitationOrder(duration=8.0, beds=1))
