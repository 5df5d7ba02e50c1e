from dataclasses import replace
from pathlib import Path

import pytest

from matching.match.case_file import load_case
from matching.match.loop import linear_bed
from matching.match.verify import manoeuvre_torques, simulate_case
from modelling.bed.controllers import STRUCTURES

CASE = Path(__file__).parents[2] / "examples" / "road_to_rig" / "case.toml"
GENTLE = {
    "proportional_gain": 60.0,
    "integral_gain": 60.0,
    "torque_feed_forward": 0.2,
    "acceleration_feed_forward": 0.3,
}


@pytest.fixture(scope="session")
def reference():
    return load_case(CASE)


@pytest.fixture(scope="session")
def feedback(reference):
    """The reference case by feedback alone, with gains known to be stable."""
    return replace(reference, loop=replace(reference.loop.with_values(GENTLE), structure=STRUCTURES["pi"]))


@pytest.fixture(scope="session")
def simulated(feedback):
    parts = linear_bed(feedback)
    return parts, simulate_case(parts, *manoeuvre_torques(parts))
