"""The fresh campaign: its orders, a perfect model at a low sampling rate, and its table."""

import numpy as np
from plant.fresh import RATES, TORQUES, WRONG, FreshOrder, fresh_cases
from plant.hidden import INSIDE, KINDS
from plant.marks import needs_compiler

from tests.campaign.fresh import table


def test_orders_are_the_same_for_the_same_seed_and_a_third_is_on_wrong_models() -> None:
    orders = fresh_cases(54, 4)
    assert orders == fresh_cases(54, 4) != fresh_cases(54, 5)
    assert all(not KINDS[kind].inside for kind in WRONG)
    assert sum(bool(order.background) for order in orders) == 18
    perfect = [(order.rate, order.torque) for order in orders if order.category == "perfect"]
    assert sorted(perfect) == sorted((rate, torque) for rate in RATES for torque in TORQUES)
    for order in orders:
        assert set(order.effects) <= set(INSIDE) or order.category == "outside"
        assert order.size in (0.0, 1.5, 6.0, 15.0, 60.0)


@needs_compiler
def test_a_perfect_model_is_recorded_at_its_rate_with_a_stepped_torque() -> None:
    case = FreshOrder("perfect", "two_mass", (), 0.0, 5, (), 200, "stepped").make(2.0)
    values = np.genfromtxt(case.recording.splitlines(), delimiter=",", skip_header=1)
    np.testing.assert_allclose(np.diff(values[:, 0]), 0.005, rtol=1e-9)
    assert case.answer["verdict"] == "adequate"
    assert len(np.unique(values[:, 1])) <= 2 + 1  # two levels; a ramp lies between samples


def row(category, hidden, named, before=0.2, after=0.1):
    causes = [{"kind": kind, "at": at, "parameters": {}} for kind, at in hidden]
    first = causes[0] if causes else {"kind": "none", "at": "", "parameters": {}}
    answer = {**first, "category": category, "causes": causes, "background": []}
    found = [{"kind": kind, "at": at, "confidence": sure, "parameters": {}} for kind, at, sure in named]
    gain = {"nrmse_before": before, "nrmse_after": after}
    return {"answer": answer, "found": {"causes": found, "gain": gain}, "seconds": 2.0}


def test_table() -> None:
    lag, slip = ("lag", "inputs.a"), ("slip", "shafts.b")
    found = table([
        row("plain", [lag], [(*lag, 0.95)]), row("plain", [lag], [(*slip, 0.95)], after=0.3),
        row("perfect", [], []), row("perfect", [], [(*slip, 0.2)]), row("outside", [], [(*slip, 0.6)]),
        {"failed": "ValueError: no"},
    ])  # fmt: skip
    assert found["plain: right first"] == [1, 2]
    assert found["perfect: any cause"] == [1, 2]
    assert found["outside: confidence over 0.5"] == [1, 1]
    assert found["causes named, unseen error higher"] == [1, 4]
    assert found["wrong causes of confidence over 0.9"] == [1, 3]
    assert found["failed"] == ["ValueError: no"]
