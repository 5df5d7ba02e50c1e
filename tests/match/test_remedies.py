"""Single changes that make a limited case a match: which are tried, which are recommended; the match is made up."""

from dataclasses import dataclass, field, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from matching.match.case import Case
from matching.match.case_file import load_case
from matching.match.findings import Finding, counts_of
from matching.match.loop import linear_bed
from matching.match.remedies import RemedySettings, remedies_of
from modelling.bed.observer import sensor_noise
from modelling.system import Sensor

CASE = load_case(Path(__file__).parent / "found" / "better_encoder_worse_verdict" / "case.toml")
STEP = CASE.loop["sample_time"]


@dataclass
class Result:
    case: Case
    findings: list[Finding]
    response_error: SimpleNamespace
    status: str = "limited"

    def limited_by(self, cause):
        return any(one.cause == cause for one in self.findings)


def limited(case, *causes, measured=0.05, unmeasured=0.1):
    found = [Finding(cause, 1.0, 0.5) for cause in causes]
    return Result(case, found, SimpleNamespace(after=measured, unmeasured=unmeasured))


@dataclass
class Matches:
    """A match that holds where a rule says so."""

    rule: object
    tried: list[Case] = field(default_factory=list)

    def __call__(self, case):
        linear_bed(case)  # as every match begins
        self.tried.append(case)
        status = "matched" if self.rule(case) else "limited"
        return Result(case, [], SimpleNamespace(after=0.01, unmeasured=0.02), status)


def noise(case):
    return max(sensor_noise(one, STEP) for one in case.rig.sensors if one.name.startswith("rotor"))


def test_the_smallest_encoder_that_does_is_named_and_is_the_one_that_was_run():
    """The largest step first; then the smallest; what is to be written has the noise that was run."""
    now = noise(CASE)
    again = Matches(lambda case: noise(case) < now / 3.5)
    (found,) = remedies_of(limited(CASE, "standstill"), again, {})
    assert [round(now / noise(case)) for case in again.tried] == [8, 2, 4]
    assert found.factor == 4
    counts = {key: value for key, value in found.change.items() if key.endswith(".counts")}
    written = {key.rsplit(".", 2)[1]: value for key, value in counts.items()}
    assert set(written) == {one.speed_sensor for one in CASE.loop.dynamometers}  # the motor's is finer by far
    for name, many in written.items():
        as_written = Sensor(name, "speed", "x", None, many)
        assert sensor_noise(as_written, STEP) == pytest.approx(noise(again.tried[-1]))
        assert any(name in key and key.endswith("uncertainty") for key in found.change)


def test_what_helps_nothing_is_not_recommended_and_ends_soon():
    again = Matches(lambda case: False)
    settings = RemedySettings(most=5)
    causes = "response_error", "free_play", "beds_damping"
    assert remedies_of(limited(CASE, *causes, measured=0.2, unmeasured=0.5), again, {}, settings) == ()
    assert len(again.tried) == 5


def test_play_is_waived_alone_where_it_limits_alone():
    again = Matches(lambda case: not case.limits["opened_shafts"])
    (found,) = remedies_of(limited(CASE, "free_play"), again, {})
    assert found.change == {"limits.opened_shafts": False}
    assert (found.measured, found.unmeasured) == (0.01, 0.02)


def test_a_tolerance_is_the_error_that_was_found_and_one_per_cent():
    again = Matches(lambda case: case.unmeasured_tolerance > 0.4)
    found = remedies_of(limited(CASE, "response_error", unmeasured=0.4567), again, {})
    assert {"response.unmeasured_tolerance": 0.462} in [one.change for one in found]
    assert not any("response.tolerance" in one.change for one in found)


def test_an_error_that_is_no_number_is_no_tolerance():
    again = Matches(lambda case: True)
    found = remedies_of(limited(CASE, "response_error", measured=np.inf, unmeasured=np.inf), again, {})
    assert not any(key.startswith("response.") for one in found for key in one.change)


def test_a_further_torque_flange_has_a_name_that_no_sensor_has():
    """It is a bed that can be made: the sensors that a match adds by itself have other names."""
    cut = CASE.loop.dynamometers[0].follows
    taken = Sensor(f"{cut}_torque", "speed", CASE.rig.inertias[0].name)
    rig = tuple(one for one in CASE.rig.sensors if one.measures != "torque" or one.of != cut)
    rig = tuple(one for one in rig if one.name != taken.name)
    without = tuple(replace(one, torque_sensor=None) for one in CASE.loop.dynamometers)
    case = replace(
        CASE, rig=replace(CASE.rig, sensors=(*rig, taken)), loop=replace(CASE.loop, dynamometers=without),
    )  # fmt: skip
    again = Matches(lambda case: any(f"{cut}_torque_2" == name for name in case.loop.further_sensors))
    found = remedies_of(limited(case, "response_error", unmeasured=0.5), again, {}, RemedySettings(most=30))
    assert any("torque flange" in one.words for one in found)


@pytest.mark.parametrize("counts", [256, 1024, 8192])
def test_counts_are_those_of_the_noise(counts):
    """The difference of two rounded angles over a sample, drawn: its standard deviation gives the counts back."""
    random = np.random.default_rng(counts)
    quantum = 2 * np.pi / counts
    speed, starts = random.uniform(5, 80, 20000), random.uniform(0, quantum, 20000)
    read = (np.floor((starts + speed * STEP) / quantum) - np.floor(starts / quantum)) * quantum / STEP
    off = float(np.std(read - speed))
    assert sensor_noise(Sensor("w", "speed", "x", None, counts), STEP) == pytest.approx(off, rel=0.05)
    assert counts_of(off * 1.02, STEP) == counts
