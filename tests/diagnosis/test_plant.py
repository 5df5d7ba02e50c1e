"""The truth plant, a few recordings of it: nothing hidden, one effect, two effects, one outside the vocabulary."""

import re
import tomllib
from pathlib import Path

import pytest
from plant.case import make_case
from plant.marks import needs_compiler

from matching.diagnosis.diagnose import diagnose
from matching.diagnosis.result import Diagnosis
from modelling.model_file import dumps, from_dict, load
from modelling.recordings.read import read_recording
from modelling.toml import read_toml

pytestmark = needs_compiler


def diagnosed(
    folder: Path, *effects: str, size: str | float = "plain", seed: int = 5, duration: float = 8.0
) -> tuple[Diagnosis, dict]:
    """Make a recording of a two-mass drive and diagnose it."""
    case = make_case("two_mass", list(effects), size, "normal", seed, duration, 500.0)
    case.write(folder)
    system = load(folder / "model.toml")
    return diagnose(system, [read_recording(folder / "recording.csv", system)]), case.answer


@pytest.fixture(scope="module")
def subtle_drag(tmp_path_factory: pytest.TempPathFactory) -> tuple[Diagnosis, dict]:
    return diagnosed(tmp_path_factory.mktemp("drag"), "quadratic_drag", size="subtle")


def test_nothing_hidden_is_adequate(tmp_path: Path) -> None:
    found, _ = diagnosed(tmp_path)
    assert found.verdict == "adequate"
    assert found.causes == []


@pytest.mark.parametrize("kind", ["quadratic_drag", "sensor_drift"])
def test_one_subtle_effect_is_named_with_its_value(kind: str, tmp_path: Path, request: pytest.FixtureRequest) -> None:
    shared = kind == "quadratic_drag"
    found, answer = request.getfixturevalue("subtle_drag") if shared else diagnosed(tmp_path, kind, size="subtle")
    assert found.verdict == "explained"
    assert [(cause.kind, cause.at) for cause in found.causes] == [(answer["kind"], answer["at"])]
    for key, value in answer["parameters"].items():
        own = found.causes[0].parameters[key]
        assert abs(own.value - value) < 4 * own.standard_uncertainty
    for errors in found.errors.values():
        assert errors.after_holdout < 1.1 * errors.noise


def test_every_fitted_candidate_is_listed_with_the_reason_it_was_not_taken(tmp_path: Path) -> None:
    found, answer = diagnosed(tmp_path, "quadratic_drag", size="plain", duration=4.0)
    rows = found.to_dict()["candidates"]
    taken = [(row["kind"], row["at"]) for row in rows if row["not_taken"] is None]
    assert taken == [(answer["kind"], answer["at"])]
    assert len(rows) == len({(row["kind"], str(row["at"])) for row in rows}) >= 4
    reasons = {None, "not_better", "not_physical", "beyond_recording", "worse_unseen", "by_chance", "at_bound", "rival"}
    for row in rows:
        assert row["not_taken"] in reasons
        assert row["misfit"] >= 0.9 * rows[0]["misfit"]
    assert rows[0]["misfit_holdout"] == pytest.approx(1, abs=0.1)


@pytest.mark.long
def test_friction_that_differs_between_recordings_is_told_for_each(tmp_path: Path) -> None:
    case = make_case("two_mass", ["recording_friction"], "plain", "normal", 3, 3.0, 250.0)
    case.write(tmp_path)
    system = load(tmp_path / "model.toml")
    found = diagnose(system, [read_recording(tmp_path / f"{name}.csv", system) for name in ("recording", "holdout")])
    assert [(cause.kind, cause.at) for cause in found.causes] == [("recording_friction", case.answer["at"])]
    for key, value in case.answer["parameters"].items():
        estimate = found.causes[0].parameters[key]
        assert abs(estimate.value - value) < 4 * estimate.standard_uncertainty
    assert found.verdict == "explained"
    (effect,) = from_dict(tomllib.loads(dumps(found.extended))).effects
    assert [quantity.value for _, quantity in effect.parameters] == pytest.approx(
        [estimate.value for estimate in found.causes[0].parameters.values()]
    )


@pytest.mark.long
def test_two_effects_are_both_named(tmp_path: Path) -> None:
    found, answer = diagnosed(tmp_path, "coulomb_friction", "sensor_gain", duration=2.5)
    assert {(cause.kind, cause.at) for cause in found.causes} == {(one["kind"], one["at"]) for one in answer["causes"]}


def test_free_play_touched_on_one_side_is_told_as_a_lower_bound(tmp_path: Path) -> None:
    """A drive that pulls throughout crosses half of its free play, from the middle to one side, and never the rest."""
    hidden = make_case("two_mass", [("backlash", "shafts.link")], "plain", seed=4, duration=3.5)
    hidden.write(tmp_path)
    system = load(tmp_path / "model.toml")
    found = diagnose(system, [read_recording(tmp_path / "recording.csv", system)])
    assert [(cause.kind, cause.at) for cause in found.causes] == [("backlash", "shafts.link")]
    gap = found.causes[0].parameters["gap"]
    width = hidden.answer["parameters"]["gap"]
    least = float(re.search(r"only one side .* at least (\S+) rad", gap.note).group(1))
    assert least == pytest.approx(width / 2, rel=0.03)
    assert gap.standard_uncertainty >= gap.value


def test_extended_model_goes_through_its_file(tmp_path: Path, subtle_drag: tuple[Diagnosis, dict]) -> None:
    found, _ = subtle_drag
    path = tmp_path / "extended.toml"
    path.write_text(dumps(found.extended))
    again = from_dict(read_toml(path))
    assert again.effects == found.extended.effects
    assert again.parameters == found.extended.parameters


@pytest.mark.long
def test_torque_from_outside_is_not_explained(tmp_path: Path) -> None:
    """A 7 Hz torque that no input tells: nothing of the vocabulary may be given for sure."""
    found, answer = diagnosed(tmp_path, "disturbance", duration=3.0)
    assert answer["outside"]
    assert found.verdict == "unexplained" or all(cause.confidence < 0.5 for cause in found.causes)
    assert found.rest


@pytest.mark.long
def test_friction_and_free_play_at_once_are_both_named_with_their_sizes(tmp_path: Path) -> None:
    """A gap that begins too narrow would stay so, and a further spring would take its place."""
    found, answer = diagnosed(tmp_path, "coulomb_friction", "backlash", seed=6, duration=3.0)
    assert found.verdict == "explained"
    causes = {(cause.kind, cause.at): cause for cause in found.causes}
    assert set(causes) == {(one["kind"], one["at"]) for one in answer["causes"]}
    for one in answer["causes"]:
        for key, value in one["parameters"].items():
            own = causes[one["kind"], one["at"]].parameters[key]
            assert abs(own.value - value) < 4 * own.standard_uncertainty < 0.05 * value
