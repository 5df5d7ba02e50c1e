"""Long data: causes are searched for in a window, fitted to all, and searched for in all where that is not enough."""

import pytest
from plant.case import make_case
from plant.marks import needs_compiler

from matching.diagnosis.data import prepare_data
from matching.diagnosis.descent import solve
from matching.diagnosis.diagnose import diagnose
from matching.diagnosis.moves import search_window
from matching.diagnosis.problem import base_problem
from matching.diagnosis.settings import DiagnosisSettings
from modelling.model_file import load
from modelling.recordings.read import read_recording

pytestmark = needs_compiler


@pytest.fixture(scope="module")
def drag(tmp_path_factory):
    """Model and recording of a two-mass drive with a drag that grows with the square of the speed."""
    folder = tmp_path_factory.mktemp("drag")
    make_case("two_mass", ["quadratic_drag"], "plain", "normal", 5, 8.0, 500.0).write(folder)
    system = load(folder / "model.toml")
    return system, read_recording(folder / "recording.csv", system)


@pytest.fixture(scope="module")
def base(drag):
    system, recording = drag
    return solve(*base_problem(system, prepare_data(system, [recording])[0]))


def test_short_data_have_no_window(base) -> None:
    assert search_window(base, DiagnosisSettings().window) is None


@pytest.mark.long
def test_answer_is_that_of_a_search_over_all(drag) -> None:
    system, recording = drag
    steps: list[str] = []
    whole = diagnose(system, [recording])
    found = diagnose(system, [recording], progress=steps.append, settings=DiagnosisSettings(window=4000))
    assert any("time window" in step for step in steps)
    assert [(cause.kind, cause.at) for cause in found.causes] == [(cause.kind, cause.at) for cause in whole.causes]
    assert found.verdict == whole.verdict == "explained"
    for key, expected in whole.causes[0].parameters.items():
        value = found.causes[0].parameters[key]
        assert abs(value.value - expected.value) < 0.3 * expected.standard_uncertainty
        assert value.standard_uncertainty == pytest.approx(expected.standard_uncertainty, rel=0.1)
    for name, errors in whole.errors.items():
        assert found.errors[name].after_holdout == pytest.approx(errors.after_holdout, rel=0.02)
