"""What a recording cannot tell from a named cause: by the equations of one inertia, where that is known."""

from types import SimpleNamespace

import numpy as np
import pytest

from matching.diagnosis.diagnose import diagnose
from matching.diagnosis.result import Diagnosis, KnownScreening
from matching.diagnosis.screening import ScreenedCandidate
from modelling.model_file import from_dict
from modelling.recordings.recording import Recording

J, DRAG, RESISTING, NOISE = 0.2, 0.5, 2.0, 0.02
TIME = np.arange(0, 6, 5e-3)
FREQUENCIES = 2 * np.pi * np.array([0.4, 1.1, 2.3])
MODEL = {
    "inertias": {"rotor": {"J": J, "drag": DRAG}},
    "inputs": {"motor": {"on": "rotor"}},
    "sensors": {"speed": {"measures": "speed", "of": "rotor", "uncertainty": NOISE}},
}


def diagnosed(mean: float) -> Diagnosis:
    """A constant torque hidden in a steady vibration about a mean motor torque (N·m): J·ω̇ + DRAG·ω = T − RESISTING."""
    waves = 4 * np.exp(1j * np.outer(TIME, FREQUENCIES))
    torque = mean + waves.real.sum(axis=1)
    speed = (mean - RESISTING) / DRAG + (waves / (1j * FREQUENCIES * J + DRAG)).real.sum(axis=1)
    noisy = speed + NOISE * np.random.default_rng(2).normal(size=len(TIME))
    return diagnose(from_dict(MODEL), [Recording(TIME, {"motor": torque, "speed": noisy}, (), "made", {})])


def named(found: Diagnosis) -> set[tuple[str, str]]:
    (cause,) = found.causes
    return {(cause.kind, cause.at)} | {(rival.kind, rival.at) for rival in cause.alternatives}


@pytest.fixture(scope="module")
def one_sign() -> Diagnosis:
    return diagnosed(mean=20.0)


def test_all_that_is_the_same_while_the_speed_keeps_its_sign_is_listed(one_sign: Diagnosis) -> None:
    """Friction of 2 N·m, a resisting torque and a speed offset of −RESISTING/DRAG = −4 rad/s give the same speed."""
    same = {
        ("constant_torque", "inertias.rotor"), ("coulomb_friction", "inertias.rotor"),
        ("sensor_offset", "sensors.speed"), ("input_offset", "inputs.motor"),
    }  # fmt: skip
    assert same <= named(one_sign)
    assert "does not tell it from" in one_sign.causes[0].evidence
    assert one_sign.causes[0].confidence < 0.5


def test_friction_is_told_apart_where_the_speed_changes_its_sign() -> None:
    found = diagnosed(mean=1.0)
    assert found.causes[0].kind in ("constant_torque", "sensor_offset")
    assert ("coulomb_friction", "inertias.rotor") not in named(found)
    assert {("constant_torque", "inertias.rotor"), ("sensor_offset", "sensors.speed")} <= named(found)


def test_confidences_of_what_is_alike_add_to_no_more_than_one(one_sign: Diagnosis) -> None:
    (cause,) = one_sign.causes
    assert cause.confidence + sum(rival.confidence for rival in cause.alternatives) <= 1 + 1e-9


def test_what_the_search_has_screened_changes_no_answer(one_sign: Diagnosis, monkeypatch: pytest.MonkeyPatch) -> None:
    """Candidates that take too little of the whole residual are left out beforehand; all are asked here."""
    monkeypatch.setattr(KnownScreening, "of", lambda *_: None)
    left_out = diagnosed(mean=20.0)
    assert left_out.to_dict() == one_sign.to_dict()


def test_candidates_are_left_out_by_their_best_guess() -> None:
    guesses = [("lag", 4.0), ("lag", 100.0), ("slip", 9.0)]
    screened = [ScreenedCandidate(kind, "inputs.motor", {}, reduction) for kind, reduction in guesses]
    assert KnownScreening(SimpleNamespace(), screened).too_small(5.0) == {("slip", "inputs.motor")}
