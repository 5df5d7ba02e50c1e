"""The campaign of diagnoses: its orders, what it makes, and its table."""

import numpy as np
import pytest
from plant.case import make_case
from plant.hidden import INSIDE, KINDS
from plant.marks import needs_compiler
from plant.orders import OTHERS, RATES, TORQUES, WRONG, Order, orders

from matching.diagnosis.diagnose import diagnose
from modelling.model_file import load
from modelling.recordings.read import read_recording
from tests.campaign.score import matches, table


def test_orders_are_the_same_for_the_same_seed_and_a_third_is_on_wrong_models() -> None:
    made = orders(90, 4)
    assert made == orders(90, 4) != orders(90, 5)
    assert all(not KINDS[kind].inside for kind in WRONG)
    assert sum(bool(order.background) for order in made) == 30
    perfect = {(order.rate, order.torque) for order in made if order.category == "perfect"}
    assert len(perfect) == 9
    assert perfect <= {(rate, torque) for rate in RATES for torque in TORQUES}
    assert {order.category for order in made} >= set(OTHERS)
    for order in made:
        assert set(order.effects) <= set(INSIDE) or order.category == "outside"
        groups = [KINDS[kind].group for kind in order.effects]
        assert len(set(groups)) == len(groups) == {"two": 2, "three": 3}.get(order.category, len(groups)) <= 3
        assert (order.category == "wrong_noise") == (order.stated_noise != 1.0)


@needs_compiler
def test_a_perfect_model_is_recorded_at_its_rate_with_a_stepped_torque() -> None:
    case = Order("perfect", "two_mass", (), 0.0, 5, (), 200, "stepped").make(2.0)
    values = np.genfromtxt(case.recording.splitlines(), delimiter=",", skip_header=1)
    np.testing.assert_allclose(np.diff(values[:, 0]), 0.005, rtol=1e-9)
    assert case.answer["verdict"] == "adequate"
    assert len(np.unique(values[:, 1])) <= 2 + 1  # two levels; a ramp lies between samples


@needs_compiler
def test_background_is_in_the_recording_and_not_in_the_answer():
    given = {"seed": 3, "duration": 2.0, "rate": 250.0}
    plain, behind = (make_case("two_mass", "sensor_gain", background=b, **given) for b in ((), ("coulomb_friction",)))
    assert [one["kind"] for one in behind.answer["causes"]] == ["sensor_gain"]
    assert [kind for kind, _ in behind.answer["background"]] == ["coulomb_friction"]
    tables = [np.genfromtxt(case.recording.splitlines(), delimiter=",", skip_header=1) for case in (plain, behind)]
    noise = float(plain.model.split("uncertainty = ")[1].split()[0])
    assert np.abs(tables[0][:, 3] - tables[1][:, 3]).max() > 5 * noise


@needs_compiler
@pytest.mark.parametrize("at", ["inertias.motor", "shafts.link"])
def test_a_table_can_be_hidden_on_an_inertia_and_in_a_shaft(at):
    case = make_case("two_mass", [("table", at)], 30.0, seed=3, duration=2.0, rate=250.0)
    assert (case.answer["kind"], case.answer["at"], case.answer["verdict"]) == ("table", at, "unexplained")
    axis = {key.split("_")[0] for key in case.answer["parameters"]} - {"torque"}
    assert axis == {"twist"} if at == "shafts.link" else axis <= {"speed", "angle"}
    torques = [value for key, value in case.answer["parameters"].items() if key.startswith("torque")]
    assert np.max(np.abs(torques)) > 10 * np.abs(torques[0])  # a bump


def row(category, hidden, named, before=0.2, after=0.1):
    causes = [{"kind": kind, "at": at, "parameters": {}} for kind, at in hidden]
    first = causes[0] if causes else {"kind": "none", "at": "", "parameters": {}}
    answer = {**first, "category": category, "causes": causes, "background": [], "outside": category == "outside"}
    found = [{"kind": kind, "at": at, "confidence": sure, "parameters": {}} for kind, at, sure in named]
    gain = {"nrmse_before": before, "nrmse_after": after}
    return {"answer": answer, "found": {"causes": found, "gain": gain}, "seconds": 2.0}


def test_table() -> None:
    lag, slip, shared = ("lag", "inputs.a"), ("slip", "shafts.b"), ("clock_offset", "sensors.a+sensors.b")
    found = table([
        row("plain", [lag], [(*lag, 0.95)]), row("plain", [lag], [(*slip, 0.95)], after=0.3),
        row("perfect", [], []), row("perfect", [], [(*slip, 0.2)]), row("outside", [], [(*slip, 0.6)]),
        row("two", [shared, slip], [("clock_offset", ["sensors.a", "sensors.b"], 0.8), (*slip, 0.9)]),
        row("two", [shared, slip], [(*slip, 0.9)]),
        {"number": "7", "failed": "ValueError: no"},
    ])  # fmt: skip
    assert found["plain: right first"] == [1, 2]
    assert found["two: all found"] == [1, 2]
    assert found["perfect: any cause that is not there"] == [1, 2]
    assert found["outside: confidence over 0.5"] == [1, 1]
    assert found["causes named, unseen error higher"] == [1, 6]
    assert found["wrong causes of confidence over 0.9"] == [1, 3]
    assert found["failed"] == ["7 ValueError: no"]


@needs_compiler
@pytest.mark.parametrize(
    ("number", "where"),
    [
        pytest.param(46, "the screening takes the angles of a shaft's ends for each other", marks=pytest.mark.long),
        pytest.param(5, "the screening promises more of a neighbouring shaft", marks=pytest.mark.long),
    ],
)
def test_a_cause_is_found_though_the_screening_prefers_a_neighbour(number, where, tmp_path):
    del where
    case = orders(72, 61403)[number].make()
    case.write(tmp_path)
    system = load(tmp_path / "model.toml")
    found = diagnose(system, [read_recording(tmp_path / "recording.csv", system)])
    assert found.verdict == "explained"
    (cause,) = found.to_dict()["causes"]
    assert matches(cause, case.answer)
    assert cause["confidence"] > 0.9
