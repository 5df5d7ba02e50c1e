"""Beds in time: the batch, the exported controller for minutes, and a fault in the loop's matrices that it finds."""

from dataclasses import replace

import numpy as np
import pytest

from matching.match import loop as loop_of_match
from matching.match.exported import exported_controller
from matching.match.loop import control_law, linear_bed
from matching.match.minutes import MinuteSettings, minutes
from matching.match.verify import verify
from modelling.bed import bed as bed_of_model
from modelling.controller.batch import ControllerBatch

SHORT = MinuteSettings(seconds=1.5, settle=1.0, pulse=0.2)


@pytest.fixture(scope="module")
def exported(small_result):
    return exported_controller(small_result.tuned)


def test_a_fault_of_30_percent_in_the_matrices_of_loop_and_design_is_found(small_case, monkeypatch):
    """The controller, its poles and its errors come from the same matrices, so all of them agree with each other."""
    sound = verify(small_case, deviations=False)
    assert sound.checks["loop and simulation agree"]
    exact = bed_of_model.delayed_beds

    def too_strong(*arguments):
        return [replace(made, new=1.3 * made.new, old=1.3 * made.old) for made in exact(*arguments)]

    for module in (bed_of_model, loop_of_match):  # the observer's model is made by the former
        monkeypatch.setattr(module, "delayed_beds", too_strong)
    wrong = verify(small_case, deviations=False)
    assert wrong.checks["sampled loop"]
    assert not wrong.checks.get("loop and simulation agree", False)
    assert not wrong.stable


def test_a_law_steps_many_beds_as_it_steps_each(small_case):
    law, random = control_law(linear_bed(small_case)), np.random.default_rng(1)
    states, readings = random.normal(size=(len(law.A), 5)), random.normal(size=(len(law.sensors), 5))
    known, limit = random.normal(size=(len(law.known), 5)), np.array([[3.0]])
    sent, after = law.step(states, readings, known, limit)
    for i in range(5):
        alone = law.step(states[:, i], readings[:, i], known[:, i], limit[:, 0])
        np.testing.assert_allclose(sent[:, i], alone[0], rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(after[:, i], alone[1], rtol=1e-10, atol=1e-12)


def test_a_batch_of_exported_controllers_is_the_controller_in_python(exported):
    """C sources against Python, two beds with readings of their own, through hold, emulation and a fault."""
    law, random = exported.law, np.random.default_rng(2)
    y, w, k = len(law.sensors), len(law.known), len(law.dynamometers)
    batch, alone = ControllerBatch(exported, 2), [exported.running(), exported.running()]
    for n in range(120):
        readings, known = 0.1 * random.normal(size=(y, 2)), random.normal(size=(w, 2))
        readings[:, 1] *= 1.0 if n < 100 else np.nan
        commands, modes, faults = batch.step(readings, known, 1 if n < 40 else 2, np.zeros((k, 2)), n)
        for b, one in enumerate(alone):
            answer = one.step(readings[:, b], known[:, b], 1 if n < 40 else 2, np.zeros(k), n)
            np.testing.assert_allclose(commands[:, b], answer.commands, rtol=1e-9, atol=1e-9)
            assert (modes[b], faults[b]) == (answer.mode, answer.fault)
    assert faults.tolist() == [0, 1]


def test_a_controller_that_stays_in_emulation_and_one_that_does_not(small_result, exported):
    stays = minutes(small_result.tuned, exported, 3, SHORT)
    assert len(stays.runs) == 4
    assert [run.emulated for run in stays.runs] == [SHORT.seconds] * 4
    assert not stays.findings
    assert all(0 < run.drift < 5 for run in stays.runs)
    strict = replace(exported.settings, unexpected=np.full(len(exported.settings.unexpected), 1e-2))
    gives_up = minutes(small_result.tuned, replace(exported, settings=strict), 3, SHORT)
    assert {run.fault for run in gives_up.runs} == {"unexpected"}
    assert max(run.emulated for run in gives_up.runs) < SHORT.seconds
    (found,) = gives_up.findings
    assert found.beds == (4, 4)
    assert "unexpected" in found.sentence()


def test_an_emulation_begins_from_means_of_readings_torques_and_commands(exported):
    """Double exponential means over 0.05 s, of commands too: noise leaves a sixth of one sample's."""
    law, random = exported.law, np.random.default_rng(4)
    samples, starts = round(0.05 / law.sample_time), []
    for _ in range(30):
        one, sent = exported.running(), np.zeros(len(law.dynamometers))
        mean, slow = None, None
        for n in range(6 * samples + 1):
            noisy, known = 50.0 + random.normal(size=len(law.sensors)), random.normal(size=len(law.known))
            emulating, held = n == 6 * samples, min(n + 1, samples)
            answer = one.step(noisy, known, 2 if emulating else 1, np.full(len(law.dynamometers), 50.0), n)
            now = np.concatenate([noisy, known, sent if emulating else answer.commands])  # those of the last sample
            mean = now if mean is None else mean + (now - mean) / held
            slow = mean if slow is None else slow + (mean - slow) / held
            sent = answer.commands
        assert np.concatenate(one._start) == pytest.approx(2 * mean - slow, rel=1e-9, abs=1e-9)
        starts.append(one._start[0])
    share = 1 / samples  # variance of twice a mean less the mean of the mean, for a small share: 5/4 of it
    assert np.std(starts) == pytest.approx(np.sqrt(1.25 * share), rel=0.25)


def test_an_emulation_begins_where_a_hold_that_still_rises_is(exported):
    """An even rise of all readings leaves no lag in the start."""
    one, rise = exported.running(), 1e-3
    for n in range(2000):
        readings = np.full(len(exported.law.sensors), rise * n)
        one.step(readings, np.zeros(len(exported.law.known)), 1 if n < 1999 else 2, np.zeros(1), n)
    assert one._start[0] == pytest.approx(readings, abs=0.05 * rise)
