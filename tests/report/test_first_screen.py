"""What the first screen of a match says of drawn beds, and of a rig that has no such mode; contents by hand."""

import pytest

from matching.match.findings import Finding
from matching.report.match import answer, key_figures

CONTENT = {
    "status": "matched", "structure": "observer", "limits": [],
    "asked": {"tolerance": 0.1, "unmeasured_tolerance": 0.3},
    "targets": [{"vehicle_mode": 2, "symmetry": "none", "vehicle": 10.2, "rig": None, "matched": 10.2, "met": True}],
    "response_error": {"before": 2.5, "after": 0.024, "unmeasured_after": 0.05, "band": [0.5, 30.0]},
    "beds": {"drawn": 200, "stable": 200, "damped": 200, "kept": 150, "error_median": 0.075, "error_95": 0.131,
             "unmeasured_median": 0.14, "unmeasured_95": 0.2},
    "findings": [],
}  # fmt: skip


def test_both_errors_stand_with_their_drawn_beds():
    rows = [tuple(row) for row in key_figures(CONTENT)]
    errors = [number for number, row in enumerate(rows) if row[0].startswith("response error")]
    assert [rows[number][3:] for number in errors] == [("0.024", "≤ 0.1"), ("0.05", "≤ 0.3")]
    assert [rows[number + 1][3] for number in errors] == ["0.075, 0.13", "0.14, 0.2"]
    assert ("200, 200, 150", "200") in [row[3:] for row in rows]
    assert rows[0][2] == "no such mode"


@pytest.mark.parametrize(("beyond", "said"), [
    (15, "one drawn bed in 13 is beyond 0.1"), (150, "150 of 200 drawn beds are beyond 0.1"),
])  # fmt: skip
def test_the_verdict_says_that_drawn_beds_are_beyond(beyond, said):
    found = Finding("beds_error", 0.131, 0.1, where="measured torques", beds=(beyond, 200), limits=False).to_dict()
    assert said in answer(CONTENT | {"findings": [found]})
    assert "beyond" not in answer(CONTENT)


def test_a_result_of_an_older_version_is_still_shown():
    beds = {key: value for key, value in CONTENT["beds"].items() if key != "kept"}
    older = {key: value for key, value in CONTENT.items() if key != "findings"} | {"beds": beds}
    assert ("200, 200", "200") in [tuple(row)[3:] for row in key_figures(older)]
    assert answer(older)
