"""Beds without torque flanges: an encoder and the inverter's torque; the observer estimates the torque in the shaft."""

import re

import numpy as np
import pytest
from independent.dynamic_stiffness import Judge as Independent
from plant.marks import needs_compiler
from small_bed import write

from matching.match.case_file import case_files, load_case
from matching.match.exported import exported_controller
from matching.match.loop import control_law, linear_bed
from matching.match.responses import error_figures
from matching.match.verify import disagreement, manoeuvre_torques, simulate_case
from modelling.controller.batch import ControllerBatch
from modelling.controller.law import EMULATION, SPEED_HOLD, TORQUE_GONE
from modelling.errors import InputError


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    """The small bed without its flange."""
    made = write(tmp_path_factory.mktemp("bare"))
    made.write_text(re.sub(r"torque_sensor = .*\n", "", made.read_text()))
    rig = made.parent / "rig.toml"
    rig.write_text(re.sub(r"\[sensors.flange_torque\]\n.*\n.*\n", "", rig.read_text()))
    return made


@pytest.fixture(scope="module")
def bare(file):
    return load_case(file)


def test_the_controller_reads_no_torque_and_the_error_is_that_of_an_independent_bed(bare):
    law = control_law(linear_bed(bare))
    assert law.sensors == ("rotor_speed", "motor_speed")
    low, high = np.log(bare.band)
    dense = np.exp(low + (high - low) * (np.arange(3000) + 0.5) / 3000)  # the bed has a sharp resonance
    found, stated = Independent(bare, law, dense).verdict({}), error_figures(bare)
    assert found.measured == pytest.approx(stated.after, rel=0.02)
    assert found.unmeasured == pytest.approx(stated.unmeasured, rel=0.02)


def test_the_simulated_motion_is_what_the_loop_foretells(bare):
    bed = linear_bed(bare)
    assert disagreement(bed, simulate_case(bed, manoeuvre_torques(bed)[0])) < 1e-4


@needs_compiler
def test_the_exported_c_does_what_the_python_does(bare):
    """From speed hold into emulation; nothing of it is taken for a lost torque."""
    controller = exported_controller(bare)
    assert controller.torque_readings == (-1,)
    batch, alone, random = ControllerBatch(controller, 1), controller.running(), np.random.default_rng(4)
    for n in range(200):
        readings = 0.02 * random.standard_normal(len(controller.law.sensors))  # noise, about what the model expects
        known = random.standard_normal(len(controller.law.known))
        mode = SPEED_HOLD if n < 50 else EMULATION
        commands, _, fault = batch.step(readings[:, None], known[:, None], mode, np.zeros((1, 1)), n)
        answer = alone.step(readings, known, mode, np.zeros(1), n)
        assert commands[:, 0] == pytest.approx(answer.commands, rel=1e-4, abs=1e-3)
        assert fault[0] == answer.fault
        assert answer.fault != TORQUE_GONE  # no bed answers: readings may become unexpected


def test_the_case_is_written_as_it_was_read(bare, tmp_path):
    for name, text in case_files(bare).items():
        (tmp_path / name).write_text(text)
    assert load_case(tmp_path / "case.toml").loop.dynamometers == bare.loop.dynamometers


@pytest.mark.parametrize("structure", ["pi", "model_based"])
def test_a_feedback_law_needs_the_flange(file, structure, tmp_path):
    for part in file.parent.iterdir():
        (tmp_path / part.name).write_text(part.read_text())
    case = tmp_path / file.name
    case.write_text(re.sub(r'structure = "\w+"', f'structure = "{structure}"', case.read_text()))
    with pytest.raises(InputError, match=r"dynamometers.dyno.torque_sensor: is missing, and structure"):
        load_case(case)
