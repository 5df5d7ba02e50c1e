"""Cases drawn at random end matched and verified, or limited with a stated limit; checked by other means."""

import numpy as np
import pytest
from match import drawn, independent
from match.conftest import LITTLE

from matching.match.case_file import load_case
from matching.match.match import match
from modelling.bed.vehicle import cut

QUICK = (2,)


@pytest.mark.parametrize(
    "seed", [seed if seed in QUICK else pytest.param(seed, marks=pytest.mark.long) for seed in range(20)]
)
def test_never_wrong(seed, tmp_path):
    case = load_case(drawn.draw(seed, tmp_path))
    result = match(case, seed, starts=3, settings=LITTLE if seed in QUICK else None)
    checks, tuned = result.verification, result.tuned

    own = independent.poles(tuned)
    assert checks.checks["sampled loop"] == (own.real.max() < 0)
    for name in (move.name for move in case.moves):
        part = next(one for one in result.parameters if one.name == name)
        assert part.lower <= part.tuned <= part.upper

    if result.status == "limited":
        assert result.limits
        assert all(any(letter.isdigit() for letter in sentence) for sentence in result.limits)
        broken = checks.violations or not checks.stable or not all(target.met for target in result.targets)
        broken = broken or result.response_error.unmeasured > case.unmeasured_tolerance or not checks.beds.holds
        assert broken or "the manoeuvre takes" in " ".join(result.limits)
        return
    assert result.status == "matched"
    assert result.limits == ()
    assert own.real.max() < 0
    assert checks.modulus_margin >= case.limits["modulus_margin"]
    (target,) = result.targets
    if not case.loop.structure.has_feed_forward:
        frequency = np.abs(own) / (2 * np.pi)
        near = own[
            np.argmin(np.abs(frequency / target.vehicle - 1) + np.abs(-own.real / np.abs(own) - target.vehicle_damping))
        ]
        assert abs(near) / (2 * np.pi) == pytest.approx(target.vehicle, rel=0.011)
        assert -near.real / abs(near) == pytest.approx(target.vehicle_damping, abs=0.021)
    step = case.loop["sample_time"]
    time = np.arange(0, 1.5, step)
    torque = np.clip(time / 0.05, 0, 1) * case.manoeuvre["motor_torque"].amplitude
    feed_forward = case.loop.structure.feed_forward(tuned.rig, cut(case.vehicle, case.rig), tuned.loop)
    wanted = independent.vehicle_motion(case, torque, step)
    got = independent.rig_motion(tuned, feed_forward, torque, step)
    # what swings: each motion less its own smooth rise
    swing = [motion - np.polyval(np.polyfit(time, motion, 3), time) for motion in (wanted, got)]
    # of the swing: with feed-forward the error stated for the motor speed, else 1 % in frequency and 0.02 in damping
    allowed = result.response_error.functions[0].after + 0.01 if feed_forward else 0.3
    assert np.std(swing[1] - swing[0]) < allowed * np.std(swing[0])


def test_draws_cover_both_ends_and_structures(tmp_path):
    cases = [load_case(drawn.draw(seed, tmp_path / str(seed))) for seed in range(20)]
    assert {case.loop.structure.name for case in cases} == {"pi", "model_based"}
    assert {len(case.loop.dynamometers) for case in cases} == {1, 2}
    delays = [case.loop["dead_time"] for case in cases]
    assert min(delays) < 0.001
    assert max(delays) > 0.01
