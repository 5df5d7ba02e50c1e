"""The gains of a feedback law over drawn beds: figures against the independent method, and how a match ends."""

import numpy as np
import pytest
from independent.dynamic_stiffness import Judge, check_loop
from small_bed import CASE, FEEDBACK_GAINS, write

from matching.match.case import apply
from matching.match.case_file import load_case
from matching.match.loop import control_law, frequency_response, linear_bed
from matching.match.match import match
from matching.match.robustness import drawn_beds, feedback_tuner
from matching.match.tune_observer import DAMPING_RESERVE
from matching.report.match import summary


@pytest.fixture(scope="module")
def feedback_cases(tmp_path_factory):
    """The small bed by structure."""
    text = CASE.replace('measures = ["motor_speed"]\n', "") + FEEDBACK_GAINS
    return {
        structure: load_case(write(tmp_path_factory.mktemp(structure), text.replace('"observer"', f'"{structure}"')))
        for structure in ("pi", "model_based")
    }


def test_beds_depend_on_neither_gains_nor_the_residual_vehicle(feedback_cases):
    """So a search that begins at several of them draws its beds once; another sample time makes other beds."""
    case = feedback_cases["pi"]
    part = case.residual_vehicle.parts[0]
    name = next(name for name in part.parameters if name.endswith(".J"))
    inertia = {f"residual_vehicle.{name}": 1.3 * part.parameters[name].value}
    moved = drawn_beds(apply(case, {**inertia, "loop.proportional_gain": 17.0}))
    drawn, slower = drawn_beds(case), drawn_beds(apply(case, {"loop.sample_time": 2 * case.loop["sample_time"]}))
    for what in ("A", "B", "C"):
        np.testing.assert_array_equal(getattr(moved.pool, what), getattr(drawn.pool, what))
    for what in ("held", "read", "answered", "commanded", "vehicle"):
        np.testing.assert_array_equal(getattr(moved.beds, what), getattr(drawn.beds, what))
    assert not np.allclose(slower.beds.commanded, drawn.beds.commanded)


@pytest.mark.parametrize("structure", ["pi", "model_based"])
def test_errors_damping_margin_and_noise_are_those_of_the_independent_method(structure, feedback_cases):
    case = feedback_cases[structure]
    search = feedback_tuner(case, case.moves, drawn_beds(case))
    at = np.array([0.6, 0.5, 0.6, 0.3, 0.2])
    tuned = apply(case, search.values(at))
    law = control_law(linear_bed(tuned))
    box, controller = case.uncertainty, search.controller(at)
    positions = box.spread(512)[:4]
    judge = Judge(tuned, law, search.beds.frequencies)
    verdicts = [judge.verdict(box.at(position)) for position in positions]
    search.guarded = np.arange(5)
    needed = search.required.damping_ratio * (1 + DAMPING_RESERVE)
    ratios = (search._damping_room(search.pool, controller, np.arange(5))[1:] + 1) * needed
    np.testing.assert_allclose(ratios, [verdict.damping_ratio for verdict in verdicts], rtol=1e-5)
    acting = frequency_response(controller, search._frequencies)
    of_beds = acting.at(slice(len(search._frequencies) - len(search.beds.frequencies), None))
    squares = search._squares(search.beds, of_beds)[:4]
    tolerances = case.unmeasured_tolerance, case.tolerance
    expected = [
        (verdict.unmeasured / tolerances[0]) ** 2 + (verdict.measured / tolerances[1]) ** 2 for verdict in verdicts
    ]
    np.testing.assert_allclose(squares, expected, rtol=1e-4)
    loop = check_loop(tuned, law, search.plan.uncertainty, search.required.margin_from, search.required.rolled_off_from)
    *_, noise, rolled_off, margin = search.judged(at).least
    assert margin == pytest.approx(min(loop.modulus_margin / (1.03 * 0.5) - 1, 1.0), abs=1e-4)
    assert rolled_off == pytest.approx(max(1 - 1.03 * loop.largest_rolled_off / 0.5, -100), abs=1e-3)
    assert noise == pytest.approx(1 - 1.03 * max(loop.command_noise) / search.required.command_noise, abs=0.02)


def test_feedback_that_misses_a_target_with_the_margin_over_all_is_matched_over_beds(feedback_cases):
    result = match(feedback_cases["pi"], starts=3, beds=60)
    assert any(
        "tuned over drawn beds" in note and "are those of the gains before that" in note for note in result.notes
    )
    assert result.status == "matched"
    assert result.robust.beds.stable == result.robust.beds.damped == 60
    assert result.verification.modulus_margin == result.robust.loop.modulus_margin >= 0.5
    counted_from = result.robust.required.margin_from
    assert result.verification.margin_from == result.to_dict()["modulus_margin_from"] == counted_from
    assert f"from {counted_from:.3g} Hz on, slowest pole" in summary(result.to_dict())
    assert result.response_error.after <= result.case.tolerance
