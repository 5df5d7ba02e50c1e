"""Sixty drawn drives on drawn beds: each ends matched and verified, or limited for a reason that is true."""

import json
import re
import tomllib
from dataclasses import replace

import pytest
from match_beds.drawn_cases import BUILDS, DEAD_TIMES_S, STRUCTURES, draw

from matching.match.case import apply
from matching.match.case_file import load_case
from matching.match.findings import Finding, stated
from matching.match.match import match
from matching.report.match import content, summary

SEEDS = range(20, 60)  # forty take a third of the time of all long tests
SHORTER_DEAD_TIME = re.compile(r"solved with ([\d.]+) ms, every target is met")


def broken(result):
    """What of a result is not as a match has to be, by its figures alone."""
    checks, robust, error, case = result.verification, result.robust, result.response_error, result.case
    found = []
    if not checks.stable:
        found.append("loop")
    if checks.violations:
        found.append("limits")
    if not all(target.met for target in result.targets):
        found.append("targets")
    if robust is not None and robust.beds.drawn:
        if robust.beds.stable < robust.beds.drawn:
            found.append("beds")
        if robust.beds.damped < robust.beds.drawn:
            found.append("damping of beds")
    if error.after > case.tolerance:
        found.append("error to measured torques")
    loop, required = robust.loop, robust.required
    if error.unmeasured > case.unmeasured_tolerance:
        found.append("error to unmeasured torques")
    if loop.largest_rolled_off > required.rolled_off:
        found.append("roll-off")
    if any(noise > most for noise, most in zip(loop.command_noise.values(), required.command_noise)):
        found.append("noise")
    if any(torque > most for torque, most in zip(loop.unexpected_torque.values(), required.sensor_offset)):
        found.append("offsets")
    if robust.slowest_own is not None and robust.slowest_own.rate < required.decay_rate:
        found.append("feed-forward")
    if robust.beds.worst is not None and robust.beds.worst.damping_ratio <= 0:
        found.append("worst bed")
    ways = (robust.beds.opened, *robust.beds.opened_alone.values())
    softer = any(ratio <= 0 for way in ways for ratio in way.values())
    if required.opened_shafts and (softer if result.lash is None else result.lash.limit_cycles):
        found.append("free play")
    return found


def ends_well(result):
    """Status, sentences and figures agree."""
    if result.status == "matched":
        assert not result.limits
        assert not broken(result)
    else:
        assert broken(result) or any("the manoeuvre takes" in sentence for sentence in result.limits), result.limits
        assert any(any(letter.isdigit() for letter in sentence) for sentence in result.limits), result.limits


@pytest.mark.long
@pytest.mark.parametrize("seed", SEEDS)
def test_a_drawn_case_ends_well(seed, tmp_path):
    case = load_case(draw(seed, tmp_path))
    result = match(case)
    ends_well(result)
    written = content(result)
    json.dumps(written, allow_nan=False)
    assert summary(written).startswith(result.status.upper())
    for milliseconds in re.findall(SHORTER_DEAD_TIME, " ".join(result.limits)):
        shorter = apply(case, {"loop.dead_time": float(milliseconds) * 1e-3})  # beds are drawn about it, as from a file
        assert all(target.met for target in match(shorter).targets)


def test_a_match_whose_figures_hold_ends_well_and_others_do_not(small_result):
    """What the long test asks, of a match that holds and of results that say what their figures do not."""
    ends_well(small_result)
    robust = small_result.robust
    beds = replace(robust, beds=replace(robust.beds, damped=5))
    loud = replace(robust, loop=replace(robust.loop, command_noise={"dyno": 1e3}))
    for false in (
        replace(small_result, verification=beds), replace(small_result, verification=loud),
        replace(small_result, targets=(replace(small_result.targets[0], met=False),)),
        replace(small_result, findings=tuple(stated("dead_time", ["mode 2 is reached at 3 Hz"]))),
    ):  # fmt: skip
        with pytest.raises(AssertionError):
            ends_well(false)
    ends_well(replace(small_result, verification=beds, findings=(Finding("beds_not_stable", beds=(3, 8)),)))


def test_the_draws_cover_builds_structures_dead_times_and_sensors(tmp_path):
    cases = [tomllib.loads(draw(seed, tmp_path / str(seed)).read_text()) for seed in SEEDS]
    loops = [case["loop"] for case in cases]
    assert {(seed % len(BUILDS), loop["structure"]) for seed, loop in zip(SEEDS, loops, strict=True)} == {
        (build, structure) for build in range(len(BUILDS)) for structure in STRUCTURES
    }
    assert {loop["dead_time"] for loop in loops} == set(DEAD_TIMES_S)
    assert {len(case["dynamometers"]) for case in cases} == {1, 2, 4}
    assert {"knows" in loop for loop in loops} == {"measures" in loop for loop in loops} == {True, False}
    assert {"operating_point" in case for case in cases} == {True, False}
