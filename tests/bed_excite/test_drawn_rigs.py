"""No plan is beyond a limit: drawn rigs, four dynamometers and one on a differential among them."""

import tomllib

import numpy as np
import pytest

from matching.bed.excite import ExcitationOrder, plan_excitation
from matching.match.case_file import load_case
from tests.bed_excite.drawn_rigs import Rig, draw

ORDER = ExcitationOrder(duration=6.0, beds=2)
FRESH_SEED = 12  # of beds that the plan was not made on
ROUNDED = 1.03  # dead times are rounded to a fifth of a sample here


def check(number, folder):
    path = draw(number, folder)
    case = load_case(path)
    plan = plan_excitation(case, ORDER)
    rig, tables = (tomllib.loads((folder / f"{name}.toml").read_text(encoding="utf-8")) for name in ("rig", "case"))
    box, step = case.uncertainty, case.loop["sample_time"]
    assert max(plan.used.values()) <= 0.8 + 1e-6
    largest = {}
    undamped = np.array([
        -1.0 if quantity.name.endswith(".damping") else float(quantity.name.endswith("torque_gain"))
        for quantity in box.uncertain
    ])  # fmt: skip
    planned, fresh = box.draw(2, ORDER.seed), [*box.draw(2, FRESH_SEED), undamped]
    for positions, allowed in ((planned, 0.8 * ROUNDED), (fresh, ROUNDED)):
        for position in positions:
            for name, share in Rig(rig, tables, box.at(position)).peaks(plan, step).items():
                assert share <= allowed, (number, name, share)
                largest[name] = max(share, largest.get(name, 0.0))
    assert max(largest.values()) > 0.6  # and what the bed allows is used
    return plan, largest


def test_no_limit_is_exceeded_with_one_dynamometer_on_a_differential(tmp_path):
    check(1, tmp_path)


@pytest.mark.long
@pytest.mark.parametrize("number", [0, *range(2, 20)])
def test_no_limit_is_exceeded_on_any_of_twenty(number, tmp_path):
    check(number, tmp_path)
