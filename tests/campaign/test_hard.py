"""The second campaign: its orders, one recording with model error in the background, and its score."""

import numpy as np
import pytest
from plant.case import make_case
from plant.hard import CATEGORIES, hard_cases
from plant.hidden import KINDS, NEWER
from plant.marks import needs_compiler

from tests.campaign.hard import hard_summary


def test_orders_are_the_same_for_the_same_seed_and_hold_every_category():
    orders = hard_cases(60, 4)
    assert orders == hard_cases(60, 4)
    assert {order.category for order in orders} == set(CATEGORIES)
    for order in orders:
        groups = [KINDS[kind].group for kind in order.effects]
        assert len(set(groups)) == len(groups) == {"triple": 3, "clean_error": 0}.get(order.category, 1)
        assert (order.category == "newer") == bool(set(order.effects) & set(NEWER))
        assert (order.category == "wrong_noise") == (order.stated_noise != 1.0)


@needs_compiler
def test_background_is_in_the_recording_and_not_in_the_answer():
    given = {"seed": 3, "duration": 2.0, "rate": 250.0}
    plain, behind = (make_case("two_mass", "sensor_gain", background=b, **given) for b in ((), ("coulomb_friction",)))
    assert [one["kind"] for one in behind.answer["causes"]] == ["sensor_gain"]
    assert [kind for kind, _ in behind.answer["background"]] == ["coulomb_friction"]
    tables = [np.genfromtxt(case.recording.splitlines(), delimiter=",", skip_header=1) for case in (plain, behind)]
    noise = float(plain.model.split("uncertainty = ")[1].split()[0])
    assert np.abs(tables[0][:, 3] - tables[1][:, 3]).max() > 5 * noise


def row(category, hidden, named, confidence, before=0.2, after=0.1):
    causes = [{"kind": kind, "at": at} for kind, at in hidden]
    found = [{"kind": kind, "at": at, "confidence": confidence} for kind, at in named]
    return {
        "order": {"category": category}, "answer": {"causes": causes, "background": [("compliance", "shafts.link")]},
        "found": {"causes": found, "gain": {"nrmse_before": before, "nrmse_after": after}},
    }  # fmt: skip


def test_score():
    shared = ("clock_offset", "sensors.a+sensors.b")
    rows = [
        row("newer", [shared], [("clock_offset", ["sensors.a", "sensors.b"])], 0.9),
        row("newer", [shared], [("backlash", "shafts.link")], 0.9, after=0.3),
        row("clean_error", [], [("compliance", "shafts.link")], 0.99),
        row("triple", [shared, ("slip", "shafts.link")], [("slip", "shafts.link")], 0.7),
    ]
    figures = hard_summary(rows)
    assert figures["all"]["of"] == 4
    assert figures["all"]["right_first"] == pytest.approx(2 / 3)
    assert figures["all"]["all_found"] == pytest.approx(1 / 3)
    assert figures["all"]["wrong_and_sure"] == 0.25
    assert figures["all"]["unseen_worse"] == 0.25
    assert figures["newer"]["right_first"] == 0.5
