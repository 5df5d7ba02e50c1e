"""R_RVM on unseen data: against the equations written out, gaps and delays included."""

import math

import numpy as np
import pytest

from matching.diagnosis import holdout as holdout_fidelity
from matching.diagnosis.data import Segment
from matching.diagnosis.holdout import DRIVABILITY_HZ, ModelResiduals, fidelity, holdout_data
from modelling.fidelity.measures import assess_signal
from modelling.model_file import from_dict

SYSTEM = from_dict({
    "inertias": {"a": {"J": 1.0}},
    "sensors": {
        "speed": {"measures": "speed", "of": "a", "uncertainty": 0.01},
        "still": {"measures": "angle", "of": "a", "uncertainty": 0.01},
    },
})  # fmt: skip
NOISE = np.array([0.01, 0.01])
TIME = 0.002 * np.arange(4000)
DELAY = 0.004


def motion(time: np.ndarray) -> np.ndarray:
    """A sweep with a pulse, so that one delay alone fits."""
    return np.sin(2 * np.pi * (0.3 * time + 0.4 * time**2)) + 3 * np.exp(-((time - 3.0) ** 2) / 0.1)


def held_out(scatter: np.ndarray, keep: np.ndarray | None = None):
    true = motion(TIME)
    readings = np.column_stack([true + scatter, np.zeros(len(TIME))])
    if keep is not None:
        readings[~keep] = np.nan
    segment = Segment(TIME, np.zeros((len(TIME), 0)), readings, "r.csv")
    late = np.column_stack([true + scatter - motion(TIME - DELAY), np.zeros(len(TIME))]) / NOISE
    right = np.column_stack([scatter, np.zeros(len(TIME))]) / NOISE
    return holdout_data(NOISE, ModelResiduals([segment], [late]), ModelResiduals([segment], [right]))


def by_hand(measured: np.ndarray, simulated: np.ndarray, delay: float) -> float:
    """Eqs. 18 to 21 for one signal."""
    nrmse = 1 - math.sqrt(np.mean((measured - simulated) ** 2)) / (measured.max() - measured.min())
    delayed = 1 - 2 / math.pi * math.atan((6 * DRIVABILITY_HZ) ** 3 * abs(delay) ** 3)
    return math.sqrt((nrmse**2 + delayed**2) / 2)


def test_a_delayed_simulation_scores_what_the_equations_say() -> None:
    scatter = 0.01 * np.random.default_rng(3).standard_normal(len(TIME))
    found = fidelity(SYSTEM, held_out(scatter))
    assert found is not None
    (before,), (after,) = found.before.signals, found.after.signals
    assert before.delay.value == pytest.approx(DELAY, abs=4 * before.delay.standard_uncertainty + 1e-5)
    measured = motion(TIME) + scatter
    assert found.before.r_rvm == pytest.approx(by_hand(measured, motion(TIME - DELAY), DELAY), abs=2e-3)
    assert found.after.r_rvm == pytest.approx(by_hand(measured, motion(TIME), 0.0), abs=1e-5)
    assert abs(after.delay.value) < 2e-4
    assert found.after.r_rvm == pytest.approx(found.noise_floor, abs=1e-4)
    width = np.ptp(measured)
    assert found.after.r_mu == pytest.approx(1 - 0.02 / width, rel=1e-9)
    expected = math.sqrt((2 * found.after.r_rvm**2 + found.after.r_mu**2) / 3)
    assert found.after.r_xil == pytest.approx(expected, rel=1e-12)


def test_a_sensor_that_rests_does_not_count_and_is_told() -> None:
    found = fidelity(SYSTEM, held_out(np.zeros(len(TIME))))
    assert found is not None
    assert [signal.name for signal in found.after.signals] == ["speed"]
    assert any("still" in note for note in found.notes)


def test_short_gaps_are_bridged_and_a_long_one_leaves_the_longer_stretch() -> None:
    keep = np.ones(len(TIME), bool)
    keep[::50] = False
    bridged = fidelity(SYSTEM, held_out(np.zeros(len(TIME)), keep))
    keep[2500:2600] = False
    cut = fidelity(SYSTEM, held_out(np.zeros(len(TIME)), keep))
    assert bridged is not None
    assert cut is not None
    assert bridged.seconds["speed"] == pytest.approx(TIME[-1], abs=0.1)
    assert cut.seconds["speed"] == pytest.approx(5.0, abs=0.1)
    assert bridged.before.r_rvm == pytest.approx(by_hand(motion(TIME), motion(TIME - DELAY), DELAY), abs=5e-3)


def test_models_fitted_over_other_windows_are_laid_out_alike() -> None:
    readings = motion(TIME)[:, None] * [1, 1]
    whole = [
        Segment(TIME[cut], np.zeros((len(TIME[cut]), 0)), readings[cut], name)
        for name, cut in (("b", slice(0, 900)), ("a", slice(0, 500)), ("a", slice(500, 900)))
    ]
    left = [own.readings * 2 for own in whole]
    other = [2, 0, 1]
    extended = ModelResiduals([whole[i] for i in other], [left[i] for i in other])
    found = holdout_data(NOISE, ModelResiduals(whole, left), extended)
    np.testing.assert_array_equal(found.before, found.after)
    np.testing.assert_allclose(found.before, found.measured * 2 * NOISE)
    assert [part.stop - part.start for part in found.parts] == [900, 900]


def test_nothing_measured_gives_none() -> None:
    segment = Segment(TIME, np.zeros((len(TIME), 0)), np.full((len(TIME), 2), np.nan), "r.csv")
    residual = [np.full((len(TIME), 2), np.nan)]
    assert (
        fidelity(SYSTEM, holdout_data(NOISE, ModelResiduals([segment], residual), ModelResiduals([segment], residual)))
        is None
    )


def test_a_model_that_nothing_was_added_to_is_assessed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    scatter = 0.01 * np.random.default_rng(3).standard_normal(len(TIME))
    segment = Segment(TIME, np.zeros((len(TIME), 0)), np.column_stack([motion(TIME) + scatter] * 2), "r.csv")
    model = ModelResiduals([segment], [np.column_stack([scatter, scatter]) / NOISE])
    names = []
    monkeypatch.setattr(
        holdout_fidelity, "assess_signal", lambda name, *given: names.append(name) or assess_signal(name, *given)
    )
    found = fidelity(SYSTEM, holdout_data(NOISE, model, model))
    assert names == ["speed", "still"]
    assert found is not None
    assert found.before == found.after


def test_a_sensor_without_a_long_enough_part_is_named() -> None:
    keep = np.arange(len(TIME)) % 200 < 50  # parts of 50 samples, 0.3 s apart
    scatter = 0.01 * np.random.default_rng(3).standard_normal(len(TIME))
    data = held_out(scatter, keep)
    data.measured[:, 1] = motion(TIME)
    judged = fidelity(SYSTEM, data)
    assert judged is not None
    assert judged.notes == ["speed has no part of held-out data long enough for its fidelity"]
