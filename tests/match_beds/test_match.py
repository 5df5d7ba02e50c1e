"""A match with an observer, small effort: what it states holds, and what is not kept is said."""

import json
from dataclasses import replace

import numpy as np
import pytest
from result_schema import check_schema

from matching.match.beds import DampingFault, NamedMode
from matching.match.bounds import errors_with_bounds, estimator_bound, prompt_bound
from matching.match.findings import Finding, sentences
from matching.match.limits import led_by_bound
from matching.match.loop import bed_set, controller_on, frequency_response, linear_bed
from matching.match.loop import responses as controlled
from matching.match.match import match
from matching.match.responses import error_figures
from matching.match.robustness import not_kept, noted
from matching.match.verify import matched_motion
from matching.report.match import content, summary
from modelling.bed.controllers import STRUCTURES

FAULT = DampingFault(3, NamedMode(5.2, 0.01, 0.03, "inertias.rotor", 0.7, "kinetic"))


@pytest.fixture
def result(small_result):
    return small_result


def test_the_target_is_met_in_the_loop_and_in_the_simulation(result):
    assert result.status == "matched", result.limits
    target = result.targets[0]
    assert target.matched == pytest.approx(target.vehicle, rel=0.01)
    assert target.identified == pytest.approx(target.vehicle, rel=0.02)
    assert result.response_error.after < 0.02 < result.response_error.before
    assert result.response_error.unmeasured < result.case.unmeasured_tolerance


@pytest.mark.long
def test_with_40_ms_the_dead_time_is_named_first_and_the_search_is_short(small_case):
    """A controller that knew every torque would miss both tolerances: no long search finds another."""
    box = small_case.uncertainty.about({"loop.dead_time": 0.04})
    case = replace(small_case, loop=small_case.loop.with_values({"dead_time": 0.04}), uncertainty=box)
    late = match(case, beds=3)
    assert late.status == "limited"
    assert late.response_error.bound > case.unmeasured_tolerance
    assert late.limits[0].startswith("with every torque measured, dead time and sampling alone leave")
    assert any("response error to measured torques" in sentence for sentence in late.limits[1:])
    assert any("the search is short" in note for note in late.notes)
    json.dumps(content(late), allow_nan=False)
    assert "sampling alone leave" in summary(content(late)).splitlines()[1]


def _three_masses(f: np.ndarray, motor: float, side: float) -> np.ndarray:
    """The small vehicle's compared responses (f, 3) by complex equations of our own."""
    K = np.array([[side, -side, 0], [-side, side + 8000, -8000], [0, -8000, 8000]], dtype=complex)
    C = np.array([[2 + 0.01, -2, 0], [-2, 2 + 30, -30], [0, -30, 30 + 0.5]])
    found = []
    for w in 2 * np.pi * f:
        q = np.linalg.solve(K + 1j * w * C - w**2 * np.diag([motor, 1.0, 40.0]), np.eye(3))
        twist = (side + 2j * w) * (q[0] - q[1])
        found.append([1j * w * q[0, 0], twist[0], twist[2]])
    return np.array(found)


@pytest.mark.long
def test_what_the_specimen_alone_leaves_is_not_put_on_the_dead_time(small_case):
    """A motor and a side shaft that are not the vehicle's: the best bed answers like the vehicle with these parts."""
    other = small_case.rig.with_values({"inertias.motor.J": 0.9, "shafts.side.stiffness": 7000.0})
    f = np.geomspace(*small_case.band, 4000)
    ratio = np.log(_three_masses(f, 0.9, 7000.0) / _three_masses(f, 0.5, 4000.0))
    by_hand = np.sqrt(np.mean(np.abs(ratio) ** 2))
    for dead_time in (0.0023, 0.04):
        box = small_case.uncertainty.about({"loop.dead_time": dead_time})
        case = replace(small_case, loop=small_case.loop.with_values({"dead_time": dead_time}), uncertainty=box)
        assert prompt_bound(case) < 0.01
        assert prompt_bound(replace(case, rig=other)) == pytest.approx(by_hand, rel=0.03)
        for rig, causes in (
            (case.rig, {0.0023: [], 0.04: ["dead_time_alone"]}[dead_time]),
            (other, ["other_specimen"]),
        ):
            own = replace(case, rig=rig)
            error = errors_with_bounds(own, error_figures(own))
            found = led_by_bound([Finding("response_error", 1.0, 0.1, where="measured torques")], own, error)
            assert [one.cause for one in found[:-1]] == causes


def test_a_short_search_is_for_dead_times_out_of_reach_alone(result):
    assert not any("sampling alone" in sentence for sentence in [*result.notes, *result.limits])


def test_the_result_states_beds_margin_and_noise(result):
    stated = json.loads(json.dumps(content(result)))
    assert stated["beds"]["drawn"] == stated["beds"]["stable"] == 8
    assert stated["margin"]["modulus"] == result.verification.modulus_margin >= 0.5
    assert stated["margin"]["from"] == pytest.approx(2 * result.targets[0].vehicle, rel=1e-3)
    assert stated["command_noise"]["dyno"] <= 0.02 * 1500
    assert "on 8 drawn beds" in summary(stated)
    check_schema("match", stated)


def test_an_ideal_estimator_does_as_well_as_noise_and_dead_time_allow(small_case, result):
    """Less noise is better, more is worse; with hardly any no tuned observer comes near."""
    bound = result.response_error.unmeasured_bound
    exact, poor = (
        estimator_bound(replace(small_case, rig=replace(small_case.rig, sensors=sensors)))
        for sensors in (
            tuple(replace(part, uncertainty=size) for part in small_case.rig.sensors) for size in (0.02, 5.0)
        )
    )
    assert exact < bound < poor
    assert exact < 0.8 * result.response_error.unmeasured
    assert content(result)["response_error"]["unmeasured_bound"] == bound


def test_what_is_not_kept_is_named(result):
    robust = replace(
        result.robust, required=replace(result.robust.required, command_noise=(1e-3,), rolled_off_from=40.0)
    )
    robust = replace(robust, loop=replace(robust.loop, largest_rolled_off=0.7))
    robust = replace(robust, beds=replace(robust.beds, damped=5, faults=(FAULT,)))
    strict = replace(result.case, unmeasured_tolerance=1e-4)
    said = sentences(not_kept(strict, robust))
    assert any(words.startswith("3 of 8 beds") for words in said)
    assert any("sensor noise makes" in words and "0.001 N·m is allowed" in words for words in said)
    assert any("response error to unmeasured torques" in words for words in said)
    assert any("|T| is 0.70" in words for words in said)
    assert not not_kept(result.case, result.robust)
    closed = replace(result.robust, beds=replace(result.robust.beds, opened={}))
    assert not noted(result.case, closed)


def test_a_feedback_law_is_held_to_the_same_limits(result):
    """A limit that is exceeded is a limit for every structure."""
    loop = replace(result.case.loop, structure=STRUCTURES["model_based"])
    case = replace(result.case, loop=loop, tolerance=1e-9, unmeasured_tolerance=1e-4)
    beds = replace(result.robust.beds, stable=6, worst=replace(result.robust.beds.worst, damping_ratio=-0.01))
    robust = replace(result.robust, beds=beds, loop=replace(result.robust.loop, largest_rolled_off=0.7))
    said = sentences(not_kept(case, robust))
    assert said == sentences(not_kept(replace(case, loop=result.case.loop), robust))
    assert said[0].startswith("2 of 8 beds drawn within")
    for words in ("to measured torques", "to unmeasured torques", "(damping ratio -0.0100)", "|T| is 0.70"):
        assert any(words in sentence for sentence in said)
    damped = replace(result.robust, beds=replace(result.robust.beds, damped=5, faults=(FAULT,)))
    (missed,) = sentences(not_kept(replace(result.case, loop=loop), damped))
    assert missed.startswith("3 of 8 beds drawn within [uncertainty] damp the mode at 5.2 Hz (inertias.rotor, 70 %")
    assert not noted(replace(result.case, loop=loop), damped)


def test_a_worst_bed_damped_too_little_is_noted_with_how_much_it_has(result):
    mode = FAULT.mode
    worst = replace(result.robust.beds.worst, damping_ratio=0.8 * mode.asked, mode=mode)
    robust = replace(result.robust, beds=replace(result.robust.beds, worst=worst, opened={}))
    assert not not_kept(result.case, robust)
    (note,) = sentences(noted(result.case, robust))
    assert "80 % of the" in note
    assert worst.named[0] in note


def test_the_simulated_loop_swings_as_the_frequency_response_says(result):
    """Steady swing at 4 Hz by time steps with a delay line, against the response of the sampled loop."""
    tuned, frequency, step = result.tuned, 4.0, 1e-3
    time = np.arange(6000) * step
    torque = 10 * np.sin(2 * np.pi * frequency * time)
    parts = linear_bed(tuned)
    traces = matched_motion(parts, {"motor_torque": torque})
    last = slice(-1000, None)
    drive = np.exp(-2j * np.pi * frequency * time[last])
    swing = 2 * np.mean(traces["side_torque"][last] * drive) / 10 * 1j
    bed = bed_set(tuned, [{}], np.array([frequency]))
    wanted = controlled(bed, frequency_response(controller_on(parts), bed.frequencies), ("motor_torque",))[0, 0, 1]
    assert swing == pytest.approx(wanted, rel=5e-3)
