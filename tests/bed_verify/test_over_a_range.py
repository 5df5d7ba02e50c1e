"""The proof of a bed whose vehicle drives over a range of speeds: at which speed, and what holds it there."""

import dataclasses
from pathlib import Path

import pytest
from driving.own_bed import held_motor, plant

from matching.bed.excite import steady_speed
from matching.bed.proof import plan_proof
from matching.match.case_file import load_case
from matching.match.responses import ComparedBed

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture(scope="module")
def drive_away():
    return load_case(EXAMPLES / "drive_away" / "case.toml")


def own(speed_of_bodies):
    """Motor torque and rotor speed of the tests' own car, in closed form."""
    return held_motor(plant(EXAMPLES / "drive_away" / "vehicle.toml", EXAMPLES / "drive_away" / "rig.toml", 0.0025),
                      speed_of_bodies)  # fmt: skip


def test_the_rotors_turn_as_at_the_operating_point():
    """It is stated as a speed of the vehicle; the rotors' follows from it."""
    case = load_case(EXAMPLES / "gear_change" / "case.toml")
    assert steady_speed(case) == pytest.approx(own(50 / 3.6 / 0.3)[1], rel=1e-4)


def test_the_vehicle_keeps_its_speed_in_the_proof(drive_away):
    """Else 2000 kg would coast from 36 km/h to standstill while the bed is judged at one speed."""
    speed = 33.0
    planned = plan_proof(drive_away, speed)
    mean = planned.torques[: round(planned.period / planned.step)].mean(axis=0)
    motor = planned.inputs.index("motor_torque")
    assert mean[motor] == pytest.approx(own(speed)[0], rel=0.02)
    assert any("about keeps its speed" in note for note in planned.notes)


def test_of_an_unknown_specimen_every_response_counts_in_one_error():
    """As in a match, so that both are asked for the same."""
    case = load_case(EXAMPLES / "gear_change" / "case.toml")
    assert not ComparedBed(case).measured.any()
    known = dataclasses.replace(case, loop=dataclasses.replace(case.loop, specimen="known"))
    assert ComparedBed(known).measured.any()
