"""A real drive, the public EMPS recording: dry friction first, and told that more is left open."""

from pathlib import Path

import pytest

from matching.diagnosis.diagnosis import diagnose
from modelling.measurement.read import read_recording
from modelling.model.files import load

EMPS = Path(__file__).parents[2].parent / "shared" / "data" / "emps"
pytestmark = pytest.mark.skipif(not EMPS.exists(), reason="the shared recording of the real drive is not here")


@pytest.mark.long
def test_real_drive_has_dry_friction_first_and_something_left_over() -> None:
    system = load(EMPS / "model.toml")
    found = diagnose(system, [read_recording(EMPS / "recording.csv", system)])
    first = found.causes[0]
    assert (first.kind, first.at) == ("coulomb_friction", "inertias.carriage")
    forward, reverse = (first.parameters[key] for key in ("torque", "torque_reverse"))
    for own in (forward, reverse):
        assert 0 < own.standard_uncertainty < 0.1 * own.value
    errors = found.errors["position"]
    assert errors.after_holdout < 0.1 * errors.before_holdout
    assert found.verdict == "unexplained"
    assert found.rest
