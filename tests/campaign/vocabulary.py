"""What the answers of the third campaign are worth: newer causes, and torques that stand as a curve."""

from typing import Any

from tests.campaign.hard import first_right, share, wrong_and_sure

SHAPED = ("table", "position")  # categories without a cause to name: the curve is the answer
FIRST_CURVES = 3  # of the discrepancy, among which the hidden torque has to stand


def vocabulary_summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Shares by category, each with the number of recordings behind it."""
    made = [row for row in rows if "found" in row]
    by_category: dict[str, list[dict[str, Any]]] = {}
    for row in made:
        by_category.setdefault(row["order"]["category"], []).append(row)
    failed = [row["failed"] for row in rows if "failed" in row]
    return {
        "recordings": len(rows),
        "failed": failed,
        **{name: _figures(name, some) for name, some in sorted(by_category.items())},
    }


def _figures(category: str, rows: list[dict[str, Any]]) -> dict[str, Any]:
    out = {"of": len(rows), "wrong_and_sure": share([wrong_and_sure(row) for row in rows])}
    if category in SHAPED:
        return out | {"curve_at_place": share([curve_at_place(row) for row in rows])}
    if category == "clean":
        return out | {"false_alarms": share([bool(row["found"]["causes"]) for row in rows])}
    return out | {"right_first": share([first_right(row) for row in rows])}


def curve_at_place(row: dict[str, Any]) -> bool:
    """Whether one of the first curves of what is left is at the hidden torque's place, over its variable."""
    hidden = row["answer"]["causes"][0]
    axes = {key.split("_")[0] for key in hidden["parameters"]} & {"speed", "angle", "twist"} or {"angle"}
    curves = row["found"]["discrepancy"][:FIRST_CURVES]
    return any((curve["at"], curve["over"]) == (hidden["at"], *axes) for curve in curves)
