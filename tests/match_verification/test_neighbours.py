"""A target mode with a neighbour 1 % away: told apart by shape and damping, in the loop and in the simulation."""

import math
import tomllib

import pytest
import tomli_w
from small_bed import CASE, RIG, VEHICLE

from matching.match.case_file import load_case
from matching.match.kept import candidates_of, target_modes_of
from matching.match.loop import linear_bed
from matching.match.loop_modes import modes_of
from matching.match.targets import target_modes
from matching.match.verify import identified_modes, manoeuvre_torques, simulate_case
from modelling.modal.modes import damped_modes

MAIN, BESIDE = 10.300, 10.336  # Hz, with damping ratios 0.085 and 0.020
ABSORBER = 0.05, 10.33, 0.02  # kg·m² behind the body, Hz and damping ratio by itself


@pytest.fixture(scope="module")
def prepared(tmp_path_factory):
    """The small bed, feed-forward alone; behind the vehicle's body an absorber near the target's frequency."""
    folder = tmp_path_factory.mktemp("neighbours")
    vehicle, rig, case = (tomllib.loads(text) for text in (VEHICLE, RIG, CASE))
    J, frequency, damping = ABSORBER
    omega = 2 * math.pi * frequency
    vehicle["inertias"]["trailer"] = {"J": J}
    hitch = {"between": ["body", "trailer"], "stiffness": J * omega**2, "damping": 2 * damping * J * omega}
    vehicle["shafts"]["hitch"] = hitch
    case["loop"] = {"structure": "model_based", "dead_time": 0.002, "knows": ["motor_torque"]}
    case["targets"] = [{"mode": 2}, {"mode": 3}]
    case["response"]["compare"] = case["response"]["compare"][:2]
    case["move"] = {"loop.proportional_gain": {"lower": 1, "upper": 300}}
    for name, content in (("vehicle", vehicle), ("rig", rig), ("case", case)):
        (folder / f"{name}.toml").write_text(tomli_w.dumps(content))
    return linear_bed(load_case(folder / "case.toml"))


def test_the_models_are_as_they_are_meant(prepared):
    modes = [(mode.frequency, mode.damping_ratio) for mode in list(damped_modes(prepared.case.vehicle))[1:3]]
    assert modes[0] == pytest.approx((MAIN, 0.0849), rel=1e-3)
    assert modes[1] == pytest.approx((BESIDE, 0.0202), rel=5e-3)


def test_each_target_is_a_mode_of_its_own_and_the_loop_shows_it(prepared):
    case = prepared.case
    wanted = [mode.damping_ratio for _, mode in target_modes(case)]
    assert sorted(wanted) == pytest.approx([0.0202, 0.0849], rel=5e-3)
    named = target_modes_of(case, candidates_of(case, modes_of(prepared)))
    reached = [row.mode.damping_ratio for row in named]
    assert reached == pytest.approx(wanted, rel=1e-3)  # the feed-forward has the poles of the vehicle


def test_the_simulation_shows_a_mode_or_says_that_it_does_not_but_never_its_neighbour(prepared):
    """The absorber moves the drive side by a thousandth: what is read at 0.085 of damping is not it."""
    traces = simulate_case(prepared, *manoeuvre_torques(prepared))
    identified = identified_modes(prepared, traces)
    for mode, (_, wanted) in zip(identified, target_modes(prepared.case), strict=True):
        for reading in (mode.vehicle, mode.matched):
            if reading is not None:
                assert reading.frequency == pytest.approx(wanted.frequency, rel=2e-3)
                assert reading.damping_ratio == pytest.approx(wanted.damping_ratio, rel=0.02)
    by_damping = {
        round(wanted.damping_ratio, 2): mode for mode, (_, wanted) in zip(identified, target_modes(prepared.case))
    }
    assert by_damping[0.08].vehicle is not None
    assert by_damping[0.08].matched is not None
