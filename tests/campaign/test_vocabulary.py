"""The third campaign: its orders, a recording with a hidden table, and its score."""

import numpy as np
import pytest
from plant.case import make_case
from plant.marks import needs_compiler
from plant.vocabulary import CATEGORIES, vocabulary_cases

from tests.campaign.run import Campaign
from tests.campaign.vocabulary import vocabulary_summary

TABLE = ("table", "inertias.load", {"angle_1": 0.0, "torque_1": 0.0, "angle_2": 1.0, "torque_2": 2.0})


def test_orders_are_the_same_for_the_same_seed_and_hold_every_category():
    orders = vocabulary_cases(30, 4)
    assert orders == vocabulary_cases(30, 4)
    assert {order.category for order in orders} == set(CATEGORIES)
    assert Campaign(vocabulary=True).name != Campaign(hard=True).name != Campaign().name


@needs_compiler
@pytest.mark.parametrize("at", ["inertias.motor", "shafts.link"])
def test_a_table_can_be_hidden_on_an_inertia_and_in_a_shaft(at):
    case = make_case("two_mass", [("table", at)], 30.0, seed=3, duration=2.0, rate=250.0)
    assert (case.answer["kind"], case.answer["at"], case.answer["verdict"]) == ("table", at, "unexplained")
    axis = {key.split("_")[0] for key in case.answer["parameters"]} - {"torque"}
    assert axis == {"twist"} if at == "shafts.link" else axis <= {"speed", "angle"}
    torques = [value for key, value in case.answer["parameters"].items() if key.startswith("torque")]
    assert np.max(np.abs(torques)) > 10 * np.abs(torques[0])  # a bump


def row(category, hidden, named=(), curves=()):
    causes = [{"kind": kind, "at": at, "parameters": parameters} for kind, at, parameters in hidden]
    found = [{"kind": kind, "at": at, "confidence": confidence} for kind, at, confidence in named]
    return {
        "order": {"category": category}, "answer": {"causes": causes},
        "found": {"causes": found, "discrepancy": [{"at": at, "over": over} for at, over in curves]},
    }  # fmt: skip


def test_score():
    elsewhere = [("inertias.motor", "angle")] * 3
    rows = [
        row("table", [TABLE], curves=[("inertias.load", "time"), ("inertias.load", "angle")]),
        row("table", [TABLE], curves=[*elsewhere, ("inertias.load", "angle")]),
        row("table", [TABLE], [("backlash", "shafts.link", 0.9)], [("inertias.load", "speed")]),
        row("clean", []),
        {"order": {"category": "clean"}, "failed": "not made"},
    ]
    figures = vocabulary_summary(rows)
    assert figures["recordings"] == 5
    assert figures["failed"] == ["not made"]
    assert figures["table"] == {
        "of": 3, "wrong_and_sure": pytest.approx(1 / 3), "curve_at_place": pytest.approx(1 / 3),
    }  # fmt: skip
    assert figures["clean"] == {"of": 1, "wrong_and_sure": 0.0, "false_alarms": 0.0}
