"""Is something there, of what kind is it, how much is left: on recordings that were answered wrongly once."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from matching.diagnosis.causes import ExtendedModel
from matching.diagnosis.data import Segment
from matching.diagnosis.diagnose import diagnose
from matching.diagnosis.moves import _taken
from matching.diagnosis.result import Diagnosis
from matching.diagnosis.screening import ScreenedCandidate
from matching.diagnosis.windows import _pairs
from matching.report.diagnosis import content, report
from modelling.effects import EFFECTS
from modelling.model_file import from_dict, load
from modelling.recordings.read import read_recording

SHARED = Path(__file__).parents[2].parent / "shared"
FINDINGS, DATA = SHARED / "findings" / "diagnosis", SHARED / "data"
with_findings = pytest.mark.skipif(not FINDINGS.exists(), reason="the shared recordings are not here")


def answered(folder: Path, recording: str, holdout: str = "") -> Diagnosis:
    system = load(folder / "model.toml")
    unseen = read_recording(folder / holdout, system) if holdout else None
    return diagnose(system, [read_recording(folder / recording, system)], unseen)


def to_do(found: Diagnosis) -> str:
    return " ".join(str(step) for step in report(content(found)).lists["What to do next"])


# --- Faults that ended a diagnosis.


def test_places_are_the_same_in_whatever_order_they_are_written() -> None:
    system = from_dict({
        "inertias": {"a": {"J": 1.0}, "b": {"J": 2.0}},
        "shafts": {"s": {"between": ["a", "b"], "stiffness": 100}},
        "inputs": {"u": {"on": "a"}},
        "sensors": {"w": {"measures": "speed", "of": "a", "uncertainty": 0.01}},
    })  # fmt: skip
    first = {"order": 1.0, "amplitude": 0.1, "phase": 0.0}
    model = ExtendedModel(system, (), {}, {})
    one = model.with_cause("geared_ripple", "inertias.a+inertias.b", first, 1e-3)
    assert not one.stands_twice
    assert one.with_cause("geared_ripple", "inertias.b+inertias.a", first, 1e-3).stands_twice
    hypothesis = SimpleNamespace(model=one, places={(c.kind, c.at) for c in one.causes})
    assert _taken(hypothesis, ScreenedCandidate("geared_ripple", "inertias.b+inertias.a", first, 9.0))
    assert not _taken(hypothesis, ScreenedCandidate("torque_ripple", "inertias.a", first, 9.0))


def test_windows_are_joined_within_their_segment_only() -> None:
    """Two segments, the second of which begins where the first one ends, as windows of an earlier fit do."""
    time = np.linspace(0, 1, 101)
    whole = Segment(time, np.zeros((101, 1)), np.zeros((101, 1)))
    windows = []
    for number, part in enumerate((whole.part(0, 51), whole.part(50, 101))):
        for first in range(0, 50, 10):
            window = part.part(first, first + 11)
            windows.append(Segment(window.time, window.inputs, window.readings, cut_from=number))
    starts = [np.array([float(i)]) for i in range(len(windows))]
    while True:
        joined, starts = _pairs(SimpleNamespace(problem=SimpleNamespace(data=SimpleNamespace(segments=windows)),
                                                starts=starts))  # fmt: skip
        if len(joined) == len(windows):
            break
        windows = joined
    assert [(w.cut_from, len(w.time)) for w in windows] == [(0, 51), (1, 51)]
    assert [float(start[0]) for start in starts] == [0.0, 5.0]


@pytest.mark.parametrize("step", [0.0, 0.01])
def test_a_torque_in_few_steps_proposes_no_rate_of_rounding(step: float) -> None:
    time = np.round(np.arange(5000) * 0.004, 3)
    torque = np.where(time < 10.004, 0.05, 0.05 + step)
    motion = SimpleNamespace(time=time, signal=lambda _: torque, per_segment=lambda f, s: f(time, s))
    for guess in EFFECTS["rate_limit"].guesses(motion, "inputs.torque"):
        rate = guess.parameters(np.ones(1))["rate"]
        assert rate * 20 > step
        assert rate > 1e-6
    low, high = EFFECTS["rate_limit"].fit_bounds("rate", 1e-15, 0.004)
    assert low < high


def test_a_wrong_stiffness_that_a_fit_left_at_zero_stays_at_zero_or_more() -> None:
    """Else a fit without one block ended below, and the diagnosis with it."""
    assert EFFECTS["wrong_parameter"].fit_bounds("value", 0.0, 0.004)[0] == 0.0


@pytest.mark.long
@with_findings
def test_a_torque_of_two_levels_is_answered() -> None:
    found = answered(FINDINGS / "two_level_input", "recording.csv")
    assert found.verdict == "unexplained"
    assert found.errors["speed"].after_holdout < 0.1 * found.errors["speed"].before_holdout


# --- Exchanges.


@with_findings
def test_gain_and_delay_of_one_sensor_take_the_place_of_an_offset() -> None:
    found = answered(FINDINGS / "offset_for_gain_and_delay", "fit.csv", "unseen.csv")
    causes = {cause.kind: cause for cause in found.causes if cause.in_model}
    assert set(causes) == {"sensor_gain", "sensor_delay"}
    assert {cause.at for cause in causes.values()} == {"sensors.gps_speed"}
    assert causes["sensor_gain"].parameters["factor"].value == pytest.approx(1.075, abs=0.005)
    assert causes["sensor_delay"].parameters["delay"].value == pytest.approx(0.65, abs=0.05)
    errors = found.errors["gps_speed"]
    assert errors.after_holdout < 0.3 * errors.before_holdout
    assert "Use extended.toml" in to_do(found)


@pytest.mark.long
@with_findings
def test_an_input_that_is_held_is_no_dead_time_beside_friction_either() -> None:
    found = answered(FINDINGS / "held_input_beside_friction", "recording.csv")
    assert found.verdict == "explained"
    assert not any(cause.kind in ("dead_time", "sensor_delay", "clock_offset") for cause in found.causes)
    assert any("held between samples" in note for note in found.notes)
    (cause,) = found.causes
    friction = next(iter(cause.parameters.values()))
    assert friction.value == pytest.approx(0.0122, rel=1e-3)
    alike = {(cause.kind, cause.at), *((rival.kind, rival.at) for rival in cause.alternatives)}
    assert ("coulomb_friction", "inertias.rotor") in alike


# --- Real and realistic drives.


@pytest.mark.long
@with_findings
def test_true_friction_beside_an_error_of_the_model_stands_in_the_extended_model() -> None:
    """Own least squares: 1.41 N·m, and 7.05 rad/s on the unseen recording, where the base model leaves 12.17."""
    found = answered(FINDINGS / "friction_left_out", "fit.csv", "unseen.csv")
    (cause,) = (cause for cause in found.causes if cause.in_model)
    assert (cause.kind, cause.at) == ("coulomb_friction", "inertias.motor")
    assert cause.there > 0.99
    assert found.errors["motor_speed"].after_holdout < 1.15 * 7.05
    assert found.verdict == "unexplained"


@pytest.mark.long
@pytest.mark.skipif(not (DATA / "dc_motor_prbs").exists(), reason="the shared recordings are not here")
def test_friction_of_a_measured_motor_is_there_and_its_rival_is_named() -> None:
    """A person's best leaves 0.1085 rad/s of the unseen part; the speed never changes its sign."""
    found = answered(DATA / "dc_motor_prbs", "fit.csv", "unseen.csv")
    (cause,) = (cause for cause in found.causes if cause.in_model)
    assert cause.at == "inertias.rotor"
    assert cause.there > 0.99
    assert cause.left["speed"][1] < 0.5 * cause.left["speed"][0]
    names = {cause.kind, *(rival.kind for rival in cause.alternatives)}
    assert {"coulomb_friction", "constant_torque"} <= names
    torque = cause.parameters["torque"]
    assert torque.value == pytest.approx(0.30, abs=0.015)
    assert found.errors["speed"].after_holdout < 1.15 * 0.1085
    assert "Use extended.toml" in to_do(found)
    assert found.judged_by == "holdout"
