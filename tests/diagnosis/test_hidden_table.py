"""A torque that no law describes, hidden by the truth plant: its curve stands at its place, over its variable."""

from pathlib import Path

import numpy as np
import pytest
from plant.bench import record
from plant.excitation import Excitation
from plant.hidden import Hidden
from plant.marks import needs_compiler
from plant.sensing import add_noise
from plant.systems import two_mass
from plant.writing import model_text, recording_text

from matching.diagnosis.diagnose import diagnose
from matching.diagnosis.result import Diagnosis
from modelling.model_file import load
from modelling.recordings.read import read_recording

pytestmark = [needs_compiler, pytest.mark.long]
STEP, SAMPLES = 4e-3, 1500  # s
NOISE = {"motor_speed": 0.01, "load_speed": 0.01, "link_torque": 0.02}  # rad/s, rad/s, N·m
PEAK, CENTRE, WIDTH = 1.0, 0.3, 0.3  # N·m, rad, rad


def hidden_torque(angle: np.ndarray) -> np.ndarray:
    """On the load near one angle, always in one direction, N·m."""
    return -PEAK * np.exp(-(((angle - CENTRE) / WIDTH) ** 2))


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> Diagnosis:
    """Sines whose mean is zero: the load passes the angle again and again, both ways."""
    folder: Path = tmp_path_factory.mktemp("table")
    drive, time = two_mass(np.random.default_rng(1)), np.arange(SAMPLES) * STEP
    points = np.linspace(-2, 2, 33)
    table = {f"angle_{i}": x for i, x in enumerate(points, 1)}
    table |= {f"torque_{i}": y for i, y in enumerate(hidden_torque(points), 1)}
    waves = [[(8.0, 0.37), (6.0, 1.1), (3.0, 7.3)], [(4.0, 0.61), (2.0, 4.7)]]  # N·m, Hz
    inputs = np.array([sum(a * np.cos(2 * np.pi * f * time) for a, f in some) for some in waves]).T
    at_rest = np.zeros_like(inputs)
    excitation = Excitation(inputs, 0, {}, at_rest, at_rest, 0.0)
    take = record(drive, [Hidden("table", "inertias.load", table)], excitation, STEP)
    readings = add_noise(take.readings, NOISE, [], np.random.default_rng(2))
    (folder / "model.toml").write_text(model_text(drive, drive.values, NOISE, set()))
    (folder / "recording.csv").write_text(recording_text(drive, take, readings))
    system = load(folder / "model.toml")
    return diagnose(system, [read_recording(folder / "recording.csv", system)], keep_rest=True)


def test_no_cause_of_the_vocabulary_is_named_for_sure(found: Diagnosis) -> None:
    assert found.verdict == "unexplained"
    assert all(cause.confidence < 0.5 for cause in found.causes)


def test_the_table_is_kept_at_its_place_and_unseen_data_gain(found: Diagnosis) -> None:
    assert found.kept is not None
    assert (found.kept.effect.at, found.kept.over) == ("inertias.load", "angle")
    assert found.kept.nrmse_after < 0.7 * found.kept.nrmse_before


def test_its_curve_has_the_shape_of_the_torque(found: Diagnosis) -> None:
    curve = next(c for c in found.discrepancy if (c.at, c.over) == ("inertias.load", "angle"))
    assert np.corrcoef(curve.torque, hidden_torque(curve.grid))[0, 1] > 0.7
