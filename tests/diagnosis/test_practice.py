"""The eleven practice recordings, made by a plant that shares no code with the models: kind, place and value."""

import json
from pathlib import Path

import numpy as np
import pytest

from matching.diagnosis.diagnose import diagnose
from modelling.model_file import load
from modelling.recordings.read import read_recording

PRACTICE = Path(__file__).parents[2].parent / "shared" / "practice"
pytestmark = pytest.mark.skipif(not PRACTICE.exists(), reason="the shared practice recordings are not here")
CASES = [f"case{i:02d}" for i in range(10)]
SECONDS = 6.0  # of 16 s: enough to name every cause; whole recordings are long tests
# From 6 s the gap of a lash is fitted to another point on other processors, 0.04 % apart, the uncertainty stated is
# smaller than that, and the verdict may tip. Known, and open; from a whole recording name, value and uncertainty hold.
NEEDS_ALL = "case02"
QUICK = ("case00", "case09")  # of every `make test`; the others take 20 to 40 s each
SHORT = [
    pytest.param(case, SECONDS, marks=() if case in QUICK else pytest.mark.long) for case in CASES if case != NEEDS_ALL
]
LONG = [pytest.param(case, np.inf, marks=pytest.mark.long) for case in CASES]


@pytest.mark.parametrize(("case", "end"), [*SHORT, *LONG])
def test_practice_case_is_named_with_place_and_value(case: str, end: float) -> None:
    answer = json.loads((PRACTICE / "answers.json").read_text())[case]
    system = load(PRACTICE / case / "model.toml")
    found = diagnose(system, [read_recording(PRACTICE / case / "recording.csv", system).cut(0, end)])
    if answer["kind"] == "none":
        assert found.verdict == "adequate"
        assert not found.causes
        assert found.extended.effects == ()
        return
    assert found.verdict == "explained"
    assert [cause.kind for cause in found.causes] == [answer["kind"]]
    cause = found.causes[0]
    assert cause.at in [answer["at"], *answer.get("equivalent", [])]
    for errors in found.errors.values():
        assert errors.after_holdout < 1.1 * errors.noise
    assert len(found.extended.effects) == 1
    for key, value in answer["parameters"].items():
        own = cause.parameters[key]
        assert own.standard_uncertainty < 0.05 * abs(value)
        off = abs(own.value - value) / own.standard_uncertainty
        assert off < 4 or abs(own.value - value) < 1e-9


@pytest.mark.long
def test_plain_lash_between_two_masses_is_named_and_every_other_candidate_has_its_reason() -> None:
    """The gap is right to a thousandth; its stated uncertainty is still too small (the misfit is kinked)."""
    answer = json.loads((PRACTICE / "answers.json").read_text())["case10"]
    system = load(PRACTICE / "case10" / "model.toml")
    found = diagnose(system, [read_recording(PRACTICE / "case10" / "recording.csv", system)])
    assert found.verdict == "explained"
    assert [(cause.kind, cause.at) for cause in found.causes] == [(answer["kind"], answer["at"])]
    assert found.causes[0].parameters["gap"].value == pytest.approx(answer["parameters"]["gap"], rel=1e-3)
    rows = found.to_dict()["candidates"]
    assert len(rows) >= 5
    assert [row["kind"] for row in rows if row["not_taken"] is None] == [answer["kind"]]
    for errors in found.errors.values():
        assert errors.after_holdout < 1.1 * errors.noise
