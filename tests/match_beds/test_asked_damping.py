"""How much damping each mode of a bed is asked for: by the vehicle's mode, by the bed's own, by the targets."""

from dataclasses import replace

import numpy as np
import pytest

from matching.match.beds import Judge, damping_faults
from matching.match.damping import asked_damping, decay_rates, is_stable_loop, stable_loops
from matching.match.findings import sentences
from matching.match.loop import controller_on, linear_bed
from matching.match.requirements import Requirements
from matching.match.robustness import not_kept
from matching.match.verify import OwnMode

STEP = 1e-3
TARGETS = Requirements(
    0.05, 1 / 3, 0.5, 20.0, 0.5, 100.0, (np.inf,), (np.inf,), ((2 * np.pi * 50, 0.03), (2 * np.pi * 12, 0.15))
)


def pole(hertz, ratio):
    """z of a mode."""
    size = 2 * np.pi * hertz
    return np.exp(size * complex(-ratio, np.sqrt(1 - ratio**2)) * STEP)


def asked(hertz, ratio, own=complex(-1e9, 0), fast=1.0, required=TARGETS):
    z = np.array([[pole(hertz, ratio), np.conj(pole(hertz, ratio))]])
    both = asked_damping(z, STEP, required, np.array([[own]]), np.array([fast]))[0]
    assert both[0] == both[1]
    return both[0]


def test_a_mode_is_asked_for_a_share_of_the_vehicles_mode_that_it_reproduces():
    assert asked(50, 0.02) == pytest.approx(0.03 / 3)
    assert asked(12, 0.1) == pytest.approx(0.05)  # the target itself: a share of its damping
    assert asked(25, 0.02) == 0.05  # like none of the vehicle's
    between = [asked(50 * ratio, 0.02) for ratio in (1.0, 1.1, 1.15, 1.2, 1.3)]
    assert between[0] == between[1] < between[2] < between[3] < between[4] == 0.05


def test_a_mode_that_control_does_not_move_is_asked_for_what_the_bed_has():
    own = 2 * np.pi * 30 * complex(-0.02, np.sqrt(1 - 0.02**2))
    assert asked(30, 0.02, own) == pytest.approx(0.95 * 0.02)
    assert asked(30, 0.2, own) == 0.05  # it is another one
    assert asked(36, 0.02, own) == 0.05


def test_beyond_the_roll_off_a_mode_keeps_what_the_bed_has_there():
    assert asked(150, 0.02, fast=0.01) == pytest.approx(0.0095)
    assert asked(60, 0.02, fast=0.01) > 0.0095


def test_one_rule_of_stability_at_one():
    for z, neutral, stable in (
        (1 + 5e-8, 0, False), (1 + 5e-8, 1, True), (1.0, 0, False), (1.0, 1, True), (1 + 5e-7, 1, False),
        (1 - 5e-7, 0, True),
    ):  # fmt: skip
        assert is_stable_loop(np.array([z, 0.5]), neutral) == stable
        assert stable_loops(np.array([[z, 0.5]]), neutral).tolist() == [stable]


def test_rates_of_decay_are_those_of_what_swings():
    z = np.array([[pole(10, 0.1), np.exp(-3.0 * STEP), -0.9, 1.01]])
    found = decay_rates(z, STEP)[0]
    assert found[0] == pytest.approx(2 * np.pi * 10 * 0.1)
    assert np.isinf(found[1])
    assert found[2] == pytest.approx(-np.log(0.9) / STEP)
    assert found[3] < 0


def test_a_bed_that_creeps_away_has_the_least_damping(small_case):
    bed = linear_bed(small_case)
    judge = Judge(small_case, controller_on(bed), 0, TARGETS)
    wrong = {"dynamometers.dyno.torque_gain": -1.0}
    verdicts = judge.verdicts([{}, wrong])
    assert verdicts.damping_ratio[1] < 0 < verdicts.damping_ratio[0]
    creeping = replace(judge.controller, A=judge.controller.A + 0.02 * np.eye(len(judge.controller.A)))
    found = Judge(small_case, creeping, 0, TARGETS).verdicts([{}])
    assert not found.stable[0]
    assert found.damping_ratio[0] < 0


def test_a_mode_damped_too_little_is_named_with_its_owner_and_how_many_beds_have_it(small_case, small_result):
    bed = linear_bed(small_result.tuned)
    judge = Judge(small_result.tuned, controller_on(bed), 0, small_result.robust.required)
    box = small_result.tuned.uncertainty
    values = [box.at(position) for position in box.draw(4, 1)]
    found = judge.verdicts(values)
    strict = replace(found, damped=np.zeros(4, bool), asked=np.full(4, 0.9))
    faults = damping_faults(judge, values, strict)
    assert sum(fault.beds for fault in faults) == 4
    mode = faults[0].mode
    assert mode.frequency > 0
    assert 0 < mode.share <= 1
    robust = replace(small_result.robust, beds=replace(small_result.robust.beds, damped=0, faults=faults))
    said = not_kept(small_result.case, robust)[0].sentence()
    assert said.startswith(f"{faults[0].beds} of 8 beds drawn within [uncertainty] damp the mode at ")
    assert f"{mode.frequency:.3g} Hz ({mode.owner}, " in said


def test_the_model_that_runs_ahead_is_judged_once(small_result):
    robust = small_result.robust
    slow = replace(robust, slowest_own=OwnMode(207.0, 0.5 * robust.required.decay_rate))
    (said,) = sentences(not_kept(small_result.case, slow))
    assert "207 Hz" in said
    assert "the same on every bed" in said
