"""Perfect models that begin far off, with held or smooth inputs and rounded channels: nothing is added."""

import numpy as np
import pytest

from matching.diagnosis.diagnose import diagnose
from modelling.model_file import load
from modelling.recordings.corrections import resolution
from modelling.recordings.read import read_recording
from tests.campaign.perfect import draw, write

SEED = 4907


@pytest.mark.parametrize(
    ("number", "begins"),
    [
        pytest.param(14, "in another minimum, smooth inputs", marks=pytest.mark.long),
        (17, "in another minimum, held inputs"),
        (11, "where twenty iterations do not reach the end, held inputs"),
        pytest.param(12, "with held inputs of 12 bits", marks=pytest.mark.long),
    ],
)
def test_a_perfect_model_is_adequate_wherever_it_begins(number, begins, tmp_path):
    del begins
    write(draw(SEED, number), tmp_path)
    system = load(tmp_path / "model.toml")
    found = diagnose(system, [read_recording(tmp_path / "recording.csv", system)])
    assert (found.verdict, found.causes) == ("adequate", [])
    if draw(SEED, number).about["between"] == "held":
        assert any("taken as held between samples" in note for note in found.notes)


def test_resolution_is_that_of_a_rounded_signal_and_none_of_a_command_with_few_levels():
    rng = np.random.default_rng(1)
    smooth = np.cumsum(rng.standard_normal(5000))
    step = np.ptp(smooth) / 3000
    text = np.array([float(f"{value:.6g}") for value in np.round(smooth / step) * step])
    assert resolution(text) == pytest.approx(step, rel=1e-3)
    assert resolution(smooth) == 0.0
    assert resolution(rng.choice([-18.0, 18.0], 5000)) == 0.0
