"""A match set by hand: gains known to be stable on the reference case, verified for good. No optimiser is involved."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from matching.match.case_file import load_case
from matching.match.exported import exported_controller
from matching.match.findings import stated
from matching.match.in_time import errors_in_time
from matching.match.loop import linear_bed
from matching.match.responses import ComparedBed
from matching.match.result import MatchResult, ParameterResult, TargetResult
from matching.match.verify import manoeuvre_torques, verify
from matching.report.acting import acting
from matching.report.match import pictures
from modelling.modal.modes import damped_modes, modes
from modelling.running.controllers import unsupervised

CASE = Path(__file__).parents[2] / "examples" / "road_to_rig" / "case.toml"
IN_TIME = 1200  # samples of the manoeuvre on beds that are not the model: enough to draw
GAINS = {
    "proportional_gain": 60.0,
    "integral_gain": 60.0,
    "torque_feed_forward": 0.2,
    "acceleration_feed_forward": 0.3,
}


@pytest.fixture(scope="session")
def case():
    return load_case(CASE)


@pytest.fixture(scope="session")
def hand_made(case):
    tuned = replace(case, loop=case.loop.with_values(GAINS))
    seen = verify(tuned)
    found = ComparedBed(tuned).at(np.geomspace(0.3, 50, 200))
    vehicle, rig = tuple(modes(case.vehicle)), tuple(modes(case.rig))
    targets = []
    for (number, mode, _), own in zip(seen.targets, seen.identified, strict=True):
        aim = vehicle[number - 1]
        like = next(one for one in rig if one.symmetry == aim.symmetry and one.frequency > 0)
        targets.append(
            TargetResult(
                number,
                aim.symmetry,
                aim.frequency,
                own.vehicle.damping_ratio,
                like.frequency,
                mode.frequency,
                mode.damping_ratio,
                own.matched.frequency,
                own.matched.damping_ratio,
                True,
            )
        )
    parameters = []
    for move in case.moves:
        value = tuned.loop.values.get(move.name.removeprefix("loop."), move.start)
        still = value == move.start
        parameters.append(
            ParameterResult(
                move.name, move.start, value, move.unit, move.lower, move.upper, 1.0, 0.0 if still else 0.5, still
            )
        )
    errors = seen.errors
    torques, lead = manoeuvre_torques(linear_bed(tuned))
    begun = {name: torque[: lead + IN_TIME] for name, torque in torques.items()}
    in_time = errors_in_time(tuned, unsupervised(exported_controller(tuned)), begun, lead)
    return MatchResult(
        tuple(stated("components_differ", ["Set by hand: nothing was tuned"])),
        seen.notes,
        case,
        tuned,
        tuple(damped_modes(case.vehicle)),
        tuple(damped_modes(case.rig)),
        seen.modes,
        tuple(targets),
        tuple(parameters),
        replace(errors, bound=0.004, bound_unsampled=0.003),
        found,
        seen,
        1.0,
        (1.0, 1.005),
        seconds=2.0,
        simulated_in_time=in_time,
    )


@pytest.fixture(scope="session")
def as_figures(hand_made):
    return {name: picture.draw() for name, picture in pictures(hand_made).items()}


@pytest.fixture(scope="session")
def drawn(as_figures):
    return {name: acting(figure)[1] for name, figure in as_figures.items()}
